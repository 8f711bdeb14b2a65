"""D-optimal design: the log det of a prior and the chosen candidates' information, dense.

    f(S) = log det(Λ + Σ_{i ∈ S} F_i F_iᵀ) − log det Λ

for any state dimension n and rank r of the factors F_i (n, r). Monotone and submodular, concave
in fractional choices. Everything is computed from a Cholesky factor of the current sum, which is
made anew after each change: n³ is little beside c·n² at the sizes of public designs, and no
rounding error builds up behind a prior of 1e-6.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from models.geometry import BoolArray, FloatArray, IntArray, frozen


class LogDet:
    """Score sets of candidates by the log det of what they tell about a state, in nats.

    `prior` (n, n) is the information before any candidate, symmetric and positive definite;
    candidate i adds `factors[i] @ factors[i].T`, `factors` (c, n, r).

    Raises:
        ValueError: for shapes that disagree, numbers that are not finite, or a prior that is not
            symmetric (to 1e-9 relative) or not positive definite.
    """

    name = "log_det"
    unit = "nats"
    maximise = True
    submodular = True

    def __init__(self, prior: FloatArray, factors: FloatArray) -> None:
        """Check the arrays and lay the factors side by side."""
        prior, factors = np.asarray(prior, dtype=float), np.asarray(factors, dtype=float)
        if prior.ndim != 2 or prior.shape[0] != prior.shape[1] or not prior.size:
            raise ValueError(f"prior must have shape (n, n), got {prior.shape}")
        n = len(prior)
        if factors.ndim != 3 or factors.shape[1] != n:
            raise ValueError(f"factors must have shape (c, {n}, r), got {factors.shape}")
        for name, array in (("prior", prior), ("factors", factors)):
            if not np.all(np.isfinite(array)):
                at = np.argwhere(~np.isfinite(array))[0].tolist()
                raise ValueError(f"{name}{at} must be finite, got {array[tuple(at)]}")
        asymmetry = float(np.max(np.abs(prior - prior.T)))
        if asymmetry > 1e-9 * float(np.max(np.abs(prior))):
            raise ValueError(f"prior must be symmetric, got entries that differ by {asymmetry:g}")
        try:
            np.linalg.cholesky(prior)
        except np.linalg.LinAlgError:
            least = float(np.linalg.eigvalsh(prior)[0])
            raise ValueError(
                f"prior must be positive definite, got least eigenvalue {least:g}"
            ) from None
        self.prior: FloatArray = frozen(0.5 * (prior + prior.T))  # type: ignore[assignment]
        self.n_states = n
        self.rank = factors.shape[2]
        self._n_candidates = len(factors)
        # (n, c·r): the columns of all factors, a candidate's beside each other.
        self.columns: FloatArray = np.ascontiguousarray(factors.transpose(1, 0, 2)).reshape(n, -1)
        self._prior_log_det = float(np.linalg.slogdet(prior)[1])

    @property
    def n_candidates(self) -> int:
        """The number of candidates, c."""
        return self._n_candidates

    def value(self, selected: IntArray) -> float:
        """Evaluate a set by LU, apart from the states' Cholesky factors."""
        chosen = np.sort(np.asarray(selected, dtype=np.int64).reshape(-1))
        if np.unique(chosen).size != chosen.size:
            raise ValueError(f"a candidate is selected twice in {chosen.tolist()}")
        if chosen.size and (chosen[0] < 0 or chosen[-1] >= self.n_candidates):
            raise ValueError(f"candidates must lie in 0…{self.n_candidates - 1}")
        F = self.factor(chosen)
        return float(np.linalg.slogdet(self.prior + F @ F.T)[1]) - self._prior_log_det

    def state(self, selected: IntArray | None = None) -> LogDetState:
        """Start a set, empty unless `selected` is given."""
        state = LogDetState(self)
        for candidate in [] if selected is None else selected:
            state.add(int(candidate))
        return state

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return log det(Λ + Σ x_i F_i F_iᵀ) − log det Λ and its gradient (c,) at `x` (c,) ≥ 0."""
        weighted = self.columns * np.repeat(np.asarray(x, dtype=float), self.rank)
        L = np.linalg.cholesky(self.prior + weighted @ self.columns.T)
        score = 2.0 * float(np.sum(np.log(np.diag(L)))) - self._prior_log_det
        half = solve_triangular(L, self.columns, lower=True, check_finite=False)
        return score, np.sum(half * half, axis=0).reshape(self.n_candidates, self.rank).sum(axis=1)

    def factor(self, candidates: IntArray) -> FloatArray:
        """Return the factors of `candidates` (m,) side by side, (n, m·r)."""
        by_candidate = self.columns.reshape(self.n_states, self.n_candidates, self.rank)
        return by_candidate[:, candidates].reshape(self.n_states, -1)

    def log_det(self, L: FloatArray) -> float:
        """Return the score whose information has the Cholesky factor `L` (n, n)."""
        return 2.0 * float(np.sum(np.log(np.diag(L)))) - self._prior_log_det


class LogDetState:
    """Keep the information of the chosen candidates and its Cholesky factor."""

    def __init__(self, objective: LogDet) -> None:
        """Start empty."""
        self._objective = objective
        self._selected: list[int] = []
        self._chosen: BoolArray = np.zeros(objective.n_candidates, dtype=np.bool_)
        self._information = objective.prior.copy()
        self._factor: FloatArray | None = None

    @property
    def selected(self) -> list[int]:
        """The candidates chosen so far, in the order they were added."""
        return list(self._selected)

    @property
    def score(self) -> float:
        """The score of `selected`, in nats."""
        return self._objective.log_det(self._cholesky_factor())

    def gains(self, candidates: IntArray | None = None) -> FloatArray:
        """Return the change of the score on adding each of `candidates` (default: all), (m,).

        log det(I + F_iᵀ M⁻¹ F_i), M the information so far; 0 for a candidate already selected.
        """
        f = self._objective
        if candidates is None:
            rows, columns = np.arange(f.n_candidates), f.columns
        else:
            rows = np.asarray(candidates, dtype=np.int64)
            columns = f.factor(rows)
        half = solve_triangular(self._cholesky_factor(), columns, lower=True, check_finite=False)
        if f.rank == 1:
            gains = np.log1p(np.sum(half * half, axis=0))
        else:
            blocks = half.reshape(f.n_states, len(rows), f.rank).transpose(1, 2, 0)
            gains = np.linalg.slogdet(np.eye(f.rank) + blocks @ blocks.transpose(0, 2, 1))[1]
        return np.where(self._chosen[rows], 0.0, np.maximum(gains, 0.0))

    def add(self, candidate: int) -> None:
        """Add one candidate; ValueError if it is there already or does not exist."""
        if not 0 <= candidate < self._objective.n_candidates:
            raise ValueError(
                f"candidate must lie in 0…{self._objective.n_candidates - 1}, got {candidate}"
            )
        if self._chosen[candidate]:
            raise ValueError(f"candidate {candidate} is already selected")
        self._selected.append(int(candidate))
        self._chosen[candidate] = True
        F = self._objective.factor(np.array([candidate]))
        self._information += F @ F.T
        self._factor = None

    def remove(self, candidate: int) -> None:
        """Remove one candidate; ValueError if it is not selected."""
        if not (0 <= candidate < len(self._chosen) and self._chosen[candidate]):
            raise ValueError(f"candidate {candidate} is not selected")
        self._selected.remove(int(candidate))
        self._chosen[candidate] = False
        # From scratch: subtracting would leave rounding errors as large as what was taken away.
        F = self._objective.factor(np.array(self._selected, dtype=np.int64))
        self._information = self._objective.prior + F @ F.T
        self._factor = None

    def _cholesky_factor(self) -> FloatArray:
        if self._factor is None:
            factor: FloatArray = np.linalg.cholesky(self._information).astype(np.float64)
            self._factor = factor
        return self._factor
