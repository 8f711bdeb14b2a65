"""How the cameras before each camera are told apart, as far as it matters to those after it.

To second order what k gains after i and j depends on i, and there are n³ of them. Cameras before j
that see what j or a camera after it sees are *near*, and for k near them stand for themselves.
Others act on what follows through the car's covariance alone, and share classes: far ones by that
covariance where the next camera may begin (`placement.sieve.far`), and all of them, for k beyond
what j and its near ones see, by the covariance there (`placement.sieve.beyond`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import BoolArray, IntArray
from placement.tempered.paths import Arcs
from placement.tempered.process import Cameras

BEYOND = 8  # classes by covariance behind a camera
STEPS = 1024.0  # losses are whole numbers of 1 / STEPS
IMPOSSIBLE = 65_535  # in place of a loss: no placement worth having goes that way
EMPTY = -1.0  # in place of a variance: nobody is in a class
MOST = 65_534
ROUNDING = 1e-6  # what a mutual information may be off


class Classes(NamedTuple):
    """Classes of the cameras before each of n, and where the losses of its m arcs out lie.

    Class 0 knows nothing, 1 … n_far are far; the row of an arc to a near camera goes on with each
    of j's near ones, that of another with their n_beyond classes.
    """

    n_far: int
    n_beyond: int
    into: IntArray  # (n + 1,) arcs by target
    source: IntArray  # (m,) in that order
    out_of: IntArray  # (n + 1,) arcs by source
    target: IntArray  # (m,) in that order
    place: IntArray  # (m,) of the arcs by target, where they are by source
    early: IntArray  # (n,) the first sample that j or any camera after it may see
    beyond: IntArray  # (n,) the last sample that j or a near one sees
    near: BoolArray  # (m,) by target: the source is near
    rank: IntArray  # (m,) by target: its number among j's near ones
    many: IntArray  # (n,) how many of those
    group: NDArray[np.uint8]  # (m,) by target: the class for all that is beyond
    extra: NDArray[np.float32]  # (m,) by target: what it pays to pass for that class
    ahead: BoolArray  # (m,) by source: the target is near
    row_at: IntArray  # (m + 1,) by source, into the losses


def classes_of(arcs: Arcs, cameras: Cameras, n_far: int, n_beyond: int = BEYOND) -> Classes:
    """Lay out the classes of all cameras; `group` is filled by `fill_losses`."""
    n = cameras.first.size
    first, last = cameras.first, cameras.last
    target = np.ascontiguousarray(arcs.target[arcs.out])
    source = arcs.source[arcs.out]
    place = np.empty(len(arcs.out), dtype=np.int64)
    place[arcs.out] = np.arange(len(arcs.out))
    early = first.astype(np.int64)  # of the blind the last sample
    np.minimum.at(early, source, first[target])
    near = last[arcs.source] >= early[arcs.target]
    many = np.bincount(arcs.target[near], minlength=n)
    rank = np.cumsum(near) - 1
    rank -= np.repeat(np.concatenate([[0], np.cumsum(many)[:-1]]), np.diff(arcs.into))
    beyond = np.maximum(last, early)
    np.maximum.at(beyond, arcs.target[near], last[arcs.source[near]])
    ahead = (last[target] >= 0) & (first[target] <= beyond[source])
    width = np.where(ahead, 1 + n_far + many[source], 1 + n_far + n_beyond)
    row_at = np.concatenate([[0], np.cumsum(width)]).astype(np.int64)
    return Classes(
        n_far,
        n_beyond,
        arcs.into,
        arcs.source,
        arcs.out_of,
        target,
        place,
        early,
        beyond.astype(np.int64),
        near,
        rank.astype(np.int64),
        many.astype(np.int64),
        np.zeros(len(target), dtype=np.uint8),
        np.zeros(len(target), dtype=np.float32),
        ahead,
        row_at,
    )


@njit(cache=True)
def rounded_down(loss):  # type: ignore[no-untyped-def]
    """Return a loss as a whole number of steps, no more than it is."""
    if not loss > ROUNDING:
        return 0
    return min(int((loss - ROUNDING) * STEPS), MOST)
