"""Pick a method for the user: proven where that can be had, always with the best placement found.

The chain bound and its labels prove optimality for `localisation` (on the Norisring in half a
second, where the integer program stops 0.2 % short after a minute) and the tempered chain for
`entropy`; both are anytime. For the other objectives the search along the road gives the best
placements, and greedy's bound comes with them where the objective is submodular.
"""

from __future__ import annotations

import importlib
from dataclasses import replace

from placement.objectives.coverage import Coverage
from placement.objectives.dense_design import DenseDesign
from placement.objectives.entropy import Entropy
from placement.objectives.localisation import Localisation
from placement.objectives.tolerance import Tolerance
from placement.problem import Problem, Run
from placement.solution import Proposal


def solve_auto(problem: Problem, run: Run) -> Proposal:
    """Solve by `chain` or `tempered` where they apply, else by `search`: see `stats["chosen"]`."""
    chosen = "chain" if isinstance(problem.objective, Localisation) else "search"
    if isinstance(problem.objective, Entropy):
        chosen = "tempered"
    if isinstance(problem.objective, Tolerance):
        chosen = "tolerance"
    if chosen == "chain" and problem.constraints.beyond_matroid():
        chosen = "mip"  # the chain knows neither money nor separation
    if isinstance(problem.objective, Coverage):
        chosen = "mip"
    if isinstance(problem.objective, DenseDesign) and not problem.constraints.separation_m:
        chosen = "branch"
    module = importlib.import_module(f"placement.solvers.{chosen}")
    proposal: Proposal = getattr(module, f"solve_{chosen}")(problem, run)
    return replace(proposal, stats={**proposal.stats, "chosen": chosen})
