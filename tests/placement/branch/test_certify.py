"""Certificates at any fraction, however bad, against enumeration; the climb against Newton."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from placement.bounds.concave import best_fraction
from placement.bounds.matroid import root_choice
from placement.branch.certify import best_sum, log_blocks, squares, upper
from placement.branch.climb import LOG_DET, TRACE_INVERSE, climb, slopes_of
from placement.branch.design import design_of
from placement.branch.relax import relax
from placement.branch.small import descending, eliminate, gram, inverse_factor, times
from placement.branch.swaps import better_by_swaps, gains_over, score_of
from placement.constraints import Constraints, count_only
from placement.objectives.log_det import LogDet
from placement.objectives.trace_inverse import TraceInverse
from placement.problem import Problem, Run

NONE = np.empty(0, dtype=np.int64)


@pytest.mark.parametrize("form", ["natural", "projected", "trace", "priced", "priced trace"])
def test_bounds_and_what_they_fix_hold_at_any_fraction(form: str) -> None:
    for seed in range(12):
        rng = np.random.default_rng(seed)
        r = 1 + seed % 2
        n, c = 4, 9
        k = n // r if form == "projected" else int(rng.integers(1, 6))
        kind = TraceInverse if "trace" in form else LogDet
        cost = rng.uniform(0.1, 1.0, c) if "priced" in form else None
        group = np.arange(c) // 2 if seed % 3 == 0 and cost is None else np.full(c, -1)
        rules = Constraints(
            c, c if cost is not None else k, group, NONE, NONE, cost=cost,
            money=np.inf if cost is None else 1.5,
        )  # fmt: skip
        problem = Problem(kind(10.0 ** -(seed % 7) * np.eye(n), rng.normal(size=(c, n, r))), rules)
        design = design_of(problem)
        fixed = np.array([0]) if seed % 2 else NONE
        free = np.setdiff1d(np.arange(c), fixed)
        free = free[~np.isin(design.group[free], design.group[fixed])]
        m = design.k - fixed.size
        left = design.purse - float(design.cost[fixed].sum())
        if m < 1:
            continue
        hold, leave, x = np.empty(free.size), np.empty(free.size), rng.uniform(size=free.size)
        for rounds in (1, 12):  # a fraction out of thin air, and a climbed one
            bound, total, _, constant, base, project = relax(
                design.kind, form == "projected", design.base, design.root, design.V, design.group,
                design.cost, left, design.priced, free, fixed, m, x.copy(), 0.3, -np.inf, 1e-9,
                rounds, hold, leave,
            )  # fmt: skip
            assert project == (form == "projected")
            scores: dict[tuple[int, ...], float] = {}
            for size in range(m + 1) if design.priced else [m]:
                for rest in itertools.combinations(free, size):
                    chosen = np.array([*fixed, *rest], dtype=np.int64)
                    if not rules.violations(chosen):
                        scores[rest] = score_of(
                            design.kind, design.base, design.V, chosen, chosen.size
                        )
            slack = 1e-9 * max(1.0, max(map(abs, scores.values())))
            assert bound >= max(scores.values()) - slack
            for at, i in enumerate(free):
                with_i = [v for rest, v in scores.items() if i in rest]
                without = [v for rest, v in scores.items() if i not in rest]
                for values, loss in ((with_i, hold[at]), (without, leave[at])):
                    if values:
                        at_most = upper(
                            design.kind, project, design.priced, n, constant, base, total - loss
                        )
                        assert at_most >= max(values) - slack


def test_the_climb_ends_where_newton_ends() -> None:
    for seed, (k, r) in enumerate([(4, 1), (6, 1), (5, 2), (9, 3)]):
        rng = np.random.default_rng(seed)
        f = LogDet(0.01 * np.eye(4), rng.normal(size=(30, 4, r)))
        group = np.arange(30) // 2 if seed % 2 else np.full(30, -1)
        rules = Constraints(30, k, group, NONE, NONE)
        newton = best_fraction(f, root_choice(rules), Run(rng), tolerance=1e-9)
        design = design_of(Problem(f, rules))
        bound, *_ = relax(
            design.kind, False, design.base, design.root, design.V, design.group, design.cost,
            np.inf, False, np.arange(30), NONE, k, np.zeros(30), 0.0, -np.inf, 1e-9, 2000,
            np.empty(30), np.empty(30),
        )  # fmt: skip
        # climbed to a tenth of nothing: the relaxation is never pruned here
        assert bound >= newton.score - 1e-9
        assert bound <= newton.bound + 0.15 * abs(newton.bound)


@pytest.mark.parametrize("kind", [LOG_DET, TRACE_INVERSE])
@pytest.mark.parametrize("r", [1, 2])
def test_slopes_follow_every_exchange(kind: int, r: int) -> None:
    rng = np.random.default_rng(kind + 2 * r)
    d, p, m = 3, 12, 5
    G = rng.normal(size=(d, p * r))
    x = np.full(p, m / p)
    blocks = G.reshape(d, p, r)

    def information(x: np.ndarray) -> np.ndarray:
        return 0.1 * np.eye(d) + np.einsum("apr,bpr,p->ab", blocks, blocks, x)

    def score(x: np.ndarray) -> float:
        M = information(x)
        return float(np.linalg.slogdet(M)[1] if kind == LOG_DET else -np.trace(np.linalg.inv(M)))

    theta = np.linalg.inv(information(x))
    slope = np.empty(p)
    slopes_of(kind, theta, G, r, slope)
    h = 1e-6
    differences = [(score(x + h * e) - score(x - h * e)) / (2 * h) for e in np.eye(p)]
    np.testing.assert_allclose(slope, differences, rtol=1e-5)
    before = score(x)
    group = np.arange(p) // 2
    made = climb(kind, theta, slope, G, r, x, m, group, False, np.zeros(p), 60, 1e-9)
    assert made > 3
    assert score(x) > before
    assert x.min() >= 0.0
    assert x.sum() == pytest.approx(m)
    assert np.bincount(group, x).max() <= 1.0 + 1e-9
    np.testing.assert_allclose(theta, np.linalg.inv(information(x)), rtol=1e-7, atol=1e-10)
    fresh = np.empty(p)
    slopes_of(kind, theta, G, r, fresh)
    np.testing.assert_allclose(slope, fresh, rtol=1e-7)


def test_best_sums_and_their_losses_are_those_of_enumeration() -> None:
    for seed in range(60):
        rng = np.random.default_rng(seed)
        p, m, whole = int(rng.integers(1, 8)), int(rng.integers(1, 5)), bool(seed % 2)
        worth = np.round(rng.normal(size=p), 1)
        group = rng.integers(0, p, p) if seed % 3 else np.arange(p)
        found = {}
        for size in [m] if whole else range(m + 1):
            for s in itertools.combinations(range(p), size):
                if len({group[i] for i in s}) == size:
                    found[s] = float(sum(worth[i] for i in s))
        leave, hold, taken = np.empty(p), np.empty(p), np.empty(p, np.bool_)
        total = best_sum(worth, group, not seed % 3, m, whole, leave, hold, taken)
        if not found:
            assert total == -np.inf
            continue
        assert total == pytest.approx(max(found.values()))
        for i in range(p):
            with_i = max((v for s, v in found.items() if i in s), default=-np.inf)
            without = max((v for s, v in found.items() if i not in s), default=-np.inf)
            assert total - hold[i] >= with_i - 1e-12
            assert total - leave[i] >= without - 1e-12
            if not taken[i] and with_i > -np.inf:
                assert total - hold[i] == pytest.approx(with_i)


def test_small_matrices_agree_with_numpy() -> None:
    rng = np.random.default_rng(0)
    A, B = rng.normal(size=(4, 6)), rng.normal(size=(6, 3))
    np.testing.assert_allclose(times(A, B), A @ B)
    np.testing.assert_allclose(gram(A), A.T @ A)
    M = A @ A.T
    W = np.empty((4, 4))
    assert inverse_factor(M, W)
    np.testing.assert_allclose(W @ M @ W.T, np.eye(4), atol=1e-10)
    assert not inverse_factor(-M, W)
    right = rng.normal(size=(4, 2))
    solved, block = right.copy(), M.copy()
    assert eliminate(block, solved) == pytest.approx(np.linalg.slogdet(M)[1])
    np.testing.assert_allclose(M @ solved, right)
    worth = np.round(rng.normal(size=50), 1)
    np.testing.assert_array_equal(descending(worth), np.argsort(-worth, kind="stable"))
    out = np.empty(2)
    squares(W, np.ascontiguousarray(A[:, :4]), 2, out)
    expected = np.sum((W @ A[:, :4]) ** 2, axis=0).reshape(2, 2).sum(axis=1)
    assert np.all(out >= expected)
    np.testing.assert_allclose(out, expected, rtol=1e-12)
    log_blocks(W, np.ascontiguousarray(A[:, :4]), 2, np.full(2, 0.1), out)
    half = W @ A[:, :4]
    blocks = [half[:, a : a + 2].T @ half[:, a : a + 2] + 0.1 * np.eye(2) for a in (0, 2)]
    np.testing.assert_allclose(out, [np.linalg.slogdet(b)[1] for b in blocks], rtol=1e-10)


@pytest.mark.parametrize("kind", [LogDet, TraceInverse])
@pytest.mark.parametrize("r", [1, 2])
def test_gains_and_swaps_agree_with_the_objective(
    kind: type[LogDet] | type[TraceInverse], r: int
) -> None:
    rng = np.random.default_rng(r)
    objective = kind(0.5 * np.eye(3), rng.normal(size=(15, 3, r)))
    design = design_of(Problem(objective, count_only(15, 4)))
    state = objective.state(np.array([2, 7]))
    M = design.base + sum(design.V[i].T @ design.V[i] for i in (2, 7))
    W, gains = np.empty((3, 3)), np.empty(15)
    assert inverse_factor(M, W)
    gains_over(design.kind, W, design.V, gains)
    outside = np.setdiff1d(np.arange(15), [2, 7])
    np.testing.assert_allclose(gains[outside], state.gains(outside), rtol=1e-9)
    chosen = np.array([2, 7, -1, -1])
    count, score = better_by_swaps(
        design.kind, design.base, design.V, design.group, design.cost, np.inf, design.required,
        4, chosen, 50,
    )  # fmt: skip
    assert count == 4
    sign = 1.0 if objective.maximise else -1.0
    assert score == pytest.approx(sign * objective.value(chosen))
    rivals = [
        sign * objective.value(np.array([*np.delete(chosen, a), i]))
        for a in range(4)
        for i in np.setdiff1d(np.arange(15), chosen)
    ]
    assert score >= max(rivals) - 1e-9
