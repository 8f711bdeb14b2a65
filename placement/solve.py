"""The one verb: solve a placement problem by a named method, and believe nothing it says.

A method proposes a placement and perhaps a bound. `solve` owns everything else: the checks, the
clock, recomputing the value from the selected set, rounding the bound outwards, comparing the
two, and the status. So every method, ours or a rival's, is measured by the same hand.
"""

from __future__ import annotations

import importlib
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np

from models.geometry import IntArray
from placement.cluster import Work
from placement.constraints import Infeasible
from placement.interrupts import asked_to_stop, stop_on_request
from placement.objectives.base import Demanding
from placement.problem import Problem, Run
from placement.solution import OPTIMAL_GAP, Proposal, Solution, Status

# Relative error allowed for in a value summed in float64 over a path of a few thousand samples
# (pairwise sums: about 12 ulp; the log dets under the sum: a few more), and again in its bound.
ROUNDING = 1e-12
# A bound this far (relative) below a value contradicts it; nearer, the two are the same number
# computed in different orders. Near-singular 2×2 blocks lose about half the digits.
CONTRADICTION = 1e-9


@dataclass(frozen=True, slots=True)
class Method:
    """Say where a method lives (`module:function`), what it does, and whether it proves a bound.

    Every method keeps the budget, groups, required and forbidden candidates; `keeps` names the
    other constraints that it can keep, and `solve` refuses it where it cannot.
    """

    target: str
    summary: str
    proves_bound: bool
    keeps: tuple[str, ...] = ()

    def load(self) -> Callable[[Problem, Run], Proposal]:
        """Import the method: only now, so that no command pays for what it does not use."""
        module, function = self.target.split(":")
        solver: Callable[[Problem, Run], Proposal] = getattr(
            importlib.import_module(module), function
        )
        return solver


_ALL = ("budget.money", "budget.separation_m")
METHODS: dict[str, Method] = {
    "auto": Method(
        "placement.solvers.auto:solve_auto",
        "picks for you what proves most: `chain`, `tempered`, `diagram`, … after a search",
        proves_bound=True,
        keeps=_ALL,
    ),
    "greedy": Method(
        "placement.solvers.greedy:solve_greedy",
        "add the best camera until the budget is spent; bound from diminishing returns",
        proves_bound=True,
        keeps=_ALL,
    ),
    "exchange": Method(
        "placement.solvers.exchange:solve_exchange",
        "greedy, then swap cameras while that helps; greedy's bound",
        proves_bound=True,
        keeps=_ALL,
    ),
    "search": Method(
        "placement.solvers.search:solve_search",
        "exchange from two starts, then rearrange stretches of road while that helps",
        proves_bound=True,
        keeps=_ALL,
    ),
    "relaxation": Method(
        "placement.solvers.relaxation:solve_relaxation",
        "the concave relaxation, rounded; bound from its dual certificate",
        proves_bound=True,
        keeps=_ALL,
    ),
    "mip": Method(
        "placement.solvers.mip:solve_mip",
        "mixed-integer program with submodular and tangent cuts; optimal given time",
        proves_bound=True,
        keeps=_ALL,
    ),
    "branch": Method(
        "placement.solvers.branch:solve_branch",
        "dense designs: branch-and-bound on the concave relaxation; optimal given time",
        proves_bound=True,
        keeps=("budget.money",),
    ),
    "tempered": Method(
        "placement.solvers.tempered:solve_tempered",
        "entropy: relaxation, tempered chain bound along the road, best-first search",
        proves_bound=True,
        keeps=_ALL,
    ),
    "hill-climb": Method(
        "placement.solvers.hill_climb:solve_hill_climb",
        "from ten random placements, improve one pose at a time (as in 2018)",
        proves_bound=False,
        keeps=_ALL,
    ),
    "cascade": Method(
        "placement.solvers.cascade:solve_cascade",
        "a cheap score keeps three poses a mount, exchange chooses among them (as in 2018)",
        proves_bound=False,
        keeps=_ALL,
    ),
    "chain": Method(
        "placement.solvers.chain:solve_chain",
        "chain bound along the road, elimination, exact search by labels",
        proves_bound=True,
    ),
    "regions": Method(
        "placement.solvers.regions:solve_regions",
        "localisation on millions of poses: lazy greedy, swaps, cuts at one price a camera",
        proves_bound=True,
    ),
    "diagram": Method(
        "placement.solvers.diagram:solve_diagram",
        "trace: relaxed decision diagram along the road, refined until the bound closes",
        proves_bound=True,
        keeps=_ALL,
    ),
    "tolerance": Method(
        "placement.solvers.tolerance:solve_tolerance",
        "tolerance: built along the road by a beam, proven by counting labels from below",
        proves_bound=True,
        keeps=_ALL,
    ),
    "uniform": Method(
        "placement.solvers.uniform:solve_uniform",
        "baseline: equal spacing along the road, the best pose at each place",
        proves_bound=False,
        keeps=_ALL,
    ),
    "random": Method(
        "placement.solvers.random_choice:solve_random",
        "baseline: one placement drawn at random",
        proves_bound=False,
        keeps=_ALL,
    ),
}


