"""What the cameras tell about the whole trajectory: the log det of its information matrix.

    f(S) = log det(Λ_odometry + Σ_{i ∈ S} Λ_i) − log det Λ_odometry = Σ_t log det(I + P_t J_t)

in nats: twice the mutual information of the measurements and the trajectory, a gain over the
empty placement (Krause et al. 2008 for sensors, Cover & Thomas for the chain rule on the right,
with P_t the filter's predicted covariance). Monotone and submodular in S, because log det of a sum
of positive semidefinite matrices is; concave in fractional choices.
"""

from __future__ import annotations

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.objectives.navigation import DrivePart, NavigationObjective, WhiteDrive
from placement.objectives.navigation_chain import Drive
from placement.objectives.navigation_offsets import OffsetEntropy
from placement.objectives.windows.entropy import (
    block_transfers,
    empty_transfers,
    log_det_through,
    window_gains,
)
from placement.objectives.windows.filter import (
    empty_messages,
    filter_forward,
    inform_backward,
    smoothed_positions,
    trace_against,
)


class Entropy(NavigationObjective):
    """Score placements by the information about the trajectories of `drives`, in nats."""

    name = "entropy"
    unit = "nats"
    maximise = True
    submodular = True

    def _part(self, drive: Drive) -> DrivePart:
        return OffsetEntropy(drive) if drive.persistent else WhiteEntropy(drive)

    def curvature(self, x: FloatArray, among: IntArray) -> FloatArray | None:
        """Return the second derivatives (m, m), nearly; None unless all drives have offsets."""
        total = np.zeros((among.size, among.size))
        for weight, part in self._parts:
            found = part.curvature(x, among) if isinstance(part, OffsetEntropy) else None
            if found is None:
                return None
            total += weight * found
        return total


class WhiteEntropy:
    """One drive's entropy where every frame is independent."""

    def __init__(self, drive: Drive) -> None:
        """Lay the drive out."""
        self.drive = WhiteDrive(drive)

    def score(self, selected: IntArray) -> float:
        """Return the log det ratio of a placement, in nats."""
        d = self.drive
        return float(filter_forward(d.steps, d.p0, d.total(selected), *empty_messages(d.n_samples)))

    def messages(self, selected: IntArray) -> WhiteEntropyMessages:
        """Filter forward and backward once; gains then need their own windows only."""
        return WhiteEntropyMessages(self.drive, selected)

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return the log det at information Σ x_i J_i, and tr(J_i Σ_smoothed) for each i."""
        d = self.drive
        support = np.flatnonzero(x)
        total = d.total(support, x[support])
        before, after, logs = empty_messages(d.n_samples)
        score = float(filter_forward(d.steps, d.p0, total, before, after, logs))
        later = np.empty_like(after)
        inform_backward(d.steps, total, later)
        smoothed = np.empty((d.n_samples, 3))
        smoothed_positions(after, later, smoothed)
        rows = np.arange(x.size)
        gradient = np.empty(x.size)
        trace_against(d.indptr, d.indices, d.blocks, d.frames, smoothed, rows, gradient)
        return score, gradient


class WhiteEntropyMessages:
    """Forward covariances and backward information of one placement."""

    def __init__(self, drive: WhiteDrive, selected: IntArray) -> None:
        """Compute the messages along the whole drive."""
        self.drive = drive
        self.total = drive.total(selected)
        self.before, self.after, self.log_before = empty_messages(drive.n_samples)
        self.score = float(
            filter_forward(
                drive.steps, drive.p0, self.total, self.before, self.after, self.log_before
            )
        )
        self.later = np.empty_like(self.after)
        inform_backward(drive.steps, self.total, self.later)
        self.through = np.empty(drive.n_samples)
        log_det_through(
            self.after, self.later, self.total, self.before, self.log_before, self.through
        )
        self.transfers = empty_transfers(drive.n_samples)
        block_transfers(drive.steps, self.total, self.transfers)

    def gains(self, rows: IntArray) -> FloatArray:
        """Return the gain (m,) of each candidate of `rows`, in nats."""
        d = self.drive
        out = np.empty(rows.size)
        window_gains(
            d.indptr,
            d.indices,
            d.blocks,
            d.frames,
            rows,
            d.steps,
            self.total,
            self.before,
            self.later,
            self.log_before,
            self.through,
            self.transfers,
            out,
        )
        return out
