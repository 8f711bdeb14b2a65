"""What each further camera buys: value and proven bound for every budget from A to B.

Budgets share what they can. One greedy run serves them all (its first k cameras are greedy's for
k), and each of its states bounds every budget. The method then solves each budget in its share of
the time (`trace`: one relaxed decision diagram bounds them all, `placement.solvers.trace_curve`;
`entropy`: two chains do besides, `placement.tempered.curve`), and what is known of one budget
tightens the others:

    a placement of k cameras is one for k + 1;          so values rise with k,
    opt(k) ≤ opt(k + 1);                                so a bound for k + 1 is one for k,
    opt(k + 1) ≤ (k + 1)/k · opt(k) for monotone submodular scores that are 0 for nothing:
    leave out the worst of k + 1 cameras, and at least k/(k + 1) of the score remains.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from models.geometry import FloatArray
from placement.bounds.linear import most_sum
from placement.constraints import Infeasible
from placement.interrupts import stop_on_request
from placement.objectives.base import Demanding
from placement.objectives.entropy import Entropy
from placement.objectives.trace import Trace
from placement.problem import Problem, Run
from placement.solution import OPTIMAL_GAP, Solution, Status
from placement.solve import certified, outwards, solve

Report = Callable[[str, float | None], None]
MOST_BUDGETS = 1_000
FIRST_SHARE = 1.0 / 3.0  # of a time limit, for the greatest budget
LEAST_S = 0.05  # for any budget, where there is no time limit


@dataclass(frozen=True, slots=True)
class BudgetCurve:
    """The solutions for budgets `first`, `first` + 1, …: values and bounds are monotone."""

    first: int
    solutions: tuple[Solution, ...]

    def table(self) -> pd.DataFrame:
        """Return a row a budget, as `budget_curve.csv` holds it."""
        return pd.DataFrame(
            [
                {
                    "k": self.first + n,
                    "value": s.value,
                    "bound": s.bound,
                    "gap": s.gap,
                    "status": str(s.status),
                    "method": s.method,
                    "seconds": s.seconds,
                    "selected": " ".join(map(str, s.selected)),
                }
                for n, s in enumerate(self.solutions)
            ]
        )


def parse_budgets(text: str) -> tuple[int, int]:
    """Read `A:B`; raises ValueError unless 1 ≤ A ≤ B and they are at most 1,000 budgets."""
    first, _, last = text.partition(":")
    try:
        low, high = int(first), int(last)
    except ValueError:
        raise ValueError(f"--budget must be A:B, two whole numbers, got {text}") from None
    if not 1 <= low <= high or high - low >= MOST_BUDGETS:
        raise ValueError(
            f"--budget must be A:B with 1 ≤ A ≤ B and at most {MOST_BUDGETS:,} budgets, got {text}"
        )
    return low, high


def budget_curve(
    problem: Problem,
    first: int,
    last: int,
    method: str = "auto",
    *,
    time_limit_s: float = math.inf,
    seed: int = 0,
    progress: Report | None = None,
) -> BudgetCurve:
    """Solve `problem` for the budgets `first` … `last`, all within `time_limit_s` seconds.

    Raises:
        ValueError: as `solve` does, or if the constraints contradict one of the budgets.
    """
    if isinstance(problem.objective, Demanding):
        raise ValueError(
            f"--budget A:B must be one number for objective.kind = {problem.objective.name}, whose "
            "value is that number"
        )
    tell = progress or (lambda _text, _fraction: None)
    deadline = time.monotonic() + time_limit_s
    budgets = range(first, last + 1)
    problems = [
        replace(problem, constraints=replace(problem.constraints, budget=k)) for k in budgets
    ]
    bounds = np.full(len(budgets), np.inf)
    solutions: list[Solution] = []
    if len(budgets) > 1 and isinstance(problem.objective, Trace) and method in ("auto", "diagram"):
        solutions = _by_one_diagram(problems, budgets, method, deadline, seed, tell)
    if not solutions:
        solutions = _one_by_one(problems, budgets, method, deadline, seed, tell)
    if not all(s.status.has_placement for s in solutions):
        return BudgetCurve(first, tuple(solutions))
    if problem.objective.submodular and time.monotonic() < deadline:
        bounds = _shared_bounds(problems, solutions, deadline)
        objective = problem.objective
        if len(budgets) > 1 and isinstance(objective, Entropy) and method in ("auto", "tempered"):
            from placement.tempered.curve import chain_bounds

            run = Run(np.random.default_rng(seed), deadline, tell)
            with stop_on_request():
                bounds = np.minimum(bounds, chain_bounds(problems[-1], objective, run)[first:])
    return BudgetCurve(first, _tightened(problem, first, solutions, bounds))


def _one_by_one(
    problems: list[Problem], budgets: range, method: str, deadline: float, seed: int, tell: Report
) -> list[Solution]:
    """Solve the greatest budget, then the others from the least on.

    They share the time that is left; without a time limit, `auto` takes as much for all of them
    as it took for the greatest, or half where chains bound them all.
    """
    started = time.monotonic()
    limited = math.isfinite(deadline)
    last = len(problems) - 1
    found: dict[int, Solution] = {}
    for n, at in enumerate([last, *range(last)]):
        left = max(0.0, deadline - time.monotonic()) / (len(problems) - n)
        if limited and n == 0:
            left = FIRST_SHARE * (deadline - started) if last else deadline - started
        tell(f"budget {budgets[at]}", n / len(problems))
        found[at] = solve(problems[at], method, time_limit_s=left, seed=seed)
        if n == 0 and not limited and method == "auto":
            now = time.monotonic()
            part = 0.5 if isinstance(problems[at].objective, Entropy) else 1.0
            deadline = now + max(part * (now - started), LEAST_S * last)
        if found[at].stats.get("stopped_by") == "interrupt":
            deadline = time.monotonic()  # what is left takes no time worth speaking of
    return [found[at] for at in range(len(problems))]


def _by_one_diagram(
    problems: list[Problem], budgets: range, method: str, deadline: float, seed: int, tell: Report
) -> list[Solution]:
    """Solve all budgets of a `trace` problem by one diagram; none where it cannot."""
    from placement.solvers.trace_curve import solve_trace_curve

    started = time.monotonic()
    run = Run(np.random.default_rng(seed), deadline, tell)
    try:
        with stop_on_request():
            proposals = solve_trace_curve(problems[-1], budgets, run)
    except (ValueError, ArithmeticError, Infeasible):  # views too long; or `solve` says what it is
        return []
    seconds = (time.monotonic() - started) / len(problems)
    return [
        certified(each, proposal, Run(run.rng), method, seconds, seed)
        for each, proposal in zip(problems, proposals, strict=True)
    ]


def _shared_bounds(
    problems: list[Problem], solutions: list[Solution], deadline: float
) -> FloatArray:
    """Bound every budget's score from the placements found for all: f(R) + best sum of gains."""
    bounds = np.full(len(problems), np.inf)
    objective = problems[0].objective
    states = {(): None} | {s.selected: None for s in solutions}
    for selected in states:
        if time.monotonic() >= deadline:
            break
        state = objective.state(np.array(selected, dtype=np.int64))
        score, gains = state.score, state.gains()
        for n, each in enumerate(problems):
            bounds[n] = min(bounds[n], score + most_sum(each.constraints, gains))
    return bounds


