"""What a solve returns: the placement, its value, the proven bound, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

OPTIMAL_GAP = 1e-6


class Status(StrEnum):
    """How a solve ended."""

    OPTIMAL = "optimal"  # the proven gap is at most OPTIMAL_GAP
    FEASIBLE = "feasible"  # a placement, with or without a bound
    TIME_LIMIT = "time_limit"  # the incumbent when time ran out or the user stopped it
    INFEASIBLE = "infeasible"  # no placement obeys the constraints
    NUMERICAL_ERROR = "numerical_error"  # the method failed; there may be an incumbent

    @property
    def has_placement(self) -> bool:
        """Whether a solution that ended so holds a placement to be relied on."""
        return self not in (Status.INFEASIBLE, Status.NUMERICAL_ERROR)


@dataclass(frozen=True, slots=True)
class Proposal:
    """What a solver hands to the verb: nothing in it is believed until it is recomputed.

    `score_bound` is an upper bound on the score of every placement (None: the method proves
    nothing), already rounded outwards by its own error allowance.
    """

    selected: list[int]
    score_bound: float | None = None
    status: Status = Status.FEASIBLE
    stats: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Solution:
    """A placement with its certificate.

    `value` is recomputed from `selected`; `bound` bounds the value of every placement (from
    above where the objective is maximised, from below where minimised), or is None.
    """

    objective: str
    unit: str
    maximise: bool
    method: str
    status: Status
    selected: tuple[int, ...]
    value: float
    bound: float | None
    seconds: float
    seed: int
    stats: dict[str, Any]

    @property
    def empty_handed(self) -> bool:
        """Whether it was stopped before its first camera was placed."""
        return self.status is Status.TIME_LIMIT and not self.selected

    @property
    def gap(self) -> float | None:
        """Return |bound − value| / |value|; None without a bound, 0 where both are 0."""
        if self.bound is None or not np.isfinite(self.bound) or not np.isfinite(self.value):
            return None
        distance = abs(self.bound - self.value)
        if distance == 0.0:
            return 0.0
        return distance / abs(self.value) if self.value else None
