"""What dense designs share: a prior, a factor for every candidate, and the sum of both."""

from __future__ import annotations

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from models.geometry import BoolArray, FloatArray, IntArray, frozen


class DenseDesign:
    """Hold the information Λ + Σ F_i F_iᵀ of any candidates, checked once.

    `prior` (n, n) is the information before any candidate, symmetric and positive definite;
    candidate i adds `factors[i] @ factors[i].T`, `factors` (c, n, r).

    Raises:
        ValueError: for shapes that disagree, numbers that are not finite, or a prior that is not
            symmetric (to 1e-9 relative) or not positive definite.
    """

    def __init__(self, prior: ArrayLike, factors: ArrayLike) -> None:
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
        symmetric: FloatArray = np.array(0.5 * (prior + prior.T), dtype=np.float64)
        try:
            root: FloatArray = np.linalg.cholesky(symmetric).astype(np.float64)
        except np.linalg.LinAlgError:
            least = float(np.linalg.eigvalsh(symmetric)[0])
            raise ValueError(
                f"prior must be positive definite, got least eigenvalue {least:g}"
            ) from None
        self.prior: FloatArray = frozen(symmetric)  # type: ignore[assignment]
        self.root: FloatArray = frozen(root)  # type: ignore[assignment]
        self.n_states = n
        self.rank = factors.shape[2]
        self._n_candidates = len(factors)
        # (n, c·r): the columns of all factors, a candidate's beside each other.
        self.columns: FloatArray = np.ascontiguousarray(factors.transpose(1, 0, 2)).reshape(n, -1)

    @property
    def n_candidates(self) -> int:
        """The number of candidates, c."""
        return self._n_candidates

    def over(self, keep: IntArray) -> Self:
        """Return the same objective over the candidates `keep` alone, numbered 0 … len − 1."""
        by_candidate = self.columns.reshape(self.n_states, self.n_candidates, self.rank)
        return type(self)(self.prior, by_candidate[:, keep].transpose(1, 0, 2))

    def factor(self, candidates: IntArray) -> FloatArray:
        """Return the factors of `candidates` (m,) side by side, (n, m·r)."""
        by_candidate = self.columns.reshape(self.n_states, self.n_candidates, self.rank)
        return by_candidate[:, candidates].reshape(self.n_states, -1)

    def checked(self, selected: IntArray) -> IntArray:
        """Return a set as a sorted array; refuse strangers and repetitions."""
        chosen = np.sort(np.asarray(selected, dtype=np.int64).reshape(-1))
        if np.unique(chosen).size != chosen.size:
            raise ValueError(f"a candidate is selected twice in {chosen.tolist()}")
        if chosen.size and (chosen[0] < 0 or chosen[-1] >= self.n_candidates):
            raise ValueError(f"candidates must lie in 0…{self.n_candidates - 1}")
        return chosen

    def information(self, selected: IntArray) -> FloatArray:
        """Return Λ + Σ F_i F_iᵀ over a set, (n, n)."""
        F = self.factor(self.checked(selected))
        total: FloatArray = self.prior + F @ F.T
        return total

    def relaxed_information(self, x: FloatArray) -> FloatArray:
        """Return Λ + Σ x_i F_i F_iᵀ, (n, n)."""
        weighted = self.columns * np.repeat(np.asarray(x, dtype=float), self.rank)
        total: FloatArray = self.prior + weighted @ self.columns.T
        return total


class Selection:
    """The chosen candidates in order, and the checks on joining and leaving."""

    def __init__(self, n_candidates: int) -> None:
        """Start empty."""
        self.order: list[int] = []
        self.inside: BoolArray = np.zeros(n_candidates, dtype=np.bool_)

    def add(self, candidate: int) -> None:
        """Add one candidate; ValueError if it is there already or does not exist."""
        if not 0 <= candidate < len(self.inside):
            raise ValueError(f"candidate must lie in 0…{len(self.inside) - 1}, got {candidate}")
        if self.inside[candidate]:
            raise ValueError(f"candidate {candidate} is already selected")
        self.order.append(int(candidate))
        self.inside[candidate] = True

    def remove(self, candidate: int) -> None:
        """Remove one candidate; ValueError if it is not selected."""
        if not (0 <= candidate < len(self.inside) and self.inside[candidate]):
            raise ValueError(f"candidate {candidate} is not selected")
        self.order.remove(int(candidate))
        self.inside[candidate] = False
