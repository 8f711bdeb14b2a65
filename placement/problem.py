"""A placement problem as solvers see it: an objective, constraints, and where candidates lie."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from models.geometry import FloatArray
from placement.cluster import Serial, Work
from placement.constraints import Constraints
from placement.interrupts import asked_to_stop
from placement.objectives.base import Objective


@dataclass(frozen=True, slots=True)
class Problem:
    """Choose candidates to optimise `objective` under `constraints`.

    `arc_length_m` (c,) places each candidate's mount along the path and `path_length_m` is the
    path's length; `uniform` needs both, and they are None for bare information problems.
    `cheap_scores()` returns a score (c,) for each candidate alone, by which `cascade` sorts poses.
    """

    objective: Objective
    constraints: Constraints
    arc_length_m: FloatArray | None = None
    path_length_m: float | None = None
    cheap_scores: Callable[[], FloatArray] | None = None

    def __post_init__(self) -> None:
        """Check that objective and constraints speak of the same candidates."""
        if self.objective.n_candidates != self.constraints.n:
            raise ValueError(
                f"constraints cover {self.constraints.n} candidates, "
                f"the objective {self.objective.n_candidates}"
            )


@dataclass(slots=True)
class Run:
    """The circumstances of one solve: randomness, the clock, and a line to whoever watches."""

    rng: np.random.Generator
    deadline: float = float("inf")  # time.monotonic() seconds
    progress: Callable[[str, float | None], None] = field(default=lambda _text, _fraction: None)
    incumbent: list[int] | None = None  # best placement so far, returned on interrupt
    score_bound: float | None = None  # best bound so far, valid at any time
    work: Work = field(default_factory=Serial)  # where parts of it may run

    def remaining(self) -> float:
        """Return the seconds left, never negative; none once Ctrl-C asked to stop."""
        if asked_to_stop():
            return 0.0
        return max(0.0, self.deadline - time.monotonic())

    def out_of_time(self) -> bool:
        """Return whether the time limit has passed, or Ctrl-C asked to stop."""
        return asked_to_stop() or time.monotonic() >= self.deadline
