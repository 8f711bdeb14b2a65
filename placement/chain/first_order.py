"""The chain bound to first order: each camera conditioned on the one before it, for all budgets.

For a monotone submodular f and a placement i_1 < … < i_k in any fixed order,

    f(S) = Σ_l f(i_l | i_1 … i_{l−1}) ≤ alone(i_1) + Σ_{l ≥ 2} gain(i_l | i_{l−1}),

the chain rule followed by diminishing returns. Every placement is a path, so the best path of k
nodes bounds every placement of k cameras, whatever order is chosen and however windows overlap.
Leaving constraints out of account (two poses of a mount, not adjacent on the path) only adds
paths. A path may not jump over a required candidate.

F[j, l] is the best path of l nodes that ends in j; B[j, r] what at most r further nodes can add
after j. F and B together bound every placement that holds j: what falls short of the incumbent
can be left out.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.chain.pairs import Arcs
from placement.chain.windows import Windows

NONE = -1e300  # no path


def forward(windows: Windows, arcs: Arcs, budget: int) -> FloatArray:
    """Return F (n, budget + 1); column 0 is no path."""
    values = np.full((len(windows), budget + 1), NONE)
    _forward(
        windows.alone,
        windows.first,
        windows.last,
        windows.mandatory,
        arcs.into,
        arcs.source,
        arcs.gain,
        windows.n_positions,
        values,
    )
    return values


def backward(windows: Windows, arcs: Arcs, budget: int) -> FloatArray:
    """Return B (n, budget + 1)."""
    values = np.full((len(windows), budget + 1), NONE)
    _backward(
        windows.alone,
        windows.first,
        windows.last,
        windows.mandatory,
        arcs.out_of,
        arcs.by_source,
        arcs.target,
        arcs.gain,
        windows.n_positions,
        values,
    )
    return values


def through(F: FloatArray, B: FloatArray) -> FloatArray:
    """Return, for each node (n,), the bound on placements that hold it, within the budget."""
    if not F.size:
        return np.empty(0)
    return np.asarray(np.max(F[:, 1:] + B[:, -2::-1], axis=1))


def decode(windows: Windows, arcs: Arcs, F: FloatArray, budget: int) -> IntArray:
    """Return the nodes of the best path of at most `budget` nodes that passes all required."""
    after = np.flatnonzero(windows.mandatory)
    ends = F.copy()
    if after.size:
        ends[: after[-1]] = NONE
    if not F.size or ends[:, 1 : budget + 1].max(initial=NONE) <= NONE / 2:
        return np.empty(0, dtype=np.int64)
    last, size = np.unravel_index(np.argmax(ends[:, : budget + 1]), ends[:, : budget + 1].shape)
    path = [int(last)]
    while size > 1:
        j = path[-1]
        before = after[after < j]
        low = int(before[-1]) if before.size else 0
        far = np.flatnonzero(windows.last[low:j] < windows.first[j]) + low
        span = slice(arcs.into[j], arcs.into[j + 1])
        near = arcs.source[span]
        options = np.concatenate(
            [F[far, size - 1] + windows.alone[j], F[near, size - 1] + arcs.gain[span]]
        )
        options[np.concatenate([far, near]) < low] = NONE
        path.append(int(np.concatenate([far, near])[np.argmax(options)]))
        size -= 1
    return np.array(path[::-1], dtype=np.int64)


@numba.njit(cache=True)
def _forward(
    alone: FloatArray,
    first: IntArray,
    last: IntArray,
    mandatory: BoolArray,
    into: IntArray,
    source: NDArray[np.int32],
    gain: FloatArray,
    n_positions: int,
    F: FloatArray,
) -> None:
    budget = F.shape[1] - 1
    # clear[p, l]: the best path of l nodes that leaves all from position p on untouched.
    clear = np.full((n_positions + 1, budget + 1), NONE)
    clear[:, 0] = 0.0
    low = 0  # the last required node: nothing may jump over it
    for j in range(len(alone)):
        for size in range(budget):
            F[j, size + 1] = clear[first[j], size] + alone[j]
        for q in range(into[j], into[j + 1]):
            i = source[q]
            if i < low:
                continue
            g = gain[q]
            for size in range(1, budget):
                F[j, size + 1] = max(F[j, size + 1], F[i, size] + g)
        if mandatory[j]:
            clear[:] = NONE
            low = j
        for size in range(1, budget + 1):
            value = F[j, size]
            p = last[j] + 1
            while p <= n_positions and clear[p, size] < value:
                clear[p, size] = value
                p += 1


@numba.njit(cache=True)
def _backward(
    alone: FloatArray,
    first: IntArray,
    last: IntArray,
    mandatory: BoolArray,
    out_of: IntArray,
    by_source: IntArray,
    target: NDArray[np.int32],
    gain: FloatArray,
    n_positions: int,
    B: FloatArray,
) -> None:
    n, budget = len(alone), B.shape[1] - 1
    # clear[p, r]: the best r further nodes whose windows all start after position p.
    clear = np.full((n_positions + 1, budget + 1), NONE)
    clear[:, 0] = 0.0
    high = n
    for j in range(n - 1, -1, -1):
        best = 0.0 if high == n else NONE  # a path may end here unless something is required
        for r in range(budget + 1):
            B[j, r] = best
        for r in range(1, budget + 1):
            B[j, r] = max(B[j, r], clear[last[j], r])
        for k in range(out_of[j], out_of[j + 1]):
            q = by_source[k]
            i = target[q]
            if i > high:
                continue
            g = gain[q]
            for r in range(1, budget + 1):
                B[j, r] = max(B[j, r], g + B[i, r - 1])
        if mandatory[j]:
            clear[:] = NONE
            high = j
        for r in range(1, budget + 1):
            value = alone[j] + B[j, r - 1]
            p = first[j] - 1
            while p >= 0 and clear[p, r] < value:
                clear[p, r] = value
                p -= 1
