"""Where along a drive the lateral variance first exceeds a limit, and by how much it does so.

Frames are independent here; `offset_violation` has the same for persistent errors. A candidate's
window starts from the stored covariance before its first sample, so nothing earlier is filtered
again.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.objectives.windows.filter import predict, put6, row6, update


@njit(cache=True)
def violations(steps, p0, total, limit, before, lateral):  # type: ignore[no-untyped-def]
    """Filter over information `total` (t, 3); return the first sample above `limit`, else t.

    Fills the covariances before each sample's measurements (t, 6) and the lateral variances after
    them (t,).
    """
    t_end = steps.shape[0]
    first = t_end
    p = (p0[0], p0[1], p0[2], p0[3], p0[4], p0[5])
    for t in range(t_end):
        if t > 0:
            p = predict(p, steps[t])
        put6(before, t, p)
        q0, q1, q2, q3, q4, q5, _ = update(p, total[t, 0], total[t, 1], total[t, 2])
        p = (q0, q1, q2, q3, q4, q5)
        lateral[t] = q3
        if q3 > limit and first == t_end:
            first = t
    return first


@njit(cache=True)
def reach_with(  # type: ignore[no-untyped-def]
    indptr, indices, blocks, frames, rows, steps, total, before, first, limit, reach
):
    """Set reach[k] to where the first violation moves when candidate rows[k] joins.

    `first` is where it is now. A fraction limit / variance there, below 1, tells near misses
    apart; without any violation it is t.
    """
    t_end = steps.shape[0]
    isotropic = blocks.shape[1] == 1
    for k in range(rows.size):
        i = rows[k]
        e, stop = indptr[i], indptr[i + 1]
        begin = first
        if e < stop and indices[e] < first:
            begin = np.int64(indices[e])
        if begin >= t_end:
            reach[k] = t_end
            continue
        p = row6(before, begin)
        found = np.float64(t_end)
        for t in range(begin, t_end):
            if t > begin:
                p = predict(p, steps[t])
            j0, j1, j2 = total[t, 0], total[t, 1], total[t, 2]
            if e < stop and indices[e] == t:
                if isotropic:
                    j0 += frames * blocks[e, 0]
                    j2 += frames * blocks[e, 0]
                else:
                    j0 += frames * blocks[e, 0]
                    j1 += frames * blocks[e, 1]
                    j2 += frames * blocks[e, 2]
                e += 1
            q0, q1, q2, q3, q4, q5, _ = update(p, j0, j1, j2)
            p = (q0, q1, q2, q3, q4, q5)
            if q3 > limit:
                found = t + limit / q3
                break
        reach[k] = found


@njit(cache=True)
def excess_with(  # type: ignore[no-untyped-def]
    indptr, indices, blocks, frames, rows, steps, total, before, earlier, limit, excess
):
    """Set excess[k] to Σ_t max(0, variance / limit − 1) when candidate rows[k] joins.

    earlier (t + 1,) holds that sum over the samples before t as things are.
    """
    t_end = steps.shape[0]
    isotropic = blocks.shape[1] == 1
    for k in range(rows.size):
        i = rows[k]
        e, stop = indptr[i], indptr[i + 1]
        if e == stop:
            excess[k] = earlier[t_end]
            continue
        begin = np.int64(indices[e])
        p = row6(before, begin)
        found = earlier[begin]
        for t in range(begin, t_end):
            if t > begin:
                p = predict(p, steps[t])
            j0, j1, j2 = total[t, 0], total[t, 1], total[t, 2]
            if e < stop and indices[e] == t:
                if isotropic:
                    j0 += frames * blocks[e, 0]
                    j2 += frames * blocks[e, 0]
                else:
                    j0 += frames * blocks[e, 0]
                    j1 += frames * blocks[e, 1]
                    j2 += frames * blocks[e, 2]
                e += 1
            q0, q1, q2, q3, q4, q5, _ = update(p, j0, j1, j2)
            p = (q0, q1, q2, q3, q4, q5)
            if q3 > limit:
                found += q3 / limit - 1.0
        excess[k] = found
