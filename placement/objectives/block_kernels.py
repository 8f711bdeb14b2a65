"""Numba loops over the blocks of `Information`: sums per sample, log det gains and slopes.

A block is (J_tt, J_tn, J_nn) = (a, c, b) in 1/m², stored in float32 as three numbers or, where
isotropic, as one; everything is summed in float64. `scale` is the prior variance s in m², so that
log det(I + sA) = log1p(sa + sb + s²(ab − c²)): no cancellation for the smallest A, and the
product ab − c², which rounding alone can make negative, is kept from it.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray


@numba.njit(cache=True, inline="always")
def block_of(blocks: NDArray[np.float32], e: int) -> tuple[float, float, float]:
    """Return entry e as (J_tt, J_tn, J_nn) in float64, whether stored as one number or three."""
    a = np.float64(blocks[e, 0])
    if blocks.shape[1] == 1:
        return a, 0.0, a
    return a, np.float64(blocks[e, 1]), np.float64(blocks[e, 2])


@numba.njit(cache=True, inline="always")
def log_det_ratio(
    a: float, c: float, b: float, j_a: float, j_c: float, j_b: float, scale: float
) -> float:
    """Return log det(I + s(A + J)) − log det(I + sA), exact to rounding for small J, too."""
    a, c, b = scale * a, scale * c, scale * b
    j_a, j_c, j_b = scale * j_a, scale * j_c, scale * j_b
    det = 1.0 + a + b + max(a * b - c * c, 0.0)
    rise = j_a * (1.0 + b) + j_b * (1.0 + a) - 2.0 * j_c * c + max(j_a * j_b - j_c * j_c, 0.0)
    return float(np.log1p(max(rise, 0.0) / det))


@numba.njit(cache=True)
def candidate_gains(
    rows: IntArray,
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    weights: FloatArray,
    scale: float,
    sums: FloatArray,
    gains: FloatArray,
) -> None:
    """Write the gains of the candidates `rows` into `gains` (c,)."""
    for r in range(len(rows)):
        i = rows[r]
        total = 0.0
        for e in range(indptr[i], indptr[i + 1]):
            t = indices[e]
            j_a, j_c, j_b = block_of(blocks, e)
            total += weights[t] * log_det_ratio(
                sums[t, 0], sums[t, 1], sums[t, 2], j_a, j_c, j_b, scale
            )
        gains[i] = total


@numba.njit(cache=True)
def entry_gains(
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    weights: FloatArray,
    scale: float,
    sums: FloatArray,
    out: FloatArray,
) -> None:
    """Write each entry's gain, as `candidate_gains` before summing."""
    for e in range(len(indices)):
        t = indices[e]
        j_a, j_c, j_b = block_of(blocks, e)
        out[e] = weights[t] * log_det_ratio(
            sums[t, 0], sums[t, 1], sums[t, 2], j_a, j_c, j_b, scale
        )


@numba.njit(cache=True)
def entry_slopes(
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    weights: FloatArray,
    scale: float,
    sums: FloatArray,
    out: FloatArray,
) -> None:
    """Write w_t tr((I + sA_t)⁻¹ sJ) of each entry."""
    for e in range(len(indices)):
        t = indices[e]
        a, c, b = scale * sums[t, 0], scale * sums[t, 1], scale * sums[t, 2]
        det = a + b + max(a * b - c * c, 0.0) + 1.0
        j_a, j_c, j_b = block_of(blocks, e)
        rise = j_a * (1.0 + b) + j_b * (1.0 + a) - 2.0 * j_c * c
        out[e] = weights[t] * scale * rise / det


@numba.njit(cache=True)
def row_sums(indptr: IntArray, entries: FloatArray, out: FloatArray) -> None:
    """Sum the entries of each candidate's row into `out` (c,)."""
    for i in range(len(out)):
        total = 0.0
        for e in range(indptr[i], indptr[i + 1]):
            total += entries[e]
        out[i] = total


@numba.njit(cache=True)
def weighted_sums(
    x: FloatArray,
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    sums: FloatArray,
) -> None:
    """Add Σ_i x_i J_it to `sums` (t, 3)."""
    for i in range(len(x)):
        if x[i] == 0.0:
            continue
        for e in range(indptr[i], indptr[i + 1]):
            t = indices[e]
            a, c, b = block_of(blocks, e)
            sums[t, 0] += x[i] * a
            sums[t, 1] += x[i] * c
            sums[t, 2] += x[i] * b


@numba.njit(cache=True)
def add_rows(
    rows: IntArray,
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    touched: BoolArray,
    sums: FloatArray,
) -> None:
    """Add the blocks of `rows` to the sums of the `touched` samples, in the rows' order."""
    for r in range(len(rows)):
        i = rows[r]
        for e in range(indptr[i], indptr[i + 1]):
            t = indices[e]
            if touched[t]:
                a, c, b = block_of(blocks, e)
                sums[t, 0] += a
                sums[t, 1] += c
                sums[t, 2] += b


@numba.njit(cache=True)
def mark_seeing(
    samples: NDArray[np.int32],
    sample_indptr: IntArray,
    sample_candidates: NDArray[np.int32],
    stale: BoolArray,
) -> None:
    """Mark every candidate that sees one of `samples`."""
    for s in range(len(samples)):
        t = samples[s]
        for e in range(sample_indptr[t], sample_indptr[t + 1]):
            stale[sample_candidates[e]] = True
