"""Build placements along the road: each camera takes the tolerance as far as it can, B at a time.

A label is a placement so far; what it is worth is how far the car gets before it is out of
tolerance. Labels of one price compete, the B that get farthest are kept, and the first price at
which one gets to the end is the cheapest found. With failures the distances of the intact
placement and of the worst failure are added: a camera that is the only one to cover a stretch
helps the first at once and the second as soon as another covers it too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.constraints import Constraints
from placement.objectives.tolerance import Tolerance

LOOK_BACK = 150  # samples before the first violation within which a camera may still help
SAME = 1e-9


@dataclass(frozen=True, slots=True)
class Label:
    """A placement so far, sorted, and how far it gets."""

    selected: tuple[int, ...]
    reach: float
    done: bool


class Beam:
    """Labels by price, extended in order of price."""

    def __init__(
        self,
        objective: Tolerance,
        constraints: Constraints,
        width: int,
        stop: Callable[[], bool],
        rows: IntArray | None = None,
    ) -> None:
        """Prepare; `rows` (default: all that may be used) are the candidates that are tried."""
        self.objective = objective
        self.constraints = constraints
        self.width = width
        self.stop = stop
        usable = np.flatnonzero(constraints.usable()) if rows is None else rows
        self.rows = np.setdiff1d(usable, constraints.required)
        self.spans = [spans_of(part.drive) for part in objective.parts]  # type: ignore[attr-defined]

    def search(
        self, ceiling: float = math.inf, tell: Callable[[str], None] = lambda _text: None
    ) -> list[int] | None:
        """Return the cheapest placement found below `ceiling`, or None."""
        o = self.objective
        start = self._with_free(tuple(int(i) for i in np.unique(self.constraints.required)))
        waiting: dict[float, dict[tuple[int, ...], Label]] = {}
        self._put(waiting, self._label(start))
        while waiting and not self.stop():
            price = min(waiting)
            if price >= ceiling - SAME:
                return None
            labels = sorted(waiting.pop(price).values(), key=lambda b: (-b.reach, b.selected))
            for label in labels:
                if label.done and o.feasible(np.array(label.selected, dtype=np.int64)):
                    return list(label.selected)
            tell(f"{price:g} {o.unit} reach {100.0 * labels[0].reach / self._whole():.0f} %")
            for label in labels[: self.width]:
                if self.stop():
                    return None
                for child in self._children(label):
                    self._put(waiting, child)
        return None

    def _whole(self) -> float:
        whole = float(sum(part.n_samples for part in self.objective.parts))
        return whole * (2.0 if self.objective.failures else 1.0)

    def _put(self, waiting: dict[float, dict[tuple[int, ...], Label]], label: Label) -> None:
        price = round(self.objective.price(label.selected), 9)
        level = waiting.setdefault(price, {})
        level[label.selected] = label
        if len(level) > 4 * self.width:
            best = sorted(level.values(), key=lambda b: (-b.reach, b.selected))[: self.width]
            waiting[price] = {b.selected: b for b in best}

    def _label(self, selected: tuple[int, ...]) -> Label:
        reach, done, _ = self._extended(np.array(selected, dtype=np.int64), np.empty(0, np.int64))
        return Label(selected, reach, done)

    def _children(self, label: Label) -> list[Label]:
        chosen = np.array(label.selected, dtype=np.int64)
        allowed = self.constraints.addable(chosen)
        rows = self.rows[allowed[self.rows]]
        now, _, reach = self._extended(chosen, rows)
        better = np.flatnonzero(reach > now + SAME)
        children: list[Label] = []
        cost = np.round(self.objective.cost[rows[better]], 9)
        for price in np.unique(cost):  # the best of each price
            group = better[cost == price]
            for n in group[np.argsort(-reach[group], kind="stable")[: self.width]]:
                selected = tuple(sorted((*label.selected, int(rows[n]))))
                done = bool(reach[n] >= self._whole() - SAME)
                children.append(Label(selected, float(reach[n]), done))
        return children

    def _extended(self, chosen: IntArray, rows: IntArray) -> tuple[float, bool, FloatArray]:
        """Return the label's reach, whether it is at the end, and its reach with each of rows."""
        now, after = 0.0, np.zeros(rows.size)
        for part, (first, last) in zip(self.objective.parts, self.spans, strict=True):
            whole = float(part.n_samples)
            intact, _ = part.reach(chosen, rows[:0])
            begin = min(intact, whole)
            near = (first[rows] <= begin) & (last[rows] >= begin - LOOK_BACK)
            found = np.full(rows.size, intact)
            found[near] = part.reach(chosen, rows[near])[1]
            now += intact
            after += found
            if self.objective.failures:
                worst, worst_with = self._with_failures(part, chosen, rows, intact, first, last)
                now += worst
                after += worst_with
        return now, now >= self._whole() - SAME, after

    def _with_failures(
        self, part: object, chosen: IntArray, rows: IntArray, intact: float,
        first: IntArray, last: IntArray,
    ) -> tuple[float, FloatArray]:  # fmt: skip
        """Return the least reach over one camera dark, and that with each of `rows` beside.

        Failures are taken in order of their reach until the next cannot matter any more.
        """
        without = [np.delete(chosen, n) for n in range(chosen.size)]
        nothing = rows[:0]
        reaches = [part.reach(w, nothing)[0] for w in without]  # type: ignore[attr-defined]
        worst_with = np.full(rows.size, intact)  # the new one itself dark
        for n in np.argsort(reaches, kind="stable"):
            if rows.size == 0 or reaches[n] >= worst_with.max():
                break
            near = (first[rows] <= reaches[n]) & (last[rows] >= reaches[n] - LOOK_BACK)
            found = np.full(rows.size, reaches[n])
            found[near] = part.reach(without[n], rows[near])[1]  # type: ignore[attr-defined]
            worst_with = np.minimum(worst_with, found)
        if not chosen.size:
            return intact, worst_with
        return float(min(reaches)), worst_with

    def _with_free(self, start: tuple[int, ...]) -> tuple[int, ...]:
        """Add the cameras that cost nothing, one at a time while they help."""
        chosen = list(start)
        free = self.rows[self.objective.cost[self.rows] == 0.0]
        while free.size and not self.stop():
            allowed = self.constraints.addable(np.array(chosen, dtype=np.int64))
            rows = free[allowed[free]]
            now, done, reach = self._extended(np.array(sorted(chosen), dtype=np.int64), rows)
            if done or not rows.size or reach.max() <= now + SAME:
                break
            chosen.append(int(rows[np.argmax(reach)]))
        return tuple(sorted(chosen))


def spans_of(drive: object) -> tuple[IntArray, IntArray]:
    """Return the first and last sample (c,) that each candidate sees; beyond any if it is blind."""
    views = getattr(drive, "views", drive)
    indptr, indices = views.indptr, views.indices  # type: ignore[attr-defined]
    c = indptr.size - 1
    first, last = np.full(c, np.iinfo(np.int64).max), np.full(c, -1)
    seeing = np.flatnonzero(np.diff(indptr))
    first[seeing] = indices[indptr[seeing]]
    last[seeing] = indices[indptr[seeing + 1] - 1]
    return first, last
