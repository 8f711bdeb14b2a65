"""The baseline below which no method may fall: a placement drawn at random."""

from __future__ import annotations

import numpy as np

from placement.problem import Problem, Run
from placement.solution import Proposal

_DRAWS = 20  # placements behind the mean and spread in the stats


def solve_random(problem: Problem, run: Run) -> Proposal:
    """Return the first placement drawn; `stats` tell mean, least and greatest of twenty.

    One draw is what “at random” means to whoever compares with it; the twenty say how much luck
    it had.
    """
    first = draw_placement(problem, run.rng)
    run.incumbent = first
    values = [problem.objective.value(np.array(first, dtype=np.int64))]
    while len(values) < _DRAWS and not run.out_of_time():
        placement = draw_placement(problem, run.rng)
        values.append(problem.objective.value(np.array(placement, dtype=np.int64)))
    return Proposal(
        first,
        stats={
            "draws": len(values),
            "mean_value": float(np.mean(values)),
            "least_value": float(np.min(values)),
            "greatest_value": float(np.max(values)),
        },
    )


def draw_placement(problem: Problem, rng: np.random.Generator) -> list[int]:
    """Draw candidates one after the other, each of those that may still join alike, to the budget.

    Required candidates come first. The distribution is that of this procedure, not uniform over
    placements: under one-per-mount a mount with more poses is drawn more often.
    """
    constraints = problem.constraints
    selected = [int(i) for i in np.unique(constraints.required)]
    free = constraints.addable(np.array(selected, dtype=np.int64))
    for candidate in rng.permutation(np.flatnonzero(free)):
        if free[candidate]:
            selected.append(int(candidate))
            free = constraints.addable(np.array(selected, dtype=np.int64))
            if not free.any():
                break
    return selected
