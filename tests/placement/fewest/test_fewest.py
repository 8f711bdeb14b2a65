"""The method finds the fewest cameras of tiny roads, proves them, and keeps every rule."""

import math

import numpy as np
import pytest

from placement.constraints import Constraints, count_only
from placement.fewest.beam import Beam
from placement.objectives.tolerance import Tolerance
from placement.problem import Problem
from placement.solution import Status
from placement.solve import solve
from tests.placement.fewest.tiny_roads import C, best_price, counting_of, tiny, tiny_drive


@pytest.mark.parametrize("failures", [0, 1])
def test_the_method_finds_and_proves_the_fewest(failures: int) -> None:
    proven = 0
    for seed in range(14):
        objective = tiny(np.random.default_rng([7, failures, seed]), failures)
        best = best_price(objective)
        solution = solve(Problem(objective, count_only(C, C)), time_limit_s=20.0)
        assert solution.stats["chosen"] == "tolerance"
        assert solution.value == best, seed
        assert solution.bound is not None
        assert solution.bound <= best
        proven += solution.status is Status.OPTIMAL
    assert proven >= (7 if not failures else 5)


def test_the_cheapest_not_the_fewest_where_cameras_have_prices() -> None:
    for seed in range(7):
        rng = np.random.default_rng([3, seed])
        cost = rng.choice([0.0, 100.0, 150.0, 400.0], C) if seed % 2 else rng.uniform(1.0, 9.0, C)
        objective = tiny(rng, seed % 3 == 0, cost)
        best = best_price(objective)
        solution = solve(Problem(objective, count_only(C, C)), time_limit_s=20.0)
        assert solution.unit == "money"
        assert solution.bound is not None
        assert solution.bound <= best * (1.0 + 1e-9) + 1e-9, seed
        assert solution.value <= 1.3 * best + 1e-9, seed
        counting, unit = counting_of(objective)
        counting.prove(100, lambda: False)
        assert unit * counting.need <= best * (1.0 + 1e-9), seed


def test_persistent_errors_are_bounded_by_cameras_whose_offsets_are_known() -> None:
    for seed in range(10):
        objective = tiny(np.random.default_rng([4, seed]), seed % 2, offsets=2)
        best = best_price(objective)
        solution = solve(Problem(objective, count_only(C, C)), time_limit_s=20.0)
        assert solution.value == best, seed
        assert solution.bound is not None
        assert solution.bound <= best
        counting, _ = counting_of(objective)
        counting.prove(C + 1, lambda: False)
        assert counting.need <= best, seed
        assert "offset" in solution.stats["bound_relaxes"]


def test_every_drive_must_be_in_tolerance() -> None:
    for seed in range(8):
        objective = tiny(np.random.default_rng([5, seed]), drives=2)
        solution = solve(Problem(objective, count_only(C, C)), time_limit_s=20.0)
        assert solution.value == best_price(objective), seed
        assert solution.bound is not None
        assert solution.bound <= solution.value


def test_groups_required_and_forbidden_poses_are_kept() -> None:
    none = np.empty(0, dtype=np.int64)
    for seed in range(12):
        objective = tiny(np.random.default_rng([6, seed]))
        group = np.arange(C) // 2
        constraints = Constraints(C, C, group, np.array([2]), none)
        best = best_price(objective, constraints)
        solution = solve(Problem(objective, constraints), time_limit_s=20.0)
        if math.isinf(best):
            assert solution.status is Status.INFEASIBLE
            continue
        assert 2 in solution.selected
        assert solution.bound is not None
        assert solution.bound <= best
        assert solution.value <= best + 1


def test_what_is_in_tolerance_already_needs_no_camera() -> None:
    drive = tiny_drive(np.random.default_rng(0))
    for failures in (0, 1):
        objective = Tolerance([drive], 1e6, failures)
        solution = solve(Problem(objective, count_only(C, C)))
        assert solution.status is Status.OPTIMAL
        assert (solution.selected, solution.value, solution.bound) == ((), 0.0, 0.0)


def test_too_small_a_budget_is_infeasible_in_clear_words() -> None:
    seen = 0
    for seed in range(30):
        objective = tiny(np.random.default_rng([8, seed]))
        best = best_price(objective)
        if best < 2 or best > C:
            continue
        solution = solve(Problem(objective, count_only(C, int(best) - 1)), time_limit_s=20.0)
        assert solution.status is Status.INFEASIBLE
        assert solution.selected == ()
        assert f"at most budget.cameras = {int(best) - 1}" in solution.stats["reason"]
        assert "are known to do" in solution.stats["reason"]
        seen += 1
    assert seen >= 5


def test_other_methods_either_meet_the_tolerance_or_say_that_they_did_not() -> None:
    met = 0
    for seed in range(6):
        objective = tiny(np.random.default_rng([9, seed]), seed % 2)
        best = best_price(objective)
        for method in ("greedy", "exchange", "search"):
            problem = Problem(objective, count_only(C, C), np.linspace(0.0, 30.0, C), 40.0)
            solution = solve(problem, method)
            if solution.status is Status.INFEASIBLE:
                assert "nothing in tolerance was found" in solution.stats["reason"]
            else:
                assert solution.value >= best
                met += 1
    assert met >= 12


def test_no_time_gives_a_placement_with_a_bound_and_a_stopped_beam_nothing() -> None:
    objective = tiny(np.random.default_rng(12))
    hurried = solve(Problem(objective, count_only(C, C)), time_limit_s=0.0)
    assert hurried.status in (Status.TIME_LIMIT, Status.OPTIMAL)
    assert hurried.bound is not None
    assert hurried.bound <= best_price(objective) <= hurried.value
    assert Beam(objective, count_only(C, C), 3, lambda: True).search() is None


def test_other_objectives_are_refused(new_problem) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError, match="method tolerance needs the objective tolerance"):
        solve(new_problem(np.random.default_rng(0)), "tolerance")
