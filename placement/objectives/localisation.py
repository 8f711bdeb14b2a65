"""What one instant of cameras tells about the car's position, summed along the path.

    f(S) = Σ_t w_t [ log det(C + Σ_{i ∈ S} J_it) − log det C ],    C = I / prior_sigma_m²

No odometry links one sample to the next. Monotone and submodular in S, because log det is
operator-monotone with diminishing returns in positive semidefinite increments; concave in
fractional choices x. Values are nats of the 2×2 log determinant: an isotropic block counts both
axes, so figures "per axis" are half of these.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from models.geometry import BoolArray, FloatArray, IntArray
from placement.information import Information
from placement.objectives import block_kernels as kernels

Scalar = TypeVar("Scalar", bound=np.generic)

# How far beyond |J_tn| ≤ √(J_tt J_nn) a stored block may lie: float32 rounding of a singular
# block, with a factor of ten. Anything more is not an information matrix.
_SINGULAR_SLACK = 1e-6


class Localisation:
    """Score placements by the log det of each path sample's information, taken alone.

    `information` covers c candidates and t samples, `prior_sigma_m` is what the car knows without
    cameras, `weights` (t,) count the samples (default: one each). One frame a sample is counted.

    Raises:
        ValueError: for a prior that is not positive, weights that are negative or of the wrong
            shape, or blocks that are not positive semidefinite.
    """

    name = "localisation"
    unit = "nats"
    maximise = True
    submodular = True

    def __init__(
        self, information: Information, prior_sigma_m: float, weights: ArrayLike | None = None
    ) -> None:
        """Check the arguments and index the candidates by the samples they see."""
        if not (np.isfinite(prior_sigma_m) and prior_sigma_m > 0.0):
            raise ValueError(f"objective.prior_sigma_m must be positive, got {prior_sigma_m}")
        t = information.n_samples
        w = np.ones(t) if weights is None else np.array(weights, dtype=np.float64)
        if w.shape != (t,):
            raise ValueError(f"weights must have shape ({t},), got {w.shape}")
        if not np.all(np.isfinite(w) & (w >= 0.0)):
            raise ValueError(f"weights must be finite and at least 0, got {w.min()}")
        self.information = information
        self.prior_sigma_m = float(prior_sigma_m)
        self.weights = _fixed(w, np.float64)
        self.scale = float(prior_sigma_m) ** 2
        # Public to the state and to bounds: CSR rows by candidate, and the same by sample.
        self.indptr = _fixed(information.indptr, np.int64)
        self.indices = _fixed(information.indices, np.int32)
        _check_rows(self.indptr, self.indices, t)
        self.blocks = _fixed(_semidefinite(information.blocks), np.float32)
        seen_by = sparse.csr_array(
            (np.zeros(len(self.indices), np.int8), self.indices, self.indptr),
            shape=(self.n_candidates, t),
        ).tocsc()
        self.sample_indptr = _fixed(seen_by.indptr, np.int64)
        self.sample_candidates = _fixed(seen_by.indices, np.int32)
        self._first_gains: FloatArray | None = None  # gains over the empty placement, made once

    @property
    def n_candidates(self) -> int:
        """The number of candidates, c."""
        return self.information.n_candidates

    def value(self, selected: IntArray) -> float:
        """Evaluate a placement in plain NumPy, sharing nothing with the kernels of the state."""
        chosen = _distinct(selected, self.n_candidates)
        t, width = self.information.n_samples, self.blocks.shape[1]
        entries = np.concatenate(
            [np.arange(self.indptr[i], self.indptr[i + 1]) for i in chosen]
            or [np.empty(0, dtype=np.int64)]
        )
        sums = np.column_stack(
            [
                np.bincount(self.indices[entries], self.blocks[entries, a].astype(float), t)
                for a in range(width)
            ]
        )
        if width == 1:
            return float(2.0 * np.sum(self.weights * np.log1p(self.scale * sums[:, 0])))
        a, c, b = (self.scale * sums).T
        return float(np.sum(self.weights * np.log1p(a + b + np.maximum(a * b - c * c, 0.0))))

    def state(self, selected: IntArray | None = None) -> LocalisationState:
        """Start a placement, empty unless `selected` is given."""
        state = LocalisationState(self)
        for candidate in [] if selected is None else _distinct(selected, self.n_candidates):
            state.add(int(candidate))
        return state

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return Σ_t w_t log det(I + C⁻¹ Σ_i x_i J_it) and its gradient (c,) at `x` (c,)."""
        sums = self.sums(x)
        score = float(np.sum(self.sample_scores(sums)))
        slopes = np.zeros(self.n_candidates)
        kernels.row_sums(self.indptr, self.entry_slopes(sums), slopes)
        return score, slopes

    # Below: the pieces that cuts are made of, per sample and per stored entry of `information`.

    def sums(self, x: FloatArray) -> FloatArray:
        """Return Σ_i x_i [J_tt, J_tn, J_nn] of every sample, (t, 3), for `x` (c,) ≥ 0."""
        choice = np.ascontiguousarray(x, dtype=np.float64)
        if choice.shape != (self.n_candidates,):
            raise ValueError(f"x must have shape ({self.n_candidates},), got {choice.shape}")
        sums = np.zeros((self.information.n_samples, 3))
        kernels.weighted_sums(choice, self.indptr, self.indices, self.blocks, sums)
        return sums

    def sample_scores(self, sums: FloatArray) -> FloatArray:
        """Return each sample's weighted term (t,) of the score, given its information (t, 3)."""
        a, c, b = (self.scale * sums).T
        scores: FloatArray = self.weights * np.log1p(a + b + np.maximum(a * b - c * c, 0.0))
        return scores

    def entry_gains(self, sums: FloatArray) -> FloatArray:
        """Return (nnz,): by how much adding the entry's block alone raises its sample's term."""
        out = np.empty(len(self.indices))
        kernels.entry_gains(self.indices, self.blocks, self.weights, self.scale, sums, out)
        return out

    def entry_slopes(self, sums: FloatArray) -> FloatArray:
        """Return (nnz,): w_t tr((C + A_t)⁻¹ J_it), the derivative of the sample's term by x_i."""
        out = np.empty(len(self.indices))
        kernels.entry_slopes(self.indices, self.blocks, self.weights, self.scale, sums, out)
        return out

    def first_gains(self) -> FloatArray:
        """Return every candidate's gain over the empty placement, (c,), read-only."""
        if self._first_gains is None:
            gains = np.zeros(self.n_candidates)
            kernels.row_sums(
                self.indptr,
                self.entry_gains(np.zeros((self.information.n_samples, 3))),
                gains,
            )
            self._first_gains = _fixed(gains, np.float64)
        return self._first_gains


