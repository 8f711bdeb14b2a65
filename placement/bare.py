"""Solve a bare information problem from a file into a folder.

The folder holds `problem.npz` (what was solved), `solution.json` (the contract's keys, with no
cameras) and `placements.csv` (a row a chosen candidate), so that `placement verify` needs nothing
else.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd

from placement.atomic import Content, prepared_folder, write_files
from placement.experiments import read_table
from placement.information_problem import InformationProblem, read_problem
from placement.interrupts import stop_on_request
from placement.output import left_behind, record_of, solution_lines, to_csv, to_json
from placement.problem import Problem
from placement.solution import Solution
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
) -> Solution:
    """Solve `source` and write the results to `out`; files of `stale` are removed there.

    Raises:
        ValueError: for bad input; nothing is written then.
    """
    from placement.solve import check_call, solve

    bare, problem = load_bare(source, budget=budget, objective=objective)
    check_call(method, time_limit_s, seed)
    with prepared_folder(out), watch(quiet) as report:
        report(f"solving {bare.name}", None)
        with stop_on_request():  # what was found is written, whenever Ctrl-C comes
            solution = solve(problem, method, time_limit_s=time_limit_s, seed=seed, progress=report)
            files: dict[str, Content] = {
                PROBLEM_FILE: bare.write,
                "solution.json": to_json(
                    record_of(bare.name, problem, solution, [], bare.sha256())
                ),
            }
            if solution.status.has_placement:
                files["placements.csv"] = to_csv(candidates_table(bare, solution))
            write_files(out, files, remove=left_behind(out, stale, files))
    if not quiet:
        chosen = f"{len(solution.selected)} of {problem.constraints.n} candidates"
        for line in solution_lines(solution, chosen, out, digits=9):
            sys.stdout.write(line + "\n")
    return solution


def candidates_table(bare: InformationProblem, solution: Solution) -> pd.DataFrame:
    """Return one row a chosen candidate: its number, and its cost and group where there are any."""
    chosen = np.array(sorted(solution.selected), dtype=np.int64)
    table = pd.DataFrame({"candidate": chosen})
    for name, column in (("cost", bare.cost), ("group", bare.group)):
        if column is not None:
            table[name] = np.asarray(column)[chosen]
    return table


def _number(budget: str) -> float:
    try:
        return float(budget)
    except ValueError:
        raise ValueError(
            f"--budget must be one number for a bare information problem, got {budget}"
        ) from None
