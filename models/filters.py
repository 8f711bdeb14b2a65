"""The filter: an EKF on (x, y, heading), and the Schmidt–Kalman filter that contains it.

The estimate is the present pose and, while measurements are under way, copies of past positions
(`remember`), so that a measurement that arrives late updates the past position it speaks of, and
through the correlations the present one: exactly what it would have done in time, but for what
happened since (stochastic cloning; Roumeliotis and Burdick 2002).

Each camera's persistent offset b is a *considered* state: it has unit covariance for ever, is
never estimated, and only its cross-covariance with the estimate is carried. A position measured
by camera i is z = position + D_i b_i + v with v ~ N(0, R). With C_i = E[e b_iᵀ] of the error e:

    S  = P_hh + C_i,h Dᵀ + D C_i,hᵀ + D Dᵀ + R
    K  = (P_·h + C_i Dᵀ) S⁻¹
    P ← P − K S Kᵀ,    C_j ← C_j − K (C_j,h + δ_ij D)   for every camera j met so far

(Schmidt 1966; h are the two rows of the position spoken of). C_j matters to nobody until camera j
measures again, so a camera that cannot see the car again may leave: dropping its C_j is exact.
With no considered states this is the EKF.

Arrays, changed in place: mean (N,), covariance (N, N), cross (k, N, p), N = 3 + 2·slots. A slot
that holds nothing has zero rows and columns, which no update changes. `met` (k,) lists the cameras
with a cross-covariance, the first `n_met` of it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from models.geometry import FloatArray, IntArray

POSE = 3

UPDATED, GATED, BROKEN = 0, 1, 2
"""What `update` says: used; rejected by the gate; the covariance is not positive."""


@njit(cache=True)
def predict(
    mean: FloatArray,
    covariance: FloatArray,
    cross: FloatArray,
    met: IntArray,
    n_met: int,
    forward: float,
    left: float,
    turned: float,
    rolled: float,
    noise: FloatArray,
) -> None:
    """Move the pose by odometry (forward, left, turned) in its own frame, rolled metres long.

    noise (3,): densities of heading, along, across, as `OdometryNoise.as_array`. The noise of the
    step is `OdometryNoise.covariance(rolled)`, laid along the mean heading of the step.
    """
    c, s = math.cos(mean[2]), math.sin(mean[2])
    east, north = c * forward - s * left, s * forward + c * left
    middle = mean[2] + 0.5 * turned
    mean[0] += east
    mean[1] += north
    mean[2] += turned
    size = len(mean)
    for j in range(size):
        covariance[0, j] -= north * covariance[2, j]
        covariance[1, j] += east * covariance[2, j]
    for i in range(size):
        covariance[i, 0] -= north * covariance[i, 2]
        covariance[i, 1] += east * covariance[i, 2]
    for m in range(n_met):
        block = cross[met[m]]
        for q in range(block.shape[1]):
            block[0, q] -= north * block[2, q]
            block[1, q] += east * block[2, q]
    heading2 = noise[0] * noise[0] * rolled
    along2 = noise[1] * noise[1] * rolled
    across2 = noise[2] * noise[2] * rolled + heading2 * rolled * rolled / 3.0
    lever = 0.5 * heading2 * rolled
    c, s = math.cos(middle), math.sin(middle)
    covariance[0, 0] += c * c * along2 + s * s * across2
    covariance[1, 1] += s * s * along2 + c * c * across2
    mixed = c * s * (along2 - across2)
    covariance[0, 1] += mixed
    covariance[1, 0] += mixed
    covariance[0, 2] -= s * lever
    covariance[2, 0] -= s * lever
    covariance[1, 2] += c * lever
    covariance[2, 1] += c * lever
    covariance[2, 2] += heading2


@njit(cache=True)
def remember(
    mean: FloatArray,
    covariance: FloatArray,
    cross: FloatArray,
    met: IntArray,
    n_met: int,
    slot: int,
) -> None:
    """Copy the present position into `slot`, fully correlated with the present."""
    size = len(mean)
    for a in range(2):
        row = POSE + 2 * slot + a
        mean[row] = mean[a]
        for j in range(size):
            covariance[row, j] = covariance[a, j]
        for i in range(size):
            covariance[i, row] = covariance[i, a]
        for m in range(n_met):
            block = cross[met[m]]
            for q in range(block.shape[1]):
                block[row, q] = block[a, q]


@njit(cache=True)
def forget(
    mean: FloatArray,
    covariance: FloatArray,
    cross: FloatArray,
    met: IntArray,
    n_met: int,
    slot: int,
) -> None:
    """Empty `slot`."""
    for a in range(2):
        row = POSE + 2 * slot + a
        mean[row] = 0.0
        covariance[row, :] = 0.0
        covariance[:, row] = 0.0
        for m in range(n_met):
            cross[met[m], row, :] = 0.0


@njit(cache=True)
def update(
    mean: FloatArray,
    covariance: FloatArray,
    cross: FloatArray,
    met: IntArray,
    n_met: int,
    row: int,
    camera: int,
    x: float,
    y: float,
    offsets: FloatArray,
    white: FloatArray,
    gate: float,
    work: FloatArray,
    innovation: FloatArray,
) -> int:
    """Take in the position (x, y) that a camera measured; return UPDATED, GATED or BROKEN.

    row: 0 for the present position, POSE + 2·slot for a remembered one. camera: the index of
    its considered block, which must be in `met`, or −1 for a filter that considers none; then
    `offsets` is not read. offsets (2, p): the Jacobian D. white: (R_xx, R_xy, R_yy). gate: the
    largest squared normalised innovation taken, inf for all. work (N, 4): scratch.
    innovation (3,), written: the innovation whitened by S (two numbers), and its squared norm.
    """
    size = len(mean)
    width = cross.shape[2]
    gain_t, gain = work[:, :2], work[:, 2:]  # P_·h + C Dᵀ, and K
    s_xx, s_xy, s_yy = white[0], white[1], white[2]
    for i in range(size):
        gain_t[i, 0] = covariance[i, row]
        gain_t[i, 1] = covariance[i, row + 1]
    if camera >= 0:
        block = cross[camera]
        for i in range(size):
            for q in range(width):
                gain_t[i, 0] += block[i, q] * offsets[0, q]
                gain_t[i, 1] += block[i, q] * offsets[1, q]
        for q in range(width):
            s_xx += (block[row, q] + offsets[0, q]) * offsets[0, q]
            s_yy += (block[row + 1, q] + offsets[1, q]) * offsets[1, q]
            s_xy += (block[row + 1, q] + offsets[1, q]) * offsets[0, q]
    s_xx += gain_t[row, 0]
    s_xy += gain_t[row, 1]
    s_yy += gain_t[row + 1, 1]
    determinant = s_xx * s_yy - s_xy * s_xy
    # not (a > 0) also catches NaN
    if not (s_xx > 0.0 and determinant > 0.0 and math.isfinite(determinant)):
        return BROKEN
    v_x, v_y = x - mean[row], y - mean[row + 1]
    root = math.sqrt(s_xx)
    innovation[0] = v_x / root
    innovation[1] = (v_y - s_xy / s_xx * v_x) / math.sqrt(determinant / s_xx)
    innovation[2] = innovation[0] * innovation[0] + innovation[1] * innovation[1]
    if innovation[2] > gate:
        return GATED
    for i in range(size):
        a, b = gain_t[i, 0], gain_t[i, 1]
        gain[i, 0] = (s_yy * a - s_xy * b) / determinant
        gain[i, 1] = (s_xx * b - s_xy * a) / determinant
        mean[i] += gain[i, 0] * v_x + gain[i, 1] * v_y
    for i in range(size):
        for j in range(i, size):
            # K S Kᵀ = (P_·h + C Dᵀ) Kᵀ
            value = covariance[i, j] - gain_t[i, 0] * gain[j, 0] - gain_t[i, 1] * gain[j, 1]
            covariance[i, j] = value
            covariance[j, i] = value
    for m in range(n_met):
        block = cross[met[m]]
        for q in range(width):
            seen_x, seen_y = block[row, q], block[row + 1, q]
            if met[m] == camera:
                seen_x += offsets[0, q]
                seen_y += offsets[1, q]
            for i in range(size):
                block[i, q] -= gain[i, 0] * seen_x + gain[i, 1] * seen_y
    for i in range(POSE):
        if not covariance[i, i] >= 0.0:
            return BROKEN
    return UPDATED


@njit(cache=True)
def normalised_error(covariance: FloatArray, e_x: float, e_y: float, e_heading: float) -> float:
    """Return e P⁻¹ eᵀ of the pose by elimination; −1 where P is not positive definite."""
    p_xx = covariance[0, 0]
    if not p_xx > 0.0:
        return -1.0
    l_y, l_h = covariance[0, 1] / p_xx, covariance[0, 2] / p_xx
    d_y = covariance[1, 1] - l_y * covariance[0, 1]
    if not d_y > 0.0:
        return -1.0
    mixed = covariance[1, 2] - l_y * covariance[0, 2]
    l_hy = mixed / d_y
    d_h = covariance[2, 2] - l_h * covariance[0, 2] - l_hy * mixed
    if not d_h > 0.0:
        return -1.0
    r_y = e_y - l_y * e_x
    r_h = e_heading - l_h * e_x - l_hy * r_y
    total: float = e_x * e_x / p_xx + r_y * r_y / d_y + r_h * r_h / d_h
    return total


def new_estimate(
    pose: tuple[float, float, float],
    covariance: FloatArray,
    *,
    slots: int = 0,
    cameras: int = 0,
    offsets: int = 0,
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """Return the arrays (mean, covariance, cross, met) of a filter that starts at `pose`."""
    size = POSE + 2 * slots
    mean = np.zeros(size)
    mean[:POSE] = pose
    full = np.zeros((size, size))
    full[:POSE, :POSE] = covariance
    return mean, full, np.zeros((cameras, size, offsets)), np.zeros(cameras, dtype=np.int64)
