"""Which cameras before another see what it or one after it sees, and where their losses lie.

To second order what k gains after i and j depends on i, and there are n³ of them. Cameras before j
that see what j or a camera after it sees are *near*: the losses of cameras *ahead*, k that see what
j or a near one sees, are kept one by one. All others act on one another through the car's state
alone, at `early` before j or at `beyond` behind it (`placement.sieve.told`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import BoolArray, IntArray
from placement.tempered.line import ArcsOut
from placement.tempered.paths import both_ways
from placement.tempered.process import Cameras

STEPS = 1024.0  # losses kept one by one are whole numbers of 1 / STEPS
IMPOSSIBLE = 65_535  # in place of a loss: no placement worth having goes that way
MOST = 65_534
ROUNDING = 1e-6  # what a mutual information may be off


class Neighbours(NamedTuple):
    """The m arcs between n cameras, into each and out of each, and who is near to whom.

    The row of an arc to a camera ahead holds a loss for each near one of its source.
    """

    into: IntArray  # (n + 1,) arcs by target
    source: NDArray[np.int32]  # (m,) in that order
    out_of: IntArray  # (n + 1,) arcs by source
    target: NDArray[np.int32]  # (m,) in that order
    place: NDArray[np.int32]  # (m,) of the arcs by target, where they are by source
    early: IntArray  # (n,) the first sample that j or any camera after it may see
    beyond: IntArray  # (n,) the last sample that j or a near one sees
    near: BoolArray  # (m,) by target: the source is near
    rank: NDArray[np.int32]  # (m,) by target: its number among j's near ones
    many: IntArray  # (n,) how many of those
    ahead: BoolArray  # (m,) by source: the target sees what the source or a near one of it sees
    row_at: IntArray  # (m + 1,) by source, into the losses


def neighbours_of(arcs: ArcsOut, cameras: Cameras) -> Neighbours:
    """Lay out the neighbours of all cameras, along the arcs that are possible."""
    n, m = cameras.first.size, len(arcs.target)
    found = Neighbours(
        *both_ways(arcs, np.int32),
        early=cameras.first.astype(np.int64),  # of the blind the last sample
        beyond=np.empty(n, dtype=np.int64),
        near=np.empty(m, dtype=np.bool_),
        rank=np.zeros(m, dtype=np.int32),
        many=np.zeros(n, dtype=np.int64),
        ahead=np.empty(m, dtype=np.bool_),
        row_at=np.zeros(m + 1, dtype=np.int64),
    )
    _fill(cameras.first, cameras.last, found)
    return found


@njit(cache=True)
def _fill(first, last, found):  # type: ignore[no-untyped-def]
    for j in range(first.size):
        for e in range(found.out_of[j], found.out_of[j + 1]):
            found.early[j] = min(found.early[j], first[found.target[e]])
        far = max(np.int64(last[j]), found.early[j])
        for a in range(found.into[j], found.into[j + 1]):
            ends = last[found.source[a]]
            found.near[a] = ends >= found.early[j]
            if found.near[a]:
                found.rank[a] = found.many[j]
                found.many[j] += 1
                far = max(far, np.int64(ends))
        found.beyond[j] = far
        for e in range(found.out_of[j], found.out_of[j + 1]):
            k = found.target[e]
            found.ahead[e] = last[k] >= 0 and first[k] <= far
            found.row_at[e + 1] = found.row_at[e] + (found.many[j] if found.ahead[e] else 0)


@njit(cache=True)
def rounded_down(information, weight):  # type: ignore[no-untyped-def]
    """Return `weight` times a mutual information as a whole number of steps, no more than it is."""
    if not information > ROUNDING:
        return 0
    return int(min((information - ROUNDING) * weight * STEPS, float(MOST)))
