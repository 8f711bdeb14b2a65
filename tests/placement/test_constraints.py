from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from placement.bounds.linear import best_sum, most_sum
from placement.bounds.matroid import root_choice, using
from placement.constraints import Constraints, Infeasible, count_only

NONE = np.empty(0, dtype=np.int64)


def priced(cost: list[float], money: float, required: tuple[int, ...] = ()) -> Constraints:
    n = len(cost)
    return Constraints(
        n, n, np.full(n, -1), np.array(required, dtype=np.int64), NONE, np.array(cost), money
    )


def spaced(x: list[float], separation_m: float, required: tuple[int, ...] = ()) -> Constraints:
    n = len(x)
    place = np.column_stack([x, np.zeros(n)])
    return Constraints(
        n,
        n,
        np.full(n, -1),
        np.array(required, dtype=np.int64),
        NONE,
        place_m=place,
        separation_m=separation_m,
    )


def draw(rng: np.random.Generator) -> Constraints:
    """Draw constraints of every kind on eight candidates, two a place."""
    n = 8
    spots = rng.uniform(0.0, 30.0, (4, 2))
    return Constraints(
        n,
        int(rng.integers(1, 5)),
        np.repeat(np.arange(4), 2) if rng.uniform() < 0.7 else np.full(n, -1),
        NONE,
        np.array([int(rng.integers(n))]),
        rng.choice([0.0, 1.0, 2.0, 5.0, 1e9], n),
        float(rng.choice([0.0, 3.0, 6.0, 1e9, math.inf])),
        np.repeat(spots, 2, axis=0),
        float(rng.choice([0.0, 8.0, 15.0, 100.0])),
    )


def feasible(constraints: Constraints) -> list[tuple[int, ...]]:
    everyone = range(constraints.n)
    return [
        chosen
        for size in range(constraints.n + 1)
        for chosen in itertools.combinations(everyone, size)
        if not constraints.violations(chosen)
    ]


def test_money_is_counted_to_the_last_cent() -> None:
    ten = priced([0.1] * 11, 1.0)
    assert not ten.violations(range(10))  # ten times 0.1 is 1, whatever binary sums say
    assert "cost" in ten.violations(range(11))[0]
    assert ten.addable(np.arange(9)).any()
    assert not ten.addable(np.arange(10)).any()


def test_costs_of_nothing_and_of_a_billion_work() -> None:
    both = priced([0.0, 1e9, 1.0], 1.0)
    assert both.addable(NONE).tolist() == [True, False, True]
    assert both.usable().tolist() == [True, False, True]
    assert priced([0.0, 0.0], 0.0).addable(NONE).all()


@pytest.mark.parametrize("cost", [-1.0, math.nan, math.inf])
def test_impossible_costs_are_refused_by_name(cost: float) -> None:
    with pytest.raises(ValueError, match=r"cost\[1\] must be finite and at least 0"):
        priced([1.0, cost], 2.0)


@pytest.mark.parametrize("money", [-1.0, math.nan])
def test_impossible_money_is_refused(money: float) -> None:
    with pytest.raises(ValueError, match=r"budget\.money must be at least 0"):
        priced([1.0], money)


def test_contradictions_name_both_sides() -> None:
    with pytest.raises(Infeasible, match=r"2 required poses cost 7 .* budget\.money = 5"):
        priced([3.0, 4.0], 5.0, required=(0, 1))
    with pytest.raises(Infeasible, match=r"candidates 0 and 2 stand 5 m apart.*separation_m .* 10"):
        spaced([0.0, 50.0, 5.0], 10.0, required=(0, 2))


def test_cameras_on_one_mount_or_exactly_the_separation_apart_are_not_too_near() -> None:
    far = 1e5 / 3.0
    rules = spaced([far, far, far + 10.0, far + 19.9], 10.0)
    assert rules.violations([0, 1]) == []
    assert rules.violations([0, 2]) == []
    assert "nearer than 10 m" in rules.violations([2, 3])[0]
    assert rules.addable(np.array([2])).tolist() == [True, True, False, False]


def test_addable_says_what_violations_says() -> None:
    rng = np.random.default_rng(5)
    for _ in range(100):
        rules = draw(rng)
        for chosen in feasible(rules):
            now = np.array(chosen, dtype=np.int64)
            mask = rules.addable(now)
            for i in set(range(rules.n)) - set(chosen):
                assert mask[i] == (not rules.violations([*chosen, i]))


def test_every_placement_keeps_every_linear_row() -> None:
    rng = np.random.default_rng(6)
    cut_off = 0
    for _ in range(100):
        rules = draw(rng)
        matrix, limits = rules.linear_rows()
        sides, side_limits = rules.side_rows()
        assert sides.shape[0] == len(side_limits)
        choice = root_choice(rules)
        for chosen in feasible(rules):
            x = np.zeros(rules.n)
            x[list(chosen)] = 1.0
            assert np.all(matrix @ x <= limits * (1.0 + 1e-12))
            node = choice
            for i in chosen:
                node = using(node, int(choice.group[i]))
            assert node.feasible
        for pair in itertools.combinations(range(rules.n), 2):
            if rules.separation_m and rules.group[0] >= 0 and rules.violations(pair):
                x = np.zeros(rules.n)
                x[list(pair)] = 1.0
                cut_off += bool(np.any(matrix @ x > limits * (1.0 + 1e-12)))
    assert cut_off > 300  # the rows are not idle


def test_the_best_sum_with_money_priced_is_never_too_low_and_never_above_without_money() -> None:
    rng = np.random.default_rng(7)
    for _ in range(100):
        rules = draw(rng)
        worth = rng.normal(1.0, 1.0, rules.n)
        best = max(math.fsum(worth[list(chosen)]) for chosen in feasible(rules))
        most = most_sum(rules, worth)
        assert most >= best - 1e-9 * (1.0 + abs(best))
        assert most <= best_sum(rules, worth)[1]


def test_trimming_keeps_what_fits_in_the_order_given() -> None:
    rng = np.random.default_rng(8)
    for _ in range(50):
        rules = draw(rng)
        order = rng.permutation(rules.n)
        kept = rules.trimmed(order)
        assert rules.violations(kept) == []
        assert not rules.addable(kept).any()


def test_what_goes_beyond_a_matroid_is_named() -> None:
    assert count_only(3, 2).beyond_matroid() == ()
    assert priced([1.0, 2.0], 5.0).beyond_matroid() == ("budget.money",)
    assert replace(priced([1.0], 5.0), money=math.inf).beyond_matroid() == ()
    assert spaced([0.0, 1.0], 5.0).beyond_matroid() == ("budget.separation_m",)
