"""Prove `trace` placements by a relaxed decision diagram along the road, refined until it closes.

Each sweep (`placement.diagram`) merges fewer labels than the one before and prunes with what the
earlier ones proved, so the lower bound rises until it meets the best placement or time is up.
The path that attains the bound is a set of cameras; repaired and polished by swaps it is often
better than any found by local search alone, and a better placement prunes more.

The bound holds for every budget, one-per-mount or not, whatever overlaps: constraints other than
the count, required and forbidden poses are relaxed. With several drives, each has a diagram of
its own, and the weighted bounds are summed. Where cameras have persistent offsets, the diagram
bounds what could be had if those of cameras whose views meet were known, and so what can be had
(docs/trace-bound.md).
"""

from __future__ import annotations

import math
import time
from dataclasses import astuple, dataclass, field, replace
from typing import Any

import numpy as np

from models.geometry import BoolArray, IntArray
from placement.diagram.passes import Diagram, Outcome
from placement.diagram.single import OutOfTime
from placement.objectives.navigation_chain import Drive
from placement.objectives.trace import Trace, WhiteTrace
from placement.problem import Problem, Run
from placement.solution import OPTIMAL_GAP, Proposal, Status
from placement.solvers.exchange import polish
from placement.solvers.greedy import climb

LEAVE_TIME_S = 0.4  # for the verb's own checks, out of the time limit
BOUND_FROM = "relaxed decision diagram along the road"
KNOWN_OFFSETS = BOUND_FROM + ", offsets known where views meet"


@dataclass(frozen=True, slots=True)
class Effort:
    """How finely a sweep tells labels apart."""

    width: int  # labels a sample and count
    coarse: int  # those from which clusters start
    slots: int  # labels inside clusters, for each end and class


# Each sweep costs two to four times the one before; beyond the last, memory is the limit. What
# helps differs: on `winding` labels inside clusters, on `circuit` those between them.
EFFORTS = (
    Effort(12, 2, 1),
    Effort(60, 4, 2),
    Effort(120, 8, 4),
    Effort(250, 8, 4),
    Effort(400, 16, 8),
    Effort(800, 24, 8),
    Effort(1600, 32, 12),
)
QUICK = (Effort(120, 8, 4), Effort(400, 16, 8), Effort(1600, 32, 12))
LABELS_GROW = 4.0  # times from the probe to the first quick effort and from that to the next
PROBE = Effort(60, 1, 1)
PROBE_EPSILON = 0.2
GROWTH = 2.3  # times as long as the one before takes the next sweep
WORTH_IT = 1.4  # a sweep that may not take this much longer than the last is not worth it


def solve_diagram(problem: Problem, run: Run) -> Proposal:
    """Find a placement by swaps, then prove and improve it sweep by sweep.

    Raises:
        ValueError: for an objective other than `trace`, or views too long for the memory.
    """
    proof = Proof(problem, run)
    finished = proof.work()
    return Proposal(
        proof.incumbent,
        run.score_bound,
        Status.FEASIBLE if finished else Status.TIME_LIMIT,
        proof.stats(),
    )


