"""A-optimal design: the trace of the covariance that a prior and the chosen candidates leave.

    f(S) = tr (Λ + Σ_{i ∈ S} F_i F_iᵀ)⁻¹, to be minimised

Convex in fractional choices, so relaxations bound it from below; falling in S, but without
diminishing returns in general, so greedy promises nothing.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from models.geometry import FloatArray, IntArray
from placement.objectives.dense_design import DenseDesign, Selection


class TraceInverse(DenseDesign):
    """Score sets of candidates by the trace of the covariance, in units of the state squared."""

    name = "trace_inverse"
    unit = "state^2"
    maximise = False
    submodular = False

    def value(self, selected: IntArray) -> float:
        """Evaluate a set by LU, apart from the states."""
        return float(np.trace(np.linalg.inv(self.information(selected))))

    def state(self, selected: IntArray | None = None) -> TraceInverseState:
        """Start a set, empty unless `selected` is given."""
        state = TraceInverseState(self)
        for candidate in [] if selected is None else selected:
            state.add(int(candidate))
        return state

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return −tr (Λ + Σ x_i F_i F_iᵀ)⁻¹ and its gradient (c,) at `x` (c,) ≥ 0."""
        W = inverse_root(self.relaxed_information(x))
        pulled = W.T @ (W @ self.columns)
        slopes = np.sum(pulled * pulled, axis=0).reshape(self.n_candidates, self.rank)
        return -float(np.sum(W * W)), slopes.sum(axis=1)


class TraceInverseState:
    """Keep the information of the chosen candidates and the inverse of its Cholesky factor."""

    def __init__(self, objective: TraceInverse) -> None:
        """Start empty."""
        self._objective = objective
        self._set = Selection(objective.n_candidates)
        self._W: FloatArray | None = None

    @property
    def selected(self) -> list[int]:
        """The candidates chosen so far, in the order they were added."""
        return list(self._set.order)

    @property
    def score(self) -> float:
        """Minus the trace of the covariance of `selected`."""
        W = self._factor()
        return -float(np.sum(W * W))

    def gains(self, candidates: IntArray | None = None) -> FloatArray:
        """Return the change of the score on adding each of `candidates` (default: all), (m,).

        tr (I + FᵀΘF)⁻¹ FᵀΘ²F, Θ the covariance so far; 0 for a candidate already selected.
        """
        f = self._objective
        rows = np.arange(f.n_candidates) if candidates is None else np.asarray(candidates)
        W, r = self._factor(), f.rank
        half = W @ (f.columns if candidates is None else f.factor(rows))
        pulled = W.T @ half
        if r == 1:
            gains = np.sum(pulled * pulled, axis=0) / (1.0 + np.sum(half * half, axis=0))
        else:
            blocks, outer = (
                array.reshape(f.n_states, len(rows), r).transpose(1, 2, 0)
                for array in (half, pulled)
            )
            inner = np.eye(r) + blocks @ blocks.transpose(0, 2, 1)
            products = outer @ outer.transpose(0, 2, 1)
            gains = np.trace(np.linalg.solve(inner, products), axis1=1, axis2=2)
        return np.where(self._set.inside[rows], 0.0, gains)

    def add(self, candidate: int) -> None:
        """Add one candidate; ValueError if it is there already or does not exist."""
        self._set.add(candidate)
        self._W = None

    def remove(self, candidate: int) -> None:
        """Remove one candidate; ValueError if it is not selected."""
        self._set.remove(candidate)
        self._W = None

    def _factor(self) -> FloatArray:
        if self._W is None:
            f = self._objective
            F = f.factor(np.array(self._set.order, dtype=np.int64))
            self._W = inverse_root(f.prior + F @ F.T)
        return self._W


def inverse_root(M: FloatArray) -> FloatArray:
    """Return W = chol(M)⁻¹, lower triangular."""
    W: FloatArray = solve_triangular(
        np.linalg.cholesky(M), np.eye(len(M)), lower=True, check_finite=False
    )
    return W
