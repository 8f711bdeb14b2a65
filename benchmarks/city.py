"""Place cameras over a whole city: `python -m benchmarks.city NETWORK --store DIR [--growth]`.

NETWORK is a SUMO network (`.net.xml[.gz]`) with its buildings beside it. Mounts every 25 m on the
right of each carriageway, the default camera's poses, one sample a metre, `localisation`: one
camera a mount, 2,000 in all, or `--cameras`. What is printed, stage by stage: seconds by the clock
and of processor time (children included), and the peak of memory so far. The information lies in
`--store`, chunk by chunk; a run that was stopped goes on where it stopped.

`--growth` measures sixteenths and quarters of the city, each a run of the space-filling curve, with
as large a share of the cameras, and fits the exponent of processor time against length.

`--workers N` and `--cluster ADDRESS` say where work runs; the result is the same to the byte.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.documents import existing, fill, markdown
from models.errors import ErrorModel
from models.files.roadfile import read_road_file
from models.network import RoadNetwork
from placement.city.information import Site
from placement.city.mounts import network_mounts, network_order
from placement.city.solve import (
    METHODS,
    CityProblem,
    CitySolution,
    compute_city,
    load_city,
    open_store,
    solve_city,
)
from placement.cluster import Work, cores, work_at
from placement.instance.schema import CameraSection, MountsSection
from placement.watch import watch

RANGE_M = 60.0  # at the default report limit of 2 m no pose of 6 m reaches further than 34 m
PRIOR_SIGMA_M = 0.5
# Which sixteenths and quarters stand for all: spread over the city.
GROWTH = ((16, (1, 6, 11, 14)), (4, (0, 2)), (1, (0,)))
_UNTOLD = ("stages", "selected sha256", "placement_seconds", "certificate_seconds")


@dataclass(slots=True)
class Stages:
    """Seconds and memory of each stage of a run."""

    rows: list[dict[str, Any]] = field(default_factory=list)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure a block."""
        clock, used = time.perf_counter(), _processor_s()
        yield
        self.rows.append(
            {
                "stage": name,
                "seconds": round(time.perf_counter() - clock, 2),
                "processor s": round(_processor_s() - used, 2),
                "peak GiB": round(_peak_gib(), 2),
            }
        )

    def processor_s(self, *names: str) -> float:
        """Return the processor time of the named stages together."""
        return float(sum(row["processor s"] for row in self.rows if row["stage"] in names))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what the command line asks for and print tables as Markdown."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("network", type=Path)
    parser.add_argument("--store", type=Path, required=True, help="where the chunks go")
    parser.add_argument("--cameras", type=int, default=2000)
    parser.add_argument("--spacing", type=float, default=25.0, help="metres between mounts")
    parser.add_argument("--method", choices=METHODS, default="lazy")
    parser.add_argument("--growth", action="store_true")
    parser.add_argument("--workers", type=int)
    parser.add_argument("--cluster")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    parser.add_argument("--document", type=existing, help="fill the tables of this document")
    options = parser.parse_args(arguments)
    try:
        measure(options)
    except ValueError as error:
        parser.exit(2, f"error: {error}\n")


def measure(options: argparse.Namespace) -> None:
    """Run the city, or parts of it; print, and write what was asked for."""
    work = work_at(options.workers, options.cluster)
    try:
        stages = Stages()
        with stages.stage("network"):
            network = read_road_file(options.network)
        digest = hashlib.sha256(options.network.read_bytes()).hexdigest()
        found = growth(network, digest, options, work) if options.growth else {}
        if not options.growth:
            solution, problem = run(network, digest, (1, 0), options, work, stages)
            found = {"stages": stages.rows, **summary(network, problem, solution)}
            say_table(stages.rows)
            _say("\n".join(f"{key}: {value}" for key, value in found.items() if key != "stages"))
    finally:
        work.close()
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
    if options.document is not None:
        fill(options.document, tables(found))


