"""The 3-state filter along the odometry chain: scalar kernels, forward and backward messages.

Symmetric 3×3 matrices are six numbers (tt, tn, tθ, nn, nθ, θθ), information about position three
(tt, tn, nn). The update is written without subtracting large covariances: with P_p the position
block of P and A = (J + det J · adj P_p) / det(I + P_p J),

    P⁺ = P − P H ᵀ A H P,   P⁺_p = (P_p + det P_p · adj J) / det(I + P_p J),

so nothing is inverted and P or J may be singular (an exactly known initial heading).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from models.geometry import FloatArray

BLOCK = 32  # samples a stored transfer spans; a gap shorter than two of them is walked
RESCALE = 1e200  # products of determinants are folded into the logarithm beyond this


@njit(cache=True, inline="always")
def predict(p, step):  # type: ignore[no-untyped-def]
    """Return F P Fᵀ + Q (6,) for one row of `chain_steps`."""
    ptt, ptn, pth, pnn, pnh, phh = p
    c, s, y, x = step[0], step[1], step[2], step[3]
    a0 = c * ptt + s * ptn + y * pth
    a1 = c * ptn + s * pnn + y * pnh
    a2 = c * pth + s * pnh + y * phh
    b0 = c * ptn - s * ptt + x * pth
    b1 = c * pnn - s * ptn + x * pnh
    b2 = c * pnh - s * pth + x * phh
    return (
        c * a0 + s * a1 + y * a2 + step[4],
        c * a1 - s * a0 + x * a2 + step[5],
        a2 + step[6],
        c * b1 - s * b0 + x * b2 + step[7],
        b2 + step[8],
        phh + step[9],
    )


@njit(cache=True, inline="always")
def update(p, jtt, jtn, jnn):  # type: ignore[no-untyped-def]
    """Return P⁺ (6,) and det(I + P_p J) on learning J about the position."""
    ptt, ptn, pth, pnn, pnh, phh = p
    det_j = jtt * jnn - jtn * jtn
    det_p = ptt * pnn - ptn * ptn
    det = 1.0 + ptt * jtt + 2.0 * ptn * jtn + pnn * jnn + det_p * det_j
    inv = 1.0 / det
    att = (jtt + det_j * pnn) * inv
    atn = (jtn - det_j * ptn) * inv
    ann = (jnn + det_j * ptt) * inv
    # heading rows: P_hp (I + J P_p)⁻¹ with the inverse as adjugate over determinant
    ftt = 1.0 + jtn * ptn + jnn * pnn
    ftn = -(jtt * ptn + jtn * pnn)
    fnt = -(jtn * ptt + jnn * ptn)
    fnn = 1.0 + jtt * ptt + jtn * ptn
    return (
        (ptt + det_p * jnn) * inv,
        (ptn - det_p * jtn) * inv,
        (pth * ftt + pnh * fnt) * inv,
        (pnn + det_p * jtt) * inv,
        (pth * ftn + pnh * fnn) * inv,
        phh - (pth * pth * att + 2.0 * pth * pnh * atn + pnh * pnh * ann),
        det,
    )


@njit(cache=True, inline="always")
def log_det_plus(p, g):  # type: ignore[no-untyped-def]
    """Return log det(I + P G) of two positive semidefinite (6,) by Cholesky of I + LᵀGL."""
    l11 = math.sqrt(max(p[0], 0.0))
    i1 = 1.0 / l11 if l11 > 0.0 else 0.0
    l21, l31 = p[1] * i1, p[2] * i1
    l22 = math.sqrt(max(p[3] - l21 * l21, 0.0))
    i2 = 1.0 / l22 if l22 > 0.0 else 0.0
    l32 = (p[4] - l31 * l21) * i2
    l33 = math.sqrt(max(p[5] - l31 * l31 - l32 * l32, 0.0))
    g0, g1, g2, g3, g4, g5 = g
    # columns of G L
    u0, u1, u2 = g0 * l11 + g1 * l21 + g2 * l31, g1 * l11 + g3 * l21 + g4 * l31, 0.0
    u2 = g2 * l11 + g4 * l21 + g5 * l31
    v1, v2 = g3 * l22 + g4 * l32, g4 * l22 + g5 * l32
    w2 = g5 * l33
    m11 = 1.0 + l11 * u0 + l21 * u1 + l31 * u2
    m21 = l22 * u1 + l32 * u2
    m31 = l33 * u2
    m22 = 1.0 + l22 * v1 + l32 * v2
    m32 = l33 * v2
    m33 = 1.0 + l33 * w2
    d2 = m22 - m21 * m21 / m11
    e32 = m32 - m31 * m21 / m11
    d3 = m33 - m31 * m31 / m11 - e32 * e32 / d2
    # every pivot of I + (something positive semidefinite) is at least 1
    return math.log(m11) + math.log(max(d2, 1.0)) + math.log(max(d3, 1.0))


@njit(cache=True, inline="always")
def parallel(a, b):  # type: ignore[no-untyped-def]
    """Return (A⁻¹ + B)⁻¹ = (I + A B)⁻¹ A (6,) of positive semidefinite (6,), A maybe singular."""
    a0, a1, a2, a3, a4, a5 = a
    b0, b1, b2, b3, b4, b5 = b
    m00 = 1.0 + a0 * b0 + a1 * b1 + a2 * b2
    m01 = a0 * b1 + a1 * b3 + a2 * b4
    m02 = a0 * b2 + a1 * b4 + a2 * b5
    m10 = a1 * b0 + a3 * b1 + a4 * b2
    m11 = 1.0 + a1 * b1 + a3 * b3 + a4 * b4
    m12 = a1 * b2 + a3 * b4 + a4 * b5
    m20 = a2 * b0 + a4 * b1 + a5 * b2
    m21 = a2 * b1 + a4 * b3 + a5 * b4
    m22 = 1.0 + a2 * b2 + a4 * b4 + a5 * b5
    c00 = m11 * m22 - m12 * m21
    c01 = m02 * m21 - m01 * m22
    c02 = m01 * m12 - m02 * m11
    c10 = m12 * m20 - m10 * m22
    c11 = m00 * m22 - m02 * m20
    c12 = m02 * m10 - m00 * m12
    c20 = m10 * m21 - m11 * m20
    c21 = m01 * m20 - m00 * m21
    c22 = m00 * m11 - m01 * m10
    inv = 1.0 / (m00 * c00 + m01 * c10 + m02 * c20)
    return (
        (c00 * a0 + c01 * a1 + c02 * a2) * inv,
        0.5 * (c00 * a1 + c01 * a3 + c02 * a4 + c10 * a0 + c11 * a1 + c12 * a2) * inv,
        0.5 * (c00 * a2 + c01 * a4 + c02 * a5 + c20 * a0 + c21 * a1 + c22 * a2) * inv,
        (c10 * a1 + c11 * a3 + c12 * a4) * inv,
        0.5 * (c10 * a2 + c11 * a4 + c12 * a5 + c20 * a1 + c21 * a3 + c22 * a4) * inv,
        (c20 * a2 + c21 * a4 + c22 * a5) * inv,
    )


@njit(cache=True, inline="always")
def parallel_far(a, b):  # type: ignore[no-untyped-def]
    """Return (A⁻¹ + B)⁻¹ = L (I + LᵀBL)⁻¹ Lᵀ (6,) of positive semidefinite (6,), A = L Lᵀ.

    Where A B is 1e7 one way and 1 another `parallel` loses a per cent and more, this next to
    nothing; where A is nearly singular, as a step's noise, this loses some 1e-9, that nothing.
    """
    l00 = math.sqrt(max(a[0], 0.0))
    i0 = 1.0 / l00 if l00 > 0.0 else 0.0
    l10, l20 = a[1] * i0, a[2] * i0
    l11 = math.sqrt(max(a[3] - l10 * l10, 0.0))
    i1 = 1.0 / l11 if l11 > 0.0 else 0.0
    l21 = (a[4] - l20 * l10) * i1
    l22 = math.sqrt(max(a[5] - l20 * l20 - l21 * l21, 0.0))
    b0, b1, b2, b3, b4, b5 = b
    u0, u1, u2 = b0 * l00 + b1 * l10 + b2 * l20, b1 * l00 + b3 * l10 + b4 * l20, 0.0
    u2 = b2 * l00 + b4 * l10 + b5 * l20
    v1, v2, w2 = b3 * l11 + b4 * l21, b4 * l11 + b5 * l21, b5 * l22
    m00 = 1.0 + l00 * u0 + l10 * u1 + l20 * u2
    m10, m20 = l11 * u1 + l21 * u2, l22 * u2
    m11, m21, m22 = 1.0 + l11 * v1 + l21 * v2, l22 * v2, 1.0 + l22 * w2
    # M = C Cᵀ; every pivot of I + (something positive semidefinite) is at least 1
    c00 = math.sqrt(m00)
    c10, c20 = m10 / c00, m20 / c00
    c11 = math.sqrt(max(m11 - c10 * c10, 1.0))
    c21 = (m21 - c20 * c10) / c11
    c22 = math.sqrt(max(m22 - c20 * c20 - c21 * c21, 1.0))
    # X = C⁻¹ Lᵀ, and Xᵀ X
    x00, x01, x02 = l00 / c00, l10 / c00, l20 / c00
    x10, x11, x12 = -c10 * x00 / c11, (l11 - c10 * x01) / c11, (l21 - c10 * x02) / c11
    x20 = (-c20 * x00 - c21 * x10) / c22
    x21 = (-c20 * x01 - c21 * x11) / c22
    x22 = (l22 - c20 * x02 - c21 * x12) / c22
    return (
        x00 * x00 + x10 * x10 + x20 * x20,
        x00 * x01 + x10 * x11 + x20 * x21,
        x00 * x02 + x10 * x12 + x20 * x22,
        x01 * x01 + x11 * x11 + x21 * x21,
        x01 * x02 + x11 * x12 + x21 * x22,
        x02 * x02 + x12 * x12 + x22 * x22,
    )


@njit(cache=True, inline="always")
def pull_back(g, step):  # type: ignore[no-untyped-def]
    """Return Fᵀ G F (6,) for one row of `chain_steps`."""
    g0, g1, g2, g3, g4, g5 = g
    c, s, y, x = step[0], step[1], step[2], step[3]
    a0, a1, a2 = c * g0 - s * g1, c * g1 - s * g3, c * g2 - s * g4
    b0, b1, b2 = s * g0 + c * g1, s * g1 + c * g3, s * g2 + c * g4
    h0, h1, h2 = y * g0 + x * g1 + g2, y * g1 + x * g3 + g4, y * g2 + x * g4 + g5
    return (
        c * a0 - s * a1,
        s * a0 + c * a1,
        y * a0 + x * a1 + a2,
        s * b0 + c * b1,
        y * b0 + x * b1 + b2,
        y * h0 + x * h1 + h2,
    )


@njit(cache=True, inline="always")
def row6(a, t):  # type: ignore[no-untyped-def]
    """Return row `t` of an array (t, 6) as six scalars."""
    return a[t, 0], a[t, 1], a[t, 2], a[t, 3], a[t, 4], a[t, 5]


@njit(cache=True, inline="always")
def put6(a, t, p):  # type: ignore[no-untyped-def]
    """Write six scalars into row `t` of an array (t, 6)."""
    a[t, 0], a[t, 1], a[t, 2], a[t, 3], a[t, 4], a[t, 5] = p


@njit(cache=True)
def filter_forward(steps, p0, total, before, after, log_before):  # type: ignore[no-untyped-def]
    """Run the filter over information `total` (t, 3); return Σ log det(I + P_t J_t).

    Fills the covariances before and after each sample's measurements (t, 6) and the sum of the
    logarithms of all earlier samples (t,).
    """
    p = (p0[0], p0[1], p0[2], p0[3], p0[4], p0[5])
    log_sum = 0.0
    for t in range(steps.shape[0]):
        if t > 0:
            p = predict(p, steps[t])
        put6(before, t, p)
        log_before[t] = log_sum
        q0, q1, q2, q3, q4, q5, det = update(p, total[t, 0], total[t, 1], total[t, 2])
        p = (q0, q1, q2, q3, q4, q5)
        put6(after, t, p)
        log_sum += math.log(det)
    return log_sum


@njit(cache=True)
def inform_backward(steps, total, later):  # type: ignore[no-untyped-def]
    """Fill `later` (t, 6): the information about state t in the measurements of later samples."""
    n = steps.shape[0]
    g = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    put6(later, n - 1, g)
    for t in range(n - 1, 0, -1):
        g = (g[0] + total[t, 0], g[1] + total[t, 1], g[2], g[3] + total[t, 2], g[4], g[5])
        q = (steps[t, 4], steps[t, 5], steps[t, 6], steps[t, 7], steps[t, 8], steps[t, 9])
        g = pull_back(parallel(g, q), steps[t])
        put6(later, t - 1, g)


@njit(cache=True)
def add_rows(indptr, indices, blocks, scale, weight, rows, total):  # type: ignore[no-untyped-def]
    """Add scale · weight[k] · blocks of candidate rows[k] to `total` (t, 3)."""
    isotropic = blocks.shape[1] == 1
    for k in range(rows.size):
        i = rows[k]
        factor = scale * weight[k]
        for e in range(indptr[i], indptr[i + 1]):
            t = indices[e]
            if isotropic:
                total[t, 0] += factor * blocks[e, 0]
                total[t, 2] += factor * blocks[e, 0]
            else:
                total[t, 0] += factor * blocks[e, 0]
                total[t, 1] += factor * blocks[e, 1]
                total[t, 2] += factor * blocks[e, 2]


@njit(cache=True)
def trace_against(indptr, indices, blocks, scale, per_sample, rows, out):  # type: ignore[no-untyped-def]
    """Set out[k] = scale · Σ_t tr(J_t M_t) for candidate rows[k] and symmetric M (t, 3)."""
    isotropic = blocks.shape[1] == 1
    for k in range(rows.size):
        i = rows[k]
        found = 0.0
        for e in range(indptr[i], indptr[i + 1]):
            t = indices[e]
            if isotropic:
                found += blocks[e, 0] * (per_sample[t, 0] + per_sample[t, 2])
            else:
                found += (
                    blocks[e, 0] * per_sample[t, 0]
                    + 2.0 * blocks[e, 1] * per_sample[t, 1]
                    + blocks[e, 2] * per_sample[t, 2]
                )
        out[k] = scale * found


@njit(cache=True)
def smoothed_positions(after, later, out):  # type: ignore[no-untyped-def]
    """Fill `out` (t, 3) with the smoother's position covariance (P⁻¹ + Γ)⁻¹ at each sample."""
    for t in range(after.shape[0]):
        p = parallel(row6(after, t), row6(later, t))
        out[t, 0], out[t, 1], out[t, 2] = p[0], p[1], p[3]


def empty_messages(n_samples: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return storage for the covariances before and after, and the logarithms before."""
    return np.empty((n_samples, 6)), np.empty((n_samples, 6)), np.empty(n_samples)
