"""The best path behind the values of `second_order.forward_best`: a walk back, in plain NumPy."""

from __future__ import annotations

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.chain.first_order import NONE
from placement.chain.pairs import Arcs
from placement.chain.windows import Windows


def decode(windows: Windows, arcs: Arcs, start: FloatArray, arc: FloatArray) -> IntArray:
    """Return the nodes of the best path of `forward_best`, up to ties within rounding.

    Walks back by values alone: from a state, the predecessor whose value and gain add up to it.
    """
    needed = np.flatnonzero(windows.mandatory)
    from_ = int(needed[-1]) if needed.size else 0
    head = int(np.argmax(start[from_:])) + from_ if len(start) > from_ else -1
    low = int(arcs.into[from_])
    tail = int(np.argmax(arc[low:])) + low if len(arc) > low else -1
    path: list[int] = []
    if tail >= 0 and arc[tail] > max(start[head], 0.0):
        state = tail
    else:
        if head < 0 or (start[head] <= 0.0 and not needed.size):
            return np.empty(0, dtype=np.int64)
        path, state = [head], -1
    ends = np.maximum(start, NONE)
    np.maximum.at(ends, arcs.target, arc)
    while True:
        if state >= 0:
            i, j = int(arcs.source[state]), int(arcs.target[state])
            path.append(j)
            # Either i started afresh, or the best arc into i, given what j then gains.
            value, previous = start[i] + arcs.gain[state], -1
            for q in range(int(arcs.into[i]), int(arcs.into[i + 1])):
                if arc[q] + arcs.gain[state] <= value or arc[q] <= NONE / 2:
                    continue
                h = int(arcs.source[q])
                if windows.group[h] >= 0 and windows.group[h] == windows.group[j]:
                    continue
                third = arc[q] + triple_gain(windows, h, i, j, float(arcs.gain[state]))
                if third > value:
                    value, previous = third, q
            if previous < 0:
                path.append(i)
            state = previous
            if state >= 0:
                continue
        j = path[-1]
        before = needed[needed < j]
        low = int(before[-1]) if before.size else 0
        far = np.flatnonzero(windows.last[low:j] < windows.first[j]) + low
        if not far.size or (ends[far].max() <= 0.0 and not before.size):
            return np.array(path[::-1], dtype=np.int64)
        i = int(far[np.argmax(ends[far])])
        span = slice(int(arcs.into[i]), int(arcs.into[i + 1]))
        if span.stop > span.start and arc[span].max() > start[i]:
            state = int(np.argmax(arc[span])) + span.start
        else:
            path.append(i)
            state = -1


def triple_gain(windows: Windows, h: int, i: int, j: int, pair_gain: float) -> float:
    """Return gain(j | i, h) from gain(j | i), in plain NumPy."""
    rows = [slice(int(windows.indptr[k]), int(windows.indptr[k + 1])) for k in (h, i, j)]
    shared = np.intersect1d(windows.position[rows[0]], windows.position[rows[2]])
    if not shared.size:
        return pair_gain
    blocks = []
    for row in rows:
        at = np.searchsorted(windows.position[row], shared)
        at = np.minimum(at, row.stop - row.start - 1)
        there = windows.position[row][at] == shared
        blocks.append(windows.block[row][at] * there[:, None])
    weight = windows.weight[rows[2]][np.searchsorted(windows.position[rows[2]], shared)]
    H, M, J = blocks

    def log_det(A: FloatArray) -> FloatArray:
        a, c, b = A.T
        return np.asarray(np.log1p(a + b + np.maximum(a * b - c * c, 0.0)))

    change = log_det(H + M + J) + log_det(M) - log_det(H + M) - log_det(M + J)
    return pair_gain + float(np.sum(weight * change))
