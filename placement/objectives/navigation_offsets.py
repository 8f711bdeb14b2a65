"""The parts of the navigation objectives for drives whose cameras have persistent offsets."""

from __future__ import annotations

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.objectives.navigation_chain import Drive
from placement.objectives.windows.final import half_inverse, negative_entropy, require_finite
from placement.objectives.windows.offset_adjoint import offset_adjoint
from placement.objectives.windows.offset_curvature import OffsetCurvature
from placement.objectives.windows.offset_gains import (
    offset_entropy_gains,
    offset_final,
    offset_forgetting,
    offset_reductions,
    offsets_through,
)
from placement.objectives.windows.offset_information import inform_offsets
from placement.objectives.windows.offset_slopes import offset_slopes
from placement.objectives.windows.offsets import (
    filter_offsets,
    flat,
    make_plan,
    offset_shares,
    views_of,
)

LEAST_SHARE = 1e-12  # a smaller share of a camera is none: its offsets' variance is 1 / share


class OffsetDrive:
    """One drive laid out for the kernels."""

    def __init__(self, drive: Drive) -> None:
        """Take the drive's arrays and each camera's share of information about itself."""
        self.drive = drive
        self.steps = drive.steps()
        self.p0 = drive.initial_covariance()
        self.n_samples = drive.information.n_samples
        self.views = views_of(drive)
        self.shares = np.empty(drive.information.n_candidates)
        offset_shares(self.views, self.shares)


class Forward:
    """The filter over one placement: covariances after each sample, and their log dets."""

    def __init__(self, drive: OffsetDrive, selected: IntArray, x: FloatArray | None = None) -> None:
        """Filter along the whole drive; `x` (c,) gives the cameras' shares where fractional."""
        self.drive = drive
        self.plan = make_plan(drive.views, selected, drive.n_samples, x)
        self.matrices = flat(self.plan)
        self.log_before = np.empty(drive.n_samples)
        self.log_sum = float(
            filter_offsets(
                drive.steps, drive.p0, drive.views, self.plan, self.matrices, self.log_before
            )
        )
        self.log_det = self.log_sum - float(np.sum(drive.shares[self.plan.camera]))

    def car(self) -> FloatArray:
        """Return the covariance (t, 6) of the car's own states after each sample."""
        start = self.plan.matrix_ptr[:-1]
        n = np.sqrt(np.diff(self.plan.matrix_ptr)).astype(np.int64)
        where = [start, start + 1, start + 2, start + n + 1, start + n + 2, start + 2 * n + 2]
        return np.stack([self.matrices[w] for w in where], axis=1)

    def later(self) -> FloatArray:
        """Return the information of later samples, laid out as `matrices`."""
        later = flat(self.plan)
        inform_offsets(self.drive.steps, self.drive.views, self.plan, later)
        return later

    def forget(self) -> FloatArray:
        """Return G = Γ (I + P Γ)⁻¹ after each sample, laid out as `matrices`."""
        out = flat(self.plan)
        offset_forgetting(self.drive.views, self.plan, self.matrices, self.later(), out)
        return out

    def adjoint(self, seed: FloatArray, w_tt: float, w_nn: float) -> FloatArray:
        """Return the derivative of Σ_{τ > t} tr(W P_τ) + tr(seed P_T) by P_t, as `matrices`."""
        d, out = self.drive, flat(self.plan)
        offset_adjoint(d.steps, d.p0, d.views, self.plan, self.matrices, seed, w_tt, w_nn, out)
        return out

    def slopes(self, kernel: FloatArray, variance: float, w_tt: float, w_nn: float) -> FloatArray:
        """Return the derivative by every candidate's share (c,); see `offset_slopes`."""
        d, out = self.drive, np.empty(self.drive.shares.size)
        rows = np.arange(out.size)
        offset_slopes(
            rows,
            d.steps,
            d.p0,
            d.views,
            self.plan,
            self.matrices,
            kernel,
            variance,
            w_tt,
            w_nn,
            out,
        )
        return out

    def trace(self, w_tt: float, w_nn: float) -> float:
        """Return the mean of tr(W P_t), in m²."""
        car = self.car()
        return float(np.mean(w_tt * car[:, 0] + w_nn * car[:, 3]))


