"""Solve a bare information problem from a file into a folder.

The folder holds `problem.npz` (what was solved), `solution.json` (the contract's keys, with no
cameras) and `placements.csv` (a row a chosen candidate), so that `placement verify` needs nothing
else.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from placement.atomic import Content, prepare_folder, write_files
from placement.experiments import read_table
from placement.information_problem import InformationProblem, read_problem
from placement.output import to_csv, to_json, versions
from placement.problem import Problem
from placement.solution import Solution, Status
from placement.watch import watch

PROBLEM_FILE = "problem.npz"


def load_bare(
    source: str, *, budget: str | None = None, objective: str | None = None
) -> tuple[InformationProblem, Problem]:
    """Read `source`, apply the command line's changes, and check it all.

    Raises:
        ValueError: one line naming the file and what is wrong.
    """
    path = Path(source)
    number = None if budget is None else _number(budget)
    if path.suffix.lower() == ".npz":
        bare = read_problem(path).changed(number, objective)
    else:
        if number is None:
            raise ValueError(f"--budget must be given with a table of experiments ({path})")
        bare = read_table(path).problem(number, path.stem).changed(objective=objective)
    try:
        return bare, bare.problem()
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def solve_bare_into(
    out: Path,
    source: str,
    *,
    method: str = "auto",
    objective: str | None = None,
    budget: str | None = None,
    time_limit_s: float = math.inf,
    seed: int = 0,
    quiet: bool = False,
    stale: tuple[str, ...] = (),
) -> Status:
    """Solve `source` and write the results to `out`; files of `stale` are removed there.

    Raises:
        ValueError: for bad input; nothing is written then.
    """
    from placement.solve import solve

    bare, problem = load_bare(source, budget=budget, objective=objective)
    prepare_folder(out)
    with watch(quiet) as report:
        report(f"solving {bare.name}", None)
        solution = solve(problem, method, time_limit_s=time_limit_s, seed=seed, progress=report)
        files: dict[str, Content] = {
            PROBLEM_FILE: bare.write,
            "solution.json": to_json(record_of(bare, problem, solution)),
        }
        if solution.status.has_placement:
            files["placements.csv"] = to_csv(candidates_table(bare, solution))
        write_files(out, files, remove=[name for name in stale if name not in files])
    if not quiet:
        for line in _lines(problem, solution, out):
            sys.stdout.write(line + "\n")
    return solution.status


def record_of(bare: InformationProblem, problem: Problem, solution: Solution) -> dict[str, Any]:
    """Return the content of `solution.json`."""
    constraints = problem.constraints
    money: dict[str, Any] = {}
    if constraints.cost is not None:
        spent = constraints.total_cost(np.array(solution.selected, dtype=np.int64))
        money = {"cost": spent, "money": constraints.money}
    return {
        "instance": bare.name,
        "objective": solution.objective,
        "unit": solution.unit,
        "method": solution.method,
        "status": str(solution.status),
        "value": solution.value,
        "upper_bound" if solution.maximise else "lower_bound": solution.bound,
        "gap": solution.gap,
        "seconds": solution.seconds,
        "budget": constraints.budget,
        "candidates": constraints.n,
        **money,
        "selected": sorted(solution.selected),
        "cameras": [],
        "stats": solution.stats,
        "seed": solution.seed,
        "versions": versions(),
        "instance_sha256": bare.sha256(),
    }


def candidates_table(bare: InformationProblem, solution: Solution) -> pd.DataFrame:
    """Return one row a chosen candidate: its number, and its cost and group where there are any."""
    chosen = np.array(sorted(solution.selected), dtype=np.int64)
    table = pd.DataFrame({"candidate": chosen})
    for name, column in (("cost", bare.cost), ("group", bare.group)):
        if column is not None:
            table[name] = np.asarray(column)[chosen]
    return table


def _lines(problem: Problem, solution: Solution, out: Path) -> list[str]:
    if not solution.status.has_placement:
        reason = solution.stats.get("reason") or solution.stats.get("error") or "no reason given"
        return [f"{solution.method}: {solution.status} ({reason}); recorded in {out}"]
    side = "at most" if solution.maximise else "at least"
    bound = "no bound" if solution.bound is None else f"{side} {solution.bound:.9g} for any"
    gap = "" if solution.gap is None else f", gap {100 * solution.gap:.3g} %"
    return [
        f"{solution.method}: {solution.status}, {len(solution.selected)} of "
        f"{problem.constraints.n} candidates, {solution.objective} {solution.value:.9g} "
        f"{solution.unit} ({bound}{gap}) in {solution.seconds:.1f} s",
        f"results in {out}",
    ]


def _number(budget: str) -> float:
    try:
        return float(budget)
    except ValueError:
        raise ValueError(
            f"--budget must be one number for a bare information problem, got {budget}"
        ) from None