class LocalisationState:
    """Keep the information of every sample, and the gains that a change has not touched.

    A change touches the samples its candidate sees, and with them the gains of the candidates
    that see any of those; only these are computed again, when next asked for. Sums are always
    those of adding `selected` in order: removing recomputes what it touched instead of
    subtracting, so no rounding error accumulates however long an exchange runs.
    """

    def __init__(self, objective: Localisation) -> None:
        """Start empty."""
        self._objective = objective
        self._selected: list[int] = []
        self._chosen: BoolArray = np.zeros(objective.n_candidates, dtype=np.bool_)
        self._sums = np.zeros((objective.information.n_samples, 3))
        self._gains = objective.first_gains().copy()
        self._stale: BoolArray = np.zeros(objective.n_candidates, dtype=np.bool_)

    @property
    def selected(self) -> list[int]:
        """The candidates chosen so far, in the order they were added."""
        return list(self._selected)

    @property
    def score(self) -> float:
        """The score of `selected`, in nats."""
        return float(np.sum(self._objective.sample_scores(self._sums)))

    @property
    def sums(self) -> FloatArray:
        """Information [J_tt, J_tn, J_nn] of every sample from `selected`, (t, 3), a copy."""
        return self._sums.copy()

    def gains(self, candidates: IntArray | None = None) -> FloatArray:
        """Return the change of the score on adding each of `candidates` (default: all), (m,).

        A candidate already selected gains 0.
        """
        f = self._objective
        if candidates is None:
            rows = np.flatnonzero(self._stale)
        else:
            asked = np.asarray(candidates, dtype=np.int64)
            rows = np.unique(asked[self._stale[asked]])
        if rows.size:
            kernels.candidate_gains(
                rows,
                f.indptr,
                f.indices,
                f.blocks,
                f.weights,
                f.scale,
                self._sums,
                self._gains,
            )
            self._stale[rows] = False
        if candidates is None:
            return np.where(self._chosen, 0.0, self._gains)
        return np.where(self._chosen[asked], 0.0, self._gains[asked])

    def add(self, candidate: int) -> None:
        """Add one candidate; ValueError if it is there already or does not exist."""
        _check_candidate(candidate, self._objective.n_candidates)
        if self._chosen[candidate]:
            raise ValueError(f"candidate {candidate} is already selected")
        self._selected.append(int(candidate))
        self._chosen[candidate] = True
        self._touch(candidate, np.array([candidate]), restart=False)

    def remove(self, candidate: int) -> None:
        """Remove one candidate; ValueError if it is not selected."""
        _check_candidate(candidate, self._objective.n_candidates)
        if not self._chosen[candidate]:
            raise ValueError(f"candidate {candidate} is not selected")
        self._selected.remove(int(candidate))
        self._chosen[candidate] = False
        self._touch(candidate, np.array(self._selected, dtype=np.int64), restart=True)

    def _touch(self, candidate: int, rows: IntArray, *, restart: bool) -> None:
        """Add `rows` to the sums of the samples `candidate` sees, from zero if `restart`."""
        f = self._objective
        seen = f.indices[f.indptr[candidate] : f.indptr[candidate + 1]]
        touched = np.zeros(len(self._sums), dtype=np.bool_)
        touched[seen] = True
        if restart:
            self._sums[seen] = 0.0
        kernels.add_rows(rows, f.indptr, f.indices, f.blocks, touched, self._sums)
        kernels.mark_seeing(seen, f.sample_indptr, f.sample_candidates, self._stale)


