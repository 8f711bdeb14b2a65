"""The dissertation's optimiser: from random placements, nudge one camera at a time uphill."""

from __future__ import annotations

import numpy as np

from models.geometry import IntArray
from placement.objectives.base import State
from placement.problem import Problem, Run
from placement.solution import Proposal, Status
from placement.solvers.exchange import MARGIN
from placement.solvers.greedy import TIE
from placement.solvers.nearby import addable_near, number_places
from placement.solvers.random_choice import draw_placement

RESTARTS = 10
_NEIGHBOURS = 64  # drawn, where there is no road to say who is near


def solve_hill_climb(problem: Problem, run: Run) -> Proposal:
    """Climb from ten random placements and return the best summit; nothing is proven.

    A step gives one camera another pose at its place or at the next place along the road in
    either direction, on either side: the best of them, if it raises the score. Without a road
    each step tries 64 candidates at random.
    """
    place = number_places(problem)
    best_score = -np.inf
    summits: list[float] = []
    for _ in range(RESTARTS):
        state = problem.objective.state(np.array(draw_placement(problem, run.rng), dtype=np.int64))
        if run.incumbent is None:
            run.incumbent = state.selected
        finished = _climb(problem, run, state, place)
        score = state.score
        if score > best_score:
            best_score, run.incumbent = score, state.selected
        if not finished:
            break
        summits.append(score)
        run.progress(f"{len(summits)} summits, best score {best_score:.6g}", None)
    return Proposal(
        list(run.incumbent or []),
        None,
        Status.FEASIBLE if len(summits) == RESTARTS else Status.TIME_LIMIT,
        {"restarts": len(summits), "mean_score": float(np.mean(summits)) if summits else None},
    )


def _climb(problem: Problem, run: Run, state: State, place: IntArray | None) -> bool:
    """Move cameras in turn until none can be bettered; return False when out of time."""
    required = {int(i) for i in problem.constraints.required}
    unimproved = 0
    while True:
        movable = [i for i in state.selected if i not in required]
        if unimproved >= len(movable):
            return True
        if run.out_of_time():
            return False
        camera, before = movable[0], state.score
        state.remove(camera)
        candidates = _neighbours(problem, state, camera, place, run.rng)
        gains = state.gains(candidates)
        best = float(np.max(gains, initial=-np.inf))
        if best > before - state.score + MARGIN * abs(before):
            better = int(np.min(candidates[gains >= best - TIE * abs(best)]))
            state.add(better)
            # a gain may promise what rounding then takes: such steps could go round for ever
            if state.score > before + 0.5 * MARGIN * abs(before):
                unimproved = 0
                continue
            state.remove(better)
        state.add(camera)
        unimproved += 1


def _neighbours(
    problem: Problem, state: State, camera: int, place: IntArray | None, rng: np.random.Generator
) -> IntArray:
    """Return the candidates one step from `camera`, which has just left `state`."""
    if place is not None:
        return addable_near(problem, state.selected, place, int(place[camera]), 1)
    allowed = problem.constraints.addable(np.array(state.selected, dtype=np.int64))
    free = np.flatnonzero(allowed)
    return rng.choice(free, min(_NEIGHBOURS, len(free)), replace=False)
