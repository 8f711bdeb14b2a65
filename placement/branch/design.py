"""The arrays that the tree of a dense design works on: candidates left, whitened, in groups."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.geometry import BoolArray, FloatArray, IntArray
from placement.branch.climb import LOG_DET, TRACE_INVERSE
from placement.objectives.log_det import LogDet
from placement.objectives.trace_inverse import TraceInverse, inverse_root
from placement.problem import Problem


def design_of(problem: Problem) -> Design:
    """Lay out the problem: usable candidates, whitened by the prior where that keeps the value."""
    objective, constraints = problem.objective, problem.constraints
    if not isinstance(objective, LogDet | TraceInverse):
        raise ValueError(f"method branch needs log_det or trace_inverse, got {objective.name}")
    if constraints.separation_m:
        raise ValueError("method branch cannot keep budget.separation_m")
    n, c, r = objective.n_states, objective.n_candidates, objective.rank
    if isinstance(objective, LogDet):  # M = L (I + Σ …) Lᵀ: the score is the second's log det
        kind, base, root, V = LOG_DET, np.eye(n), np.eye(n), objective.whitened()
        doubt = 0.0
    else:
        # The covariance of a direction that only the prior knows is as uncertain as the prior is.
        W = inverse_root(objective.prior)
        condition = float(np.trace(objective.prior) * np.sum(W * W))
        doubt = n * float(np.finfo(float).eps) * condition
        kind, base, root = TRACE_INVERSE, objective.prior.copy(), objective.root.copy()
        V = np.ascontiguousarray(objective.columns.reshape(n, c, r).transpose(1, 2, 0))
    usable = constraints.usable()
    usable[constraints.required] = True
    if kind == LOG_DET:
        usable &= np.any(V != 0.0, axis=(1, 2)) | np.isin(np.arange(c), constraints.required)
    alone = constraints.group < 0
    key = np.where(alone, constraints.group.max(initial=0) + 1 + np.arange(c), constraints.group)
    _, group = np.unique(key, return_inverse=True)
    required = np.zeros(c, dtype=np.bool_)
    required[constraints.required] = True
    cost = np.zeros(c) if constraints.cost is None else constraints.cost.astype(np.float64)
    design = Design(
        kind,
        np.ascontiguousarray(base, dtype=np.float64),
        np.ascontiguousarray(root, dtype=np.float64),
        V,
        group.astype(np.int64),
        cost,
        constraints.purse if constraints.limits_money else np.inf,
        constraints.budget,
        constraints.limits_money,
        required,
        np.arange(c),
        doubt,
    ).keep(usable)
    # Every design can be filled up to a base of the matroid, and none gets worse by it.
    most = int(np.unique(design.group).size)
    return replace(design, k=min(constraints.budget, most))


@dataclass(frozen=True, slots=True)
class Design:
    """The arrays of a problem over the candidates `ids` that are left; see `tree.search`."""

    kind: int
    base: FloatArray
    root: FloatArray
    V: FloatArray
    group: IntArray
    cost: FloatArray
    purse: float
    k: int
    priced: bool
    required: BoolArray
    ids: IntArray
    doubt: float  # relative: how far two ways of computing one score may be apart

    def keep(self, mask: BoolArray) -> Design:
        """Return the design over some of its candidates."""
        _, group = np.unique(self.group[mask], return_inverse=True)
        return Design(
            self.kind,
            self.base,
            self.root,
            np.ascontiguousarray(self.V[mask]),
            group.astype(np.int64),
            self.cost[mask],
            self.purse,
            self.k,
            self.priced,
            self.required[mask],
            self.ids[mask],
            self.doubt,
        )
