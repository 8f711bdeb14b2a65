"""Classes of the cameras that end well before another begins."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.diagram.order import below, meet
from placement.objectives.windows.filter import put6, row6
from placement.sieve.classes import CHANGE, EMPTY, FAR
from placement.tempered.crossings import after
from placement.tempered.process import prior_at


@njit(cache=True)
def far_classes(j, process, cameras, rows, pairs, classes, far):  # type: ignore[no-untyped-def]
    """Sort the far cameras before j into classes by what j gains after them; fill `far` (FAR, 6).

    What a class takes off the car's covariance P at `early` is below that of all its members, in
    the Loewner order: Φ (P_l − X) Φᵀ of a camera that leaves X behind its last sample l, Φ the
    chain's transition from l to `early`. Of covariances themselves the least upper bounds may
    exceed P, and then say nothing.
    """
    early = classes.early[j]
    least, most, from_sample = np.inf, -np.inf, early
    for a in range(classes.into[j], classes.into[j + 1]):
        i = classes.source[a]
        if not classes.near[a] and cameras.last[i] >= 0:
            gain = np.float64(pairs[i, j])
            least, most = min(least, gain), max(most, gain)
            from_sample = min(from_sample, cameras.last[i])
    if least > most:
        return
    phi = np.empty((early - from_sample + 1, 3, 3))
    phi[early - from_sample] = np.eye(3)
    for t in range(early, from_sample, -1):
        f, now, before = process.f[t], phi[t - from_sample], phi[t - 1 - from_sample]
        for x in range(3):
            for y in range(3):
                before[x, y] = now[x, 0] * f[y] + now[x, 1] * f[3 + y] + now[x, 2] * f[6 + y]
    m, v = np.empty((3, 3)), np.empty((3, 3))
    for a in range(classes.into[j], classes.into[j + 1]):
        i = classes.source[a]
        classes.group[a] = 0
        if classes.near[a] or cameras.last[i] < 0:
            continue
        c = 0
        if most > least:
            c = min(int(FAR * (np.float64(pairs[i, j]) - least) / (most - least)), FAR - 1)
        classes.group[a] = 1 + c
        known = after(prior_at(process, cameras.first[i]), rows[i])
        at_last = prior_at(process, cameras.last[i])
        d = (
            at_last[0] - known[0], at_last[1] - known[1], at_last[2] - known[2],
            at_last[3] - known[3], at_last[4] - known[4], at_last[5] - known[5],
        )  # fmt: skip
        _keep_below(far, c, moved(phi[cameras.last[i] - from_sample], d), m, v)


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


@njit(cache=True)
def _keep_below(kept, at, d, m, v):  # type: ignore[no-untyped-def]
    """Let row `at` of `kept` (c, 6) be below `d` (6,), too."""
    if kept[at, 0] == EMPTY:
        put6(kept, at, d)
        return
    now = row6(kept, at)
    if below(now, d, 1.0):
        return
    if not below(d, now, 1.0):
        nothing = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        both = meet(now, d, nothing, m, v)
        d = both if both[0] > 0.0 else meet(d, now, nothing, m, v)
    f = 1.0 - CHANGE
    put6(kept, at, (f * d[0], f * d[1], f * d[2], f * d[3], f * d[4], f * d[5]))
