"""Bound `trace` for many budgets at once, and place for each: what shares its work is below.

placements   each from its neighbours' (`placement.solvers.curve_search`);
relaxation   its tangent at the fractional choice of one budget bounds all: what large budgets
             have, at once for the greatest, and in the end where the gaps are then widest;
prices       diagrams that pay for cameras bound all budgets, too, each by its tangent to the
             curve's hull (`placement.solvers.curve_prices`): what small budgets have;
counts       one diagram with a root for each budget that is then still open, with as many
             cameras left, where that is cheap: for budgets above the hull.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from placement.bounds.concave import best_fraction
from placement.bounds.matroid import root_choice
from placement.bounds.tangent import tangent_bound
from placement.diagram.layout import lay_moves
from placement.diagram.passes import Diagram
from placement.diagram.single import OutOfTime
from placement.objectives.base import Relaxable
from placement.objectives.navigation_chain import Drive
from placement.objectives.trace import Trace
from placement.problem import Problem, Run
from placement.solution import Proposal, Status
from placement.solvers.curve_prices import MOST_WORK, PricedCurve
from placement.solvers.curve_search import CurveSearch
from placement.solvers.diagram import (
    BOUND_FROM,
    LEAVE_TIME_S,
    PROBE,
    PROBE_EPSILON,
    Effort,
    free_choice,
    offset_drives,
    repaired,
    shortened,
    white_parts,
)
from placement.solvers.trace_proof import EVERYWHERE, RELAXATION, TOLERANCE

EFFORTS = (Effort(60, 4, 2), Effort(120, 8, 4))
MOST_COUNTED = 3_000_000  # labels that a probe with counts may take
SEARCH_SHARE = 0.3  # of a time limit
RELAX_SHARE = 0.15  # of a time limit
RELAX_S = 10.0  # where there is none
FIRST_RELAXED = (1.0, 0.75, 0.55)  # of the greatest budget
RELAXATIONS = 5  # more at most, each at the budget whose gap is then the greatest
SLIGHT = 0.01  # a gap that neither relaxations nor counts are asked about
CLOSED = 1e-7  # a gap that is none
NEAR = 1.1  # a path's placement this near the best (as a share) is polished
PRICED = BOUND_FROM + ", cameras priced"
KNOWN = ", offsets known where views meet"


def solve_trace_curve(problem: Problem, budgets: range, run: Run) -> list[Proposal]:
    """Return a proposal for every budget of `budgets`, which increase.

    Raises:
        ValueError: for an objective other than `trace`, or views too long for a diagram.
    """
    if not isinstance(problem.objective, Trace):
        raise ValueError(f"this curve needs the objective trace, got {problem.objective.name}")
    proof = CurveProof(problem, budgets, run)
    finished = proof.work()
    return proof.proposals(Status.FEASIBLE if finished else Status.TIME_LIMIT)


@dataclass(slots=True)
class CurveProof:
    """The best placements of all budgets, searched with offsets known, and what bounds them."""

    problem: Problem
    budgets: range
    run: Run
    known: dict[int, Problem] = field(default_factory=dict)
    relaxed: dict[int, float] = field(default_factory=dict)  # bounds by the concave relaxation
    counted: dict[int, float] = field(default_factory=dict)  # by diagrams that count
    floor: float = 0.0  # what every usable camera at once would leave
    search: CurveSearch = field(init=False)
    prices: PricedCurve = field(init=False)
    _persistent: list[Drive | None] = field(default_factory=list)
    _values: dict[tuple[int, ...], float] = field(default_factory=dict)  # with offsets unknown

    def __post_init__(self) -> None:
        """Take the offsets for known in the search, and look at the drives.

        Raises:
            ValueError: if most views are too long for a diagram.
        """
        objective = self.problem.objective
        assert isinstance(objective, Trace)  # noqa: S101 - its one caller has checked
        known = objective.offsets_known() if objective.persistent else objective
        for k in self.budgets:
            rules = replace(self.problem.constraints, budget=k)
            self.known[k] = replace(self.problem, objective=known, constraints=rules)
        most = self.known[self.budgets[-1]]
        usable, required, budget = free_choice(most)
        pairs = zip(white_parts(most), offset_drives(self.problem), strict=True)
        weighed = [(part, drive) for part, drive in pairs if part[0] > 0.0]
        parts, self._persistent = [p for p, _ in weighed], [d for _, d in weighed]
        for _, part in parts:
            lay_moves(part.drive, usable, required, budget)
        self.floor = known.value(np.flatnonzero(self.problem.constraints.usable()))
        self.search = CurveSearch(self.known, self.run)
        self.prices = PricedCurve(
            parts,
            self._persistent,
            usable,
            required,
            self.problem.constraints.group,
            objective.value(required),
            lambda: {k - required.size: self.value(k) for k in self.search.value},
            self._offer,
            lambda: self.run.remaining() <= LEAVE_TIME_S,
            lambda text: self.run.progress(f"{text}, {self._widest()}", None),
        )

    def work(self) -> bool:
        """Find placements, then bound them; return whether no time was missing."""
        with shortened(self.run, SEARCH_SHARE * self.run.remaining()):
            self.search.work()
        limited = math.isfinite(self.run.deadline)
        try:
            with shortened(self.run, (1.0 - RELAX_SHARE) * self.run.remaining()):
                for share in FIRST_RELAXED:
                    at = int(share * self.budgets[-1])
                    if at in self.budgets and not self.run.out_of_time():
                        self._relax_at(at)
                self._price(math.inf if limited else MOST_WORK)
                self._count()
            finished = True
        except OutOfTime:
            finished = False
        with shortened(self.run, self.run.remaining() - LEAVE_TIME_S if limited else RELAX_S):
            self._relax()
        return finished and self.run.remaining() > LEAVE_TIME_S

    def proposals(self, status: Status) -> list[Proposal]:
        """Return what was found and proven."""
        persistent = any(drive is not None for drive in self._persistent)
        made = []
        for k in self.budgets:
            bounds = self._bounds(k)
            source = max(bounds, key=bounds.__getitem__)
            bound = min(bounds[source], self.value(k))
            said = source + KNOWN if persistent and source in (PRICED, BOUND_FROM) else source
            made.append(Proposal(self.selected(k), -bound, status, {"bound_from": said}))
        return made

    def selected(self, k: int) -> list[int]:
        """Return the best placement of at most `k` cameras."""
        if all(drive is None for drive in self._persistent):
            return self.search.best[k]
        fewer = (self.search.best[j] for j in self.search.best if j <= k)
        return min(fewer, key=self._true_value)

    def value(self, k: int) -> float:
        """Return what the best placement of `k` cameras comes to, in m²."""
        if all(drive is None for drive in self._persistent):
            return self.search.value[k]
        return self._true_value(self.selected(k))

    def _true_value(self, selected: list[int]) -> float:
        chosen = tuple(selected)
        if chosen not in self._values:
            value = self.problem.objective.value(np.array(chosen, dtype=np.int64))
            self._values[chosen] = value
        return self._values[chosen]

    def bound(self, k: int) -> float:
        """Return the proven lower bound on the value for `k` cameras, in m²."""
        return max(self._bounds(k).values())

    def _bounds(self, k: int) -> dict[str, float]:
        return {
            EVERYWHERE: self.floor,
            RELAXATION: self.relaxed.get(k, 0.0),
            PRICED: self.prices.bound(k - self._required()),
            BOUND_FROM: self.counted.get(k, 0.0),
        }

    def _gap(self, k: int) -> float:
        """Return the share of the value that is not proven."""
        return 1.0 - self.bound(k) / max(self.value(k), 1e-300)

    def _widest(self) -> str:
        k = max(self.budgets, key=self._gap)
        return f"widest gap {100.0 * self._gap(k):.2g} % at k = {k}"

    def _required(self) -> int:
        """Return how many cameras every placement holds."""
        return int(np.unique(self.problem.constraints.required).size)

    def _price(self, most_work: float) -> None:
        """Bound by prices, where nothing else says as much."""
        required = self._required()
        self.prices.refine(lambda left: self.relaxed.get(left + required, self.floor), most_work)

    def _relax(self) -> None:
        """Bound all budgets by tangents of the relaxations of those whose gaps are greatest."""
        tried: set[int] = set()
        while len(tried) < RELAXATIONS and not self.run.out_of_time():
            open_ones = [k for k in self.budgets if k not in tried and self._gap(k) > SLIGHT]
            if not open_ones:
                return
            at = max(open_ones, key=self._gap)
            tried.add(at)
            self._relax_at(at)
            self.run.progress(f"relaxed at k = {at}", len(tried) / RELAXATIONS)

    def _relax_at(self, at: int) -> None:
        """Bound all budgets by the tangent at the fractional choice of one."""
        problem = self.known[at]
        objective = cast("Relaxable", problem.objective)
        x = best_fraction(
            objective,
            root_choice(problem.constraints),
            Run(self.run.rng, self.run.deadline, self.run.progress),
            start=np.array(self.search.best[at], dtype=np.int64),
            tolerance=TOLERANCE,
        ).x
        for k in sorted(self.budgets, key=lambda k: abs(k - at)):
            if self.run.out_of_time() and k != at:
                return
            bound = -tangent_bound(objective, self.known[k].constraints, x)
            self.relaxed[k] = max(self.relaxed.get(k, 0.0), bound)

    def _count(self) -> None:
        """Sweep with counts for the budgets that are open, as far as their labels are few."""
        required = self._required()
        affordable = MOST_COUNTED / max(self.prices.probe_labels, 1) - 1.0
        asked = [
            k
            for k in self.budgets
            if 0 < k - required <= affordable
            and self._gap(k) > SLIGHT
            and self.prices.above_hull(k - required) > SLIGHT
        ]
        if not asked:
            return
        most = self.known[asked[-1]]
        usable, _, left = free_choice(most)
        diagrams = [
            (w, Diagram(p.drive, (p.w_tt, p.w_nn), usable, self.prices.required, left, persistent))
            for (w, p), persistent in zip(self.prices.parts, self._persistent, strict=True)
        ]
        for effort, probing in ((PROBE, True), *((e, False) for e in EFFORTS)):
            for weight, diagram in diagrams:
                self._sweep(diagrams, weight, diagram, effort, asked, probing=probing)
            for k in asked:
                bound = _sum_of_bounds(diagrams, k - required)
                self.counted[k] = max(self.counted.get(k, 0.0), bound)
            if all(self._gap(k) <= CLOSED for k in asked):
                return

    def _sweep(
        self,
        diagrams: list[tuple[float, Diagram]],
        weight: float,
        diagram: Diagram,
        effort: Effort,
        asked: list[int],
        *,
        probing: bool,
    ) -> None:
        """Sweep one drive for all the budgets asked for at once."""
        n = diagram.drive.n_samples
        threshold = np.full(diagram.budget + 1, -np.inf)
        for k in asked:
            left = k - self._required()
            others = _sum_of_bounds(diagrams, left) - weight * diagram.bounds[left] / n
            threshold[left] = np.inf if probing else (self.value(k) - others) * n / weight
        outcome = diagram.sweep(
            effort.width,
            threshold,
            self.prices.out_of_time,
            probing=probing,
            epsilon=PROBE_EPSILON if probing else None,
            coarse_width=effort.coarse,
            slots=effort.slots,
            progress=lambda share: self.run.progress(f"counts, width {effort.width}", share),
        )
        if outcome is not None and not probing:
            for k in asked:
                self._offer(outcome.paths[k - self._required()], k)

    def _offer(self, path: list[int], k: int | None = None) -> None:
        """Make a placement of a best path, for `k` or as many cameras as it has."""
        if k is None:
            k = len(set(path)) + self._required()
        k = min(max(k, self.budgets[0]), self.budgets[-1])
        selected = repaired(self.known[k], path)
        if set(selected) == set(self.search.best[k]) or self.run.out_of_time():
            return
        value = self.known[k].objective.value(np.array(sorted(selected), dtype=np.int64))
        if value < NEAR * self.search.value[k]:
            self.search.improve(k, selected)


def _sum_of_bounds(diagrams: list[tuple[float, Diagram]], left: int) -> float:
    """Return the lower bound on the value with `left` cameras more than the required, in m²."""
    return float(sum(w * d.bounds[left] / d.drive.n_samples for w, d in diagrams))
