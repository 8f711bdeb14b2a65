"""Swaps: where they must help, and where they must stop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from placement.constraints import Constraints, count_only
from placement.information import Information
from placement.objectives.localisation import Localisation
from placement.problem import Problem
from placement.solve import solve

Make = Callable[..., Any]


def test_swaps_mend_what_greedy_gets_wrong() -> None:
    # The middle camera sees most, but the two that share the road between them are the best pair.
    rows = [np.arange(0, 10), np.arange(10, 20), np.arange(4, 16)]
    info = Information(
        20,
        np.array([0, 10, 20, 32]),
        np.concatenate(rows).astype(np.int32),
        np.full((32, 1), 50.0, np.float32),
    )
    problem = Problem(Localisation(info, 0.5), count_only(3, 2))
    assert 2 in solve(problem, "greedy").selected
    solution = solve(problem, "exchange")
    assert solution.selected == (0, 1)
    assert solution.stats["swaps"] == 1
    assert solution.stats["greedy_value"] == solve(problem, "greedy").value


def test_no_single_swap_improves_the_end(new_problem: Make) -> None:
    for seed in range(10):
        problem = new_problem(
            np.random.default_rng(seed),
            n_candidates=18,
            n_samples=40,
            budget=5,
            groups=True,
            required=(7,),
        )
        f, chosen = problem.objective, solve(problem, "exchange").selected
        value = f.value(np.array(chosen))
        for out in set(chosen) - {7}:
            rest = [i for i in chosen if i != out]
            for new in np.flatnonzero(problem.constraints.addable(np.array(rest))):
                assert f.value(np.array([*rest, new])) <= value * (1.0 + 1e-9)


def test_a_pair_that_only_pays_together_is_beyond_swaps_but_harm_is_taken_out(
    new_information: Make, new_toy: Make
) -> None:
    rng = np.random.default_rng(3)
    toy = new_toy(new_information(rng, 12, 30, scale=3.0))
    none = np.empty(0, dtype=np.int64)
    problem = Problem(toy, Constraints(12, 4, np.full(12, -1), none, none))
    assert solve(problem, "exchange").value <= solve(problem, "greedy").value


def test_swaps_help_on_some_small_filter_problem(new_information: Make, new_toy: Make) -> None:
    improved = 0
    for seed in range(20):
        toy = new_toy(new_information(np.random.default_rng([4, seed]), 12, 30, scale=3.0))
        problem = Problem(toy, count_only(12, 3))
        greedy, exchange = (solve(problem, m).value for m in ("greedy", "exchange"))
        assert exchange <= greedy
        improved += exchange < greedy * (1.0 - 1e-6)
    assert improved > 0
