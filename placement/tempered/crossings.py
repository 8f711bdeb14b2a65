"""What a few cameras make of the stretch of road they see.

Let P be the covariance of the car's state at sample s, the cameras' first. Over the samples to
their last, e, with each camera's offsets marginalised (`placement.objectives.windows.offsets`),

    Σ log det = C + log det(I + P M),   P_e = A (P⁻¹ + M)⁻¹ Aᵀ + R

where A, M, R and C depend on the cameras, not on P: C and R are what comes of P = 0, A is how much
of an error at s is left at e, and M = Σ (H Φ)ᵀ (J⁻¹ + H P H ᵀ)⁻¹ H Φ sums what each measurement
tells of that error. So what a camera adds to others that are out of its sight depends on them
through six numbers, and costs two 3×3 determinants. A row holds A (9), M (6), R (6), C.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from placement.objectives.windows.entropy import cross_block
from placement.objectives.windows.filter import RESCALE, log_det_plus
from placement.objectives.windows.offsets import (
    enter_state,
    leave_state,
    set_initial,
    update_state,
)
from placement.tempered.process import prior_at, step_on

ROW = 22


@njit(cache=True)
def predict_wide(m, n, phi, f, q, t):  # type: ignore[no-untyped-def]
    """Step the car's part of `m` (n, n) and `phi` (n, 3) on to sample t."""
    a0, a1, a2 = f[t, 0], f[t, 1], f[t, 2]
    b0, b1, b2 = f[t, 3], f[t, 4], f[t, 5]
    c0, c1, c2 = f[t, 6], f[t, 7], f[t, 8]
    p = step_on((m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]), f, q, t)
    r0, r1, r2 = m[0], m[1], m[2]
    for j in range(3, n):
        x, y, z = r0[j], r1[j], r2[j]
        r0[j] = a0 * x + a1 * y + a2 * z
        r1[j] = b0 * x + b1 * y + b2 * z
        r2[j] = c0 * x + c1 * y + c2 * z
        m[j, 0], m[j, 1], m[j, 2] = r0[j], r1[j], r2[j]
    set_initial(m, p)
    for j in range(phi.shape[1]):
        x, y, z = phi[0, j], phi[1, j], phi[2, j]
        phi[0, j] = a0 * x + a1 * y + a2 * z
        phi[1, j] = b0 * x + b1 * y + b2 * z
        phi[2, j] = c0 * x + c1 * y + c2 * z


@njit(cache=True)
def learn(m, n, at, phi, told, white, offsets, frames, e, share, u, v):  # type: ignore[no-untyped-def]
    """Learn entry e of a camera whose offsets start at state `at`; return det(I + H P Hᵀ J).

    As `windows.offsets.update_state`; what it tells of the error at the start, `phi` (n, 3) from
    there to here, is added to `told` (6,). Without columns `phi` stays out of it.
    """
    p = offsets.shape[2]
    det, a00, a01, a11 = update_state(m, n, at, white, offsets, frames, e, share, u, v)
    if phi.shape[1] == 0:
        return det
    unit = 1.0 / math.sqrt(share)
    x0, x1, x2 = phi[0, 0], phi[0, 1], phi[0, 2]
    y0, y1, y2 = phi[1, 0], phi[1, 1], phi[1, 2]
    for k in range(p):
        b0, b1 = unit * offsets[e, 0, k], unit * offsets[e, 1, k]
        x0 += b0 * phi[at + k, 0]
        x1 += b0 * phi[at + k, 1]
        x2 += b0 * phi[at + k, 2]
        y0 += b1 * phi[at + k, 0]
        y1 += b1 * phi[at + k, 1]
        y2 += b1 * phi[at + k, 2]
    g0, g1, g2 = a00 * x0 + a01 * y0, a00 * x1 + a01 * y1, a00 * x2 + a01 * y2
    h0, h1, h2 = a01 * x0 + a11 * y0, a01 * x1 + a11 * y1, a01 * x2 + a11 * y2
    told[0] += x0 * g0 + y0 * h0
    told[1] += x0 * g1 + y0 * h1
    told[2] += x0 * g2 + y0 * h2
    told[3] += x1 * g1 + y1 * h1
    told[4] += x1 * g2 + y1 * h2
    told[5] += x2 * g2 + y2 * h2
    for i in range(n):
        w0, w1 = v[0, i], v[1, i]
        phi[i, 0] -= w0 * x0 + w1 * y0
        phi[i, 1] -= w0 * x1 + w1 * y1
        phi[i, 2] -= w0 * x2 + w1 * y2
    return det


