"""Cuts mixed at a price: what candidates are worth, who is taken for it, and where mixtures go.

`gains` (nnz, levels) hold g_t(j | R_l) for candidate j of CSR rows and part t of an objective (a
sample, a drive), `mixture` (t, levels) μ, and `sets` (t,) the number of levels beyond the first.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray


@njit(cache=True, error_model="numpy", nogil=True)
def worths(
    indptr: IntArray,
    indices: NDArray[np.int32],
    gains: NDArray[np.floating],
    mixture: FloatArray,
    sets: IntArray,
    worth: FloatArray,
) -> None:
    """Write c_j = Σ_tl μ_tl g_t(j | R_l) of every candidate into `worth` (c,)."""
    for i in range(len(worth)):
        total = 0.0
        for e in range(indptr[i], indptr[i + 1]):
            t = indices[e]
            for level in range(sets[t] + 1):
                total += mixture[t, level] * gains[e, level]
        worth[i] = total


@njit(cache=True, error_model="numpy", nogil=True)
def slopes(
    indptr: IntArray,
    indices: NDArray[np.int32],
    gains: NDArray[np.floating],
    share: FloatArray,
    sets: IntArray,
    slope: FloatArray,
) -> None:
    """Add Σ_j p_j g_t(j | R_l) to `slope` (t, levels), with the candidates' `share` (c,) for p."""
    for i in range(len(share)):
        if share[i] > 1e-12:
            for e in range(indptr[i], indptr[i + 1]):
                t = indices[e]
                for level in range(sets[t] + 1):
                    slope[t, level] += share[i] * gains[e, level]


@njit(cache=True, error_model="numpy", nogil=True)
def shares(
    worth: FloatArray, start: IntArray, price: float, temperature: float, share: FloatArray
) -> None:
    """Write each candidate's share of its mount, exp((c − λ)/τ) against 1 for no camera."""
    for m in range(len(start) - 1):
        most = 0.0
        for i in range(start[m], start[m + 1]):
            most = max(most, (worth[i] - price) / temperature)
        whole = np.exp(-most)
        for i in range(start[m], start[m + 1]):
            share[i] = np.exp((worth[i] - price) / temperature - most)
            whole += share[i]
        for i in range(start[m], start[m + 1]):
            share[i] /= whole