def _fixed(array: NDArray[Any], dtype: type[Scalar]) -> NDArray[Scalar]:
    """Return `array` contiguous, of one type and read-only: what every kernel is compiled for."""
    fixed = np.ascontiguousarray(array, dtype=dtype).view()
    fixed.flags.writeable = False
    return fixed


def _semidefinite(blocks: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the blocks with what float32 rounding made indefinite put right; refuse the rest."""
    if blocks.shape[1] not in (1, 3):
        raise ValueError(f"information.blocks must have 1 or 3 columns, got {blocks.shape[1]}")
    if not np.all(np.isfinite(blocks)) or np.any(blocks[:, [0, -1]] < 0.0):
        raise ValueError("information.blocks must be finite with diagonals of at least 0")
    if blocks.shape[1] == 1:
        return blocks
    a, c, b = blocks.astype(np.float64).T
    limit = np.sqrt(a * b)
    bad = np.abs(c) > limit
    if not bad.any():
        return blocks
    if np.any(np.abs(c) > limit * (1.0 + _SINGULAR_SLACK)):
        at = int(np.argmax(np.abs(c) - limit))
        raise ValueError(
            f"information.blocks[{at}] must be positive semidefinite, got {blocks[at].tolist()}"
        )
    mended = blocks.copy()
    inside = np.nextafter(limit[bad].astype(np.float32), np.float32(0.0))
    mended[bad, 1] = np.copysign(inside, blocks[bad, 1])
    return mended


def _check_rows(indptr: IntArray, indices: NDArray[np.int32], n_samples: int) -> None:
    """Refuse rows that a kernel could not walk safely."""
    if (
        indptr.size == 0
        or indptr[0] != 0
        or indptr[-1] != len(indices)
        or np.any(np.diff(indptr) < 0)
    ):
        raise ValueError("information.indptr must rise from 0 to the number of entries")
    if len(indices) and (indices.min() < 0 or indices.max() >= n_samples):
        raise ValueError(f"information.indices must lie in 0…{n_samples - 1}")


def _distinct(selected: Iterable[int] | IntArray, n: int) -> IntArray:
    """Return `selected` as an array, refusing strangers and repetitions."""
    chosen = np.asarray(selected, dtype=np.int64).reshape(-1)
    for candidate in chosen:
        _check_candidate(int(candidate), n)
    if np.unique(chosen).size != chosen.size:
        raise ValueError(f"a candidate is selected twice in {chosen.tolist()}")
    return chosen


def _check_candidate(candidate: int, n: int) -> None:
    if not 0 <= candidate < n:
        raise ValueError(f"candidate must lie in 0…{n - 1}, got {candidate}")
