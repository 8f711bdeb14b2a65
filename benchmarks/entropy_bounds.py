"""Measure proofs of `entropy`, on `winding`: `python -m benchmarks.entropy_bounds [options]`.

One row for each odometry profile and budget: value, bound, gap, seconds, and which bound won, with
the gap of each stage beside it. Failures stay in the table. `--roads` measures other shipped
instances, or the cameras and errors of `winding` along circuits.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.chain_bounds import TRACKS, road_instance
from models.vehicle import PROFILES
from placement.assemble import Scene, assemble
from placement.instance import load_instance
from placement.objectives.entropy import Entropy
from placement.objectives.navigation_chain import Drive
from placement.problem import Problem
from placement.solution import Solution
from placement.solve import solve

BUDGETS = (5, 10, 20, 40, 80)
COLUMNS = ("profile", "k", "value", "bound", "gap, %", "status", "s", "bound from")
WHERE = ("road", "poses")
STAGES = ("relaxation", "first order", "second order", "search")


def main(arguments: Sequence[str] | None = None) -> None:
    """Solve every case, print the table as Markdown, and write it as JSON if asked to."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    parser.add_argument("--seconds", type=float, default=300.0, help="time limit of each case")
    parser.add_argument("--budgets", type=int, nargs="+", default=list(BUDGETS))
    parser.add_argument("--profiles", nargs="+", default=list(PROFILES), choices=list(PROFILES))
    parser.add_argument(
        "--persistent", action="store_true", help="installation errors that persist"
    )
    parser.add_argument("--roads", nargs="+", help="instances and circuits, instead of winding")
    parser.add_argument("--tracks", type=Path, default=TRACKS, help="folder of the circuits' files")
    options = parser.parse_args(arguments)
    head: tuple[str, ...] = (*COLUMNS, *(f"{stage}, %" for stage in STAGES))
    head = (*WHERE, *head) if options.roads else head
    sys.stdout.write(f"| {' | '.join(head)} |\n|{' --- |' * len(head)}\n")
    rows = []
    for road in options.roads or ["winding"]:
        instance = road_instance(road, options.tracks)
        if instance is None:
            sys.stderr.write(f"{road}: no file in {options.tracks.name}, left out\n")
            continue
        scene = assemble(persisting(instance) if options.persistent else instance)
        where = {"road": road, "poses": scene.problem.constraints.n} if options.roads else {}
        for profile in options.profiles:
            for budget in options.budgets:
                solution = solve(
                    entropy_problem(scene, profile, budget),
                    "auto",
                    time_limit_s=options.seconds,
                )
                rows.append({**where, **row(profile, budget, solution)})
                sys.stdout.write(f"| {' | '.join(str(rows[-1][name]) for name in head)} |\n")
                sys.stdout.flush()
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")


def winding(*, persistent: bool) -> Any:
    """Return the instance `winding`, with covariance errors that persist where asked for."""
    instance = load_instance("winding")
    return persisting(instance) if persistent else instance


def persisting(instance: Any) -> Any:
    """Return an instance with covariance errors that persist."""
    errors = instance.errors.model_copy(update={"model": "covariance", "persistent": True})
    return replace(instance, document=instance.document.model_copy(update={"errors": errors}))


def entropy_problem(scene: Scene, profile: str, budget: int) -> Problem:
    """Return the scene's candidates under `entropy` for a car of that profile."""
    sigma = np.array(scene.instance.vehicle.initial_sigma)
    drive = Drive(scene.points, scene.information, PROFILES[profile], sigma)
    return replace(
        scene.problem,
        objective=Entropy([drive]),
        constraints=replace(scene.problem.constraints, budget=budget),
    )


def row(profile: str, budget: int, solution: Solution) -> dict[str, Any]:
    """Return one row of the table; gaps in per cent of the value."""

    def gap(bound: float) -> float:
        return round(100.0 * (bound / solution.value - 1.0), 4)

    found = dict(
        zip(
            COLUMNS,
            (
                profile,
                budget,
                round(solution.value, 4),
                None if solution.bound is None else round(solution.bound, 4),
                None if solution.bound is None else gap(solution.bound),
                solution.status.value,
                round(solution.seconds, 1),
                solution.stats.get("bound_from", "none"),
            ),
            strict=True,
        )
    )
    stages = solution.stats.get("bounds", {})
    for stage in STAGES:
        bounds = [bound for name, bound in stages.items() if stage in name]
        found[f"{stage}, %"] = gap(min(bounds)) if bounds else "–"
    return found


if __name__ == "__main__":
    main()
