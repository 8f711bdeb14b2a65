"""The textbook relaxation: choose fractions of cameras, then round.

Replace x ∈ {0, 1}ᶜ by 0 ≤ x ≤ 1 and the score is concave, so a conic solver finds the best
fractional choice (Joshi & Boyd 2009). Its bound is ours, not the solver's: the tangent at
the x it returns, maximised exactly over placements (`placement.bounds`). On weakly coupled roads
the bound is 38–186 % off, because a tenth of a camera already earns most of a logarithm.

The x is rounded by systematic sampling, which keeps the budget and the groups and gives each
candidate its own probability; the best of several draws is polished by swaps.
"""

from __future__ import annotations

import importlib
import threading
import warnings
from typing import Any

import numpy as np
from scipy import sparse

from models.geometry import FloatArray, IntArray
from placement.bounds.linear import best_sum
from placement.bounds.matroid import root_choice
from placement.bounds.tangent import tangent_bound
from placement.constraints import Constraints
from placement.objectives.base import Relaxable
from placement.objectives.localisation import Localisation
from placement.problem import Problem, Run
from placement.solution import Proposal, Status
from placement.solvers.exchange import polish
from placement.solvers.greedy import climb

DRAWS = 20
CONDITIONAL_STEPS = 300
WALL = 1e-6
LOOK_S = 0.02  # how often to look whether the conic solver is done


def solve_relaxation(problem: Problem, run: Run) -> Proposal:
    """Solve the concave relaxation, certify its bound, round it, and polish by swaps.

    `localisation` is modelled in cvxpy and solved by Clarabel; other concave extensions, and
    whatever the conic solver fails on, take conditional-gradient steps (Frank & Wolfe 1956).

    Raises:
        ValueError: if the objective has no concave extension.
    """
    objective, constraints = problem.objective, problem.constraints
    if not isinstance(objective, Relaxable):
        raise ValueError(
            f"method relaxation needs an objective with a concave relaxation, got {objective.name}"
        )
    # Something to return if time ends before anything is rounded; no part of the method else.
    aside = Run(run.rng, run.deadline, run.progress)
    greedy = climb(problem, aside)[0].selected
    run.incumbent = greedy
    run.progress("solving the concave relaxation", None)
    x, stats = _conic_choice(objective, constraints, run)
    if x is None:
        x = conditional_gradient(objective, constraints, run)
        stats["relaxation"] = "conditional gradient"
    run.score_bound = tangent_bound(objective, constraints, x)
    stats["fractional"] = int(np.sum((x > 1e-6) & (x < 1.0 - 1e-6)))
    best: list[int] = []
    best_score = -np.inf
    for draw in range(DRAWS):
        if run.out_of_time():
            break
        selected = _heaviest(x, constraints) if draw == 0 else _sampled(x, constraints, run.rng)
        if constraints.beyond_matroid():  # what was rounded may break them: keep what fits
            selected = constraints.trimmed(_ranked(selected, x))
        score = objective.state(selected).score
        if score > best_score:
            best, best_score = [int(i) for i in selected], score
    if run.out_of_time():
        return _in_a_hurry(problem, run, aside, [best, greedy], stats)
    stats["rounded_score"] = best_score
    state = problem.objective.state(np.array(best, dtype=np.int64))
    stats["swaps"], settled = polish(problem, run, state)
    if not settled:
        return _in_a_hurry(problem, run, aside, [state.selected, greedy], stats)
    return Proposal(state.selected, run.score_bound, Status.FEASIBLE, stats)


def _in_a_hurry(
    problem: Problem, run: Run, aside: Run, placements: list[list[int]], stats: dict[str, Any]
) -> Proposal:
    """Return the best of `placements`; where no bound is there yet, greedy's."""
    rules, objective = problem.constraints, problem.objective
    sign = 1.0 if objective.maximise else -1.0
    valid = [p for p in placements if not rules.violations(p)]
    best = max(valid, key=lambda p: sign * objective.value(np.array(p, dtype=np.int64)))
    if aside.score_bound is not None and (
        run.score_bound is None or aside.score_bound < run.score_bound
    ):
        run.score_bound = aside.score_bound
    return Proposal(best, run.score_bound, Status.TIME_LIMIT, stats)


