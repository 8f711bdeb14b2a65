"""The one table of behaviour that every method passes: add a method's name and it is held to it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from placement.constraints import Constraints, count_only
from placement.information import Information
from placement.objectives.localisation import Localisation
from placement.problem import Problem
from placement.solution import OPTIMAL_GAP, Solution, Status
from placement.solve import METHODS, solve

# Every method that is ready; a new one joins by its name.
READY = [
    "auto",
    "greedy",
    "exchange",
    "search",
    "hill-climb",
    "cascade",
    "uniform",
    "random",
    "relaxation",
    "mip",
    "chain",
    "regions",
]
# Methods that find the optimum of small problems and prove it.
EXACT: list[str] = ["auto", "mip", "chain"]
# Methods whose placement does not depend on how the candidates are numbered (save for ties).
NUMBERING_FREE = ["greedy", "exchange", *EXACT]
# Methods whose placement for one camera more holds the one before.
NESTED = ["greedy"]
# Methods that ask nothing of an objective but its state and value.
ANY_OBJECTIVE = [
    "auto",
    "greedy",
    "exchange",
    "search",
    "hill-climb",
    "cascade",
    "uniform",
    "random",
]

every_method = pytest.mark.parametrize("method", READY)
Make = Callable[..., Any]


def check(problem: Problem, solution: Solution) -> None:
    """Hold what every solution owes: a placement, its own value, a bound on the right side."""
    assert not problem.constraints.violations(solution.selected)
    assert list(solution.selected) == sorted(solution.selected)
    chosen = np.array(solution.selected, dtype=np.int64)
    assert solution.value == problem.objective.value(chosen)
    assert solution.status in {Status.OPTIMAL, Status.FEASIBLE}, solution.stats
    if solution.bound is None:
        assert not METHODS[solution.method].proves_bound or not problem.objective.submodular
        return
    if problem.objective.maximise:
        assert solution.bound >= solution.value
    else:
        assert solution.bound <= solution.value
    proven = abs(solution.bound - solution.value) <= OPTIMAL_GAP * abs(solution.value)
    assert (solution.status is Status.OPTIMAL) == proven


@pytest.fixture(scope="module")
def best_values() -> dict[tuple[int, bool], float]:
    """Keep what enumeration found of a small problem, for every method that is held to it."""
    return {}


@every_method
@pytest.mark.parametrize("groups", [False, True])
def test_values_lie_below_brute_force_and_bounds_above_on_200_small_problems(
    method: str,
    groups: bool,
    new_problem: Make,
    brute_force: Make,
    best_values: dict[tuple[int, bool], float],
) -> None:
    for seed in range(100):
        rng = np.random.default_rng([seed, groups])
        n = int(rng.integers(2, 15 if seed % 10 == 0 else 10))
        order = rng.permutation(n)
        problem = new_problem(
            rng,
            n_candidates=n,
            n_samples=int(rng.integers(5, 20)),
            budget=int(rng.integers(1, 5)),
            groups=groups,
            isotropic=bool(seed % 2),
            required=tuple(order[:1]) if seed % 3 == 0 else (),
            forbidden=tuple(np.sort(order[1 : 1 + seed % 3])),
            scale=float(10.0 ** rng.integers(-2, 3)),
        )
        if (seed, groups) not in best_values:
            best_values[seed, groups] = brute_force(problem)[0]
        best = best_values[seed, groups]
        solution = solve(problem, method, seed=seed)
        check(problem, solution)
        slack = 1e-12 * best  # the same sums in another order
        assert solution.value <= best + slack
        if solution.bound is not None:
            assert solution.bound >= best - slack
        if method in EXACT:
            assert solution.status is Status.OPTIMAL
            assert solution.value == pytest.approx(best, rel=OPTIMAL_GAP)


@every_method
def test_a_budget_of_nothing_places_nothing_and_knows_it(method: str, new_problem: Make) -> None:
    problem = new_problem(np.random.default_rng(1), budget=0)
    solution = solve(problem, method)
    assert solution.selected == ()
    assert solution.value == 0.0
    if METHODS[method].proves_bound:
        assert solution.status is Status.OPTIMAL
        assert solution.bound == 0.0


@every_method
def test_a_budget_for_everything_takes_everything_useful(method: str, new_problem: Make) -> None:
    problem = new_problem(np.random.default_rng(2), n_candidates=7, budget=7)
    solution = solve(problem, method)
    check(problem, solution)
    assert solution.value == pytest.approx(problem.objective.value(np.arange(7)), rel=1e-12)
    if METHODS[method].proves_bound:
        assert solution.status is Status.OPTIMAL


@every_method
def test_a_budget_beyond_everything_is_the_same(method: str, new_problem: Make) -> None:
    problem = new_problem(np.random.default_rng(3), n_candidates=5, budget=10**9)
    check(problem, solve(problem, method))
    assert len(solve(problem, method).selected) == 5


@every_method
def test_groups_of_one_are_no_groups(method: str, new_problem: Make) -> None:
    problem = new_problem(np.random.default_rng(4))
    n = problem.constraints.n
    grouped = replace(problem, constraints=replace(problem.constraints, group=np.arange(n)))
    free, alone = solve(problem, method), solve(grouped, method)
    check(grouped, alone)
    assert alone.value == pytest.approx(free.value, rel=1e-12)


@every_method
def test_one_group_holds_one_camera(method: str, new_problem: Make) -> None:
    problem = new_problem(np.random.default_rng(5), budget=4)
    n = problem.constraints.n
    single = replace(problem, constraints=replace(problem.constraints, group=np.zeros(n, int)))
    solution = solve(single, method)
    check(single, solution)
    assert len(solution.selected) == 1


@every_method
def test_required_cameras_stand_and_forbidden_ones_do_not(method: str, new_problem: Make) -> None:
    problem = new_problem(
        np.random.default_rng(6), budget=4, groups=True, required=(4, 9), forbidden=(0, 1)
    )
    solution = solve(problem, method)
    check(problem, solution)
    assert {4, 9} <= set(solution.selected)


@every_method
def test_required_cameras_may_use_up_the_budget(method: str, new_problem: Make) -> None:
    problem = new_problem(np.random.default_rng(7), budget=2, required=(1, 8))
    solution = solve(problem, method)
    check(problem, solution)
    assert solution.selected == (1, 8)
    if METHODS[method].proves_bound:
        assert solution.status is Status.OPTIMAL


@every_method
def test_all_forbidden_leaves_the_empty_placement(method: str, new_problem: Make) -> None:
    problem = new_problem(np.random.default_rng(8), n_candidates=4, forbidden=(0, 1, 2, 3))
    solution = solve(problem, method)
    assert solution.selected == ()
    if METHODS[method].proves_bound:
        assert solution.status is Status.OPTIMAL


@every_method
def test_duplicate_candidates_are_no_trouble(method: str) -> None:
    # Four times the same three windows, two of them alike as well.
    rows = [range(5), range(5), range(3, 8)] * 4
    indices = np.concatenate([np.array(r, np.int32) for r in rows])
    info = Information(8, np.arange(0, 61, 5), indices, np.full((60, 1), 7.0, np.float32))
    problem = Problem(Localisation(info, 0.5), count_only(12, 4), np.repeat([1.0, 6.0], 6), 8.0)
    solution = solve(problem, method)
    check(problem, solution)
    assert len(solution.selected) == 4


@every_method
def test_candidates_that_see_nothing_are_worth_nothing(method: str) -> None:
    nothing = Information(
        6, np.zeros(6, np.int64), np.empty(0, np.int32), np.empty((0, 1), np.float32)
    )
    problem = Problem(Localisation(nothing, 0.5), count_only(5, 2), np.arange(5.0), 6.0)
    solution = solve(problem, method)
    assert solution.value == 0.0
    assert solution.bound in {0.0, None}
    if METHODS[method].proves_bound:
        assert solution.status is Status.OPTIMAL


@every_method
@pytest.mark.parametrize("scale", [1e-20, 1e20])
def test_ill_conditioned_information_keeps_value_and_bound_in_order(
    method: str, scale: float, new_problem: Make, brute_force: Make
) -> None:
    for seed in range(5):
        problem = new_problem(
            np.random.default_rng([9, seed]),
            n_candidates=8,
            isotropic=False,
            scale=scale,
            spread=8.0,
        )
        solution = solve(problem, method)
        check(problem, solution)
        best, _ = brute_force(problem)
        assert solution.value <= best * (1.0 + 1e-12)
        assert solution.bound is None or solution.bound >= best * (1.0 - 1e-12)


@pytest.mark.parametrize("method", [m for m in READY if m in NUMBERING_FREE])
@pytest.mark.parametrize("groups", [False, True])
def test_numbering_the_candidates_anew_changes_nothing(
    method: str, groups: bool, new_problem: Make
) -> None:
    rng = np.random.default_rng(10)
    problem = new_problem(rng, n_candidates=12, n_samples=40, budget=4, groups=groups)
    info = problem.objective.information
    order = rng.permutation(12)
    rows = [np.arange(info.indptr[i], info.indptr[i + 1]) for i in order]
    entries = np.concatenate(rows)
    shuffled = Information(
        40,
        np.concatenate([[0], np.cumsum([len(r) for r in rows])]),
        info.indices[entries],
        info.blocks[entries],
    )
    constraints = replace(problem.constraints, group=problem.constraints.group[order])
    again = solve(Problem(Localisation(shuffled, 0.5), constraints), method)
    first = solve(problem, method)
    assert sorted(order[list(again.selected)]) == list(first.selected)
    assert again.value == pytest.approx(first.value, rel=1e-12)
    assert again.bound == pytest.approx(first.bound, rel=1e-9)


@every_method
def test_a_smaller_budget_never_beats_the_bound_of_a_larger(method: str, new_problem: Make) -> None:
    values, bounds = [], []
    for budget in range(7):
        problem = new_problem(np.random.default_rng(11), n_candidates=12, budget=budget)
        solution = solve(problem, method)
        values.append(solution.value)
        bounds.append(math.inf if solution.bound is None else solution.bound)
    assert all(max(values[: k + 1]) <= bounds[k] for k in range(7))
    if method in NESTED or method in EXACT:
        assert np.all(np.diff(values) >= -OPTIMAL_GAP * np.array(values[1:]))


@every_method
def test_one_seed_gives_one_answer(method: str, new_problem: Make) -> None:
    first, second = (
        solve(new_problem(np.random.default_rng(12), n_candidates=20), method, seed=5)
        for _ in range(2)
    )
    assert (first.selected, first.value, first.bound) == (
        second.selected,
        second.value,
        second.bound,
    )


@every_method
def test_no_time_at_all_still_gives_a_placement(method: str, new_problem: Make) -> None:
    problem = new_problem(np.random.default_rng(13), required=(2,))
    solution = solve(problem, method, time_limit_s=0.0)
    assert not problem.constraints.violations(solution.selected)
    assert solution.status in {Status.TIME_LIMIT, Status.FEASIBLE, Status.OPTIMAL}


@pytest.mark.parametrize("method", ANY_OBJECTIVE)
@pytest.mark.parametrize("groups", [False, True])
def test_an_objective_to_minimise_without_submodularity_is_served(
    method: str, groups: bool, new_information: Make, new_toy: Make, brute_force: Make
) -> None:
    for seed in range(10):
        rng = np.random.default_rng([14, seed])
        n = 9
        constraints = Constraints(
            n,
            3,
            np.arange(n) // 2 if groups else np.full(n, -1),
            np.array([seed % n]),
            np.array([(seed + 1) % n]),
        )
        toy = new_toy(new_information(rng, n, 20, scale=3.0))
        problem = Problem(toy, constraints, np.arange(n) * 2.0, 20.0)
        solution = solve(problem, method, seed=seed)
        check(problem, solution)
        assert not solution.maximise
        assert solution.bound is None  # diminishing returns prove nothing here
        best, _ = brute_force(problem)
        assert solution.value >= best * (1.0 - 1e-12)
