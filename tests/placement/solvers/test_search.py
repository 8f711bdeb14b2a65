"""Rearranging stretches of road: what swaps alone cannot do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from placement.constraints import count_only
from placement.information import Information
from placement.objectives.localisation import Localisation
from placement.problem import Problem, Run
from placement.solution import Status
from placement.solve import solve
from placement.solvers.nearby import number_places
from placement.solvers.search import Kicks

Make = Callable[..., Any]


def windows(n: int, length: int, budget: int) -> Problem:
    """Place a candidate at every metre, each seeing `length` samples from its own on."""
    indices = np.concatenate([np.arange(i, i + length) for i in range(n)]).astype(np.int32)
    J = np.full((len(indices), 1), 1e4, np.float32)
    info = Information(n + length - 1, np.arange(n + 1) * length, indices, J)
    f = Localisation(info, 0.5)
    return Problem(f, count_only(n, budget), np.arange(float(n)), float(n + length - 1))


def test_cameras_that_crowd_spread_until_none_overlaps() -> None:
    problem = windows(41, 10, 4)
    f, place = problem.objective, number_places(problem)
    assert place is not None
    state = f.state(np.array([0, 9, 18, 27]))
    Kicks(problem, Run(np.random.default_rng(0)), state, place).work()
    assert state.score == pytest.approx(f.value(np.array([0, 10, 20, 30])), rel=1e-12)


def test_where_money_is_short_a_dear_camera_gives_way_to_cheap_ones() -> None:
    """Two cameras at 3 see 6 m each; for the same money six at 1 see 4 m: no swap gets there."""
    n, place = 30, np.repeat(np.arange(30.0), 2)
    begin, length = np.arange(2 * n) // 2, np.tile([6, 4], n)
    indices = np.concatenate([np.arange(b, b + m) for b, m in zip(begin, length, strict=True)])
    indptr = np.concatenate([[0], np.cumsum(length)])
    J = np.full((len(indices), 1), 1e4, np.float32)
    f = Localisation(Information(n + 6, indptr, indices.astype(np.int32), J), 0.5)
    priced = replace(count_only(2 * n, n), cost=np.tile([3.0, 1.0], n), money=6.0)
    problem = Problem(f, priced, place, n + 6.0)
    numbers = number_places(problem)
    assert numbers is not None
    state = f.state(np.array([0, 20]))
    Kicks(problem, Run(np.random.default_rng(0)), state, numbers).work()
    assert state.score == pytest.approx(f.value(np.arange(1, 60, 10)), rel=1e-12)
    assert not priced.violations(state.selected)


def test_it_is_never_worse_than_exchange_and_sometimes_better(
    new_information: Make, new_toy: Make
) -> None:
    better = 0
    for seed in range(8):
        rng = np.random.default_rng([5, seed])
        toy = new_toy(new_information(rng, 24, 48, scale=2.0))
        problem = Problem(toy, count_only(24, 5), np.arange(24.0) * 2.0, 48.0)
        exchange, search = (solve(problem, m, seed=seed).value for m in ("exchange", "search"))
        assert search <= exchange
        better += search < exchange * (1.0 - 1e-6)
    assert better > 0


def test_a_kick_that_fails_is_undone(new_problem: Make) -> None:
    problem = new_problem(np.random.default_rng(1), n_candidates=30, groups=True, budget=4)
    found = solve(problem, "search")
    state = problem.objective.state(np.array(found.selected))
    place = number_places(problem)
    assert place is not None
    Kicks(problem, Run(np.random.default_rng(9)), state, place).work()
    assert problem.objective.value(np.array(state.selected)) >= found.value * (1.0 - 1e-12)
    assert not problem.constraints.violations(state.selected)


def test_without_a_road_it_is_exchange(new_problem: Make) -> None:
    problem = replace(new_problem(np.random.default_rng(2), n_candidates=25), arc_length_m=None)
    assert solve(problem, "search").selected == solve(problem, "exchange").selected


def test_required_cameras_are_not_kicked(new_problem: Make) -> None:
    problem = new_problem(np.random.default_rng(3), n_candidates=30, budget=5, required=(3, 20))
    assert {3, 20} <= set(solve(problem, "search").selected)


def test_out_of_time_it_still_has_the_uniform_placement(
    new_information: Make, new_toy: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(6)
    toy = new_toy(new_information(rng, 24, 48, scale=2.0))
    problem = Problem(toy, count_only(24, 5), np.arange(24.0) * 2.0, 48.0)
    # Time enough for the uniform placement, and none for greedy.
    monkeypatch.setattr(
        "placement.solvers.search.climb",
        lambda p, run: (setattr(run, "deadline", 0.0), (p.objective.state(), None, False))[1],
    )
    solution = solve(problem, "search")
    assert solution.selected == solve(problem, "uniform").selected
    assert solution.status is Status.TIME_LIMIT
