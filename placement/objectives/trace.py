"""How well the filter knows where the car is, on average along the drive.

    value(S) = mean over samples of tr(W P_t),   P_t the filter's covariance after sample t

in m², minimised; W picks the position, or its lateral component. P_t is convex in the information
of the samples up to t (the inverse is operator-convex, and P_t a block of it), so fractional
choices have a convex value. Not submodular: no guarantee of greedy's holds, and greedy measured
9–59 % worse than the best placements found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.objectives.navigation import DrivePart, NavigationObjective, WhiteDrive
from placement.objectives.navigation_chain import Drive
from placement.objectives.navigation_offsets import OffsetTrace
from placement.objectives.windows.filter import (
    empty_messages,
    filter_forward,
    inform_backward,
    trace_against,
)
from placement.objectives.windows.trace import (
    filter_adjoint,
    forgetting,
    leaps,
    position_slopes,
    window_reductions,
)

WEIGHTS = {"position": (1.0, 1.0), "lateral": (0.0, 1.0)}


class Trace(NavigationObjective):
    """Score placements by the mean squared error that the filter expects, in m²."""

    name = "trace"
    unit = "m^2"
    maximise = False
    submodular = False

    def __init__(self, drives: Sequence[Drive], weight: str = "position") -> None:
        """Check the weight: `position` or `lateral`."""
        if weight not in WEIGHTS:
            raise ValueError(f"objective.weight must be one of {sorted(WEIGHTS)}, got {weight!r}")
        self.weight = weight
        super().__init__(drives)

    def over(self, drives: Sequence[Drive]) -> Trace:
        """Return the same objective over other drives."""
        return Trace(drives, self.weight)

    @property
    def persistent(self) -> bool:
        """Whether any drive's cameras have offsets that all their frames share."""
        return any(drive.persistent for drive in self.drives)

    def offsets_known(self) -> Trace:
        """Return the objective of cameras whose offsets are known: below this one for every set.

        Whoever knows the offsets estimates no worse than whoever does not: with offsets o,
        P = E Cov(e | z, o) + Cov E(e | z, o) ≥ E Cov(e | z, o), and for Gaussians Cov(e | z, o)
        depends on neither z nor o. What is left of a camera is its white information.
        """
        drives = []
        for drive in self.drives:
            information = drive.information
            if information.white is not None:
                information = replace(
                    information, blocks=information.white, white=None, offsets=None
                )
            drives.append(replace(drive, information=information))
        return Trace(drives, self.weight)

    def _part(self, drive: Drive) -> DrivePart:
        part = OffsetTrace if drive.persistent else WhiteTrace
        return part(drive, *WEIGHTS[self.weight])


class WhiteTrace:
    """One drive's trace where every frame is independent; its score is minus the mean."""

    def __init__(self, drive: Drive, w_tt: float, w_nn: float) -> None:
        """Lay the drive out; w_tt and w_nn weigh the variance along and across the road."""
        self.drive = WhiteDrive(drive)
        self.w_tt, self.w_nn = w_tt, w_nn

    def score(self, selected: IntArray) -> float:
        """Return minus the mean of tr(W P_t) of a placement, in m²."""
        return self._score(self.drive.total(selected), *empty_messages(self.drive.n_samples))

    def _score(
        self, total: FloatArray, before: FloatArray, after: FloatArray, logs: FloatArray
    ) -> float:
        filter_forward(self.drive.steps, self.drive.p0, total, before, after, logs)
        return -float(np.mean(self.w_tt * after[:, 0] + self.w_nn * after[:, 3]))

    def messages(self, selected: IntArray) -> WhiteTraceMessages:
        """Filter forward once, and backward for the information and the adjoint."""
        return WhiteTraceMessages(self, selected)

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return minus the mean at information Σ x_i J_i, and its gradient (c,)."""
        d = self.drive
        support = np.flatnonzero(x)
        total = d.total(support, x[support])
        before, after, logs = empty_messages(d.n_samples)
        score = self._score(total, before, after, logs)
        future = np.empty_like(after)
        filter_adjoint(d.steps, total, before, np.zeros(6), self.w_tt, self.w_nn, future)
        slopes = np.empty((d.n_samples, 3))
        position_slopes(after, future, self.w_tt, self.w_nn, slopes)
        gradient = np.empty(x.size)
        rows = np.arange(x.size)
        trace_against(d.indptr, d.indices, d.blocks, d.frames / d.n_samples, slopes, rows, gradient)
        return score, gradient


class WhiteTraceMessages:
    """Covariances, later information and the adjoint of one placement."""

    def __init__(self, part: WhiteTrace, selected: IntArray) -> None:
        """Compute the messages along the whole drive."""
        d = self.drive = part.drive
        self.w_tt, self.w_nn = part.w_tt, part.w_nn
        self.total = d.total(selected)
        self.before, self.after, logs = empty_messages(d.n_samples)
        self.score = part._score(self.total, self.before, self.after, logs)  # noqa: SLF001
        later = np.empty_like(self.after)
        inform_backward(d.steps, self.total, later)
        self.forget = np.empty_like(later)
        forgetting(self.after, later, self.forget)
        self.future = np.empty_like(later)
        filter_adjoint(
            d.steps, self.total, self.before, np.zeros(6), self.w_tt, self.w_nn, self.future
        )
        self.target = np.empty(d.n_samples, dtype=np.int64)
        self.leap, self.passed = np.empty_like(d.steps), np.empty_like(later)
        leaps(d.steps, self.total, self.w_tt, self.w_nn, self.target, self.leap, self.passed)
        self.walked = np.empty(0, dtype=np.int64)

    def gains(self, rows: IntArray) -> FloatArray:
        """Return the fall of the mean (m,) on adding each candidate of `rows`, in m²."""
        d = self.drive
        out, self.walked = np.empty(rows.size), np.empty(rows.size, dtype=np.int64)
        window_reductions(
            d.indptr,
            d.indices,
            d.blocks,
            d.frames,
            rows,
            d.steps,
            self.total,
            self.before,
            self.after,
            self.future,
            self.forget,
            self.target,
            self.leap,
            self.passed,
            self.w_tt,
            self.w_nn,
            out,
            self.walked,
        )
        return out / d.n_samples
