"""How few cameras keep a car within tolerance, how few there must be, and what plainer plans need.

`python -m benchmarks.tolerance` measures the tables of docs/tolerance.md and writes them into it;
`--print` only prints them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.documents import replace_table, table_of
from models.geometry import IntArray
from placement.assemble import Scene, assemble
from placement.fewest.beam import Beam
from placement.instance import Instance, instance_from_dict, load_instance
from placement.objectives.tolerance import Tolerance
from placement.solve import solve

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "tolerance.md"
DATA = Path(__file__).resolve().parent.parent.parent / "shared" / "data"
TOLERANCE_M = 0.29
# The sides of a grid's even and odd places: left, right, in turn, both at once.
PATTERNS = (
    ((1,), (1,)),
    ((-1,), (-1,)),
    ((1,), (-1,)),
    ((-1,), (1,)),
    ((1, -1), (1, -1)),
)
HEADER = (
    "| road | errors | fewest | at least | status | `greedy` | `uniform` | grid | seconds |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
)


def main() -> None:
    """Measure both tables: every camera working, and any one of them dark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--time-limit", type=float, default=300.0)
    parser.add_argument("--failures", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--roads", nargs="+", default=["winding", "Norisring"])
    parser.add_argument("--errors", nargs="+", default=["radius", "covariance"])
    parser.add_argument("--print", action="store_true", help="leave the document alone")
    options = parser.parse_args()
    for failures in options.failures:
        sys.stdout.write(HEADER)
        for name, errors, instance in instances(options.roads, options.errors):
            made = row(name, errors, instance, failures, options.time_limit)
            sys.stdout.write(made)
            sys.stdout.flush()
            if not options.print:
                table = "one dark" if failures else "all working"
                text = DOCUMENT.read_text(encoding="utf-8")
                rows = with_row(table_of(text, table).splitlines(), made.rstrip("\n"))
                DOCUMENT.write_text(
                    replace_table(text, table, HEADER + "\n".join(rows)), encoding="utf-8"
                )


def with_row(lines: list[str], made: str) -> list[str]:
    """Return a table's rows with that of the same road and errors replaced: `winding` first."""
    rows = {road_and_errors(line): line for line in [*lines[2:], made]}
    ordered = sorted(rows, key=lambda k: (k[0] != "winding", k[0], "persistent" in k[1], k[1]))
    return [rows[key] for key in ordered]


def road_and_errors(line: str) -> tuple[str, str]:
    """Return the first two cells of a row."""
    road, errors = (cell.strip() for cell in line.split("|")[1:3])
    return road, errors


def instances(roads: list[str], errors: list[str]) -> Iterator[tuple[str, str, Instance]]:
    """Yield each road with each error model: radius and white, covariance and persistent."""
    for road in roads:
        for model in errors:
            base = load_instance("winding")
            tables: dict[str, Any] = base.as_dict()
            if road != "winding":
                tables["road"] = {"file": str(DATA / "tracks" / f"{road}.csv")}
            tables["errors"] = {"model": model, "persistent": model == "covariance"}
            tables["objective"] = {"kind": "tolerance", "tolerance_m": TOLERANCE_M}
            tables["budget"] = {"cameras": 200}
            yield road, model, instance_from_dict(tables, name=road)


def row(name: str, errors: str, instance: Instance, failures: int, time_limit_s: float) -> str:
    """Return one row; a method that finds nothing in tolerance has a dash."""
    scene = assemble(instance.changed({"budget.failures": failures}))
    objective = scene.problem.objective
    if not isinstance(objective, Tolerance):
        raise TypeError(f"wanted the objective tolerance, got {objective.name}")
    found = solve(scene.problem, "tolerance", time_limit_s=time_limit_s)
    bound = "none" if found.bound is None else f"{np.ceil(found.bound - 1e-6):.0f}"
    persistence = "persistent" if instance.errors.persistent else "white"
    cells = [
        name,
        f"{errors}, {persistence}",
        f"**{found.value:.0f}**" if found.status.has_placement else "none",
        bound,
        str(found.status),
        greedy_count(scene, objective),
        method_count(scene, "uniform"),
        grid_count(scene, objective, 1 if found.bound is None else int(found.bound)),
        f"{found.seconds:.0f}",
    ]
    return "| " + " | ".join(cells) + " |\n"


def greedy_count(scene: Scene, objective: Tolerance) -> str:
    """Return how many cameras it takes if each in turn takes the car as far as it can."""
    found = Beam(objective, scene.problem.constraints, 1, lambda: False).search()
    return "–" if found is None else str(len(found))


def method_count(scene: Scene, method: str) -> str:
    """Return how many cameras a method needs."""
    found = solve(scene.problem, method)
    return f"{found.value:.0f}" if found.status.has_placement else "–"


def grid_count(scene: Scene, objective: Tolerance, least: int) -> str:
    """Return the fewest cameras of a regular grid: one pose, one spacing, one side or taking turns.

    Every pose of a mount, turned with the road, every whole number of mounts as spacing, every
    start, the left side, the right, both in turn or both at once; the fewest of all that are in
    tolerance. None of fewer than `least` can be.
    """
    table = poses_by_place(scene)
    for _, grid in grids(table, least):
        if objective.feasible(selected_of(table, *grid)):
            return str(selected_of(table, *grid).size)
    return "–"


def poses_by_place(scene: Scene) -> IntArray:
    """Return the candidates (pose, side, place), −1 where there is none; sides right, left."""
    candidates = scene.candidates
    s = np.round(candidates.arc_length_m, 6)
    places = np.unique(s)
    cameras = candidates.cameras
    side = candidates.mount_side[candidates.mount]
    yaw = np.round(candidates.yaw_deg * side, 3) % 360.0  # mirrored poses are one pose
    pose = np.column_stack([yaw, np.degrees(cameras.pitch_rad), np.degrees(cameras.hfov_rad)])
    _, kind = np.unique(np.round(pose, 3), axis=0, return_inverse=True)
    table = np.full((int(kind.max()) + 1, 2, places.size), -1, dtype=np.int64)
    table[kind.ravel(), (side > 0).astype(np.int64), np.searchsorted(places, s)] = np.arange(s.size)
    return table


Grid = tuple[int, int, int, int]  # pose, spacing, start and pattern of sides


def grids(table: IntArray, least: int) -> list[tuple[int, Grid]]:
    """List all grids of `least` cameras or more with their number, those of fewest first."""
    places = table.shape[2]
    found: list[tuple[int, Grid]] = []
    for kind in range(len(table)):
        for stride in range(1, 2 * places // max(least - 1, 1) + 1):
            for start in range(stride):
                for pattern in range(len(PATTERNS)):
                    size = selected_of(table, kind, stride, start, pattern).size
                    if size >= least:
                        found.append((size, (kind, stride, start, pattern)))
    return sorted(found, key=lambda grid: grid[0])


def selected_of(table: IntArray, kind: int, stride: int, start: int, pattern: int) -> IntArray:
    """Return the candidates of a grid, sorted."""
    chosen = [
        table[kind, int(side > 0), start + n * stride :: 2 * stride]
        for n in (0, 1)
        for side in PATTERNS[pattern][n]
    ]
    selected = np.sort(np.concatenate(chosen))
    return selected[selected >= 0]


if __name__ == "__main__":
    main()
