"""Dense log det designs against definitions, differences and published optima."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from placement.constraints import count_only
from placement.objectives.base import Relaxable
from placement.objectives.log_det import LogDet
from placement.problem import Problem
from placement.solution import Status
from placement.solve import solve


def gaussian(seed: int, c: int = 12, n: int = 4, r: int = 1, prior: float = 1e-6) -> LogDet:
    rng = np.random.default_rng(seed)
    return LogDet(prior * np.eye(n), rng.normal(size=(c, n, r)))


def information(f: LogDet, x: np.ndarray) -> np.ndarray:
    F = f.columns.reshape(f.n_states, f.n_candidates, f.rank)
    return f.prior + np.einsum("ncr,mcr,c->nm", F, F, x)


@pytest.mark.parametrize("r", [1, 2, 3])
@pytest.mark.parametrize("prior", [1e-6, 1.0])
def test_gains_are_differences_of_the_value_through_adding_and_removing(
    r: int, prior: float
) -> None:
    f = gaussian(1, r=r, prior=prior)
    rng = np.random.default_rng(2)
    state = f.state()
    for step in range(40):
        inside = state.selected
        if inside and (len(inside) > 8 or rng.uniform() < 0.4):
            state.remove(int(rng.choice(inside)))
        else:
            state.add(int(rng.choice(np.setdiff1d(np.arange(12), inside))))
        here = f.value(np.array(state.selected, dtype=np.int64))
        assert state.score == pytest.approx(here, rel=1e-9, abs=1e-9)
        asked = rng.choice(12, 5) if step % 2 else np.arange(12)
        for i, gain in zip(asked, state.gains(asked), strict=True):
            after = f.value(np.union1d(state.selected, [i]).astype(np.int64))
            assert gain == pytest.approx(after - here, rel=1e-7, abs=1e-8)


@pytest.mark.parametrize("r", [1, 3])
def test_the_relaxation_extends_the_value_and_its_gradient_is_its_slope(r: int) -> None:
    f = gaussian(3, r=r, prior=0.5)
    assert isinstance(f, Relaxable)
    x = np.random.default_rng(4).uniform(0.2, 0.8, 12)
    score, gradient = f.relaxed(x)
    expected = np.linalg.slogdet(information(f, x))[1] - np.linalg.slogdet(f.prior)[1]
    assert score == pytest.approx(expected, rel=1e-12)
    h = 1e-6
    slopes = [(f.relaxed(x + h * e)[0] - f.relaxed(x - h * e)[0]) / (2.0 * h) for e in np.eye(12)]
    np.testing.assert_allclose(gradient, slopes, rtol=1e-6)
    whole = np.zeros(12)
    whole[[2, 5]] = 1.0
    assert f.relaxed(whole)[0] == pytest.approx(f.value(np.array([2, 5])), rel=1e-12)


@pytest.mark.parametrize("method", ["greedy", "exchange", "search", "relaxation", "random"])
def test_every_general_method_keeps_value_below_brute_force_below_bound(method: str) -> None:
    for seed in range(10):
        f = gaussian(seed, c=10, n=3, r=1 + seed % 2, prior=10.0 ** -(seed % 7))
        problem = Problem(f, count_only(10, 4))
        best = max(f.value(np.array(s)) for s in itertools.combinations(range(10), 4))
        solution = solve(problem, method)
        assert solution.status in {Status.FEASIBLE, Status.OPTIMAL}, solution.stats
        assert solution.value <= best + 1e-9
        assert solution.bound is None or solution.bound >= best - 1e-9


@pytest.mark.parametrize(("edges", "trees"), [(9, 1), (10, 10), (11, 40)])
def test_the_best_subgraphs_of_ten_nodes_have_the_known_number_of_spanning_trees(
    edges: int, trees: int
) -> None:
    # Kirchhoff: the reduced Laplacian's determinant counts spanning trees; one node is grounded.
    pairs = list(itertools.combinations(range(10), 2))
    factors = np.zeros((len(pairs), 10, 1))
    for i, (a, b) in enumerate(pairs):
        factors[i, a, 0], factors[i, b, 0] = 1.0, -1.0
    f = LogDet(1e-6 * np.eye(9), factors[:, 1:])
    values = [
        solve(Problem(f, count_only(len(pairs), edges)), "exchange").value,
        *(
            f.value(np.array(hamiltonian(pairs, extra)))
            for extra in ([], [(0, 9)], [(0, 9), (0, 5)])
            if 9 + len(extra) == edges
        ),
    ]
    most = np.log(trees) - 9.0 * np.log(1e-6)
    # The prior adds 1e-6 times the inverse's trace, at most some hundred.
    assert max(values) <= most + 1e-3
    if edges < 11:  # a path, a cycle; a cycle with its longest chord has only 35
        assert max(values) == pytest.approx(most, abs=1e-3)


def hamiltonian(pairs: list[tuple[int, int]], extra: list[tuple[int, int]]) -> list[int]:
    """List the edges of the path 0 – 1 – … – 9 and `extra` ones."""
    return [pairs.index(edge) for edge in [*((i, i + 1) for i in range(9)), *extra]]


@pytest.mark.parametrize(
    ("prior", "factors", "message"),
    [
        (np.eye(2)[:1], np.ones((3, 2, 1)), r"prior must have shape \(n, n\), got \(1, 2\)"),
        (np.eye(2), np.ones((3, 3, 1)), r"factors must have shape \(c, 2, r\), got \(3, 3, 1\)"),
        (np.eye(2), np.ones((3, 2)), "factors must have shape"),
        (np.diag([1.0, np.nan]), np.ones((3, 2, 1)), r"prior\[1, 1\] must be finite, got nan"),
        (np.eye(2), np.full((1, 2, 1), np.inf), r"factors\[0, 0, 0\] must be finite, got inf"),
        (np.array([[1.0, 0.5], [0.0, 1.0]]), np.ones((3, 2, 1)), "prior must be symmetric"),
        (np.diag([1.0, -2.0]), np.ones((3, 2, 1)), "definite, got least eigenvalue -2"),
        (np.zeros((2, 2)), np.ones((3, 2, 1)), "definite, got least eigenvalue 0"),
    ],
)
def test_bad_arrays_are_refused_by_name(
    prior: np.ndarray, factors: np.ndarray, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        LogDet(prior, factors)


def test_a_state_refuses_strangers_repetitions_and_absentees() -> None:
    state = gaussian(5).state(np.array([1]))
    with pytest.raises(ValueError, match="candidate 1 is already selected"):
        state.add(1)
    with pytest.raises(ValueError, match="candidate 2 is not selected"):
        state.remove(2)
    with pytest.raises(ValueError, match="candidate must lie in 0…11, got 12"):
        state.add(12)
    with pytest.raises(ValueError, match="selected twice"):
        gaussian(5).value(np.array([1, 1]))
