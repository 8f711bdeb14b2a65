"""What a camera's gain loses to the one before last.

To second order g(k | i, j) = g(k | j) − I(z_k; z_i | z_j): the *loss* is mutual information given
the camera in between. Where the state at some sample parts i from k, six numbers of either give it
(`placement.sieve.told`); else it is that of features (`placement.sieve.features`), given all of
z_j: by data processing no more than the true one. A camera that is blind to one axis at some sample
has no features: nobody loses to it, nor after it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from models.geometry import FloatArray
from placement.branch.small import inverse_factor
from placement.sieve.ahead import fill_ahead
from placement.sieve.features import RANK, factor, measured
from placement.sieve.given import camera_given, state_given
from placement.sieve.told import roots_of, tell_beyond, tell_from_afar, tell_from_near


class Known(NamedTuple):
    """What first-order paths at a price bring: into each camera (n,), beyond it, and are worth.

    Two arcs whose best path falls short of `need` lose everything.
    """

    price: float
    into: FloatArray
    beyond: FloatArray
    need: float


@njit(cache=True, parallel=True)
def fill_losses(  # type: ignore[no-untyped-def]
    process, cameras, rows, kind, weight, gain, near, features, meeting, known, nodes,
    told, losses,
):  # fmt: skip
    """Fill what is told around each j in `nodes`, and the rows of `losses` of the arcs out of it.

    `gain` (m,) are the first-order gains by source, `rows` as in
    `placement.tempered.gains`, `kind` (n,) the group that may have one
    camera, −1 for none.
    """
    for number in prange(nodes.size):
        j = nodes[number]
        if near.out_of[j] < near.out_of[j + 1]:
            _fill_around(
                j, process, cameras, rows, kind, weight, gain, near, features, meeting,
                known, told, losses,
            )  # fmt: skip


@njit(cache=True)
def _fill_around(  # type: ignore[no-untyped-def]
    j, process, cameras, rows, kind, weight, gain, near, features, meeting, known, told,
    losses,
):  # fmt: skip
    if cameras.last[j] >= 0 and not features.usable[j]:
        return  # nobody can be given it
    early, beyond = near.early[j], near.beyond[j]
    # all of z_j, by a Cholesky factor of its covariance
    size = 0
    if cameras.last[j] >= 0:
        size = 2 * (cameras.indptr[j + 1] - cameras.indptr[j])
    root, noise = np.empty((size, size)), np.empty((size, size))
    if size:
        measured(process, cameras, j, root, noise)
        root += noise
        factor(root, size)
    start, stop = np.empty((3, size)), np.empty((3, size))
    state_given(process, cameras, j, early, root, start)
    state_given(process, cameras, j, beyond, root, stop)
    at_early, at_beyond = np.empty((3, 3)), np.empty((3, 3))
    parted = roots_of(process, early, beyond, start, stop, at_early, at_beyond, told.link[j])
    # each near camera, given z_j: rows of B and the inverse of a factor of its covariance; 0 rows
    # are `used` where nothing is known
    n_near = near.many[j]
    before = np.zeros((n_near, RANK, size)), np.zeros((n_near, RANK, RANK))
    used, camera = np.zeros(n_near, np.int64), np.full(n_near, -1)
    reached = np.empty(n_near)  # what paths bring through each of them to j
    for a in range(near.into[j], near.into[j + 1]):
        if near.near[a]:
            c, i = near.rank[a], near.source[a]
            camera[c] = i
            reached[c] = known.into[i] + np.float64(gain[near.place[a]]) - 2.0 * known.price
            b, inverse = before[0][c], before[1][c]
            if camera_given(cameras, i, j, features, root, b, inverse) and inverse_factor(
                inverse, inverse
            ):
                # of features, whose noise alone has covariance I
                used[c] = RANK if np.diag(inverse).max() <= 1.0 + 1e-6 else 0
    if parted:
        tell_from_afar(j, process, cameras, rows, near, at_early, told)
        tell_from_near(j, features, near, at_beyond, stop, before, used, told)
        tell_beyond(j, process, cameras, rows, near, at_beyond, told)
    fill_ahead(
        j, cameras, kind, weight, gain, near, features, meeting, known, root,
        parted, at_early, start, before, used, camera, reached, told, losses,
    )  # fmt: skip
