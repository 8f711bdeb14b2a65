"""Equal spacing, the best pose at each place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from placement.constraints import Constraints, count_only
from placement.information import Information
from placement.objectives.localisation import Localisation
from placement.problem import Problem
from placement.solve import solve

NONE = np.empty(0, dtype=np.int64)


def straight(worth: np.ndarray, constraints: Constraints) -> Problem:
    """Put two poses every 10 m along 100 m; candidate i sees its own sample alone."""
    n = len(worth)
    info = Information(
        n, np.arange(n + 1), np.arange(n, dtype=np.int32), worth[:, None].astype(np.float32)
    )
    return Problem(
        Localisation(info, 0.5), constraints, np.repeat(np.arange(5.0, 100, 10), 2), 100.0
    )


def test_cameras_stand_at_equal_spacing_each_with_its_better_pose() -> None:
    worth = np.tile([1.0, 2.0], 10)
    worth[4:6] = [3.0, 2.0]
    solution = solve(straight(worth, count_only(20, 2)), "uniform")
    assert solution.selected == (4, 15)  # at 25 m the even pose is better, at 75 m the odd one
    assert solution.bound is None


def test_a_tie_of_poses_goes_to_the_first() -> None:
    assert solve(straight(np.ones(20), count_only(20, 1)), "uniform").selected == (8,)


def test_a_required_camera_takes_the_place_nearest_to_it() -> None:
    group = np.repeat(np.arange(10), 2)
    constraints = Constraints(20, 2, group, np.array([3]), NONE)
    solution = solve(straight(np.ones(20), constraints), "uniform")
    assert solution.selected == (3, 14)


def test_places_whose_mounts_are_forbidden_go_to_the_next() -> None:
    constraints = Constraints(20, 2, np.full(20, -1), NONE, np.array([4, 5]))
    assert solve(straight(np.ones(20), constraints), "uniform").selected == (2, 14)


def test_a_problem_without_a_road_is_refused(new_problem: Callable[..., Any]) -> None:
    bare = replace(new_problem(np.random.default_rng(0)), arc_length_m=None)
    with pytest.raises(ValueError, match="needs candidates along a road"):
        solve(bare, "uniform")
