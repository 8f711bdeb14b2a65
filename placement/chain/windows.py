"""Candidates in their order along the path, each with the stretch of samples it sees.

On a closed path the samples are unrolled from a cut: a window that crosses the cut keeps its
length, and what two windows share beyond the cut is not seen as shared. The chain bound conditions
each camera on the ones before it; forgetting a shared sample conditions on less, and so only
raises the bound. The cut is laid where candidates have least to tell across it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.constraints import Constraints
from placement.objectives.localisation import Localisation

# Roundings in one log det of three blocks, with room.
_ROUNDINGS = 16.0
_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True)
class Windows:
    """Hold n usable candidates, ordered along the path, as CSR rows.

    candidate (n,): the original numbers; group (n,), −1 for none; mandatory (n,): required.
    Row j spans `indptr[j]:indptr[j + 1]` of position (unrolled sample numbers, rising), sample,
    block (nnz, 3) (s·J as [tt, tn, nn], isotropic ones too), weight (nnz,), and det (nnz,), that
    of I + sJ. first, last (n,): the ends of each window. alone (n,): each candidate's value by
    itself; slack (n,): the rounding error of any gain of it. wraps: whether some sample has two
    positions, so that sums over positions only bound values.
    """

    candidate: IntArray
    group: IntArray
    mandatory: BoolArray
    indptr: IntArray
    position: IntArray
    sample: IntArray
    block: FloatArray
    weight: FloatArray
    det: FloatArray
    first: IntArray
    last: IntArray
    alone: FloatArray
    slack: FloatArray
    n_positions: int
    wraps: bool

    def __len__(self) -> int:
        """Return n."""
        return len(self.candidate)

    def subset(self, keep: BoolArray) -> Windows:
        """Return the windows marked in `keep` (n,), in the same order and positions."""
        return self.taken(np.flatnonzero(keep))

    def taken(self, rows: IntArray) -> Windows:
        """Return the windows `rows`, in that order."""
        lengths = np.diff(self.indptr)[rows]
        ends = np.cumsum(lengths)
        entries = np.arange(int(lengths.sum())) + np.repeat(
            self.indptr[rows] - (ends - lengths), lengths
        )
        return Windows(
            self.candidate[rows],
            self.group[rows],
            self.mandatory[rows],
            np.concatenate([[0], ends]).astype(np.int64),
            self.position[entries],
            self.sample[entries],
            self.block[entries],
            self.weight[entries],
            self.det[entries],
            self.first[rows],
            self.last[rows],
            self.alone[rows],
            self.slack[rows],
            self.n_positions,
            self.wraps,
        )


def reordered(windows: Windows, power: float) -> tuple[Windows, IntArray]:
    """Order windows by their centre, samples weighted by (log det)^power; return the rows, too.

    Any order gives a valid bound in which windows that do not meet come one after the other, as
    any mean of each window's positions ensures. But how good a bound depends much on the order:
    on `winding` with 80 cameras, first and second order are 2.7 and 1.2 % off by the plain middle
    (power 0), 0.8 and 0.8 % by power 1, 1.6 and 0.55 % by power 0.3.
    """
    row = np.repeat(np.arange(len(windows)), np.diff(windows.indptr))
    mass = np.log(windows.det) ** power + 1e-300
    total = np.bincount(row, mass, len(windows))
    centre = np.bincount(row, mass * windows.position, len(windows)) / total
    # Equal centres must not fall apart with rounding: the original number decides between them.
    rows = np.lexsort((windows.candidate, np.round(centre, 9)))
    return windows.taken(rows), rows


def ordered_windows(
    objective: Localisation, constraints: Constraints, power: float = 1.0
) -> Windows:
    """Order the usable candidates that see anything (`reordered`), and unroll their windows.

    A required candidate that sees nothing is left out, too: it uses budget, but no order.
    """
    usable = constraints.usable() & (np.diff(objective.indptr) > 0)
    rows = np.flatnonzero(usable)
    t = objective.information.n_samples
    start, length = _cyclic_spans(objective.indptr, objective.indices, rows, t)
    cut = _quiet_cut(start, length, objective.first_gains()[rows], t)
    start = (start - cut) % t
    # Windows whose middle lies beyond the end belong, one turn earlier, to the beginning.
    start = np.where(start + length / 2.0 >= t, start - t, start)
    return reordered(_gather(objective, constraints, rows, start, cut), power)[0]


def _gather(
    objective: Localisation, constraints: Constraints, rows: IntArray, start: IntArray, cut: int
) -> Windows:
    t = objective.information.n_samples
    lengths = np.diff(objective.indptr)[rows]
    ends = np.cumsum(lengths)
    row = np.repeat(np.arange(rows.size), lengths)
    entries = objective.indptr[rows][row] + np.arange(int(lengths.sum())) - (ends - lengths)[row]
    sample = objective.indices[entries].astype(np.int64)
    # One turn is added throughout, so that no position is negative.
    position = t + start[row] + (sample - cut - start[row]) % t
    by_place = np.lexsort((position, row))
    entries, sample, position = entries[by_place], sample[by_place], position[by_place]
    block = objective.scale * objective.blocks[entries].astype(np.float64)
    if block.shape[1] == 1:
        block = np.column_stack([block[:, 0], np.zeros(len(block)), block[:, 0]])
    a, c, b = block.T
    weight = objective.weights[sample]
    excess = a + b + np.maximum(a * b - c * c, 0.0)
    own = weight * np.log1p(excess)
    indptr = np.concatenate([[0], ends]).astype(np.int64)
    rounding = weight * (_conditioning(block, sample, t) + 1.0) + own
    mandatory = np.zeros(constraints.n, dtype=np.bool_)
    mandatory[constraints.required] = True
    first_sample = np.full(t, -1, dtype=np.int64)
    first_sample[sample] = position
    return Windows(
        rows,
        constraints.group[rows],
        mandatory[rows],
        indptr,
        position,
        sample,
        np.ascontiguousarray(block),
        weight,
        1.0 + excess,
        position[indptr[:-1]],
        position[indptr[1:] - 1],
        np.add.reduceat(own, indptr[:-1]) if rows.size else np.empty(0),
        _ROUNDINGS * _EPS * (np.add.reduceat(rounding, indptr[:-1]) if rows.size else own),
        3 * t,
        bool(np.any(first_sample[sample] != position)),
    )


def _conditioning(block: FloatArray, sample: IntArray, t: int) -> FloatArray:
    """Bound, for each entry's sample, the conditioning of log det(I + any sum of its blocks).

    With |c_i| ≤ ρ √(a_i b_i) for every block, the same holds for sums (Cauchy–Schwarz), so
    (1 + a)(1 + b) / det ≤ 1 / (1 − ρ²); and by positive semidefiniteness ≤ 1 + min(a, b).
    """
    a, c, b = block.T
    product = a * b
    share = np.divide(c * c, product, out=np.zeros(len(a)), where=product > 0.0)
    worst = np.zeros(t)
    np.maximum.at(worst, sample, np.minimum(share, 1.0 - _EPS))
    total = np.maximum(np.bincount(sample, a, t), np.bincount(sample, b, t))
    return np.asarray(np.minimum(1.0 / (1.0 - worst), 1.0 + total)[sample])


@numba.njit(cache=True)
def _cyclic_spans(
    indptr: IntArray, indices: NDArray[np.int32], rows: IntArray, t: int
) -> tuple[IntArray, IntArray]:
    """Return, for each row, where its shortest cyclic interval of samples starts, and its length.

    The interval leaves out the row's largest gap, counted around the end of the path; where gaps
    tie, the one around the end.
    """
    starts, lengths = np.empty(len(rows), np.int64), np.empty(len(rows), np.int64)
    for r in range(len(rows)):
        low, high = indptr[rows[r]], indptr[rows[r] + 1]
        widest = indices[low] + t - indices[high - 1]
        starts[r] = indices[low]
        for e in range(low + 1, high):
            if indices[e] - indices[e - 1] > widest:
                widest = indices[e] - indices[e - 1]
                starts[r] = indices[e]
        lengths[r] = t - widest
    return starts, lengths


@numba.njit(cache=True)
def _quiet_cut(start: IntArray, length: IntArray, alone: FloatArray, t: int) -> int:
    """Return the sample before which to cut: where the windows across are worth least together.

    Sample 0, if nothing crosses there: an open path is left as it is.
    """
    crossing = np.zeros(t)
    for r in range(len(start)):
        for at in range(start[r] + 1, start[r] + length[r] + 1):
            crossing[at % t] += alone[r]
    return int(np.argmin(crossing)) if t and crossing[0] > 0.0 else 0
