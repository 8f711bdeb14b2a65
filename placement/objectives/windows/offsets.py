"""The filter with persistent camera offsets: states (e_t, e_n, e_θ) and p offsets a camera in view.

A camera's offsets o ~ N(0, I) shift all its reports: z_t = e_t + B_t o + white noise. Estimating
them jointly with the car is the Bayes-optimal filter, so the covariance of the first three states
is that with the offsets marginalised out, at every sample. A camera joins the state at the first
sample it sees and leaves it after the last; dropping its rows then is exact, as no later
measurement involves it.

Arrays of one placement hold, for each sample, a square matrix over the states that remain after
it: three, then p for each camera in view, ordered by the first sample it sees.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.objectives.navigation_chain import Drive
from placement.objectives.windows.filter import predict

# The car's own; a kernel that is handed a plain 3 is compiled for that number alone, and again.
CAR_STATES = np.int64(3)


class Views(NamedTuple):
    """What all candidates see: CSR rows with white information and offset Jacobians."""

    indptr: IntArray
    indices: NDArray[np.int32]
    white: NDArray[np.float32]  # (nnz, 1 | 3), one frame
    offsets: NDArray[np.float32]  # (nnz, 2, p)
    frames: float


class Plan(NamedTuple):
    """When the cameras of one placement enter, measure and leave; slots are ordered by entry."""

    camera: IntArray  # (k,) candidate of each slot
    share: FloatArray  # (k,) x of each slot: 1, or less where the choice is fractional
    last: IntArray  # (k,) last sample of each slot
    enter_ptr: IntArray  # (t + 1,) slots enter_ptr[t]:enter_ptr[t + 1] enter at sample t
    measure_ptr: IntArray  # (t + 1,) into the next two
    measure_slot: IntArray
    measure_entry: IntArray
    in_view_ptr: IntArray  # (t + 1,) into the slots that remain after each sample
    in_view: IntArray
    matrix_ptr: IntArray  # (t + 1,) into flat storage of the square matrices after each sample
    widest: int  # most states at any moment


def views_of(drive: Drive) -> Views:
    """Lay out the cameras of a drive with offsets for the kernels."""
    info = drive.information
    if info.white is None or info.offsets is None:
        raise ValueError("information.white and information.offsets are needed, got None")
    return Views(
        np.ascontiguousarray(info.indptr, dtype=np.int64),
        np.ascontiguousarray(info.indices, dtype=np.int32),
        np.ascontiguousarray(info.white, dtype=np.float32),
        np.ascontiguousarray(info.offsets, dtype=np.float32),
        float(info.frames_per_sample),
    )


def make_plan(
    views: Views, selected: IntArray, n_samples: int, x: FloatArray | None = None
) -> Plan:
    """Order the cameras of a placement by when they come into view; those that see nothing go.

    A camera chosen to a fraction x (c,) contributes x times its information, offsets
    marginalised: its white information counts x times and its offsets' variance is 1 / x.
    """
    seeing = selected[views.indptr[selected + 1] > views.indptr[selected]]
    first = views.indices[views.indptr[seeing]].astype(np.int64)
    last = views.indices[views.indptr[seeing + 1] - 1].astype(np.int64)
    order = np.lexsort((seeing, first))
    camera, first, last = seeing[order], first[order], last[order]
    counts = views.indptr[camera + 1] - views.indptr[camera]
    slot = np.repeat(np.arange(camera.size), counts)
    entry = np.concatenate(
        [np.arange(views.indptr[i], views.indptr[i + 1]) for i in camera]
        or [np.empty(0, dtype=np.int64)]
    )
    when = views.indices[entry].astype(np.int64)
    by_time = np.lexsort((slot, when))
    samples = np.arange(n_samples)
    after = (first[None, :] <= samples[:, None]) & (samples[:, None] < last[None, :])
    during = (first[None, :] <= samples[:, None]) & (samples[:, None] <= last[None, :])
    p = views.offsets.shape[2]
    states = 3 + p * after.sum(axis=1)
    return Plan(
        camera,
        np.ones(camera.size) if x is None else x[camera],
        last,
        np.searchsorted(first, np.arange(n_samples + 1)),
        np.searchsorted(when[by_time], np.arange(n_samples + 1)),
        slot[by_time],
        entry[by_time],
        np.concatenate([[0], np.cumsum(after.sum(axis=1))]),
        np.ascontiguousarray(np.nonzero(after)[1]),  # strided, kernels would be compiled again
        np.concatenate([[0], np.cumsum(states * states)]),
        int(3 + p * max(during.sum(axis=1).max(initial=0), 0)),
    )


@njit(cache=True)
def enter_state(m, n, p, diagonal):  # type: ignore[no-untyped-def]
    """Append p independent states with that diagonal; return their number."""
    for i in range(n, n + p):
        for j in range(n + p):
            m[i, j] = 0.0
            m[j, i] = 0.0
        m[i, i] = diagonal
    return n + p


@njit(cache=True)
def leave_state(m, n, at, p):  # type: ignore[no-untyped-def]
    """Drop the p states from `at` on; return how many remain."""
    for i in range(n):
        for j in range(at, n - p):
            m[i, j] = m[i, j + p]
    for i in range(at, n - p):
        for j in range(n - p):
            m[i, j] = m[i + p, j]
    return n - p


@njit(cache=True)
def predict_state(m, n, step):  # type: ignore[no-untyped-def]
    """Replace the first three states' rows and columns by those one step on."""
    c, s, y, x = step[0], step[1], step[2], step[3]
    q = predict((m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]), step)
    m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2] = q
    m[1, 0], m[2, 0], m[2, 1] = q[1], q[2], q[4]
    for j in range(3, n):
        a, b, h = m[0, j], m[1, j], m[2, j]
        m[0, j] = c * a + s * b + y * h
        m[1, j] = c * b - s * a + x * h
        m[j, 0], m[j, 1] = m[0, j], m[1, j]


