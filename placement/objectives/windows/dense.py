"""The navigation objectives the slow way: one dense matrix for the whole trajectory.

Shares nothing with the kernels but the chain's steps; it is their oracle, and a referee's second
opinion. Time grows with the cube of the number of samples: for drives of some hundred at most.
"""

from __future__ import annotations

import math

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.objectives.navigation_chain import Drive

WEIGHTS = {"position": np.diag([1.0, 1.0, 0.0]), "lateral": np.diag([0.0, 1.0, 0.0])}


class DenseDrive:
    """One drive with its prior covariance of all states, (3t, 3t)."""

    def __init__(self, drive: Drive) -> None:
        """Build the prior covariance by the recursion Σ_t = F Σ_{t−1} Fᵀ + Q."""
        self.drive = drive
        self.t = drive.information.n_samples
        self.prior = np.zeros((3 * self.t, 3 * self.t))
        self.prior[:3, :3] = np.diag(drive.initial_sigma**2)
        for t, step in enumerate(drive.steps()):
            if t == 0:
                continue
            c, s, y, x, *q = step
            f = np.array([[c, s, y], [-s, c, x], [0.0, 0.0, 1.0]])
            noise = np.array([[q[0], q[1], q[2]], [q[1], q[3], q[4]], [q[2], q[4], q[5]]])
            now, last = (slice(3 * (t - back), 3 * (t - back) + 3) for back in (0, 1))
            past = slice(0, 3 * t)
            self.prior[now, past] = f @ self.prior[last, past]
            self.prior[past, now] = self.prior[now, past].T
            self.prior[now, now] = f @ self.prior[last, last] @ f.T + noise

    def camera(self, i: int, until: int | None = None) -> FloatArray:
        """Return camera i's information (3t, 3t) from samples ≤ `until`, its offsets marginalised.

        W − W B (I + BᵀWB)⁻¹ BᵀW for white information W and offset Jacobian B; W where white.
        """
        where, told = self._told(i, until)
        out = np.zeros_like(self.prior)
        out[np.ix_(where, where)] = told
        return out

    def _told(self, i: int, until: int | None) -> tuple[IntArray, FloatArray]:
        """Return which rows of the trajectory (m,) a camera tells of, and what, (m, m)."""
        info = self.drive.information
        blocks = info.blocks
        if self.drive.persistent and info.white is not None:
            blocks = info.white
        entries = np.arange(info.indptr[i], info.indptr[i + 1])
        if until is not None:
            entries = entries[info.indices[entries] <= until]
        n = entries.size
        where = (3 * info.indices[entries].astype(np.int64)[:, None] + np.arange(2)).ravel()
        w = np.zeros((2 * n, 2 * n))
        for k, e in enumerate(entries):
            b = info.frames_per_sample * blocks[e].astype(np.float64)
            tt, tn, nn = (b[0], 0.0, b[0]) if b.size == 1 else b
            w[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[tt, tn], [tn, nn]]
        if self.drive.persistent and info.offsets is not None:
            jacobian = info.offsets[entries].astype(np.float64)
            jacobian = jacobian.reshape(2 * n, info.offsets.shape[2])
            wb = w @ jacobian
            w[:] -= wb @ np.linalg.solve(np.eye(jacobian.shape[1]) + jacobian.T @ wb, wb.T)
        return where, w

    def information(self, x: FloatArray, until: int | None = None) -> FloatArray:
        """Return Σ x_i Λ_i (3t, 3t) from samples ≤ `until`."""
        out = np.zeros_like(self.prior)
        for i in np.flatnonzero(x):
            where, told = self._told(int(i), until)
            out[np.ix_(where, where)] += x[i] * told
        return out

    def entropy(self, x: FloatArray) -> float:
        """Return log det(I + Σ Λ), in nats."""
        n = len(self.prior)
        return float(np.linalg.slogdet(np.eye(n) + self.prior @ self.information(x))[1])

    def covariance(self, x: FloatArray, until: int) -> FloatArray:
        """Return the filter's covariance (3, 3) of state `until` from samples ≤ `until`."""
        n = len(self.prior)
        gained = np.eye(n) + self.prior @ self.information(x, until)
        now = slice(3 * until, 3 * until + 3)
        return np.asarray(np.linalg.solve(gained, self.prior[:, now])[now], dtype=np.float64)

    def trace(self, x: FloatArray, weight: str = "position") -> float:
        """Return the mean over samples of tr(W P_t), in m²."""
        w = WEIGHTS[weight]
        return float(np.mean([np.trace(w @ self.covariance(x, t)) for t in range(self.t)]))

    def final_entropy(self, x: FloatArray) -> float:
        """Return ½ log((2πe)³ det P_T), in nats."""
        log_det = np.linalg.slogdet(self.covariance(x, self.t - 1))[1]
        return float(0.5 * (3.0 * math.log(2.0 * math.pi * math.e) + log_det))


def choice(n_candidates: int, selected: IntArray | list[int]) -> FloatArray:
    """Return x (c,), 1 for each of `selected`."""
    x = np.zeros(n_candidates)
    x[np.asarray(selected, dtype=np.int64)] = 1.0
    return x
