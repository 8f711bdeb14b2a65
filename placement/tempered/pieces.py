"""Windows with a gap, as where a closed road is cut: one piece is what others are conditioned on.

A camera at the seam of a lap sees its first metres and its last. Others may be conditioned on
either piece alone, b' of b: conditioning on less is valid. What b itself gains is at most what b'
does, and what the rest adds to b' for a car that nobody else looks at:

    g(b | H) = g(b' | H) + g(b | H, b') − g(b' | H, b') ≤ g(b' | H) + [g(b) − g(b')],

as the information of b is that of b' and some more, which tells the less the more is known. The
bracket, `extra`, is small where b' is the piece that tells more: at a seam the last metres, since
the car knows best where it is when it starts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.geometry import BoolArray, FloatArray
from placement.bounds.restrict import restricted_information
from placement.information import Information
from placement.objectives.navigation_chain import Drive
from placement.tempered.crossings import ROW, alone, cross_each
from placement.tempered.process import Cameras, Process, cameras_of, take_in

# A window keeps its offsets in the state all the way across a gap: those longer than this are cut.
LONGEST = 200
ROUNDING = 1e-8


def pieces_of(drive: Drive) -> tuple[Drive, BoolArray]:
    """Cut windows whose ends lie `LONGEST` samples apart, or more, at their gap.

    What tells more is kept. Return the drive and which cameras (c,) keep all they see.
    """
    info = drive.information
    whole = np.ones(info.n_candidates, dtype=np.bool_)
    gap = np.zeros(info.n_candidates, dtype=np.int64)  # the first entry behind it
    for i in range(info.n_candidates):
        begin, end = int(info.indptr[i]), int(info.indptr[i + 1])
        if end - begin > 1 and int(info.indices[end - 1]) - int(info.indices[begin]) >= LONGEST:
            gap[i] = begin + 1 + int(np.argmax(np.diff(info.indices[begin:end].astype(np.int64))))
            whole[i] = False
    cut = np.flatnonzero(~whole)
    if not cut.size:
        return drive, whole
    early, late = (np.ones(len(info.indices), dtype=np.bool_) for _ in range(2))
    for at in cut:
        early[gap[at] : info.indptr[at + 1]] = False
        late[info.indptr[at] : gap[at]] = False
    plain = take_in(drive.steps(), drive.initial_covariance(), np.zeros((info.n_samples, 3)))
    told = []
    for kept in (early, late):
        part = restricted_information(restricted_entries(info, kept), cut)
        told.append(own_stretch(plain, cameras_of(replace(drive, information=part), 1.0))[1])
    kept = np.ones(len(info.indices), dtype=np.bool_)
    for at, is_late in zip(cut, told[1] >= told[0], strict=True):
        rows = slice(int(info.indptr[at]), int(info.indptr[at + 1]))
        kept[rows] = (late if is_late else early)[rows]
    return replace(drive, information=restricted_entries(info, kept)), whole


def own_stretch(process: Process, cameras: Cameras) -> tuple[FloatArray, FloatArray]:
    """Return what each camera makes of the stretch it sees (c, ROW), and its gain alone (c,)."""
    n = cameras.first.size
    rows, gains = np.empty((n, ROW)), np.zeros(n)
    cross_each(process, cameras, rows)
    alone(process, cameras, rows, gains)
    # nothing is known of what is no number
    return rows, np.where(np.isnan(gains), np.inf, np.maximum(gains, 0.0))


def extra_of(alone: FloatArray, piece: FloatArray, whole: BoolArray) -> FloatArray:
    """Return what the rest of each window adds (c,) to the `piece` (c,) that is kept of it."""
    more = np.maximum(alone - piece, 0.0) + ROUNDING * (1.0 + alone)
    return np.where(whole, 0.0, more)


def restricted_entries(info: Information, kept: BoolArray) -> Information:
    """Return the information in the entries `kept` (nnz,) alone."""
    return replace(
        info,
        indptr=np.concatenate([[0], np.cumsum(kept)])[info.indptr].astype(np.int64),
        indices=info.indices[kept],
        blocks=info.blocks[kept],
        white=None if info.white is None else info.white[kept],
        offsets=None if info.offsets is None else info.offsets[kept],
    )
