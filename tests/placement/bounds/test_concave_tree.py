"""Branching on the relaxation, against brute force: no bound below the best, and it gets there."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from benchmarks.synthetic_drives import random_drive
from models.geometry import FloatArray, IntArray
from placement.bounds.concave import best_fraction
from placement.bounds.concave_tree import decided, feasible, split_until
from placement.bounds.matroid import Choice, best_choice, root_choice
from placement.constraints import Constraints
from placement.objectives.entropy import Entropy
from placement.problem import Run

NONE = np.empty(0, dtype=np.int64)


def draw(seed: int, n: int) -> tuple[Entropy, Constraints]:
    rng = np.random.default_rng(seed)
    drives = [
        random_drive(rng, n_samples=16, n_candidates=n, offsets=2) for _ in range(1 + seed % 2)
    ]
    group = np.arange(n) // 2 if seed % 3 else np.full(n, -1)
    required = np.array([seed % n]) if seed % 4 == 0 else NONE
    forbidden = np.array([(seed + 3) % n]) if seed % 5 == 0 else NONE
    return Entropy(drives), Constraints(n, 1 + seed % 4, group, required, forbidden)


def best_score(objective: Entropy, constraints: Constraints) -> float:
    return max(
        objective.value(np.array(s, dtype=np.int64))
        for r in range(constraints.budget + 1)
        for s in itertools.combinations(range(constraints.n), r)
        if not constraints.violations(s)
    )


def hold_the_tree_against_brute_force(seed: int, n: int) -> None:
    objective, constraints = draw(seed, n)
    best = best_score(objective, constraints)
    choice = root_choice(constraints)
    run = Run(np.random.default_rng(seed))
    # from the optimum of the relaxation, or from anywhere else: both are certified
    x = best_fraction(objective, choice, run).x
    if seed % 2:
        x = feasible(choice, np.random.default_rng(seed).uniform(0.0, 0.5, n), np.ones(n))
    for beat in (best, 0.95 * best):
        reported: list[float] = []
        offered: list[IntArray] = []
        split_until(
            objective, choice, x, run, beat=beat, report=reported.append, offer=offered.append
        )
        assert min(reported, default=math.inf) >= best * (1.0 - 1e-12)
        assert reported == sorted(reported, reverse=True)
        if reported:
            assert reported[-1] <= best * (1.0 + 1e-6)
        if reported and beat < best * (1.0 - 1e-6):
            found = [s for s in offered if not constraints.violations(s)]
            assert max(objective.value(s) for s in found) >= best * (1.0 - 1e-9)


@pytest.mark.parametrize("block", range(4))
def test_no_bound_is_below_the_best_and_the_last_one_is_the_best(block: int) -> None:
    for seed in range(50 * block, 50 * (block + 1)):
        hold_the_tree_against_brute_force(seed, 6)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_nor_of_two_thousand(block: int) -> None:
    for seed in range(1000 + 200 * block, 1200 + 200 * block):
        hold_the_tree_against_brute_force(seed, 9)


def worths(seed: int) -> tuple[Choice, FloatArray]:
    rng = np.random.default_rng(seed)
    n = 8
    group = rng.integers(-1, 4, n)
    constraints = Constraints(n, int(rng.integers(1, 5)), group, NONE, NONE)
    return root_choice(constraints), rng.uniform(-0.2, 1.0, n)


def test_what_is_decided_keeps_every_sum_within_the_margin() -> None:
    for seed in range(300):
        choice, worth = worths(seed)
        chosen, loss = best_choice(choice, worth)
        most = float(np.random.default_rng(seed + 1).uniform(0.0, 0.6))
        after = decided(choice, worth, chosen, loss, most)
        for r in range(choice.budget + 1):
            for s in itertools.combinations(range(worth.size), r):
                members = np.array(s, dtype=np.int64)
                if np.unique(choice.group[members]).size < r:
                    continue
                if worth[members].sum() >= worth[chosen].sum() - most + 1e-12:
                    assert after.allowed[members].all()
                    assert np.isin(np.flatnonzero(after.used), choice.group[members]).all()


def test_a_start_is_a_fractional_choice() -> None:
    rng = np.random.default_rng(0)
    for seed in range(100):
        choice, worth = worths(seed)
        chosen, loss = best_choice(choice, worth)
        choice = decided(choice, worth, chosen, loss, 0.3)
        x = feasible(choice, rng.uniform(0.0, 1.0, worth.size), worth)
        held = np.bincount(choice.group, x, len(choice.used))
        assert np.sum(x) <= choice.budget + 1e-12
        assert held[choice.used] == pytest.approx(1.0)
        assert not np.any(x[~choice.allowed])
