"""Bound `trace` for many budgets by one diagram: a root for each, with as many cameras left.

Labels are kept by how many cameras are left, so whatever a sweep knows of one budget serves the
others (`Diagram.sweep` given thresholds). Placements come from one run of greedy, each budget's
polished by swaps from the better of greedy's and the one before with a camera more; then from the
best paths. Where many cameras leave the diagram's bound behind, the concave relaxation is asked:
its tangent at the fractional choice of one budget bounds all the others, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from placement.bounds.concave import best_fraction
from placement.bounds.matroid import root_choice
from placement.bounds.tangent import tangent_bound
from placement.diagram.passes import Diagram, Outcome
from placement.diagram.single import OutOfTime
from placement.objectives.base import Relaxable
from placement.objectives.trace import Trace
from placement.problem import Problem, Run
from placement.solution import Proposal, Status
from placement.solvers.diagram import (
    BOUND_FROM,
    KNOWN_OFFSETS,
    LEAVE_TIME_S,
    PROBE,
    PROBE_EPSILON,
    Effort,
    free_choice,
    repaired,
    shortened,
    white_parts,
)
from placement.solvers.exchange import polish
from placement.solvers.greedy import best_addition, climb
from placement.solvers.trace_proof import RELAXATION, TOLERANCE

EFFORTS = (Effort(60, 4, 2), Effort(120, 8, 4), Effort(250, 8, 4))
GROWTH = 2.3  # times as long as the one before takes the next sweep
MOST_LABELS = 25e6  # where there is no time limit
RELAXATIONS = 8  # at most, each at the budget whose gap is then the greatest
RELAX_SHARE = 0.15  # of a time limit
RELAX_S = 10.0  # where there is none
SLIGHT = 0.01  # a gap that no relaxation is asked about
NEAR = 1.1  # a path's placement this near the best (as a share) is polished


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
    """The best placements of all budgets, with offsets known, and the diagrams of the drives."""

    problem: Problem
    budgets: range
    run: Run
    known: dict[int, Problem] = field(default_factory=dict)
    best: dict[int, list[int]] = field(default_factory=dict)
    value: dict[int, float] = field(default_factory=dict)
    relaxed: dict[int, float] = field(default_factory=dict)  # bounds by the concave relaxation
    _diagrams: list[tuple[float, Diagram]] = field(default_factory=list)
    _labels: float = 0.0

    def work(self) -> bool:
        """Find placements, then sweep with rising effort; return whether no time was missing."""
        objective = self.problem.objective
        assert isinstance(objective, Trace)  # noqa: S101 - its one caller has checked
        known = objective.offsets_known() if objective.persistent else objective
        for k in self.budgets:
            rules = replace(self.problem.constraints, budget=k)
            self.known[k] = replace(self.problem, objective=known, constraints=rules)
        most = self.known[self.budgets[-1]]
        usable, required, budget = free_choice(most)
        for weight, part in white_parts(most):
            if weight > 0.0:
                diagram = Diagram(part.drive, (part.w_tt, part.w_nn), usable, required, budget)
                self._diagrams.append((weight, diagram))
        with shortened(self.run, 0.4 * self.run.remaining()):
            self._search(most)
        limited = math.isfinite(self.run.deadline)
        try:
            with shortened(self.run, (1.0 - RELAX_SHARE) * self.run.remaining()):
                self._refine()
            finished = True
        except OutOfTime:
            finished = False
        with shortened(self.run, self.run.remaining() - LEAVE_TIME_S if limited else RELAX_S):
            self._relax()
        return finished and self.run.remaining() > LEAVE_TIME_S

    def proposals(self, status: Status) -> list[Proposal]:
        """Return what was found and proven, with offsets unknown again."""
        objective = self.problem.objective
        persistent = isinstance(objective, Trace) and objective.persistent
        source = KNOWN_OFFSETS if persistent else BOUND_FROM
        made = []
        for k in self.budgets:
            relaxed = self.relaxed.get(k, 0.0)
            stats = {"bound_from": RELAXATION if relaxed > self.bound(k) else source}
            bound = min(max(self.bound(k), relaxed), self.value[k])
            made.append(Proposal(self.best[k], -bound, status, stats))
        return made

    def bound(self, k: int) -> float:
        """Return the proven lower bound on the value for `k` cameras, in m²."""
        left = k - self._required()
        return float(sum(w * d.bounds[left] / d.drive.n_samples for w, d in self._diagrams))

    def _gap(self, k: int) -> float:
        """Return the share of the value that is not proven."""
        bound = max(self.bound(k), self.relaxed.get(k, 0.0))
        return 1.0 - bound / max(self.value[k], 1e-300)

    def _relax(self) -> None:
        """Bound all budgets by tangents of the relaxations of those whose gaps are greatest."""
        tried: set[int] = set()
        while len(tried) < RELAXATIONS and not self.run.out_of_time():
            open_ones = [k for k in self.budgets if k not in tried and self._gap(k) > SLIGHT]
            if not open_ones:
                return
            at = max(open_ones, key=self._gap)
            tried.add(at)
            problem = self.known[at]
            objective = cast("Relaxable", problem.objective)
            x = best_fraction(
                objective,
                root_choice(problem.constraints),
                Run(self.run.rng, self.run.deadline, self.run.progress),
                start=np.array(self.best[at], dtype=np.int64),
                tolerance=TOLERANCE,
            ).x
            for k in sorted(self.budgets, key=lambda k: abs(k - at)):
                if self.run.out_of_time() and k != at:
                    return
                bound = -tangent_bound(objective, self.known[k].constraints, x)
                self.relaxed[k] = max(self.relaxed.get(k, 0.0), bound)
            self.run.progress(f"relaxed at k = {at}", len(tried) / RELAXATIONS)

    def _required(self) -> int:
        """Return how many cameras every placement holds."""
        return int(np.unique(self.problem.constraints.required).size)

    def _search(self, most: Problem) -> None:
        """Find a placement for every budget by swaps."""
        aside = Run(self.run.rng, self.run.deadline, self.run.progress)
        greedy, _, _ = climb(most, aside)
        order = greedy.selected
        for n, k in enumerate(self.budgets):
            problem = self.known[k]
            start = [order[:k]]
            if n:
                state = problem.objective.state(np.array(self.best[k - 1], dtype=np.int64))
                added = None if self.run.out_of_time() else best_addition(problem, state)
                start.append(self.best[k - 1] + ([] if added is None else [added]))
            for selected in start:
                self._offer(k, selected)
            self._polish(k, self.best[k])
            self.run.progress(f"k = {k}, value {self.value[k]:.6g}", n / len(self.budgets))

    def _polish(self, k: int, selected: list[int]) -> None:
        problem = self.known[k]
        state = problem.objective.state(np.array(selected, dtype=np.int64))
        polish(problem, Run(self.run.rng, self.run.deadline, self.run.progress), state)
        self._offer(k, state.selected)

    def _offer(self, k: int, selected: list[int]) -> None:
        """Keep `selected` if it is better than the best of `k` cameras."""
        if not self.known[k].constraints.violations(selected):
            value = self.known[k].objective.value(np.array(sorted(selected), dtype=np.int64))
            if value < self.value.get(k, math.inf):
                self.best[k], self.value[k] = sorted(int(i) for i in selected), value

    def _refine(self) -> None:
        """Sweep with rising effort while time and labels allow."""
        seconds, labels = self._sweep_all(PROBE, probing=True)
        limited = math.isfinite(self.run.deadline)
        for effort in EFFORTS:
            before = self._labels
            if limited and GROWTH * seconds > self.run.remaining() - LEAVE_TIME_S:
                return
            if not limited and before + 2 * labels > MOST_LABELS:
                return
            seconds, labels = self._sweep_all(effort)
            if labels == 0 or all(self.bound(k) >= (1.0 - 1e-7) * self.value[k] for k in self.best):
                return

    def _sweep_all(self, effort: Effort, *, probing: bool = False) -> tuple[float, int]:
        """Sweep every drive; return the seconds it took and the labels, 0 if room ran out."""
        seconds, labels = 0.0, 0
        for weight, diagram in self._diagrams:
            outcome = self._sweep(weight, diagram, effort, probing=probing)
            if outcome is None:
                return seconds, 0
            seconds, labels = seconds + outcome.seconds, labels + outcome.labels
            if not probing:
                self._improve(outcome.paths)
        self._labels += labels
        return seconds, labels

    def _sweep(
        self, weight: float, diagram: Diagram, effort: Effort, *, probing: bool
    ) -> Outcome | None:
        """Sweep one drive for all budgets at once."""
        n = diagram.drive.n_samples
        threshold = np.full(diagram.budget + 1, -np.inf)
        for k in self.budgets:
            left = k - self._required()
            others = self.bound(k) - weight * diagram.bounds[left] / n
            threshold[left] = np.inf if probing else (self.value[k] - others) * n / weight
        return diagram.sweep(
            effort.width,
            threshold,
            lambda: self.run.remaining() <= LEAVE_TIME_S,
            probing=probing,
            epsilon=PROBE_EPSILON if probing else None,
            coarse_width=effort.coarse,
            slots=effort.slots,
            progress=lambda share: self.run.progress(f"width {effort.width}", share),
        )

    def _improve(self, paths: dict[int, list[int]]) -> None:
        """Make placements of the best paths; polish those that promise something."""
        for k in self.budgets:
            path = paths.get(k - self._required())
            if path is None:
                continue
            selected = repaired(self.known[k], path)
            if set(selected) == set(self.best[k]) or self.run.out_of_time():
                continue
            value = self.known[k].objective.value(np.array(sorted(selected), dtype=np.int64))
            if value < NEAR * self.value[k]:
                self._polish(k, selected)
