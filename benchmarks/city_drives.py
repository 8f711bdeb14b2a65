"""Place cameras for a city's traffic: `python -m benchmarks.city_drives INSTANCE --store DIR`.

INSTANCE is a TOML file with `[traffic]`, `objective.kind = "entropy"` and `errors.persistent =
false`, as `benchmarks/luxembourg.toml`: cameras on the right of every carriageway, chosen for the
trajectories of all drives. Its information lies in `--store`, chunk by chunk; a run that was
stopped computes no chunk again. Printed are seconds by the clock and of processor time (children
included) and the peak of memory so far, stage by stage, then the value and its bound.

Then the result is checked: for `--check` drives, spread evenly, the referee looks through the
cameras and filters each drive anew, in plain NumPy, and the cars of `--runs` closed-loop runs are
driven along it; their rms error stands beside the one predicted.

`--out DIR` writes the cameras and all figures, `--document docs/city.md` the tables.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.city import Stages, say_table
from benchmarks.documents import existing, fill, markdown
from models.geometry import FloatArray, IntArray
from models.network import RoadNetwork
from models.roads import Road
from models.simulation import ClosedLoop, Settings, closed_loop, speed_policy
from placement.assemble import build_errors, build_odometry
from placement.atomic import prepare_folder, write_files
from placement.city.cuts import bound_trajectories
from placement.city.drives import CityDrives, city_drives
from placement.city.information import Site
from placement.city.mounts import network_mounts, network_order, refuse_unknown
from placement.city.navigate import TrajectoryProblem, greedy_trajectories, trajectory_problem
from placement.city.solve import compute_city, open_store
from placement.cluster import work_at
from placement.information.chunks import gather
from placement.instance import Instance, load_instance
from placement.obstacles import build_obstacles
from placement.output import to_json
from placement.referee.drive import Track, filter_drive
from placement.referee.sight import Eye
from placement.referee.values import eyes_through, look_past, track_of
from placement.roadway import build_routes, network_of
from placement.validation import FILTER_HZ, validate_loop
from placement.watch import watch

AGREES = 1e-6  # relative: the referee's differences leave this much
GATE = Settings().gate


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("instance", type=Path)
    parser.add_argument("--store", type=Path, required=True, help="where the chunks go")
    parser.add_argument("--out", type=Path, help="where cameras and figures go")
    parser.add_argument("--cameras", type=int, help="instead of budget.cameras")
    parser.add_argument("--check", type=int, default=10, help="drives that the referee filters")
    parser.add_argument("--runs", type=int, default=20, help="closed-loop runs of each of those")
    parser.add_argument("--document", type=existing, help="fill the tables of this document")
    parser.add_argument("--workers", type=int)
    parser.add_argument("--cluster")
    options = parser.parse_args(arguments)
    try:
        found = run(options)
    except ValueError as error:
        parser.exit(2, f"error: {error}\n")
    if options.document is not None:
        fill(options.document, tables(found))
    if not all(row["agrees"] for row in found["checked"]):
        sys.exit("error: the referee does not agree")


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Solve, prove, check, print and write."""
    instance = city_instance(options.instance)
    budget = options.cameras or instance.budget.cameras
    stages = Stages()
    work = work_at(options.workers, options.cluster)
    if options.out is not None:
        prepare_folder(options.out)
    try:
        with watch() as report:
            with stages.stage("network and drives"):
                network, drives = traffic_of(instance)
            with stages.stage("mounts"):
                site = build_site(instance, network, drives)
            store = open_store(options.store, site, _key(instance))
            with stages.stage("information"):
                computed = compute_city(site, store, work, report)
            with stages.stage("load"):
                rows = gather(store, site.n_chunks)
                group = rows.candidates // len(site.mounts.poses)
                problem = trajectory_problem(rows, group, len(site.mounts), drives)
            with stages.stage("greedy"):
                chosen, gains, looked = greedy_trajectories(problem, budget, report)
                by_drive = problem.by_drive(chosen)
                value = float(np.dot(drives.weights, by_drive))
            with stages.stage("certificate"):
                bound = max(bound_trajectories(problem, budget, chosen, progress=report), value)
            with stages.stage("check"):
                report("looking through the cameras again", None)
                checked = check(instance, problem, site, chosen, by_drive, options)
    finally:
        work.close()
    found = {
        "stages": stages.rows,
        **_summary(network, problem, site),
        "chunks": site.n_chunks,
        "chunks computed": computed,
        "cameras": len(chosen),
        "value": value,
        "first gain": float(gains[0]),
        "last gain": float(gains[-1]),
        "bound": bound,
        "gap %": round(100.0 * (bound - value) / value, 2),
        **looked,
        "selected sha256": hashlib.sha256(np.sort(rows.candidates[chosen]).tobytes()).hexdigest(),
        "checked": checked,
    }
    say_table(stages.rows)
    for key, item in found.items():
        if key not in ("stages", "checked"):
            sys.stdout.write(f"{key}: {item}\n")
    say_table(checked)
    if options.out is not None:
        cameras = cameras_csv(site, rows.candidates[chosen], gains)
        write_files(options.out, {"city.json": to_json(found), "cameras.csv": cameras})
    return found