@njit(cache=True)
def work_space(most, p):  # type: ignore[no-untyped-def]
    """Return m, phi, told, u, v, pointers, ends and places for at most `most` cameras."""
    size = 3 + most * p
    return (
        np.zeros((size, size)),
        np.zeros((size, 3)),
        np.zeros(6),
        np.empty((2, size)),
        np.empty((2, size)),
        np.empty(most, np.int64),
        np.empty(most, np.int64),
        np.empty(most, np.int64),
    )


@njit(cache=True)
def run_through(process, cameras, members, start, stop, space, phi, car):  # type: ignore[no-untyped-def]
    """Filter from the car's covariance in `space` at `start` to sample `stop`; return Σ log det.

    `members` are positions of cameras; those whose last entry lies beyond `stop` are learnt from as
    far as `stop`. Fills rows of `car` (t, 6) with the car's covariance after each sample, where it
    has rows. The cameras' own shares (`Cameras.own`) are still in the sum.
    """
    m, _, told, u, v, at_entry, end_entry, place = space
    p = cameras.offsets.shape[2]
    indices = cameras.indices
    f, q = process.f, process.q
    for c in range(members.size):
        at_entry[c] = cameras.indptr[members[c]]
        end_entry[c] = cameras.indptr[members[c] + 1]
        place[c] = -1
    n, log_sum, product = 3, 0.0, 1.0
    for t in range(start, stop + 1):
        if t > start:
            predict_wide(m, n, phi, f, q, t)
        for c in range(members.size):
            e = at_entry[c]
            if e == end_entry[c] or indices[e] != t:
                continue
            if place[c] < 0:
                place[c] = n
                n = enter_state(m, n, p, 1.0)
                phi[place[c] : n] = 0.0
            product *= learn(
                m, n, place[c], phi, told, cameras.white, cameras.offsets, cameras.frames, e,
                cameras.share, u, v,
            )  # fmt: skip
            if product > RESCALE:
                log_sum += math.log(product)
                product = 1.0
            at_entry[c] = e + 1
            if e + 1 == end_entry[c] and p:
                for i in range(place[c], n - p):
                    phi[i] = phi[i + p]
                n = leave_state(m, n, place[c], p)
                for d in range(members.size):
                    if place[d] > place[c]:
                        place[d] -= p
        if car.shape[0]:
            car[t, 0], car[t, 1], car[t, 2] = m[0, 0], m[0, 1], m[0, 2]
            car[t, 3], car[t, 4], car[t, 5] = m[1, 1], m[1, 2], m[2, 2]
    return log_sum + math.log(product)


@njit(cache=True)
def cross(process, cameras, members, start, stop, space, row):  # type: ignore[no-untyped-def]
    """Fill `row` (ROW,) with what `members` make of the samples start … stop, their windows."""
    m, phi, told = space[0], space[1], space[2]
    m[:3, :3] = 0.0
    phi[:3] = np.eye(3)
    told[:] = 0.0
    log_sum = run_through(process, cameras, members, start, stop, space, phi, np.empty((0, 6)))
    for c in range(members.size):
        log_sum -= cameras.own[members[c]]
    for i in range(3):
        for j in range(3):
            row[3 * i + j] = phi[i, j]
    row[9:15] = told
    row[15], row[16], row[17] = m[0, 0], m[0, 1], m[0, 2]
    row[18], row[19], row[20] = m[1, 1], m[1, 2], m[2, 2]
    row[21] = log_sum


@njit(cache=True, inline="always")
def worth(p, row):  # type: ignore[no-untyped-def]
    """Return the log det of a row's cameras where the car's covariance at their start is `p`."""
    g = (row[9], row[10], row[11], row[12], row[13], row[14])
    return row[21] + log_det_plus(p, g)


@njit(cache=True)
def cross_each(process, cameras, rows):  # type: ignore[no-untyped-def]
    """Fill `rows` (n, ROW) with what each camera makes of its own stretch; of the blind nothing."""
    space = work_space(1, cameras.offsets.shape[2])
    for i in range(rows.shape[0]):
        if cameras.last[i] < 0:
            rows[i] = 0.0
            rows[i, 0], rows[i, 4], rows[i, 8] = 1.0, 1.0, 1.0
            continue
        cross(
            process, cameras, np.arange(i, i + 1), cameras.first[i], cameras.last[i], space, rows[i]
        )


@njit(cache=True)
def after(p, row):  # type: ignore[no-untyped-def]
    """Return the car's covariance behind a stretch."""
    return cross_block(p, row)[0]


@njit(cache=True)
def alone(process, cameras, rows, out):  # type: ignore[no-untyped-def]
    """Add each camera's log det on the bare chain to `out` (n,)."""
    for i in range(out.size):
        if cameras.last[i] >= 0:
            out[i] = worth(prior_at(process, cameras.first[i]), rows[i])
