"""The dissertation's two stages: a cheap score picks poses, the real objective picks cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.problem import Problem, Run
from placement.solution import Proposal, Status
from placement.solvers.exchange import polish
from placement.solvers.greedy import climb

POSES_PER_MOUNT = 3


def solve_cascade(problem: Problem, run: Run) -> Proposal:
    """Keep each mount's three best poses by the cheap score; choose among them by exchange.

    The cheap score is `problem.cheap_scores` (`kalman_gain` on a road), or where there is none
    the gain over the empty placement. Required poses stay whatever their score. No bound: the
    best placement may need a pose the cheap score dismissed.
    """
    scores = (
        problem.objective.state().gains()
        if problem.cheap_scores is None
        else problem.cheap_scores()
    )
    kept = best_poses(problem, scores)
    dismissed = np.setdiff1d(np.arange(problem.constraints.n), kept)
    forbidden = np.setdiff1d(
        np.union1d(problem.constraints.forbidden, dismissed), problem.constraints.required
    )
    small = replace(problem, constraints=replace(problem.constraints, forbidden=forbidden))
    # A run of its own: the bound greedy proves there holds for the poses kept, not for all.
    inner = Run(run.rng, run.deadline, run.progress)
    try:
        state, _, finished = climb(small, inner)
        swaps, settled = polish(small, inner, state)
    finally:
        run.incumbent = inner.incumbent
    return Proposal(
        state.selected,
        None,
        Status.FEASIBLE if finished and settled else Status.TIME_LIMIT,
        {"poses_kept": len(kept), "swaps": swaps},
    )


def best_poses(problem: Problem, scores: FloatArray) -> IntArray:
    """Return the candidates, sorted, that are among the POSES_PER_MOUNT best of their mount.

    A mount is a group; a candidate without one is a mount by itself. Ties go to the lower index.
    """
    usable = np.flatnonzero(problem.constraints.usable())
    group = problem.constraints.group[usable]
    mount = np.where(group >= 0, group, -1 - usable)
    order = np.lexsort((usable, -scores[usable], mount))
    _, start, count = np.unique(mount[order], return_index=True, return_counts=True)
    rank = np.arange(len(order)) - np.repeat(start, count)
    return np.sort(usable[order[rank < POSES_PER_MOUNT]])
