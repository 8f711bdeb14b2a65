"""Linear inequalities that every placement satisfies, one sample of the path at a time.

For a sample t with term f_t(S) = w_t log det(I + s Σ_{i ∈ S} J_it), monotone and submodular, and
any set R of candidates (Nemhauser & Wolsey 1981):

    f_t(S) ≤ f_t(S ∪ R) ≤ f_t(R) + Σ_{j ∈ S∖R} gain_t(j | R)      the *submodular* cut at R,

tight at S = R. For fractional x the term is concave, so its tangent at any x° bounds it, too:

    f_t(S) ≤ f_t(x°) + Σ_j slope_tj(x°) (x_j − x°_j)               the *tangent* cut at x°.

Both have the form f_t(S) ≤ constant + Σ_{j sees t} coefficient_j x_j, with coefficients ≥ 0.
Coefficients are rounded outwards, so a cut holds in exact arithmetic for the stored blocks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.objectives.localisation import Localisation

# Sets R that separation tries: every subset of at most two of the first DEPTH fractional
# candidates, the prefixes by weight, and what adding or dropping one of them then improves.
DEPTH = 10
# Roundings in one gain, with room: each loses at most half an ulp of the terms it adds.
ROUNDINGS = 16.0
_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True)
class Cuts:
    """Hold m cuts f_t(S) ≤ constant + Σ coefficient_j x_j as CSR rows over candidates.

    sample (m,), constant (m,); row r spans `indptr[r]:indptr[r + 1]` of candidate and coefficient.
    """

    sample: IntArray
    constant: FloatArray
    indptr: IntArray
    candidate: NDArray[np.int32]
    coefficient: FloatArray

    def __len__(self) -> int:
        """Return the number of cuts, m."""
        return len(self.sample)

    def at(self, x: FloatArray) -> FloatArray:
        """Return each cut's right-hand side (m,) at `x` (c,)."""
        row = np.repeat(np.arange(len(self)), np.diff(self.indptr))
        weighted = self.coefficient * x[self.candidate]
        totals: FloatArray = self.constant + np.bincount(row, weighted, len(self))
        return totals

    def subset(self, keep: NDArray[np.bool_]) -> Cuts:
        """Return the cuts marked in `keep` (m,)."""
        lengths = np.diff(self.indptr)
        entries = np.repeat(keep, lengths)
        indptr = np.concatenate([[0], np.cumsum(lengths[keep])])
        return Cuts(
            self.sample[keep],
            self.constant[keep],
            indptr,
            self.candidate[entries],
            self.coefficient[entries],
        )

    def renumbered(self, position: IntArray) -> Cuts:
        """Return the cuts with candidate j called `position[j]`; those at −1 are left out.

        Valid for placements that hold none of those.
        """
        new = position[self.candidate]
        ends = np.concatenate([[0], np.cumsum(new >= 0)])
        return Cuts(
            self.sample,
            self.constant,
            ends[self.indptr].astype(np.int64),
            new[new >= 0].astype(np.int32),
            self.coefficient[new >= 0],
        )


def joined(parts: list[Cuts]) -> Cuts:
    """Return all cuts of `parts` in one, in order."""
    offsets = np.cumsum([0] + [len(p.candidate) for p in parts])
    starts = [p.indptr[:-1] + o for p, o in zip(parts, offsets, strict=False)]
    return Cuts(
        np.concatenate([p.sample for p in parts]),
        np.concatenate([p.constant for p in parts]),
        np.concatenate([*starts, offsets[-1:]]).astype(np.int64),
        np.concatenate([p.candidate for p in parts]),
        np.concatenate([p.coefficient for p in parts]),
    )


