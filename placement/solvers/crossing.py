"""Cross placements of a road: where both hold as many cameras in a stretch, try the other's there.

Searches from different starts end in different places, each good in other stretches. A trial costs
one pass of the filter, so crossing two placements takes a second or two where polishing one takes a
minute; what it keeps is what neither search would have found by moving a few cameras at a time. The
others come from one camera in each of k equal parts, at random, settled by local swaps. (Partition
crossover: Whitley, Hains & Howe 2009, for tours; here a road has only one order to cut.)
"""

from __future__ import annotations

import numpy as np

from models.geometry import IntArray
from placement.objectives.base import State
from placement.problem import Problem, Run
from placement.solvers.exchange import MARGIN
from placement.solvers.nearby import addable_near, number_places
from placement.solvers.search import Kicks

LONGEST = 20  # cameras of a stretch that is exchanged as a whole, at most
PATIENCE = 6  # mates in a row that brought nothing


def breed(problem: Problem, run: Run, state: State) -> int:
    """Cross `state` with one new placement after another while that helps and there is time.

    Returns the number of mates; none where candidates have no places along a road.
    """
    place = number_places(problem)
    if place is None or problem.constraints.budget < 2:
        return 0
    best, score = state.selected, state.score
    mates = failed = 0
    while failed < PATIENCE and not run.out_of_time():
        run.progress(f"{mates} placements crossed, score {score:.6g}", None)
        mate = new_placement(problem, run, place)
        mates, failed = mates + 1, failed + 1
        found, reached = better_of_both(problem, run, place, best, mate)
        if reached > score + MARGIN * abs(score):
            best, score, failed = found, reached, 0
            run.incumbent = best
    _settle(problem, run, state, place, best)
    return mates


def meet(problem: Problem, run: Run, state: State, other: list[int]) -> None:
    """Cross `state` with the placement `other`, either way, and keep the better."""
    place = number_places(problem)
    if place is not None and sorted(other) != sorted(state.selected):
        score = state.score
        best, reached = better_of_both(problem, run, place, state.selected, other)
        if reached > score + MARGIN * abs(score):
            _settle(problem, run, state, place, best)


def better_of_both(
    problem: Problem, run: Run, place: IntArray, one: list[int], other: list[int]
) -> tuple[list[int], float]:
    """Return the better of `one` with stretches of `other` and `other` with stretches of `one`."""
    ways = (cross(problem, run, place, a, b) for a, b in ((one, other), (other, one)))
    return max(ways, key=lambda found: found[1])


def _settle(problem: Problem, run: Run, state: State, place: IntArray, best: list[int]) -> None:
    """Make `state` hold `best` and let all cameras settle."""
    kicks = Kicks(problem, run, state, place)
    kicks.become(best)
    kicks.settle(kicks.movable())


def new_placement(problem: Problem, run: Run, place: IntArray) -> list[int]:
    """Put a camera somewhere in each of k equal parts of the road and let all settle."""
    constraints = problem.constraints
    state = problem.objective.state(np.unique(constraints.required))
    parts = constraints.budget - len(state.selected)
    spots = (np.arange(parts) + run.rng.uniform(size=parts)) * (place.max() + 1) / max(parts, 1)
    for spot in spots:
        candidates = addable_near(problem, state.selected, place, int(spot), 1)
        if candidates.size:
            state.add(int(candidates[np.argmax(state.gains(candidates))]))
    kicks = Kicks(problem, run, state, place)
    kicks.settle(kicks.movable())
    return state.selected


def cross(
    problem: Problem, run: Run, place: IntArray, one: list[int], other: list[int]
) -> tuple[list[int], float]:
    """Take stretches of `other` into `one` as long as that helps; return it and its score.

    Both are placements; shorter stretches are tried first. None is left that would help, unless
    time is up.
    """
    objective = problem.objective
    sign = 1.0 if objective.maximise else -1.0
    score = sign * objective.value(np.array(sorted(one), dtype=np.int64))
    tried: set[tuple[frozenset[int], frozenset[int]]] = set()
    while True:
        for out, into in stretches(place, one, other):
            if run.out_of_time():
                return one, score
            if (out, into) in tried:
                continue
            tried.add((out, into))
            mixed = sorted((set(one) - out) | into)
            if len(mixed) != len(one) or problem.constraints.violations(mixed):
                continue
            reached = sign * objective.value(np.array(mixed, dtype=np.int64))
            if reached > score + MARGIN * abs(score):
                one, score = mixed, reached
                tried.clear()
                break
        else:
            return one, score


def stretches(
    place: IntArray, one: list[int], other: list[int]
) -> list[tuple[frozenset[int], frozenset[int]]]:
    """List what stands in stretches that hold equally many of both, where it differs.

    The shortest come first, then those nearer to the road's start.
    """
    mine, theirs = (np.array(sorted(s, key=lambda i: (place[i], i))) for s in (one, other))
    ends = np.unique(np.concatenate([place[mine], place[theirs], [-1]])) + 1
    a, b = (np.searchsorted(place[s], ends) for s in (mine, theirs))
    found = []
    for u in range(ends.size - 1):
        for v in range(u + 1, ends.size):
            size = int(a[v] - a[u])
            if size > LONGEST:
                break
            if size == b[v] - b[u]:
                out = frozenset(mine[a[u] : a[v]].tolist())
                into = frozenset(theirs[b[u] : b[v]].tolist())
                if out != into:
                    found.append((size, out, into))
    found.sort(key=lambda entry: entry[0])
    return list(dict.fromkeys((out, into) for _, out, into in found))
