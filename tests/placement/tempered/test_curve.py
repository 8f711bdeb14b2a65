"""Chain bounds of all budgets in one run, against brute force for each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from placement.budget_curve import budget_curve
from placement.problem import Problem
from placement.tempered import curve
from placement.tempered.curve import chain_bounds
from tests.placement.tempered.test_bound import best_placement, new_run, small_problem


@pytest.mark.parametrize("offsets", [0, 2])
def test_every_budget_is_bounded(offsets: int) -> None:
    tight = 0
    for seed in range(20):
        objective, constraints = small_problem(seed, offsets)
        if constraints.budget < constraints.required.size or not constraints.budget:
            continue
        found = chain_bounds(Problem(objective, constraints), objective, new_run())
        assert len(found) == constraints.budget + 1
        for k in range(constraints.required.size, constraints.budget + 1):
            best, _ = best_placement(objective, replace(constraints, budget=k))
            assert found[k] >= best - 1e-12
            tight += found[k] <= best * (1.0 + 1e-6) + 1e-9
    assert tight > 20  # one camera always, two often


def test_a_curve_of_entropy_is_bounded_by_chains_too(monkeypatch: pytest.MonkeyPatch) -> None:
    objective, constraints = small_problem(8)
    problem = Problem(objective, replace(constraints, budget=4))
    asked = []

    def noted(*given):  # type: ignore[no-untyped-def]
        asked.append(chain_bounds(*given))
        return asked[-1]

    monkeypatch.setattr(curve, "chain_bounds", noted)
    found = budget_curve(problem, 2, 4)
    assert len(asked) == 1
    for k, solution in zip((2, 3, 4), found.solutions, strict=True):
        best, _ = best_placement(objective, replace(constraints, budget=k))
        assert solution.bound is not None
        assert best <= solution.bound <= asked[0][k] * (1.0 + 1e-6) + 1e-6


def test_too_many_candidates_have_no_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    objective, constraints = small_problem(8)
    monkeypatch.setattr(curve, "MOST_CANDIDATES", 1)
    assert np.all(np.isinf(chain_bounds(Problem(objective, constraints), objective, new_run())))
