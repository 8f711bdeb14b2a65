"""The chain bound to second order, at a price a camera instead of a count.

Conditioning on the last two cameras is valid for the same reason as on the last one,

    f(S) ≤ alone(i_1) + gain(i_2 | i_1) + Σ_{l ≥ 3} gain(i_l | i_{l−1}, i_{l−2}),

and much tighter where three windows overlap. A state is an arc i → j, the last two cameras; a
camera whose window does not meet the one before starts afresh, with its value alone. At a price
λ ≥ 0 for each camera no count is needed, and for every placement of at most k cameras

    f(S) ≤ k λ + max over paths (gains − λ · nodes).

The right side is convex in λ: its least value is the bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.chain.first_order import NONE
from placement.chain.pairs import TINY, Arcs, det
from placement.chain.windows import Windows


@dataclass(frozen=True, slots=True)
class Priced:
    """Values of paths net of `price` a node, by their last (or first) two nodes.

    start (n,): paths that end in a node which starts afresh. arc (m,): paths that end in an arc.
    after_start (n,), after_arc (m,): what can still be added after each, at least 0 where a path
    may end. best: the best whole path.
    """

    price: float
    start: FloatArray
    arc: FloatArray
    after_start: FloatArray
    after_arc: FloatArray
    best: float


def price_paths(windows: Windows, arcs: Arcs, price: float) -> Priced:
    """Run the second-order dynamic program forwards and backwards at one price."""
    n, m = len(windows), len(arcs)
    start, arc = np.full(n, NONE), np.full(m, NONE)
    after_start, after_arc = np.full(n, NONE), np.full(m, NONE)
    steps: Any = (
        (_priced_forward, (arcs.into, arcs.source, arcs.gain), (start, arc)),
        (
            _priced_backward,
            (arcs.into, arcs.source, arcs.target, arcs.gain, arcs.by_source, arcs.out_of),
            (after_start, after_arc),
        ),
    )
    for kernel, ways, out in steps:
        kernel(*_rows(windows), *ways, price, *_scratch(windows), *out)
    whole = [start + after_start, arc + after_arc]
    best = max(0.0 if not windows.mandatory.any() else NONE, *(w.max(initial=NONE) for w in whole))
    return Priced(price, start, arc, after_start, after_arc, best)


def forward_best(
    windows: Windows, arcs: Arcs, price: float
) -> tuple[float, FloatArray, FloatArray]:
    """Run it forwards alone: return the best whole path's net value, and start (n,), arc (m,)."""
    start, arc = np.full(len(windows), NONE), np.full(len(arcs), NONE)
    into: Any = (arcs.into, arcs.source, arcs.gain)
    kernel: Any = _priced_forward
    kernel(*_rows(windows), *into, price, *_scratch(windows), start, arc)
    needed = np.flatnonzero(windows.mandatory)
    from_ = int(needed[-1]) if needed.size else 0
    best = max(
        NONE if needed.size else 0.0,
        start[from_:].max(initial=NONE),
        arc[arcs.into[from_] :].max(initial=NONE),
    )
    return best, start, arc


def _rows(windows: Windows) -> tuple[Any, ...]:
    """Return what both kernels read of the windows."""
    return (
        windows.indptr,
        windows.position,
        windows.block,
        windows.weight,
        windows.det,
        windows.first,
        windows.last,
        windows.group,
        windows.mandatory,
        windows.alone,
    )


def _scratch(windows: Windows) -> tuple[Any, ...]:
    """Return zeroed dense rows, blocks and determinants, for two nodes."""
    p = windows.n_positions
    return np.zeros((p, 3)), np.zeros(p), np.zeros((p, 3)), np.zeros(p)


@numba.njit(cache=True, inline="always")
def _third(
    row_low: int,
    row_high: int,
    position: IntArray,
    block: FloatArray,
    weight: FloatArray,
    middle: FloatArray,
    middle_det: FloatArray,
    outer: FloatArray,
    outer_det: FloatArray,
) -> float:
    """Return by how much a row lowers the gain of `outer` given `middle`: a sum of w log ratios."""
    total, product, power = 0.0, 1.0, 1.0
    for e in range(row_low, row_high):
        p = position[e]
        if outer_det[p] == 0.0:
            continue
        if weight[e] != power or product < TINY:
            total += power * np.log(product)
            product, power = 1.0, weight[e]
        a, c, b = middle[p, 0], middle[p, 1], middle[p, 2]
        x, y, z = block[e, 0], block[e, 1], block[e, 2]
        u, v, w = outer[p, 0], outer[p, 1], outer[p, 2]
        here = middle_det[p] if middle_det[p] > 0.0 else 1.0
        product *= det(a + x + u, c + y + v, b + z + w) / det(a + x, c + y, b + z)
        product *= here / det(a + u, c + v, b + w)
    return float(total + power * np.log(product))


@numba.njit(cache=True, inline="always")
def _fill(
    j: int,
    indptr: IntArray,
    position: IntArray,
    block: FloatArray,
    own_det: FloatArray,
    dense: FloatArray,
    dense_det: FloatArray,
) -> None:
    for e in range(indptr[j], indptr[j + 1]):
        dense[position[e]] = block[e]
        dense_det[position[e]] = own_det[e]


