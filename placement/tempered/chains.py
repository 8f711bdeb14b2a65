"""Backgrounds that are chains themselves: what persistent errors leave of a fractional choice.

A camera whose offsets persist tells mostly how the car moved within its window, and a fractional
choice of them is information that is not white: it links all samples of a window. Any positive
definite Λ may be the background (`placement.tempered.bound`), but only one that links neighbouring
samples alone leaves the trajectory a Markov chain. Of those the best to stand for Λ is the chain
with the same covariance of each two neighbouring samples, which among all distributions with these
has the greatest entropy (Dempster 1972).

With the background's steps x_t = F̃ x_{t−1} + w̃, Cov w̃ = K̃⁻¹, and odometry's F, Q, the sum of
shares 1 − θ and θ of either's information is a chain, too, of the steps

    Q_c = (θ Q⁻¹ + (1 − θ) K̃)⁻¹,   F_c = F + (1 − θ) Q_c K̃ (F̃ − F),

and white information (F̃ − F)ᵀ (K̃⁻¹ / (1 − θ) + Q / θ)⁻¹ (F̃ − F) about each state t − 1, which is
taken in as `placement.tempered.process` says.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit

from models.geometry import FloatArray, IntArray
from placement.objectives.navigation_chain import Drive
from placement.objectives.windows.filter import parallel_far, put6
from placement.tempered.pieces import LONGEST, pieces_of, restricted_entries
from placement.tempered.process import Process, step_on

LEAST_BLOCK = 32  # samples
SINGULAR = 1e-12  # of a step's noise, in units of its own: less than that is none
LEAST_START = 1e-3  # variance of the start, against that of the first step


class Chain(NamedTuple):
    """A Gauss–Markov chain: what is known of the first state beyond the start, and each step."""

    start: FloatArray  # (3, 3) information, positive semidefinite
    f: FloatArray  # (t, 3, 3), row 0 unused
    information: FloatArray  # (t, 3, 3), row 0 unused


def odometry_of(drive: Drive) -> Chain | None:
    """Return the steps of a drive's odometry; None where it knows a direction for certain."""
    steps = drive.steps()
    f, information = np.zeros((len(steps), 3, 3)), np.zeros((len(steps), 3, 3))
    c, s, y, x = steps[:, :4].T
    f[:, 0, 0], f[:, 0, 1], f[:, 0, 2] = c, s, y
    f[:, 1, 0], f[:, 1, 1], f[:, 1, 2] = -s, c, x
    f[:, 2, 2] = 1.0
    noise = _whole(steps[1:, 4:])
    scale = np.sqrt(np.diagonal(noise, axis1=1, axis2=2))
    if not np.all(scale > 0.0):
        return None
    scale = scale[:, :, None] * scale[:, None, :]
    if np.linalg.eigvalsh(noise / scale)[:, 0].min(initial=1.0) < SINGULAR:
        return None
    information[1:] = np.linalg.inv(noise / scale) / scale
    return Chain(np.zeros((3, 3)), f, information)


def chain_of(drive: Drive, x: FloatArray) -> Chain | None:
    """Return the chain that stands for odometry and the fractional choice `x` (c,), if there is."""
    odometry = odometry_of(drive)
    if odometry is None or len(odometry.f) < 2:
        return None
    # a little more at the start, which may be known for certain: any chain is valid
    begin = _whole(drive.initial_covariance()[None])[0]
    begin = begin + LEAST_START * np.diag(np.diagonal(_whole(drive.steps()[1:2, 4:])[0]))
    begin = np.linalg.inv(begin)
    narrow = _cut_short(pieces_of(drive)[0])
    f, information = np.zeros_like(odometry.f), np.zeros_like(odometry.information)
    try:
        cov, link = _neighbours(odometry._replace(start=begin), narrow, x)
        f[1:] = np.linalg.solve(cov[:-1], link).transpose(0, 2, 1)
    except np.linalg.LinAlgError:
        return None
    left = cov[1:] - f[1:] @ link
    left = 0.5 * (left + left.transpose(0, 2, 1))
    if not np.all(np.isfinite(left)) or np.linalg.eigvalsh(left)[:, 0].min() <= 0.0:
        return None
    information[1:] = np.linalg.inv(left)
    information = 0.5 * (information + information.transpose(0, 2, 1))
    # in units of its own, whose magnitudes may be 1e15 apart
    unit = np.sqrt(np.diagonal(begin))
    unit = unit[:, None] * unit
    values, vectors = np.linalg.eigh(np.linalg.inv(cov[0] * unit) - begin / unit)
    start = unit * ((vectors * np.maximum(values, 0.0)) @ vectors.T)
    return Chain(0.5 * (start + start.T), f, information)


