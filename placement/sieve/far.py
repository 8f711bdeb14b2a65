"""Classes of the cameras that end well before another begins."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.objectives.windows.filter import put6
from placement.sieve.anchors import choose_anchors
from placement.sieve.features import prior_matrix
from placement.sieve.given import invert
from placement.tempered.crossings import after
from placement.tempered.process import prior_at


@njit(cache=True)
def far_classes(j, process, cameras, rows, weight, pairs, classes, known, start, far):  # type: ignore[no-untyped-def]
    """Sort the far cameras before j into classes; fill `far` (classes, 6).

    A class takes D = Φ (P_l − X) Φᵀ off the car's covariance P at `early`: what its anchor does,
    which leaves X behind its last sample l, Φ the chain's transition from l to `early`. `start`
    (3, 2 m) is Cov(x_early, z_j) L⁻ᵀ.
    """
    early = classes.early[j]
    many, from_sample = 0, early
    for a in range(classes.into[j], classes.into[j + 1]):
        i = classes.source[a]
        if not classes.near[a] and cameras.last[i] >= 0:
            many += 1
            from_sample = min(from_sample, cameras.last[i])
    if many == 0:
        return
    phi = np.empty((early - from_sample + 1, 3, 3))
    phi[early - from_sample] = np.eye(3)
    for t in range(early, from_sample, -1):
        f, now, before = process.f[t], phi[t - from_sample], phi[t - 1 - from_sample]
        for x in range(3):
            for y in range(3):
                before[x, y] = now[x, 0] * f[y] + now[x, 1] * f[3 + y] + now[x, 2] * f[6 + y]
    p, left, at_p, told = np.empty((3, 3)), np.empty((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    prior_matrix(process, early, p)
    for x in range(3):
        for y in range(3):
            left[x, y] = p[x, y]
            for z in range(start.shape[1]):
                left[x, y] -= start[x, z] * start[y, z]
    if not invert(p, at_p) or not invert(left, told):
        return
    told -= at_p  # what z_j tells of the state at `early`
    member, off = np.empty(many, np.int64), np.empty((many, 6))
    information, value = np.empty((many, 6)), np.empty(many)
    n = 0
    for a in range(classes.into[j], classes.into[j + 1]):
        i = classes.source[a]
        if classes.near[a] or cameras.last[i] < 0:
            continue
        behind = after(prior_at(process, cameras.first[i]), rows[i])
        at_last = prior_at(process, cameras.last[i])
        d = (
            at_last[0] - behind[0], at_last[1] - behind[1], at_last[2] - behind[2],
            at_last[3] - behind[3], at_last[4] - behind[4], at_last[5] - behind[5],
        )  # fmt: skip
        d = moved(phi[cameras.last[i] - from_sample], d)
        left[0, 0], left[0, 1], left[0, 2] = p[0, 0] - d[0], p[0, 1] - d[1], p[0, 2] - d[2]
        left[1, 0], left[1, 1], left[1, 2] = left[0, 1], p[1, 1] - d[3], p[1, 2] - d[4]
        left[2, 0], left[2, 1], left[2, 2] = left[0, 2], left[1, 2], p[2, 2] - d[5]
        if not invert(left, at_p):
            continue  # stays where nothing is known
        member[n], value[n] = a, known.into[i] + np.float64(pairs[i, j])
        put6(off, n, d)
        put6(
            information, n,
            (
                at_p[0, 0] + told[0, 0], at_p[0, 1] + told[0, 1], at_p[0, 2] + told[0, 2],
                at_p[1, 1] + told[1, 1], at_p[1, 2] + told[1, 2], at_p[2, 2] + told[2, 2],
            ),
        )  # fmt: skip
        n += 1
    chosen, group, extra = np.empty(classes.n_far, np.int64), np.empty(n, np.int64), np.empty(n)
    found = choose_anchors(
        information[:n], value[:n], weight, known.spare, classes.n_far, chosen, group, extra
    )
    for c in range(found):
        far[c] = off[chosen[c]]
    for q in range(n):
        classes.group[member[q]] = 1 + group[q]
        classes.extra[member[q]] = extra[q]


@njit(cache=True)
def moved(phi, d):  # type: ignore[no-untyped-def]
    """Return Φ D Φᵀ (6,)."""
    a0 = phi[0, 0] * d[0] + phi[0, 1] * d[1] + phi[0, 2] * d[2]
    a1 = phi[0, 0] * d[1] + phi[0, 1] * d[3] + phi[0, 2] * d[4]
    a2 = phi[0, 0] * d[2] + phi[0, 1] * d[4] + phi[0, 2] * d[5]
    b0 = phi[1, 0] * d[0] + phi[1, 1] * d[1] + phi[1, 2] * d[2]
    b1 = phi[1, 0] * d[1] + phi[1, 1] * d[3] + phi[1, 2] * d[4]
    b2 = phi[1, 0] * d[2] + phi[1, 1] * d[4] + phi[1, 2] * d[5]
    c0 = phi[2, 0] * d[0] + phi[2, 1] * d[1] + phi[2, 2] * d[2]
    c1 = phi[2, 0] * d[1] + phi[2, 1] * d[3] + phi[2, 2] * d[4]
    c2 = phi[2, 0] * d[2] + phi[2, 1] * d[4] + phi[2, 2] * d[5]
    return (
        a0 * phi[0, 0] + a1 * phi[0, 1] + a2 * phi[0, 2],
        a0 * phi[1, 0] + a1 * phi[1, 1] + a2 * phi[1, 2],
        a0 * phi[2, 0] + a1 * phi[2, 1] + a2 * phi[2, 2],
        b0 * phi[1, 0] + b1 * phi[1, 1] + b2 * phi[1, 2],
        b0 * phi[2, 0] + b1 * phi[2, 1] + b2 * phi[2, 2],
        c0 * phi[2, 0] + c1 * phi[2, 1] + c2 * phi[2, 2],
    )