def city_instance(path: Path) -> Instance:
    """Read an instance, and refuse what this command does not do."""
    instance = load_instance(path)
    if instance.objective.kind != "entropy" or instance.errors.persistent:
        raise ValueError(
            "a city's drives need objective.kind = entropy and errors.persistent = false, got "
            f"{instance.objective.kind} and {str(instance.errors.persistent).lower()}"
        )
    budget = instance.budget.model_fields_set - {"cameras"}
    if budget:
        raise ValueError(f"budget must hold cameras alone, got {', '.join(sorted(budget))}")
    if instance.mounts.sides != ("right",):
        raise ValueError(f'mounts.sides must be ["right"], got {list(instance.mounts.sides)}')
    if instance.objective.weights is not None:
        raise ValueError("objective.weights must be left out: only localisation weighs samples")
    refuse_unknown(instance.mounts, instance.camera)
    return instance


def traffic_of(instance: Instance) -> tuple[RoadNetwork, CityDrives]:
    """Return the network, and the drives of `[traffic]` over it."""
    from models.drives import drive_road

    network = network_of(instance)
    if network is None:
        raise ValueError("road.file must be a network of streets, got one road")
    network = replace(network, obstacles=build_obstacles(instance))
    routes = build_routes(instance, network)
    drives = city_drives(
        [(drive_road(network, route), route.weight) for route in routes],
        build_odometry(instance.vehicle),
        spacing_m=instance.road.sample_spacing_m,
        rate_hz=instance.camera.rate_hz,
        speed_mps=instance.vehicle.speed_mps,
        initial_sigma=instance.vehicle.initial_sigma,
    )
    return network, drives


def build_site(instance: Instance, network: RoadNetwork, drives: CityDrives) -> Site:
    """Put mounts along the streets; samples are those of all drives."""
    order = network_order(network)
    mounts = network_mounts(network, order, instance.mounts, instance.camera)
    return Site(
        mounts,
        drives.points,
        network.obstacles,
        build_errors(instance),
        instance.camera.max_range_m,
    )


@dataclass(frozen=True, slots=True)
class Reach:
    """The chosen cameras that stand within reach of one drive, as the referee sees them."""

    eyes: list[Eye]
    rows: IntArray


def check(
    instance: Instance,
    problem: TrajectoryProblem,
    site: Site,
    chosen: IntArray,
    by_drive: FloatArray,
    options: argparse.Namespace,
) -> list[dict[str, Any]]:
    """Filter some drives anew, by the referee, and drive them; one row a drive."""
    n = len(problem.drives)
    which = np.unique(np.linspace(0, n - 1, min(options.check, n)).astype(int))
    candidates = problem.rows.candidates[chosen]
    found = []
    for d in which.tolist():
        track, xy = _track(instance, problem.drives, d)
        near = near_drive(instance, site, candidates, xy)
        looked = (look_past(site.obstacles, eye, xy, instance) for eye in near.eyes)
        sights = [sight for sight in looked if sight.seen.any()]
        whole = filter_drive(track, sights)
        rms = math.sqrt(float(np.mean(whole.covariance[:, 0, 0] + whole.covariance[:, 1, 1])))
        row: dict[str, Any] = {
            "drive": d,
            "km": round(float(track.s_m[-1]) / 1000.0, 2),
            "cameras that see it": len(sights),
            "nats": round(float(by_drive[d]), 6),
            "referee": round(whole.log_det, 6),
            "agrees": bool(abs(whole.log_det - by_drive[d]) <= AGREES * max(1.0, by_drive[d])),
            "predicted rms m": round(rms, 3),
        }
        if options.runs and sights:
            row["driven rms m"] = round(_driven(instance, problem, site, near, d, options.runs), 3)
        found.append(row)
    return found


def _track(instance: Instance, drives: CityDrives, d: int) -> tuple[Track, FloatArray]:
    here = slice(int(drives.start[d]), int(drives.start[d + 1]))
    s = drives.points.s_m[here]
    points = drives.roads[d].evaluate(s)  # anew, not from the solver's own samples
    track = track_of(instance, points, float(s[1] - s[0]))
    return track, np.column_stack([points.x_m, points.y_m])


