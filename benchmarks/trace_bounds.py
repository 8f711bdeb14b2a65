"""Prove `winding` placements for `trace`: value, bound and gap of the decision diagram.

`python -m benchmarks.trace_bounds --time-limit 600` prints the table, a row as each case ends;
`--method auto --time-limit inf` does by effort, not time, for a machine that is busy.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace

from placement.assemble import Scene, assemble
from placement.instance import load_instance
from placement.problem import Problem
from placement.solve import solve

PROFILES = ("car", "robot")
WEIGHTS = ("position", "lateral")
BUDGETS = (5, 10, 20)
HEADER = (
    "| odometry | weight | k | greedy, m² | swaps, m² | best found, m² | lower bound, m² | gap "
    "| status | seconds |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
)


def main() -> None:
    """Solve each case by `exchange` and by a method that proves; failures stay in the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--time-limit", type=float, default=600.0)
    parser.add_argument("--method", default="diagram", help="auto without a limit: 20 s a case")
    parser.add_argument("--profiles", nargs="+", default=PROFILES)
    parser.add_argument("--weights", nargs="+", default=WEIGHTS)
    parser.add_argument("--budgets", nargs="+", type=int, default=BUDGETS)
    parser.add_argument(
        "--persistent", action="store_true", help="covariance errors whose offsets persist"
    )
    options = parser.parse_args()
    sys.stdout.write(HEADER)
    for profile in options.profiles:
        for weight in options.weights:
            for budget in options.budgets:
                given = profile, weight, budget, options.time_limit, options.method
                sys.stdout.write(row(*given, persistent=options.persistent))
                sys.stdout.flush()


def table(time_limit_s: float, method: str, budgets: Sequence[int] = BUDGETS) -> str:
    """Return the whole table in Markdown."""
    rows = [row(p, w, k, time_limit_s, method) for p in PROFILES for w in WEIGHTS for k in budgets]
    return (HEADER + "".join(rows)).rstrip()


def persistent_table(time_limit_s: float, budgets: Sequence[int] = BUDGETS) -> str:
    """Return the table of errors that persist, position alone, in Markdown."""
    rows = [
        row(p, WEIGHTS[0], k, time_limit_s, "auto", persistent=True)
        for p in PROFILES
        for k in budgets
    ]
    return (HEADER + "".join(rows)).rstrip()


def winding(profile: str, weight: str = "position", *, persistent: bool = False) -> Scene:
    """Return `winding` under `trace`: white errors of the `radius` model, or persistent ones."""
    instance = load_instance("winding").changed(
        {
            "objective.kind": "trace",
            "objective.weight": weight,
            "vehicle.profile": profile,
            "errors.model": "covariance" if persistent else "radius",
            "errors.persistent": persistent,
        }
    )
    return assemble(instance)


def with_budget(problem: Problem, budget: int) -> Problem:
    """Return `problem` for another number of cameras."""
    return replace(problem, constraints=replace(problem.constraints, budget=budget))


def row(
    profile: str,
    weight: str,
    budget: int,
    time_limit_s: float,
    method: str = "diagram",
    *,
    persistent: bool = False,
) -> str:
    """Return one row of the table."""
    problem = with_budget(winding(profile, weight, persistent=persistent).problem, budget)
    swaps = solve(problem, "exchange")
    found = solve(problem, method, time_limit_s=time_limit_s)
    bound = "none" if found.bound is None else f"{found.bound:.6g}"
    gap = "none" if found.gap is None else f"{100.0 * found.gap:.3g} %"
    return (
        f"| {profile} | {weight} | {budget} | {swaps.stats['greedy_value']:.6g} "
        f"| {swaps.value:.6g} | {found.value:.6g} | {bound} "
        f"| {gap} | {found.status} | {found.seconds:.0f} |\n"
    )


if __name__ == "__main__":
    main()
