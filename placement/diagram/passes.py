"""Sweeps of rising width over one drive, each pruned by the labels of those before it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from models.geometry import BoolArray, FloatArray, IntArray
from placement.diagram.arrays import (
    ARCS,
    FULL,
    NODES,
    Arcs,
    Road,
    Rules,
    Views,
    add_root,
    empty_table,
    new_storage,
)
from placement.diagram.moves import floor_information, make_moves
from placement.diagram.sweep import forward, near_form
from placement.diagram.togo import backward, hopes, least_by_cut, merged_table
from placement.objectives.navigation import WhiteDrive
from placement.objectives.windows.filter import empty_messages, filter_forward

CHUNK = 4  # samples swept between looks at the clock
ROUNDING = 1e-8  # relative; what bounds give up for rounding along the sweep
MOST_NODES, MOST_ARCS, MOST_WAITING = 24_000_000, 80_000_000, 1_000_000
# What labels inside clusters may hold: (cameras + 1)·span², some 3 kB each at eight slots.
MOST_PENDING = 400_000
EPSILON = 1e-4  # the least ratio between labels that are merged
COARSE = 0.03  # the same for labels that try clusters


class OutOfTime(Exception):  # noqa: N818 - a signal, not an error
    """The sweep was stopped by the clock."""


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
    ) -> None:
        """Prepare for at most `budget` of the `usable` (c,) cameras beside the required ones.

        Of views too long for the memory only the head is a move, and what the cameras see beyond
        is given to every placement: see `diagram.moves`.

        Raises:
            ValueError: if most views are too long.
        """
        self.drive = drive
        self.weight = weight
        self.budget = budget
        longest = max(1, math.isqrt(MOST_PENDING // (budget + 1)))
        self.moves, beyond = make_moves(drive, usable, longest, budget)
        self.base = drive.total(required) + beyond
        floor = drive.total(required) + floor_information(drive, usable, budget)
        before, after, logs = empty_messages(drive.n_samples)
        filter_forward(drive.steps, drive.p0, floor, before, after, logs)
        paid = weight[0] * after[:, 0] + weight[1] * after[:, 3]
        self.road = Road(
            drive.steps,
            self.base,
            float(weight[0]),
            float(weight[1]),
            before * (1.0 - 1e-12),
            np.concatenate(([0.0], np.cumsum(paid))) * (1.0 - 1e-12),
            near_form(drive.steps, *weight, max(1, drive.n_samples // (2 * max(budget, 1)))),
        )
        m = self.moves
        self.views = Views(m.ptr, m.blocks, m.at, m.family, m.families, m.span)
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
        k, t = self.budget, self.drive.n_samples
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
        storage = new_storage(t, k, self.views, slots, MOST_NODES, MOST_ARCS, MOST_WAITING)
        rules = Rules(
            (np.inf if probing else 0.0) if several else float(thresholds[k]),
            width,
            EPSILON if epsilon is None else epsilon,
            slack,
            COARSE,
            coarse_width,
            slots,
            probing,
        )
        starts = -thresholds[asked] if several and not probing else np.zeros(asked.size)
        for b, cost in zip(asked, starts, strict=True):
            add_root(storage.pool, storage.counter, int(k - b), float(cost), self.drive.p0)
        hope = np.zeros((t + 1, k + 2))
        hopes(self.road, self.views.span, table, self.cuts, hope)
        bin_epsilon = np.zeros(k + 1)
        roots: IntArray = np.empty(0, dtype=np.int64)
        for begin in range(0, t, CHUNK):
            if out_of_time():
                raise OutOfTime
            progress(begin / t)
            end = min(t, begin + CHUNK)
            forward(begin, end, k, self.road, self.views, rules, hope, table, bin_epsilon, storage)
            if storage.counter[FULL]:
                return None
            if begin == 0:  # roots are the only labels to which an arc leads from nowhere
                first = storage.arcs.source[: storage.counter[ARCS]]
                roots = storage.arcs.target[np.flatnonzero(first < 0)].astype(np.int64)
        nodes, arcs = storage.nodes, storage.arcs
        n = int(storage.counter[NODES])
        best_arc = np.full(n, -1, dtype=np.int64)
        backward(
            int(storage.counter[ARCS]), arcs.source, arcs.target, arcs.cost, nodes.togo, best_arc
        )
        found = np.full(k + 1, np.nan)
        found[asked] = nodes.togo[roots] * (1.0 - ROUNDING)
        paths = {
            int(b): self._path(int(r), best_arc, arcs) for b, r in zip(asked, roots, strict=True)
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
            n,
            width,
            float(bin_epsilon.max()),
            time.monotonic() - start,
            storage.counter.tolist(),
            found,
            paths,
        )

    def _path(self, node: int, best_arc: IntArray, arcs: Arcs) -> list[int]:
        """Return the cameras of the best path from a label on."""
        path = []
        while best_arc[node] >= 0:
            arc = best_arc[node]
            if arcs.move[arc] >= 0:
                path.append(int(self.moves.candidate[arcs.move[arc]]))
            node = int(arcs.target[arc])
        return path
