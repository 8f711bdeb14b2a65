"""Branch-and-bound against enumeration: every option, bounds never below, time kept."""

from __future__ import annotations

import itertools
import time
from typing import Any

import numpy as np
import pytest

from placement.constraints import Constraints, Infeasible, count_only
from placement.objectives.log_det import LogDet
from placement.objectives.trace_inverse import TraceInverse
from placement.problem import Problem, Run
from placement.solution import Status
from placement.solve import solve
from placement.solvers.branch import Tree

NONE = np.empty(0, dtype=np.int64)


def draw(seed: int, kind: type[LogDet] | type[TraceInverse]) -> Problem | None:
    """Draw any rank, prior, group, cost, required and forbidden; None where they contradict."""
    rng = np.random.default_rng(seed)
    c, n, r = int(rng.integers(3, 12)), int(rng.integers(1, 6)), int(rng.integers(1, 4))
    k = int(rng.integers(0, c + 1))
    prior = 10.0 ** rng.integers(-6, 3) * np.eye(n)
    if seed % 3 == 0:  # conditioned at 1e8
        Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
        prior = (Q * np.logspace(-6, 2, n)) @ Q.T
        prior = 0.5 * (prior + prior.T)
    factors = rng.normal(size=(c, n, r))
    if seed % 5 == 0:
        factors = np.round(factors)  # ties, zeros, dependent columns
    group = rng.integers(-1, 4, c) if seed % 2 else np.full(c, -1)
    order = rng.permutation(c)
    required = np.sort(order[:1]) if seed % 4 == 0 and k else NONE
    forbidden = np.sort(order[1:2]) if seed % 4 < 2 else NONE
    cost, money = None, np.inf
    if seed % 7 in (1, 2, 3):
        cost = rng.uniform(0.0, 1.0, c).round(2)
        money = float(0.4 * cost.sum())
    try:
        rules = Constraints(c, k, group, required, forbidden, cost=cost, money=money)
    except Infeasible:
        return None
    return Problem(kind(prior, factors), rules)


def best_score(problem: Problem) -> float:
    objective, rules = problem.objective, problem.constraints
    sign = 1.0 if objective.maximise else -1.0
    return max(
        sign * objective.value(np.array(s, dtype=np.int64))
        for size in range(rules.budget + 1)
        for s in itertools.combinations(range(rules.n), size)
        if not rules.violations(s)
    )


@pytest.mark.parametrize("kind", [LogDet, TraceInverse])
def test_it_equals_enumeration_whatever_the_options(
    kind: type[LogDet] | type[TraceInverse],
) -> None:
    for seed in range(56):
        problem = draw(seed, kind)
        if problem is None:
            continue
        best = best_score(problem)
        solution = solve(problem, "branch")
        sign = 1.0 if kind is LogDet else -1.0
        assert solution.status is Status.OPTIMAL, (seed, solution)
        assert not problem.constraints.violations(solution.selected)
        assert sign * solution.value == pytest.approx(best, rel=1e-6, abs=1e-9)
        assert solution.bound is not None
        assert sign * solution.bound >= best - 1e-9 * abs(best) - 1e-12


def test_the_tree_finds_the_best_without_any_help(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wrong pruning hides behind a good start, so there is none here."""
    monkeypatch.setattr(Tree, "_swap", lambda _tree, _start: None)
    pairs = list(itertools.combinations(range(6), 2))
    edges = np.zeros((len(pairs), 6, 1))
    for i, (a, b) in enumerate(pairs):
        edges[i, a, 0], edges[i, b, 0] = 1.0, -1.0
    symmetric = Problem(LogDet(0.3 * np.eye(5), edges[:, 1:]), count_only(len(pairs), 6))
    problems = [draw(seed, kind) for seed in range(24) for kind in (LogDet, TraceInverse)]
    for problem in [symmetric, *(p for p in problems if p is not None)]:
        best = best_score(problem)
        solution = solve(problem, "branch")
        sign = 1.0 if problem.objective.maximise else -1.0
        assert solution.status is Status.OPTIMAL
        assert sign * solution.value == pytest.approx(best, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("n", "k", "prior"), [(4, 4, 1e-6), (4, 4, 1.0), (4, 7, 1e-6), (5, 3, 1e-6)]
)
def test_budgets_of_about_n_are_proven_with_the_prior_tiny_or_not(
    n: int, k: int, prior: float
) -> None:
    for seed in range(3):
        rng = np.random.default_rng([seed, n, k])
        problem = Problem(LogDet(prior * np.eye(n), rng.normal(size=(14, n, 1))), count_only(14, k))
        solution = solve(problem, "branch")
        assert solution.status is Status.OPTIMAL
        assert solution.value == pytest.approx(best_score(problem), rel=1e-6)
        assert solution.stats["projected"] == (k == n and prior < 1e-3)


def gaussian(c: int, k: int, seed: int = 0) -> Problem:
    rng = np.random.default_rng([10, c, k, seed])
    return Problem(LogDet(1e-6 * np.eye(10), rng.normal(size=(c, 10, 1))), count_only(c, k))


@pytest.mark.parametrize("k", [10, 15])
def test_a_hundred_gaussian_experiments_are_proven_to_1e_4_nats(k: int) -> None:
    solution = solve(gaussian(100, k), "auto")
    assert solution.stats["chosen"] == "branch"
    assert solution.status is Status.OPTIMAL
    assert solution.bound is not None
    assert 0.0 <= solution.bound - solution.value <= 1e-4


def test_out_of_time_it_has_a_design_and_a_bound() -> None:
    problem = gaussian(60, 20)
    solve(problem, "branch", time_limit_s=0.01)  # compiled by now, whatever came before
    started = time.monotonic()
    solution = solve(problem, "branch", time_limit_s=0.1)
    assert time.monotonic() - started < 5.0
    assert not problem.constraints.violations(solution.selected)
    if solution.bound is not None:
        assert solution.bound >= solution.value
    nothing = solve(problem, "branch", time_limit_s=0.0)
    assert nothing.status is Status.TIME_LIMIT


def test_the_bound_falls_and_never_crosses_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = gaussian(40, 13, seed=3)
    bounds: list[float] = []
    original = Tree._publish

    def watched(tree: Tree) -> None:
        original(tree)
        assert tree.run.score_bound is not None
        bounds.append(tree.run.score_bound)

    monkeypatch.setattr(Tree, "_publish", watched)
    monkeypatch.setattr("placement.solvers.branch.DIVE", 8)
    tree = Tree(problem, Run(np.random.default_rng(0)))
    tree.start()
    assert tree.explore()
    assert len(bounds) > 3
    assert bounds == sorted(bounds, reverse=True)
    assert bounds[-1] >= tree.score
    assert bounds[-1] - tree.score <= 1e-6 * tree.score


def test_two_runs_of_one_seed_are_one_run() -> None:
    problem: Any = gaussian(40, 12, seed=1)
    first, second = (solve(problem, "branch", seed=4) for _ in range(2))
    assert first.selected == second.selected
    assert first.bound == second.bound
    assert first.stats == second.stats


def test_other_objectives_and_separation_are_refused() -> None:
    problem = gaussian(12, 3)
    apart = Constraints(
        12, 3, np.full(12, -1), NONE, NONE, place_m=np.zeros((12, 2)), separation_m=1.0
    )
    with pytest.raises(ValueError, match="cannot keep"):
        solve(Problem(problem.objective, apart), "branch")
