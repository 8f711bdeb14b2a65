"""What theory promises of greedy and of all that only improves on it, and where it stops.

Each factor is of the best placement's value, for monotone submodular scores that are 0 for the
empty placement (`localisation`, `entropy`). There is none for `trace`, `final_entropy`, for
separation (not a matroid), nor for money beside a count or groups: there the instance's own gap
is all there is, and it is nearly always far better than the factor anyhow.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from placement.constraints import Constraints
from placement.problem import Problem

BUDGET = 1.0 - 1.0 / math.e
MATROID = 0.5
MONEY = 0.5 * BUDGET


def greedy_guarantee(problem: Problem, finished: bool = True) -> dict[str, Any]:
    """Return `{"guarantee": {"factor", "holds_for", "source"}}`, or nothing where none holds.

    `finished` says that greedy was not stopped on its way. Required poses do no harm: the factor
    then holds for the gain over them (contraction keeps matroids and submodularity).
    """
    constraints = problem.constraints
    if not finished or not problem.objective.submodular or constraints.separation_m:
        return {}
    if constraints.limits_money:
        if not _is_ungrouped(constraints) or not _money_alone_limits(constraints):
            return {}
        return _said(
            MONEY, "a monotone submodular score under a money budget", "Leskovec et al. 2007"
        )
    if _is_ungrouped(constraints):
        return _said(
            BUDGET, "a monotone submodular score under a budget", "Nemhauser, Wolsey & Fisher 1978"
        )
    return _said(
        MATROID,
        "a monotone submodular score with one camera a mount",
        "Fisher, Nemhauser & Wolsey 1978",
    )


def _said(factor: float, holds_for: str, source: str) -> dict[str, Any]:
    return {"guarantee": {"factor": factor, "holds_for": holds_for, "source": source}}


def _is_ungrouped(constraints: Constraints) -> bool:
    """Whether no two candidates that could both be chosen share a group."""
    usable = constraints.usable()
    usable[constraints.required] = False
    groups = constraints.group[usable]
    groups = groups[groups >= 0]
    return bool(np.unique(groups).size == groups.size)


def _money_alone_limits(constraints: Constraints) -> bool:
    """Whether the count can never be what stops a placement from growing."""
    usable = constraints.usable()
    if constraints.cost is None or int(usable.sum()) <= constraints.budget:
        return True
    cheapest = np.sort(constraints.cost[usable])[: constraints.budget + 1]
    return bool(math.fsum(cheapest) > constraints.purse)
