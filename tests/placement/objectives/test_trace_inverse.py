"""The trace of the inverse against definitions and differences."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from placement.constraints import count_only
from placement.objectives.base import Relaxable
from placement.objectives.trace_inverse import TraceInverse
from placement.problem import Problem
from placement.solution import Status
from placement.solve import solve


def gaussian(seed: int, c: int = 10, n: int = 3, r: int = 1, prior: float = 0.1) -> TraceInverse:
    rng = np.random.default_rng(seed)
    return TraceInverse(prior * np.eye(n), rng.normal(size=(c, n, r)))


@pytest.mark.parametrize("r", [1, 3])
@pytest.mark.parametrize("prior", [1e-4, 1.0])
def test_gains_are_differences_of_the_value_through_adding_and_removing(
    r: int, prior: float
) -> None:
    f = gaussian(1, r=r, prior=prior)
    rng = np.random.default_rng(2)
    state = f.state()
    for step in range(30):
        inside = state.selected
        if inside and (len(inside) > 7 or rng.uniform() < 0.4):
            state.remove(int(rng.choice(inside)))
        else:
            state.add(int(rng.choice(np.setdiff1d(np.arange(10), inside))))
        here = f.value(np.array(state.selected, dtype=np.int64))
        assert state.score == pytest.approx(-here, rel=1e-9)
        asked = rng.choice(10, 4) if step % 2 else np.arange(10)
        for i, gain in zip(asked, state.gains(asked), strict=True):
            after = f.value(np.union1d(state.selected, [i]).astype(np.int64))
            assert gain == pytest.approx(here - after, rel=1e-7, abs=1e-8 * here)


@pytest.mark.parametrize("r", [1, 3])
def test_the_relaxation_extends_the_score_and_its_gradient_is_its_slope(r: int) -> None:
    f = gaussian(3, r=r)
    assert isinstance(f, Relaxable)
    x = np.random.default_rng(4).uniform(0.2, 0.8, 10)
    _, gradient = f.relaxed(x)
    h = 1e-6
    slopes = [(f.relaxed(x + h * e)[0] - f.relaxed(x - h * e)[0]) / (2.0 * h) for e in np.eye(10)]
    np.testing.assert_allclose(gradient, slopes, rtol=1e-5)
    whole = np.zeros(10)
    whole[[2, 5]] = 1.0
    assert f.relaxed(whole)[0] == pytest.approx(-f.value(np.array([2, 5])), rel=1e-12)


@pytest.mark.parametrize("method", ["greedy", "exchange", "relaxation", "random"])
def test_general_methods_stay_above_the_best_and_bounds_below(method: str) -> None:
    for seed in range(4):
        f = gaussian(seed, r=1 + seed % 2)
        best = min(f.value(np.array(s)) for s in itertools.combinations(range(10), 4))
        solution = solve(Problem(f, count_only(10, 4)), method)
        assert solution.status in {Status.FEASIBLE, Status.OPTIMAL}, solution.stats
        assert solution.value >= best * (1.0 - 1e-9)
        assert solution.bound is None or solution.bound <= best * (1.0 + 1e-9)


def test_over_some_candidates_it_is_the_same_objective() -> None:
    f = gaussian(5, r=2)
    keep = np.array([1, 4, 7])
    assert f.over(keep).value(np.array([0, 2])) == pytest.approx(f.value(np.array([1, 7])))