@njit(cache=True)
def white_block(white, frames, e, share):  # type: ignore[no-untyped-def]
    """Return `share` times entry e's white information (tt, tn, nn), all frames of its sample."""
    factor = share * frames
    if white.shape[1] == 1:
        j = factor * np.float64(white[e, 0])
        return j, 0.0, j
    return (
        factor * np.float64(white[e, 0]),
        factor * np.float64(white[e, 1]),
        factor * np.float64(white[e, 2]),
    )


@njit(cache=True)
def innovation(s00, s01, s11, jtt, jtn, jnn):  # type: ignore[no-untyped-def]
    """Return det(I + S J) and A = (J⁻¹ + S)⁻¹ (tt, tn, nn) for S = H P Hᵀ; J may be singular."""
    det_j = jtt * jnn - jtn * jtn
    det = 1.0 + s00 * jtt + 2.0 * s01 * jtn + s11 * jnn + (s00 * s11 - s01 * s01) * det_j
    return det, (jtt + det_j * s11) / det, (jtn - det_j * s01) / det, (jnn + det_j * s00) / det


@njit(cache=True)
def condition(m, n, a00, a01, a11, u, v):  # type: ignore[no-untyped-def]
    """Condition P, the first n states of `m`, on a measurement: P −= P Hᵀ A H P.

    `u` (2, n) holds P Hᵀ, `v` (2, n) gets P HᵀA. Rows as slices and both components in one pass:
    twice as fast as indexing in two dimensions.
    """
    u0, u1, v0, v1 = u[0], u[1], v[0], v[1]
    for i in range(n):
        v0[i] = a00 * u0[i] + a01 * u1[i]
        v1[i] = a01 * u0[i] + a11 * u1[i]
    for i in range(n):
        x0, x1 = v0[i], v1[i]
        row = m[i]
        for j in range(n):
            row[j] -= x0 * u0[j] + x1 * u1[j]


@njit(cache=True)
def update_state(m, n, at, white, offsets, frames, e, share, u, v):  # type: ignore[no-untyped-def]
    """Learn entry e of a camera whose offsets start at state `at`: det(I + H P Hᵀ J), and A.

    A = (J⁻¹ + H P Hᵀ)⁻¹ is (tt, tn, nn). The states are offsets times √share, so that their prior
    variance is 1. Leaves P Hᵀ in `u` (2, n) and P HᵀA in `v` (2, n), for the adjoint.
    """
    p = offsets.shape[2]
    unit = 1.0 / math.sqrt(share)
    u0, u1 = u[0], u[1]
    for i in range(n):
        u0[i], u1[i] = m[0, i], m[1, i]
    for q in range(p):
        b0, b1 = unit * offsets[e, 0, q], unit * offsets[e, 1, q]
        row = m[at + q]
        for i in range(n):
            u0[i] += b0 * row[i]
            u1[i] += b1 * row[i]
    s00, s01, s11 = u0[0], u0[1], u1[1]
    for q in range(p):
        b0, b1 = unit * offsets[e, 0, q], unit * offsets[e, 1, q]
        s00 += b0 * u0[at + q]
        s01 += b1 * u0[at + q]
        s11 += b1 * u1[at + q]
    jtt, jtn, jnn = white_block(white, frames, e, share)
    det, a00, a01, a11 = innovation(s00, s01, s11, jtt, jtn, jnn)
    condition(m, n, a00, a01, a11, u, v)
    return det, a00, a01, a11


@njit(cache=True)
def find(active, n_active, slot):  # type: ignore[no-untyped-def]
    """Return where `slot` stands among the active ones."""
    for a in range(n_active):
        if active[a] == slot:
            return a
    return -1