def solve(
    problem: Problem,
    method: str = "auto",
    *,
    time_limit_s: float = math.inf,
    seed: int = 0,
    progress: Callable[[str, float | None], None] | None = None,
    work: Work | None = None,
) -> Solution:
    """Choose candidates for `problem` by `method` within `time_limit_s` seconds.

    The value is recomputed from the selected set and the bound rounded outwards; the status says
    `optimal` only if the two then agree to 1e-6 relative. A placement that breaks a constraint,
    or a bound that its own placement beats, is `numerical_error`; Ctrl-C gives the best
    placement so far with status `time_limit`; contradicting constraints met on the way give
    `infeasible`, an empty selection and the value NaN.

    `progress` is called with a line of text and the share done, where known. `work` says where the
    parts of a method that has any run (`placement.cluster`); the solution is the same.

    Raises:
        ValueError: for an unknown method, one that cannot keep the problem's constraints, a
            negative or NaN time limit, a negative seed.
    """
    check_call(method, time_limit_s, seed)
    solver_of = METHODS[method]
    _refuse_unkept(method, problem)
    start = time.monotonic()
    run = Run(np.random.default_rng(seed), deadline=start + time_limit_s)
    if progress is not None:
        run.progress = progress
    if work is not None:
        run.work = work
    with stop_on_request():
        proposal = _propose(solver_of, problem, run)
    return certified(problem, proposal, run, method, time.monotonic() - start, seed)


def certified(
    problem: Problem, proposal: Proposal, run: Run, method: str, seconds: float, seed: int
) -> Solution:
    """Recompute what a proposal claims and say what is left of it."""
    selected, value, bound, status, stats = _judge(problem, proposal, run)
    objective = problem.objective
    return Solution(
        objective=objective.name,
        unit=objective.unit,
        maximise=objective.maximise,
        method=method,
        status=status,
        selected=selected,
        value=value,
        bound=bound,
        seconds=seconds,
        seed=seed,
        stats=stats,
    )


def check_call(method: str, time_limit_s: float, seed: int) -> None:
    """Refuse what no problem is needed to refuse, as `solve` does: before an hour of assembling."""
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if math.isnan(time_limit_s) or time_limit_s < 0.0:
        raise ValueError(f"time_limit_s must be at least 0, got {time_limit_s}")
    if seed < 0:
        raise ValueError(f"seed must be at least 0, got {seed}")


def _refuse_unkept(name: str, problem: Problem) -> None:
    """Refuse, by name, a method that would ignore a constraint."""
    asked = problem.constraints.beyond_matroid()
    unkept = [constraint for constraint in asked if constraint not in METHODS[name].keeps]
    if unkept:
        able = [other for other, method in METHODS.items() if set(asked) <= set(method.keeps)]
        raise ValueError(
            f"method {name} cannot keep {' and '.join(unkept)}; these can: {', '.join(able)}"
        )


