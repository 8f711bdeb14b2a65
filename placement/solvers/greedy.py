"""Add the best camera until the budget is spent.

For a monotone submodular score under a budget this is within 1 − 1/e of the best placement, and
within 1/2 under one-per-mount (Nemhauser, Wolsey & Fisher 1978). Far better on real roads, and
each step also proves its own bound. Neither holds where the objective is not submodular (`trace`):
there the steps are the same and nothing is proven. Under a money budget it is run twice, by gain
and by gain a unit of money; the better of the two is within (1 − 1/e)/2 (`placement.guarantees`).
"""

from __future__ import annotations

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.bounds.linear import best_sum, most_sum
from placement.constraints import Constraints
from placement.guarantees import greedy_guarantee
from placement.objectives.base import State
from placement.problem import Problem, Run
from placement.solution import Proposal, Status

# Gains this near the best (relative) are one gain: mirrored candidates must not change places
# with rounding, so the lowest index among them wins.
TIE = 1e-9
_BATCH = 64  # candidates looked at again at a time
_POOL = 4096  # candidates that are looked at first, where there are many more
# A bound is a pass over all candidates. Where a bound a step would look at more than this many, it
# is made only every few steps, and at the last: a million candidates and a thousand cameras took
# 45 s of which bounds were two thirds.
_BOUND_WORK = 5_000_000


def solve_greedy(problem: Problem, run: Run) -> Proposal:
    """Place required cameras, then the best one at a time; bound the optimum at every step."""
    state, upper, finished = climb(problem, run)
    return Proposal(
        state.selected,
        run.score_bound,
        Status.FEASIBLE if finished else Status.TIME_LIMIT,
        {"gains_computed": upper.evaluations, **greedy_guarantee(problem, finished)},
    )


def climb(problem: Problem, run: Run) -> tuple[State, UpperGains, bool]:
    """Run greedy; return its state, what it knows about gains, and whether it had the time.

    Leaves the placement in `run.incumbent` and the best bound in `run.score_bound`. Where money
    is limited the better of greedy by gain and greedy by gain a unit of money is returned.
    """
    first = _climb(problem, run, None)
    if not problem.constraints.limits_money or not first[2]:
        return first
    # A run of its own: its placements are not the best so far until they are.
    aside = Run(run.rng, run.deadline, run.progress, score_bound=run.score_bound)
    second = _climb(problem, aside, per_money(problem.constraints))
    run.score_bound = aside.score_bound
    if second[0].score <= first[0].score:
        return first[0], first[1], second[2]
    run.incumbent = second[0].selected
    return second


def per_money(constraints: Constraints) -> FloatArray:
    """Return what to weigh gains by, (c,), to compare them by the money they cost."""
    if constraints.cost is None:
        return np.ones(constraints.n)
    free = 1e-12 * constraints.purse or 1.0  # what costs nothing is taken first
    return 1.0 / np.maximum(constraints.cost, free)


def _climb(
    problem: Problem, run: Run, per_gain: FloatArray | None
) -> tuple[State, UpperGains, bool]:
    """Run greedy by gain, or by gain times `per_gain` (c,)."""
    constraints = problem.constraints
    state = problem.objective.state()
    for candidate in np.unique(constraints.required):
        state.add(int(candidate))
    run.incumbent = state.selected
    upper = UpperGains(state, lazy=problem.objective.submodular, per_gain=per_gain)
    steps_a_bound = 1 + constraints.n * constraints.budget // _BOUND_WORK
    if problem.objective.submodular and run.out_of_time():
        tighten_bound(problem, run, upper)  # these gains are known: a bound, however short of time
    while not run.out_of_time():
        placed = len(state.selected)
        last = placed >= constraints.budget
        if problem.objective.submodular and (last or placed % steps_a_bound == 0):
            tighten_bound(problem, run, upper)
        best = upper.argmax(np.flatnonzero(constraints.addable(_array(state.selected))))
        if best is None:
            return state, upper, True
        state.add(best)
        upper.forget()
        run.incumbent = state.selected
        placed = len(state.selected)
        run.progress(f"greedy: {placed} of {constraints.budget}", placed / constraints.budget)
    return state, upper, False


def best_addition(problem: Problem, state: State) -> int | None:
    """Return the candidate that raises the score of `state` most, as `climb` would choose it.

    The lowest index wins a tie; None if no candidate may join, or none that may helps.
    """
    candidates = np.flatnonzero(problem.constraints.addable(_array(state.selected)))
    if not candidates.size:
        return None
    gains = state.gains(candidates)
    best = float(np.max(gains))
    return int(candidates[np.argmax(gains >= best * (1.0 - TIE))]) if best > 0.0 else None


