"""Orbits against all permutations, and designs with symmetry against enumeration."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from placement.branch.symmetry import orbits, products
from placement.constraints import count_only
from placement.objectives.log_det import LogDet
from placement.problem import Problem
from placement.solution import Status
from placement.solve import solve


def edges(nodes: int) -> np.ndarray:
    """Return the grounded incidence vectors of a complete graph, (c, nodes − 1, 1)."""
    pairs = list(itertools.combinations(range(nodes), 2))
    factors = np.zeros((len(pairs), nodes, 1))
    for i, (a, b) in enumerate(pairs):
        factors[i, a, 0], factors[i, b, 0] = 1.0, -1.0
    return factors[:, 1:]


def factorial(factors: int) -> np.ndarray:
    """Return the runs of a two-level factorial experiment with an intercept, (2^f, f + 1, 1)."""
    runs = np.array(list(itertools.product([-1.0, 1.0], repeat=factors)))
    return np.column_stack([np.ones(len(runs)), runs])[:, :, None]


def orbits_by_enumeration(gram: np.ndarray, colours: np.ndarray) -> list[set[int]]:
    c = len(gram)
    found = [{i} for i in range(c)]
    for move in itertools.permutations(range(c)):
        if any(colours[i] != colours[j] for i, j in enumerate(move)):
            continue
        moved = gram[np.ix_(move, move)]
        if not np.array_equal(np.abs(moved), np.abs(gram)):
            continue
        if not any(
            np.array_equal(np.outer(signs, signs) * moved, gram)
            for signs in itertools.product([-1.0, 1.0], repeat=c)
        ):
            continue
        for i, j in enumerate(move):
            both = found[i] | found[j]
            for member in both:
                found[member] = both
    return found


@pytest.mark.parametrize("coloured", [False, True])
def test_orbits_are_those_of_all_signed_permutations(coloured: bool) -> None:
    for factors in (edges(4), factorial(2), np.eye(5)[:, :, None], edges(4)[:5]):
        gram = products(np.ascontiguousarray(factors.transpose(0, 2, 1)))
        assert gram is not None
        colours = np.zeros(len(factors), dtype=np.int64)
        colours[0] = int(coloured)
        labels = orbits(gram, colours)
        expected = orbits_by_enumeration(gram, colours)
        for i in range(len(factors)):
            assert set(np.flatnonzero(labels == labels[i]).tolist()) == expected[i]


def test_experiments_that_all_differ_are_not_searched() -> None:
    factors = np.random.default_rng(0).normal(size=(30, 1, 4))
    assert products(factors) is None
    assert products(np.ones((5, 2, 4))) is None


@pytest.mark.parametrize("k", [5, 6, 7])
@pytest.mark.parametrize("prior", [1e-6, 0.5])
def test_symmetric_designs_equal_enumeration(k: int, prior: float) -> None:
    for factors in (edges(6), factorial(4)):
        c, n = factors.shape[:2]
        f = LogDet(prior * np.eye(n), factors)
        best = max(f.value(np.array(s)) for s in itertools.combinations(range(c), k))
        solution = solve(Problem(f, count_only(c, k)), "branch")
        assert solution.status is Status.OPTIMAL
        assert solution.value == pytest.approx(best, rel=1e-9)
        assert solution.stats.get("orbits_merged", 0) > 0 or solution.stats["nodes"] <= 3


@pytest.mark.parametrize(("count", "trees"), [(9, 1), (10, 10), (11, 40)])
def test_ten_nodes_have_at_most_the_known_number_of_spanning_trees(count: int, trees: int) -> None:
    problem = Problem(LogDet(1e-6 * np.eye(9), edges(10)), count_only(45, count))
    solution = solve(problem, "auto")
    assert solution.status is Status.OPTIMAL
    # the prior adds its share of the trace of the inverse, some hundred millionths
    assert np.exp(solution.value + 9.0 * np.log(1e-6)) == pytest.approx(trees, rel=1e-4)
