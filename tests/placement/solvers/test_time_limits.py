"""Time limits on a full-size road: what a method still does once its time is up.

Counted in processor seconds, which other work on the machine does not stretch: less than one
second of each of two processors, or a tenth of the limit.
"""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.entropy_bounds import entropy_problem
from placement.assemble import Scene, assemble
from placement.instance import load_instance
from placement.objectives.navigation_chain import Drive
from placement.objectives.trace import Trace
from placement.problem import Problem
from placement.solution import Status
from placement.solve import METHODS, solve

OVER_S = 2.0
CASES = [
    *(("localisation", m) for m in ("greedy", "exchange", "search", "relaxation", "mip", "chain")),
    *(("entropy", m) for m in ("exchange", "search", "relaxation", "mip", "tempered")),
    *(("trace", m) for m in ("exchange", "hill-climb", "cascade", "diagram", "auto")),
]


@cache
def scene() -> Scene:
    return assemble(load_instance("winding"))


def full_size(kind: str) -> Problem:
    rules = replace(scene().problem.constraints, budget=40)
    if kind == "localisation":
        return replace(scene().problem, constraints=rules)
    problem = entropy_problem(scene(), "car", 40)
    if kind == "trace":
        (drive,) = problem.objective.drives  # type: ignore[attr-defined]
        drive = Drive(drive.points, drive.information, drive.odometry, np.array([0.1, 0.1, 0.01]))
        return replace(problem, objective=Trace([drive]))
    return problem


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "method"), CASES)
def test_little_is_done_once_time_is_up(kind: str, method: str) -> None:
    problem = full_size(kind)
    solve(problem, method, time_limit_s=0.0)  # load code: what is compiled once is not counted
    for limit_s in (0.5, 4.0):
        at_limit: list[float] = []
        timer = threading.Timer(limit_s, lambda seen=at_limit: seen.append(time.process_time()))
        timer.start()
        found = solve(problem, method, time_limit_s=limit_s)
        ended = time.process_time()
        timer.cancel()
        assert not problem.constraints.violations(found.selected)
        assert found.status in (Status.TIME_LIMIT, Status.FEASIBLE, Status.OPTIMAL), found.stats
        if at_limit:
            assert ended - at_limit[0] <= max(OVER_S, 0.1 * limit_s), (kind, method, limit_s)
        if METHODS[method].proves_bound and problem.objective.submodular:
            assert found.bound is not None
