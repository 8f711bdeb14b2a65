"""Pick a method for the user: proven where that can be had, always with the best placement found.

The chain bound and its labels prove optimality for `localisation` (on the Norisring in half a
second, where the integer program stops 0.2 % short after a minute) and the tempered chain for
`entropy`; both are anytime. A city's `localisation` is cut into regions instead. `trace` is
searched and then bounded by the diagram along the road or the concave relaxation, whichever says
more. For the other objectives the search along the road gives the best placements, and greedy's
bound comes with them where the objective is submodular, else that of the concave relaxation.
"""

from __future__ import annotations

import importlib
import math
import time
from dataclasses import replace
from typing import Any

import numpy as np

from placement.bounds.concave import best_fraction
from placement.bounds.matroid import root_choice
from placement.objectives.base import Relaxable
from placement.objectives.coverage import Coverage
from placement.objectives.dense_design import DenseDesign
from placement.objectives.entropy import Entropy
from placement.objectives.localisation import Localisation
from placement.objectives.tolerance import Tolerance
from placement.objectives.trace import Trace
from placement.problem import Problem, Run
from placement.solution import OPTIMAL_GAP, Proposal, Status

CITY = 100_000  # candidates of `localisation` from which on regions prove more than the chain does
BOUND_S = 10.0  # for a bound that no method gives, where there is no time limit


def solve_auto(problem: Problem, run: Run) -> Proposal:
    """Solve by what can prove most, else by `search`: see `stats["chosen"]`."""
    chosen = "chain" if isinstance(problem.objective, Localisation) else "search"
    if isinstance(problem.objective, Entropy):
        chosen = "tempered"
    if isinstance(problem.objective, Trace):
        chosen = "trace_proof"
    if isinstance(problem.objective, Tolerance):
        chosen = "tolerance"
    if chosen == "chain" and problem.constraints.beyond_matroid():
        chosen = "mip"  # the chain knows neither money nor separation
    if isinstance(problem.objective, Localisation) and problem.constraints.n > CITY:
        chosen = "greedy" if problem.constraints.beyond_matroid() else "regions"
    if isinstance(problem.objective, Coverage):
        chosen = "mip"
    if isinstance(problem.objective, DenseDesign) and not problem.constraints.separation_m:
        chosen = "branch"
    module = importlib.import_module(f"placement.solvers.{chosen}")
    proposal: Proposal = getattr(module, f"solve_{chosen}")(problem, run)
    stats = {**proposal.stats, "chosen": chosen}
    if chosen == "chain" and proposal.status is Status.FEASIBLE and not _proven(problem, run):
        # all labels were looked at: what is open lies in the seam of a closed road, or in memory
        proposal, stats = _second_opinion(problem, run, proposal, stats)
    if run.score_bound is None and proposal.score_bound is None:
        stats |= _relaxed_bound(problem, run, proposal.selected)
    return replace(proposal, stats=stats)


def _proven(problem: Problem, run: Run) -> bool:
    """Whether the bound leaves nothing to be found above the incumbent."""
    if run.score_bound is None or run.incumbent is None or run.out_of_time():
        return True  # or else there is no time to look
    score = problem.objective.value(np.array(run.incumbent, dtype=np.int64))
    return run.score_bound - score <= 0.5 * OPTIMAL_GAP * abs(score)


def _second_opinion(
    problem: Problem, run: Run, first: Proposal, stats: dict[str, Any]
) -> tuple[Proposal, dict[str, Any]]:
    """Go on by branch and cut, which knows nothing of seams; keep the better placement."""
    from placement.solvers.mip import solve_mip

    limit = run.deadline if math.isfinite(run.deadline) else time.monotonic() + BOUND_S
    inner = Run(run.rng, limit, run.progress, run.incumbent, run.score_bound)
    second = solve_mip(problem, inner)
    value = problem.objective.value
    best = max((first, second), key=lambda p: value(np.array(p.selected, dtype=np.int64)))
    run.incumbent = best.selected
    if inner.score_bound is not None and run.score_bound is not None:
        if inner.score_bound < run.score_bound:
            stats = {**stats, "bound_from": "cuts, after the chain"}
        run.score_bound = min(run.score_bound, inner.score_bound)
    return replace(best, score_bound=run.score_bound, status=second.status), stats


def _relaxed_bound(problem: Problem, run: Run, selected: list[int]) -> dict[str, str]:
    """Bound what no method has bounded, if the objective extends concavely; say how."""
    if not isinstance(problem.objective, Relaxable):
        return {}
    limit = run.deadline if math.isfinite(run.deadline) else time.monotonic() + BOUND_S
    fraction = best_fraction(
        problem.objective,
        root_choice(problem.constraints),
        Run(run.rng, limit, run.progress),
        start=np.array(selected, dtype=np.int64),
        tolerance=1e-3,
    )
    run.score_bound = fraction.bound
    return {"bound_from": "concave relaxation"}