@dataclass(slots=True)
class Proof:
    """The incumbent, the diagrams of the drives, and what was proven.

    `most_labels` takes the quick efforts and ends before a sweep that would take the labels of
    all sweeps beyond that many. `known` is the problem with all offsets known, the same where
    there are none; `selected` and `value` are the best placement of that one, `incumbent` and
    `true_value` of the problem itself.
    """

    problem: Problem
    run: Run
    most_labels: float = np.inf
    known: Problem = field(init=False)
    persistent: bool = field(init=False)
    incumbent: list[int] = field(default_factory=list)
    true_value: float = np.inf
    selected: list[int] = field(default_factory=list)
    value: float = np.inf
    sweeps: list[dict[str, Any]] = field(default_factory=list)
    _diagrams: list[tuple[float, Diagram]] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Look at the objective."""
        objective = self.problem.objective
        if not isinstance(objective, Trace):
            raise ValueError(f"method diagram needs the objective trace, got {objective.name}")
        self.persistent = objective.persistent
        self.known = self.problem
        if self.persistent:
            self.known = replace(self.problem, objective=objective.offsets_known())

    def work(self) -> bool:
        """Start by swaps, then sweep with rising effort; return whether no time was missing."""
        self.prepare()
        started = Run(self.run.rng, self.run.deadline, self.run.progress)
        state, _, _ = climb(self.known, started)
        self.run.incumbent = state.selected
        polish(self.known, started, state)
        self.offer(state.selected)
        if self.persistent:
            self._polish_truly(0.3 * self.run.remaining())
        return self.refine()

    def prepare(self) -> None:
        """Lay out the diagrams; their floors are a first bound."""
        usable, required, budget = free_choice(self.known)
        parts = zip(white_parts(self.known), offset_drives(self.problem), strict=True)
        for (weight, part), persistent in parts:
            if weight > 0.0:
                weights = (part.w_tt, part.w_nn)
                diagram = Diagram(part.drive, weights, usable, required, budget, persistent)
                self._diagrams.append((weight, diagram))
        self._publish()

    def refine(self) -> bool:
        """Sweep with rising effort; return whether all was done that can be."""
        try:
            for at in range(len(self._diagrams)):
                self._sweep(at, PROBE, probing=True)
            last = PROBE
            for wanted in EFFORTS if math.isinf(self.most_labels) else QUICK:
                effort = self._affordable(last, wanted)
                if effort is None or not self._refined(effort):
                    break
                last = effort
        except OutOfTime:
            return False
        return self.run.remaining() > LEAVE_TIME_S

    def stats(self) -> dict[str, Any]:
        """Return what there is to tell about the search."""
        bound_from = KNOWN_OFFSETS if self.persistent else BOUND_FROM
        return {"sweeps": self.sweeps, "bound_from": bound_from}

    def offer(self, selected: list[int]) -> None:
        """Keep `selected` where it is better than the incumbents."""
        if self.problem.constraints.violations(selected):
            return
        chosen = sorted(int(i) for i in selected)
        value = self.known.objective.value(np.array(chosen, dtype=np.int64))
        if value < self.value:
            self.value, self.selected = value, chosen
        if self.persistent:
            value = self.problem.objective.value(np.array(chosen, dtype=np.int64))
        if value < self.true_value:
            self.true_value, self.incumbent = value, chosen
        self.run.incumbent = self.incumbent

    @property
    def bound(self) -> float:
        """The proven lower bound on the value, in m²."""
        return float(sum(w * d.bound / d.drive.n_samples for w, d in self._diagrams))

    def _affordable(self, last: Effort, wanted: Effort) -> Effort | None:
        """Return the effort for which time and labels suffice, None if that is no more."""
        if not self.sweeps:
            return wanted
        done = self.sweeps[-len(self._diagrams) :]
        labels = sum(s["labels"] for s in done)
        if sum(s["labels"] for s in self.sweeps) + LABELS_GROW * labels > self.most_labels:
            return EFFORTS[0] if last is PROBE else None
        if last is PROBE:
            return wanted
        seconds = max(1e-3, sum(s["seconds"] for s in done))
        affordable = 0.8 * (self.run.remaining() - LEAVE_TIME_S) / seconds
        if affordable >= GROWTH:
            return wanted
        if affordable < WORTH_IT:
            return None
        share = (affordable - 1.0) / (GROWTH - 1.0)
        return Effort(
            *(int(a + share * (b - a)) for a, b in zip(astuple(last), astuple(wanted), strict=True))
        )

    def _refined(self, effort: Effort) -> bool:
        """Sweep every diagram, as long as that helps; return whether a finer one may help more."""
        while not self._proven():
            bound, value = self.bound, self.true_value
            for at in range(len(self._diagrams)):
                outcome = self._sweep(at, effort)
                if outcome is None:  # no room: be coarser where it matters least
                    less = Effort(effort.width, effort.coarse // 2 + 1, effort.slots // 2 + 1)
                    outcome = self._sweep(at, less)
                if outcome is None:
                    return False
                self._improve(outcome)
            gap = max(self.true_value - bound, 0.0)
            if value - self.true_value < 0.1 * gap:
                return not self._proven()
        return False

    def _sweep(self, at: int, effort: Effort, *, probing: bool = False) -> Outcome | None:
        """Sweep one diagram; what it may not exceed follows from what the others need."""
        weight, diagram = self._diagrams[at]
        n = diagram.drive.n_samples
        others = self.bound - weight * diagram.bound / n
        threshold = np.inf if probing else (self.true_value - others) * n / weight

        def report(share: float) -> None:
            value = self.true_value
            gap = (value - self.bound) / max(value, 1e-300)
            text = f"width {effort.width}, value {value:.6g}, gap {100.0 * gap:.3g} %"
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

    def _proven(self) -> bool:
        return self.true_value - self.bound <= 0.5 * OPTIMAL_GAP * abs(self.true_value)

    def _improve(self, outcome: Outcome) -> None:
        """Make a placement of a sweep's best path, polish it, and keep it if it is better."""
        selected = repaired(self.known, outcome.path)
        if set(selected) == set(self.selected):
            return
        self.offer(selected)
        state = self.known.objective.state(np.array(selected, dtype=np.int64))
        polish(self.known, Run(self.run.rng, self.run.deadline, self.run.progress), state)
        self.offer(state.selected)

    def _polish_truly(self, seconds: float) -> None:
        """Polish the incumbent with its offsets unknown, for some seconds."""
        state = self.problem.objective.state(np.array(self.incumbent, dtype=np.int64))
        with shortened(self.run, seconds):
            polish(self.problem, self.run, state)
        self.offer(state.selected)

    def _publish(self) -> None:
        publish(self.run, -min(self.bound, self.true_value))


