"""The covariance at the end of a drive as a function of the covariance at any sample.

From sample t to the last, P ↦ A (P⁻¹ + Γ)⁻¹ Aᵀ + C. Two such maps compose to a third, so one
backward pass gives all of them, and a candidate is filtered over its own window only.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from models.geometry import FloatArray
from placement.objectives.windows.entropy import cross_block
from placement.objectives.windows.filter import parallel, predict, put6, row6, update

LOG_2_PI_E_CUBED = 3.0 * math.log(2.0 * math.pi * math.e)


@njit(cache=True, inline="always")
def log_det(p):  # type: ignore[no-untyped-def]
    """Return log det P of a positive definite (6,), −inf where it is singular."""
    if p[0] <= 0.0:
        return -np.inf
    l10, l20 = p[1] / p[0], p[2] / p[0]
    d1 = p[3] - l10 * p[1]
    if d1 <= 0.0:
        return -np.inf
    e = p[4] - l20 * p[1]
    d2 = p[5] - l20 * p[2] - e * e / d1
    if d2 <= 0.0:
        return -np.inf
    return math.log(p[0]) + math.log(d1) + math.log(d2)


@njit(cache=True, inline="always")
def full(p):  # type: ignore[no-untyped-def]
    """Return a symmetric (6,) as (3, 3)."""
    return np.array([[p[0], p[1], p[2]], [p[1], p[3], p[4]], [p[2], p[4], p[5]]])


@njit(cache=True)
def transfers_to_end(steps, total, transfers):  # type: ignore[no-untyped-def]
    """Fill `transfers` (t, N_TRANSFER), the map from the covariance after t to the last one."""
    n = steps.shape[0]
    transfers[:] = 0.0
    a2 = np.eye(3)
    g2 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    c2 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for t in range(n - 1, -1, -1):
        m = transfers[t]
        for i in range(3):
            for j in range(3):
                m[3 * i + j] = a2[i, j]
        put6(transfers[:, 9:15], t, g2)
        put6(transfers[:, 15:21], t, c2)
        if t == 0:
            break
        # the step to t and its update as a map of its own, from covariance 0
        s = steps[t]
        q = predict((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), s)
        jtt, jtn, jnn = total[t, 0], total[t, 1], total[t, 2]
        det_j = jtt * jnn - jtn * jtn
        q0, q1, q2, q3, q4, q5, det = update(q, jtt, jtn, jnn)
        k = np.zeros((3, 3))
        k[0, 0] = (jtt + det_j * q[3]) / det
        k[0, 1] = k[1, 0] = (jtn - det_j * q[1]) / det
        k[1, 1] = (jnn + det_j * q[0]) / det
        f = np.array([[s[0], s[1], s[2]], [-s[1], s[0], s[3]], [0.0, 0.0, 1.0]])
        a1 = f - full(q) @ k @ f
        c1 = (q0, q1, q2, q3, q4, q5)
        met = full(parallel(g2, c1))
        g1 = f.T @ k @ f + a1.T @ met @ a1
        c = a2 @ full(parallel(c1, g2)) @ a2.T
        a2 = a2 @ (a1 - full(c1) @ met @ a1)
        g2 = (g1[0, 0], g1[0, 1], g1[0, 2], g1[1, 1], g1[1, 2], g1[2, 2])
        c2 = (
            c[0, 0] + c2[0],
            c[0, 1] + c2[1],
            c[0, 2] + c2[2],
            c[1, 1] + c2[3],
            c[1, 2] + c2[4],
            c[2, 2] + c2[5],
        )


@njit(cache=True)
def window_final_falls(  # type: ignore[no-untyped-def]
    indptr, indices, blocks, frames, rows, steps, total, before, transfers, base, out
):
    """Set out[k] to `base` − log det P_T with candidate rows[k]; base = log det P_T without."""
    isotropic = blocks.shape[1] == 1
    for k in range(rows.size):
        first, stop = indptr[rows[k]], indptr[rows[k] + 1]
        if first == stop:
            out[k] = 0.0
            continue
        t = np.int64(indices[first])
        p = row6(before, t)
        e = first
        while True:
            jtt, jtn, jnn = total[t, 0], total[t, 1], total[t, 2]
            if indices[e] == t:
                b = frames * np.float64(blocks[e, 0])
                if isotropic:
                    jtt, jnn = jtt + b, jnn + b
                else:
                    jtt += b
                    jtn += frames * np.float64(blocks[e, 1])
                    jnn += frames * np.float64(blocks[e, 2])
                e += 1
            q0, q1, q2, q3, q4, q5, _ = update(p, jtt, jtn, jnn)
            p = (q0, q1, q2, q3, q4, q5)
            if e == stop:
                break
            t += 1
            p = predict(p, steps[t])
        end, _ = cross_block(p, transfers[t])
        out[k] = base - log_det(end)


def negative_entropy(covariance: FloatArray) -> float:
    """Return −½ log((2πe)³ det P) of a covariance (6,), in nats."""
    return -0.5 * float(LOG_2_PI_E_CUBED + log_det(covariance))


def half_inverse(covariance: FloatArray) -> FloatArray:
    """Return ½ P⁻¹ (6,): the derivative of ½ log det P."""
    tt, tn, th, nn, nh, hh = covariance
    inverse = np.linalg.inv(np.array([[tt, tn, th], [tn, nn, nh], [th, nh, hh]]))
    return np.asarray(0.5 * inverse[np.triu_indices(3)], dtype=np.float64)


def require_finite(score: float) -> None:
    """Refuse a drive that ends without any uncertainty to speak of."""
    if not math.isfinite(score):
        raise ValueError(
            "vehicle odometry noise and initial_sigma leave the final state exactly known "
            "in some direction, so its entropy is not finite"
        )
