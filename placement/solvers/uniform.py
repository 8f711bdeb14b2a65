"""The baseline a planner would draw: cameras at equal spacing, each with its best pose."""

from __future__ import annotations

import numpy as np

from models.geometry import FloatArray
from placement.bounds.linear import best_sum
from placement.objectives.tolerance import Tolerance
from placement.objectives.trace import Trace
from placement.problem import Problem, Run
from placement.solution import Proposal, Status
from placement.solvers.greedy import TIE


def solve_uniform(problem: Problem, run: Run) -> Proposal:
    """Spread the budget over the path: camera j of k aims for (j + ½)/k of its length.

    Each takes the free mount nearest along the path to its place (either side, the earlier on a
    tie) and there the pose with the greatest gain over the empty placement. Required cameras
    stand in for the places nearest to them. Where money or separation leave no room for all, it
    starts again with one camera fewer. Nothing is proven, nothing is optimised jointly. For
    `tolerance` it takes the fewest that are in tolerance.

    Raises:
        ValueError: where the candidates have no place along a road.
    """
    if problem.arc_length_m is None or problem.path_length_m is None:
        raise ValueError(
            "method 'uniform' needs candidates along a road, and this problem has none"
        )
    if isinstance(problem.objective, Tolerance):
        return _fewest(problem, problem.objective, run)
    constraints = problem.constraints
    alone = problem.objective.state().gains()
    fitting, _ = best_sum(constraints, np.ones(constraints.n))  # a budget may exceed the mounts
    required = [int(i) for i in np.unique(constraints.required)]
    run.incumbent = list(required)
    selected = required
    for k in range(fitting.size, len(required) - 1, -1):
        selected = _spread(problem, run, alone, k)
        if run.out_of_time() or len(selected) == k or not constraints.beyond_matroid():
            break
    run.incumbent = list(selected)
    return Proposal(selected, None, Status.TIME_LIMIT if run.out_of_time() else Status.FEASIBLE)


def _fewest(problem: Problem, objective: Tolerance, run: Run) -> Proposal:
    """Return the first count whose equal spacing is in tolerance; there may be none.

    The best pose at a place is the one that alone lowers the mean lateral variance most.
    """
    alone = Trace(objective.drives, "lateral").state().gains()
    required = [int(i) for i in np.unique(problem.constraints.required)]
    for k in range(len(required), problem.constraints.budget + 1):
        selected = _spread(problem, run, alone, k)
        if run.out_of_time() or len(selected) < k:
            break
        if objective.feasible(np.array(selected, dtype=np.int64)):
            run.incumbent = selected
            return Proposal(selected)
        run.progress(f"{k} cameras are too few", k / problem.constraints.budget)
    return Proposal(required, None, Status.TIME_LIMIT if run.out_of_time() else Status.FEASIBLE)


def _spread(problem: Problem, run: Run, alone: FloatArray, k: int) -> list[int]:
    """Place k cameras at equal spacing, or fewer where the rest find no mount or no time."""
    constraints = problem.constraints
    s = np.asarray(problem.arc_length_m)
    selected = [int(i) for i in np.unique(constraints.required)]
    places = (np.arange(k) + 0.5) / max(k, 1) * float(problem.path_length_m or 0.0)
    for candidate in selected:
        places = np.delete(places, np.argmin(np.abs(places - s[candidate])))
    allowed = constraints.addable(np.array(selected, dtype=np.int64))
    simple = not constraints.beyond_matroid()
    for place in places:
        if not simple:
            allowed = constraints.addable(np.array(selected, dtype=np.int64))
        free = np.flatnonzero(allowed)
        if run.out_of_time() or not free.size:
            break
        distance = np.abs(s[free] - place)
        at_mount = free[s[free] == s[free][np.argmin(distance)]]
        best = np.max(alone[at_mount])
        chosen = int(at_mount[np.argmax(alone[at_mount] >= best - TIE * abs(best))])
        selected.append(chosen)
        allowed[chosen] = False
        if constraints.group[chosen] >= 0:
            allowed[constraints.group == constraints.group[chosen]] = False
    return selected