class CutMaker:
    """Make cuts of one objective; what depends on it alone is computed once."""

    def __init__(self, objective: Localisation) -> None:
        """List the stored entries sample by sample."""
        self.objective = objective
        # `sample_candidates` is in this order: by sample, and by candidate within one.
        self._order = np.argsort(objective.indices, kind="stable").astype(np.int64)
        self._counts = np.diff(objective.sample_indptr)
        self._seen = self._counts > 0
        self._n_samples = objective.information.n_samples
        self._row_lengths = np.diff(objective.indptr)

    def submodular(self, selected: IntArray) -> Cuts:
        """Return the cut at R = `selected` of every sample that some candidate sees."""
        x = np.zeros(self.objective.n_candidates)
        x[selected] = 1.0
        sums = self.objective.sums(x)
        gains = self.objective.entry_gains(sums)
        gains[np.repeat(x > 0.0, self._row_lengths)] = 0.0
        return self._rounded(sums, self.objective.sample_scores(sums), gains, self._slack(sums))

    def tangent(self, x: FloatArray) -> Cuts:
        """Return the tangent at `x` (c,) of every sample that some candidate sees."""
        sums = self.objective.sums(x)
        slopes = self.objective.entry_slopes(sums)
        weighted = slopes * np.repeat(x, self._row_lengths)
        inner = np.bincount(self.objective.indices, weighted, self._n_samples)
        scores = self.objective.sample_scores(sums)
        slack = self._slope_slack(sums)
        # `inner` sums what slopes and their own rounding contribute; its constant goes up by both.
        lost = np.bincount(
            self.objective.indices,
            (slack + (ROUNDINGS + self._counts[self.objective.indices]) * _EPS * slopes)
            * np.repeat(x, self._row_lengths),
            self._n_samples,
        )
        cuts = self._rounded(sums, scores - inner, slopes, slack)
        # A concave term that is 0 at x = 0 has tangents that are at least 0 there.
        constant = np.maximum(cuts.constant + lost[cuts.sample], 0.0)
        return Cuts(cuts.sample, constant, cuts.indptr, cuts.candidate, cuts.coefficient)

    def separate(self, x: FloatArray, level: FloatArray, by: float) -> Cuts:
        """Return, for each sample t whose `level_t` exceeds a cut at `x` by more than `by`, one.

        `x` (c,) are fractional choices and `level` (t,) what a relaxation believes each sample's
        term to be. Of the sets R tried the one with the least right-hand side at `x` is taken,
        or the tangent at `x` where that is lower still.
        """
        f = self.objective
        members = np.full((self._n_samples, DEPTH), -1, dtype=np.int64)
        sides = np.full(self._n_samples, np.inf)
        _find_sets(
            x,
            f.sample_indptr,
            f.sample_candidates,
            self._order,
            f.blocks,
            f.weights,
            f.scale,
            members,
            sides,
        )
        tangents = self.tangent(x)
        tangent_sides = tangents.at(x)
        tangents = tangents.subset(
            (tangent_sides < sides[tangents.sample] - by)
            & (level[tangents.sample] > tangent_sides + by)
        )
        wanted = level > sides + by
        wanted[tangents.sample] = False
        return joined([self._at_sets(members).subset(wanted[self._seen]), tangents])

    def _at_sets(self, members: IntArray) -> Cuts:
        """Return the submodular cut of each sample at its own set of entries (t, DEPTH)."""
        f = self.objective
        inside = np.zeros(len(f.indices), dtype=np.bool_)
        inside[members[members >= 0]] = True
        columns = (0, None, 0) if f.blocks.shape[1] == 1 else (0, 1, 2)
        sums = np.zeros((self._n_samples, 3))
        for column, stored in enumerate(columns):
            if stored is not None:
                values = f.blocks[inside, stored].astype(np.float64)
                sums[:, column] = np.bincount(f.indices[inside], values, self._n_samples)
        gains = f.entry_gains(sums)
        gains[inside] = 0.0
        return self._rounded(sums, f.sample_scores(sums), gains, self._slack(sums))

    def _rounded(
        self, sums: FloatArray, constant: FloatArray, coefficient: FloatArray, slack: FloatArray
    ) -> Cuts:
        """Assemble one cut a sample from entry coefficients (nnz,), rounded outwards.

        `slack` (nnz,) is the absolute error of each coefficient; those that are 0 stay 0, since
        they stand for members of R.
        """
        loss = ROUNDINGS * _EPS
        coefficient = coefficient[self._order]
        up = coefficient * (1.0 + loss) + slack[self._order]
        nonzero = coefficient > 0.0
        ends = np.concatenate([[0], np.cumsum(nonzero)])
        kept = np.diff(ends[self.objective.sample_indptr])[self._seen]
        weights = self.objective.weights
        constant = constant + loss * (np.abs(constant) + weights * (self._conditioning(sums) - 1.0))
        return Cuts(
            np.flatnonzero(self._seen),
            constant[self._seen],
            np.concatenate([[0], np.cumsum(kept)]).astype(np.int64),
            self.objective.sample_candidates[nonzero],
            up[nonzero],
        )

    def _conditioning(self, sums: FloatArray) -> FloatArray:
        """Return how much larger the terms of det(I + sA) are than the determinant, (t,) ≥ 1.

        An error of one ulp in the terms is this many in the determinant, and as much, absolute,
        in its logarithm.
        """
        if self.objective.blocks.shape[1] == 1:
            return np.ones(len(sums))
        a, c, b = (self.objective.scale * sums).T
        return np.asarray((1.0 + a) * (1.0 + b) / (1.0 + a + b + np.maximum(a * b - c * c, 0.0)))

    def _slack(self, sums: FloatArray) -> FloatArray:
        """Bound the absolute error of each entry's gain over `sums`, (nnz,)."""
        f = self.objective
        if f.blocks.shape[1] == 1:
            return np.zeros(len(f.indices))
        with_entry = sums[f.indices] + f.blocks.astype(np.float64)
        loss = ROUNDINGS * _EPS * (self._conditioning(with_entry) - 1.0)
        return np.asarray(f.weights[f.indices] * loss)

    def _slope_slack(self, sums: FloatArray) -> FloatArray:
        """Bound the absolute error of each entry's slope at `sums`, (nnz,)."""
        f = self.objective
        if f.blocks.shape[1] == 1:
            return np.zeros(len(f.indices))
        a, c, b = (f.scale * sums[f.indices]).T
        j_a, _, j_b = f.scale * f.blocks.astype(np.float64).T
        terms = j_a * (1.0 + b) + j_b * (1.0 + a)
        det = 1.0 + a + b + np.maximum(a * b - c * c, 0.0)
        conditioning = self._conditioning(sums)[f.indices]
        return np.asarray(f.weights[f.indices] * ROUNDINGS * _EPS * conditioning * terms / det)


