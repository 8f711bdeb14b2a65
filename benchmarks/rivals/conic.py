"""The textbook: the concave relaxation modelled in cvxpy, solved by a conic solver, rounded.

Joshi & Boyd (2009): maximise over 0 ≤ x ≤ 1, take the k largest (one of each group), then swap
while that helps. The bound is the conic solver's own word; ours, from the same x, is computed by
the method `relaxation`.
"""

from __future__ import annotations

import importlib
import math
import time
import warnings
from typing import Any

import numpy as np
from scipy import sparse

from benchmarks.rivals.registry import Answer, CannotSayError, Limits
from benchmarks.runner.subjects import Subject
from placement.bounds.linear import best_sum
from placement.constraints import Constraints
from placement.objectives.coverage import Coverage
from placement.objectives.localisation import Localisation
from placement.objectives.log_det import LogDet
from placement.objectives.trace_inverse import TraceInverse
from placement.problem import Problem, Run
from placement.solvers.exchange import polish

cp: Any = importlib.import_module("cvxpy")  # has no types

LARGEST_LOG_DET = 120  # a dense log det of more states takes a conic solver minutes to hours
LARGEST_ENTRIES = 3_000_000


def solve_clarabel(subject: Subject, limits: Limits) -> Answer:
    """Solve by Clarabel, an interior point."""
    return _solve(subject, limits, cp.CLARABEL, {"time_limit": limits.time_limit_s})


def solve_scs(subject: Subject, limits: Limits) -> Answer:
    """Solve by SCS, operator splitting."""
    return _solve(subject, limits, cp.SCS, {"time_limit_secs": limits.time_limit_s})


def _solve(subject: Subject, limits: Limits, solver: str, options: dict[str, Any]) -> Answer:
    problem = subject.problem
    deadline = time.monotonic() + limits.time_limit_s
    x = cp.Variable(problem.constraints.n)
    score, cones = _score(problem, x)
    model = cp.Problem(cp.Maximize(score), [*cones, *_rules(problem.constraints, x)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.solve(solver=solver, **options)
    if x.value is None or not np.all(np.isfinite(x.value)):
        raise RuntimeError(f"{solver} ended with {model.status} and no x")
    selected = _rounded(problem, np.asarray(x.value, dtype=float), deadline)
    solved = model.status == cp.OPTIMAL and math.isfinite(float(model.value))
    note = "" if solved else f"{solver}: {model.status}, so no bound"
    bound = float(model.value) if problem.objective.maximise else -float(model.value)
    return Answer(selected, bound if solved else None, note=note)


def _rounded(problem: Problem, x: np.ndarray[Any, Any], deadline: float) -> list[int]:
    """Take the heaviest placement, and swap while that helps."""
    constraints = problem.constraints
    selected, _ = best_sum(constraints, np.maximum(x, 0.0) + 1e-12)
    if constraints.beyond_matroid():
        rest = np.argsort(-x, kind="stable")
        first = selected[np.argsort(-x[selected], kind="stable")]
        selected = constraints.trimmed(np.concatenate([first, rest]))
    state = problem.objective.state(selected)
    polish(problem, Run(np.random.default_rng(0), deadline=deadline), state)
    return state.selected


def _score(problem: Problem, x: Any) -> tuple[Any, list[Any]]:
    f = problem.objective
    if isinstance(f, LogDet):
        return cp.log_det(_information(f, x)) - float(np.linalg.slogdet(f.prior)[1]), []
    if isinstance(f, TraceInverse):
        return -cp.tr_inv(_information(f, x)), []
    if isinstance(f, Coverage):
        level = cp.Variable(f.information.n_samples)
        seen = sparse.csr_matrix(f.seen.T)
        rows = [level <= 1.0, f.times * level <= seen @ x]
        return f.weights @ level, rows
    if not isinstance(f, Localisation):
        raise CannotSayError(
            f"{f.name} is a recursion along the whole drive: no cvxpy model of bearable size"
        )
    if len(f.indices) > LARGEST_ENTRIES:
        raise CannotSayError(
            f"{len(f.indices):,} entries are beyond what cvxpy compiles in minutes"
        )
    return _localisation(f, x)


def _information(f: LogDet | TraceInverse, x: Any) -> Any:
    """Return prior + Σ x_i F_i F_iᵀ as an affine expression (n, n)."""
    n = f.n_states
    if n > LARGEST_LOG_DET:
        raise CannotSayError(f"a dense log det of {n} states is beyond a conic solver")
    by_candidate = f.columns.reshape(n, f.n_candidates, f.rank)
    outer = np.einsum("acr,bcr->abc", by_candidate, by_candidate).reshape(n * n, -1)
    whole = f.prior.reshape(-1) + sparse.csr_matrix(outer) @ x
    return cp.reshape(whole, (n, n), order="C")


def _localisation(f: Localisation, x: Any) -> tuple[Any, list[Any]]:
    """Σ log(1 + s Σ x J), or 2 log u with u² + q² ≤ p r for blocks [[p, q], [q, r]]."""
    seen = np.flatnonzero(np.diff(f.sample_indptr) > 0)
    weights = f.weights[seen]

    def information(column: int) -> Any:
        values = f.scale * f.blocks[:, column].astype(np.float64)
        shape = (f.n_candidates, f.information.n_samples)
        matrix = sparse.csr_matrix((values, f.indices, f.indptr), shape=shape)
        return matrix.T.tocsr()[seen] @ x

    if f.blocks.shape[1] == 1:
        return 2.0 * cp.sum(cp.multiply(weights, cp.log1p(information(0)))), []
    p, q, r = 1.0 + information(0), information(1), 1.0 + information(2)
    u = cp.Variable(len(seen))
    cone = cp.SOC(p + r, cp.vstack([2.0 * u, 2.0 * q, p - r]), axis=0)
    return 2.0 * cp.sum(cp.multiply(weights, cp.log(u))), [cone]


def _rules(constraints: Constraints, x: Any) -> list[Any]:
    upper = np.where(constraints.usable(), 1.0, 0.0)
    lower = np.zeros(constraints.n)
    lower[constraints.required] = 1.0
    matrix, limits = constraints.linear_rows()
    return [x >= lower, x <= upper, sparse.csr_matrix(matrix) @ x <= limits]