def _cut_short(drive: Drive) -> Drive:
    """Cut windows to `LONGEST` samples: blocks are as long as the longest; any chain is valid."""
    info = drive.information
    lengths = np.diff(info.indptr)
    begin = np.repeat(info.indptr[:-1], lengths)
    kept = info.indices.astype(np.int64) - info.indices[begin] < LONGEST
    if kept.all():
        return drive
    return replace(drive, information=restricted_entries(info, kept))


def _neighbours(odometry: Chain, narrow: Drive, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the covariances (t, 3, 3) of all states, and (t − 1, 3, 3) of each with the next."""
    info = narrow.information
    t = info.n_samples
    support = np.flatnonzero(x)
    begin, end = info.indptr[support], info.indptr[support + 1]
    support, begin, end = (part[end > begin] for part in (support, begin, end))
    span = int(np.max(info.indices[end - 1] - info.indices[begin], initial=0)) + 1
    b = max(span, LEAST_BLOCK)
    blocks = -(-t // b)
    own, next_to = np.zeros((blocks, 3 * b, 3 * b)), np.zeros((blocks, 3 * b, 3 * b))
    for s in range(blocks * b):
        k, at = s // b, 3 * (s % b)
        here = slice(at, at + 3)
        if s >= t:
            own[k, here, here] = np.eye(3)  # to fill the last block
            continue
        q, f = odometry.information[s], odometry.f[s]
        own[k, here, here] += odometry.start if s == 0 else q
        if s == 0:
            continue
        before, there = (s - 1) // b, slice(3 * ((s - 1) % b), 3 * ((s - 1) % b) + 3)
        own[before, there, there] += f.T @ q @ f
        if before == k:
            own[k, here, there] -= q @ f
            own[k, there, here] -= f.T @ q
        else:
            next_to[before, there, here] -= f.T @ q
    for i in support:
        where, told = _told(narrow, int(i))
        k = int(where[0]) // (3 * b)
        inside = where < 3 * b * (k + 1)
        w, share = where - 3 * b * k, float(x[i])
        own[k][np.ix_(w[inside], w[inside])] += share * told[np.ix_(inside, inside)]
        if not inside.all():
            v = w[~inside] - 3 * b
            own[k + 1][np.ix_(v, v)] += share * told[np.ix_(~inside, ~inside)]
            next_to[k][np.ix_(w[inside], v)] += share * told[np.ix_(inside, ~inside)]
    for k in range(blocks):
        if k > 0:
            own[k] -= next_to[k - 1].T @ own[k - 1] @ next_to[k - 1]
        own[k] = np.linalg.inv(0.5 * (own[k] + own[k].T))
    cov, link = np.empty((blocks * b, 3, 3)), np.empty((blocks * b - 1, 3, 3))
    later = own[-1]
    for k in range(blocks - 1, -1, -1):
        if k < blocks - 1:
            gain = own[k] @ next_to[k]
            across = -gain @ later
            link[(k + 1) * b - 1] = across[-3:, :3]
            later = own[k] - across @ gain.T
            later = 0.5 * (later + later.T)
        cells = later.reshape(b, 3, b, 3)
        every = np.arange(b)
        cov[k * b : (k + 1) * b] = cells[every, :, every, :]
        link[k * b : (k + 1) * b - 1] = cells[every[:-1], :, every[1:], :]
    return cov[:t], link[: t - 1]


def _told(drive: Drive, i: int) -> tuple[IntArray, FloatArray]:
    """Return which coordinates of the trajectory a camera tells of, and its information of them."""
    info = drive.information
    begin, end = int(info.indptr[i]), int(info.indptr[i + 1])
    where = (3 * info.indices[begin:end].astype(np.int64)[:, None] + np.arange(2)).ravel()
    persistent = drive.persistent and info.white is not None and info.offsets is not None
    blocks = np.asarray(info.white if persistent else info.blocks, dtype=np.float64)[begin:end]
    white = np.zeros((end - begin, 2, end - begin, 2))
    every = np.arange(end - begin)
    one = blocks.ndim == 1 or blocks.shape[1] == 1
    white[every, 0, every, 0] = blocks.ravel() if one else blocks[:, 0]
    white[every, 1, every, 1] = blocks.ravel() if one else blocks[:, 2]
    white[every, 0, every, 1] = white[every, 1, every, 0] = 0.0 if one else blocks[:, 1]
    told: FloatArray = info.frames_per_sample * white.reshape(where.size, where.size)
    if persistent and info.offsets is not None:
        b = np.asarray(info.offsets, dtype=np.float64)[begin:end].reshape(where.size, -1)
        gain = told @ b
        told = told - gain @ np.linalg.solve(np.eye(b.shape[1]) + b.T @ gain, gain.T)
    return where, told


def mixed(drive: Drive, chain: Chain, theta: float) -> Process:
    """Return the chain of a share 1 − `theta` of a background and `theta` of the odometry."""
    return _mixed(drive, chain, theta)[0]


def _mixed(drive: Drive, chain: Chain, theta: float) -> tuple[Process, FloatArray]:
    """Return that chain, and what it knows of the first state beyond the start (6,)."""
    steps = drive.steps()
    t = len(steps)
    found, start = Process(np.zeros((t, 9)), np.zeros((t, 6)), np.zeros((t, 6))), np.zeros(6)
    p0 = drive.initial_covariance()
    _mix(steps, p0, chain.start, chain.f, chain.information, theta, *found, start)
    return found, start


def constant_of(drive: Drive, chain: Chain, theta: float) -> tuple[float, float]:
    """Return f at a share 1 − θ of the background less (1 − θ) f at the whole, in nats.

    And the sum of the magnitudes that it is the difference of, for its rounding.
    """
    odometry = odometry_of(drive)
    if odometry is None:
        raise ValueError("a chain is a background of odometry with noise in all directions")
    process, start = _mixed(drive, chain, theta)
    p0 = _whole(drive.initial_covariance()[None])[0]
    mix = -_log_dets(_whole(process.q[1:])) + _log_dets(np.eye(3) + p0 @ _whole(start[None]))
    whole = _log_dets(chain.information[1:]) + _log_dets(np.eye(3) + p0 @ chain.start)
    bare = _log_dets(odometry.information[1:])
    magnitude = abs(mix) + abs(whole) + abs(bare)
    if not math.isfinite(magnitude):
        return math.inf, 0.0  # a bound that bounds nothing
    return mix - (1.0 - theta) * whole - theta * bare, magnitude


def _log_dets(matrices: FloatArray) -> float:
    """Return the sum of log dets; NaN where rounding has left one that is not positive."""
    signs, logs = np.linalg.slogdet(matrices)
    return float(np.sum(logs)) if np.all(signs > 0.0) else math.nan


def _whole(packed: FloatArray) -> FloatArray:
    """Return symmetric matrices (t, 3, 3) from their six numbers (t, 6)."""
    return packed[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


@njit(cache=True)
def _mix(steps, p0, start, f_of, information, theta, f, q, prior, known):  # type: ignore[no-untyped-def]
    n = steps.shape[0]
    rest = 1.0 - theta
    g = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    plain, other, inverse = np.zeros((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for t in range(n - 1, 0, -1):
        s, k = steps[t], information[t]
        noise = (s[4] / theta, s[5] / theta, s[6] / theta, s[7] / theta, s[8] / theta, s[9] / theta)
        told = (
            rest * k[0, 0], rest * k[0, 1], rest * k[0, 2],
            rest * k[1, 1], rest * k[1, 2], rest * k[2, 2],
        )  # fmt: skip
        plain[0, 0], plain[0, 1], plain[0, 2] = s[0], s[1], s[2]
        plain[1, 0], plain[1, 1], plain[1, 2] = -s[1], s[0], s[3]
        plain[2, 2] = 1.0
        other[:] = f_of[t] - plain
        left = parallel_far(noise, told)
        move = plain + _square(left) @ _square(told) @ other
        more = other.T @ _square(parallel_far(told, noise)) @ other
        put6(q, t, parallel_far(left, g))
        inverse[:] = np.linalg.solve(np.eye(3) + _square(left) @ _square(g), move)
        for i in range(3):
            for j in range(3):
                f[t, 3 * i + j] = inverse[i, j]
        more += move.T @ _square(parallel_far(g, left)) @ move
        g = (
            more[0, 0], 0.5 * (more[0, 1] + more[1, 0]), 0.5 * (more[0, 2] + more[2, 0]),
            more[1, 1], 0.5 * (more[1, 2] + more[2, 1]), more[2, 2],
        )  # fmt: skip
    g = (
        g[0] + rest * start[0, 0], g[1] + rest * start[0, 1], g[2] + rest * start[0, 2],
        g[3] + rest * start[1, 1], g[4] + rest * start[1, 2], g[5] + rest * start[2, 2],
    )  # fmt: skip
    known[0], known[1], known[2], known[3], known[4], known[5] = g
    p = parallel_far((p0[0], p0[1], p0[2], p0[3], p0[4], p0[5]), g)
    put6(prior, 0, p)
    for t in range(1, n):
        p = step_on(p, f, q, t)
        put6(prior, t, p)


@njit(cache=True)
def _square(packed):  # type: ignore[no-untyped-def]
    a, b, c, d, e, f = packed
    return np.array([[a, b, c], [b, d, e], [c, e, f]])