def conditional_gradient(objective: Relaxable, constraints: Constraints, run: Run) -> FloatArray:
    """Climb the concave extension by steps towards the best placement of its tangent.

    Stops when the tangent's bound is within 1e-6 of the score, after CONDITIONAL_STEPS, or out
    of time; return the visited x (c,) whose bound was least.
    """
    x = np.zeros(constraints.n)
    x[best_sum(constraints, objective.relaxed(x)[1])[0]] = 1.0
    best_x, best_bound = x, np.inf
    for step in range(CONDITIONAL_STEPS):
        score, slope = objective.relaxed(x)
        towards = np.zeros(constraints.n)
        towards[best_sum(constraints, slope)[0]] = 1.0
        bound = score + float(slope @ (towards - x))
        if bound < best_bound:
            best_x, best_bound = x, bound
        if bound - score <= 1e-6 * abs(score) or run.out_of_time():
            break
        run.progress("climbing the concave relaxation", step / CONDITIONAL_STEPS)
        x = x + _line_search(objective, x, towards - x, run) * (towards - x)
    return best_x


def _line_search(objective: Relaxable, x: FloatArray, direction: FloatArray, run: Run) -> float:
    """Return the step in [0, 1] at which the score stops rising along `direction`, to 1e-4."""
    low, high = 0.0, 1.0
    while high - low > 1e-4 and not run.out_of_time():
        middle = (low + high) / 2.0
        if float(objective.relaxed(x + middle * direction)[1] @ direction) > 0.0:
            low = middle
        else:
            high = middle
    return low if low > 0.0 else high