def near_drive(instance: Instance, site: Site, candidates: IntArray, xy: FloatArray) -> Reach:
    """Return which of the chosen cameras stand within reach of the samples `xy` of a drive."""
    cameras = site.mounts.cameras(candidates)
    rows = [
        i
        for i in range(len(candidates))
        if np.hypot(xy[:, 0] - cameras.x_m[i], xy[:, 1] - cameras.y_m[i]).min()
        <= 1.001 * instance.camera.max_range_m
    ]
    return Reach(eyes_through(cameras, rows), candidates[np.array(rows, dtype=np.int64)])


def _driven(
    instance: Instance,
    problem: TrajectoryProblem,
    site: Site,
    near: Reach,
    d: int,
    runs: int,
) -> float:
    """Return the rms error of the filter in closed-loop runs along drive d."""
    loop = drive_loop(instance, problem.drives.roads[d], site, near)
    tolerance = instance.objective.tolerance_m
    summary = validate_loop(loop, runs=runs, seed=d, tolerance_m=tolerance).summary
    return float(summary["filters"]["ekf"]["simulated_rms_m"])


def drive_loop(
    instance: Instance, road: Road, site: Site, near: Reach, gate: float = GATE
) -> ClosedLoop:
    """Return the closed loop along `road` past the cameras that stand near it."""
    return closed_loop(
        road,
        site.mounts.cameras(near.rows),
        build_errors(instance),
        odometry=build_odometry(instance.vehicle),
        speed=speed_policy(instance.vehicle.speed_mps, "kinematic"),
        plant="kinematic",
        settings=Settings(
            filter_hz=FILTER_HZ,
            frame_hz=instance.camera.rate_hz,
            gate=gate,
            initial_sigma=instance.vehicle.initial_sigma,
            max_range_m=instance.camera.max_range_m,
        ),
        obstacles=site.obstacles,
    )


def cameras_csv(site: Site, candidates: IntArray, gains: FloatArray) -> str:
    """List the cameras in the order in which they were chosen."""
    cameras = site.mounts.cameras(candidates)
    lines = ["candidate,x_m,y_m,height_m,yaw_deg,pitch_deg,hfov_deg,vfov_deg,gain"]
    for n, candidate in enumerate(candidates.tolist()):
        angles = (
            cameras.yaw_rad[n],
            cameras.pitch_rad[n],
            cameras.hfov_rad[n],
            cameras.vfov_rad[n],
        )
        numbers = (
            cameras.x_m[n],
            cameras.y_m[n],
            cameras.height_m[n],
            *np.degrees(angles),
            gains[n],
        )
        lines.append(f"{candidate}," + ",".join(f"{number:.10g}" for number in numbers))
    return "\n".join(lines) + "\n"


def tables(found: dict[str, Any]) -> dict[str, str]:
    """Lay out the document's tables."""
    stages = [[str(item) for item in row.values()] for row in found["stages"]]
    told = [
        [name, str(found[name])]
        for name in (
            "network km", "buildings", "drives", "driven km", "samples", "mounts", "poses",
            "candidates kept", "entries", "cameras", "value", "bound", "gap %", "gains looked at",
            "samples renewed",
        )
    ]  # fmt: skip
    checked = [[str(item) for item in row.values()] for row in found["checked"]]
    return {
        "drives: stages": markdown(list(found["stages"][0]), stages),
        "drives: result": markdown(["", "nats, m, counts"], told),
        "drives: check": markdown(list(found["checked"][0]), checked),
    }


def _summary(network: RoadNetwork, problem: TrajectoryProblem, site: Site) -> dict[str, Any]:
    drives = problem.drives
    return {
        "network km": round(network.length_m / 1000.0, 1),
        "buildings": len(network.obstacles),
        "drives": len(drives),
        "driven km": round(sum(road.length_m for road in drives.roads) / 1000.0),
        "samples": len(drives.points),
        "mounts": len(site.mounts),
        "poses": site.mounts.n_candidates,
        "candidates kept": len(problem.group),
        "entries": len(problem.rows.indices),
    }


def _key(instance: Instance) -> dict[str, Any]:
    """Return what the information is made of: neither budget nor objective."""
    tables = instance.as_dict()
    parts = {name: tables.get(name) for name in ("road", "traffic", "mounts", "camera", "errors")}
    files = {name: hashlib.sha256(path.read_bytes()).hexdigest()
             for name, path in sorted(instance.files.items())}  # fmt: skip
    return {**json.loads(json.dumps(parts, default=str)), "files": files}


if __name__ == "__main__":
    main()