@njit(cache=True)
def pass_sample(  # type: ignore[no-untyped-def]
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
):
    """Advance to sample t and learn what the placement's cameras see there.

    Offsets of active slots start at state `base`. Cameras seen last at t stay in the state.
    Returns the numbers of states and active slots, and the product of determinants, which a few
    dozen cameras in one sample do not bring near the largest number.
    """
    p = offsets.shape[2]
    if t > 0:
        predict_state(m, n, steps[t])
    for slot in range(enter_ptr[t], enter_ptr[t + 1]):
        n = enter_state(m, n, p, 1.0)
        active[n_active] = slot
        n_active += 1
    product = 1.0
    for k in range(measure_ptr[t], measure_ptr[t + 1]):
        slot = measure_slot[k]
        at = base + p * find(active, n_active, slot)
        share = shares[slot]
        det, _, _, _ = update_state(m, n, at, white, offsets, frames, measure_entry[k], share, u, v)
        product *= det
    return n, n_active, product


@njit(cache=True)
def drop_unseen(t, m, n, base, active, n_active, p, last):  # type: ignore[no-untyped-def]
    """Drop the offsets of cameras that see nothing after sample t; return the two numbers."""
    a = 0
    while a < n_active:
        if last[active[a]] <= t:
            n = leave_state(m, n, base + p * a, p)
            for b in range(a, n_active - 1):
                active[b] = active[b + 1]
            n_active -= 1
        else:
            a += 1
    return n, n_active


@njit(cache=True)
def store(flat, start, m, n):  # type: ignore[no-untyped-def]
    """Write the leading n × n of `m` into flat storage."""
    for i in range(n):
        for j in range(n):
            flat[start + i * n + j] = m[i, j]


@njit(cache=True)
def set_initial(m, p0):  # type: ignore[no-untyped-def]
    """Write a covariance (6,) as the three states of `m`."""
    m[0, 0], m[1, 1], m[2, 2] = p0[0], p0[3], p0[5]
    m[0, 1], m[0, 2], m[1, 2] = p0[1], p0[2], p0[4]
    m[1, 0], m[2, 0], m[2, 1] = p0[1], p0[2], p0[4]


@njit(cache=True)
def filter_offsets(steps, p0, views, plan, matrices, log_before):  # type: ignore[no-untyped-def]
    """Filter forward; fill the covariance after each sample and earlier samples' log dets.

    Returns Σ log det over all samples, offsets included: the caller takes off their own share.
    """
    n_samples, p = steps.shape[0], views.offsets.shape[2]
    enter_ptr, measure_ptr, measure_slot = plan.enter_ptr, plan.measure_ptr, plan.measure_slot
    measure_entry, shares, last_seen = plan.measure_entry, plan.share, plan.last
    white, offsets, frames = views.white, views.offsets, views.frames
    m = np.zeros((plan.widest, plan.widest))
    u, v = np.empty((2, plan.widest)), np.empty((2, plan.widest))
    active = np.empty(plan.camera.size, dtype=np.int64)
    set_initial(m, p0)
    n, n_active, log_sum = CAR_STATES, np.int64(0), 0.0
    for t in range(n_samples):
        log_before[t] = log_sum
        n, n_active, det = pass_sample(
            t,
            m,
            n,
            CAR_STATES,
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
        log_sum += math.log(det)
        n, n_active = drop_unseen(t, m, n, CAR_STATES, active, n_active, p, last_seen)
        store(matrices, plan.matrix_ptr[t], m, n)
    return log_sum


@njit(cache=True)
def offset_shares(views, out):  # type: ignore[no-untyped-def]
    """Fill out[i] with log det(I + Σ_t BᵀWB): what camera i would tell about its offsets alone.

    The chain rule: joint log det of trajectory and offsets, less these, is the trajectory's.
    """
    p = views.offsets.shape[2]
    for i in range(out.size):
        m = np.eye(p)
        for e in range(views.indptr[i], views.indptr[i + 1]):
            jtt, jtn, jnn = white_block(views.white, views.frames, e, 1.0)
            for a in range(p):
                b0, b1 = np.float64(views.offsets[e, 0, a]), np.float64(views.offsets[e, 1, a])
                c0, c1 = jtt * b0 + jtn * b1, jtn * b0 + jnn * b1
                for b in range(p):
                    m[a, b] += c0 * views.offsets[e, 0, b] + c1 * views.offsets[e, 1, b]
        out[i] = log_det_definite(m, p)


@njit(cache=True)
def log_det_definite(m, n):  # type: ignore[no-untyped-def]
    """Return log det of the leading n × n of a positive definite matrix, which is overwritten."""
    found = 0.0
    for k in range(n):
        pivot = m[k, k]
        found += math.log(pivot)
        for i in range(k + 1, n):
            factor = m[i, k] / pivot
            for j in range(k + 1, n):
                m[i, j] -= factor * m[k, j]
    return found


def flat(plan: Plan) -> FloatArray:
    """Return storage for one square matrix a sample."""
    return np.empty(int(plan.matrix_ptr[-1]))
