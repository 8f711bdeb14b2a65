"""The best fractional choice: certified, optimal, and never ruling out what is best."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from benchmarks.synthetic_drives import random_drive
from placement.bounds import concave
from placement.bounds.concave import best_fraction
from placement.bounds.matroid import root_choice
from placement.constraints import Constraints
from placement.objectives.entropy import Entropy
from placement.objectives.trace import Trace
from placement.problem import Run

NONE = np.empty(0, dtype=np.int64)


def new_run() -> Run:
    return Run(np.random.default_rng(0))


def draw(seed: int, n: int = 9, offsets: int = 0) -> tuple[Any, Constraints]:
    rng = np.random.default_rng(seed)
    drive = random_drive(rng, n_candidates=n, offsets=offsets)
    objective = Trace([drive]) if seed % 2 else Entropy([drive])
    group = np.arange(n) // 2 if seed % 3 else np.full(n, -1)
    required = np.array([seed % n]) if seed % 4 == 0 else NONE
    return objective, Constraints(n, 3, group, required, NONE)


def best(objective: Any, constraints: Constraints) -> tuple[float, tuple[int, ...]]:
    sign = 1.0 if objective.maximise else -1.0
    found = (
        (sign * objective.value(np.array(s, dtype=np.int64)), s)
        for r in range(constraints.budget + 1)
        for s in itertools.combinations(range(constraints.n), r)
        if not constraints.violations(s)
    )
    return max(found, key=lambda entry: entry[0])


@pytest.mark.parametrize("offsets", [0, 2])
def test_the_bound_is_above_every_placement_and_the_best_one_stays_in(offsets: int) -> None:
    for seed in range(12 if offsets else 40):
        objective, constraints = draw(seed, offsets=offsets)
        score, placement = best(objective, constraints)
        beat = score - 1e-6 * abs(score)
        found = best_fraction(objective, root_choice(constraints), new_run(), beat=beat)
        assert found.bound >= score - 1e-12 * abs(score)
        assert found.choice.allowed[list(placement)].all()


def test_it_is_optimal_and_feasible() -> None:
    for seed in range(20):
        objective, constraints = draw(seed, n=25)
        found = best_fraction(objective, root_choice(constraints), new_run(), tolerance=1e-7)
        assert found.bound - found.score <= 1e-6 * abs(found.score)
        assert found.x.min() >= 0.0
        assert found.x.sum() <= 3.0 + 1e-9
        assert np.bincount(root_choice(constraints).group, found.x).max() <= 1.0 + 1e-9
        assert found.x[constraints.required] == pytest.approx(1.0)


def test_learning_the_curvature_on_the_way_ends_at_the_same_bound(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    objective, constraints = draw(6, n=25)
    exact = best_fraction(objective, root_choice(constraints), new_run())
    monkeypatch.setattr(concave, "DEAR_S", 0.0)
    learnt = best_fraction(objective, root_choice(constraints), new_run())
    assert learnt.bound == pytest.approx(exact.bound, rel=1e-4)


@pytest.mark.parametrize("seed", [4, 6, 8, 10])
def test_curvature_that_is_told_ends_at_the_optimum(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    objective, constraints = draw(seed, n=25, offsets=3)
    monkeypatch.setattr(concave, "DEAR_S", 0.0)
    found = best_fraction(objective, root_choice(constraints), new_run(), tolerance=1e-7)
    assert found.bound - found.score <= 2e-7 * abs(found.score)


def test_striking_out_everyone_leaves_the_value_to_beat() -> None:
    objective, constraints = draw(6)
    found = best_fraction(objective, root_choice(constraints), new_run(), beat=1e6)
    assert not found.choice.allowed.any() or found.bound >= 1e6
    assert found.bound <= 1e6 * (1.0 + 1e-8)


def test_a_fraction_is_a_start_like_any_other() -> None:
    for seed in range(10):
        objective, constraints = draw(seed, n=25)
        choice = root_choice(constraints)
        whole = best_fraction(objective, choice, new_run())
        rough = best_fraction(objective, choice, new_run(), tolerance=0.3)
        again = best_fraction(objective, choice, new_run(), start=rough.x)
        assert again.score >= rough.score - 1e-9 * abs(rough.score)
        assert again.bound == pytest.approx(whole.bound, rel=1e-5)
