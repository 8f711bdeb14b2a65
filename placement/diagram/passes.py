"""Sweeps of rising width over one drive, each pruned by the labels of those before it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from models.geometry import BoolArray, FloatArray, IntArray
from placement.diagram.alone import alone_moves
from placement.diagram.arrays import Rules, empty_table
from placement.diagram.layout import lay_moves, longest_view, road_above, views_of
from placement.diagram.moves import floor_information
from placement.diagram.single import sweep_once
from placement.diagram.togo import least_by_cut, merged_table
from placement.objectives.navigation import WhiteDrive
from placement.objectives.navigation_chain import Drive

ROUNDING = 1e-8  # relative; what bounds give up for rounding along the sweep
EPSILON = 1e-4  # the least ratio between labels that are merged
COARSE = 0.03  # the same for labels that try clusters


@dataclass(slots=True)
class Outcome:
    """What one sweep found: the bound on the sum over samples, and the moves of its best path.

    `bounds` (k + 1,) are those for every budget, NaN where none was asked for; `paths` hold the
    best path of each that was.
    """

    bound: float
    path: list[int]
    labels: int
    width: int
    epsilon: float
    seconds: float
    counters: list[int] = field(default_factory=list)
    bounds: FloatArray = field(default_factory=lambda: np.empty(0))
    paths: dict[int, list[int]] = field(default_factory=dict)


class Diagram:
    """The relaxed decision diagram of one drive under one weight."""

    def __init__(
        self,
        drive: WhiteDrive,
        weight: tuple[float, float],
        usable: BoolArray,
        required: IntArray,
        budget: int,
        persistent: Drive | None = None,
    ) -> None:
        """Prepare for at most `budget` of the `usable` (c,) cameras beside the required ones.

        `persistent` is the drive itself where offsets persist; `drive` then knows them.

        Of views too long for the memory only the head is a move, and what the cameras see beyond
        is given to every placement: see `diagram.moves`.

        Raises:
            ValueError: if most views are too long.
        """
        self.drive = drive
        self.weight = weight
        self.budget = budget
        self.moves, self.base = lay_moves(drive, usable, required, budget)
        reach = max(1, drive.n_samples // (2 * max(budget, 1)))
        floor = drive.total(required) + floor_information(drive, usable, budget)
        self.road = road_above(drive, weight, self.base, floor, reach)
        self.views = views_of(self.moves, drive.n_samples)
        self.alone = alone_moves(persistent, usable, self.base, longest_view(budget))
        self.candidate = np.concatenate([self.moves.candidate, self.alone.candidate])
        self._forget(np.full(budget + 1, np.inf))
        self.bounds = np.full(budget + 1, float(self.road.floor_cost[-1]))

    def _forget(self, thresholds: FloatArray) -> None:
        """Start over with what holds only for placements below the `thresholds` (k + 1,)."""
        self.table = empty_table(self.drive.n_samples, self.budget)
        self.cuts = np.zeros((self.drive.n_samples + 1, self.budget + 1))
        self.thresholds = thresholds

    @property
    def bound(self) -> float:
        """The proven lower bound on the sum over samples, for the whole budget."""
        return float(self.bounds[-1])

    @bound.setter
    def bound(self, value: float) -> None:
        self.bounds[-1] = value

    def sweep(
        self,
        width: int,
        threshold: float | FloatArray,
        out_of_time: Callable[[], bool],
        *,
        probing: bool = False,
        epsilon: float | None = None,
        slack: float = 0.0,
        coarse_width: int = 4,
        slots: int = 2,
        progress: Callable[[float], None] = lambda _share: None,
    ) -> Outcome | None:
        """Sweep once, forgetting placements that cost `threshold` or more in sum.

        Given thresholds (k + 1,), one a budget, the sweep bounds all these budgets at once (but for
        those of −∞): a root at count k − b has b cameras left, its cost is minus its threshold.

        Improves `bounds` and the table; the table of sweeps with lower thresholds is forgotten.
        Return None if storage ran out.

        Raises:
            OutOfTime: before the bound is known; nothing is changed then.
        """
        start = time.monotonic()
        k = self.budget
        several = isinstance(threshold, np.ndarray)
        thresholds = np.full(k + 1, -np.inf)
        if several:
            thresholds[:] = threshold
        else:
            thresholds[k] = threshold
        asked = np.flatnonzero(thresholds > -np.inf)[::-1]  # by count of the root, k − b
        if np.any(thresholds > (1.0 + ROUNDING) * self.thresholds):
            self._forget(thresholds)
        thresholds = np.minimum(thresholds, self.thresholds)
        table = self.table
        rules = Rules(
            (np.inf if probing else 0.0) if several else float(thresholds[k]),
            width,
            EPSILON if epsilon is None else epsilon,
            slack,
            COARSE,
            coarse_width,
            slots,
            probing,
            0.0,
        )
        starts = -thresholds[asked] if several and not probing else np.zeros(asked.size)
        roots_at = [(int(k - b), float(cost)) for b, cost in zip(asked, starts, strict=True)]
        swept = sweep_once(
            self.drive.p0,
            self.road,
            self.views,
            self.alone,
            rules,
            table,
            self.cuts,
            k,
            roots_at,
            out_of_time,
            progress,
        )
        if swept is None:
            return None
        nodes, roots = swept.nodes, swept.roots
        found = np.full(k + 1, np.nan)
        found[asked] = nodes.togo[roots] * (1.0 - ROUNDING)
        paths = {
            int(b): swept.path(int(r), self.candidate) for b, r in zip(asked, roots, strict=True)
        }
        found = np.minimum(found, thresholds)  # the rest was forgotten
        self.bounds = np.fmax(self.bounds, found)
        self.thresholds = thresholds
        if not probing:
            least_by_cut(nodes.lo, nodes.hi, nodes.togo, self.cuts)
        self.table = merged_table(table, nodes.lo, nodes.hi, nodes.p, nodes.togo)
        return Outcome(
            float(found[k]),
            paths[k],
            swept.labels,
            width,
            swept.epsilon,
            time.monotonic() - start,
            swept.counters,
            found,
            paths,
        )
