"""One drive past the cameras, filtered the plain way: a dense Kalman filter in world axes.

The state is (x, y, heading) and, behind it, the six offsets of every camera that has persistent
ones, of unit variance each: nothing is marginalised, nothing enters or leaves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.geometry import FloatArray
from placement.referee.sight import Sight

PANELS = 20  # of Simpson's rule within one interval of the path


@dataclass(frozen=True, slots=True)
class Track:
    """The path's samples (t,), and how odometry errs along it.

    `densities` are heading (rad/√m), along and across (m/√m); `initial_sigma` (3,) is along,
    across, heading; `frames` is how many frames a camera takes while the car passes one sample.
    """

    s_m: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    densities: tuple[float, float, float]
    initial_sigma: tuple[float, float, float]
    frames: float


@dataclass(frozen=True, slots=True)
class Filtered:
    """The car's covariance after each sample (t, 3, 3), and the trajectory's log det ratio."""

    covariance: FloatArray
    log_det: float


def filter_drive(track: Track, sights: Sequence[Sight]) -> Filtered:
    """Filter the whole drive with the cameras of `sights`.

    The log det ratio is that of the trajectory's information with and without cameras, by the
    chain rule: Σ log det S − Σ log det R of the measurements, less log det(I + BᵀWB) of each
    camera, which is what it tells about its own offsets.
    """
    t, sizes = len(track.s_m), [sight.offsets.shape[2] for sight in sights]
    starts = 3 + np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    moves, noises = steps(track)
    P = np.eye(int(starts[-1]))
    P[:3, :3] = _initial(track)
    covariance, log_det = np.empty((t, 3, 3)), 0.0
    for n in range(t):
        if n:
            P[:3] = moves[n] @ P[:3]
            P[:, :3] = P[:, :3] @ moves[n].T
            P[:3, :3] += noises[n]
        for start, size, sight in zip(starts, sizes, sights, strict=False):
            if not sight.seen[n]:
                continue
            R = sight.white[n] / track.frames
            columns = [0, 1, *range(start, start + size)]
            H = np.column_stack([np.eye(2), sight.offsets[n]])
            PH = P[:, columns] @ H.T
            S = H @ PH[columns] + R
            P -= PH @ np.linalg.solve(S, PH.T)
            P = 0.5 * (P + P.T)
            log_det += _log_det(S) - _log_det(R)
        covariance[n] = P[:3, :3]
    return Filtered(covariance, log_det - sum(_about_itself(s, track.frames) for s in sights))


def steps(track: Track) -> tuple[FloatArray, FloatArray]:
    """Return the transition and the noise (t, 3, 3) that lead to each sample; row 0 is idle."""
    length, turn = np.diff(track.s_m), np.diff(track.heading_rad)
    heading_q, along_q, across_q = (density**2 for density in track.densities)
    q = np.diag([along_q, across_q, heading_q])
    end = track.heading_rad[1:]
    noise = np.zeros((len(length), 3, 3))
    for panel in range(PANELS + 1):
        left = panel / PANELS  # the share of the interval that is still to be driven
        weight = (1.0 if panel in (0, PANELS) else 4.0 if panel % 2 else 2.0) / (3.0 * PANELS)
        G = _move(left * length, end - left * turn, left * turn) @ _axes(end - left * turn)
        noise += (weight * length)[:, None, None] * (G @ q @ G.transpose(0, 2, 1))
    move = _move(length, end - turn, turn)
    idle = np.eye(3)[None]
    return np.concatenate([idle, move]), np.concatenate([0.0 * idle, noise])


def _move(length: FloatArray, heading: FloatArray, turn: FloatArray) -> FloatArray:
    """Return how errors at `heading` grow over an arc of `length` that turns by `turn`."""
    half = 0.5 * turn
    chord = length * np.where(half == 0.0, 1.0, np.sin(half) / np.where(half == 0.0, 1.0, half))
    F = np.tile(np.eye(3), (len(length), 1, 1))
    F[:, 0, 2] = -chord * np.sin(heading + half)
    F[:, 1, 2] = chord * np.cos(heading + half)
    return F


def _axes(heading: FloatArray) -> FloatArray:
    """Return world_from_road at `heading` (t,), (t, 3, 3)."""
    axes = np.zeros((len(heading), 3, 3))
    axes[:, 0, 0] = axes[:, 1, 1] = np.cos(heading)
    axes[:, 1, 0] = np.sin(heading)
    axes[:, 0, 1] = -axes[:, 1, 0]
    axes[:, 2, 2] = 1.0
    return axes


def _initial(track: Track) -> FloatArray:
    axes = _axes(track.heading_rad[:1])[0]
    initial: FloatArray = axes @ np.diag(np.square(track.initial_sigma)) @ axes.T
    return initial


def _about_itself(sight: Sight, frames: float) -> float:
    B = sight.offsets[sight.seen]
    if not B.size:
        return 0.0
    W = frames * np.linalg.inv(sight.white[sight.seen])
    return _log_det(np.eye(B.shape[2]) + np.einsum("tip,tij,tjq->pq", B, W, B))


def _log_det(matrix: FloatArray) -> float:
    sign, log = np.linalg.slogdet(matrix)
    return float(log) if sign > 0.0 else math.nan
