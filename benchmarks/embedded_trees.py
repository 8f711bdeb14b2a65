"""Which tree should carry the cuts: `mip`'s own over HiGHS's linear programs, or SCIP's single one?

`python -m benchmarks.embedded_trees` gives both the same cuts on shipped instances, alternating,
and prints value, bound, gap and seconds, by the clock and of the processor: on a shared machine
only the latter compare.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rivals.registry import RIVALS, Limits
from benchmarks.runner.subjects import Case, Subject, load_subject
from placement.problem import Problem
from placement.solve import solve

CASES = ("straight-200", "hairpin", "s-bend", "priced", "separated", "dense-mounts")
COLUMNS = ("instance", "poses", "k", "tree", "value", "bound", "gap, %", "s", "processor s")


def main(arguments: Sequence[str] | None = None) -> None:
    """Solve every case by both, print the table, and write it as JSON if asked to."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    parser.add_argument("--seconds", type=float, default=60.0, help="time limit of each")
    parser.add_argument("--cases", nargs="+", default=list(CASES))
    options = parser.parse_args(arguments)
    sys.stdout.write(f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}\n")
    rows = []
    for name in options.cases:
        subject = load_subject(Case(name, "road", {"instance": name}))
        for tree in ("mip (HiGHS)", "SCIP"):
            rows.append(row(name, subject, tree, options.seconds))
            sys.stdout.write(f"| {' | '.join(str(rows[-1][c]) for c in COLUMNS)} |\n")
            sys.stdout.flush()
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")


def row(name: str, subject: Subject, tree: str, seconds: float) -> dict[str, Any]:
    """Solve once; values are recomputed from what was selected."""
    problem: Problem = subject.problem
    began, processor = time.monotonic(), time.process_time()
    bound: float | None
    if tree == "SCIP":
        answer = RIVALS["scip-cuts"].load()(subject, Limits(seconds, 0))
        selected, bound = answer.selected, answer.bound
    else:
        solution = solve(problem, "mip", time_limit_s=seconds)
        selected, bound = list(solution.selected), solution.bound
    took, processor = time.monotonic() - began, time.process_time() - processor
    value = problem.objective.value(np.array(sorted(selected), dtype=np.int64))
    cells = (
        name,
        problem.constraints.n,
        problem.constraints.budget,
        tree,
        round(value, 3),
        None if bound is None else round(bound, 3),
        None if bound is None else round(100.0 * (bound / value - 1.0), 4),
        round(took, 1),
        round(processor, 1),
    )
    return dict(zip(COLUMNS, cells, strict=True))


if __name__ == "__main__":
    main()
