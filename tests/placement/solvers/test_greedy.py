"""Greedy's steps, its laziness and its bound."""

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
from placement.solvers import greedy
from placement.solvers.greedy import climb

Make = Callable[..., Any]


def plain_greedy(problem: Problem) -> list[int]:
    """Add the best camera by values from scratch, in the dullest way."""
    selected = sorted(int(i) for i in problem.constraints.required)
    while True:
        here = problem.objective.value(np.array(selected, dtype=np.int64))
        addable = np.flatnonzero(problem.constraints.addable(np.array(selected, dtype=np.int64)))
        gains = {int(i): problem.objective.value(np.array([*selected, i])) - here for i in addable}
        if not gains or max(gains.values()) <= 1e-12:
            return selected
        selected.append(max(gains, key=lambda i: gains[i]))


@pytest.mark.parametrize("seed", range(10))
def test_lazy_greedy_takes_the_steps_of_plain_greedy(seed: int, new_problem: Make) -> None:
    problem = new_problem(
        np.random.default_rng(seed),
        n_candidates=150,  # more than a batch
        n_samples=60,
        budget=10,
        groups=bool(seed % 2),
        isotropic=seed % 3 == 0,
        required=(17, 3) if seed % 2 else (),
    )
    state, upper, finished = climb(problem, Run(np.random.default_rng(0)))
    assert finished
    assert state.selected == plain_greedy(problem)
    assert upper.evaluations < 150 * 11


@pytest.mark.parametrize(("step", "winner"), [(1e-12, 0), (1e-6, 2)])
def test_gains_apart_by_rounding_alone_go_to_the_lower_index(step: float, winner: int) -> None:
    J = np.full((3, 1), 5.0, np.float32)
    info = Information(3, np.arange(4), np.arange(3, dtype=np.int32), J)
    f = Localisation(info, 0.5, [1.0, 1.0 - step, 1.0 + step])
    run = Run(np.random.default_rng(0))
    assert climb(Problem(f, count_only(3, 1)), run)[0].selected == [winner]


def test_the_bound_is_exact_where_cameras_do_not_overlap() -> None:
    n = 40
    J = np.linspace(1.0, 9.0, n, dtype=np.float32)[:, None]
    info = Information(n, np.arange(n + 1), np.arange(n, dtype=np.int32), J)
    problem = Problem(Localisation(info, 0.5), count_only(n, 5))
    run = Run(np.random.default_rng(0))
    state, _, _ = climb(problem, run)
    assert sorted(state.selected) == [35, 36, 37, 38, 39]
    assert run.score_bound == pytest.approx(state.score, rel=1e-13)


class Pairs:
    """Worth 1 a camera, and 10 more where both of a pair (2i, 2i + 1) stand; not submodular."""

    name, unit, maximise, submodular, n_candidates = "pairs", "points", True, False, 6

    def value(self, selected: np.ndarray) -> float:
        pairs, counts = np.unique(np.asarray(selected) // 2, return_counts=True)
        return float(np.sum(counts) + 10.0 * np.sum(counts == 2) + 0.1 * np.any(pairs == 1))

    def state(self, selected: np.ndarray | None = None) -> PairsState:
        return PairsState(self, [] if selected is None else list(selected))


class PairsState:
    def __init__(self, objective: Pairs, selected: list[int]) -> None:
        self.objective, self.selected = objective, selected

    @property
    def score(self) -> float:
        return self.objective.value(np.array(self.selected, dtype=np.int64))

    def gains(self, candidates: np.ndarray | None = None) -> np.ndarray:
        rows = np.arange(6) if candidates is None else candidates
        both = [np.union1d(self.selected, [i]).astype(np.int64) for i in rows]
        return np.array([self.objective.value(s) for s in both]) - self.score

    def add(self, candidate: int) -> None:
        self.selected = [*self.selected, candidate]

    def remove(self, candidate: int) -> None:
        self.selected = [i for i in self.selected if i != candidate]


def test_gains_that_grow_are_seen_where_the_objective_is_not_submodular() -> None:
    run = Run(np.random.default_rng(0))
    state, _, _ = climb(Problem(Pairs(), count_only(6, 3)), run)
    # 2 is worth most alone; then 3, which had been worth no more than any other, completes it.
    assert state.selected == [2, 3, 0]
    assert run.score_bound is None


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("money", [False, True])
def test_a_pool_of_the_promising_changes_no_step(
    seed: int, money: bool, new_problem: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng([seed, money])
    problem = new_problem(rng, n_candidates=300, n_samples=80, budget=25, groups=bool(seed % 2))
    if money:
        prices = replace(problem.constraints, cost=rng.uniform(0.5, 2.0, 300), money=15.0)
        problem = replace(problem, constraints=prices)
    whole = climb(problem, Run(np.random.default_rng(0)))[0].selected
    monkeypatch.setattr(greedy, "_POOL", 7)
    assert climb(problem, Run(np.random.default_rng(0)))[0].selected == whole


def test_bounds_made_every_few_steps_hold_and_end_with_the_last(
    new_problem: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = new_problem(np.random.default_rng(1), n_candidates=60, n_samples=60, budget=10)
    every = Run(np.random.default_rng(0))
    state = climb(problem, every)[0]
    monkeypatch.setattr(greedy, "_BOUND_WORK", 150)
    some = Run(np.random.default_rng(0))
    climb(problem, some)
    assert every.score_bound is not None
    assert some.score_bound is not None
    assert state.score <= every.score_bound <= some.score_bound
    assert some.score_bound <= every.score_bound * 1.2
