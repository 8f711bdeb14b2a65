"""What the same candidates tell about several drives: one matrix, or one for each."""

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


def split_samples(
    whole: Information, counts: Sequence[int], frames: Sequence[float]
) -> list[Information]:
    """Cut the samples of `whole` into runs of `counts`, each with its own frames per sample.

    One walk over all samples costs far less than one for each drive, for a candidate that sees
    nothing of a drive costs something each time; the numbers are the same to the bit.
    """
    bounds = np.concatenate(([0], np.cumsum(counts)))
    if bounds[-1] != whole.n_samples:
        raise ValueError(f"counts must add up to {whole.n_samples} samples, got {bounds[-1]}")
    owner = (np.searchsorted(bounds, whole.indices, side="right") - 1).astype(np.int32)
    row = np.repeat(np.arange(whole.n_candidates, dtype=np.int32), np.diff(whole.indptr))
    order = np.argsort(owner, kind="stable")  # rows stay in order, and samples within a row
    ends = np.searchsorted(owner[order], np.arange(len(counts) + 1))
    parts = []
    for k, per_sample in enumerate(frames):
        chosen = order[ends[k] : ends[k + 1]]
        many = np.bincount(row[chosen], minlength=whole.n_candidates)
        parts.append(
            Information(
                n_samples=int(counts[k]),
                indptr=np.concatenate(([0], np.cumsum(many))).astype(np.int64),
                indices=(whole.indices[chosen] - bounds[k]).astype(np.int32),
                blocks=whole.blocks[chosen],
                white=None if whole.white is None else whole.white[chosen],
                offsets=None if whole.offsets is None else whole.offsets[chosen],
                frames_per_sample=per_sample,
            )
        )
    return parts
