"""Losses of cameras beyond all that the one before them, and those near it, see.

Whoever came before acts through the car's covariance behind the last sample of those; classes have
that of one of them (`placement.sieve.anchors`).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.objectives.windows.filter import put6, row6
from placement.sieve.anchors import choose_anchors
from placement.sieve.classes import EMPTY, IMPOSSIBLE, rounded_down
from placement.sieve.features import RANK, carry_columns, prior_matrix
from placement.sieve.given import invert
from placement.tempered.crossings import worth
from placement.tempered.process import predict_ahead


@njit(cache=True)
def fill_beyond(  # type: ignore[no-untyped-def]
    j, process, cameras, rows, whole, weight, pairs, classes, features, known, early, beyond,
    stop, root_of, before, used, camera, losses,
):  # fmt: skip
    """Fill the rows of arcs to cameras beyond all that j and its near ones see."""
    b_before, inverse = before
    n_far, n_beyond = classes.n_far, classes.n_beyond
    size = stop.shape[1]
    farthest = beyond
    for e in range(classes.out_of[j], classes.out_of[j + 1]):
        k = classes.target[e]
        if not classes.ahead[e] and cameras.last[k] >= 0:
            farthest = max(farthest, cameras.first[k])
    # the car at `beyond` given z_j, and given each class or near camera, too
    s, p, move = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    prior_matrix(process, beyond, s)
    for x in range(3):
        for y in range(3):
            for z in range(size):
                s[x, y] -= stop[x, z] * stop[y, z]
    prior_matrix(process, early, move)
    for t in range(early + 1, beyond + 1):
        carry_columns(process.f[t], move)  # Cov(x_beyond, x_early)
    n_before = used.size
    left = np.empty((n_before, 6))
    d = np.zeros((3, RANK))
    for c in range(n_before):
        p[:] = s
        tells = used[c] > 0
        if tells and c < n_far:
            for x in range(3):
                d[x, 3:] = 0.0
                for a in range(3):
                    g = root_of[c]
                    d[x, a] = move[x, 0] * g[0, a] + move[x, 1] * g[1, a] + move[x, 2] * g[2, a]
        elif tells:
            i = camera[c]
            at = beyond - features.low[i]
            tells = 0 <= at < features.at[i + 1] - features.at[i]
            if tells:
                d[:, : used[c]] = features.field[features.at[i] + at]
        if tells:
            for x in range(3):
                for a in range(used[c]):
                    for z in range(size):
                        d[x, a] -= stop[x, z] * b_before[c, a, z]
                # times the inverse factor, from the last on: it is lower triangular
                for a in range(used[c] - 1, -1, -1):
                    total = 0.0
                    for q in range(a + 1):
                        total += inverse[c, a, q] * d[x, q]
                    d[x, a] = total
            for x in range(3):
                for y in range(3):
                    for a in range(used[c]):
                        p[x, y] -= d[x, a] * d[y, a]
        hair = 1e-11
        put6(
            left, c,
            (
                p[0, 0] + hair * s[0, 0], p[0, 1], p[0, 2],
                p[1, 1] + hair * s[1, 1], p[1, 2], p[2, 2] + hair * s[2, 2],
            ),
        )  # fmt: skip
    behind = np.full((n_far + n_beyond, 6), EMPTY)
    for c in range(n_far):
        if used[c] >= 0:
            put6(behind, c, row6(left, c))
    _near_classes(j, weight, pairs, classes, known, left, behind)
    samples = process.prior.shape[0]
    by = np.empty((samples, 6))
    for c in range(n_far + n_beyond):
        some = behind[c, 0] != EMPTY
        if some:
            put6(by, beyond, row6(behind, c))
            predict_ahead(process, row6(behind, c), beyond, farthest, by)
        for e in range(classes.out_of[j], classes.out_of[j + 1]):
            if classes.ahead[e]:
                continue
            k = classes.target[e]
            at = classes.row_at[e]
            losses[at] = 0
            if not some:
                losses[at + 1 + c] = IMPOSSIBLE
            elif cameras.last[k] < 0 or not whole[k]:
                losses[at + 1 + c] = 0
            else:
                gain = weight * worth(row6(by, cameras.first[k]), rows[k])
                losses[at + 1 + c] = rounded_down(np.float64(pairs[j, k]) - gain)


@njit(cache=True)
def _near_classes(j, weight, pairs, classes, known, left, behind):  # type: ignore[no-untyped-def]
    """Sort j's near cameras by the covariance that they leave; fill the last rows of `behind`."""
    n_near, n_far, n_beyond = classes.many[j], classes.n_far, classes.n_beyond
    member, information = np.empty(n_near, np.int64), np.empty((n_near, 6))
    value, row = np.empty(n_near), np.empty(n_near, np.int64)
    p, inverse = np.empty((3, 3)), np.zeros((3, 3))
    n = 0
    for a in range(classes.into[j], classes.into[j + 1]):
        if not classes.near[a]:
            continue
        u = left[n_far + classes.rank[a]]
        p[0, 0], p[0, 1], p[0, 2] = u[0], u[1], u[2]
        p[1, 0], p[1, 1], p[1, 2] = u[1], u[3], u[4]
        p[2, 0], p[2, 1], p[2, 2] = u[2], u[4], u[5]
        if not invert(p, inverse):
            continue  # stays where nothing is known
        i = classes.source[a]
        member[n], row[n] = a, n_far + classes.rank[a]
        value[n] = known.into[i] + np.float64(pairs[i, j])
        put6(
            information, n,
            (
                inverse[0, 0], inverse[0, 1], inverse[0, 2],
                inverse[1, 1], inverse[1, 2], inverse[2, 2],
            ),
        )  # fmt: skip
        n += 1
    chosen, group, extra = np.empty(n_beyond, np.int64), np.empty(n, np.int64), np.empty(n)
    found = choose_anchors(
        information[:n], value[:n], weight, known.spare, n_beyond, chosen, group, extra
    )
    for c in range(found):
        behind[n_far + c] = left[row[chosen[c]]]
    for q in range(n):
        classes.group[member[q]] = 1 + n_far + group[q] if group[q] >= 0 else 0
        classes.extra[member[q]] = extra[q]