def tighten_bound(problem: Problem, run: Run, upper: UpperGains) -> None:
    """Improve `run.score_bound` from the state S behind `upper`, for submodular scores.

    For every placement T: f(T) ≤ f(S ∪ T) ≤ f(S) + Σ_{j ∈ T} gain_j(S), and the right side is
    largest at the best sum of gains (Leskovec et al. 2007, with groups and required poses).
    S need not be a placement itself.
    """
    bound = upper.state.score + upper.best_sum(problem)
    run.score_bound = bound if run.score_bound is None else min(run.score_bound, bound)


class UpperGains:
    """Know an upper bound on every gain, and compute again only those that matter.

    Where the score is submodular a gain from a smaller placement bounds it from above (Minoux
    1978); elsewhere every gain is computed again after each change. After `forget` known gains
    are upper bounds; call it only once the state has grown, never when it has shrunk.
    """

    def __init__(self, state: State, *, lazy: bool, per_gain: FloatArray | None = None) -> None:
        """Start from all gains of `state`; `argmax` compares gains times `per_gain` (c,)."""
        self.state = state
        self.per_gain = per_gain
        self.lazy = lazy
        self.gains: FloatArray = state.gains().copy()
        self._fresh = np.ones(len(self.gains), dtype=np.bool_)
        self.evaluations = len(self.gains)
        self._pool: IntArray = np.empty(0, dtype=np.int64)
        self._outside = np.inf  # no candidate outside the pool gains more

    def forget(self) -> None:
        """Tell that the state has grown."""
        self._fresh[:] = False
        self.gains[self.state.selected] = 0.0
        self._fresh[self.state.selected] = True

    def refresh(self, candidates: IntArray) -> None:
        """Compute the gains of those `candidates` that are only bounded."""
        rows = candidates[~self._fresh[candidates]]
        if rows.size:
            self.gains[rows] = self.state.gains(rows)
            self._fresh[rows] = True
            self.evaluations += rows.size

    def argmax(self, candidates: IntArray) -> int | None:
        """Return the candidate of greatest gain, the lowest index on a tie; None if none gains.

        Of very many candidates a pool of the most promising is looked at first: known gains only
        fall, so who beats all that was known outside when the pool was made need not look there.
        """
        if not self.lazy:
            self.refresh(candidates)
        if self.lazy and candidates.size > 4 * _POOL:
            for _ in range(2):
                place = np.minimum(np.searchsorted(candidates, self._pool), candidates.size - 1)
                best = self._argmax(self._pool[candidates[place] == self._pool])
                if best is not None and self._worth(best) * (1.0 - TIE) > self._outside:
                    return best
                self._fill_pool()
        return self._argmax(candidates)

    def _worth(self, candidate: int) -> float:
        per_gain = 1.0 if self.per_gain is None else self.per_gain[candidate]
        return float(self.gains[candidate] * per_gain)

    def _fill_pool(self) -> None:
        worth = self.gains if self.per_gain is None else self.gains * self.per_gain
        order = np.argpartition(-worth, _POOL)
        self._pool = np.sort(order[:_POOL])
        self._outside = float(np.max(worth[order[_POOL:]]))

    def _argmax(self, candidates: IntArray) -> int | None:
        while candidates.size:
            gains = self.gains[candidates]
            if self.per_gain is not None:
                gains = gains * self.per_gain[candidates]
            fresh = self._fresh[candidates]
            best = float(np.max(gains[fresh], initial=0.0))
            rivals = np.flatnonzero(~fresh & (gains >= best * (1.0 - TIE)) & (gains > 0.0))
            if rivals.size:
                if rivals.size > _BATCH:
                    rivals = rivals[np.argpartition(-gains[rivals], _BATCH)[:_BATCH]]
                self.refresh(candidates[rivals])
                continue
            if best <= 0.0:
                return None
            return int(np.min(candidates[fresh & (gains >= best * (1.0 - TIE))]))
        return None

    def best_sum(self, problem: Problem) -> float:
        """Return the greatest Σ_{j ∈ T} gain_j over placements T; above it where money is short."""
        if problem.constraints.limits_money:
            self.refresh(np.flatnonzero(problem.constraints.usable()))
            return most_sum(problem.constraints, self.gains)
        while True:
            selected, total = best_sum(problem.constraints, self.gains)
            if self._fresh[selected].all():
                return total
            # T itself is a placement, so nothing below its least true gain is of interest, and
            # all above may be: two or three rounds, where T alone would take a hundred.
            self.refresh(selected)
            least = np.min(self.gains[selected], where=self.gains[selected] > 0.0, initial=np.inf)
            self.refresh(np.flatnonzero(self.gains >= least))


def _array(selected: list[int]) -> IntArray:
    return np.array(selected, dtype=np.int64)
