"""States and cameras given all that one camera measures, by a Cholesky factor of its covariance.

With Cov(z_j) = L Lᵀ and B = Cov(·, z_j) L⁻ᵀ, a covariance given z_j is the prior one less B Bᵀ.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.sieve.features import carry_columns, prior_matrix, solve_row


@njit(cache=True)
def state_given(process, cameras, j, t, root, out):  # type: ignore[no-untyped-def]
    """Fill `out` (3, 2 m) with Cov(x_t, z_j) L⁻ᵀ, `root` the factor L of Cov(z_j)."""
    begin, end = cameras.indptr[j], cameras.indptr[j + 1]
    if out.shape[1] == 0:
        return
    c = np.empty((3, 3))
    # later entries: Cov(x_s, x_t) = F … F P_t
    prior_matrix(process, t, c)
    at = t
    for e in range(begin, end):
        s = np.int64(cameras.indices[e])
        if s < t:
            continue
        while at < s:
            at += 1
            carry_columns(process.f[at], c)
        for x in range(3):
            out[x, 2 * (e - begin)], out[x, 2 * (e - begin) + 1] = c[0, x], c[1, x]
    # earlier ones: Cov(x_t, x_s) = Φ P_s, Φ by going back
    phi, was, p = np.eye(3), np.empty((3, 3)), np.empty((3, 3))
    at = t
    for e in range(end - 1, begin - 1, -1):
        s = np.int64(cameras.indices[e])
        if s >= t:
            continue
        while at > s:
            f = process.f[at]
            was[:] = phi
            for x in range(3):
                for y in range(3):
                    phi[x, y] = was[x, 0] * f[y] + was[x, 1] * f[3 + y] + was[x, 2] * f[6 + y]
            at -= 1
        prior_matrix(process, s, p)
        for x in range(3):
            for y in range(2):
                out[x, 2 * (e - begin) + y] = (
                    phi[x, 0] * p[0, y] + phi[x, 1] * p[1, y] + phi[x, 2] * p[2, y]
                )
    for x in range(3):
        solve_row(root, out.shape[1], out[x])


@njit(cache=True)
def camera_given(cameras, i, j, features, root, b, given):  # type: ignore[no-untyped-def]
    """Fill B (RANK, 2 m) = Cov(y_i, z_j) L⁻ᵀ and the lower part of `given` = Cov(y_i | z_j).

    Return False where z_j lies beyond the field of i, or i has no features.
    """
    if not features.usable[i]:
        return False
    rank = features.spread.shape[1]
    begin, end = cameras.indptr[j], cameras.indptr[j + 1]
    field, low = features.field[features.at[i] : features.at[i + 1]], features.low[i]
    if b.shape[1] > 0:
        if cameras.first[j] < low or cameras.last[j] >= low + len(field):
            return False
        for e in range(end - begin):
            row = field[np.int64(cameras.indices[begin + e]) - low]
            for a in range(rank):
                b[a, 2 * e], b[a, 2 * e + 1] = row[0, a], row[1, a]
        for a in range(rank):
            solve_row(root, b.shape[1], b[a])
    for a in range(rank):
        for c in range(a + 1):
            s = features.spread[i, a, c]
            for z in range(b.shape[1]):
                s -= b[a, z] * b[c, z]
            given[a, c] = s
    return True


@njit(cache=True)
def invert(m, out):  # type: ignore[no-untyped-def]
    """Fill `out` with the inverse of a symmetric 3×3 matrix; return whether it is positive."""
    a, b, c = m[0, 0], m[0, 1], m[0, 2]
    d, e, f = m[1, 1], m[1, 2], m[2, 2]
    aa, bb, cc = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * aa + b * bb + c * cc
    if not (a > 0.0 and a * d - b * b > 0.0 and det > 0.0):
        return False
    out[0, 0], out[0, 1], out[0, 2] = aa / det, bb / det, cc / det
    out[1, 0], out[1, 1], out[1, 2] = bb / det, (a * f - c * c) / det, (b * c - a * e) / det
    out[2, 0], out[2, 1], out[2, 2] = cc / det, (b * c - a * e) / det, (a * d - b * b) / det
    return True
