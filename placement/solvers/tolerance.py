"""The fewest or cheapest cameras within tolerance: built along the road, and proven from below.

A beam of placements (`fewest.beam`) drives the road and keeps those that get farthest for their
price; what it finds is pruned and, where two cameras can give way to one, exchanged. Then labels
(`fewest.bound`) prove from below, price by price, that no cheaper placement keeps any one of the
drives in tolerance. Both are anytime: stopped at any moment, the best placement and the price
proven so far are what is returned.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from models.geometry import BoolArray, FloatArray, IntArray
from placement.constraints import Constraints
from placement.fewest.arrays import MOST_UNITS
from placement.fewest.beam import SAME, Beam, spans_of
from placement.fewest.bound import EFFORTS, Counting
from placement.fewest.course import whole_units
from placement.fewest.finding import tries
from placement.objectives.tolerance import Tolerance, white_part
from placement.objectives.windows.offsets import views_of
from placement.problem import Problem, Run
from placement.solution import Proposal, Status

GRACE_S = 0.6  # processor time for a first placement, however little time there is
LEAVE_TIME_S = 0.3  # for the verb's own checks, out of the time limit
WIDTHS = (1, 4, 16)  # of the beam before anything is proven
WIDER = (50, 150, 400)  # and after, while the two do not meet
SHARE = 0.3  # of the time limit that the first beams may take
NEAR = 200  # samples on either side within which one camera may replace two


def solve_tolerance(problem: Problem, run: Run) -> Proposal:
    """Find few cameras, prove how few there must be, and look on while the two differ.

    Raises:
        ValueError: for an objective other than `tolerance`.
    """
    if not isinstance(problem.objective, Tolerance):
        raise ValueError(
            f"method tolerance needs the objective tolerance, got {problem.objective.name}"
        )
    return Search(problem, problem.objective, run).explore()


@dataclass(frozen=True, slots=True)
class Priced:
    """Prices in whole units: free (c,) who may be chosen, given: who stands without being paid."""

    free: BoolArray
    given: IntArray
    units: IntArray
    unit: float
    spent: float

    def price(self, units: int) -> float:
        """Return the price of a placement of so many units, the required cameras included."""
        return self.spent + self.unit * units

    def within(self, price: float) -> int:
        """Return the least number of units that reaches a price."""
        return math.ceil(round((price - self.spent) / self.unit, 6))


@dataclass(slots=True)
class Search:
    """The incumbent, the bounds of the drives, and what was proven."""

    problem: Problem
    objective: Tolerance
    run: Run
    incumbent: list[int] | None = None
    price: float = math.inf
    need: float = 0.0
    stats: dict[str, Any] = field(default_factory=dict)
    _kept: tuple[IntArray, Counting] | None = None

    def explore(self) -> Proposal:
        """Construct, prove, construct again; say what came of it."""
        whole = self.run.remaining()
        grace = time.process_time() + GRACE_S
        for width in WIDTHS:
            # stopped at once, there shall still be a placement
            stop = self._stop if self.incumbent else lambda: self._stop() and late(grace)
            self._construct(self.problem.constraints, width, stop)
            if self.run.remaining() < (1.0 - SHARE) * whole:
                break
        if self.incumbent is None:
            return self._give_up()
        self._find(SHARE * self.run.remaining())
        finished = self._prove(self.objective.cost, self.price)
        self._find(self.run.remaining())
        for width in WIDER:
            if self._closed() or self._stop():
                break
            self._construct(self.problem.constraints, width)
        done = self._closed() or (finished and not self._stop())
        self._tell_bound()
        return Proposal(
            self.incumbent,
            self.run.score_bound,
            Status.FEASIBLE if done else Status.TIME_LIMIT,
            self.stats,
        )

    def _stop(self) -> bool:
        return self.run.remaining() <= LEAVE_TIME_S

    def _closed(self) -> bool:
        return self.need >= self.price * (1.0 - 1e-9)

    def _construct(
        self, constraints: Constraints, width: int, stop: Callable[[], bool] | None = None
    ) -> None:
        """Build by a beam; take what is better than the incumbent, improved."""
        beam = Beam(self.objective, constraints, width, stop or self._stop)

        def tell(text: str) -> None:
            known = "" if self.incumbent is None else f", {self._worded(self.price)} known to do"
            self.run.progress(f"beam of {width}: {text}{known}", None)

        found = beam.search(self.price, tell)
        if found is None:
            return
        self._offer(found)
        better = improved(self.objective, constraints, found, self._stop)
        self._offer(better)

    def _find(self, seconds: float) -> None:
        """Look for cheaper placements by sweeps, while they find any, for so many seconds."""
        if len(self.objective.drives) > 1:  # a sweep knows of one drive
            return
        until = self.run.remaining() - seconds
        priced = self._priced(self.objective.cost)
        required = self.problem.constraints.required
        counting = self._counting(0, priced, self.price)
        self._raise(priced.price(counting.need))

        def stop() -> bool:
            return self._stop() or self.run.remaining() <= until

        better = True
        while better and not self._closed() and not stop():
            better = False
            own = np.setdiff1d(np.array(self.incumbent, dtype=np.int64), required)
            self.run.progress(f"{self._worded(self.price)} known to do, looking for fewer", None)
            for found in tries(counting, own, priced.units, stop):
                before, chosen = self.price, np.union1d(found, required).astype(np.int64)
                if self.objective.feasible(chosen):
                    self._offer(chosen.tolist())
                if self.price < before - SAME:
                    better = True
                    break

    def _offer(self, selected: list[int]) -> None:
        price = self.objective.price(selected)
        if price < self.price - SAME and not self.problem.constraints.violations(selected):
            self.incumbent, self.price = sorted(int(i) for i in selected), price
            self.run.incumbent = self.incumbent

    def _prove(self, cost: FloatArray, ceiling: float) -> bool:
        """Raise the lower bound of every drive up to `ceiling`; return whether time sufficed."""
        o, priced = self.objective, self._priced(cost)
        finished = True
        for n in range(len(o.drives)):
            counting = self._counting(n, priced, ceiling)
            text = f"drive {n + 1}: " if len(o.drives) > 1 else ""

            def tell(effort: int, share: float, c: Counting = counting, text: str = text) -> None:
                self._raise(priced.price(c.need))
                step = f"effort {effort + 1} of {len(EFFORTS)}" if effort >= 0 else "probing"
                self.run.progress(
                    f"{text}at least {self._worded(self.need)}, {self._worded(self.price)} known "
                    f"to do ({step})",
                    share,
                )

            self._raise(priced.price(counting.need))
            finished &= counting.prove(priced.within(ceiling), self._stop, tell)
            self._raise(priced.price(counting.need))
            self.stats["labels"] = self.stats.get("labels", 0) + counting.labels
        return finished

    def _priced(self, cost: FloatArray) -> Priced:
        """Return the candidates' prices in whole units, and who stands in any case."""
        constraints = self.problem.constraints
        usable = constraints.usable()
        required = np.unique(constraints.required)
        usable[required] = False
        units, unit = whole_units(cost, usable)
        given = np.union1d(required, np.flatnonzero(usable & (units == 0)))
        return Priced(usable & (units > 0), given, units, unit, math.fsum(cost[required]))

    def _counting(self, n: int, priced: Priced, ceiling: float) -> Counting:
        """Return the sweeps of drive n; those of a single drive are kept, with what they know."""
        if self._kept is not None and np.array_equal(self._kept[0], priced.units):
            return self._kept[1]
        o, constraints = self.objective, self.problem.constraints
        drive = o.drives[n]
        most = constraints.budget - np.unique(constraints.required).size
        counting = Counting(
            white_part(drive), o.limit, priced.free, priced.given, priced.units,
            max(min(most, priced.within(ceiling)), 1), o.failures,
            views_of(drive) if drive.persistent else None, constraints.group,
        )  # fmt: skip
        if len(o.drives) == 1:
            self._kept = (priced.units, counting)
        return counting

    def _raise(self, need: float) -> None:
        """Take note of a proven price; units round down, so it may lie below the incumbent's."""
        self.need = max(self.need, min(need, self.price))
        if self.incumbent is not None:
            self.run.score_bound = -self.need

    def _tell_bound(self) -> None:
        o = self.objective
        self.stats["bound_from"] = "labels along the road"
        if any(drive.persistent for drive in o.drives):
            self.stats["bound_relaxes"] = (
                "persistent errors: in the bound, cameras whose views overlap have their offsets "
                "known exactly; the placement keeps the tolerance with all offsets unknown"
            )

    def _worded(self, price: float) -> str:
        if math.isinf(price):
            return "none"
        if price >= MOST_UNITS and self.objective.unit == "cameras":
            return "no number of cameras"
        return f"{price:g} {self.objective.unit}"

    def _give_up(self) -> Proposal:
        """Say why there is no placement: proven where it can be, and what would do."""
        o, constraints = self.objective, self.problem.constraints
        what = f"2σ across the road within objective.tolerance_m = {o.tolerance_m:g}"
        what += " with any one camera dark" if o.failures else ""
        if self._stop():
            reason = f"no placement with {what} was found in the time limit; one may exist"
            return Proposal([], None, Status.INFEASIBLE, {"reason": reason})
        allowed = constraints.budget
        ones = np.ones(o.n_candidates)
        self.price = math.inf
        self._prove(ones, float(allowed + 1))
        count = int(self.need)
        known = ""
        if not self._stop():
            free = replace(constraints, budget=constraints.n, money=math.inf)
            found = Beam(o, free, 4, self._stop).search()
            if found is not None:
                cost = f" for {o.price(found):g}" if o.unit == "money" else ""
                known = f"; {len(found)} are known to do{cost}"
        proven = count > allowed
        money = f" and budget.money = {constraints.money:g}" if constraints.limits_money else ""
        verb = "keeps" if proven else "was found that keeps"
        least = f"at least {count} cameras needed"
        if count >= MOST_UNITS:
            least = "no number of them suffices"
        reason = (
            f"no placement of at most budget.cameras = {allowed}{money} {verb} {what}: "
            f"{least} (proven){known}"
        )
        return Proposal([], None, Status.INFEASIBLE, {"reason": reason, "lower_bound": count})


