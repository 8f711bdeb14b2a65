"""The plain MIP for coverage: a binary for each candidate, a level for each sample, HiGHS."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.optimize import Bounds, LinearConstraint, milp

from benchmarks.rivals.registry import Answer, CannotSayError, Limits
from benchmarks.runner.subjects import Subject
from placement.objectives.coverage import Coverage


def solve_plain(subject: Subject, limits: Limits) -> Answer:
    """Maximise Σ w z with m·z ≤ Σ x, z binary where m ≥ 2; the bound is HiGHS's word."""
    f, constraints = subject.problem.objective, subject.problem.constraints
    if not isinstance(f, Coverage) or f.partial:
        raise CannotSayError(f"a linear program has no logarithm, which {f.name} needs")
    c, t = f.n_candidates, f.information.n_samples
    rules, most = constraints.linear_rows()
    matrix = sparse.vstack(
        [
            sparse.hstack([-f.seen.T, f.times * sparse.eye_array(t)]),
            sparse.hstack([rules, sparse.csr_array((rules.shape[0], t))]),
        ]
    ).tocsr()
    lower, upper = np.zeros(c + t), np.ones(c + t)
    upper[:c][~constraints.usable()] = 0.0
    lower[constraints.required] = 1.0
    found = milp(
        -np.concatenate([np.zeros(c), f.weights]),
        constraints=LinearConstraint(matrix, -np.inf, np.concatenate([np.zeros(t), most])),
        bounds=Bounds(lower, upper),
        integrality=np.concatenate([np.ones(c), np.full(t, float(f.times > 1))]),
        options={"time_limit": limits.time_limit_s},
    )
    if found.x is None:
        raise RuntimeError(found.message)
    bound = None if found.mip_dual_bound is None else -float(found.mip_dual_bound)
    selected = [int(i) for i in np.flatnonzero(found.x[:c] > 0.5)]
    return Answer(selected, bound, nodes=int(found.mip_node_count or 0))
