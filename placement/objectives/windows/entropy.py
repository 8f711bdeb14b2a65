"""The log-det gain of a candidate from its own window, between stored messages.

With P the filter's covariance, J_t the information of sample t and Γ_b the information that later
samples hold about state b, the chain rule of mutual information gives for any sample b

    log det ratio = Σ_{t ≤ b} log det(I + P_t J_t) + log det(I + P_b⁺ Γ_b) + const_b

where const_b does not depend on what is seen at or before b. A gain therefore needs the filter
only over the candidate's window. A long gap within a window (a circuit whose start is also its
end) is crossed in blocks whose maps P ↦ A (P⁻¹ + Γ)⁻¹ Aᵀ + C are stored.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from models.geometry import FloatArray
from placement.objectives.windows.filter import (
    BLOCK,
    RESCALE,
    log_det_plus,
    parallel,
    predict,
    put6,
    row6,
    update,
)

N_TRANSFER = 22  # A (9, row by row), Γ (6), C (6), log det at P = 0


@njit(cache=True)
def window_gains(  # type: ignore[no-untyped-def]
    indptr,
    indices,
    blocks,
    frames,
    rows,
    steps,
    total,
    before,
    later,
    log_before,
    through,
    transfers,
    out,
):
    """Set out[k] to the rise of the trajectory's log det, in nats, on adding candidate rows[k].

    `total` (t, 3) is the information of the placement so far; `before`, `log_before` are its
    forward messages, `later` its backward ones, `through` (t,) the sum in the module's formula
    with b = t, `transfers` the maps of its blocks.
    """
    isotropic = blocks.shape[1] == 1
    for k in range(rows.size):
        first, stop = indptr[rows[k]], indptr[rows[k] + 1]
        if first == stop:
            out[k] = 0.0
            continue
        t = np.int64(indices[first])
        p = row6(before, t)
        log_sum, product = log_before[t], 1.0
        for e in range(first, stop):
            u = np.int64(indices[e])
            while t < u:
                if t % BLOCK == 0 and t + BLOCK < u:
                    p, log_det = cross_block(p, transfers[t // BLOCK])
                    log_sum += log_det
                    t += BLOCK
                    continue
                t += 1
                p = predict(p, steps[t])
                if t < u:
                    q0, q1, q2, q3, q4, q5, det = update(p, total[t, 0], total[t, 1], total[t, 2])
                    p = (q0, q1, q2, q3, q4, q5)
                    product *= det
                    if product > RESCALE:
                        log_sum += math.log(product)
                        product = 1.0
            jtt = frames * np.float64(blocks[e, 0])
            jtn, jnn = 0.0, jtt
            if not isotropic:
                jtn, jnn = frames * np.float64(blocks[e, 1]), frames * np.float64(blocks[e, 2])
            q0, q1, q2, q3, q4, q5, det = update(
                p, total[t, 0] + jtt, total[t, 1] + jtn, total[t, 2] + jnn
            )
            p = (q0, q1, q2, q3, q4, q5)
            product *= det
            if product > RESCALE:
                log_sum += math.log(product)
                product = 1.0
        out[k] = log_sum + math.log(product) + log_det_plus(p, row6(later, t)) - through[t]


@njit(cache=True, inline="always")
def covariance_across(x, m):  # type: ignore[no-untyped-def]
    """Return A X Aᵀ + C (6,) for the first 21 numbers of a block; X is (P⁻¹ + Γ)⁻¹."""
    x0, x1, x2, x3, x4, x5 = x
    a0, a1, a2, a3, a4, a5, a6, a7, a8 = m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]
    u0, u1, u2 = a0 * x0 + a1 * x1 + a2 * x2, a0 * x1 + a1 * x3 + a2 * x4, 0.0
    u2 = a0 * x2 + a1 * x4 + a2 * x5
    v0, v1, v2 = a3 * x0 + a4 * x1 + a5 * x2, a3 * x1 + a4 * x3 + a5 * x4, 0.0
    v2 = a3 * x2 + a4 * x4 + a5 * x5
    w0, w1, w2 = a6 * x0 + a7 * x1 + a8 * x2, a6 * x1 + a7 * x3 + a8 * x4, 0.0
    w2 = a6 * x2 + a7 * x4 + a8 * x5
    return (
        u0 * a0 + u1 * a1 + u2 * a2 + m[15],
        u0 * a3 + u1 * a4 + u2 * a5 + m[16],
        u0 * a6 + u1 * a7 + u2 * a8 + m[17],
        v0 * a3 + v1 * a4 + v2 * a5 + m[18],
        v0 * a6 + v1 * a7 + v2 * a8 + m[19],
        w0 * a6 + w1 * a7 + w2 * a8 + m[20],
    )


@njit(cache=True, inline="always")
def cross_block(p, m):  # type: ignore[no-untyped-def]
    """Return A (P⁻¹ + Γ)⁻¹ Aᵀ + C (6,) and Σ log det(I + P_t J_t) over the block."""
    g = (m[9], m[10], m[11], m[12], m[13], m[14])
    return covariance_across(parallel(p, g), m), log_det_plus(p, g) + m[21]


@njit(cache=True)
def block_transfers(steps, total, transfers):  # type: ignore[no-untyped-def]
    """Fill `transfers` (b, N_TRANSFER), the map of each whole block of samples.

    Block b leads from the covariance after sample b · BLOCK to that after (b + 1) · BLOCK.
    """
    for b in range(transfers.shape[0]):
        a = np.eye(3)
        g = np.zeros((3, 3))
        c = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        f = np.zeros((3, 3))
        log_sum = 0.0
        for t in range(b * BLOCK + 1, (b + 1) * BLOCK + 1):
            s = steps[t]
            f[0, 0], f[0, 1], f[0, 2] = s[0], s[1], s[2]
            f[1, 0], f[1, 1], f[1, 2] = -s[1], s[0], s[3]
            f[2, 2] = 1.0
            a = f @ a
            c = predict(c, s)
            jtt, jtn, jnn = total[t, 0], total[t, 1], total[t, 2]
            det_j = jtt * jnn - jtn * jtn
            q0, q1, q2, q3, q4, q5, det = update(c, jtt, jtn, jnn)
            k = np.zeros((3, 3))  # Hᵀ A H of the update at covariance C
            k[0, 0] = (jtt + det_j * c[3]) / det
            k[0, 1] = k[1, 0] = (jtn - det_j * c[1]) / det
            k[1, 1] = (jnn + det_j * c[0]) / det
            g += a.T @ k @ a
            full = np.array([[c[0], c[1], c[2]], [c[1], c[3], c[4]], [c[2], c[4], c[5]]])
            a -= full @ k @ a
            c = (q0, q1, q2, q3, q4, q5)
            log_sum += math.log(det)
        for i in range(3):
            for j in range(3):
                transfers[b, 3 * i + j] = a[i, j]
        put6(transfers[:, 9:15], b, (g[0, 0], g[0, 1], g[0, 2], g[1, 1], g[1, 2], g[2, 2]))
        put6(transfers[:, 15:21], b, c)
        transfers[b, 21] = log_sum


@njit(cache=True)
def log_det_through(after, later, total, before, log_before, through):  # type: ignore[no-untyped-def]
    """Fill `through` (t,): Σ_{τ ≤ t} log det(I + P_τ J_τ) + log det(I + P_t⁺ Γ_t)."""
    for t in range(after.shape[0]):
        det = update(row6(before, t), total[t, 0], total[t, 1], total[t, 2])[6]
        through[t] = log_before[t] + math.log(det) + log_det_plus(row6(after, t), row6(later, t))


def empty_transfers(n_samples: int) -> FloatArray:
    """Return storage for the maps of the whole blocks in `n_samples`."""
    return np.empty((max(0, (n_samples - 1) // BLOCK), N_TRANSFER))
