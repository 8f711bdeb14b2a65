"""Prove `localisation` on `winding` and real circuits: `python -m benchmarks.chain_bounds`.

A row a road and budget, each within its time limit: value, bound, gap, and the solver's seconds
by the clock and of all processors together; those of the information go to stderr. Roads whose
files are not there are left out, and said to be.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from placement.assemble import assemble
from placement.instance import instance_from_dict, load_instance, shipped_instances
from placement.solution import Solution
from placement.solve import solve

TRACKS = Path(__file__).resolve().parent.parent.parent / "shared" / "data" / "tracks"
ROADS = ("winding", "Norisring", "Spielberg", "Monza")
BUDGETS = (10, 20, 40, 80)
COLUMNS = (
    "road",
    "poses",
    "k",
    "value",
    "bound",
    "gap, %",
    "status",
    "s",
    "processor s",
    "bound from",
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Solve every case, print the table as Markdown, and write it as JSON if asked to."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    parser.add_argument("--seconds", type=float, default=60.0, help="time limit of each case")
    parser.add_argument("--budgets", type=int, nargs="+", default=list(BUDGETS))
    parser.add_argument("--roads", nargs="+", default=list(ROADS))
    parser.add_argument("--tracks", type=Path, default=TRACKS, help="folder of the circuits' files")
    options = parser.parse_args(arguments)
    sys.stdout.write(f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}\n")
    rows = []
    for road in options.roads:
        instance = road_instance(road, options.tracks)
        if instance is None:
            sys.stderr.write(f"{road}: no file in {options.tracks.name}, left out\n")
            continue
        started = time.monotonic()
        scene = assemble(instance)
        sys.stderr.write(f"{road}: information in {time.monotonic() - started:.1f} s\n")
        for budget in options.budgets:
            rules = replace(scene.problem.constraints, budget=budget)
            problem = replace(scene.problem, constraints=rules)
            began = time.process_time()
            solution = solve(problem, time_limit_s=options.seconds)
            rows.append(row(road, budget, rules.n, solution, time.process_time() - began))
            sys.stdout.write(f"| {' | '.join(str(rows[-1][name]) for name in COLUMNS)} |\n")
            sys.stdout.flush()
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")


def road_instance(road: str, tracks: Path) -> Any:
    """Return a shipped instance, or `winding`'s along a circuit; None if that has no file."""
    if road in shipped_instances():
        return load_instance(road)
    instance = load_instance("winding")
    file = tracks / f"{road}.csv"
    if not file.exists():
        return None
    document = instance.as_dict()
    document["road"] = {"file": str(file)}
    document["mounts"] |= {"side_offset_m": 1.5}
    return instance_from_dict(document, name=road)


def row(
    road: str, budget: int, poses: int, solution: Solution, processor_s: float
) -> dict[str, Any]:
    """Return one row of the table."""
    bound = solution.bound
    cells = (
        road,
        poses,
        budget,
        round(solution.value, 3),
        None if bound is None else round(bound, 3),
        None if solution.gap is None else round(100.0 * solution.gap, 4),
        solution.status.value,
        round(solution.seconds, 1),
        round(processor_s, 1),
        solution.stats.get("bound_from", "none"),
    )
    return dict(zip(COLUMNS, cells, strict=True))


if __name__ == "__main__":
    main()
