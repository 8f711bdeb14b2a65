"""The fewest, or cheapest, cameras that keep the filter within tolerance everywhere.

    value(S) = |S|, or the cost of S      if 2σ_t ≤ τ at every sample t of every drive,

σ_t² the filter's lateral variance after sample t, by the recursion of `trace`; with `failures` = 1
the same must hold without any one camera of S. Otherwise the value is

    ceiling · (1 + excess),   excess = max over failures, Σ over drives, of mean_t (4σ_t²/τ² − 1)⁺,

with the ceiling above the value of every placement, so that methods which climb find their way to
tolerance first and to few cameras then. Minimised; neither submodular nor convex.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.objectives.navigation import WhiteDrive
from placement.objectives.navigation_chain import Drive, checked_drives
from placement.objectives.navigation_offsets import Forward, OffsetDrive
from placement.objectives.selection import Selection, distinct
from placement.objectives.windows.filter import empty_messages, filter_forward
from placement.objectives.windows.offset_violation import offset_reach_with
from placement.objectives.windows.violation import excess_with, reach_with, violations

# Relative: a variance on the limit is within it, whatever the order of the sums.
ON_THE_LIMIT = 1e-9


class TolerancePart(Protocol):
    """One drive: where its lateral variance exceeds the limit."""

    n_samples: int

    def lateral(self, selected: IntArray) -> FloatArray:
        """Return the lateral variance (t,) with the cameras `selected`, in m²."""

    def within(self, selected: IntArray) -> bool:
        """Return whether that is nowhere above the limit."""

    def reach(self, selected: IntArray, rows: IntArray) -> tuple[float, FloatArray]:
        """Return the first violation with `selected`, and with each of `rows` (m,) beside.

        In samples, t where there is none; fractions tell near misses apart.
        """


class Tolerance:
    """Count, or price, placements that are in tolerance."""

    name = "tolerance"
    maximise = False
    submodular = False

    def __init__(
        self,
        drives: Sequence[Drive],
        tolerance_m: float,
        failures: int = 0,
        cost: FloatArray | None = None,
    ) -> None:
        """Lay the drives out; `cost` (c,) prices the candidates, 1 each if left out.

        Raises:
            ValueError: for a tolerance that is not positive, or that all candidates together miss.
        """
        if not (math.isfinite(tolerance_m) and tolerance_m > 0.0):
            raise ValueError(f"objective.tolerance_m must be positive, got {tolerance_m}")
        if failures not in (0, 1):
            raise ValueError(f"budget.failures must be 0 or 1, got {failures}")
        self.drives = checked_drives(drives)
        self.tolerance_m = tolerance_m
        self.failures = failures
        self.limit = (0.5 * tolerance_m) ** 2 * (1.0 + ON_THE_LIMIT)
        n = self.drives[0].information.n_candidates
        self.unit = "cameras" if cost is None else "money"
        self.cost = np.ones(n) if cost is None else cost
        self.ceiling = 1.0 + math.fsum(self.cost)
        self.parts: list[TolerancePart] = [
            OffsetTolerance(d, self.limit) if d.persistent else WhiteTolerance(d, self.limit)
            for d in self.drives
        ]
        for drive in self.drives:
            refuse_unreachable(drive, tolerance_m, self.limit)

    @property
    def n_candidates(self) -> int:
        """The number of candidates, c."""
        return self.drives[0].information.n_candidates

    def price(self, selected: IntArray | Sequence[int]) -> float:
        """Return the number of cameras, or what they cost."""
        return math.fsum(self.cost[np.asarray(selected, dtype=np.int64)])

    def scenarios(self, selected: IntArray) -> list[IntArray]:
        """Return the sets of working cameras: all, and with failures all but each one."""
        alone = [np.delete(selected, n) for n in range(selected.size)] if self.failures else []
        return [selected, *alone]

    def excess(self, selected: IntArray) -> float:
        """Return how far a placement is from tolerance; 0 where it is in tolerance."""
        chosen = distinct(selected, self.n_candidates)
        return max(self._excess(working) for working in self.scenarios(chosen))

    def feasible(self, selected: IntArray) -> bool:
        """Return whether a placement is in tolerance."""
        chosen = distinct(selected, self.n_candidates)
        return all(
            part.within(working) for working in self.scenarios(chosen) for part in self.parts
        )

    def value(self, selected: IntArray) -> float:
        """Evaluate a placement from scratch."""
        return self._value(self.excess(selected), selected)

    def state(self, selected: IntArray | None = None) -> ToleranceState:
        """Start a placement, empty unless `selected` is given."""
        chosen = [] if selected is None else distinct(selected, self.n_candidates).tolist()
        return ToleranceState(self, chosen)

    def shortfall(self, selected: IntArray) -> str | None:
        """Say where a placement is out of tolerance; None if it nowhere is."""
        chosen = distinct(selected, self.n_candidates)
        worst, text = self.limit, None
        for n, working in enumerate(self.scenarios(chosen)):
            for drive, part in zip(self.drives, self.parts, strict=True):
                lateral = part.lateral(working)
                t = int(np.argmax(lateral))
                if lateral[t] > worst:
                    worst = float(lateral[t])
                    dark = f" with candidate {chosen[n - 1]} dark" if n else ""
                    text = (
                        f"2σ across the road reaches {2.0 * math.sqrt(worst):.4g} m at "
                        f"s = {drive.points.s_m[t]:.0f} m{dark}, and objective.tolerance_m is "
                        f"{self.tolerance_m:g}"
                    )
        return text

    def _excess(self, working: IntArray) -> float:
        return math.fsum(
            float(np.mean(np.maximum(part.lateral(working) / self.limit - 1.0, 0.0)))
            for part in self.parts
        )

    def _value(self, excess: float, selected: IntArray | Sequence[int]) -> float:
        return self.ceiling * (1.0 + excess) if excess > 0.0 else self.price(selected)


class WhiteTolerance:
    """One drive whose frames are independent."""

    def __init__(self, drive: Drive, limit: float) -> None:
        """Lay the drive out for the kernels."""
        self.drive = WhiteDrive(drive)
        self.n_samples = self.drive.n_samples
        self.limit = limit

    def lateral(self, selected: IntArray) -> FloatArray:
        """Return the lateral variance (t,), in m²."""
        return self.filtered(selected)[2]

    def within(self, selected: IntArray) -> bool:
        """Return whether the lateral variance is nowhere above the limit."""
        return self.filtered(selected)[3] >= self.n_samples

    def reach(self, selected: IntArray, rows: IntArray) -> tuple[float, FloatArray]:
        """Return the first violation now, and with each of `rows` beside."""
        d = self.drive
        total, before, lateral, first = self.filtered(selected)
        out = np.empty(rows.size)
        reach_with(
            d.indptr, d.indices, d.blocks, d.frames, rows, d.steps, total, before, first,
            self.limit, out,
        )  # fmt: skip
        return with_fraction(first, lateral, self.limit), out

    def excess_with(self, selected: IntArray, rows: IntArray) -> FloatArray:
        """Return the mean excess with each of `rows` (m,) beside `selected`."""
        d, out = self.drive, np.empty(rows.size)
        total, before, lateral, _ = self.filtered(selected)
        earlier = np.concatenate([[0.0], np.cumsum(np.maximum(lateral / self.limit - 1.0, 0.0))])
        excess_with(
            d.indptr, d.indices, d.blocks, d.frames, rows, d.steps, total, before, earlier,
            self.limit, out,
        )  # fmt: skip
        return out / d.n_samples

    def filtered(self, selected: IntArray) -> tuple[FloatArray, FloatArray, FloatArray, int]:
        """Return information, covariances before, lateral variances after, first violation."""
        d = self.drive
        total, before = d.total(selected), np.empty((d.n_samples, 6))
        lateral = np.empty(d.n_samples)
        first = violations(d.steps, d.p0, total, self.limit, before, lateral)
        return total, before, lateral, int(first)


class OffsetTolerance:
    """One drive whose cameras have persistent offsets."""

    def __init__(self, drive: Drive, limit: float) -> None:
        """Lay the drive out for the kernels."""
        self.drive = OffsetDrive(drive)
        self.n_samples = self.drive.n_samples
        self.limit = limit
        self._white = white_part(drive)

    def lateral(self, selected: IntArray) -> FloatArray:
        """Return the lateral variance (t,), in m²."""
        return Forward(self.drive, selected).car()[:, 3]

    def within(self, selected: IntArray) -> bool:
        """Return whether the lateral variance is nowhere above the limit.

        Whoever knows all offsets does no worse, and is told much sooner.
        """
        d, before = self._white, np.empty((self.n_samples, 6))
        lateral, limit = np.empty(self.n_samples), self.limit * (1.0 + ON_THE_LIMIT)
        if violations(d.steps, d.p0, d.total(selected), limit, before, lateral) < self.n_samples:
            return False
        return bool(np.all(self.lateral(selected) <= self.limit))

    def reach(self, selected: IntArray, rows: IntArray) -> tuple[float, FloatArray]:
        """Return the first violation now, and with each of `rows` beside."""
        d = self.drive
        car = Forward(d, selected).car()
        above = np.flatnonzero(car[:, 3] > self.limit)
        first = int(above[0]) if above.size else d.n_samples
        v = d.views
        pending = np.zeros(d.n_samples, dtype=np.bool_)
        for i in selected:
            seen = v.indices[v.indptr[i] : v.indptr[i + 1]]
            if seen.size:
                pending[seen[0] : seen[-1]] = True
        out = np.empty(rows.size)
        offset_reach_with(
            v.indptr, v.indices, v.white, v.offsets, v.frames, rows, selected, d.steps, d.p0, car,
            pending, first, self.limit, out,
        )  # fmt: skip
        return with_fraction(first, car[:, 3], self.limit), out


class ToleranceState(Selection):
    """A placement under construction."""

    def __init__(self, objective: Tolerance, selected: list[int]) -> None:
        """Start from `selected`."""
        super().__init__(objective.n_candidates, selected)
        self._objective = objective
        self._excess: float | None = None

    @property
    def score(self) -> float:
        """Minus the value of `selected`."""
        return -self._objective._value(self._known_excess(), self._selected)  # noqa: SLF001

    def gains(self, candidates: IntArray | None = None) -> FloatArray:
        """Return the change of the score on adding each of `candidates` (default: all), (m,)."""
        o = self._objective
        rows = np.arange(o.n_candidates) if candidates is None else np.asarray(candidates)
        rows = np.ascontiguousarray(rows, dtype=np.int64)
        spent = o.price(self._selected) + o.cost[rows]
        excess = self._excess_with(rows)
        after = np.where(excess > 0.0, o.ceiling * (1.0 + excess), spent)
        gains: FloatArray = -after - self.score
        gains[np.isin(rows, self._selected)] = 0.0
        return gains

    def _changed(self) -> None:
        self._excess = None

    def _known_excess(self) -> float:
        if self._excess is None:
            self._excess = self._objective.excess(np.array(self._selected, dtype=np.int64))
        return self._excess

    def _excess_with(self, rows: IntArray) -> FloatArray:
        """Return the excess (m,) with each of `rows` beside: the worst over what may fail."""
        o, chosen = self._objective, np.array(sorted(self._selected), dtype=np.int64)
        worst = np.full(rows.size, self._known_excess() if o.failures else 0.0)  # itself dark
        if o.failures and chosen.size:
            worst[:] = o._excess(chosen)  # noqa: SLF001
        for n in range(len(o.scenarios(chosen))):
            working = chosen if n == 0 else np.delete(chosen, n - 1)
            total = np.zeros(rows.size)
            for part in o.parts:
                if isinstance(part, WhiteTolerance):
                    total += part.excess_with(working, rows)
                    continue
                for k, i in enumerate(rows):
                    beside = np.union1d(working, [i])
                    lateral = part.lateral(beside)
                    total[k] += float(np.mean(np.maximum(lateral / o.limit - 1.0, 0.0)))
            worst = np.maximum(worst, total)
        return worst


def with_fraction(first: int, lateral: FloatArray, limit: float) -> float:
    """Return a first violation as `reach_with` gives it."""
    return float(first) if first >= lateral.size else first + limit / float(lateral[first])


def white_part(drive: Drive) -> WhiteDrive:
    """Return the drive as if every camera's offsets were known exactly.

    Its cameras tell at least as much as the real ones: what is learned given the offsets has
    greater information than what is learned without them.
    """
    white = WhiteDrive(drive)
    if drive.persistent:
        white.blocks = np.ascontiguousarray(drive.information.white, dtype=np.float32)
    return white


def refuse_unreachable(drive: Drive, tolerance_m: float, limit: float) -> None:
    """Refuse a tolerance that all candidates together, offsets known, do not keep."""
    white = white_part(drive)
    before, after, logs = empty_messages(white.n_samples)
    everyone = np.arange(drive.information.n_candidates)
    filter_forward(white.steps, white.p0, white.total(everyone), before, after, logs)
    t = int(np.argmax(after[:, 3]))
    if after[t, 3] > limit:
        raise ValueError(
            f"objective.tolerance_m must be at least {2.0 * math.sqrt(after[t, 3]):.4g}, the 2σ "
            f"that all {everyone.size:,} candidates together reach at s = "
            f"{drive.points.s_m[t]:.0f} m, where they do worst, got {tolerance_m:g}"
        )
