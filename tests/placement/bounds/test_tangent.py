"""Certificates against enumeration: no bound is below the best placement, whatever its source."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from models.geometry import FloatArray
from placement.bounds.cuts import CutMaker, joined
from placement.bounds.matroid import best_choice, root_choice, using, without
from placement.bounds.tangent import cut_bound, sum_up, tangent_bound
from placement.objectives.localisation import Localisation

Make = Callable[..., Any]


def draw(seed: int, new_problem: Make) -> tuple[Any, np.random.Generator]:
    rng = np.random.default_rng([30, seed])
    problem = new_problem(
        rng,
        n_candidates=int(rng.integers(1, 10)),
        n_samples=8,
        budget=int(rng.integers(1, 5)),
        groups=bool(seed % 3),
        isotropic=bool(seed % 2),
        required=(0,) if seed % 5 == 0 else (),
        scale=10.0 ** rng.uniform(-3, 4),
        spread=float(rng.uniform(0, 3)),
    )
    return problem, rng


def check_bounds(problem: Any, rng: np.random.Generator, best: float) -> None:
    n, t = problem.constraints.n, problem.objective.information.n_samples
    x = rng.uniform(size=n) * (rng.uniform(size=n) < 0.7)
    assert tangent_bound(problem.objective, problem.constraints, x) >= best * (1.0 - 1e-13)
    maker = CutMaker(problem.objective)
    chosen = np.flatnonzero(rng.uniform(size=n) < 0.3)
    cuts = joined([maker.submodular(chosen), maker.tangent(x), maker.submodular(chosen[:0])])
    multiplier = rng.normal(size=len(cuts))  # any multipliers: also negative and NaN ones
    multiplier[rng.uniform(size=len(cuts)) < 0.1] = np.nan
    bound, loss = cut_bound(cuts, multiplier, root_choice(problem.constraints), t)
    assert bound >= best * (1.0 - 1e-13)
    assert np.all(loss >= 0.0)


@pytest.mark.parametrize("seed", range(60))
def test_no_bound_is_below_the_best_placement(
    seed: int, new_problem: Make, brute_force: Make
) -> None:
    problem, rng = draw(seed, new_problem)
    check_bounds(problem, rng, brute_force(problem)[0])


@pytest.mark.slow
def test_no_bound_is_below_the_best_placement_on_2000_problems(
    new_problem: Make, brute_force: Make
) -> None:
    for seed in range(100, 2100):
        problem, rng = draw(seed, new_problem)
        check_bounds(problem, rng, brute_force(problem)[0])


def test_what_a_candidate_costs_the_bound_is_what_forcing_it_costs(new_problem: Make) -> None:
    for seed in range(40):
        problem, rng = draw(seed, new_problem)
        choice = root_choice(problem.constraints)
        if seed % 4 == 0:
            choice = using(choice, int(choice.group[rng.integers(len(choice.group))]))
        if seed % 4 == 1:
            choice = without(choice, rng.integers(len(choice.group), size=1))
        if not choice.feasible:
            continue
        worth = np.round(rng.uniform(-0.3, 1.0, len(choice.group)), 1)  # rounded, so ties occur
        selected, loss = best_choice(choice, worth)
        best = worth[selected].sum()
        for j in np.flatnonzero(choice.allowed):
            mates = (choice.group == choice.group[j]) & (np.arange(len(worth)) != j)
            forced = using(without(choice, mates), int(choice.group[j]))
            if not forced.feasible:
                assert loss[j] == np.inf
                continue
            assert best - worth[best_choice(forced, worth)[0]].sum() == pytest.approx(loss[j])


@dataclass
class SquareRoots:
    """A concave extension that is no `localisation`: Σ_t √(A_t · x)."""

    A: FloatArray

    def relaxed(self, x: FloatArray) -> tuple[float, FloatArray]:
        roots = np.sqrt(self.A @ x)
        return float(roots.sum()), (self.A / (2.0 * roots[:, None])).sum(axis=0)


def test_the_tangent_bounds_any_concave_extension(new_problem: Make) -> None:
    rng = np.random.default_rng(31)
    problem = new_problem(rng, n_candidates=8, budget=3)
    toy = SquareRoots(rng.uniform(size=(5, 8)))
    values = [toy.relaxed(x)[0] for x in np.eye(8)[:, None, :].sum(axis=1) + 1e-12]
    bound = tangent_bound(toy, problem.constraints, rng.uniform(0.1, 1.0, 8))
    assert bound >= max(values)


def test_sums_are_rounded_up() -> None:
    terms = np.array([1e16, 1.0, -1e16])
    assert sum_up(terms, 0.0) == 1.0
    assert sum_up(np.full(10, 0.1), 1e-16) > 1.0
    assert sum_up(np.zeros(3), 1e-12) == 0.0


def test_zero_information_has_the_bound_zero(new_problem: Make) -> None:
    from placement.information import Information

    nothing = Information(4, np.zeros(4, np.int64), np.empty(0, np.int32), np.empty((0, 1), "f4"))
    problem = new_problem(np.random.default_rng(32), n_candidates=3)
    assert tangent_bound(Localisation(nothing, 0.5), problem.constraints, np.full(3, 0.5)) == 0.0