def _tightened(
    problem: Problem, first: int, solutions: list[Solution], shared: FloatArray
) -> tuple[Solution, ...]:
    """Let every budget profit from the others: see the module's docstring."""
    sign = 1.0 if problem.objective.maximise else -1.0
    best = list(solutions)
    for n in range(1, len(best)):
        if sign * best[n - 1].value > sign * best[n].value:
            best[n] = replace(best[n], value=best[n - 1].value, selected=best[n - 1].selected)
    bounds = np.array(
        [
            min(
                np.inf if s.bound is None else sign * s.bound,
                b if math.isinf(b) else float(outwards(float(b)) or 0.0),
            )
            for s, b in zip(solutions, shared, strict=True)
        ]
    )
    closed = problem.objective.submodular and not problem.constraints.required.size
    for n in range(1, len(bounds)):
        k = first + n
        if closed:
            raised = bounds[n - 1] * k / (k - 1)
            bounds[n] = min(bounds[n], raised * (1.0 + 1e-12))
    for n in range(len(bounds) - 2, -1, -1):
        bounds[n] = min(bounds[n], bounds[n + 1])
    return tuple(_judged(s, sign, float(bound)) for s, bound in zip(best, bounds, strict=True))


def _judged(solution: Solution, sign: float, score_bound: float) -> Solution:
    if math.isinf(score_bound):
        return replace(solution, bound=None)
    # The value itself is a bound's floor: nearer than rounding, the two are the same number.
    bound = sign * max(score_bound, sign * solution.value)
    proven = abs(bound - solution.value) <= OPTIMAL_GAP * abs(solution.value)
    status = solution.status
    if proven:
        status = Status.OPTIMAL
    elif status is Status.OPTIMAL:
        status = Status.FEASIBLE
    return replace(solution, bound=bound, status=status)
