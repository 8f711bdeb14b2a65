"""Poses that another pose of the same mount makes pointless: dropped before they are stored.

Pose a dominates b on one mount if it tells at least as much about every sample, J_a ⪰ J_b. A mount
holds one camera and poses cost the same, so whatever placement holds b is no worse with a.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import BoolArray, IntArray

_SLACK = 1e-12  # relative: what float64 may lose in a 2×2 determinant of float32 numbers


def undominated(
    mount: IntArray, indptr: IntArray, indices: NDArray[np.int32], blocks: NDArray[np.float32]
) -> BoolArray:
    """Mark candidates (c,) that see something and that no other of their mount dominates.

    `mount` (c,) must rise; the rest are CSR rows as in `Information`. Of equals the first stays.
    """
    keep = np.ones(len(mount), dtype=np.bool_)
    starts = np.flatnonzero(np.diff(mount, prepend=-1))
    _mark(np.append(starts, len(mount)), indptr, indices, blocks, keep)
    return keep


@njit(cache=True, error_model="numpy", nogil=True)
def _mark(
    starts: IntArray,
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    keep: BoolArray,
) -> None:
    for m in range(len(starts) - 1):
        for b in range(starts[m], starts[m + 1]):
            if indptr[b] == indptr[b + 1]:
                keep[b] = False
                continue
            for a in range(starts[m], starts[m + 1]):
                if a != b and keep[a] and _dominates(a, b, indptr, indices, blocks):
                    keep[b] = False
                    break


@njit(cache=True, error_model="numpy", nogil=True)
def _dominates(
    a: int, b: int, indptr: IntArray, indices: NDArray[np.int32], blocks: NDArray[np.float32]
) -> bool:
    begin, end = indptr[a], indptr[a + 1]
    if end - begin < indptr[b + 1] - indptr[b]:
        return False
    if indices[begin] > indices[indptr[b]] or indices[end - 1] < indices[indptr[b + 1] - 1]:
        return False
    i = begin
    for j in range(indptr[b], indptr[b + 1]):
        while i < end and indices[i] < indices[j]:
            i += 1
        if i == end or indices[i] != indices[j]:
            return False
        tt = np.float64(blocks[i, 0]) - np.float64(blocks[j, 0])
        if tt < 0.0:
            return False
        if blocks.shape[1] == 3:
            tn = np.float64(blocks[i, 1]) - np.float64(blocks[j, 1])
            nn = np.float64(blocks[i, 2]) - np.float64(blocks[j, 2])
            if nn < 0.0 or tt * nn * (1.0 - _SLACK) < tn * tn:
                return False
        i += 1
    return True
