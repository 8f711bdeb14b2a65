"""D-optimal design: the log det of a prior and the chosen candidates' information, dense.

    f(S) = log det(Λ + Σ_{i ∈ S} F_i F_iᵀ) − log det Λ

for any state dimension n and rank r of the factors F_i (n, r). Monotone and submodular, concave
in fractional choices.

A state keeps Y_i = M^{-1/2} F_i, M the information so far. Adding a column y of Y turns every
other by I − γ y yᵀ, γ = (1 − 1/√(1 + y·y)) / y·y, the square root of Sherman and Morrison's
formula: nothing is subtracted from a sum, so a prior of 1e-6 costs no digits, where downdating
y·y itself loses half of them. Turns are stored and made up for when a candidate's gain is asked
for, so that lazy greedy pays for whom it looks at.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular

from models.geometry import FloatArray, IntArray
from placement.objectives.dense_design import DenseDesign, Selection


class LogDet(DenseDesign):
    """Score sets of candidates by the log det of what they tell about a state, in nats."""

    name = "log_det"
    unit = "nats"
    maximise = True
    submodular = True

    def __init__(self, prior: ArrayLike, factors: ArrayLike) -> None:
        """Check the arrays; see `DenseDesign`."""
        super().__init__(prior, factors)
        self._whitened: FloatArray | None = None
        self._first_gains: FloatArray | None = None

    def value(self, selected: IntArray) -> float:
        """Evaluate a set by QR, apart from the states; nothing known is worth 0, not an ulp less.

        log det(I + Σ L⁻¹F (L⁻¹F)ᵀ), Λ = LLᵀ: a difference of two log dets would lose what a prior
        of condition 1e8 loses twice.
        """
        chosen = self.checked(selected)
        root = _root_above_one(self.whitened()[chosen].reshape(-1, self.n_states))
        return max(2.0 * float(np.sum(np.log(np.abs(np.diag(root))))), 0.0)

    def state(self, selected: IntArray | None = None) -> LogDetState:
        """Start a set, empty unless `selected` is given."""
        state = LogDetState(self)
        for candidate in [] if selected is None else selected:
            state.add(int(candidate))
        return state

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return log det(Λ + Σ x_i F_i F_iᵀ) − log det Λ and its gradient (c,) at `x` (c,) ≥ 0."""
        half = self.whitened().reshape(-1, self.n_states)  # (c·r, n)
        weights = np.repeat(np.asarray(x, dtype=float), self.rank)
        counting = np.flatnonzero(weights > 0.0)
        root = _root_above_one(half[counting] * np.sqrt(weights[counting])[:, None])
        score = max(2.0 * float(np.sum(np.log(np.abs(np.diag(root))))), 0.0)
        pulled = solve_triangular(root, half.T, trans="T", check_finite=False)
        slopes = np.sum(pulled * pulled, axis=0).reshape(self.n_candidates, self.rank)
        return score, slopes.sum(axis=1)

    def whitened(self) -> FloatArray:
        """Return Λ^{-1/2} F_i, a candidate's columns as rows: (c, r, n), made once."""
        if self._whitened is None:
            half = solve_triangular(self.root, self.columns, lower=True, check_finite=False)
            rows = half.reshape(self.n_states, self.n_candidates, self.rank)
            self._whitened = np.ascontiguousarray(rows.transpose(1, 2, 0))
        return self._whitened

    def first_gains(self) -> FloatArray:
        """Return every candidate's gain over the empty set, (c,), made once."""
        if self._first_gains is None:
            Y, none = self.whitened(), np.empty((0, self.n_states))
            made_up = np.zeros(self.n_candidates, dtype=np.int64)
            gains = np.empty(self.n_candidates)
            gains_after(np.arange(self.n_candidates), Y, made_up, none, np.empty(0), 0, gains)
            self._first_gains = gains
        return self._first_gains


def _root_above_one(half: FloatArray) -> FloatArray:
    """Return the upper triangular R (n, n) with RᵀR = I + halfᵀ half, `half` (m, n).

    By QR of both on top of each other: in I + halfᵀ half an eigenvalue of 1 beside one of 1e16
    would be lost, here it keeps half its digits.
    """
    stacked = np.vstack([np.eye(half.shape[1]), half])
    return np.asarray(np.linalg.qr(stacked, mode="r"), dtype=np.float64)


