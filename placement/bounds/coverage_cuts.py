"""Linear inequalities for `coverage`, and what makes its integer program small.

A sample of weight w that counts once m cameras see it has the level z ≤ w, and for every set J of
fewer than m candidates

    z ≤ w / (m − |J|) · Σ_{i ∉ J} x_i,

as whoever is seen m times is seen m − |J| times by others than J. At a placement one of these is
tight; at fractional x the least right side takes the largest x for J. For m = 1 these are the
rows of the textbook's program, for m ≥ 2 they are stronger than its m·z ≤ w·Σ x.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from models.geometry import BoolArray, FloatArray, IntArray
from placement.bounds.cuts import Cuts
from placement.bounds.restrict import restricted_information
from placement.constraints import Constraints
from placement.information import Information
from placement.objectives.coverage import Coverage

_UP = 1.0 + 4.0 * float(np.finfo(np.float64).eps)  # for the quotient w / (m − |J|)


class CoverageCuts:
    """Make cuts of one `coverage` objective."""

    def __init__(self, objective: Coverage) -> None:
        """List who sees each sample."""
        self.objective = objective
        self._seen_by = objective.seen.tocsc()
        self._counts = np.diff(self._seen_by.indptr)
        self._samples = np.flatnonzero(self._counts > 0)

    def submodular(self, selected: IntArray) -> Cuts:
        """Return, for every sample that some candidate sees, a cut that is tight at `selected`."""
        f = self.objective
        x = np.zeros(f.n_candidates)
        x[selected] = 1.0
        inside = x[self._seen_by.indices] > 0.0
        held = np.bincount(self._entry_samples()[inside], minlength=f.information.n_samples)
        return self._rows(self._samples, held, inside)

    def separate(self, x: FloatArray, level: FloatArray, by: float) -> Cuts:
        """Return, for each sample whose `level` exceeds some cut at `x` by more than `by`, one.

        The cut with the least right side is taken.
        """
        f = self.objective
        sample = self._entry_samples()
        weight = x[self._seen_by.indices]
        order = np.lexsort((-weight, sample))
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(len(order)) - self._seen_by.indptr[sample[order]]
        t = f.information.n_samples
        total = np.bincount(sample, weight, t)
        best, held = f.weights.copy(), np.full(t, f.times, dtype=np.int64)
        for j in range(f.times):
            side = f.weights * total / (f.times - j)
            held = np.where(side < best, j, held)
            best = np.minimum(best, side)
            total = total - np.bincount(sample, weight * (rank == j), t)
        wanted = self._samples[level[self._samples] > best[self._samples] + by]
        return self._rows(wanted, held, rank < held[sample])

    def useless(self, constraints: Constraints) -> BoolArray:
        """Mark the candidates (c,) that see no more than another pose of their group, at its cost.

        A placement with one of them is no worse with the other in its place. Of equals the lowest
        index stays. Where cameras must keep their distance nobody is marked.
        """
        mask = np.zeros(constraints.n, dtype=np.bool_)
        if constraints.separation_m:
            return mask
        usable = constraints.usable()
        usable[constraints.required] = False
        members = np.flatnonzero(usable & (constraints.group >= 0))
        order = members[np.argsort(constraints.group[members], kind="stable")]
        for group in np.split(order, np.flatnonzero(np.diff(constraints.group[order])) + 1):
            common = self._common(group)
            size = np.diagonal(common)
            inside = common >= size[:, None]  # row's samples are all among column's
            equal = inside & inside.T
            lower = np.arange(group.size)[None, :] < np.arange(group.size)[:, None]
            beaten = inside & (~equal | lower)
            if constraints.cost is not None:
                cost = constraints.cost[group]
                beaten &= cost[None, :] <= cost[:, None]
            np.fill_diagonal(beaten, val=False)
            mask[group] = beaten.any(axis=1)
        return mask

    def _common(self, group: IntArray) -> NDArray[np.float32]:
        """Count the samples that each two of `group` (g,) see, (g, g): whole numbers, so exact."""
        f = self.objective
        lengths = f.indptr[group + 1] - f.indptr[group]
        starts = np.cumsum(lengths) - lengths
        entry = np.arange(int(lengths.sum())) + np.repeat(f.indptr[group] - starts, lengths)
        samples, column = np.unique(f.indices[entry], return_inverse=True)
        looks = np.zeros((group.size, samples.size), dtype=np.float32)
        looks[np.repeat(np.arange(group.size), lengths), column] = 1.0
        common: NDArray[np.float32] = looks @ looks.T
        return common

    def _rows(self, samples: IntArray, held: IntArray, inside: BoolArray) -> Cuts:
        """Assemble a cut for each of `samples`; `inside` (nnz,) marks J, `held` (t,) its size."""
        f = self.objective
        full = held >= f.times
        share = f.weights / np.maximum(f.times - held, 1) * _UP
        sample = self._entry_samples()
        wanted = np.zeros(f.information.n_samples, dtype=np.bool_)
        wanted[samples] = True
        kept = wanted[sample] & ~inside & ~full[sample]
        lengths = np.bincount(sample[kept], minlength=f.information.n_samples)[samples]
        return Cuts(
            samples.astype(np.int64),
            np.where(full[samples], f.weights[samples], 0.0),
            np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
            self._seen_by.indices[kept].astype(np.int32),
            share[sample[kept]],
        )

    def _entry_samples(self) -> IntArray:
        return np.repeat(np.arange(len(self._counts)), self._counts)


def merged(objective: Coverage) -> Coverage:
    """Return the same score with the samples that the same candidates see made one."""
    seen_by = objective.seen.tocsc()
    seen_by.sort_indices()
    first: dict[bytes, int] = {}
    number = np.full(len(objective.weights), -1, dtype=np.int64)
    for t in range(len(number)):
        column = seen_by.indices[seen_by.indptr[t] : seen_by.indptr[t + 1]]
        if column.size:
            number[t] = first.setdefault(column.tobytes(), len(first))
    heard = number >= 0
    weights = np.bincount(number[heard], objective.weights[heard], len(first))
    owner = np.zeros(len(first), dtype=np.int64)
    owner[number[heard][::-1]] = np.flatnonzero(heard)[::-1]
    rows = sparse.csr_array(seen_by[:, owner])
    rows.sort_indices()
    return Coverage(
        Information(
            len(first),
            rows.indptr.astype(np.int64),
            rows.indices.astype(np.int32),
            np.ones((rows.nnz, 1), dtype=np.float32),
        ),
        objective.times,
        weights,
        partial=objective.partial,
    )


def restricted_coverage(objective: Coverage, keep: IntArray) -> Coverage:
    """Return `coverage` by the candidates `keep` alone; samples keep their numbers."""
    return Coverage(
        restricted_information(objective.information, keep),
        objective.times,
        objective.weights,
        partial=objective.partial,
    )
