"""The cameras that a path through the diagram may use, and more than any placement could know.

The diagram forgets who stands where and lets a camera be used twice, so a candidate whose
information another's exceeds everywhere, be it on another mount, can be left out: the other
stands in for it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from models.geometry import BoolArray, FloatArray, IntArray
from placement.diagram.order import block_below, block_join
from placement.objectives.navigation import WhiteDrive

# Mirrored cameras differ by the rounding of float32 storage. One stands in for the other if it is
# no worse to this (relative), and every candidate that is kept is made better by as much.
TWINS = 5e-7
FAMILIES = 8  # cameras of one last sample that are told apart inside clusters


@dataclass(frozen=True, slots=True)
class Moves:
    """Hold the cameras of one drive, sorted by their first sample.

    candidate (v,): who it is. ptr (v + 1,): its rows of `blocks` (n, 3), one a sample from its
    first to its last, zero where it is blind in between. at (t + 1,): the moves that start at
    sample t are at[t]…at[t + 1] − 1. family (v,): 0, 1, … among the cameras of one last sample,
    less than `families`. span: the longest window in samples.
    """

    candidate: IntArray
    ptr: IntArray
    blocks: FloatArray
    at: IntArray
    family: IntArray
    families: int
    span: int


def make_moves(
    drive: WhiteDrive, usable: BoolArray, longest: int, budget: int
) -> tuple[Moves, FloatArray]:
    """List the `usable` (c,) candidates that see something and that no other exceeds.

    A move holds the first `longest` samples of a view at most (on a closed road a camera at the
    start sees the first samples and the last). Return the moves, and blocks (t, 3) above what any
    `budget` candidates see beyond: every placement gets these for nothing.

    Raises:
        ValueError: if most candidates see something beyond.
    """
    blocks = three_columns(drive)
    keep = undominated(drive.indptr, drive.indices, blocks, usable)
    t = drive.n_samples
    beyond = np.zeros((t, 3))
    if not keep.size:
        zeros = np.zeros(t + 1, dtype=np.int64)
        return Moves(keep, zeros[:1], np.zeros((0, 3)), zeros, zeros[:0], 1, 0), beyond
    first = drive.indices[drive.indptr[keep]].astype(np.int64)
    order = np.argsort(first, kind="stable")
    keep, first = keep[order], first[order]
    stop = np.array(
        [
            np.searchsorted(drive.indices[drive.indptr[i] : drive.indptr[i + 1]], f + longest)
            for i, f in zip(keep, first, strict=True)
        ],
        dtype=np.int64,
    )
    stop += drive.indptr[keep]
    split = np.flatnonzero(stop < drive.indptr[keep + 1])
    if 2 * split.size > keep.size:
        raise ValueError(
            f"method diagram needs views of at most {longest} samples for {budget} cameras, got "
            f"{split.size} longer ones among {keep.size}: use search or relaxation"
        )
    for at in split:
        _join_range(drive.indices, blocks, stop[at], drive.indptr[keep[at] + 1], beyond)
    beyond *= (1.0 + TWINS) * budget
    last = drive.indices[stop - 1].astype(np.int64)
    ptr = np.concatenate(([0], np.cumsum(last - first + 1)))
    dense = np.zeros((int(ptr[-1]), 3))
    for v, i in enumerate(keep):
        row = slice(drive.indptr[i], stop[v])
        dense[ptr[v] + drive.indices[row] - first[v]] = (1.0 + TWINS) * blocks[row]
    starting = np.searchsorted(first, np.arange(t + 1))
    family = np.zeros_like(last)
    by_last = np.argsort(last, kind="stable")
    starts = np.searchsorted(last[by_last], last[by_last])
    family[by_last] = (np.arange(last.size) - starts) % FAMILIES
    moves = Moves(
        keep, ptr, dense, starting, family, int(family.max()) + 1, int(np.max(last - first) + 1)
    )
    return moves, beyond


def floor_information(drive: WhiteDrive, usable: BoolArray, budget: int) -> FloatArray:
    """Return blocks (t, 3) above the information of every placement at every sample.

    Two such blocks are known: the sum over all usable candidates, and `budget` times their join;
    at each sample the one of smaller trace is taken.
    """
    rows = np.flatnonzero(usable)
    everything = drive.total(rows)
    join = np.zeros((drive.n_samples, 3))
    _join_rows(drive.indptr, drive.indices, three_columns(drive), rows, join)
    join *= budget
    smaller = join[:, 0] + join[:, 2] < everything[:, 0] + everything[:, 2]
    return np.where(smaller[:, None], join, everything)


def three_columns(drive: WhiteDrive) -> FloatArray:
    """Return the drive's blocks in float64, frames counted, as (nnz, 3) whatever the model."""
    blocks = drive.frames * drive.blocks.astype(np.float64)
    if blocks.shape[1] == 3:
        return blocks
    return np.column_stack([blocks[:, 0], np.zeros(len(blocks)), blocks[:, 0]])


