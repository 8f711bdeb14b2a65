"""Crossing placements: never worse, always allowed, and nothing left that would help."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.synthetic_drives import random_drive
from models.geometry import IntArray
from placement.constraints import Constraints
from placement.objectives.entropy import Entropy
from placement.objectives.trace import Trace
from placement.problem import Problem, Run
from placement.solvers.crossing import breed, cross, meet, new_placement
from placement.solvers.nearby import number_places

NONE = np.empty(0, dtype=np.int64)
N = 24


def draw(seed: int) -> Problem:
    rng = np.random.default_rng(seed)
    drive = random_drive(rng, n_samples=40, n_candidates=N, offsets=2 if seed % 4 == 0 else 0)
    objective = Trace([drive]) if seed % 3 == 0 else Entropy([drive])
    group = np.arange(N) // 2
    required = np.array([5]) if seed % 2 else NONE
    constraints = Constraints(N, 7, group, required, np.array([6]))
    if seed % 3 == 1:
        place = np.repeat(np.arange(N // 4) * 10.0, 4)
        constraints = replace(constraints, place_m=np.stack([place, 0.0 * place], axis=1))
        constraints = replace(constraints, separation_m=15.0, budget=3)
    return Problem(objective, constraints, np.repeat(np.arange(N // 4) * 10.0, 4), 60.0)


def score(problem: Problem, selected: list[int]) -> float:
    value = problem.objective.value(np.array(selected, dtype=np.int64))
    return value if problem.objective.maximise else -value


def places(problem: Problem) -> IntArray:
    place = number_places(problem)
    assert place is not None
    return place


def test_no_stretch_is_left_that_would_help() -> None:
    for seed in range(60):
        problem = draw(seed)
        place, run = places(problem), Run(np.random.default_rng(seed))
        one, other = (new_placement(problem, run, place) for _ in range(2))
        found, reached = cross(problem, run, place, one, other)
        assert not problem.constraints.violations(found)
        assert reached == pytest.approx(score(problem, found), rel=1e-12)
        assert reached >= score(problem, one)
        for u in range(place.max() + 1):
            for v in range(u + 1, place.max() + 2):
                out, into = ({i for i in s if u <= place[i] < v} for s in (found, other))
                mixed = sorted((set(found) - out) | into)
                if len(out) == len(into) and not problem.constraints.violations(mixed):
                    assert score(problem, mixed) <= reached + 1e-9 * abs(reached)


def test_breeding_keeps_the_rules_and_never_loses() -> None:
    for seed in range(8):
        problem = draw(seed)
        run = Run(np.random.default_rng(seed))
        state = problem.objective.state(
            np.array(new_placement(problem, run, places(problem)), dtype=np.int64)
        )
        before = state.score
        assert breed(problem, run, state) >= 1
        assert state.score >= before - 1e-12 * abs(before)
        assert not problem.constraints.violations(state.selected)


def test_who_meets_another_ends_no_worse_than_either() -> None:
    for seed in range(12):
        problem = draw(seed)
        run = Run(np.random.default_rng(seed))
        one, other = (new_placement(problem, run, places(problem)) for _ in range(2))
        state = problem.objective.state(np.array(one, dtype=np.int64))
        meet(problem, run, state, other)
        worse = max(score(problem, one), score(problem, other))
        assert state.score >= worse - 1e-12 * abs(worse)
        assert not problem.constraints.violations(state.selected)


def test_without_a_road_or_without_time_nothing_changes() -> None:
    problem = draw(1)
    state = problem.objective.state(np.array([5, 9]))
    bare = replace(problem, arc_length_m=None)
    assert breed(bare, Run(np.random.default_rng(0)), state) == 0
    assert breed(problem, Run(np.random.default_rng(0), deadline=0.0), state) == 0
    assert sorted(state.selected) == [5, 9]
