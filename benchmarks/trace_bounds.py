"""Prove `winding` placements for `trace`: value, bound and gap of the decision diagram.

`python -m benchmarks.trace_bounds --time-limit 600` prints the table, a row as each case ends.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

from placement.assemble import assemble
from placement.instance import load_instance
from placement.solve import solve

HEADER = (
    "| odometry | weight | k | swaps, m² | best found, m² | lower bound, m² | gap | status "
    "| seconds |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
)


def main() -> None:
    """Solve each case by `exchange` and by `diagram`; failures stay in the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--time-limit", type=float, default=600.0)
    parser.add_argument("--profiles", nargs="+", default=["car", "robot"])
    parser.add_argument("--weights", nargs="+", default=["position", "lateral"])
    parser.add_argument("--budgets", nargs="+", type=int, default=[5, 10, 20])
    options = parser.parse_args()
    sys.stdout.write(HEADER)
    for profile in options.profiles:
        for weight in options.weights:
            for budget in options.budgets:
                sys.stdout.write(row(profile, weight, budget, options.time_limit))
                sys.stdout.flush()


def row(profile: str, weight: str, budget: int, time_limit_s: float) -> str:
    """Return one row of the table."""
    instance = load_instance("winding").changed(
        {
            "objective.kind": "trace",
            "objective.weight": weight,
            "vehicle.profile": profile,
            "errors.model": "radius",
            "errors.persistent": False,
        }
    )
    scene = assemble(instance)
    problem = replace(scene.problem, constraints=replace(scene.problem.constraints, budget=budget))
    swaps = solve(problem, "exchange")
    found = solve(problem, "diagram", time_limit_s=time_limit_s)
    bound = "none" if found.bound is None else f"{found.bound:.6g}"
    gap = "none" if found.gap is None else f"{100.0 * found.gap:.3g} %"
    return (
        f"| {profile} | {weight} | {budget} | {swaps.value:.6g} | {found.value:.6g} | {bound} "
        f"| {gap} | {found.status} | {found.seconds:.0f} |\n"
    )


if __name__ == "__main__":
    main()
