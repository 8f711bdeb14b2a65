"""The entropy of where the car is at the end of its drive: ½ log((2πe)³ det P_T), in nats.

Minimised; kept for the comparison with the dissertation. −log det P_T is concave in the cameras'
information (it is the log det of a Schur complement), so fractional choices have a concave score.
It is monotone but not submodular: the measurements are not independent given the last state alone.
"""

from __future__ import annotations

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.objectives.navigation import DrivePart, NavigationObjective, WhiteDrive
from placement.objectives.navigation_chain import Drive
from placement.objectives.navigation_offsets import OffsetFinalEntropy
from placement.objectives.windows.entropy import N_TRANSFER
from placement.objectives.windows.filter import empty_messages, filter_forward, trace_against
from placement.objectives.windows.final import (
    LOG_2_PI_E_CUBED,
    half_inverse,
    negative_entropy,
    require_finite,
    transfers_to_end,
    window_final_falls,
)
from placement.objectives.windows.trace import filter_adjoint, position_slopes


class FinalEntropy(NavigationObjective):
    """Score placements by the entropy of the final state of each drive, in nats."""

    name = "final_entropy"
    unit = "nats"
    maximise = False
    submodular = False

    def _part(self, drive: Drive) -> DrivePart:
        return OffsetFinalEntropy(drive) if drive.persistent else WhiteFinalEntropy(drive)


class WhiteFinalEntropy:
    """One drive's final entropy where every frame is independent; its score is minus that."""

    def __init__(self, drive: Drive) -> None:
        """Lay the drive out; refuse one that ends without any uncertainty to speak of."""
        self.drive = WhiteDrive(drive)
        require_finite(self.score(np.empty(0, dtype=np.int64)))

    def score(self, selected: IntArray) -> float:
        """Return −½ log((2πe)³ det P_T) of a placement, in nats."""
        return self._score(self.drive.total(selected), *empty_messages(self.drive.n_samples))

    def _score(
        self, total: FloatArray, before: FloatArray, after: FloatArray, logs: FloatArray
    ) -> float:
        filter_forward(self.drive.steps, self.drive.p0, total, before, after, logs)
        return negative_entropy(after[-1])

    def messages(self, selected: IntArray) -> WhiteFinalMessages:
        """Filter forward once, and build the maps to the end backward."""
        return WhiteFinalMessages(self, selected)

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return the score at information Σ x_i J_i, and its gradient (c,)."""
        d = self.drive
        support = np.flatnonzero(x)
        total = d.total(support, x[support])
        before, after, logs = empty_messages(d.n_samples)
        score = self._score(total, before, after, logs)
        seed = half_inverse(after[-1])
        future = np.empty_like(after)
        filter_adjoint(d.steps, total, before, seed, 0.0, 0.0, future)
        slopes = np.empty((d.n_samples, 3))
        position_slopes(after, future, 0.0, 0.0, slopes)
        gradient = np.empty(x.size)
        rows = np.arange(x.size)
        trace_against(d.indptr, d.indices, d.blocks, d.frames, slopes, rows, gradient)
        return score, gradient


class WhiteFinalMessages:
    """Forward covariances and the maps to the end of one placement."""

    def __init__(self, part: WhiteFinalEntropy, selected: IntArray) -> None:
        """Compute the messages along the whole drive."""
        d = self.drive = part.drive
        self.total = d.total(selected)
        self.before, self.after, logs = empty_messages(d.n_samples)
        self.score = part._score(self.total, self.before, self.after, logs)  # noqa: SLF001
        self.transfers = np.empty((d.n_samples, N_TRANSFER))
        transfers_to_end(d.steps, self.total, self.transfers)

    def gains(self, rows: IntArray) -> FloatArray:
        """Return the fall of the final entropy (m,) on adding each candidate of `rows`."""
        d = self.drive
        out = np.empty(rows.size)
        base = -2.0 * self.score - LOG_2_PI_E_CUBED
        window_final_falls(
            d.indptr,
            d.indices,
            d.blocks,
            d.frames,
            rows,
            d.steps,
            self.total,
            self.before,
            self.transfers,
            base,
            out,
        )
        return 0.5 * out
