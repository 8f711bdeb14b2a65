"""What each further camera buys: value and proven bound for every budget from A to B.

Budgets share what they can. One greedy run serves them all (its first k cameras are greedy's for
k), and each of its states bounds every budget. The method then solves each budget in its share of
the time, and what is known of one budget tightens the others:

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
from placement.objectives.base import Demanding
from placement.problem import Problem
from placement.solution import OPTIMAL_GAP, Solution, Status
from placement.solve import outwards, solve

Report = Callable[[str, float | None], None]
MOST_BUDGETS = 1_000


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
    for n, each in enumerate(problems):
        share = max(0.0, deadline - time.monotonic()) / (len(budgets) - n)
        tell(f"budget {budgets[n]}", n / len(budgets))
        solutions.append(solve(each, method, time_limit_s=share, seed=seed))
        if solutions[-1].stats.get("stopped_by") == "interrupt":
            deadline = time.monotonic()  # what is left takes no time worth speaking of
    if not all(s.status.has_placement for s in solutions):
        return BudgetCurve(first, tuple(solutions))
    if problem.objective.submodular and time.monotonic() < deadline:
        bounds = _shared_bounds(problems, solutions, deadline)
    return BudgetCurve(first, _tightened(problem, first, solutions, bounds))


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
