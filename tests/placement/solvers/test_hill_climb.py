"""Climbing one pose at a time, from random starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from placement.constraints import count_only
from placement.information import Information
from placement.objectives.localisation import Localisation
from placement.problem import Problem
from placement.solve import solve
from placement.solvers.hill_climb import RESTARTS

Make = Callable[..., Any]


def hill(worth: np.ndarray, places: np.ndarray | None) -> Problem:
    """Let candidate i see its own sample alone, and one camera stand."""
    n = len(worth)
    info = Information(
        n, np.arange(n + 1), np.arange(n, dtype=np.int32), worth[:, None].astype(np.float32)
    )
    return Problem(Localisation(info, 0.5), count_only(n, 1), places, float(n))


def test_a_camera_walks_along_the_road_to_the_summit() -> None:
    worth = np.concatenate([np.arange(1.0, 101.0), np.arange(99.0, 0.0, -1.0)])
    solution = solve(hill(worth, np.arange(199.0)), "hill-climb")
    assert solution.selected == (99,)
    assert solution.stats["restarts"] == RESTARTS


def test_a_lower_summit_holds_whoever_starts_beside_it() -> None:
    worth = np.concatenate([np.arange(1.0, 101.0), np.arange(100.0, 0.0, -1.0)])
    worth[150] = 200.0
    solution = solve(hill(worth, np.arange(200.0)), "hill-climb")
    assert solution.stats["mean_score"] < solution.value * (1.0 - 1e-6)


def test_without_a_road_any_candidate_is_near() -> None:
    worth = np.ones(50)
    worth[31] = 9.0
    assert solve(hill(worth, None), "hill-climb").selected == (31,)


def test_it_beats_the_random_placement_it_starts_from(new_problem: Make) -> None:
    for seed in range(10):
        problem = new_problem(np.random.default_rng(seed), n_candidates=30, groups=True, budget=5)
        climbed, drawn = (solve(problem, m, seed=seed).value for m in ("hill-climb", "random"))
        assert climbed >= drawn


def test_another_seed_is_another_start(new_problem: Make) -> None:
    problem = new_problem(np.random.default_rng(3), n_candidates=40, n_samples=80, budget=8)
    problem = replace(problem, arc_length_m=np.arange(40.0))
    scores = {solve(problem, "hill-climb", seed=s).stats["mean_score"] for s in range(4)}
    assert len(scores) > 1
