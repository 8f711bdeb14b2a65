"""Placements of every budget, each from its neighbours': one camera more, or one camera fewer.

Looking at all candidates for every camera of every budget would take longer than one budget does,
so that is done at a few budgets alone. Everywhere else cameras look around where they stand
(`placement.solvers.search`), after one has joined on the way up or left on the way down, and after
a few kicks. Where the candidates have no place along a road, swaps do what they can.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from models.geometry import IntArray
from placement.diagram.moves import three_columns, undominated
from placement.problem import Problem, Run
from placement.solvers.diagram import free_choice, white_parts
from placement.solvers.exchange import polish
from placement.solvers.greedy import best_addition, climb
from placement.solvers.nearby import number_places
from placement.solvers.search import Kicks

DENSE = 5  # budgets up to this many are all polished, and then
SPREAD = 1.5  # those that are this many times the last one polished
PATIENCE, PATIENCE_FEW = 4, 9  # kicks in a row that may fail, for a budget and for one of at most
FEW = 16  # cameras
MARGIN = 1e-12  # relative: less is rounding


@dataclass(slots=True)
class CurveSearch:
    """The best placements of the `budgets`, under an objective without persistent offsets."""

    known: dict[int, Problem]
    run: Run
    best: dict[int, list[int]] = field(default_factory=dict)
    value: dict[int, float] = field(default_factory=dict)
    _narrow: dict[int, Problem] = field(default_factory=dict)
    _place: IntArray | None = None

    @property
    def budgets(self) -> list[int]:
        """The budgets, in increasing order."""
        return sorted(self.known)

    def work(self) -> None:
        """Go up, down, kick, and down and up again; stop early when time is up."""
        most = self.known[self.budgets[-1]]
        self._place = number_places(most)
        out = _left_out(most)
        for k, problem in self.known.items():
            rules = problem.constraints
            forbidden = np.union1d(rules.forbidden, out)
            self._narrow[k] = replace(problem, constraints=replace(rules, forbidden=forbidden))
        self._climb()
        if self._place is None:
            return
        for k in self.budgets[-2::-1]:
            self._leave(k)
        for n, k in enumerate(self.budgets):
            self._kick(k)
            self._tell(k, "kicked", n)
        for k in self.budgets[-2::-1]:
            self._leave(k)
        for k in self.budgets[1:]:
            self._join(k)

    def offer(self, k: int, selected: list[int]) -> None:
        """Keep `selected` if it is better than the best of `k` cameras."""
        if not self.known[k].constraints.violations(selected):
            chosen = sorted(int(i) for i in selected)
            value = self.known[k].objective.value(np.array(chosen, dtype=np.int64))
            if value < self.value.get(k, math.inf) * (1.0 - MARGIN):
                self.best[k], self.value[k] = chosen, value

    def improve(self, k: int, selected: list[int]) -> None:
        """Offer `selected` settled and polished; what is better goes to the neighbours, too."""
        before = self.value[k]
        self._settle(k, selected)
        if self.value[k] < before:
            self._polish(k, self.best[k])
            if k + 1 in self.known:
                self._join(k + 1)
            if k - 1 in self.known:
                self._leave(k - 1)

    def _climb(self) -> None:
        """Start every budget from greedy's cameras and from those of the budget before."""
        most = self._narrow[self.budgets[-1]]
        greedy, _, _ = climb(most, Run(self.run.rng, self.run.deadline, self.run.progress))
        order = greedy.selected
        polished = 0
        for n, k in enumerate(self.budgets):
            self.offer(k, order[:k])
            if n:
                self.offer(k, self.best[self.budgets[n - 1]])
            if self.run.out_of_time():
                continue
            if n:
                self._join(k)
            if self._place is None or k <= DENSE or k >= SPREAD * polished:
                self._settle(k, order[:k])
                self._polish(k, self.best[k])
                polished = k
            self._tell(k, "polished", n)

    def _join(self, k: int) -> None:
        """Offer the placement of a camera fewer with the best one more, settled."""
        if k - 1 not in self.best or self.run.out_of_time():
            return
        problem = self._narrow[k]
        fewer = self.best[k - 1]
        added = best_addition(problem, problem.objective.state(np.array(fewer, dtype=np.int64)))
        if added is not None:
            self._settle(k, [*fewer, added])

    def _polish(self, k: int, selected: list[int]) -> None:
        """Offer `selected` polished by swaps."""
        problem = self._narrow[k]
        state = problem.objective.state(np.array(selected, dtype=np.int64))
        polish(problem, Run(self.run.rng, self.run.deadline, self.run.progress), state)
        self.offer(k, state.selected)

    def _leave(self, k: int) -> None:
        """Offer the placement of a camera more without the one least missed, settled."""
        if k + 1 not in self.best or self.run.out_of_time():
            return
        more, rules = self.best[k + 1], self.known[k].constraints
        value = self.known[k].objective.value
        without = [[i for i in more if i != j] for j in more if j not in rules.required]
        if without:
            self._settle(k, min(without, key=lambda s: value(np.array(s, dtype=np.int64))))

    def _settle(self, k: int, selected: list[int]) -> None:
        """Offer `selected` after all its cameras have looked around."""
        kicks = self._kicks(k, selected)
        if kicks is not None:
            kicks.settle(kicks.movable())
            selected = kicks.state.selected
        self.offer(k, selected)

    def _kick(self, k: int) -> None:
        """Kick the best placement of `k` cameras until a few kicks in a row come to nothing."""
        kicks = self._kicks(k, self.best[k])
        if kicks is not None and kicks.movable() and not self.run.out_of_time():
            kicks.work(PATIENCE_FEW if k <= FEW else PATIENCE)
            self.offer(k, kicks.state.selected)

    def _kicks(self, k: int, selected: list[int]) -> Kicks | None:
        if self._place is None:
            return None
        problem = self._narrow[k]
        state = problem.objective.state(np.array(selected, dtype=np.int64))
        return Kicks(
            problem, Run(self.run.rng, self.run.deadline, self.run.progress), state, self._place
        )

    def _tell(self, k: int, done: str, n: int) -> None:
        self.run.progress(f"k = {k} {done}, value {self.value[k]:.6g}", n / len(self.budgets))


def _left_out(problem: Problem) -> IntArray:
    """Return the candidates that another exceeds everywhere: not looked at by the search."""
    parts = white_parts(problem)
    usable, required, _ = free_choice(problem)
    if len(parts) > 1:
        return np.empty(0, dtype=np.int64)
    drive = parts[0][1].drive
    keep = undominated(drive.indptr, drive.indices, three_columns(drive), usable)
    return np.setdiff1d(np.arange(usable.size), np.concatenate([keep, required]))