@numba.njit(cache=True, inline="always")
def _clear(
    j: int, indptr: IntArray, position: IntArray, dense: FloatArray, dense_det: FloatArray
) -> None:
    for e in range(indptr[j], indptr[j + 1]):
        dense[position[e]] = 0.0
        dense_det[position[e]] = 0.0


@numba.njit(cache=True)
def _priced_forward(
    indptr: IntArray,
    position: IntArray,
    block: FloatArray,
    weight: FloatArray,
    own_det: FloatArray,
    first: IntArray,
    last: IntArray,
    group: IntArray,
    mandatory: BoolArray,
    alone: FloatArray,
    into: IntArray,
    source: NDArray[np.int32],
    gain: FloatArray,
    price: float,
    middle: FloatArray,
    middle_det: FloatArray,
    outer: FloatArray,
    outer_det: FloatArray,
    start: FloatArray,
    arc: FloatArray,
) -> None:
    clear = np.zeros(middle.shape[0] + 1)  # as in first order, one count
    order = np.empty(len(arc), np.int64)  # the arcs into each node, best first
    low = 0
    for j in range(len(alone)):
        start[j] = clear[first[j]] + alone[j] - price
        best = start[j]
        _fill(j, indptr, position, block, own_det, outer, outer_det)
        for q in range(into[j], into[j + 1]):
            i = source[q]
            if i < low:
                continue
            value = start[i] + gain[q]
            filled = False
            for s in range(into[i], into[i + 1]):
                r = order[s]
                # Two conditions leave at most what one leaves: no later arc can do better.
                if arc[r] + gain[q] <= value:
                    break
                h = source[r]
                if group[h] >= 0 and group[h] == group[j]:
                    continue
                if last[h] < first[j]:
                    value = arc[r] + gain[q]
                    continue
                if not filled:
                    _fill(i, indptr, position, block, own_det, middle, middle_det)
                    filled = True
                third = _third(
                    indptr[h],
                    indptr[h + 1],
                    position,
                    block,
                    weight,
                    middle,
                    middle_det,
                    outer,
                    outer_det,
                )
                value = max(value, arc[r] + gain[q] + third)
            if filled:
                _clear(i, indptr, position, middle, middle_det)
            arc[q] = value - price
            best = max(best, arc[q])
        order[into[j] : into[j + 1]] = into[j] + np.argsort(-arc[into[j] : into[j + 1]])
        _clear(j, indptr, position, outer, outer_det)
        if mandatory[j]:
            clear[:] = NONE
            low = j
        p = last[j] + 1
        while p < len(clear) and clear[p] < best:
            clear[p] = best
            p += 1


@numba.njit(cache=True)
def _priced_backward(
    indptr: IntArray,
    position: IntArray,
    block: FloatArray,
    weight: FloatArray,
    own_det: FloatArray,
    first: IntArray,
    last: IntArray,
    group: IntArray,
    mandatory: BoolArray,
    alone: FloatArray,
    into: IntArray,
    source: NDArray[np.int32],
    target: NDArray[np.int32],
    gain: FloatArray,
    by_source: IntArray,
    out_of: IntArray,
    price: float,
    middle: FloatArray,
    middle_det: FloatArray,
    outer: FloatArray,
    outer_det: FloatArray,
    after_start: FloatArray,
    after_arc: FloatArray,
) -> None:
    n = len(alone)
    clear = np.zeros(middle.shape[0] + 1)
    high = n
    for j in range(n - 1, -1, -1):
        end = clear[last[j]]  # nothing more, or a fresh start further on; NONE past a required node
        if high == n:
            end = max(end, 0.0)
        value = end
        for s in range(out_of[j], out_of[j + 1]):
            q = by_source[s]
            if target[q] <= high:
                value = max(value, gain[q] - price + after_arc[q])
        after_start[j] = value
        # The ways on, best first, as if they were conditioned on j alone.
        ways = by_source[out_of[j] : out_of[j + 1]]
        ways = ways[target[ways] <= high]
        worth = gain[ways] - price + after_arc[ways]
        best_first = np.argsort(-worth)
        _fill(j, indptr, position, block, own_det, middle, middle_det)
        for q in range(into[j], into[j + 1]):
            i = source[q]
            value = end
            filled = False
            for s in best_first:
                then = target[ways[s]]
                if worth[s] <= value:
                    break
                if group[i] >= 0 and group[i] == group[then]:
                    continue
                if last[i] < first[then]:
                    value = worth[s]
                    continue
                if not filled:
                    _fill(i, indptr, position, block, own_det, outer, outer_det)
                    filled = True
                # Symmetric in the outer two: then lowers nothing of i, but the ratios are the same.
                third = _third(
                    indptr[then],
                    indptr[then + 1],
                    position,
                    block,
                    weight,
                    middle,
                    middle_det,
                    outer,
                    outer_det,
                )
                value = max(value, worth[s] + third)
            if filled:
                _clear(i, indptr, position, outer, outer_det)
            after_arc[q] = value
        _clear(j, indptr, position, middle, middle_det)
        if mandatory[j]:
            clear[:] = NONE
            high = j
        value = alone[j] - price + after_start[j]
        p = first[j] - 1
        while p >= 0 and clear[p] < value:
            clear[p] = value
            p -= 1
