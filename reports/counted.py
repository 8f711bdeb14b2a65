"""Solve with work bounded by a count, so that no table depends on how fast a machine is.

Methods look at the clock wherever they could stop. Here the clock is a counter: time is up after so
many looks, on every machine at the same place. It fits methods that only look at `Run`, as
`tolerance` does, and not those that measure how long their steps take.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from placement.interrupts import asked_to_stop, stop_on_request
from placement.problem import Problem, Run
from placement.solution import Solution
from placement.solve import METHODS, certified


@dataclass(slots=True)
class CountedRun(Run):
    """A run whose time is up after `looks` looks at the clock."""

    looks: int = 0

    def remaining(self) -> float:
        """Return infinity while looks are left, then 0."""
        self.looks -= 1
        return 0.0 if self.looks < 0 or asked_to_stop() else math.inf

    def out_of_time(self) -> bool:
        """Return whether no look is left."""
        return self.remaining() == 0.0


def solve_counted(problem: Problem, method: str, looks: int, seed: int = 0) -> Solution:
    """Solve as `placement.solve.solve` does, stopped after `looks` looks at the clock."""
    run = CountedRun(np.random.default_rng(seed), looks=looks)
    with stop_on_request():
        proposal = METHODS[method].load()(problem, run)
    return certified(problem, proposal, run, method, math.nan, seed)
