"""Money and separation: every method keeps them, every bound survives them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from placement.constraints import Constraints
from placement.problem import Problem
from placement.solution import Status
from placement.solve import METHODS, solve

ABLE = [name for name, method in METHODS.items() if len(method.keeps) == 2]
# Made for one objective, and not the one these problems have.
OTHERS = {"tempered", "diagram", "tolerance"}
NewProblem = Callable[..., Problem]
BruteForce = Callable[[Problem], tuple[float, tuple[int, ...]]]


def side(problem: Problem, rng: np.random.Generator, kind: str) -> Problem:
    """Add prices, a separation or both to a problem whose mounts hold three poses each."""
    n = problem.constraints.n
    mount = np.arange(n) // 3
    spots = np.column_stack(
        [4.0 * np.arange(mount.max() + 1.0), rng.uniform(0, 3, mount.max() + 1)]
    )
    rules = problem.constraints
    if kind in ("money", "both"):
        cost = rng.choice([0.0, 1.0, 2.0, 3.0, 1e9], n, p=[0.1, 0.3, 0.3, 0.2, 0.1])
        rules = replace(rules, cost=cost, money=float(rng.choice([2.0, 4.0, 1e9])))
    if kind in ("separation", "both"):
        rules = replace(rules, place_m=spots[mount], separation_m=float(rng.choice([5.0, 9.0])))
    return replace(problem, constraints=rules)


def draw(new_problem: NewProblem, seed: int, kind: str) -> Problem:
    rng = np.random.default_rng(seed)
    problem = new_problem(
        rng,
        n_candidates=int(rng.integers(6, 13)),
        budget=int(rng.integers(1, 5)),
        groups=bool(rng.integers(2)),
        isotropic=bool(rng.integers(2)),
    )
    return side(problem, rng, kind)


@pytest.fixture(scope="module")
def best_values() -> dict[tuple[int, str], float]:
    """Keep what enumeration found of a problem, for every method that is held to it."""
    return {}


@pytest.mark.parametrize("kind", ["money", "separation", "both"])
@pytest.mark.parametrize("method", [name for name in ABLE if name not in OTHERS])
def test_values_and_bounds_enclose_the_best_placement(
    new_problem: NewProblem,
    brute_force: BruteForce,
    best_values: dict[tuple[int, str], float],
    method: str,
    kind: str,
) -> None:
    for seed in range(8 if method == "relaxation" else 15):
        problem = draw(new_problem, seed, kind)
        if (seed, kind) not in best_values:
            best_values[seed, kind] = brute_force(problem)[0]
        best = best_values[seed, kind]
        found = solve(problem, method, seed=seed)
        assert found.status in (Status.OPTIMAL, Status.FEASIBLE), found.stats
        assert problem.constraints.violations(found.selected) == []
        assert found.value <= best * (1.0 + 1e-9)
        if found.bound is not None:
            assert found.bound >= best * (1.0 - 1e-12)
        if method in ("mip", "auto"):
            assert found.value == pytest.approx(best, rel=1e-6, abs=1e-12)
        guarantee = found.stats.get("guarantee")
        if guarantee:
            assert found.value >= guarantee["factor"] * best * (1.0 - 1e-9)


@pytest.mark.parametrize("kind", ["money", "separation"])
def test_minimised_scores_keep_them_too(
    new_problem: NewProblem, brute_force: BruteForce, new_toy: Callable[..., object], kind: str
) -> None:
    for seed in range(3):
        base = draw(new_problem, seed, kind)
        toy = new_toy(base.objective.information)  # type: ignore[attr-defined]
        problem = replace(base, objective=toy)
        best, _ = brute_force(problem)
        for method in ("greedy", "exchange", "search", "uniform", "random", "hill-climb"):
            found = solve(problem, method, seed=seed)
            assert problem.constraints.violations(found.selected) == []
            assert found.value >= best * (1.0 - 1e-9)
            assert "guarantee" not in found.stats


@pytest.mark.parametrize(
    ("money", "separation", "name"),
    [(2.0, 0.0, "budget.money"), (math.inf, 9.0, "budget.separation_m")],
)
def test_a_method_that_cannot_keep_a_constraint_refuses_it_by_name(
    new_problem: NewProblem, money: float, separation: float, name: str
) -> None:
    problem = side(new_problem(np.random.default_rng(0)), np.random.default_rng(0), "both")
    rules = replace(problem.constraints, money=money, separation_m=separation)
    for method in set(METHODS) - set(ABLE) - {"branch"}:  # which takes dense designs alone
        with pytest.raises(ValueError, match=f"method {method} cannot keep .*{name}"):
            solve(replace(problem, constraints=rules), method)


def test_greedy_by_gain_alone_would_be_far_off(
    new_problem: NewProblem, brute_force: BruteForce
) -> None:
    """One dear camera that is a little better must not use up the money of ten cheap ones."""
    problem = new_problem(np.random.default_rng(2), n_candidates=12, budget=12, spread=0.0)
    alone = problem.objective.state().gains()
    cost = np.where(np.arange(12) == np.argmax(alone), 10.0, 1.0)
    rules = replace(problem.constraints, cost=cost, money=10.0)
    found = solve(replace(problem, constraints=rules), "greedy")
    assert len(found.selected) == 10
    assert found.stats["guarantee"]["factor"] == pytest.approx(0.316, abs=1e-3)


def test_uniform_spreads_what_money_allows_over_the_whole_road(new_problem: NewProblem) -> None:
    rng = np.random.default_rng(1)
    problem = new_problem(rng, n_candidates=30, n_samples=30, budget=8, groups=True)
    rules = replace(problem.constraints, cost=np.ones(30), money=3.0)
    found = solve(replace(problem, constraints=rules), "uniform")
    assert len(found.selected) == 3
    places = np.asarray(problem.arc_length_m)[list(found.selected)]
    assert places.max() > 20.0


CASES: dict[str, tuple[Callable[[Constraints], Constraints], float | None]] = {
    "a budget alone": (lambda rules: rules, 0.632),
    "groups": (lambda rules: replace(rules, group=np.arange(rules.n) // 2), 0.5),
    "groups of one": (lambda rules: replace(rules, group=np.arange(rules.n)), 0.632),
    "required": (lambda rules: replace(rules, required=np.array([1])), 0.632),
    "money alone": (
        lambda rules: replace(rules, budget=rules.n, cost=np.ones(rules.n), money=3.0),
        0.316,
    ),
    "money and a count": (lambda rules: replace(rules, cost=np.ones(rules.n), money=5.0), None),
    "money and groups": (
        lambda rules: replace(
            rules,
            budget=rules.n,
            cost=np.ones(rules.n),
            money=3.0,
            group=np.arange(rules.n) // 2,
        ),
        None,
    ),
    "separation": (
        lambda rules: replace(
            rules,
            separation_m=2.0,
            place_m=np.column_stack([np.arange(float(rules.n)), np.zeros(rules.n)]),
        ),
        None,
    ),
}


@pytest.mark.parametrize("what", CASES)
@pytest.mark.parametrize("method", ["greedy", "exchange"])
def test_a_guarantee_is_stated_only_where_it_holds(
    new_problem: NewProblem, brute_force: BruteForce, method: str, what: str
) -> None:
    change, factor = CASES[what]
    for seed in range(5):
        problem = new_problem(np.random.default_rng(seed), n_candidates=8, budget=3)
        problem = replace(problem, constraints=change(problem.constraints))
        found = solve(problem, method)
        if factor is None:
            assert "guarantee" not in found.stats
            continue
        stated = found.stats["guarantee"]
        assert stated["factor"] == pytest.approx(factor, abs=1e-3)
        assert {"holds_for", "source"} <= stated.keys()
        assert found.value >= stated["factor"] * brute_force(problem)[0] * (1.0 - 1e-9)


def test_greedy_stopped_on_its_way_promises_nothing(new_problem: NewProblem) -> None:
    found = solve(new_problem(np.random.default_rng(0)), "greedy", time_limit_s=0.0)
    assert "guarantee" not in found.stats
