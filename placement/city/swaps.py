"""Swap one camera for a better one while that helps: region by region in parallel, then anywhere.

A camera is taken out, and gives way to the candidate that gains most over the others if that is
more than what it gains itself. Upper bounds on gains make that cheap: taking a camera out can raise
only the gains of those that share a sample with it, and these are computed anew; of the rest only
those whose bound beats the best so far are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import sparse

from models.geometry import BoolArray, FloatArray, IntArray
from placement.city.greedy import add_row, gain_of
from placement.city.prices import RegionTask
from placement.cluster import Work

# A swap must gain this share of what it replaces: less is rounding, and could go round in circles.
MARGIN = 1e-9
_PASSES = 20


def swap_cameras(
    task: RegionTask, parts: list[tuple[RegionTask, IntArray]], work: Work
) -> tuple[IntArray, int]:
    """Improve the placement `task.chosen`: return it anew, as rows of `task`, and how many swaps.

    `task` holds all candidates, `parts` the same cut into regions, each with its rows in `task`.
    Cameras stay in their regions while these are worked at, which is done wherever work runs.
    """
    swaps = 0
    chosen = [np.empty(0, dtype=np.int64)] * len(parts)
    for i, (rows, count) in work.run(swap_region, [part for part, _ in parts], "swaps"):
        chosen[i] = parts[i][1][rows]
        swaps += count
    together = np.concatenate(chosen) if chosen else task.chosen
    found, count = swap_region(replace(task, chosen=together))
    return found, swaps + count


def swap_region(
    task: RegionTask,
    fixed: BoolArray | None = None,
    stop: Callable[[], bool] | None = None,
) -> tuple[IntArray, int]:
    """Swap within one task until nothing helps; `fixed` (c,) marks cameras that stay."""
    c = len(task.indptr) - 1
    columns = sparse.csr_array(
        (np.zeros(len(task.indices), np.int8), task.indices, task.indptr),
        shape=(c, len(task.weights)),
    ).tocsc()
    chosen = np.array(task.chosen, dtype=np.int64)
    group = np.repeat(np.arange(len(task.start) - 1), np.diff(task.start))
    state = _start(task, chosen, group)
    swaps = 0
    for _ in range(_PASSES):
        count = _pass(
            group,
            task.indptr,
            task.indices,
            task.blocks,
            task.weights,
            task.scale,
            columns.indptr.astype(np.int64),
            columns.indices.astype(np.int32),
            np.zeros(c, np.bool_) if fixed is None else fixed,
            chosen,
            *state,
        )
        swaps += count
        if not count or (stop is not None and stop()):
            break
    return chosen, swaps


def _start(
    task: RegionTask, chosen: IntArray, group: IntArray
) -> tuple[FloatArray, BoolArray, FloatArray]:
    """Return the samples' sums (t, 3), the groups taken, and upper bounds on all gains (c,)."""
    sums = np.zeros((len(task.weights), 3))
    taken = np.zeros(len(task.start) - 1, dtype=np.bool_)
    for i in chosen:
        add_row(int(i), 1.0, task.indptr, task.indices, task.blocks, sums)
        taken[group[i]] = True
    return sums, taken, np.full(len(group), np.inf)


@njit(cache=True, error_model="numpy", nogil=True)
def _pass(
    group: IntArray,
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    weights: FloatArray,
    scale: float,
    sample_indptr: IntArray,
    sample_rows: NDArray[np.int32],
    fixed: BoolArray,
    chosen: IntArray,
    sums: FloatArray,
    taken: BoolArray,
    upper: FloatArray,
) -> int:
    """Try every camera once; return how many gave way."""
    swaps = 0
    touched = np.full(len(group), -1, dtype=np.int64)
    for n in range(len(chosen)):
        out = chosen[n]
        if fixed[out]:
            continue
        # What rounding this leaves in the sums is far below MARGIN; the value is recomputed.
        add_row(out, -1.0, indptr, indices, blocks, sums)
        taken[group[out]] = False
        for e in range(indptr[out], indptr[out + 1]):
            t = indices[e]
            for f in range(sample_indptr[t], sample_indptr[t + 1]):
                upper[sample_rows[f]] = np.inf
        best, most = out, gain_of(out, indptr, indices, blocks, weights, scale, sums)
        upper[out] = most
        most *= 1.0 + MARGIN
        for j in range(len(group)):
            if upper[j] > most and not taken[group[j]] and touched[j] != n:
                gain = gain_of(j, indptr, indices, blocks, weights, scale, sums)
                upper[j] = gain
                touched[j] = n
                if gain > most:
                    best, most = j, gain
        swaps += best != out
        chosen[n] = best
        taken[group[best]] = True
        add_row(best, 1.0, indptr, indices, blocks, sums)
    return swaps
