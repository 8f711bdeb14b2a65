"""Cameras that see the road twice, cut into pieces that share their price.

Where a road comes back on itself, or closes, a camera sees two stretches of it with a long
blindness between. As one view that would span all the road between, and what happens there could
not be told apart. A *piece* is one stretch with a share of the price. Whoever has the camera has
all its pieces for the same price, so what holds for buyers of pieces holds for buyers of cameras,
whatever the shares. They go by how much a piece tells, with diminishing returns.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np

from models.geometry import BoolArray, FloatArray, IntArray
from placement.diagram.moves import three_columns
from placement.objectives.navigation import WhiteDrive

PARTS = 2  # units that a unit is cut into where cameras are
MOST_LEVELS = 200  # units that the dearest camera may cost


@dataclass(frozen=True, slots=True)
class Pieces:
    """Hold a drive whose candidates are pieces (p,) of cameras.

    owner (p,): whose it is. single (p,): whether it is all that its camera sees. units (p,): its
    share of the price, `per_unit` to a unit of before; what got no share is not usable, and is
    given to everybody: blocks `given` (t, 3). worthiest (p,): each camera's piece that tells most.
    """

    drive: WhiteDrive
    usable: BoolArray
    owner: IntArray
    single: BoolArray
    units: IntArray
    per_unit: int
    given: FloatArray
    worthiest: BoolArray

    def settled(self) -> BoolArray:
        """Return for each sample (t + 1,) whether no camera has a piece before it and one after.

        A placement's price of pieces is whole there: each of its cameras has been paid for, or not.
        """
        n = self.drive.n_samples
        part = np.flatnonzero(self.usable & ~self.single)
        begin = self.drive.indices[self.drive.indptr[part]].astype(np.int64)
        first = np.full(int(self.owner.max(initial=0)) + 1, n, dtype=np.int64)
        last = np.zeros_like(first)
        np.minimum.at(first, self.owner[part], begin)
        np.maximum.at(last, self.owner[part], begin)
        change = np.zeros(n + 2, dtype=np.int64)
        np.add.at(change, np.minimum(first, last) + 1, 1)
        np.add.at(change, last + 1, -1)
        opened: BoolArray = np.cumsum(change[: n + 1]) > 0
        return ~opened


def in_pieces(drive: WhiteDrive, usable: BoolArray, units: IntArray, enough: float) -> Pieces:
    """Cut the `usable` (c,) cameras of prices `units` (c,) where they are blind for long.

    That is for longer than the view of most. Where it is half the drive, as for cameras at the seam
    of a lap, the piece that tells most has all of the price: prices would be open for the lap else,
    and dear to follow. `enough` is the information that keeps the tolerance
    by itself: a piece that tells J weighs log(1 + J / enough).
    """
    row = np.repeat(np.arange(drive.indptr.size - 1), np.diff(drive.indptr))
    seen = drive.indices.astype(np.int64)
    count = np.diff(drive.indptr)
    seeing = usable & (count > 0)
    longest = float(np.median(count[seeing])) if seeing.any() else np.inf
    start = np.ones(row.size, dtype=np.bool_)
    same = row[1:] == row[:-1]
    gap = np.where(same, np.diff(seen), 0)
    start[1:] = ~same | (gap > longest)
    begin = np.flatnonzero(start)
    owner = row[begin]
    part = copy.copy(drive)
    part.indptr = np.append(begin, row.size).astype(np.int64)
    blocks = three_columns(drive)
    told = np.add.reduceat(blocks[:, 0] + blocks[:, 2], begin) if begin.size else np.zeros(0)
    single = np.bincount(owner, minlength=units.size)[owner] == 1
    lap = np.zeros(units.size, dtype=np.bool_)
    lap[row[1:][gap > drive.n_samples // 2]] = True
    room = int(units[usable].max(initial=1)) * PARTS <= MOST_LEVELS
    per_unit = PARTS if room and (usable[owner] & ~single & ~lap[owner]).any() else 1
    weight = np.log1p(told / enough)
    share = shares(weight, owner, units * per_unit, lap)
    given = np.zeros((drive.n_samples, 3))
    free = (usable[owner] & (share == 0))[np.cumsum(start) - 1]
    np.add.at(given, seen[free], blocks[free])
    usable = usable[owner] & (share > 0)
    return Pieces(part, usable, owner, single, share, per_unit, given, worthiest(weight, owner))


def worthiest(worth: FloatArray, owner: IntArray) -> BoolArray:
    """Return for each piece (p,) whether it is the worthiest of its owner's."""
    order = np.lexsort((worth, owner))
    out = np.zeros(owner.size, dtype=np.bool_)
    out[order] = np.append(owner[order][1:] != owner[order][:-1], True)[: order.size]
    return out


def shares(worth: FloatArray, owner: IntArray, units: IntArray, lap: BoolArray) -> IntArray:
    """Share each owner's units (c,) among its pieces (p,), at least one each.

    By worth, rounded down, and the rest to the worthiest; all to that one where they do not
    suffice for one each, or where `lap` (c,) says so.
    """
    total = np.bincount(owner, worth, units.size)[owner]
    price = units[owner]
    share = np.maximum(1, (worth / np.maximum(total, 1e-300) * price).astype(np.int64))
    best = worthiest(worth, owner)
    others = np.bincount(owner, np.where(best, 0, share), units.size).astype(np.int64)[owner]
    share = np.where(best, price - others, share)
    short = (others >= price) | lap[owner]
    return np.where(short, np.where(best, price, 0), share)
