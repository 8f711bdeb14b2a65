"""The Loewner order on 3×3 covariances and 2×2 information blocks, as scalar kernels.

A covariance is six numbers (tt, tn, tθ, nn, nθ, θθ), a block three (tt, tn, nn). Every test here
is strict: where rounding leaves a doubt the answer is the one that keeps a bound valid.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# What a meet gives away for its own rounding: its eigenvalues lie in [0, 1] after scaling by the
# first matrix and are off by some 1e-15 times the largest, which `meet` keeps below 1e3.
ROUNDING = 1e-11
LARGEST = 1e3
FARTHEST = 1e6  # the same of `above`, which allows for how large they are


@njit(cache=True, inline="always")
def below(a, b, scale):  # type: ignore[no-untyped-def]
    """Return whether scale · A < B in the Loewner order, by the pivots of the difference."""
    d0 = b[0] - scale * a[0]
    d3 = b[3] - scale * a[3]
    d5 = b[5] - scale * a[5]
    if d0 <= 0.0 or d3 <= 0.0 or d5 <= 0.0:
        return False
    d1, d2, d4 = b[1] - scale * a[1], b[2] - scale * a[2], b[4] - scale * a[4]
    p = d3 * d0 - d1 * d1
    if p <= 0.0:
        return False
    q = d4 * d0 - d1 * d2
    r = d5 * d0 - d2 * d2
    return p * r > q * q


@njit(cache=True)
def jacobi(m, v):  # type: ignore[no-untyped-def]
    """Diagonalise the symmetric `m` (3, 3) in place; fill `v` with its eigenvectors as columns."""
    for i in range(3):
        for j in range(3):
            v[i, j] = 1.0 if i == j else 0.0
    for _ in range(12):
        off = abs(m[0, 1]) + abs(m[0, 2]) + abs(m[1, 2])
        if off <= 1e-16 * (abs(m[0, 0]) + abs(m[1, 1]) + abs(m[2, 2])):
            return
        for p in range(2):
            for q in range(p + 1, 3):
                if m[p, q] == 0.0:
                    continue
                theta = (m[q, q] - m[p, p]) / (2.0 * m[p, q])
                t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(1.0 + theta * theta))
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = t * c
                for k in range(3):
                    m[k, p], m[k, q] = c * m[k, p] - s * m[k, q], s * m[k, p] + c * m[k, q]
                for k in range(3):
                    m[p, k], m[q, k] = c * m[p, k] - s * m[q, k], s * m[p, k] + c * m[q, k]
                for k in range(3):
                    v[k, p], v[k, q] = c * v[k, p] - s * v[k, q], s * v[k, p] + c * v[k, q]


@njit(cache=True)
def by_root(a, b, largest, m):  # type: ignore[no-untyped-def]
    """Fill `m` (3, 3) with L⁻¹ B L⁻ᵀ where A = LLᵀ; return whether it is any use, and L.

    L is l00, l10, l11, l20, l21, l22. It is none where A is singular, or the trace of `m` is not
    below `largest`.
    """
    l00 = math.sqrt(max(a[0], 0.0))
    if l00 <= 0.0:
        return False, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    l10, l20 = a[1] / l00, a[2] / l00
    rest = a[3] - l10 * l10
    if rest <= 1e-12 * a[3]:
        return False, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    l11 = math.sqrt(rest)
    l21 = (a[4] - l20 * l10) / l11
    rest = a[5] - l20 * l20 - l21 * l21
    if rest <= 1e-12 * a[5]:
        return False, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    l22 = math.sqrt(rest)
    m[0, 0], m[0, 1], m[0, 2] = b[0], b[1], b[2]
    m[1, 0], m[1, 1], m[1, 2] = b[1], b[3], b[4]
    m[2, 0], m[2, 1], m[2, 2] = b[2], b[4], b[5]
    for i in range(3):
        m[0, i] /= l00
        m[1, i] = (m[1, i] - l10 * m[0, i]) / l11
        m[2, i] = (m[2, i] - l20 * m[0, i] - l21 * m[1, i]) / l22
    for i in range(3):
        m[i, 0] /= l00
        m[i, 1] = (m[i, 1] - l10 * m[i, 0]) / l11
        m[i, 2] = (m[i, 2] - l20 * m[i, 0] - l21 * m[i, 1]) / l22
    useful = m[0, 0] + m[1, 1] + m[2, 2] < largest
    for i in range(3):
        for j in range(i):
            m[i, j] = m[j, i] = 0.5 * (m[i, j] + m[j, i])
    return useful, (l00, l10, l11, l20, l21, l22)


@njit(cache=True)
def along(root, v, k):  # type: ignore[no-untyped-def]
    """Return column k of L V (3,), L as `by_root` gives it."""
    l00, l10, l11, l20, l21, l22 = root
    return (
        l00 * v[0, k],
        l10 * v[0, k] + l11 * v[1, k],
        l20 * v[0, k] + l21 * v[1, k] + l22 * v[2, k],
    )


@njit(cache=True)
def meet(a, b, fallback, m, v):  # type: ignore[no-untyped-def]
    """Return a covariance (6,) below both A and B: L min(1, D) Lᵀ where A = LLᵀ, B = L D Lᵀ.

    It is a maximal lower bound, and scaling the axes scales it, which is not so of
    ½(A + B − |A − B|), nor of the same in information form. `fallback` (6,), known to be below
    both, is returned where A is singular or B far larger. `m`, `v` (3, 3) are scratch.
    """
    useful, root = by_root(a, b, LARGEST, m)
    if not useful:
        return fallback
    jacobi(m, v)
    o0, o1, o2, o3, o4, o5 = a[0], a[1], a[2], a[3], a[4], a[5]
    for k in range(3):
        if m[k, k] < 1.0:
            x, y, z = along(root, v, k)
            w = 1.0 - m[k, k]
            o0 -= w * x * x
            o1 -= w * x * y
            o2 -= w * x * z
            o3 -= w * y * y
            o4 -= w * y * z
            o5 -= w * z * z
    f = 1.0 - ROUNDING
    return (f * o0, f * o1, f * o2, f * o3, f * o4, f * o5)


@njit(cache=True)
def above(a, b, m, v):  # type: ignore[no-untyped-def]
    """Return a covariance (6,) above both A and B: L max(1, D) Lᵀ where A = LLᵀ, B = L D Lᵀ.

    It is a minimal upper bound. A + B is returned where A is singular or B far larger. `m`, `v`
    (3, 3) are scratch.
    """
    useful, root = by_root(a, b, FARTHEST, m)
    if not useful:
        return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5])
    largest = 1.0 + m[0, 0] + m[1, 1] + m[2, 2]
    jacobi(m, v)
    o0, o1, o2, o3, o4, o5 = a[0], a[1], a[2], a[3], a[4], a[5]
    for k in range(3):
        if m[k, k] > 1.0:
            x, y, z = along(root, v, k)
            w = m[k, k] - 1.0
            o0 += w * x * x
            o1 += w * x * y
            o2 += w * x * z
            o3 += w * y * y
            o4 += w * y * z
            o5 += w * z * z
    # eigenvalues are off by some ulp of the largest, and what is added is a multiple of A
    f = ROUNDING * largest
    o0, o1, o2 = o0 + f * a[0], o1 + f * a[1], o2 + f * a[2]
    return (o0, o1, o2, o3 + f * a[3], o4 + f * a[4], o5 + f * a[5])


@njit(cache=True, inline="always")
def block_below(a0, a1, a2, b0, b1, b2):  # type: ignore[no-untyped-def]
    """Return whether block A ≤ B in the Loewner order."""
    d0, d1, d2 = b0 - a0, b1 - a1, b2 - a2
    return d0 >= 0.0 and d2 >= 0.0 and d0 * d2 >= d1 * d1


@njit(cache=True, inline="always")
def block_join(a0, a1, a2, b0, b1, b2):  # type: ignore[no-untyped-def]
    """Return a block above both: ½(A + B + |A − B|), the least where they commute.

    |D| of a 2×2 D with det D ≥ 0 is ±D; else it is (D² + δI)/τ, δ = −det D, τ² = tr D² + 2δ.
    """
    d0, d1, d2 = a0 - b0, a1 - b1, a2 - b2
    det = d0 * d2 - d1 * d1
    if det >= 0.0:
        if d0 + d2 >= 0.0:
            return a0, a1, a2
        return b0, b1, b2
    delta = -det
    tau = math.sqrt(d0 * d0 + 2.0 * d1 * d1 + d2 * d2 + 2.0 * delta)
    inv = 1.0 / tau
    m0 = (d0 * d0 + d1 * d1 + delta) * inv
    m1 = d1 * (d0 + d2) * inv
    m2 = (d1 * d1 + d2 * d2 + delta) * inv
    up = 1.0 + 1e-12
    return 0.5 * (a0 + b0 + m0) * up, 0.5 * (a1 + b1 + m1), 0.5 * (a2 + b2 + m2) * up


@njit(cache=True)
def meet_of(a, b, fallback):  # type: ignore[no-untyped-def]
    """Return `meet` of two arrays (6,), for tests."""
    out = np.empty(6)
    t = (a[0], a[1], a[2], a[3], a[4], a[5])
    u = (b[0], b[1], b[2], b[3], b[4], b[5])
    g = (fallback[0], fallback[1], fallback[2], fallback[3], fallback[4], fallback[5])
    r = meet(t, u, g, np.empty((3, 3)), np.empty((3, 3)))
    for i in range(6):
        out[i] = r[i]
    return out