@numba.njit(cache=True)
def _log_det(a: float, c: float, b: float) -> float:
    """Return log det(I + A) of A = [[a, c], [c, b]]."""
    return float(np.log1p(a + b + max(a * b - c * c, 0.0)))


@numba.njit(cache=True)
def _right_side(
    a: FloatArray, c: FloatArray, b: FloatArray, x: FloatArray, inside: NDArray[np.bool_]
) -> float:
    """Evaluate the submodular cut at the set marked `inside`, over n entries of one sample."""
    sa, sc, sb = 0.0, 0.0, 0.0
    for e in range(len(x)):
        if inside[e]:
            sa += a[e]
            sc += c[e]
            sb += b[e]
    base = _log_det(sa, sc, sb)
    total = base
    for e in range(len(x)):
        if not inside[e]:
            total += x[e] * (_log_det(sa + a[e], sc + c[e], sb + b[e]) - base)
    return total


@numba.njit(cache=True)
def _find_sets(
    x: FloatArray,
    sample_indptr: IntArray,
    sample_candidates: NDArray[np.int32],
    entries: IntArray,
    blocks: NDArray[np.float32],
    weights: FloatArray,
    scale: float,
    members: IntArray,
    sides: FloatArray,
) -> None:
    """Write the best set found for each sample as stored entries, and its right-hand side."""
    depth = members.shape[1]
    for t in range(len(weights)):
        low, high = sample_indptr[t], sample_indptr[t + 1]
        support = 0
        for p in range(low, high):
            support += x[sample_candidates[p]] > 1e-9
        if support == 0:
            sides[t] = 0.0  # the cut at the empty set
            continue
        at = np.empty(support, np.int64)
        xs, a, c, b = np.empty(support), np.empty(support), np.empty(support), np.empty(support)
        n = 0
        for p in range(low, high):
            if x[sample_candidates[p]] > 1e-9:
                at[n] = entries[p]
                xs[n] = x[sample_candidates[p]]
                a[n] = scale * blocks[at[n], 0]
                if blocks.shape[1] == 1:
                    c[n], b[n] = 0.0, a[n]
                else:
                    c[n], b[n] = scale * blocks[at[n], 1], scale * blocks[at[n], 2]
                n += 1
        first = np.argsort(-xs * np.log1p(a + b))[:depth]
        inside = np.zeros(support, np.bool_)
        best_set = inside.copy()
        best = _right_side(a, c, b, xs, inside)
        for p in range(len(first)):  # singles and pairs
            inside[first[p]] = True
            for q in range(p + 1):
                inside[first[q]] = True
                side = _right_side(a, c, b, xs, inside)
                if side < best:
                    best, best_set = side, inside.copy()
                if q < p:
                    inside[first[q]] = False
            inside[first[p]] = False
        for p in range(len(first)):  # prefixes
            inside[first[p]] = True
            side = _right_side(a, c, b, xs, inside)
            if side < best:
                best, best_set = side, inside.copy()
        improved = True
        while improved:  # add or drop one
            improved = False
            for p in range(len(first)):
                best_set[first[p]] = not best_set[first[p]]
                side = _right_side(a, c, b, xs, best_set)
                if side < best - 1e-12 * abs(best):
                    best, improved = side, True
                else:
                    best_set[first[p]] = not best_set[first[p]]
        sides[t] = weights[t] * best
        n = 0
        for p in range(support):
            if best_set[p]:
                members[t, n] = at[p]
                n += 1
