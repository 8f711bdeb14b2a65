"""As `violation`, where cameras have persistent offsets: the state carries those in view.

A candidate is followed from the last sample before its window at which no chosen camera has
offsets pending, so that the car's own covariance is all there is to start from.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.objectives.windows.offsets import (
    CAR_STATES,
    enter_state,
    leave_state,
    predict_state,
    set_initial,
    update_state,
)


@njit(cache=True)
def offset_reach_with(  # type: ignore[no-untyped-def]
    indptr,
    indices,
    white,
    offsets,
    frames,
    rows,
    chosen,
    steps,
    p0,
    car,
    pending,
    first,
    limit,
    reach,
):
    """Set reach[k] to where the first violation moves when candidate rows[k] joins `chosen`.

    car (t, 6) is the car's covariance after each sample's measurements, pending (t,) whether some
    chosen camera has been seen at or before a sample and will be after it. `first` is where the
    first violation is now; the fraction is that of `violation.reach_with`.
    """
    t_end, p = steps.shape[0], offsets.shape[2]
    slots = np.empty(chosen.size + 1, dtype=np.int64)
    slots[: chosen.size] = chosen
    at = np.empty(slots.size, dtype=np.int64)  # where a slot's offsets stand, −1 before and after
    entry = np.empty(slots.size, dtype=np.int64)
    widest = 3 + p * slots.size
    m = np.zeros((widest, widest))
    u, v = np.empty((2, widest)), np.empty((2, widest))
    for k in range(rows.size):
        i = rows[k]
        reach[k] = first
        if indptr[i] == indptr[i + 1] or first >= t_end:
            continue
        begin = min(np.int64(indices[indptr[i]]), np.int64(first))
        while begin > 0 and pending[begin - 1]:
            begin -= 1
        slots[chosen.size] = i
        n = CAR_STATES
        if begin == 0:
            set_initial(m, p0)
        else:
            set_initial(m, car[begin - 1])
        for s in range(slots.size):
            at[s] = -1
            e = indptr[slots[s]]
            while e < indptr[slots[s] + 1] and indices[e] < begin:
                e += 1
            entry[s] = e
        found = np.float64(t_end)
        for t in range(begin, t_end):
            if t > 0:
                predict_state(m, n, steps[t])
            for s in range(slots.size):
                e = entry[s]
                if e == indptr[slots[s] + 1] or indices[e] != t:
                    continue
                if at[s] < 0:
                    at[s] = n
                    n = enter_state(m, n, p, 1.0)
                update_state(m, n, at[s], white, offsets, frames, e, 1.0, u, v)
                entry[s] = e + 1
                if e + 1 == indptr[slots[s] + 1]:
                    n = leave_state(m, n, at[s], p)
                    for other in range(slots.size):
                        if at[other] > at[s]:
                            at[other] -= p
                    at[s] = -1
            if m[1, 1] > limit:
                found = t + limit / m[1, 1]
                break
        reach[k] = found
