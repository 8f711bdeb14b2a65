"""Losses of cameras that see what the one before them, or those near it, see.

Each near camera stands for itself: the loss is the mutual information of its features and those of
the camera ahead, given all that the one in between measures. Cameras ahead tell of the state before
all that, too.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from placement.sieve.features import RANK, factor, some_noise
from placement.sieve.given import camera_given
from placement.sieve.neighbours import IMPOSSIBLE, rounded_down
from placement.sieve.told import tell_ahead

# products of matrices this small (16 × 2 m × 128) run on the thread that asks for them
BLOCK, SIDE = 4, 32  # cameras before, and ahead, whose covariances are found together


@njit(cache=True)
def fill_ahead(  # type: ignore[no-untyped-def]
    j, cameras, kind, weight, gain, near, features, meeting, known, root, parted,
    at_early, start, before, used, camera, reached, told, losses,
):  # fmt: skip
    """Fill the rows of arcs to cameras that see what j or its near ones see."""
    b_before, inverse = before
    size, rank = root.shape[0], features.spread.shape[1]
    begin, end = near.out_of[j], near.out_of[j + 1]
    n_near = used.size
    # the cameras ahead given z_j, side by side
    n_ahead = 0
    for e in range(begin, end):
        if near.ahead[e]:
            n_ahead += 1
    if n_ahead == 0:
        return
    arc, usable = np.empty(n_ahead, np.int64), np.zeros(n_ahead, np.bool_)
    blocks = (n_ahead + SIDE - 1) // SIDE
    b_ahead = np.zeros((blocks, size, SIDE * rank))
    given, log_det = np.zeros((n_ahead, rank, rank)), np.zeros(n_ahead)
    one, low = np.zeros((rank, size)), np.empty((rank, rank))
    u = 0
    for e in range(begin, end):
        if not near.ahead[e]:
            continue
        k = near.target[e]
        arc[u] = e
        if camera_given(cameras, k, j, features, root, one, given[u]):
            low[:] = given[u]
            log_det[u] = factor(low, rank)
            usable[u] = some_noise(low, rank)
            if parted and usable[u]:
                tell_ahead(j, e, k, features, near, at_early, start, one, low, told)
            for a in range(rank):
                for z in range(size):
                    b_ahead[u // SIDE, z, u % SIDE * rank + a] = one[a, z]
        u += 1
    link = np.zeros((3, rank))
    d, x_of = np.zeros((rank, rank)), np.zeros((rank, rank))
    shared = np.zeros((blocks, BLOCK * rank, SIDE * rank))
    rows = b_before.reshape(n_near * rank, size)
    for c in range(n_near):
        if size > 0 and c % BLOCK == 0:
            stop = min(c + BLOCK, n_near)
            for block in range(blocks):
                some = shared[block][: (stop - c) * rank]
                np.dot(rows[c * rank : stop * rank], b_ahead[block], some)
        from_row = c % BLOCK * rank
        i = camera[c]
        q, q_end = meeting.at[i], meeting.at[i + 1]
        if used[c] > 0:  # Cov(y_i, y_k) is that with the state between them, pulled back
            link[:] = features.field[features.at[i] + cameras.last[i] - features.low[i]]
        for u in range(n_ahead):
            e = arc[u]
            k = near.target[e]
            at = near.row_at[e] + c
            worthless = reached[c] + np.float64(gain[e]) + known.beyond[k] < known.need
            if worthless or (kind[i] >= 0 and kind[i] == kind[k]):
                losses[at] = IMPOSSIBLE
                continue
            if used[c] == 0 or not usable[u]:
                continue
            if cameras.first[k] <= cameras.last[i]:
                while q < q_end and meeting.other[q] < k:
                    q += 1
                if q == q_end or meeting.other[q] != k:
                    continue
                both = meeting.covariance[q]
                if both[0, 0] != both[0, 0]:
                    continue
                for a in range(rank):
                    for b in range(rank):
                        d[a, b] = both[b, a]
            else:
                place = cameras.last[i] - features.low[k]
                if place < 0:
                    continue
                row = features.pull[features.at[k] + place]
                for a in range(rank):
                    for b in range(rank):
                        d[a, b] = (
                            link[0, a] * row[0, b] + link[1, a] * row[1, b] + link[2, a] * row[2, b]
                        )
            some, column = shared[u // SIDE], u % SIDE * rank
            left = _log_det_left(d, some, from_row, column, inverse[c], given[u], x_of)
            losses[at] = rounded_down(log_det[u] - left, weight)


@njit(cache=True)
def _log_det_left(d, shared, row, column, inverse, given, x):  # type: ignore[no-untyped-def]
    """Return log det of Cov(y_k | z_j, y), d − `shared` the covariance of y and y_k given z_j.

    With Cov(y | z_j) = L Lᵀ, `inverse` = L⁻¹ and `given` the lower part of Cov(y_k | z_j), that is
    `given` − (L⁻¹ d)ᵀ (L⁻¹ d), here by its pivots: at least 1 each, that of the noise.
    """
    for a in range(RANK):
        for b in range(RANK):
            s = 0.0
            for q in range(a + 1):
                s += inverse[a, q] * (d[q, b] - shared[row + q, column + b])
            x[a, b] = s
    # d now holds what is left, its lower part
    for a in range(RANK):
        for b in range(a + 1):
            s = given[a, b]
            for q in range(RANK):
                s -= x[q, a] * x[q, b]
            d[a, b] = s
    product = 1.0
    for b in range(RANK):
        pivot = max(d[b, b], 1.0)
        product *= pivot
        inv = 1.0 / pivot
        for a in range(b + 1, RANK):
            f = d[a, b] * inv
            for c in range(b + 1, a + 1):
                d[a, c] -= f * d[c, b]
    return math.log(product)
