"""What the navigation objectives share: drives summed, states that keep messages, white errors.

An objective is a weighted sum of one part a drive. A part evaluates a placement from scratch,
prepares the messages that make gains cheap, and extends its score to fractional choices.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.objectives.navigation_chain import Drive, checked_drives
from placement.objectives.selection import Selection, distinct
from placement.objectives.windows.filter import add_rows


class Messages(Protocol):
    """What a part remembers about one placement."""

    @property
    def score(self) -> float:
        """The drive's score of the placement."""

    def gains(self, rows: IntArray) -> FloatArray:
        """Return the change of the score on adding each candidate of `rows` (m,)."""


class DrivePart(Protocol):
    """One drive's share of an objective; larger scores are better."""

    def score(self, selected: IntArray) -> float:
        """Evaluate a placement from scratch."""

    def messages(self, selected: IntArray) -> Messages:
        """Prepare the gains of a placement's neighbours."""

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return the score and its gradient (c,) at the fractional choice `x` (c,)."""


class NavigationObjective:
    """Sum the weighted parts of several drives; subclasses name the objective and its parts."""

    name = ""
    unit = ""
    maximise = True
    submodular = False

    def __init__(self, drives: Sequence[Drive]) -> None:
        """Check the drives and prepare each one's part."""
        self.drives = checked_drives(drives)
        self._parts = [(drive.weight, self._part(drive)) for drive in self.drives]

    def _part(self, drive: Drive) -> DrivePart:
        raise NotImplementedError

    def over(self, drives: Sequence[Drive]) -> NavigationObjective:
        """Return the same objective over other drives."""
        return type(self)(drives)

    @property
    def n_candidates(self) -> int:
        """The number of candidates, c."""
        return self.drives[0].information.n_candidates

    def parts(self) -> list[tuple[float, DrivePart]]:
        """Return every drive's weight and part, for methods that work on one drive at a time."""
        return list(self._parts)

    def value(self, selected: IntArray) -> float:
        """Evaluate a placement from scratch: one pass of the filter over each drive."""
        chosen = distinct(selected, self.n_candidates)
        score = sum(weight * part.score(chosen) for weight, part in self._parts)
        return float(score if self.maximise else -score)

    def state(self, selected: IntArray | None = None) -> NavigationState:
        """Start a placement, empty unless `selected` is given."""
        chosen = [] if selected is None else distinct(selected, self.n_candidates).tolist()
        return NavigationState(self._parts, self.n_candidates, chosen)

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Return the concave extension of the score and its gradient (c,) at `x` (c,) in [0, 1].

        Each camera's information is scaled by its x. The information of a drive, and of each of
        its prefixes, is then linear in x; log det is concave in it and a filter covariance convex.
        """
        x = np.ascontiguousarray(x, dtype=np.float64)
        if x.shape != (self.n_candidates,):
            raise ValueError(f"x must have shape ({self.n_candidates},), got {x.shape}")
        score, gradient = 0.0, np.zeros(self.n_candidates)
        for weight, part in self._parts:
            part_score, part_gradient = part.relaxed(x)
            score += weight * part_score
            gradient += weight * part_gradient
        return score, gradient


class NavigationState(Selection):
    """A placement under construction; messages are renewed when something asks for them."""

    def __init__(
        self, parts: list[tuple[float, DrivePart]], n_candidates: int, selected: list[int]
    ) -> None:
        """Start from `selected`."""
        super().__init__(n_candidates, selected)
        self._parts = parts
        self._messages: list[tuple[float, Messages]] | None = None

    @property
    def score(self) -> float:
        """The score of `selected`."""
        return float(sum(weight * m.score for weight, m in self._renewed()))

    def gains(self, candidates: IntArray | None = None) -> FloatArray:
        """Return the change of the score on adding each of `candidates` (default: all), (m,).

        A candidate that is already selected gains 0.
        """
        rows = np.arange(self._n_candidates) if candidates is None else np.asarray(candidates)
        rows = np.ascontiguousarray(rows, dtype=np.int64)
        out = np.zeros(rows.size)
        for weight, message in self._renewed():
            out += weight * message.gains(rows)
        out[np.isin(rows, self._selected)] = 0.0
        return out

    def _changed(self) -> None:
        self._messages = None

    def _renewed(self) -> list[tuple[float, Messages]]:
        if self._messages is None:
            # sorted, so that the sums do not depend on the order of adding
            chosen = np.array(sorted(self._selected), dtype=np.int64)
            self._messages = [(weight, part.messages(chosen)) for weight, part in self._parts]
        return self._messages


class WhiteDrive:
    """One drive whose frames are independent: the chain's arrays and the cameras' blocks."""

    def __init__(self, drive: Drive) -> None:
        """Lay the drive out for the kernels."""
        information = drive.information
        self.steps = drive.steps()
        self.p0 = drive.initial_covariance()
        self.n_samples = information.n_samples
        self.indptr = np.ascontiguousarray(information.indptr, dtype=np.int64)
        self.indices = np.ascontiguousarray(information.indices, dtype=np.int32)
        self.blocks: NDArray[np.float32] = np.ascontiguousarray(
            information.blocks, dtype=np.float32
        )
        self.frames = float(information.frames_per_sample)

    def total(self, rows: IntArray, weights: FloatArray | None = None) -> FloatArray:
        """Return the information (t, 3) of the candidates `rows`, each times its weight."""
        total = np.zeros((self.n_samples, 3))
        weights = np.ones(rows.size) if weights is None else weights
        add_rows(self.indptr, self.indices, self.blocks, self.frames, weights, rows, total)
        return total