def undominated(
    indptr: IntArray, indices: np.ndarray, blocks: FloatArray, usable: BoolArray
) -> IntArray:
    """Return the usable candidates that see something and that no other exceeds everywhere."""
    seeing, stand_in = stand_ins(indptr, indices, blocks, usable)
    kept: IntArray = seeing[stand_in == seeing]
    return kept


def stand_ins(
    indptr: IntArray, indices: np.ndarray, blocks: FloatArray, usable: BoolArray
) -> tuple[IntArray, IntArray]:
    """Return the usable candidates that see something, and for each one that exceeds it.

    The latter (its own number where no other does) is exceeded by none itself.
    """
    seeing = np.flatnonzero(usable & (np.diff(indptr) > 0))
    first = indices[indptr[seeing]].astype(np.int64)
    last = indices[indptr[seeing + 1] - 1].astype(np.int64)
    sums = np.concatenate(([0.0], np.cumsum(blocks[:, 0] + blocks[:, 2])))
    worth = sums[indptr[seeing + 1]] - sums[indptr[seeing]]
    order = np.lexsort((seeing, -worth))
    stand_in = np.arange(seeing.size)
    _dominate(indptr, indices, blocks, seeing, first, last, order, stand_in)
    return seeing, seeing[stand_in]


def most_starting(drive: WhiteDrive, usable: BoolArray, group: IntArray) -> IntArray:
    """Return how many cameras of a placement can start at each sample at most, (t,).

    At most one of each `group` (c,) is placed, if that is not negative; where a camera is no move
    of its own, it starts where the one does that stands in for it.
    """
    seeing, stand_in = stand_ins(drive.indptr, drive.indices, three_columns(drive), usable)
    start = drive.indices[drive.indptr[stand_in]].astype(np.int64)
    own = np.where(group >= 0, group, group.max(initial=0) + 1 + np.arange(group.size))[seeing]
    pairs = np.unique(np.column_stack([start, own]), axis=0)
    return np.bincount(pairs[:, 0], minlength=drive.n_samples)


@njit(cache=True)
def _join_rows(indptr, indices, blocks, rows, join):  # type: ignore[no-untyped-def]
    for i in rows:
        _join_range(indices, blocks, indptr[i], indptr[i + 1], join)


@njit(cache=True)
def _join_range(indices, blocks, start, stop, join):  # type: ignore[no-untyped-def]
    for e in range(start, stop):
        o = join[indices[e]]
        o[0], o[1], o[2] = block_join(o[0], o[1], o[2], blocks[e, 0], blocks[e, 1], blocks[e, 2])


@njit(cache=True)
def _dominate(indptr, indices, blocks, seeing, first, last, order, stand_in):  # type: ignore[no-untyped-def]
    """Replace candidates that one of greater total information, earlier in `order`, exceeds."""
    for a in range(order.size):
        x = order[a]
        i = seeing[x]
        for b in range(a):
            y = order[b]
            if stand_in[y] != y or first[y] > first[x] or last[y] < last[x]:
                continue
            e, stop = indptr[seeing[y]], indptr[seeing[y] + 1]
            exceeded = True
            for f in range(indptr[i], indptr[i + 1]):
                while e < stop and indices[e] < indices[f]:
                    e += 1
                if (
                    e == stop
                    or indices[e] != indices[f]
                    or not block_below(
                        blocks[f, 0],
                        blocks[f, 1],
                        blocks[f, 2],
                        (1.0 + TWINS) * blocks[e, 0],
                        (1.0 + TWINS) * blocks[e, 1],
                        (1.0 + TWINS) * blocks[e, 2],
                    )
                ):
                    exceeded = False
                    break
            if exceeded:
                stand_in[x] = y
                break
