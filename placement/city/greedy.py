"""Lazy greedy on CSR rows: a heap of upper bounds on gains, for a million poses and more.

    f(S) = Σ_t w_t log det(I + s Σ_{i ∈ S} J_it)

A gain from a smaller placement bounds it from above (Minoux 1978), so only what is at the heap's
top is computed again: some dozens of rows a camera, whatever the number of candidates. Within
1 − 1/e of the best under a count, 1/2 with one pose a mount (Nemhauser, Wolsey & Fisher 1978).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.objectives.block_kernels import block_of, log_det_ratio


@njit(cache=True, error_model="numpy", nogil=True)
def gain_of(
    i: int,
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    weights: FloatArray,
    scale: float,
    sums: FloatArray,
) -> float:
    """Return the gain of candidate i over the information `sums` (t, 3) of every sample."""
    total = 0.0
    for e in range(indptr[i], indptr[i + 1]):
        t = indices[e]
        a, c, b = block_of(blocks, e)
        total += weights[t] * log_det_ratio(sums[t, 0], sums[t, 1], sums[t, 2], a, c, b, scale)
    return total


@njit(cache=True, error_model="numpy", nogil=True)
def add_row(
    i: int,
    sign: float,
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    sums: FloatArray,
) -> None:
    """Add (sign 1) candidate i's blocks to `sums` (t, 3), or take them away (−1)."""
    for e in range(indptr[i], indptr[i + 1]):
        t = indices[e]
        a, c, b = block_of(blocks, e)
        sums[t, 0] += sign * a
        sums[t, 1] += sign * c
        sums[t, 2] += sign * b


@njit(cache=True, error_model="numpy", nogil=True)
def first_gains(
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    weights: FloatArray,
    scale: float,
    sums: FloatArray,
    begin: int,
    end: int,
    out: FloatArray,
) -> None:
    """Write the gains of candidates begin … end − 1 over `sums` into `out` (c,)."""
    for i in range(begin, end):
        out[i] = gain_of(i, indptr, indices, blocks, weights, scale, sums)


@njit(cache=True, error_model="numpy", nogil=True)
def lazy_greedy(
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    weights: FloatArray,
    scale: float,
    group: IntArray,
    allowed: BoolArray,
    taken: BoolArray,
    budget: int,
    price: float,
    sums: FloatArray,
    upper: FloatArray,
    chosen: IntArray,
    gains: FloatArray,
) -> tuple[int, int]:
    """Add the best candidate of a free group until `budget` are added or none gains over `price`.

    `upper` (c,) bounds every gain over `sums` and is lowered on the way; `sums` (t, 3) and `taken`
    (groups,) are those of what is placed already, and kept up to date. Ties go to the lower index.
    Writes `chosen` and their `gains` (budget,); returns how many, and how many rows were computed.
    """
    heap = np.empty(len(upper), dtype=np.int64)
    root: Any = np.int64(0)  # a plain 0 has `_sift` compiled for that number alone
    n: Any = np.int64(0)
    for i in range(len(upper)):
        if allowed[i] and not taken[group[i]] and upper[i] > price:
            heap[n] = i
            n += 1
    for at in range(n // 2 - 1, -1, -1):
        _sift(heap, n, at, upper)
    added = computed = 0
    fresh = np.full(len(upper), -1, dtype=np.int32)
    while n > 0 and added < budget:
        i = heap[0]
        if taken[group[i]] or upper[i] <= price:
            n -= 1
            heap[0] = heap[n]
            _sift(heap, n, root, upper)
            continue
        if fresh[i] != added:
            upper[i] = min(upper[i], gain_of(i, indptr, indices, blocks, weights, scale, sums))
            fresh[i] = added
            computed += 1
            _sift(heap, n, root, upper)
            continue
        chosen[added], gains[added] = i, upper[i]
        added += 1
        taken[group[i]] = True
        add_row(i, 1.0, indptr, indices, blocks, sums)
    return added, computed


@njit(cache=True, error_model="numpy", nogil=True)
def _sift(heap: IntArray, n: int, at: int, upper: FloatArray) -> None:
    """Let the candidate at `at` sink until none below it is better."""
    while True:
        best = at
        for child in (2 * at + 1, 2 * at + 2):
            if child < n and (
                upper[heap[child]] > upper[heap[best]]
                or (upper[heap[child]] == upper[heap[best]] and heap[child] < heap[best])
            ):
                best = child
        if best == at:
            return
        heap[at], heap[best] = heap[best], heap[at]
        at = best


@njit(cache=True, error_model="numpy", nogil=True)
def stochastic_greedy(
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    weights: FloatArray,
    scale: float,
    group: IntArray,
    taken: BoolArray,
    budget: int,
    sample: int,
    rng: np.random.Generator,
    sums: FloatArray,
    chosen: IntArray,
    gains: FloatArray,
) -> int:
    """Add the best of `sample` candidates drawn at random, `budget` times; return how many.

    With a sample of (c/k) log(1/ε), the expected value is within 1 − 1/e − ε of the best under a
    count (Mirzasoleiman et al. 2015); with one pose a mount nothing of the kind is proven.
    """
    added = 0
    for _ in range(budget):
        best, best_gain = np.int64(-1), 0.0
        for _ in range(sample):
            i = rng.integers(0, len(group))
            if taken[group[i]]:
                continue
            gain = gain_of(int(i), indptr, indices, blocks, weights, scale, sums)
            if gain > best_gain or (gain == best_gain and 0 <= i < best):
                best, best_gain = i, gain
        if best >= 0:
            chosen[added], gains[added] = best, best_gain
            added += 1
            taken[group[best]] = True
            add_row(int(best), 1.0, indptr, indices, blocks, sums)
    return added
