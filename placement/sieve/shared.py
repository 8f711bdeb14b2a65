"""What many cameras share with many others through one state, as a product of matrices.

With S = I − E and U = I − K, all in [0, I],

    exp(−loss) = det(I − E K) = det(U + S K)
               = det U + ⟨S, adj U − det U⟩ + ⟨adj S, adj K − det K⟩ + det S det K,

an inner product of fourteen numbers of E and fourteen of K. So the best of values V_i − loss(i, k)
over i, for all k, is V_max + w log of the greatest of inner products, weighted by
exp((V_i − V_max) / w): some 10⁹ pairs a second, each exact but for rounding in float32, which is
allowed for, and the greatest V_i first, until none can be better. V_max must be that of a row that
counts: what is allowed for rounding of it is more than what falls below float32.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

MARGIN = 5e-6  # of the greatest that an inner product can be, for rounding
TERMS = 15  # with the margin


@njit(cache=True)
def put_left(e, weight, out):  # type: ignore[no-untyped-def]
    """Fill `out` (15,) with the numbers of E (6,) times a weight, and what rounding may be."""
    a, b, c = 1.0 - e[0], -e[1], -e[2]
    d, f, g = 1.0 - e[3], -e[4], 1.0 - e[5]
    aa, bb, cc = d * g - f * f, c * f - b * g, b * f - c * d
    dd, ff, gg = a * g - c * c, b * c - a * f, a * d - b * b
    out[0] = weight
    out[1], out[2], out[3] = weight * a, weight * d, weight * g
    out[4], out[5], out[6] = weight * b, weight * c, weight * f
    out[7], out[8], out[9] = weight * aa, weight * dd, weight * gg
    out[10], out[11], out[12] = weight * bb, weight * cc, weight * ff
    out[13] = weight * (a * aa + b * bb + c * cc)
    out[14] = weight * MARGIN


@njit(cache=True)
def put_right(k, weight, out):  # type: ignore[no-untyped-def]
    """Fill `out` (15,) with the numbers of K (6,) times a weight, and what rounding may be."""
    a, b, c, d, f, g = k[0], k[1], k[2], k[3], k[4], k[5]
    aa, bb, cc = d * g - f * f, c * f - b * g, b * f - c * d
    det = a * aa + b * bb + c * cc
    out[7], out[8] = weight * (aa - det), weight * (a * g - c * c - det)
    out[9] = weight * (a * d - b * b - det)
    out[10], out[11] = 2.0 * weight * bb, 2.0 * weight * cc
    out[12], out[13] = 2.0 * weight * (b * c - a * f), weight * det
    a, b, c, d, f, g = 1.0 - a, -b, -c, 1.0 - d, -f, 1.0 - g
    aa, bb, cc = d * g - f * f, c * f - b * g, b * f - c * d
    det = a * aa + b * bb + c * cc
    out[0] = weight * det
    out[1], out[2] = weight * (aa - det), weight * (a * g - c * c - det)
    out[3] = weight * (a * d - b * b - det)
    out[4], out[5] = 2.0 * weight * bb, 2.0 * weight * cc
    out[6] = 2.0 * weight * (b * c - a * f)
    out[14] = weight * MARGIN


@njit(cache=True, fastmath=True)
def raise_by(row, columns, n, best):  # type: ignore[no-untyped-def]
    """Raise `best` (n,) to the inner products of a row (15,) and columns (≥ 14, n)."""
    w0, w1, w2, w3, w4 = row[0], row[1], row[2], row[3], row[4]
    w5, w6, w7, w8, w9 = row[5], row[6], row[7], row[8], row[9]
    w10, w11, w12, w13, more = row[10], row[11], row[12], row[13], row[14]
    c0, c1, c2, c3, c4 = columns[0], columns[1], columns[2], columns[3], columns[4]
    c5, c6, c7, c8, c9 = columns[5], columns[6], columns[7], columns[8], columns[9]
    c10, c11, c12, c13 = columns[10], columns[11], columns[12], columns[13]
    for u in range(n):
        s = more + w0 * c0[u] + w1 * c1[u] + w2 * c2[u] + w3 * c3[u] + w4 * c4[u]
        s += w5 * c5[u] + w6 * c6[u] + w7 * c7[u] + w8 * c8[u] + w9 * c9[u]
        s += w10 * c10[u] + w11 * c11[u] + w12 * c12[u] + w13 * c13[u]
        best[u] = max(best[u], s)


@njit(cache=True)
def worth_of(best, top, weight):  # type: ignore[no-untyped-def]
    """Return a value from an inner product, `top` the value that 1 stands for."""
    if not best > 0.0:
        return -np.inf
    return top + weight * (math.log(np.float64(best)) + MARGIN)
