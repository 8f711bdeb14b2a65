"""Small matrices in compiled code: written out, because calls into LAPACK compile for seconds."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def inverse_factor(M, W):  # type: ignore[no-untyped-def]
    """Write W = chol(M)⁻¹, lower triangular; False if M is not positive definite in float64."""
    d = M.shape[0]
    L = np.zeros((d, d))
    for a in range(d):
        for b in range(a + 1):
            total = M[a, b]
            for e in range(b):
                total -= L[a, e] * L[b, e]
            if a == b:
                if not total > 0.0:
                    return False
                L[a, a] = np.sqrt(total)
            else:
                L[a, b] = total / L[b, b]
    for b in range(d):
        for a in range(b):
            W[a, b] = 0.0
        W[b, b] = 1.0 / L[b, b]
        for a in range(b + 1, d):
            total = 0.0
            for e in range(b, a):
                total -= L[a, e] * W[e, b]
            W[a, b] = total / L[a, a]
    return True


@njit(cache=True)
def log_diagonal(W):  # type: ignore[no-untyped-def]
    """Return Σ log W_aa."""
    total = 0.0
    for a in range(W.shape[0]):
        total += np.log(W[a, a])
    return total


@njit(cache=True)
def sum_squares(A):  # type: ignore[no-untyped-def]
    """Return Σ A²."""
    total = 0.0
    for a in range(A.shape[0]):
        for b in range(A.shape[1]):
            total += A[a, b] * A[a, b]
    return total


@njit(cache=True)
def times(A, B):  # type: ignore[no-untyped-def]
    """Return A B."""
    C = np.zeros((A.shape[0], B.shape[1]))
    for a in range(A.shape[0]):
        for e in range(A.shape[1]):
            factor = A[a, e]
            for b in range(B.shape[1]):
                C[a, b] += factor * B[e, b]
    return C


@njit(cache=True)
def gram(W):  # type: ignore[no-untyped-def]
    """Return WᵀW, exactly symmetric."""
    d = W.shape[1]
    G = np.zeros((d, d))
    for e in range(W.shape[0]):
        for a in range(d):
            for b in range(a + 1):
                G[a, b] += W[e, a] * W[e, b]
    for a in range(d):
        for b in range(a):
            G[b, a] = G[a, b]
    return G


@njit(cache=True)
def add_weighted(M, G, r, x):  # type: ignore[no-untyped-def]
    """Add Σ x_i G_i G_iᵀ to M in place; G (d, p·r) holds the columns side by side."""
    d, columns = G.shape
    scaled = np.empty(columns)
    for a in range(d):
        for k in range(columns):
            scaled[k] = G[a, k] * x[k // r]
        for b in range(a + 1):
            total = 0.0
            for k in range(columns):
                total += scaled[k] * G[b, k]
            M[a, b] += total
            if a != b:
                M[b, a] += total


@njit(cache=True)
def eliminate(block, right):  # type: ignore[no-untyped-def]
    """Solve `block` · X = `right` in place for a small positive definite block; return its log det.

    +∞ if rounding has spoilt the block.
    """
    r, total = block.shape[0], 0.0
    for a in range(r):
        if not block[a, a] > 0.0:
            return np.inf
        total += np.log(block[a, a])
        for b in range(a + 1, r):
            share = block[b, a] / block[a, a]
            for e in range(a, r):
                block[b, e] -= share * block[a, e]
            for e in range(right.shape[1]):
                right[b, e] -= share * right[a, e]
    for a in range(r - 1, -1, -1):
        for e in range(right.shape[1]):
            for b in range(a + 1, r):
                right[a, e] -= block[a, b] * right[b, e]
            right[a, e] /= block[a, a]
    return total


@njit(cache=True)
def descending(worth):  # type: ignore[no-untyped-def]
    """Return the indices of `worth` from the greatest to the least, the lower index first."""
    n = worth.size
    order, aside = np.arange(n), np.empty(n, np.int64)
    width = 1
    while width < n:  # merge sort: stable
        for low in range(0, n, 2 * width):
            middle, high = min(low + width, n), min(low + 2 * width, n)
            a, b = low, middle
            for at in range(low, high):
                if a < middle and (b >= high or worth[order[a]] >= worth[order[b]]):
                    aside[at] = order[a]
                    a += 1
                else:
                    aside[at] = order[b]
                    b += 1
        order, aside = aside, order
        width *= 2
    return order


@njit(cache=True)
def columns_of(V, ids):  # type: ignore[no-untyped-def]
    """Return the columns of the candidates `ids` side by side, (n, len·r), of V (c, r, n)."""
    r, n = V.shape[1], V.shape[2]
    F = np.empty((n, ids.size * r))
    for at in range(ids.size):
        for k in range(r):
            for a in range(n):
                F[a, at * r + k] = V[ids[at], k, a]
    return F
