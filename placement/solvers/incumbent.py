"""The best placement of a proof for `entropy`, the best bound, and what betters the one.

Whatever a stage proposes, a path of the chain above all, is mended until it obeys the constraints,
polished by swaps, and kept if it is better.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models.geometry import IntArray
from placement.objectives.base import State
from placement.objectives.entropy import Entropy
from placement.problem import Problem, Run
from placement.solvers.crossing import breed, meet
from placement.solvers.exchange import polish
from placement.solvers.greedy import best_addition
from placement.solvers.search import rearrange as rearranged

PATH_SHARE = 0.03  # of the time left, for polishing a path
TURN_SHARE = 0.25  # of the time left at the end, for rearranging, then for crossing, in turns
DONE = 1e-7  # relative gap that counts as closed: a tenth of what `optimal` asks for
LEAVE_TIME_S = 0.3


@dataclass(slots=True)
class Incumbent:
    """The best placement so far and what each stage has proven; `inner` ends a little earlier."""

    problem: Problem
    objective: Entropy
    run: Run
    selected: list[int] = field(default_factory=list)
    score: float = -np.inf
    stats: dict[str, Any] = field(default_factory=dict)
    inner: Run = field(init=False)

    def __post_init__(self) -> None:
        """Leave time to write the result."""
        self.inner = Run(self.run.rng, deadline=self.run.deadline - LEAVE_TIME_S)

    def rearrange(self, state: State, share: float) -> None:
        """Move cameras of one stretch together, for a share of the time (see `solvers.search`)."""
        rearranged(self.problem, self.for_a_share(share), state)

    def for_a_share(self, share: float) -> Run:
        """Return a run of its own for a share of the time left."""
        limit = time.monotonic() + share * min(self.inner.remaining(), 1e3)
        return Run(self.run.rng, min(limit, self.inner.deadline), self.run.progress)

    def use_what_is_left(self) -> None:
        """Rearrange the placement and cross it with others, while that helps and there is time."""
        state, before = self.objective.state(np.array(self.selected, dtype=np.int64)), -np.inf
        while state.score > before and not self.inner.out_of_time():
            before = state.score
            self.rearrange(state, TURN_SHARE)
            breed(self.problem, self.for_a_share(TURN_SHARE), state)
        self.offer(np.array(state.selected, dtype=np.int64))

    def try_path(self, path: IntArray) -> None:
        """Polish the placement nearest to a path, if there is one, and keep it if it is better."""
        if self.inner.out_of_time():
            return
        path = self._mended(path)
        if self.problem.constraints.violations(path):
            return
        state = self.objective.state(np.sort(path))
        polish(self.problem, self.for_a_share(PATH_SHARE), state)
        meet(self.problem, self.for_a_share(PATH_SHARE), state, self.selected)
        self.offer(np.array(state.selected, dtype=np.int64))

    def _mended(self, path: IntArray) -> IntArray:
        """Return a path without all but the first camera of each group, filled up greedily."""
        constraints = self.problem.constraints
        group = constraints.group[path]
        _, first = np.unique(group, return_index=True)
        kept = np.union1d(path[first], path[group < 0])
        if kept.size == path.size:
            return path
        state = self.objective.state(kept)
        while len(state.selected) < constraints.budget and not self.inner.out_of_time():
            added = best_addition(self.problem, state)
            if added is None:
                break
            state.add(added)
        return np.array(state.selected, dtype=np.int64)

    def offer(self, selected: IntArray) -> None:
        """Keep `selected` if it is a placement and better than the incumbent."""
        if self.problem.constraints.violations(selected):
            return
        score = self.objective.value(selected)
        if score > self.score:
            self.score = score
            self.selected = [int(i) for i in np.sort(selected)]
            self.run.incumbent = self.selected

    def bounded(self, stage: str, bound: float) -> None:
        """Note what a stage has proven: nothing beats both the incumbent and `bound`."""
        # logarithms of numbers near 1 are off by an ulp of 1 each, however small their sum
        samples = sum(drive.weight * drive.information.n_samples for drive in self.objective.drives)
        slack = 4.0 * np.finfo(np.float64).eps * samples if bound > 0.0 else 0.0
        bound = max(float(bound) + slack, self.score)
        known = self.stats["bounds"].get(stage, np.inf)
        self.stats["bounds"][stage] = min(known, bound)
        if self.run.score_bound is None or bound <= self.run.score_bound:
            first = "bound_from" not in self.stats
            if first or self.run.score_bound is None or bound < self.run.score_bound:
                self.stats["bound_from"] = stage
            self.run.score_bound = bound
        gap = (self.run.score_bound - self.score) / max(abs(self.score), 1e-300)
        self.run.progress(f"{stage}: score {self.score:.6g}, gap {100.0 * gap:.3g} %", None)

    def closed(self) -> bool:
        """Say whether bound and score agree to all that `optimal` asks for."""
        bound = self.run.score_bound
        return bound is not None and bound - self.score <= DONE * abs(self.score)
