"""Gains of candidates with persistent offsets: the window walk of `windows.offsets`' filter.

A candidate's offsets ride along as p more states over its own window, right behind the first
three. Entropy gains end at the window's last sample, against the stored information of later
ones; falls of the trace are followed under the bound of `windows.trace`, which holds for the
larger state as it stands.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from placement.objectives.windows.filter import RESCALE
from placement.objectives.windows.offsets import (
    CAR_STATES,
    drop_unseen,
    leave_state,
    log_det_definite,
    pass_sample,
    set_initial,
    store,
    update_state,
)
from placement.objectives.windows.trace import TAIL_TOLERANCE


@njit(cache=True)
def load_before(t, m, base, p0, matrices, plan, p, active):  # type: ignore[no-untyped-def]
    """Set `m` to the state after sample t − 1 with room for `base` leading states.

    Returns the numbers of states and active slots.
    """
    if t == 0:
        m[:base, :base] = 0.0
        set_initial(m, p0)
        return base, 0
    first = plan.in_view_ptr[t - 1]
    n_active = plan.in_view_ptr[t] - first
    for a in range(n_active):
        active[a] = plan.in_view[first + a]
    stored = 3 + p * n_active
    start = plan.matrix_ptr[t - 1]
    shift = base - 3
    for i in range(stored):
        row = i if i < 3 else i + shift
        for j in range(stored):
            m[row, j if j < 3 else j + shift] = matrices[start + i * stored + j]
    return stored + shift, n_active


@njit(cache=True)
def insert_candidate(m, n, p):  # type: ignore[no-untyped-def]
    """Make states 3…3 + p − 1 the candidate's offsets, independent and of unit variance."""
    for i in range(3, 3 + p):
        for j in range(n):
            m[i, j] = 0.0
            m[j, i] = 0.0
        m[i, i] = 1.0


@njit(cache=True)
def log_det_plus_flat(m, n, flat, start, low, work):  # type: ignore[no-untyped-def]
    """Return log det(I + P G) for the leading n × n of `m` and G in flat storage."""
    for j in range(n):  # Cholesky P = L Lᵀ; an exactly known state has a column of zeros
        for i in range(j, n):
            s = m[i, j]
            for k in range(j):
                s -= low[i, k] * low[j, k]
            if i == j:
                low[j, j] = math.sqrt(max(s, 0.0))
            else:
                low[i, j] = s / low[j, j] if low[j, j] > 0.0 else 0.0
    for i in range(n):  # work = G L
        for j in range(n):
            work[i, j] = 0.0
        for k in range(n):
            g = flat[start + i * n + k]
            for j in range(k + 1):
                work[i, j] += g * low[k, j]
    # low ← I + Lᵀ G L, built row by row into the upper part of work's copy
    out = np.eye(n)
    for k in range(n):
        for i in range(k + 1):
            g = low[k, i]
            for j in range(n):
                out[i, j] += g * work[k, j]
    return log_det_definite(out, n)


@njit(cache=True)
def offsets_through(views, plan, matrices, later, log_before, log_sum, through):  # type: ignore[no-untyped-def]
    """Fill `through` (t,): earlier and present log dets, and log det(I + P_t Γ_t)."""
    n_samples, p = through.size, views.offsets.shape[2]
    m = np.empty((plan.widest, plan.widest))
    low, work = np.empty_like(m), np.empty_like(m)
    for t in range(n_samples):
        n = 3 + p * (plan.in_view_ptr[t + 1] - plan.in_view_ptr[t])
        start = plan.matrix_ptr[t]
        for i in range(n):
            for j in range(n):
                m[i, j] = matrices[start + i * n + j]
        done = log_before[t + 1] if t + 1 < n_samples else log_sum
        through[t] = done + log_det_plus_flat(m, n, later, start, low, work)


@njit(cache=True)
def offset_forgetting(views, plan, matrices, later, out):  # type: ignore[no-untyped-def]
    """Fill `out`, laid out as `later`, with G = (I + Γ P)⁻¹ Γ for each sample."""
    p = views.offsets.shape[2]
    for t in range(plan.in_view_ptr.size - 1):
        n = 3 + p * (plan.in_view_ptr[t + 1] - plan.in_view_ptr[t])
        a, b = plan.matrix_ptr[t], plan.matrix_ptr[t + 1]
        g = later[a:b].reshape((n, n))
        m = matrices[a:b].reshape((n, n))
        store(out, a, np.linalg.solve(np.eye(n) + g @ m, g), n)


@njit(cache=True)
def offset_entropy_gains(  # type: ignore[no-untyped-def]
    rows, steps, p0, views, plan, matrices, later, log_before, through, own_shares, out
):
    """Set out[k] to the rise of the trajectory's log det on adding candidate rows[k], in nats.

    `own_shares` (c,) is what each camera tells about its offsets alone (`offset_shares`).
    """
    p = views.offsets.shape[2]
    enter_ptr, measure_ptr, measure_slot = plan.enter_ptr, plan.measure_ptr, plan.measure_slot
    measure_entry, shares, last_seen = plan.measure_entry, plan.share, plan.last
    white, offsets, frames = views.white, views.offsets, views.frames
    size = plan.widest + p
    m, low, work = np.zeros((size, size)), np.empty((size, size)), np.empty((size, size))
    u, v = np.empty((2, size)), np.empty((2, size))
    active = np.empty(plan.camera.size + 1, dtype=np.int64)
    for k in range(rows.size):
        e, stop = views.indptr[rows[k]], views.indptr[rows[k] + 1]
        out[k] = 0.0
        if e == stop:
            continue
        t = np.int64(views.indices[e])
        base = 3 + p
        n, n_active = load_before(t, m, base, p0, matrices, plan, p, active)
        insert_candidate(m, n, p)
        log_sum, product = log_before[t], 1.0
        while True:
            n, n_active, det = pass_sample(
                t,
                m,
                n,
                base,
                active,
                n_active,
                steps,
                enter_ptr,
                measure_ptr,
                measure_slot,
                measure_entry,
                shares,
                white,
                offsets,
                frames,
                u,
                v,
            )
            if views.indices[e] == t:
                det *= update_state(m, n, CAR_STATES, white, offsets, frames, e, 1.0, u, v)[0]
                e += 1
            product *= det
            if product > RESCALE:
                log_sum += math.log(product)
                product = 1.0
            n, n_active = drop_unseen(t, m, n, base, active, n_active, p, last_seen)
            if e == stop:
                break
            t += 1
        n = leave_state(m, n, CAR_STATES, p)
        log_sum += math.log(product) - own_shares[rows[k]] - through[t]
        out[k] = log_sum + log_det_plus_flat(m, n, later, plan.matrix_ptr[t], low, work)


