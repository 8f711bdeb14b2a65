"""The derivative of what comes after a sample by its covariance, persistent offsets included.

One walk back along the road; the forward filter's gains are computed again, sample by sample, from
the covariances it has stored.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from placement.objectives.windows.offset_gains import load_before
from placement.objectives.windows.offset_information import pull_rows, spread
from placement.objectives.windows.offsets import (
    CAR_STATES,
    enter_state,
    find,
    predict_state,
    set_initial,
    store,
    update_state,
)


@njit(cache=True)
def offset_adjoint(steps, p0, views, plan, matrices, seed, w_tt, w_nn, future):  # type: ignore[no-untyped-def]
    """Fill `future`, laid out as `matrices`: the derivative of what comes after by the covariance.

    What comes after sample t is Σ_{τ > t} (w_tt P_tt + w_nn P_nn)_τ and tr(`seed` P_T) over the
    first three states at the last sample; `seed` (6,).
    """
    n_samples, p = steps.shape[0], views.offsets.shape[2]
    g = np.zeros((plan.widest, plan.widest))
    wide = np.zeros((plan.widest, plan.widest))
    m = np.zeros((plan.widest, plan.widest))
    active = np.empty(plan.camera.size, dtype=np.int64)
    most = 1
    for t in range(n_samples):
        most = max(most, plan.measure_ptr[t + 1] - plan.measure_ptr[t])
    u = np.empty((2, plan.widest))
    gains = np.empty((most, 2, plan.widest))
    set_initial(g, seed)
    store(future, plan.matrix_ptr[n_samples - 1], g, CAR_STATES)
    for t in range(n_samples - 1, 0, -1):
        n, n_active = load_before(t, m, CAR_STATES, p0, matrices, plan, p, active)
        n_before = n
        predict_state(m, n, steps[t])
        for slot in range(plan.enter_ptr[t], plan.enter_ptr[t + 1]):
            n = enter_state(m, n, p, 1.0)
            active[n_active] = slot
            n_active += 1
        first, stop = plan.measure_ptr[t], plan.measure_ptr[t + 1]
        for k in range(first, stop):
            slot = plan.measure_slot[k]
            at = 3 + p * find(active, n_active, slot)
            update_state(
                m,
                n,
                at,
                views.white,
                views.offsets,
                views.frames,
                plan.measure_entry[k],
                plan.share[slot],
                u,
                gains[k - first],
            )
        wide[:n, :n] = 0.0
        kept = plan.in_view[plan.in_view_ptr[t] : plan.in_view_ptr[t + 1]]
        spread(g, kept, active[:n_active], p, wide)
        wide[0, 0] += w_tt
        wide[1, 1] += w_nn
        for k in range(stop - 1, first - 1, -1):
            slot = plan.measure_slot[k]
            at = 3 + p * find(active, n_active, slot)
            undo_update(
                wide, n, at, views, plan.measure_entry[k], plan.share[slot], gains[k - first]
            )
        n = n_before
        pull_rows(wide, n, steps[t])
        g[:n, :n] = wide[:n, :n]
        store(future, plan.matrix_ptr[t - 1], g, n)


@njit(cache=True)
def undo_update(g, n, at, views, e, share, v):  # type: ignore[no-untyped-def]
    """Replace `g` by Lᵀ g L, L = I − v H, the derivative of the update with entry e.

    One factor at a time: a strong camera makes the result smaller than `g` by the square of its
    strength, and all terms in one sum would leave nothing but rounding.
    """
    p = views.offsets.shape[2]
    unit = 1.0 / math.sqrt(share)
    y = np.zeros((2, n))
    for i in range(n):
        row = g[i]
        for j in range(n):
            y[0, i] += row[j] * v[0, j]
            y[1, i] += row[j] * v[1, j]
    for i in range(n):
        g[i, 0] -= y[0, i]
        g[i, 1] -= y[1, i]
        for q in range(p):
            b0, b1 = unit * views.offsets[e, 0, q], unit * views.offsets[e, 1, q]
            g[i, at + q] -= b0 * y[0, i] + b1 * y[1, i]
    y[:] = 0.0
    for i in range(n):
        row, v0, v1 = g[i], v[0, i], v[1, i]
        for j in range(n):
            y[0, j] += v0 * row[j]
            y[1, j] += v1 * row[j]
    for j in range(n):
        g[0, j] -= y[0, j]
        g[1, j] -= y[1, j]
    for q in range(p):
        b0, b1 = unit * views.offsets[e, 0, q], unit * views.offsets[e, 1, q]
        for j in range(n):
            g[at + q, j] -= b0 * y[0, j] + b1 * y[1, j]
    for i in range(n):
        for j in range(i):
            g[i, j] = g[j, i] = 0.5 * (g[i, j] + g[j, i])
