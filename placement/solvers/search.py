"""Exchange, then rearrange whole stretches of the road and keep what helps.

Swaps stop where no *single* camera can be bettered, but neighbours depend on each other: two or
three may have to move together. So a kick takes out a few consecutive cameras, puts them back
elsewhere in the same stretch, lets the cameras around it settle by local swaps, and is undone
unless the whole is better (iterated local search: Lourenço, Martin & Stützle 2003). Gains near
one place cost a hundredth of a sweep over all candidates, so a kick costs about as much as a swap.
Where money is short it need not put back as many: what is left over buys more in the stretch.

On `winding` with `trace` fifty kicks led from either start to the same placement, better than
that of swaps alone by 1–7 %. Nothing is proven beyond greedy's bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.objectives.base import State
from placement.problem import Problem, Run
from placement.solution import Proposal, Status
from placement.solvers.exchange import MARGIN, polish
from placement.solvers.greedy import UpperGains, climb, per_money, tighten_bound
from placement.solvers.nearby import addable_near, number_places
from placement.solvers.uniform import solve_uniform

PATIENCE = 50  # kicks in a row that came to nothing, before the search ends; or, if more,
PATIENCE_PER_CAMERA = 4  # this many for each camera
LONGEST = 5  # cameras a kick takes out, at most
_REACH = 2  # places along the road within which a local swap looks for a better pose
_NEIGHBOURS = 2  # cameras on either side of a change that look again


def solve_search(problem: Problem, run: Run) -> Proposal:
    """Polish greedy's and the uniform placement by swaps, then kick the better until it stays.

    Where the candidates have no place along a road, greedy's is polished and that is all.
    """
    place = number_places(problem)
    # The uniform placement costs next to nothing: it is there when time runs out on greedy's.
    other = None if place is None else _uniform_start(problem, run)
    state, _, in_time = climb(problem, run)
    swaps, settled = polish(problem, run, state)
    stats: dict[str, Any] = {"swaps": swaps, "start": "greedy"}
    if place is not None and other is not None:
        # In a run of its own, so that the incumbent stays the better of the two.
        polish(problem, Run(run.rng, run.deadline, run.progress), other)
        if other.score > state.score + MARGIN * abs(state.score):
            state, stats["start"] = other, "uniform"
        run.incumbent = state.selected
        kicks = Kicks(problem, run, state, place)
        stats.update(kicks.work())
        if stats["kicks_kept"]:
            swaps, settled = polish(problem, run, state)
            stats["swaps"] += swaps
    finished = in_time and settled and not run.out_of_time()
    if finished and problem.objective.submodular:
        tighten_bound(problem, run, UpperGains(state, lazy=True))
    return Proposal(
        state.selected,
        run.score_bound,
        Status.FEASIBLE if finished else Status.TIME_LIMIT,
        stats,
    )


def rearrange(problem: Problem, run: Run, state: State) -> None:
    """Kick `state` until it stays or time is up, where candidates have places along a road."""
    place = number_places(problem)
    if place is not None:
        Kicks(problem, run, state, place).work()


def _uniform_start(problem: Problem, run: Run) -> State:
    """Return the uniform placement as a state."""
    proposal = solve_uniform(problem, Run(run.rng, run.deadline, run.progress))
    return problem.objective.state(np.array(proposal.selected, dtype=np.int64))


@dataclass(slots=True)
class Kicks:
    """Rearrange stretches of the placement in `state`; `place` (c,) numbers the places."""

    problem: Problem
    run: Run
    state: State
    place: IntArray

    def work(self, patience: int | None = None) -> dict[str, int]:
        """Kick until `patience` in a row fail or time is up; leave the best in `state`."""
        best, best_score = self.state.selected, self.state.score
        tried = kept = failed = 0
        if patience is None:
            patience = max(PATIENCE, PATIENCE_PER_CAMERA * len(best))
        while failed < patience and self.movable() and not self.run.out_of_time():
            tried += 1
            score = self.kick()
            if score > best_score + MARGIN * abs(best_score):
                best, best_score = self.state.selected, score
                self.run.incumbent = best
                kept, failed = kept + 1, 0
                self.run.progress(f"{tried} rearrangements, score {score:.6g}", None)
            else:
                self.become(best)
                failed += 1
        return {"kicks": tried, "kicks_kept": kept}

    def kick(self) -> float:
        """Move a few consecutive cameras within their stretch, let it settle; return the score."""
        rng, place, state = self.run.rng, self.place, self.state
        order = self.movable()
        size = int(rng.integers(1, min(LONGEST, len(order)) + 1))
        first = int(rng.integers(0, len(order) - size + 1))
        last = first + size
        low = int(place[order[first - 1]]) if first else 0
        high = int(place[order[last]]) if last < len(order) else int(place.max())
        for camera in order[first:last]:
            state.remove(camera)
        if rng.uniform() < 0.5:
            targets = rng.uniform(low, high + 1, size)
        else:  # one in each equal part of the stretch
            targets = low + (np.arange(size) + rng.uniform(0.0, 1.0, size)) * (high - low) / size
        per_gain = self._thrift()
        for target in rng.permutation(targets):
            candidates = addable_near(self.problem, state.selected, place, int(target), 1)
            if candidates.size:
                gains = per_gain[candidates] * state.gains(candidates)
                state.add(int(candidates[np.argmax(gains)]))
        if self.problem.constraints.limits_money:
            self._spend(low, high, per_gain)
        nearby = [i for i in self.movable() if low - 1 <= place[i] <= high + 1]
        return self.settle(nearby)

    def _thrift(self) -> FloatArray:
        """Return what a gain is worth, (c,): where money is short, every other kick by its price.

        A dear camera's place is then taken by cheap ones, which swaps one by one never try.
        """
        constraints = self.problem.constraints
        if not constraints.limits_money or self.run.rng.uniform() < 0.5:
            return np.ones(constraints.n)
        return per_money(constraints)

    def _spend(self, low: int, high: int, per_gain: FloatArray) -> None:
        """Buy more cameras in the stretch for what is left, as long as that helps."""
        state = self.state
        for _ in range(LONGEST):
            allowed = self.problem.constraints.addable(np.array(state.selected, dtype=np.int64))
            here = (self.place >= low - 1) & (self.place <= high + 1)
            candidates = np.flatnonzero(allowed & here)
            gains = state.gains(candidates)
            if not np.any(gains > 0.0):
                return
            state.add(int(candidates[np.argmax(per_gain[candidates] * gains)]))

    def settle(self, waiting: list[int]) -> float:
        """Swap the cameras `waiting` for better ones near by, and whoever that unsettles."""
        state, place = self.state, self.place
        score = state.score
        while waiting and not self.run.out_of_time():
            camera = waiting.pop(0)
            state.remove(camera)
            candidates = addable_near(
                self.problem, state.selected, place, int(place[camera]), _REACH
            )
            gains = state.gains(candidates)
            best = int(np.argmax(gains))
            risen = state.score + float(gains[best])
            if risen <= score + MARGIN * abs(score):
                state.add(camera)
                continue
            score = risen
            new = int(candidates[best])
            state.add(new)
            order = self.movable()
            at = order.index(new)
            for other in order[max(0, at - _NEIGHBOURS) : at + _NEIGHBOURS + 1]:
                if other != new and other not in waiting:
                    waiting.append(other)
        return state.score

    def movable(self) -> list[int]:
        """List the cameras that are not required, along the road."""
        required = {int(i) for i in self.problem.constraints.required}
        free = (i for i in self.state.selected if i not in required)
        return sorted(free, key=lambda i: (self.place[i], i))

    def become(self, selected: list[int]) -> None:
        """Make the state hold `selected` again."""
        for camera in set(self.state.selected) - set(selected):
            self.state.remove(camera)
        for camera in sorted(set(selected) - set(self.state.selected)):
            self.state.add(camera)
