"""The odometry chain with a white background taken in, and the cameras that look at it.

A background Y that is white (one block a sample) leaves the trajectory a Gauss–Markov chain: given
measurements of information Y_t at every sample, states still follow one another by

    x_t = F'_t x_{t−1} + w'_t,   Cov w'_t = Q'_t = (Q_t⁻¹ + Γ_t)⁻¹,   F'_t = (I + Q_t Γ_t)⁻¹ F_t,

Γ_t the information about x_t in the background at t and later (the smoother's backward pass;
Rauch, Tung & Striebel 1965). So gains over odometry and background are gains over another chain,
and nothing needs to remember the background but its steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.objectives.navigation_chain import Drive
from placement.objectives.windows.filter import parallel, pull_back, put6, row6
from placement.objectives.windows.offsets import Views, offset_shares


class Process(NamedTuple):
    """A Gauss–Markov chain; row t leads from sample t − 1 to sample t."""

    f: FloatArray  # (t, 9) F' row by row
    q: FloatArray  # (t, 6) Q'
    prior: FloatArray  # (t, 6) the covariance of each state that nobody has looked at


class Cameras(NamedTuple):
    """What candidates see of one drive, each with `share` of its information."""

    indptr: IntArray  # CSR rows, as `windows.offsets.Views` has them
    indices: NDArray[np.int32]
    white: NDArray[np.float32]
    offsets: NDArray[np.float32]
    frames: float
    share: float
    own: FloatArray  # (n,) log det of what each tells about its own offsets
    first: IntArray  # (n,) samples first and last seen; of the blind the last and −1
    last: IntArray


def take_in(steps: FloatArray, p0: FloatArray, base: FloatArray) -> Process:
    """Return the chain (t, N_STEP) from covariance `p0` (6,) with the background `base` (t, 3)."""
    t = len(steps)
    found = Process(np.zeros((t, 9)), np.zeros((t, 6)), np.zeros((t, 6)))
    _take_in(steps, p0, base, *found)
    return found


def cameras_of(drive: Drive, share: float) -> Cameras:
    """Lay out the cameras of a drive, with persistent offsets or without."""
    info = drive.information
    indptr = np.ascontiguousarray(info.indptr, dtype=np.int64)
    indices = np.ascontiguousarray(info.indices, dtype=np.int32)
    white: NDArray[np.float32] = info.blocks
    offsets = np.zeros((len(indices), 2, 0), dtype=np.float32)
    if drive.persistent and info.white is not None and info.offsets is not None:
        white, offsets = info.white, info.offsets
    views = Views(
        indptr,
        indices,
        np.ascontiguousarray(white, dtype=np.float32),
        np.ascontiguousarray(offsets, dtype=np.float32),
        float(info.frames_per_sample),
    )
    own = np.empty(info.n_candidates)
    offset_shares(views, own)
    first = np.full(info.n_candidates, info.n_samples - 1)
    last = np.full(info.n_candidates, -1)
    seeing = np.flatnonzero(np.diff(indptr))
    first[seeing] = indices[indptr[:-1][seeing]]
    last[seeing] = indices[indptr[1:][seeing] - 1]
    return Cameras(*views, share, own, first, last)


@njit(cache=True)
def _take_in(steps, p0, base, f, q, prior):  # type: ignore[no-untyped-def]
    n = steps.shape[0]
    g = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    inverse, plain = np.empty((3, 3)), np.zeros((3, 3))
    for t in range(n - 1, -1, -1):
        g = (g[0] + base[t, 0], g[1] + base[t, 1], g[2], g[3] + base[t, 2], g[4], g[5])
        if t == 0:
            break
        s = steps[t]
        noise = (s[4], s[5], s[6], s[7], s[8], s[9])
        put6(q, t, parallel(noise, g))
        plain[0, 0], plain[0, 1], plain[0, 2] = s[0], s[1], s[2]
        plain[1, 0], plain[1, 1], plain[1, 2] = -s[1], s[0], s[3]
        plain[2, 2] = 1.0
        n0 = np.array([[s[4], s[5], s[6]], [s[5], s[7], s[8]], [s[6], s[8], s[9]]])
        g0 = np.array([[g[0], g[1], g[2]], [g[1], g[3], g[4]], [g[2], g[4], g[5]]])
        inverse[:] = np.linalg.solve(np.eye(3) + n0 @ g0, plain)
        for i in range(3):
            for j in range(3):
                f[t, 3 * i + j] = inverse[i, j]
        g = pull_back(parallel(g, noise), s)
    p = parallel((p0[0], p0[1], p0[2], p0[3], p0[4], p0[5]), g)
    put6(prior, 0, p)
    for t in range(1, n):
        p = step_on(p, f, q, t)
        put6(prior, t, p)


@njit(cache=True, inline="always")
def step_on(p, f, q, t):  # type: ignore[no-untyped-def]
    """Return F P Fᵀ + Q (6,) for the step to sample t."""
    p0, p1, p2, p3, p4, p5 = p
    a0, a1, a2 = f[t, 0], f[t, 1], f[t, 2]
    b0, b1, b2 = f[t, 3], f[t, 4], f[t, 5]
    c0, c1, c2 = f[t, 6], f[t, 7], f[t, 8]
    u0, u1, u2 = a0 * p0 + a1 * p1 + a2 * p2, a0 * p1 + a1 * p3 + a2 * p4, 0.0
    u2 = a0 * p2 + a1 * p4 + a2 * p5
    v0, v1, v2 = b0 * p0 + b1 * p1 + b2 * p2, b0 * p1 + b1 * p3 + b2 * p4, 0.0
    v2 = b0 * p2 + b1 * p4 + b2 * p5
    w0, w1, w2 = c0 * p0 + c1 * p1 + c2 * p2, c0 * p1 + c1 * p3 + c2 * p4, 0.0
    w2 = c0 * p2 + c1 * p4 + c2 * p5
    return (
        u0 * a0 + u1 * a1 + u2 * a2 + q[t, 0],
        u0 * b0 + u1 * b1 + u2 * b2 + q[t, 1],
        u0 * c0 + u1 * c1 + u2 * c2 + q[t, 2],
        v0 * b0 + v1 * b1 + v2 * b2 + q[t, 3],
        v0 * c0 + v1 * c1 + v2 * c2 + q[t, 4],
        w0 * c0 + w1 * c1 + w2 * c2 + q[t, 5],
    )


@njit(cache=True)
def carry(process, p, start, stop):  # type: ignore[no-untyped-def]
    """Return the covariance (6,) at sample `stop` of a car that nobody looks at since `start`."""
    for t in range(start + 1, stop + 1):
        p = step_on(p, process.f, process.q, t)
    return p


@njit(cache=True)
def predict_ahead(process, p, start, stop, out):  # type: ignore[no-untyped-def]
    """Fill rows start + 1 … stop of `out` (t, 6): the covariances ahead of `p` after `start`."""
    for t in range(start + 1, stop + 1):
        p = step_on(p, process.f, process.q, t)
        put6(out, t, p)


@njit(cache=True, inline="always")
def prior_at(process, t):  # type: ignore[no-untyped-def]
    """Return the covariance (6,) of state t that nobody has looked at."""
    return row6(process.prior, t)
