"""First-order bounds on `entropy` for all budgets at once: the tables of the chain hold them all.

The chain itself (θ = 1) serves small budgets, whose cameras stand far apart; with a share of the
relaxation's optimum for a quarter of the greatest budget it serves those between; the relaxation
of each serves the greatest.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.geometry import FloatArray
from placement.bounds.concave import best_fraction
from placement.bounds.matroid import root_choice
from placement.objectives.entropy import Entropy
from placement.problem import Problem, Run
from placement.tempered.background import background_of, chains_of, stand_in
from placement.tempered.bound import Tempered
from placement.tempered.dominance import undominated
from placement.tempered.line import make_line
from placement.tempered.paths import OutOfTimeError

SHARES = (1.0, 0.85)
MIDDLE = 0.25  # of the greatest budget, for the background
MOST_CANDIDATES = 11_000  # half a gigabyte of gains


def chain_bounds(problem: Problem, objective: Entropy, run: Run) -> FloatArray:
    """Return a bound on the score for each budget 0 … k of the problem, (k + 1,); ∞ where none."""
    constraints = problem.constraints
    k = constraints.budget
    best = np.full(k + 1, np.inf)
    seeing = np.zeros(constraints.n, dtype=np.bool_)
    for drive in objective.drives:
        seeing |= np.diff(drive.information.indptr) > 0
    seeing[constraints.required] = True
    candidates = np.flatnonzero(undominated(objective, constraints).allowed & seeing)
    if k < 1 or not candidates.size or candidates.size > MOST_CANDIDATES:
        return best
    middle = replace(constraints, budget=max(int(MIDDLE * k), constraints.required.size, 1))
    white = stand_in(objective)
    y = best_fraction(white, root_choice(middle), run, tolerance=1e-3).x
    background = chains_of(objective, y) or list(background_of(white, y))
    line = make_line(objective, constraints, candidates)
    try:
        for share in SHARES:
            run.progress(f"all budgets by the tempered chain, share {share:g}", None)
            chain = Tempered(objective, line, k, share, background, run)
            best = np.minimum(best, chain.bounds())
    except OutOfTimeError:
        pass
    return best