def late(until: float) -> bool:
    """Return whether this process has worked until then, however busy the machine."""
    return time.process_time() >= until


def improved(
    objective: Tolerance, constraints: Constraints, selected: list[int], stop: Any
) -> list[int]:
    """Drop cameras that are not needed, and replace two neighbours by one, while either helps."""
    required = {int(i) for i in constraints.required}
    spans = [spans_of(part.drive) for part in objective.parts]  # type: ignore[attr-defined]
    first = np.min([f for f, _ in spans], axis=0)
    last = np.max([last for _, last in spans], axis=0)
    usable = np.flatnonzero(constraints.usable())
    chosen = sorted(selected, key=lambda i: (first[i], i))
    changed = True
    while changed and not stop():
        changed = False
        for i in sorted(chosen, key=lambda i: -objective.cost[i]):
            rest = [j for j in chosen if j != i]
            if i not in required and objective.feasible(np.array(rest, dtype=np.int64)):
                chosen, changed = rest, True
        for n in range(len(chosen) - 1):
            pair = chosen[n : n + 2]
            if stop() or required & set(pair):
                continue
            rest = chosen[:n] + chosen[n + 2 :]
            low, high = first[pair].min() - NEAR, last[pair].max() + NEAR
            one = _one_instead(objective, constraints, rest, pair, usable, first, last, low, high)
            if one is not None:
                chosen = sorted([*rest, one], key=lambda i: (first[i], i))
                changed = True
                break
    return chosen


def _one_instead(
    objective: Tolerance,
    constraints: Constraints,
    rest: list[int],
    pair: list[int],
    usable: IntArray,
    first: IntArray,
    last: IntArray,
    low: int,
    high: int,
) -> int | None:
    """Return the cheapest camera that replaces a pair, if one does and costs less."""
    chosen = np.array(sorted(rest), dtype=np.int64)
    rows = usable[constraints.addable(chosen)[usable]]
    rows = rows[(first[rows] <= high) & (last[rows] >= low)]
    rows = rows[objective.cost[rows] < objective.price(pair) - SAME]
    for working in objective.scenarios(chosen):
        for part in objective.parts:
            if rows.size:
                rows = rows[part.reach(working, rows)[1] >= part.n_samples]
    for i in rows[np.argsort(objective.cost[rows], kind="stable")]:
        if objective.feasible(np.append(chosen, i)):
            return int(i)
    return None