def publish(run: Run, score_bound: float) -> bool:
    """Tell `run` of a bound; return whether it is better than the one it had."""
    if run.score_bound is None or score_bound < run.score_bound:
        run.score_bound = score_bound
        return True
    return False


class shortened:  # noqa: N801 - reads as a verb after `with`
    """Let `run` end `seconds` from now, or at its own deadline if that is sooner."""

    def __init__(self, run: Run, seconds: float) -> None:
        """Remember the run's own deadline."""
        self.run, self.seconds, self.deadline = run, seconds, run.deadline

    def __enter__(self) -> None:
        """Bring the deadline forward."""
        self.run.deadline = min(self.deadline, time.monotonic() + self.seconds)

    def __exit__(self, *_: object) -> None:
        """Put it back."""
        self.run.deadline = self.deadline


def repaired(problem: Problem, path: list[int]) -> list[int]:
    """Return the required cameras and as many of the path's, in order, as may join them."""
    constraints = problem.constraints
    selected = [int(i) for i in np.unique(constraints.required)]
    for candidate in dict.fromkeys(path):
        if constraints.addable(np.array(selected, dtype=np.int64))[candidate]:
            selected.append(candidate)
    return selected


def white_parts(problem: Problem) -> list[tuple[float, WhiteTrace]]:
    """Return the weighted drives of a `trace` problem, or say that the diagram cannot help."""
    objective = problem.objective
    if not isinstance(objective, Trace):
        raise ValueError(f"method diagram needs the objective trace, got {objective.name}")
    parts = []
    for weight, part in objective.parts():
        if not isinstance(part, WhiteTrace):
            raise ValueError("a diagram needs cameras whose offsets are known: see offsets_known")
        parts.append((weight, part))
    return parts


def offset_drives(problem: Problem) -> list[Drive | None]:
    """Return each drive of a `trace` problem whose cameras have persistent offsets, else None."""
    objective = problem.objective
    drives = objective.drives if isinstance(objective, Trace) else []
    return [drive if drive.persistent else None for drive in drives]


def free_choice(problem: Problem) -> tuple[BoolArray, IntArray, int]:
    """Return the candidates (c,) that may join the required ones, those, and the budget left."""
    constraints = problem.constraints
    required = np.unique(constraints.required)
    usable = constraints.usable()
    usable[required] = False
    return usable, required, constraints.budget - required.size
