"""A drive laid out for the sweep: the cameras that matter, sorted, and priced in whole units."""

from __future__ import annotations

import numpy as np

from models.geometry import BoolArray, FloatArray, IntArray
from placement.diagram.moves import TWINS, floor_information, three_columns, undominated
from placement.fewest.arrays import KEY_BITS, MOST_UNITS, Course
from placement.fewest.crowds import join_of_all
from placement.fewest.pieces import MOST_LEVELS, in_pieces
from placement.fewest.seconds import seconds_of
from placement.objectives.navigation import WhiteDrive
from placement.objectives.windows.filter import empty_messages, filter_forward
from placement.objectives.windows.offsets import Views

ROUNDING = 1e-9  # relative, of the limit


def whole_units(cost: FloatArray, usable: BoolArray) -> tuple[IntArray, float]:
    """Return prices (c,) in whole units, rounded down, and the unit.

    The unit is the cheapest positive price over the least whole number for which every price is
    a multiple, if there is one that leaves the dearest at `MOST_LEVELS` or less.
    """
    priced = cost[usable & (cost > 0.0)]
    if not priced.size:
        return np.zeros(cost.size, dtype=np.int64), 1.0
    low, high = float(priced.min()), float(priced.max())
    unit = max(low, high / MOST_LEVELS)
    for parts in range(1, 21):
        trial = low / parts
        if high / trial > MOST_LEVELS:
            break
        share = np.unique(priced) / trial
        if np.all(np.abs(share - np.round(share)) <= 1e-9 * share):
            unit = trial
            break
    units = np.floor(cost / unit * (1.0 + 1e-9) + 1e-12).astype(np.int64)
    return units, unit


def course_of(
    drive: WhiteDrive,
    limit: float,
    usable: BoolArray,
    given: IntArray,
    units: IntArray,
    most: int,
    failures: int,
    views: Views | None,
    group: IntArray | None = None,
) -> Course:
    """Lay out the drive and the cameras that none of the same price or cheaper exceeds.

    group (c,) says which candidates exclude each other, by equal numbers of 0 or more.

    With persistent errors all that see something stay: offsets are not compared, and those of
    cameras in pieces are known: what is true of one piece by itself is not true of both.
    """
    views_of = drive
    pieces = in_pieces(drive, usable, units, 1.0 / limit)
    price = units[pieces.owner] * pieces.per_unit
    drive, usable, units = pieces.drive, pieces.usable, pieces.units
    blocks = three_columns(drive)
    kept = []
    if views is not None:
        kept.append(np.flatnonzero(usable))
    for level in np.unique(units[usable]) if views is None else []:
        best = undominated(drive.indptr, drive.indices, blocks, usable & (units <= level))
        kept.append(best[units[best] == level])
    who = np.concatenate(kept) if kept else np.empty(0, dtype=np.int64)
    if 2 * who.size >= 2**KEY_BITS - 1:
        raise ValueError(
            f"method tolerance needs fewer than {2 ** (KEY_BITS - 1) - 1:,} useful candidates, "
            f"got {who.size:,}: coarsen mounts or poses"
        )
    first = drive.indices[drive.indptr[who]].astype(np.int64)
    order = np.argsort(first, kind="stable")
    who, first = who[order], first[order]
    last = drive.indices[drive.indptr[who + 1] - 1].astype(np.int64)
    ptr = np.concatenate(([0], np.cumsum(last - first + 1))).astype(np.int64)
    dense = np.zeros((int(ptr[-1]), 3))
    for v, i in enumerate(who):
        row = slice(drive.indptr[i], drive.indptr[i + 1])
        dense[ptr[v] + drive.indices[row] - first[v]] = (1.0 + TWINS) * blocks[row]
    at = np.searchsorted(first, np.arange(drive.n_samples + 1)).astype(np.int64)
    greatest = np.empty((drive.n_samples, 3))
    join_of_all(at, ptr, dense, greatest)
    plain = views_of.total(given)
    # a mount's cameras exclude each other, but not the pieces of one of them
    group = np.full(pieces.usable.size, -1) if group is None else group[pieces.owner]
    lonely = np.where(pieces.single, group, -1)
    left = np.setdiff1d(np.flatnonzero(usable & (np.diff(drive.indptr) > 0)), who)
    laid_out = (ptr, dense, first, who, at)
    second, stand_in = seconds_of(
        drive.indptr, drive.indices, blocks, left, lonely, units, laid_out
    )
    names = np.concatenate([who, stand_in])
    base = plain + pieces.given
    floor = base + (1.0 + 1e-9) * floor_information(drive, usable, max(most, 1))
    before, after, logs = empty_messages(drive.n_samples)
    filter_forward(drive.steps, drive.p0, floor, before, after, logs)
    return Course(
        steps=drive.steps,
        p0=drive.p0,
        base=base,
        ptr=ptr,
        blocks=dense,
        best=greatest,
        second=second,
        twice=np.array(
            [second[ptr[v] : ptr[v + 1]].any() for v in range(who.size)], dtype=np.bool_
        ),
        at=at,
        first=first,
        units=units[who],
        per_unit=pieces.per_unit,
        settled=pieces.settled(),
        floor=before * (1.0 - 1e-12),
        limit=limit * (1.0 + ROUNDING),
        failures=int(failures),  # a bool would have every kernel compiled again
        owner=pieces.owner[names],
        group=group[names],
        whole=np.where(pieces.worthiest[who], price[who], MOST_UNITS),
        plain=plain,
        who=np.where(pieces.single[who], pieces.owner[who], -1),
        indptr=views_of.indptr,
        indices=views_of.indices,
        white=np.empty((0, 3), dtype=np.float32) if views is None else views.white,
        offsets=np.empty((0, 2, 0), dtype=np.float32) if views is None else views.offsets,
        frames=drive.frames,
    )


def spans(course: Course) -> tuple[IntArray, IntArray]:
    """Return the first and last sample (v,) of each camera."""
    return course.first, course.first + np.diff(course.ptr) - 1