@njit(cache=True)
def offset_reductions(  # type: ignore[no-untyped-def]
    rows, steps, p0, views, plan, matrices, future, forget, w_tt, w_nn, out
):
    """Set out[k] to the fall of Σ_t (w_tt P_tt + w_nn P_nn)_t on adding candidate rows[k].

    What the walk leaves open at its end is at most TAIL_TOLERANCE of it (`windows.trace`).
    """
    p, last = views.offsets.shape[2], steps.shape[0] - 1
    enter_ptr, measure_ptr, measure_slot = plan.enter_ptr, plan.measure_ptr, plan.measure_slot
    measure_entry, shares, last_seen = plan.measure_entry, plan.share, plan.last
    white, offsets, frames = views.white, views.offsets, views.frames
    size = plan.widest + p
    m = np.zeros((size, size))
    u, v = np.empty((2, size)), np.empty((2, size))
    active = np.empty(plan.camera.size + 1, dtype=np.int64)
    for k in range(rows.size):
        e, stop = views.indptr[rows[k]], views.indptr[rows[k] + 1]
        out[k] = 0.0
        if e == stop:
            continue
        t = np.int64(views.indices[e])
        base = 3 + p
        n, n_active = load_before(t, m, base, p0, matrices, plan, p, active)
        insert_candidate(m, n, p)
        fall = 0.0
        while True:
            n, n_active, _ = pass_sample(
                t,
                m,
                n,
                base,
                active,
                n_active,
                steps,
                enter_ptr,
                measure_ptr,
                measure_slot,
                measure_entry,
                shares,
                white,
                offsets,
                frames,
                u,
                v,
            )
            if e < stop and views.indices[e] == t:
                update_state(m, n, CAR_STATES, white, offsets, frames, e, 1.0, u, v)
                e += 1
                if e == stop:
                    n = leave_state(m, n, CAR_STATES, p)
                    base = 3
            n, n_active = drop_unseen(t, m, n, base, active, n_active, p, last_seen)
            start = plan.matrix_ptr[t]
            stored = n - (base - 3)
            fall += w_tt * (matrices[start] - m[0, 0])
            fall += w_nn * (matrices[start + stored + 1] - m[1, 1])
            if e == stop:
                tail, rho = 0.0, 0.0
                for i in range(n):
                    for j in range(n):
                        delta = matrices[start + i * n + j] - m[i, j]
                        tail += delta * future[start + i * n + j]
                        rho += delta * forget[start + i * n + j]
                if t == last or (rho < 0.5 and rho * tail <= TAIL_TOLERANCE * (fall + tail)):
                    fall += tail
                    break
            t += 1
        out[k] = fall


@njit(cache=True)
def offset_final(rows, steps, p0, views, plan, matrices, out):  # type: ignore[no-untyped-def]
    """Set out[k] (k, 6) to the covariance of the last state with candidate rows[k] added."""
    p, last = views.offsets.shape[2], steps.shape[0] - 1
    enter_ptr, measure_ptr, measure_slot = plan.enter_ptr, plan.measure_ptr, plan.measure_slot
    measure_entry, shares, last_seen = plan.measure_entry, plan.share, plan.last
    white, offsets, frames = views.white, views.offsets, views.frames
    size = plan.widest + p
    m = np.zeros((size, size))
    u, v = np.empty((2, size)), np.empty((2, size))
    active = np.empty(plan.camera.size + 1, dtype=np.int64)
    for k in range(rows.size):
        e, stop = views.indptr[rows[k]], views.indptr[rows[k] + 1]
        start = np.int64(views.indices[e]) if e < stop else last
        base = 3 + p
        n, n_active = load_before(start, m, base, p0, matrices, plan, p, active)
        insert_candidate(m, n, p)
        for t in range(start, last + 1):
            n, n_active, _ = pass_sample(
                t,
                m,
                n,
                base,
                active,
                n_active,
                steps,
                enter_ptr,
                measure_ptr,
                measure_slot,
                measure_entry,
                shares,
                white,
                offsets,
                frames,
                u,
                v,
            )
            if e < stop and views.indices[e] == t:
                update_state(m, n, CAR_STATES, white, offsets, frames, e, 1.0, u, v)
                e += 1
                if e == stop:
                    n = leave_state(m, n, CAR_STATES, p)
                    base = 3
            n, n_active = drop_unseen(t, m, n, base, active, n_active, p, last_seen)
        out[k, 0], out[k, 1], out[k, 2] = m[0, 0], m[0, 1], m[0, 2]
        out[k, 3], out[k, 4], out[k, 5] = m[1, 1], m[1, 2], m[2, 2]
