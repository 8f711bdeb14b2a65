"""Measure the tables of docs/trace-bound.md: `python -m benchmarks.trace_document [tables]`.

`gaps` takes two hours with its time limit of ten minutes a case; `--time-limit` shortens it, and
`--method auto --time-limit inf` does by effort, not time, for a machine that is busy.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from pathlib import Path

from benchmarks.documents import replace_table
from benchmarks.trace_bounds import PROFILES, persistent_table, table, winding, with_budget
from placement.assemble import assemble
from placement.budget_curve import BudgetCurve, budget_curve
from placement.instance import load_instance
from placement.problem import Problem
from placement.solve import solve
from placement.validation import validate

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "trace-bound.md"
TABLES = ("gaps", "persistent", "closed loop", "curve", "entropy curve")
CURVE = (1, 40)
PERSISTENT_S = 300.0
SHOWN = (1, 2, 3, 5, 10, 15, 20, 30, 40)


def main() -> None:
    """Fill the tables that are asked for, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tables", nargs="*", default=list(TABLES), help=f"of {', '.join(TABLES)}")
    parser.add_argument("--time-limit", type=float, default=600.0, help="seconds for each gap")
    parser.add_argument("--method", default="diagram", help="for gaps: diagram or auto")
    parser.add_argument("--runs", type=int, default=200, help="drives for each closed loop")
    options = parser.parse_args()
    for name in options.tables:
        if name == "gaps":
            made = f"`{options.method}`, time limit {options.time_limit:.0f} s a case.\n\n"
            made += table(options.time_limit, options.method)
        elif name == "persistent":
            made = persistent_table(min(options.time_limit, PERSISTENT_S))
        elif name == "closed loop":
            made = closed_loop_table(options.runs)
        elif name == "curve":
            made = curve_table(winding("car").problem)
        elif name == "entropy curve":
            made = curve_table(entropy_problem())
        else:
            raise SystemExit(f"tables must be of {', '.join(TABLES)}, got {name!r}")
        DOCUMENT.write_text(replace_table(DOCUMENT.read_text("utf-8"), name, made), "utf-8")
        sys.stdout.write(f"{name}\n{made}\n\n")


def closed_loop_table(runs: int, budget: int = 10) -> str:
    """Return what greedy's, the swapped and auto's placements do when driven."""
    lines = [
        "| odometry | method | trace, m² | predicted rms, m | simulated rms, m "
        "| cross-track rms, m | cross-track against `auto` |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for profile in PROFILES:
        scene = winding(profile)
        problem = with_budget(scene.problem, budget)
        rows = []
        for method in ("greedy", "exchange", "auto"):
            found = solve(problem, method)
            driven = validate(scene, found.selected, runs=runs).summary["filters"]["ekf"]
            rows.append((method, found.value, driven))
        best = rows[-1][2]["cross_track_rms_m"]
        for method, value, driven in rows:
            worse = 100.0 * (driven["cross_track_rms_m"] / best - 1.0)
            lines.append(
                f"| {profile} | `{method}` | {value:.4g} | {driven['predicted_rms_m']:.3f} "
                f"| {driven['simulated_rms_m']:.3f} | {driven['cross_track_rms_m']:.3f} "
                f"| {worse:+.0f} % |"
            )
    return "\n".join(lines)


def entropy_problem() -> Problem:
    """Return `winding` under `entropy`, the odometry and errors of its instance."""
    return assemble(load_instance("winding").changed({"objective.kind": "entropy"})).problem


def curve_table(problem: Problem) -> str:
    """Return some budgets of the curve, and its time against that of its last budget alone."""
    budget_curve(problem, 1, 2)  # what is compiled is nobody's time
    solve(with_budget(problem, 2), "auto")
    started = time.process_time()
    alone = solve(with_budget(problem, CURVE[1]), "auto")
    alone_s, started = time.process_time() - started, time.process_time()
    curve = budget_curve(problem, *CURVE)
    curve_s = time.process_time() - started
    unit = curve.solutions[0].unit.replace("^2", "²")
    lines = [f"| k | value, {unit} | bound, {unit} | gap |", "| --- | --- | --- | --- |"]
    for k in SHOWN:
        s = curve.solutions[k - CURVE[0]]
        gap = "none" if s.gap is None else f"{100.0 * s.gap:.2g} %"
        lines.append(f"| {k} | {s.value:.5g} | {s.bound or 0.0:.5g} | {gap} |")
    own = "none" if alone.gap is None else f"{100.0 * alone.gap:.2g} %"
    lines.append("")
    lines.append(
        f"All forty budgets: {curve_s:.0f} s of processor time. k = {CURVE[1]} alone by `auto`: "
        f"{alone_s:.0f} s, gap {own}. Greatest gap of the curve: {worst_gap(curve)}."
    )
    return "\n".join(lines)


def worst_gap(curve: BudgetCurve) -> str:
    """Return the greatest gap of a curve and where it is."""
    gaps = [(math.inf if s.gap is None else s.gap, n) for n, s in enumerate(curve.solutions)]
    gap, n = max(gaps)
    return f"{100.0 * gap:.2g} % at k = {curve.first + n}"


if __name__ == "__main__":
    main()
