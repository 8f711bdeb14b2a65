"""What a camera's gain loses to the one before last, for classes of those.

To second order g(k | i, j) = g(k | j) − I(z_k; z_i | z_j): the *loss* is mutual information given
the camera in between. There are n³ of them, so cameras i before j are told apart as far as it
matters. Those that see what j or a camera after it sees are *near*, and for k near them stand for
themselves. Others act on what follows through the car's covariance alone, where the next camera may
begin (far ones), or behind the last sample that j or a near one sees (all of them, for k beyond
it), and pass for one of a few *anchors* among them, for which they pay (`placement.sieve.anchors`).

Mutual information is that of features (`placement.sieve.features`), given all of z_j: by data
processing it is no more than the true one. An anchor's covariance counts as a measurement of the
state at that sample. All losses are rounded down to multiples of 1 / `STEPS`. A camera that is
blind to one axis at some sample has no features: nobody loses to it, nor after it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from models.geometry import FloatArray
from placement.branch.small import inverse_factor
from placement.objectives.windows.filter import row6
from placement.sieve.ahead import fill_ahead
from placement.sieve.beyond import fill_beyond
from placement.sieve.classes import EMPTY
from placement.sieve.far import far_classes
from placement.sieve.features import RANK, factor, measured
from placement.sieve.given import as_measurement, camera_given, class_given, state_given


class Known(NamedTuple):
    """What first-order paths at a price bring: into each camera (n,), beyond it, and are worth.

    Two arcs whose best path falls short of `need` lose everything; `spare` is what paths may waste.
    """

    price: float
    into: FloatArray
    beyond: FloatArray
    need: float
    spare: float


@njit(cache=True, parallel=True)
def fill_losses(  # type: ignore[no-untyped-def]
    process, cameras, rows, whole, kind, weight, pairs, classes, features, meeting, known, nodes,
    losses,
):  # fmt: skip
    """Fill the rows of `losses` of the arcs out of each j in `nodes`.

    `rows` and `whole` are as in `placement.tempered.gains`, `kind` (n,) the group that may have one
    camera, −1 for none. Cameras that are not `whole` lose nothing.
    """
    for number in prange(nodes.size):
        j = nodes[number]
        begin, end = classes.out_of[j], classes.out_of[j + 1]
        if begin == end:
            continue
        _losses_after(
            j, process, cameras, rows, whole, kind, weight, pairs, classes, features, meeting,
            known, losses,
        )  # fmt: skip


@njit(cache=True)
def _losses_after(  # type: ignore[no-untyped-def]
    j, process, cameras, rows, whole, kind, weight, pairs, classes, features, meeting, known,
    losses,
):  # fmt: skip
    if cameras.last[j] >= 0 and not features.usable[j]:
        return  # nobody can be given it: losses and classes stay 0
    n_near, n_far = classes.many[j], classes.n_far
    early, beyond = classes.early[j], classes.beyond[j]
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
    # the classes far away, as measurements of the state at `early`
    far = np.full((n_far, 6), EMPTY)
    far_classes(j, process, cameras, rows, weight, pairs, classes, known, start, far)
    # what each class and each near camera is, given z_j: rows of B and the inverse of a factor of
    # its covariance; `used` rows, 0 where nothing is known, −1 where there is no such class
    n_before = n_far + n_near
    before = np.zeros((n_before, RANK, size)), np.zeros((n_before, RANK, RANK))
    used = np.full(n_before, -1)
    root_of = np.zeros((n_far, 3, 3))  # of the information that a class adds about the state
    camera = np.full(n_before, -1)
    for c in range(n_far):
        if far[c, 0] == EMPTY:
            continue
        used[c] = 0
        if as_measurement(process, early, row6(far, c), root_of[c]):
            class_given(process, early, root_of[c], start, before[0][c], before[1][c])
            if inverse_factor(before[1][c], before[1][c]):
                used[c] = RANK
    for a in range(classes.into[j], classes.into[j + 1]):
        if classes.near[a]:
            c = n_far + classes.rank[a]
            i = classes.source[a]
            camera[c], used[c] = i, 0
            if camera_given(
                cameras, i, j, features, root, before[0][c], before[1][c]
            ) and inverse_factor(before[1][c], before[1][c]):
                used[c] = RANK
    fill_beyond(
        j, process, cameras, rows, whole, weight, pairs, classes, features, known, early, beyond,
        stop, root_of, before, used, camera, losses,
    )  # fmt: skip
    fill_ahead(
        j, process, cameras, whole, kind, weight, pairs, classes, features, meeting, known, early,
        root, root_of, before, used, camera, losses,
    )  # fmt: skip