def run(
    network: RoadNetwork,
    digest: str,
    part: tuple[int, int],
    options: argparse.Namespace,
    work: Work,
    stages: Stages,
) -> tuple[CitySolution, CityProblem]:
    """Solve part (n, i): the i-th of n runs of the curve through the city."""
    n, i = part
    with stages.stage("mounts"):
        site = build_site(network, part, options.spacing)
    key = {"network": digest, "part": list(part), "spacing_m": options.spacing}
    store = open_store(options.store / f"{n}-{i}", site, key)
    with watch() as report:
        with stages.stage("information"):
            compute_city(site, store, work, report)
        with stages.stage("load"):
            problem = load_city(site, store, PRIOR_SIGMA_M)
        with stages.stage("greedy and certificate"):
            solution = solve_city(
                problem,
                max(1, options.cameras // n),
                method=options.method,
                work=work,
                progress=report,
            )
    return solution, problem


def build_site(network: RoadNetwork, part: tuple[int, int], spacing_m: float) -> Site:
    """Sample part (n, i) of the network and put mounts beside it."""
    n, i = part
    order = network_order(network)
    lengths = np.cumsum([network.edges[e].length_m for e in order])
    share = (lengths / lengths[-1] * n).astype(np.int64).clip(0, n - 1)
    order = [e for e, s in zip(order, share.tolist(), strict=True) if s == i]
    samples = network.sample(1.0, order)
    mounts = network_mounts(
        network, order, MountsSection(spacing_m=spacing_m, sides=("right",)), CameraSection()
    )
    return Site(mounts, samples.points, network.obstacles, ErrorModel("covariance"), RANGE_M)


def growth(
    network: RoadNetwork, digest: str, options: argparse.Namespace, work: Work
) -> dict[str, Any]:
    """Measure parts of the city, and fit the exponent of processor time against samples."""
    run(network, digest, (256, 77), options, work, Stages())  # compiles everything
    rows: list[dict[str, Any]] = []
    for n, parts in GROWTH:
        times, samples, gaps = [], [], []
        for i in parts:
            stages = Stages()
            solution, problem = run(network, digest, (n, i), options, work, stages)
            times.append(stages.processor_s("information", "load", "greedy and certificate"))
            samples.append(problem.n_samples)
            gaps.append(solution.gap)
        rows.append(
            {
                "part": f"1/{n}",
                "km": round(float(np.mean(samples)) / 1000.0, 1),
                "processor s": round(float(np.mean(times)), 2),
                "gap %": round(100.0 * max(gaps), 3),
            }
        )
    say_table(rows)
    km, seconds = (np.array([row[key] for row in rows], float) for key in ("km", "processor s"))
    exponent = float(np.polyfit(np.log(km), np.log(seconds), 1)[0])
    _say(f"exponent: {exponent:.3f}")
    return {"growth": rows, "exponent": round(exponent, 4)}


def tables(found: dict[str, Any]) -> dict[str, str]:
    """Lay out the document's tables of a run, or of its growth."""
    if "growth" in found:
        rows = [[str(item) for item in row.values()] for row in found["growth"]]
        head = list(found["growth"][0])
        rows.append(["exponent", "", str(found["exponent"]), ""])
        return {"city: growth": markdown(head, rows)}
    stages = [[str(item) for item in row.values()] for row in found["stages"]]
    told = [[name, str(item)] for name, item in found.items() if name not in _UNTOLD]
    return {
        "city: stages": markdown(list(found["stages"][0]), stages),
        "city: result": markdown(["", "nats, m, counts"], told),
    }


def summary(network: RoadNetwork, problem: CityProblem, solution: CitySolution) -> dict[str, Any]:
    """Return what a run found."""
    return {
        "network km": round(network.length_m / 1000.0, 1),
        "buildings": len(network.obstacles),
        "samples": problem.n_samples,
        "mounts": problem.n_mounts,
        "candidates kept": len(problem.group),
        "entries": len(problem.rows.indices),
        "cameras": len(solution.selected),
        "value": solution.value,
        "bound": solution.bound,
        "gap %": round(100.0 * solution.gap, 4),
        "price": solution.price,
        **solution.stats,
        "selected sha256": hashlib.sha256(solution.selected.tobytes()).hexdigest(),
        "processors": cores(),
    }


def _processor_s() -> float:
    own, children = (
        resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime


def _peak_gib() -> float:
    """Return the peak of this process, and of the largest child that has ended, together."""
    peaks: list[int] = [
        resource.getrusage(who).ru_maxrss
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    ]
    return sum(peaks) / 2**20


def say_table(rows: Sequence[dict[str, Any]]) -> None:
    """Print rows that share their keys as a table in Markdown."""
    if rows:
        _say(markdown(list(rows[0]), [[str(item) for item in row.values()] for row in rows]))


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")


if __name__ == "__main__":
    main()
