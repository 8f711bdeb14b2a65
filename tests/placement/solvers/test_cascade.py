"""The cheap score picks poses, the objective picks cameras."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from placement.constraints import Constraints
from placement.problem import Problem
from placement.solve import solve
from placement.solvers.cascade import best_poses

Make = Callable[..., Any]


def with_scores(problem: Problem, scores: np.ndarray) -> Problem:
    return replace(problem, cheap_scores=lambda: scores)


def mounts_of_five(new_problem: Make, **kwargs: Any) -> Problem:
    problem = new_problem(np.random.default_rng(1), n_candidates=15, **kwargs)
    group = np.repeat([0, 1, 2], 5)
    return replace(problem, constraints=replace(problem.constraints, group=group))


def test_three_poses_of_each_mount_are_kept_the_lower_index_on_a_tie(new_problem: Make) -> None:
    problem = mounts_of_five(new_problem, forbidden=(2,))
    scores = np.array([1, 2, 9, 3, 4, 5, 5, 5, 5, 5, 0, 0, 1, 1, 0], dtype=float)
    assert best_poses(problem, scores).tolist() == [1, 3, 4, 5, 6, 7, 10, 12, 13]


def test_candidates_without_a_mount_are_all_kept(new_problem: Make) -> None:
    problem = new_problem(np.random.default_rng(2))
    assert len(best_poses(problem, np.zeros(10))) == 10


def test_only_poses_the_score_kept_are_chosen(new_problem: Make) -> None:
    problem = mounts_of_five(new_problem, budget=3)
    scores = -np.arange(15.0)
    solution = solve(with_scores(problem, scores), "cascade")
    assert set(solution.selected) <= {0, 1, 2, 5, 6, 7, 10, 11, 12}
    assert solution.stats["poses_kept"] == 9


def test_a_required_pose_stays_whatever_its_score(new_problem: Make) -> None:
    problem = mounts_of_five(new_problem, budget=3, required=(4,))
    assert 4 in solve(with_scores(problem, -np.arange(15.0)), "cascade").selected


def test_the_bound_over_the_poses_kept_is_not_passed_off_as_one_over_all(
    new_problem: Make, brute_force: Make
) -> None:
    problem = mounts_of_five(new_problem, budget=3)
    best, placement = brute_force(problem)
    worst = np.ones(15)
    worst[list(placement)] = 0.0  # dismiss what the best placement is made of
    solution = solve(with_scores(problem, worst), "cascade")
    assert solution.value < best
    assert solution.bound is None


def test_a_constraint_type_is_untouched(new_problem: Make) -> None:
    problem = mounts_of_five(new_problem, budget=2)
    solve(problem, "cascade")
    assert isinstance(problem.constraints, Constraints)
    assert problem.constraints.forbidden.size == 0
