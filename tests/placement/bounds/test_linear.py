"""The best sum against enumeration."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from placement.bounds.linear import best_sum
from placement.constraints import Constraints, count_only


@pytest.mark.parametrize("seed", range(60))
def test_the_best_sum_equals_enumeration(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 9
    group = rng.integers(-1, 4, n)
    order = rng.permutation(n)
    required = order[:1] if seed % 2 else order[:0]
    constraints = Constraints(n, int(rng.integers(1, 6)), group, required, np.sort(order[1:3]))
    worth = rng.integers(-2, 6, n).astype(float)  # small integers: plenty of ties
    best = max(
        sum(worth[list(s)])
        for size in range(n + 1)
        for s in itertools.combinations(range(n), size)
        if not constraints.violations(s)
    )
    selected, total = best_sum(constraints, worth)
    assert not constraints.violations(selected)
    assert total == best == np.sum(worth[selected])


def test_nothing_worth_having_is_not_taken() -> None:
    selected, total = best_sum(count_only(3, 2), np.array([-1.0, 0.0, -2.0]))
    assert selected.size == 0
    assert total == 0.0


def test_a_budget_of_nothing_gives_nothing() -> None:
    assert best_sum(count_only(3, 0), np.ones(3))[1] == 0.0