class LogDetState:
    """Keep the whitened factors of all candidates, turned lazily as the set grows."""

    _Y: FloatArray | None

    def __init__(self, objective: LogDet) -> None:
        """Start empty."""
        self._objective = objective
        self._set = Selection(objective.n_candidates)
        self._restart()

    @property
    def selected(self) -> list[int]:
        """The candidates chosen so far, in the order they were added."""
        return list(self._set.order)

    @property
    def score(self) -> float:
        """The score of `selected`, in nats: the gains of those added, in order."""
        return self._score

    def gains(self, candidates: IntArray | None = None) -> FloatArray:
        """Return the change of the score on adding each of `candidates` (default: all), (m,).

        log det(I + Y_iᵀ Y_i); 0 for a candidate already selected.
        """
        if candidates is None:
            rows = np.arange(self._objective.n_candidates)
        else:
            rows = np.asarray(candidates, dtype=np.int64)
        if not self._turns:  # nothing has been added: known since the objective was made
            return self._objective.first_gains()[rows].copy()
        if self._Y is None:
            self._Y = self._objective.whitened().copy()
        gains = np.empty(len(rows))
        gains_after(rows, self._Y, self._made_up, self._axes, self._pulls, self._turns, gains)
        gains[self._set.inside[rows]] = 0.0
        return gains

    def add(self, candidate: int) -> None:
        """Add one candidate; ValueError if it is there already or does not exist."""
        self._set.add(candidate)
        self._turn(int(candidate))

    def remove(self, candidate: int) -> None:
        """Remove one candidate; ValueError if it is not selected."""
        self._set.remove(candidate)
        self._restart()
        for other in self._set.order:
            self._turn(other)

    def _restart(self) -> None:
        """Forget every turn: undoing one would magnify the errors of the others."""
        f = self._objective
        self._score = 0.0
        self._turns = 0
        self._Y = None
        self._made_up: IntArray = np.zeros(f.n_candidates, dtype=np.int64)
        self._axes: FloatArray = np.empty((8 * f.rank, f.n_states))
        self._pulls: FloatArray = np.empty(8 * f.rank)

    def _turn(self, candidate: int) -> None:
        """Let the others feel that `candidate` is in."""
        r = self._objective.rank
        if self._turns + r > len(self._pulls):
            self._axes = np.concatenate([self._axes, np.empty_like(self._axes)])
            self._pulls = np.concatenate([self._pulls, np.empty_like(self._pulls)])
        y = self._objective.whitened()[candidate].copy()
        self._score += add_turns(y, self._axes, self._pulls, self._turns)
        self._turns += r


@njit(cache=True, fastmath=True)
def add_turns(y, axes, pulls, turns):  # type: ignore[no-untyped-def]
    """Turn a candidate's rows y (r, n) by the turns there are, append its own; return its gain."""
    r, n = y.shape
    gain = 0.0
    for k in range(r):
        for turn in range(turns + k):
            inner = 0.0
            for a in range(n):
                inner += axes[turn, a] * y[k, a]
            inner *= pulls[turn]
            for a in range(n):
                y[k, a] -= inner * axes[turn, a]
        square = 0.0
        for a in range(n):
            square += y[k, a] * y[k, a]
            axes[turns + k, a] = y[k, a]
        gain += np.log1p(square)
        pulls[turns + k] = (1.0 - 1.0 / np.sqrt(1.0 + square)) / square if square > 0.0 else 0.0
    return gain


@njit(cache=True, fastmath=True)
def gains_after(rows, Y, made_up, axes, pulls, turns, out):  # type: ignore[no-untyped-def]
    """Make up for the turns that `rows` (m,) have missed, in place; write their gains (m,)."""
    r, n = Y.shape[1], Y.shape[2]
    for at in range(rows.size):
        i = rows[at]
        for turn in range(made_up[i], turns):
            for k in range(r):
                inner = 0.0
                for a in range(n):
                    inner += axes[turn, a] * Y[i, k, a]
                inner *= pulls[turn]
                for a in range(n):
                    Y[i, k, a] -= inner * axes[turn, a]
        made_up[i] = turns
        if r == 1:
            square = 0.0
            for a in range(n):
                square += Y[i, 0, a] * Y[i, 0, a]
            out[at] = np.log1p(square)
        else:
            # column by column, each turning those after it: det(I + YᵀY) would lose what nearly
            # parallel columns have in common
            total = 0.0
            left = Y[i].copy()
            for k in range(r):
                square = 0.0
                for a in range(n):
                    square += left[k, a] * left[k, a]
                total += np.log1p(square)
                if square == 0.0:
                    continue
                pull = (1.0 - 1.0 / np.sqrt(1.0 + square)) / square
                for other in range(k + 1, r):
                    inner = 0.0
                    for a in range(n):
                        inner += left[k, a] * left[other, a]
                    inner *= pull
                    for a in range(n):
                        left[other, a] -= inner * left[k, a]
            out[at] = total
