"""Backward messages with persistent offsets: what later samples tell about car and offsets.

The states are those of `windows.offsets`, in the same order. Going back over a sample, the offsets
of cameras that enter there are marginalised with their prior, the identity.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from placement.objectives.windows.filter import parallel
from placement.objectives.windows.offsets import find, set_initial, store, white_block


@njit(cache=True)
def inform_offsets(steps, views, plan, matrices):  # type: ignore[no-untyped-def]
    """Fill the information that later samples hold about the states after each sample."""
    n_samples, p = steps.shape[0], views.offsets.shape[2]
    g = np.zeros((plan.widest, plan.widest))
    wide = np.zeros((plan.widest, plan.widest))
    h = np.empty((2, 3 + p))
    n = 3
    store(matrices, plan.matrix_ptr[n_samples - 1], g, n)
    for t in range(n_samples - 1, 0, -1):
        # the states during sample t: those before it, then those that enter at t
        before, entering = plan.in_view_ptr[t - 1], plan.enter_ptr[t]
        n_before = plan.in_view_ptr[t] - before
        slots = np.empty(n_before + plan.enter_ptr[t + 1] - entering, dtype=np.int64)
        slots[:n_before] = plan.in_view[before : before + n_before]
        slots[n_before:] = np.arange(entering, plan.enter_ptr[t + 1])
        width = 3 + p * slots.size
        wide[:width, :width] = 0.0
        spread(g, plan.in_view[plan.in_view_ptr[t] : plan.in_view_ptr[t + 1]], slots, p, wide)
        for k in range(plan.measure_ptr[t], plan.measure_ptr[t + 1]):
            slot = plan.measure_slot[k]
            at = 3 + p * find(slots, slots.size, slot)
            add_measurement(wide, at, views, plan.measure_entry[k], plan.share[slot], h)
        n = 3 + p * n_before
        while width > n:
            marginalise_last(wide, width, p)
            width -= p
        step_back(wide, n, steps[t])
        g[:n, :n] = wide[:n, :n]
        store(matrices, plan.matrix_ptr[t - 1], g, n)


@njit(cache=True)
def spread(g, some, slots, p, wide):  # type: ignore[no-untyped-def]
    """Write `g` over the states of `some` slots into `wide`, over those of `slots`."""
    where = np.empty(3 + p * some.size, dtype=np.int64)
    where[:3] = np.arange(3)
    for a in range(some.size):
        at = 3 + p * find(slots, slots.size, some[a])
        for q in range(p):
            where[3 + p * a + q] = at + q
    for i in range(where.size):
        for j in range(where.size):
            wide[where[i], where[j]] = g[i, j]


@njit(cache=True)
def add_measurement(g, at, views, e, share, h):  # type: ignore[no-untyped-def]
    """Add Hᵀ J H of entry e, whose camera's offsets start at state `at`."""
    p = views.offsets.shape[2]
    unit = 1.0 / math.sqrt(share)
    jtt, jtn, jnn = white_block(views.white, views.frames, e, share)
    h[:, :3] = 0.0
    h[0, 0], h[1, 1] = 1.0, 1.0
    for q in range(p):
        h[0, 3 + q], h[1, 3 + q] = unit * views.offsets[e, 0, q], unit * views.offsets[e, 1, q]
    for i in range(3 + p):
        row = i if i < 3 else at + i - 3
        a, b = jtt * h[0, i] + jtn * h[1, i], jtn * h[0, i] + jnn * h[1, i]
        for j in range(3 + p):
            g[row, j if j < 3 else at + j - 3] += a * h[0, j] + b * h[1, j]


@njit(cache=True)
def marginalise_last(g, n, p):  # type: ignore[no-untyped-def]
    """Take the last p states, whose prior information is the identity, out of `g` (n, n)."""
    for k in range(n - 1, n - p - 1, -1):
        pivot = 1.0 + g[k, k]
        for i in range(k):
            factor = g[i, k] / pivot
            for j in range(k):
                g[i, j] -= factor * g[k, j]


@njit(cache=True)
def step_back(g, n, step):  # type: ignore[no-untyped-def]
    """Carry information about the states after a step to those before it: noise, then Fᵀ · F."""
    q = (step[4], step[5], step[6], step[7], step[8], step[9])
    x = (g[0, 0], g[0, 1], g[0, 2], g[1, 1], g[1, 2], g[2, 2])
    k0, k1, k2, k3, k4, k5 = parallel(q, x)  # (Q⁻¹ + Γ_xx)⁻¹
    y = parallel(x, q)
    for i in range(3, n):
        r0 = k0 * g[0, i] + k1 * g[1, i] + k2 * g[2, i]
        r1 = k1 * g[0, i] + k3 * g[1, i] + k4 * g[2, i]
        r2 = k2 * g[0, i] + k4 * g[1, i] + k5 * g[2, i]
        for j in range(3, n):
            g[i, j] -= r0 * g[0, j] + r1 * g[1, j] + r2 * g[2, j]
    for i in range(3, n):
        r0 = k0 * g[0, i] + k1 * g[1, i] + k2 * g[2, i]
        r1 = k1 * g[0, i] + k3 * g[1, i] + k4 * g[2, i]
        r2 = k2 * g[0, i] + k4 * g[1, i] + k5 * g[2, i]
        g[i, 0] -= x[0] * r0 + x[1] * r1 + x[2] * r2
        g[i, 1] -= x[1] * r0 + x[3] * r1 + x[4] * r2
        g[i, 2] -= x[2] * r0 + x[4] * r1 + x[5] * r2
    set_initial(g, y)
    pull_rows(g, n, step)


@njit(cache=True)
def pull_rows(g, n, step):  # type: ignore[no-untyped-def]
    """Replace `g` by Fᵀ g F on the first three states; rows 3… of the left columns are read."""
    c, s, y, x = step[0], step[1], step[2], step[3]
    for i in range(n):
        a, b = g[i, 0], g[i, 1]
        g[i, 0] = c * a - s * b
        g[i, 1] = s * a + c * b
        g[i, 2] += y * a + x * b
    for j in range(3):
        a, b = g[0, j], g[1, j]
        g[0, j] = c * a - s * b
        g[1, j] = s * a + c * b
        g[2, j] += y * a + x * b
    for i in range(3, n):
        for j in range(3):
            g[j, i] = g[i, j]
