"""A camera boiled down to a few numbers: the directions in which it tells most.

What a camera measures over its window is a vector z = S x + ε, x the car's positions there. A few
combinations y = W z, with W chosen so that Cov(W ε) = I, tell less than z, so by data processing
no more mutual information than z has: I(y_k; y_i | z_j) ≤ I(z_k; z_i | z_j). That makes

    g(k | i, j) = g(k | j) − I(z_k; z_i | z_j) ≤ g(k | j) − I(y_k; y_i | z_j)

a bound for any W. The best are the leading eigenvectors of the signal in units of the noise; a few
steps of subspace iteration come near enough, as any directions are valid.

Everything else is covariances of the chain that nobody has looked at: Cov(x_t, y_i) around each
camera's window, its *field*.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from models.geometry import BoolArray, FloatArray, IntArray
from placement.branch.small import times
from placement.objectives.windows.offsets import white_block
from placement.tempered.process import Cameras, Process

REACH = 64  # samples on either side of a window that its field covers
ITERATIONS = 8
RANK = 6  # features of a camera; the innermost loops over them are unrolled
FLATTEST = 1e-6  # the least det J / (tr J)² of a sample whose error is finite along both axes


class Features(NamedTuple):
    """r directions of n cameras: y = W z of cameras whose windows have at most m entries."""

    usable: BoolArray  # (n,) whether it has any: not if blind, or blind to an axis at some sample
    weights: FloatArray  # (n, r, 2 m), rows of W by entry, along and across
    spread: FloatArray  # (n, r, r) Cov(y) = I + W S Wᵀ
    low: IntArray  # (n,) the first sample of each field
    at: IntArray  # (n + 1,) rows of each field
    field: FloatArray  # (rows, 3, r) Cov(x_t, y)
    pull: FloatArray  # (rows, 3, r): of what y sees after t, Cov(·, y) is Cov(·, x_t) times this


def features_of(process: Process, cameras: Cameras, rank: int) -> Features:
    """Return `rank` features of each camera; of the blind, zeros."""
    n, samples = cameras.first.size, process.prior.shape[0]
    seeing = cameras.last >= 0
    most = int(np.max(np.diff(cameras.indptr), initial=1))
    low = np.where(seeing, np.maximum(cameras.first - REACH, 0), 0)
    high = np.where(seeing, np.minimum(cameras.last + REACH, samples - 1), -1)
    at = np.concatenate([[0], np.cumsum(high + 1 - low)]).astype(np.int64)
    found = Features(
        np.zeros(n, dtype=np.bool_),
        np.zeros((n, rank, 2 * most)),
        np.zeros((n, rank, rank)),
        low.astype(np.int64),
        at,
        np.zeros((int(at[-1]), 3, rank)),
        np.zeros((int(at[-1]), 3, rank)),
    )
    _find(process, cameras, found)
    return found


@njit(cache=True, parallel=True)
def _find(process, cameras, features):  # type: ignore[no-untyped-def]
    for i in prange(cameras.first.size):
        _find_one(i, process, cameras, features)


@njit(cache=True)
def _find_one(i, process, cameras, features):  # type: ignore[no-untyped-def]
    # apart from the parallel loop, which would lose what is written to `usable`
    features.usable[i] = cameras.last[i] >= 0 and directions_of(
        process, cameras, i, features.weights[i], features.spread[i]
    )
    if features.usable[i]:
        _fill_field(
            process, cameras, i, features.weights[i], features.low[i],
            features.field[features.at[i] : features.at[i + 1]],
            features.pull[features.at[i] : features.at[i + 1]],
        )  # fmt: skip


@njit(cache=True)
def carry_columns(f, m):  # type: ignore[no-untyped-def]
    """Replace `m` (3, c) by F m, `f` the nine numbers of F."""
    for c in range(m.shape[1]):
        x, y, z = m[0, c], m[1, c], m[2, c]
        m[0, c] = f[0] * x + f[1] * y + f[2] * z
        m[1, c] = f[3] * x + f[4] * y + f[5] * z
        m[2, c] = f[6] * x + f[7] * y + f[8] * z


@njit(cache=True)
def prior_matrix(process, t, m):  # type: ignore[no-untyped-def]
    """Fill `m` (3, 3) with the covariance of state t that nobody has looked at."""
    p = process.prior[t]
    m[0, 0], m[0, 1], m[0, 2] = p[0], p[1], p[2]
    m[1, 0], m[1, 1], m[1, 2] = p[1], p[3], p[4]
    m[2, 0], m[2, 1], m[2, 2] = p[2], p[4], p[5]


@njit(cache=True)
def measured(process, cameras, i, signal, noise):  # type: ignore[no-untyped-def]
    """Fill `signal` and `noise` (2 m, 2 m): covariances of what camera i measures, and of errors.

    An error is J⁻¹ of its own, a share of the white information, and B b of the offsets b ~ N(0, I)
    that all of the window have in common. Return whether all J can be inverted.
    """
    begin, end = cameras.indptr[i], cameras.indptr[i + 1]
    p = cameras.offsets.shape[2]
    c = np.empty((3, 3))
    for a in range(end - begin):
        t = np.int64(cameras.indices[begin + a])
        prior_matrix(process, t, c)
        for b in range(a, end - begin):
            while t < cameras.indices[begin + b]:
                t += 1
                carry_columns(process.f[t], c)
            for x in range(2):
                for y in range(2):
                    signal[2 * b + x, 2 * a + y] = c[x, y]
                    signal[2 * a + y, 2 * b + x] = c[x, y]
                    shared = 0.0
                    for k in range(p):
                        shared += np.float64(cameras.offsets[begin + b, x, k]) * np.float64(
                            cameras.offsets[begin + a, y, k]
                        )
                    noise[2 * b + x, 2 * a + y] = noise[2 * a + y, 2 * b + x] = (
                        shared / cameras.share
                    )
        tt, tn, nn = white_block(cameras.white, cameras.frames, begin + a, cameras.share)
        det = tt * nn - tn * tn
        if not det > FLATTEST * (tt + nn) ** 2 or not det > 1e-200:
            return False
        noise[2 * a, 2 * a] += nn / det
        noise[2 * a + 1, 2 * a + 1] += tt / det
        noise[2 * a, 2 * a + 1] -= tn / det
        noise[2 * a + 1, 2 * a] -= tn / det
    return True


@njit(cache=True)
def factor(m, n):  # type: ignore[no-untyped-def]
    """Replace the lower part of `m` (n, n) by its Cholesky factor; return its log det."""
    total = 0.0
    for a in range(n):
        for b in range(a + 1):
            s = m[a, b]
            for q in range(b):
                s -= m[a, q] * m[b, q]
            if a == b:
                s = max(s, 1e-300)
                total += math.log(s)
                m[a, a] = math.sqrt(s)
            else:
                m[a, b] = s / m[b, b]
    return total


@njit(cache=True)
def some_noise(m, n):  # type: ignore[no-untyped-def]
    """Say whether a Cholesky factor (n, n) is of features: their noise alone has covariance I."""
    return n == 0 or np.diag(m)[:n].min() >= 1.0 - 1e-6


@njit(cache=True)
def solve_row(m, n, row):  # type: ignore[no-untyped-def]
    """Replace `row` (n,) by m⁻¹ row, `m` a Cholesky factor."""
    for a in range(n):
        s = row[a]
        for q in range(a):
            s -= m[a, q] * row[q]
        row[a] = s / m[a, a]


@njit(cache=True)
def directions_of(process, cameras, i, weights, spread):  # type: ignore[no-untyped-def]
    """Fill `weights` (r, 2 m) and `spread` (r, r) of camera i; of a short window the rest stay 0.

    Return False where the camera has none. With noise = L Lᵀ and an orthonormal V near the leading
    eigenvectors of L⁻¹ S L⁻ᵀ, W = Vᵀ L⁻¹.
    """
    size = 2 * (cameras.indptr[i + 1] - cameras.indptr[i])
    rank = min(weights.shape[0], size)
    signal, noise = np.empty((size, size)), np.empty((size, size))
    if not measured(process, cameras, i, signal, noise):
        return False
    factor(noise, size)
    for _ in range(2):  # L⁻¹ S, then L⁻¹ (L⁻¹ S)ᵀ
        for a in range(size):
            solve_row(noise, size, signal[a])
        for a in range(size):
            for b in range(a):
                signal[a, b], signal[b, a] = signal[b, a], signal[a, b]
    v = np.empty((rank, size))
    for r in range(rank):
        for a in range(size):
            # smooth and different from one another, as leading directions are
            v[r, a] = math.cos(math.pi * (r // 2) * (a // 2 + 0.5) / (size // 2)) * (
                1.0 if a % 2 == r % 2 else 0.3
            )
    for _ in range(ITERATIONS):
        _orthonormal(v)
        v = times(v, signal)
    _orthonormal(v)
    spread[:] = 0.0
    for r in range(spread.shape[0]):
        spread[r, r] = 1.0
    spread[:rank, :rank] += times(times(v, signal), np.ascontiguousarray(v.T))
    for r in range(rank):  # W = Vᵀ L⁻¹, from its last entry on
        for a in range(size - 1, -1, -1):
            s = v[r, a]
            for b in range(a + 1, size):
                s -= weights[r, b] * noise[b, a]
            weights[r, a] = s / noise[a, a]
    return True


@njit(cache=True)
def _orthonormal(v):  # type: ignore[no-untyped-def]
    """Make the rows of `v` orthonormal, twice over; rows that vanish become zero."""
    for _ in range(2):
        for r in range(v.shape[0]):
            for q in range(r):
                s = 0.0
                for a in range(v.shape[1]):
                    s += v[r, a] * v[q, a]
                for a in range(v.shape[1]):
                    v[r, a] -= s * v[q, a]
            s = 0.0
            for a in range(v.shape[1]):
                s += v[r, a] * v[r, a]
            scale = 1.0 / math.sqrt(s) if s > 1e-200 else 0.0
            for a in range(v.shape[1]):
                v[r, a] *= scale


@njit(cache=True)
def _fill_field(process, cameras, i, weights, low, field, pull):  # type: ignore[no-untyped-def]
    """Fill `field` (rows, 3, r) with Cov(x_t, y_i) for the samples from `low` on, and `pull`."""
    begin, end = cameras.indptr[i], cameras.indptr[i + 1]
    rank, rows = weights.shape[0], field.shape[0]
    c, back, row = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, rank))
    # forward: Σ over entries not later than t of F … F P_s, as one set of columns
    row[:] = 0.0
    entry = begin
    for t in range(low, low + rows):
        if t > low:
            carry_columns(process.f[t], row)
        if entry < end and cameras.indices[entry] == t:
            prior_matrix(process, t, c)
            e = entry - begin
            for x in range(3):
                for r in range(rank):
                    row[x, r] += c[x, 0] * weights[r, 2 * e] + c[x, 1] * weights[r, 2 * e + 1]
            entry += 1
        field[t - low] = row
    # backward: P_t Σ over later entries of (F … F)ᵀ
    row[:] = 0.0
    entry = end - 1
    for t in range(low + rows - 1, low - 1, -1):
        pull[t - low] = row
        prior_matrix(process, t, c)
        for x in range(3):
            for r in range(rank):
                field[t - low, x, r] += (
                    c[x, 0] * row[0, r] + c[x, 1] * row[1, r] + c[x, 2] * row[2, r]
                )
        if entry >= begin and cameras.indices[entry] == t:
            e = entry - begin
            for r in range(rank):
                row[0, r] += weights[r, 2 * e]
                row[1, r] += weights[r, 2 * e + 1]
            entry -= 1
        if t > 0:
            f = process.f[t]
            for x in range(3):
                for y in range(3):
                    back[x, y] = f[3 * y + x]
            for r in range(rank):
                x0, x1, x2 = row[0, r], row[1, r], row[2, r]
                for x in range(3):
                    row[x, r] = back[x, 0] * x0 + back[x, 1] * x1 + back[x, 2] * x2


@njit(cache=True)
def covariance_of(cameras, k, weights, field, low, out):  # type: ignore[no-untyped-def]
    """Fill `out` (r, c) with Cov(y_k, ·) for whom `field` (rows, 3, c) from sample `low` is."""
    begin, end = cameras.indptr[k], cameras.indptr[k + 1]
    out[:] = 0.0
    for e in range(end - begin):
        row = field[np.int64(cameras.indices[begin + e]) - low]
        for a in range(out.shape[0]):
            w0, w1 = weights[a, 2 * e], weights[a, 2 * e + 1]
            for b in range(out.shape[1]):
                out[a, b] += w0 * row[0, b] + w1 * row[1, b]


class Pairs(NamedTuple):
    """Cov(y_k, y_i) for each i < k whose windows meet, sorted by i, then k."""

    at: IntArray  # (n + 1,)
    other: IntArray  # (pairs,) k
    covariance: FloatArray  # (pairs, r, r), a row for each feature of k


def pairs_that_meet(cameras: Cameras, features: Features) -> Pairs:
    """Return the covariances of all pairs of cameras whose windows meet."""
    n, rank = cameras.first.size, features.spread.shape[1]
    first, last = cameras.first, cameras.last
    others = []
    for i in range(n):
        meets = (first[i + 1 :] <= last[i]) & (last[i + 1 :] >= first[i]) & (last[i] >= 0)
        others.append(np.flatnonzero(meets) + i + 1)
    at = np.concatenate([[0], np.cumsum([len(found) for found in others])]).astype(np.int64)
    other = np.concatenate([*others, np.empty(0, dtype=np.int64)]).astype(np.int64)
    found = Pairs(at, other, np.zeros((len(other), rank, rank)))
    _fill_pairs(cameras, features, found)
    return found


@njit(cache=True, parallel=True)
def _fill_pairs(cameras, features, pairs):  # type: ignore[no-untyped-def]
    for i in prange(cameras.first.size):
        field = features.field[features.at[i] : features.at[i + 1]]
        for q in range(pairs.at[i], pairs.at[i + 1]):
            k = pairs.other[q]
            first, last = cameras.first[k], cameras.last[k]
            if first >= features.low[i] and last < features.low[i] + len(field):
                covariance_of(
                    cameras, k, features.weights[k], field, features.low[i], pairs.covariance[q]
                )
            else:
                pairs.covariance[q] = np.nan  # out of the field: as good as independent
