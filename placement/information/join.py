"""What the same candidates tell about several drives, side by side in one matrix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from placement.information.precompute import Information


def side_by_side(parts: Sequence[Information]) -> Information:
    """Join the samples of `parts`, in their order; all parts have the same candidates and forms.

    Only what one frame alone tells (`blocks`) is kept: white parts and offsets belong to drives.
    """
    if len(parts) == 1:
        return parts[0]
    starts = np.cumsum([0, *(part.n_samples for part in parts)])
    count = np.sum([np.diff(part.indptr) for part in parts], axis=0)
    indptr = np.concatenate(([0], np.cumsum(count)))
    indices = np.empty(indptr[-1], np.int32)
    blocks = np.empty((indptr[-1], parts[0].blocks.shape[1]), np.float32)
    taken = indptr[:-1].copy()
    for start, part in zip(starts[:-1], parts, strict=True):
        rows = np.diff(part.indptr)
        to = np.repeat(taken - part.indptr[:-1], rows) + np.arange(len(part.indices))
        indices[to] = part.indices + start
        blocks[to] = part.blocks
        taken += rows
    return Information(
        n_samples=int(starts[-1]),
        indptr=indptr,
        indices=indices,
        blocks=blocks,
        frames_per_sample=parts[0].frames_per_sample,
    )
