"""Prove `trace` placements by a relaxed decision diagram along the road, refined until it closes.

Each sweep (`diagram.sweep`) merges fewer labels than the one before and prunes with what the
earlier ones proved, so the lower bound rises until it meets the best placement or time is up.
The path that attains the bound is a set of cameras; repaired and polished by swaps it is often
better than any found by local search alone, and a better placement prunes more.

The bound holds for every budget, one-per-mount or not, whatever overlaps: constraints other than
the count, required and forbidden poses are relaxed. With several drives, each has a diagram of
its own, and the weighted bounds are summed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models.geometry import BoolArray, IntArray
from placement.diagram.passes import Diagram, Outcome, OutOfTime
from placement.objectives.trace import Trace, WhiteTrace
from placement.problem import Problem, Run
from placement.solution import OPTIMAL_GAP, Proposal, Status
from placement.solvers.exchange import polish
from placement.solvers.greedy import climb

LEAVE_TIME_S = 0.4  # for the verb's own checks, out of the time limit
STALL = 1e-4  # a sweep that raises the bound by less (relative) changed nothing


@dataclass(frozen=True, slots=True)
class Effort:
    """How finely a sweep tells labels apart."""

    width: int  # labels a sample and count
    coarse: int  # those from which clusters start
    slots: int  # labels inside clusters, for each end and class


# Each sweep costs two to four times the one before; beyond the last, memory is the limit.
EFFORTS = (
    Effort(12, 2, 1),
    Effort(40, 4, 2),
    Effort(100, 8, 4),
    Effort(200, 12, 6),
    Effort(400, 16, 8),
    Effort(800, 24, 8),
    Effort(1600, 32, 12),
)
PROBE = Effort(60, 1, 1)
PROBE_EPSILON = 0.2


def solve_diagram(problem: Problem, run: Run) -> Proposal:
    """Find a placement by swaps, then prove and improve it sweep by sweep.

    Raises:
        ValueError: for an objective other than `trace`, or persistent errors.
    """
    search = Search(problem, run)
    finished = search.explore()
    return Proposal(
        search.incumbent,
        run.score_bound,
        Status.FEASIBLE if finished else Status.TIME_LIMIT,
        search.stats(),
    )


@dataclass(slots=True)
class Search:
    """The incumbent, the diagrams of the drives, and what was proven."""

    problem: Problem
    run: Run
    incumbent: list[int] = field(default_factory=list)
    value: float = np.inf
    sweeps: list[dict[str, Any]] = field(default_factory=list)
    _diagrams: list[tuple[float, Diagram]] = field(default_factory=list)

    def explore(self) -> bool:
        """Sweep with rising effort; return whether all was done that can be."""
        parts = white_parts(self.problem)
        state, _, _ = climb(self.problem, self.run)
        polish(self.problem, self.run, state)
        self._offer(state.selected)
        usable, required, budget = free_choice(self.problem)
        for weight, part in parts:
            if weight > 0.0:
                diagram = Diagram(part.drive, (part.w_tt, part.w_nn), usable, required, budget)
                self._diagrams.append((weight, diagram))
        self._publish()
        try:
            for at, (_, diagram) in enumerate(self._diagrams):
                self._sweep(at, diagram, PROBE, probing=True)
            for effort in EFFORTS:
                if not self._refine(effort):
                    break
        except OutOfTime:
            return False
        return True

    def stats(self) -> dict[str, Any]:
        """Return what there is to tell about the search."""
        return {"sweeps": self.sweeps, "bound_from": "relaxed decision diagram along the road"}

    def _refine(self, effort: Effort) -> bool:
        """Sweep every diagram, as long as that helps; return whether a finer one may help more."""
        fits = True
        while not self._proven() and fits:
            bound, value = self.bound, self.value
            for at, (_, diagram) in enumerate(self._diagrams):
                outcome = self._sweep(at, diagram, effort)
                if outcome is None:  # no room: be coarser where it matters least
                    less = Effort(effort.width, effort.coarse // 2 + 1, effort.slots // 2 + 1)
                    outcome = self._sweep(at, diagram, less)
                fits = fits and outcome is not None
                if outcome is not None:
                    self._improve(outcome)
            gap = max(self.value - bound, 0.0)
            if self.bound - bound < 0.3 * gap and value - self.value < 0.1 * gap:
                break
        return not self._proven() and fits

    def _sweep(
        self, at: int, diagram: Diagram, effort: Effort, *, probing: bool = False
    ) -> Outcome | None:
        """Sweep one diagram; what it may not exceed follows from what the others need."""
        n = diagram.drive.n_samples
        weight = self._diagrams[at][0]
        others = self.bound - weight * diagram.bound / n
        threshold = np.inf if probing else (self.value - others) * n / weight

        def report(share: float) -> None:
            gap = (self.value - self.bound) / max(self.value, 1e-300)
            text = f"width {effort.width}, value {self.value:.6g}, gap {100.0 * gap:.3g} %"
            self.run.progress(text, share)

        outcome = diagram.sweep(
            effort.width,
            threshold,
            lambda: self.run.remaining() <= LEAVE_TIME_S,
            probing=probing,
            epsilon=PROBE_EPSILON if probing else None,
            coarse_width=effort.coarse,
            slots=effort.slots,
            progress=report,
        )
        # nothing below the incumbent was found: then the incumbent is the bound
        diagram.bound = min(diagram.bound, max(threshold, 0.0))
        if outcome is not None:
            self.sweeps.append(
                {
                    "width": effort.width,
                    "bound": self.bound,
                    "labels": outcome.labels,
                    "seconds": outcome.seconds,
                }
            )
        self._publish()
        return outcome

    @property
    def bound(self) -> float:
        """The proven lower bound on the value, in m²."""
        return float(sum(w * d.bound / d.drive.n_samples for w, d in self._diagrams))

    def _proven(self) -> bool:
        return self.value - self.bound <= 0.5 * OPTIMAL_GAP * abs(self.value)

    def _improve(self, outcome: Outcome) -> None:
        """Make a placement of a sweep's best path, polish it, and keep it if it is better."""
        constraints = self.problem.constraints
        state = self.problem.objective.state(np.unique(constraints.required))
        for candidate in dict.fromkeys(outcome.path):
            if constraints.addable(np.array(state.selected, dtype=np.int64))[candidate]:
                state.add(candidate)
        if set(state.selected) == set(self.incumbent):
            return
        self._offer(state.selected)
        polish(self.problem, self.run, state)
        self._offer(state.selected)

    def _offer(self, selected: list[int]) -> None:
        """Keep `selected` if it is better than the incumbent."""
        value = self.problem.objective.value(np.array(selected, dtype=np.int64))
        if value < self.value and not self.problem.constraints.violations(selected):
            self.value = value
            self.incumbent = sorted(int(i) for i in selected)
        self.run.incumbent = self.incumbent

    def _publish(self) -> None:
        score_bound = -min(self.bound, self.value)
        if self.run.score_bound is None or score_bound < self.run.score_bound:
            self.run.score_bound = score_bound


def white_parts(problem: Problem) -> list[tuple[float, WhiteTrace]]:
    """Return the weighted drives of a `trace` problem, or say that the diagram cannot help."""
    objective = problem.objective
    if not isinstance(objective, Trace):
        raise ValueError(f"method diagram needs the objective trace, got {objective.name}")
    parts = []
    for weight, part in objective.parts():
        if not isinstance(part, WhiteTrace):
            raise ValueError(
                "method diagram needs errors.persistent = false: with offsets a camera's frames "
                "depend on each other for as long as it sees the car"
            )
        parts.append((weight, part))
    return parts


def free_choice(problem: Problem) -> tuple[BoolArray, IntArray, int]:
    """Return the candidates (c,) that may join the required ones, those, and the budget left."""
    constraints = problem.constraints
    required = np.unique(constraints.required)
    usable = constraints.usable()
    usable[required] = False
    return usable, required, constraints.budget - required.size
