"""What a camera adds to the one before it, for every pair whose windows meet.

    gain(j | i) = alone_j + Σ_{t in both} w_t log [det(I + J_i + J_j) / det(I + J_i) det(I + J_j)]

An *arc* i → j is a pair i before j whose windows overlap and which may stand together. Pairs
whose windows do not overlap have the gain alone_j, and need no arc.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.chain.windows import Windows

TINY = 1e-150  # no product of ratios may come near underflow: two of these still fit


@dataclass(frozen=True, slots=True)
class Arcs:
    """Hold m arcs sorted by target: those into j are `into[j]:into[j + 1]`.

    source, target, gain (m,); `by_source` (m,) lists arcs by source, `out_of` (n + 1,) indexes it.
    """

    into: IntArray
    source: NDArray[np.int32]
    target: NDArray[np.int32]
    gain: FloatArray
    by_source: IntArray
    out_of: IntArray

    def __len__(self) -> int:
        """Return m."""
        return len(self.source)


def make_arcs(
    n: int, source: NDArray[np.int32], target: NDArray[np.int32], gain: FloatArray
) -> Arcs:
    """Index arcs, given sorted by target."""
    into = np.concatenate([[0], np.cumsum(np.bincount(target, minlength=n))]).astype(np.int64)
    by_source = np.argsort(source, kind="stable").astype(np.int64)
    out_of = np.concatenate([[0], np.cumsum(np.bincount(source, minlength=n))]).astype(np.int64)
    return Arcs(into, source, target, gain, by_source, out_of)


def pair_arcs(windows: Windows) -> Arcs:
    """Return every arc between `windows` with its gain."""
    lookback = first_meeting(windows.first, windows.last)
    counts = np.zeros(len(windows), dtype=np.int64)
    _count_pairs(windows.first, windows.last, windows.group, lookback, counts)
    into = np.concatenate([[0], np.cumsum(counts)])
    source = np.empty(into[-1], dtype=np.int32)
    gain = np.empty(into[-1])
    _fill_pairs(
        windows.indptr,
        windows.position,
        windows.block,
        windows.weight,
        windows.det,
        windows.first,
        windows.last,
        windows.group,
        windows.alone,
        lookback,
        into,
        source,
        gain,
        np.zeros((windows.n_positions, 3)),
        np.zeros(windows.n_positions),
    )
    target = np.repeat(np.arange(len(windows), dtype=np.int32), counts)
    return make_arcs(len(windows), source, target, gain)


def restricted_arcs(arcs: Arcs, keep_arc: BoolArray, keep_node: BoolArray) -> Arcs:
    """Return the arcs marked in `keep_arc` (m,) between the nodes marked in `keep_node` (n,)."""
    kept = keep_arc & keep_node[arcs.source] & keep_node[arcs.target]
    number = (np.cumsum(keep_node) - 1).astype(np.int32)
    return make_arcs(
        int(keep_node.sum()), number[arcs.source[kept]], number[arcs.target[kept]], arcs.gain[kept]
    )


def first_meeting(first: IntArray, last: IntArray) -> IntArray:
    """Return, for each j, the lowest i whose window, or one in between, reaches that of j, (n,)."""
    reach = np.maximum.accumulate(last) if last.size else last
    return np.minimum(np.searchsorted(reach, first), np.arange(last.size)).astype(np.int64)


@numba.njit(cache=True, inline="always")
def det(a: float, c: float, b: float) -> float:
    """Return det(I + A) of A = [[a, c], [c, b]]."""
    return 1.0 + a + b + max(a * b - c * c, 0.0)


@numba.njit(cache=True)
def _count_pairs(
    first: IntArray, last: IntArray, group: IntArray, lookback: IntArray, counts: IntArray
) -> None:
    for j in range(len(first)):
        for i in range(lookback[j], j):
            if last[i] >= first[j] and (group[i] < 0 or group[i] != group[j]):
                counts[j] += 1


@numba.njit(cache=True)
def _fill_pairs(
    indptr: IntArray,
    position: IntArray,
    block: FloatArray,
    weight: FloatArray,
    own_det: FloatArray,
    first: IntArray,
    last: IntArray,
    group: IntArray,
    alone: FloatArray,
    lookback: IntArray,
    into: IntArray,
    source: NDArray[np.int32],
    gain: FloatArray,
    here: FloatArray,
    here_det: FloatArray,
) -> None:
    """Write sources and gains; `here` (positions, 3) and `here_det` are zero scratch space."""
    for j in range(len(first)):
        for e in range(indptr[j], indptr[j + 1]):
            here[position[e]] = block[e]
            here_det[position[e]] = own_det[e]
        q = into[j]
        for i in range(lookback[j], j):
            if last[i] >= first[j] and (group[i] < 0 or group[i] != group[j]):
                # Ratios are multiplied up while weights agree: one logarithm instead of many.
                total, product, power = alone[j], 1.0, 1.0
                for e in range(indptr[i], indptr[i + 1]):
                    p = position[e]
                    if here_det[p] > 0.0:
                        if weight[e] != power or product < TINY:
                            total += power * np.log(product)
                            product, power = 1.0, weight[e]
                        product *= det(
                            block[e, 0] + here[p, 0],
                            block[e, 1] + here[p, 1],
                            block[e, 2] + here[p, 2],
                        ) / (own_det[e] * here_det[p])
                total += power * np.log(product)
                source[q] = i
                gain[q] = total
                q += 1
        for e in range(indptr[j], indptr[j + 1]):
            here[position[e]] = 0.0
            here_det[position[e]] = 0.0