def _conic_choice(
    objective: Relaxable, constraints: Constraints, run: Run
) -> tuple[FloatArray | None, dict[str, Any]]:
    """Solve `localisation` in cvxpy; return the x it found, feasible or nearly, or None."""
    if not isinstance(objective, Localisation) or not len(objective.indices) or run.out_of_time():
        return None, {}
    cp = _cvxpy()

    x = cp.Variable(objective.n_candidates)
    score, cones = _concave_score(objective, x)
    problem = cp.Problem(cp.Maximize(score), [*cones, *_matroid_constraints(constraints, x)])
    options = {} if np.isinf(run.deadline) else {"time_limit": max(run.remaining(), 0.05)}
    failures: list[Exception] = []

    def work() -> None:
        try:
            problem.solve(solver=cp.CLARABEL, **options)
        except (cp.SolverError, ArithmeticError, ValueError) as error:
            failures.append(error)

    # Neither cvxpy's own preparations nor Clarabel look at our clock: they are left behind.
    thread = threading.Thread(target=work, daemon=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "may be inaccurate": the bound is certified anyway
        thread.start()
        while thread.is_alive() and not run.out_of_time():
            thread.join(LOOK_S)
    if thread.is_alive():
        return None, {"conic_status": "left behind: out of time"}
    if failures:
        return None, {"conic_status": f"solver error: {failures[0]}"}
    if x.value is None or not np.all(np.isfinite(x.value)):
        return None, {"conic_status": str(problem.status)}
    # An interior point never touches its walls; the tangent is sharpest at the walls themselves.
    found = np.where(x.value < WALL, 0.0, np.where(x.value > 1.0 - WALL, 1.0, x.value))
    return found, {"conic_status": str(problem.status)}


def _concave_score(objective: Localisation, x: Any) -> tuple[Any, list[Any]]:
    """Return Σ_t w_t log det(I + s Σ_i x_i J_it) as a cvxpy expression, and the cones it needs.

    Where blocks are 2×2, log det [[p, q], [q, r]] = 2 log u with u² + q² ≤ p r, a rotated
    second-order cone a sample, instead of a semidefinite one.
    """
    cp = _cvxpy()
    seen = np.flatnonzero(np.diff(objective.sample_indptr) > 0)
    weights = objective.weights[seen]

    def information(column: int) -> Any:
        """Return s Σ_i x_i J[column] of the seen samples, an affine expression (t,)."""
        values = objective.scale * objective.blocks[:, column].astype(np.float64)
        matrix = sparse.csr_matrix(
            (values, objective.indices, objective.indptr),
            shape=(objective.n_candidates, objective.information.n_samples),
        )
        return matrix.T.tocsr()[seen] @ x

    if objective.blocks.shape[1] == 1:
        return 2.0 * cp.sum(cp.multiply(weights, cp.log1p(information(0)))), []
    p, q, r = 1.0 + information(0), information(1), 1.0 + information(2)
    u = cp.Variable(len(seen))
    cone = cp.SOC(p + r, cp.vstack([2.0 * u, 2.0 * q, p - r]), axis=0)
    return 2.0 * cp.sum(cp.multiply(weights, cp.log(u))), [cone]


def _matroid_constraints(constraints: Constraints, x: Any) -> list[Any]:
    """Return budget, groups, required and forbidden candidates as cvxpy constraints."""
    cp = _cvxpy()
    upper = np.where(constraints.usable(), 1.0, 0.0)
    lower = np.zeros(constraints.n)
    lower[constraints.required] = 1.0
    grouped = np.flatnonzero(constraints.group >= 0)
    found = [x >= lower, x <= upper, cp.sum(x) <= constraints.budget]
    if grouped.size:
        _, row = np.unique(constraints.group[grouped], return_inverse=True)
        matrix = sparse.csr_matrix(
            (np.ones(grouped.size), (row, grouped)), shape=(int(row.max()) + 1, constraints.n)
        )
        found.append(matrix @ x <= 1.0)
    sides, limits = constraints.side_rows()
    if len(limits):
        found.append(sparse.csr_matrix(sides) @ x <= limits)
    return found


def _cvxpy() -> Any:
    """Import cvxpy: slow, so only where needed, and without types, so as Any."""
    return importlib.import_module("cvxpy")


def _heaviest(x: FloatArray, constraints: Constraints) -> IntArray:
    """Return the placement of greatest Σ x."""
    return best_sum(constraints, x)[0]


def _ranked(selected: IntArray, x: FloatArray) -> IntArray:
    """Return `selected`, then the others of which x takes a share, each the largest x first."""
    others = np.setdiff1d(np.flatnonzero(x > WALL), selected)
    return np.concatenate(
        [part[np.argsort(-x[part], kind="stable")] for part in (selected, others)]
    )


def _sampled(x: FloatArray, constraints: Constraints, rng: np.random.Generator) -> IntArray:
    """Draw a placement in which candidate i has probability x_i, nearly.

    Systematic sampling: lay the x_i end to end, each group together, and take whoever covers
    u, u + 1, u + 2, …: at most one of each group, as its x sums to at most 1.
    """
    required = np.unique(constraints.required)
    weight = np.where(constraints.usable(), x, 0.0)
    weight[required] = 0.0
    key = root_choice(constraints).group
    groups = rng.permutation(int(key.max(initial=0)) + 1)
    order = np.lexsort((rng.random(len(x)), groups[key]))
    ends = np.cumsum(weight[order])
    ticks = rng.random() + np.arange(int(np.ceil(ends[-1])) if len(ends) else 0)
    hit = order[np.unique(np.searchsorted(ends, ticks[ticks < ends[-1]], side="right"))]
    # Rounding may let a group through twice: the first of each stays.
    _, first = np.unique(key[hit], return_index=True)
    room = constraints.budget - required.size
    return np.sort(np.concatenate([required, hit[np.sort(first)][:room]])).astype(np.int64)
