"""Where branch and cut begins: the best that greedy, swaps and, under money, kicks find."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.geometry import IntArray
from placement.bounds.cuttable import Cuttable
from placement.objectives.coverage import Coverage
from placement.objectives.localisation import Localisation
from placement.problem import Problem, Run
from placement.solvers.exchange import polish
from placement.solvers.greedy import climb
from placement.solvers.search import solve_search


def first_placement(problem: Problem, objective: Cuttable, run: Run) -> IntArray:
    """Return what greedy and swaps find; for `coverage` by several cameras, by way of shares."""
    # Under money or separation swaps alone are 1 % short.
    if isinstance(objective, Localisation) and problem.constraints.beyond_matroid():
        return np.array(solve_search(problem, run).selected, dtype=np.int64)
    easy = problem
    if isinstance(objective, Coverage) and not objective.submodular:
        shared = Coverage(objective.information, objective.times, objective.weights, partial=True)
        easy = replace(problem, objective=shared)
    state, _, _ = climb(easy, run)
    if easy is not problem:
        polish(easy, run, state)
        state = objective.state(np.array(state.selected, dtype=np.int64))
    polish(problem, run, state)
    return np.array(state.selected, dtype=np.int64)