class OffsetEntropy:
    """One drive's entropy; a score is a log det ratio, in nats."""

    def __init__(self, drive: Drive) -> None:
        """Lay the drive out."""
        self.drive = OffsetDrive(drive)
        self._curvature: OffsetCurvature | None = None

    def score(self, selected: IntArray) -> float:
        """Return the log det ratio of a placement, in nats."""
        return Forward(self.drive, selected).log_det

    def messages(self, selected: IntArray) -> OffsetEntropyMessages:
        """Filter forward and backward once; gains then need their own windows only."""
        return OffsetEntropyMessages(self.drive, selected)

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return the log det at information Σ x_i Λ_i and its gradient (c,)."""
        f = Forward(self.drive, support(x), x)
        forget = f.forget()
        return f.log_det, f.slopes(-forget, 1.0, 0.0, 0.0)

    def curvature(self, x: FloatArray, among: IntArray) -> FloatArray | None:
        """Return the second derivatives (m, m) by the shares of `among`, nearly."""
        if self._curvature is None:
            self._curvature = OffsetCurvature(self.drive.drive)
        return self._curvature.at(x, among) if self._curvature.tells else None


class OffsetTrace:
    """One drive's trace; a score is minus the mean of tr(W P_t), in m²."""

    def __init__(self, drive: Drive, w_tt: float, w_nn: float) -> None:
        """Lay the drive out; w_tt and w_nn weigh the variance along and across the road."""
        self.drive = OffsetDrive(drive)
        self.w_tt, self.w_nn = w_tt, w_nn

    def score(self, selected: IntArray) -> float:
        """Return minus the mean of tr(W P_t) of a placement, in m²."""
        return -Forward(self.drive, selected).trace(self.w_tt, self.w_nn)

    def messages(self, selected: IntArray) -> OffsetTraceMessages:
        """Filter forward once, and backward for the information and the adjoint."""
        return OffsetTraceMessages(self.drive, selected, self.w_tt, self.w_nn)

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return minus the mean at information Σ x_i Λ_i of every prefix, and its gradient (c,)."""
        f = Forward(self.drive, support(x), x)
        future = f.adjoint(np.zeros(6), self.w_tt, self.w_nn)
        slopes = f.slopes(future, 0.0, self.w_tt, self.w_nn)
        return -f.trace(self.w_tt, self.w_nn), slopes / self.drive.n_samples


class OffsetFinalEntropy:
    """One drive's final entropy; a score is minus ½ log((2πe)³ det P_T), in nats."""

    def __init__(self, drive: Drive) -> None:
        """Lay the drive out; refuse one that ends without any uncertainty to speak of."""
        self.drive = OffsetDrive(drive)
        require_finite(self.score(np.empty(0, dtype=np.int64)))

    def score(self, selected: IntArray) -> float:
        """Return −½ log((2πe)³ det P_T) of a placement, in nats."""
        return negative_entropy(Forward(self.drive, selected).car()[-1])

    def messages(self, selected: IntArray) -> OffsetFinalMessages:
        """Filter along the drive once; each gain is followed from its window to the end."""
        return OffsetFinalMessages(self.drive, selected)

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return the score at information Σ x_i Λ_i and its gradient (c,)."""
        f = Forward(self.drive, support(x), x)
        end = f.car()[-1]
        future = f.adjoint(half_inverse(end), 0.0, 0.0)
        return negative_entropy(end), f.slopes(future, 0.0, 0.0, 0.0)


def support(x: FloatArray) -> IntArray:
    """Return the candidates with a share to speak of; 1 / x must stay a number."""
    return np.flatnonzero(x > LEAST_SHARE)


class OffsetEntropyMessages:
    """Forward covariances and backward information of one placement."""

    def __init__(self, drive: OffsetDrive, selected: IntArray) -> None:
        """Compute the messages along the whole drive."""
        self.drive = drive
        self.forward = f = Forward(drive, selected)
        self.score = f.log_det
        self.later = f.later()
        self.through = np.empty(drive.n_samples)
        offsets_through(
            drive.views, f.plan, f.matrices, self.later, f.log_before, f.log_sum, self.through
        )

    def gains(self, rows: IntArray) -> FloatArray:
        """Return the gain (m,) of each candidate of `rows`, in nats."""
        d, f = self.drive, self.forward
        out = np.empty(rows.size)
        offset_entropy_gains(
            rows,
            d.steps,
            d.p0,
            d.views,
            f.plan,
            f.matrices,
            self.later,
            f.log_before,
            self.through,
            d.shares,
            out,
        )
        return out


class OffsetTraceMessages:
    """Covariances, the adjoint and what later samples make the filter forget."""

    def __init__(self, drive: OffsetDrive, selected: IntArray, w_tt: float, w_nn: float) -> None:
        """Compute the messages along the whole drive."""
        self.drive = drive
        self.w_tt, self.w_nn = w_tt, w_nn
        self.forward = f = Forward(drive, selected)
        self.score = -f.trace(w_tt, w_nn)
        self.forget = f.forget()
        self.future = f.adjoint(np.zeros(6), w_tt, w_nn)

    def gains(self, rows: IntArray) -> FloatArray:
        """Return the fall of the mean (m,) on adding each candidate of `rows`, in m²."""
        d, f = self.drive, self.forward
        out = np.empty(rows.size)
        offset_reductions(
            rows,
            d.steps,
            d.p0,
            d.views,
            f.plan,
            f.matrices,
            self.future,
            self.forget,
            self.w_tt,
            self.w_nn,
            out,
        )
        return out / d.n_samples


class OffsetFinalMessages:
    """The filter over one placement, for the covariance it ends with."""

    def __init__(self, drive: OffsetDrive, selected: IntArray) -> None:
        """Filter along the whole drive."""
        self.drive = drive
        self.forward = Forward(drive, selected)
        self.score = negative_entropy(self.forward.car()[-1])

    def gains(self, rows: IntArray) -> FloatArray:
        """Return the fall of the final entropy (m,) on adding each candidate of `rows`.

        Each is followed to the end of the drive: this objective is here for comparison.
        """
        d, f = self.drive, self.forward
        ends = np.empty((rows.size, 6))
        offset_final(rows, d.steps, d.p0, d.views, f.plan, f.matrices, ends)
        return np.array([negative_entropy(end) for end in ends]) - self.score
