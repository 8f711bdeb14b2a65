"""How much of the path is seen at all, or at least twice: the objective that everybody has.

    f(S) = Σ_t w_t [ at least m cameras of S see sample t ],    m = `times`

No error model enters: a camera sees a sample or it does not. For m = 1 this is maximum coverage,
monotone submodular; for m ≥ 2 it is not (the first camera to see a sample is worth nothing, the
second everything), so greedy has nothing to go by there. `partial` pays 1/m for each of the first
m cameras that see a sample instead, which is submodular for every m and never below f.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from models.geometry import BoolArray, FloatArray, IntArray, frozen
from placement.information import Information


class Coverage:
    """Score placements by the weight of the samples that at least `times` cameras see.

    `information` says which of its t samples each of c candidates sees; `weights` (t,) are 1 each
    unless given. With `partial` a sample counts min(cameras, times)/times of its weight.

    Raises:
        ValueError: for `times` below 1, weights that are negative, not finite or not (t,).
    """

    name = "coverage"
    unit = "samples"
    maximise = True

    def __init__(
        self,
        information: Information,
        times: int = 1,
        weights: ArrayLike | None = None,
        *,
        partial: bool = False,
    ) -> None:
        """Check the arguments and store who sees what as a matrix of ones."""
        t = information.n_samples
        w = np.ones(t) if weights is None else np.array(weights, dtype=np.float64)
        if times < 1:
            raise ValueError(f"times must be at least 1, got {times}")
        if w.shape != (t,):
            raise ValueError(f"weights must have shape ({t},), got {w.shape}")
        if not np.all(np.isfinite(w) & (w >= 0.0)):
            raise ValueError(f"weights must be finite and at least 0, got {w.min()}")
        self.information = information
        self.times = int(times)
        self.partial = partial
        self.weights: FloatArray = frozen(w)  # type: ignore[assignment]
        self.indptr = np.asarray(information.indptr, dtype=np.int64)
        self.indices = np.asarray(information.indices, dtype=np.int32)
        self.seen: Any = sparse.csr_array(
            (np.ones(len(self.indices)), self.indices, self.indptr), shape=(self.n_candidates, t)
        )

    @property
    def n_candidates(self) -> int:
        """The number of candidates, c."""
        return self.information.n_candidates

    @property
    def submodular(self) -> bool:
        """Whether greedy's guarantees hold: where one look is enough, or where looks are shared."""
        return self.partial or self.times == 1

    @property
    def step(self) -> float:
        """What every value is a multiple of: 1 where all weights are whole, else 0 (anything)."""
        whole = np.all(self.weights == np.round(self.weights)) and self.weights.sum() < 2.0**52
        return 1.0 if whole and (not self.partial or self.times == 1) else 0.0

    def value(self, selected: IntArray) -> float:
        """Count anew how many of `selected` see each sample."""
        chosen = np.asarray(selected, dtype=np.int64).reshape(-1)
        if np.unique(chosen).size != chosen.size:
            raise ValueError(f"a candidate is selected twice in {chosen.tolist()}")
        if chosen.size and (chosen.min() < 0 or chosen.max() >= self.n_candidates):
            raise ValueError(f"candidates must lie in 0…{self.n_candidates - 1}")
        counts = np.zeros(self.information.n_samples, dtype=np.int64)
        for i in chosen:
            counts[self.indices[self.indptr[i] : self.indptr[i + 1]]] += 1
        return self.score_of(counts)

    def score_of(self, counts: IntArray) -> float:
        """Return the score where `counts` (t,) cameras see each sample."""
        if self.partial:
            return float(np.sum(self.weights * np.minimum(counts, self.times)) / self.times)
        return float(np.sum(self.weights[counts >= self.times]))

    def state(self, selected: IntArray | None = None) -> CoverageState:
        """Start a placement, empty unless `selected` is given."""
        state = CoverageState(self)
        for candidate in [] if selected is None else selected:
            state.add(int(candidate))
        return state


class CoverageState:
    """Keep how many of the chosen cameras see each sample; counts are whole, so nothing drifts."""

    def __init__(self, objective: Coverage) -> None:
        """Start empty."""
        self._objective = objective
        self._selected: list[int] = []
        self._chosen: BoolArray = np.zeros(objective.n_candidates, dtype=np.bool_)
        self._counts = np.zeros(objective.information.n_samples, dtype=np.int64)

    @property
    def selected(self) -> list[int]:
        """The candidates chosen so far, in the order they were added."""
        return list(self._selected)

    @property
    def score(self) -> float:
        """The score of `selected`."""
        return self._objective.score_of(self._counts)

    def gains(self, candidates: IntArray | None = None) -> FloatArray:
        """Return the change of the score on adding each of `candidates` (default: all), (m,)."""
        f = self._objective
        if f.partial:
            worth = f.weights * (self._counts < f.times) / f.times
        else:
            worth = f.weights * (self._counts == f.times - 1)
        if candidates is None:
            gains = f.seen @ worth
            return np.where(self._chosen, 0.0, gains)
        rows = np.asarray(candidates, dtype=np.int64)
        if rows.size < 0.25 * f.n_candidates:
            gains = f.seen[rows] @ worth
        else:
            gains = (f.seen @ worth)[rows]
        return np.where(self._chosen[rows], 0.0, gains)

    def add(self, candidate: int) -> None:
        """Add one candidate; ValueError if it is there already or does not exist."""
        if not 0 <= candidate < len(self._chosen):
            raise ValueError(f"candidate must lie in 0…{len(self._chosen) - 1}, got {candidate}")
        if self._chosen[candidate]:
            raise ValueError(f"candidate {candidate} is already selected")
        self._selected.append(int(candidate))
        self._chosen[candidate] = True
        self._counts[self._row(candidate)] += 1

    def remove(self, candidate: int) -> None:
        """Remove one candidate; ValueError if it is not selected."""
        if not (0 <= candidate < len(self._chosen) and self._chosen[candidate]):
            raise ValueError(f"candidate {candidate} is not selected")
        self._selected.remove(int(candidate))
        self._chosen[candidate] = False
        self._counts[self._row(candidate)] -= 1

    def _row(self, candidate: int) -> NDArray[np.int32]:
        f = self._objective
        row: NDArray[np.int32] = f.indices[f.indptr[candidate] : f.indptr[candidate + 1]]
        return row