def _propose(method: Method, problem: Problem, run: Run) -> Proposal:
    """Run the method; turn what stops it into a proposal with the best placement so far."""
    try:
        proposal = method.load()(problem, run)
    except KeyboardInterrupt:
        status, stats = Status.TIME_LIMIT, {"stopped_by": "interrupt"}
    except Infeasible as error:
        return Proposal([], None, Status.INFEASIBLE, {"reason": str(error)})
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        status, stats = Status.NUMERICAL_ERROR, {"error": f"{type(error).__name__}: {error}"}
    else:
        if asked_to_stop() and proposal.status is not Status.INFEASIBLE:
            stats = {**proposal.stats, "stopped_by": "interrupt"}
            return replace(proposal, status=Status.TIME_LIMIT, stats=stats)
        return proposal
    return Proposal(_incumbent(problem, run), run.score_bound, status, stats)


def _incumbent(problem: Problem, run: Run) -> list[int]:
    """Return the run's best placement so far; the required poses alone before there is one."""
    if run.incumbent is not None and not problem.constraints.violations(run.incumbent):
        return list(run.incumbent)
    return [int(i) for i in np.unique(problem.constraints.required)]


def _judge(
    problem: Problem, proposal: Proposal, run: Run
) -> tuple[tuple[int, ...], float, float | None, Status, dict[str, Any]]:
    """Recompute what a proposal claims: (selected, value, bound, status, stats)."""
    stats = dict(proposal.stats)
    status = proposal.status
    if status is Status.INFEASIBLE:
        return (), math.nan, None, status, stats
    broken = problem.constraints.violations(proposal.selected)
    chosen = _incumbent(problem, run) if broken else proposal.selected
    if broken:
        status = Status.NUMERICAL_ERROR
        stats["error"] = "; ".join(broken)
    selected = tuple(sorted(int(i) for i in chosen))
    value = problem.objective.value(_indices(selected))
    if not math.isfinite(value):
        stats["error"] = f"the value of the placement is {value}"
        return selected, value, None, Status.NUMERICAL_ERROR, stats
    if isinstance(problem.objective, Demanding):
        short = problem.objective.shortfall(_indices(selected))
        if short is not None:
            reason = f"nothing in tolerance was found: {short}"
            return (), math.nan, None, Status.INFEASIBLE, {**stats, "reason": reason}
    sign = 1.0 if problem.objective.maximise else -1.0
    claims = [b for b in (proposal.score_bound, run.score_bound) if b is not None]
    score_bound = outwards(min(claims, default=None))
    if score_bound is not None and score_bound < sign * value:
        if score_bound < sign * value - CONTRADICTION * abs(value):
            stats["error"] = f"the placement's value {value!r} beats the bound {score_bound!r}"
            return selected, value, None, Status.NUMERICAL_ERROR, stats
        score_bound = sign * value
    bound = None if score_bound is None else sign * score_bound
    if not broken:
        status = _status(status, value, bound)
    return selected, value, bound, status, stats


def outwards(score_bound: float | None) -> float | None:
    """Round an upper bound on the score up by what float64 may have lost; None if it is no bound.

    An infinite or NaN bound proves nothing and becomes None.
    """
    if score_bound is None or not math.isfinite(score_bound):
        return None
    if score_bound == 0.0:  # sums of nothing are exact
        return 0.0
    return math.nextafter(score_bound + ROUNDING * abs(score_bound), math.inf)


def _status(claimed: Status, value: float, bound: float | None) -> Status:
    """Say `optimal` exactly if the gap says so; keep the other claims."""
    proven = bound is not None and abs(bound - value) <= OPTIMAL_GAP * abs(value)
    if proven:
        return Status.OPTIMAL
    return Status.FEASIBLE if claimed is Status.OPTIMAL else claimed


def _indices(selected: tuple[int, ...]) -> IntArray:
    return np.array(selected, dtype=np.int64)


class _Verb(ModuleType):
    """This module where `placement.solve` means it: once imported, it hides the function there."""

    def __call__(self, *arguments: Any, **options: Any) -> Solution:
        """Solve as `solve` does."""
        return solve(*arguments, **options)


sys.modules[__name__].__class__ = _Verb
