"""What bounds and places for every budget of `trace` at once, against all placements."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.synthetic_drives import CAR, ROBOT, random_drive
from placement.budget_curve import budget_curve
from placement.constraints import Constraints
from placement.objectives.trace import Trace
from placement.problem import Problem, Run
from placement.solution import Status
from placement.solvers.curve_prices import PricedCurve, least_at, price_for
from placement.solvers.curve_search import CurveSearch
from placement.solvers.trace_curve import BOUND_FROM, PRICED, CurveProof

CANDIDATES = 8
MOST = 5


def tiny(seed: int, drives: int = 1, offsets: int = 0) -> Problem:
    """Return a tiny road, with groups, a required camera and places, or without."""
    rng = np.random.default_rng([11, seed])
    many = [
        random_drive(
            rng,
            n_samples=int(rng.integers(6, 18)),
            n_candidates=CANDIDATES,
            isotropic=bool(rng.integers(2)),
            longest_window=int(rng.integers(2, 10)),
            wrap=seed % 5 == 4,
            odometry=CAR if rng.integers(2) else ROBOT,
            strength=float(10.0 ** rng.uniform(0.0, 4.0)),
            offsets=offsets,
        )
        for _ in range(drives)
    ]
    group = np.arange(CANDIDATES) // 2 if rng.integers(2) else np.full(CANDIDATES, -1)
    required = np.array([2] if seed % 3 == 0 else [], dtype=np.int64)
    rules = Constraints(CANDIDATES, MOST, group, required, np.empty(0, dtype=np.int64))
    place = np.sort(rng.uniform(0.0, 20.0, CANDIDATES)) if rng.integers(2) else None
    return Problem(Trace(many), rules, place, None if place is None else 20.0)


def best_values(problem: Problem) -> dict[int, float]:
    """Return the least value for each budget from that of the required cameras on."""
    least = dict.fromkeys(range(MOST + 1), math.inf)
    rules = problem.constraints
    for size in range(MOST + 1):
        for chosen in itertools.combinations(range(CANDIDATES), size):
            if not rules.violations(chosen):
                value = problem.objective.value(np.array(chosen, dtype=np.int64))
                for k in range(size, MOST + 1):
                    least[k] = min(least[k], value)
    return least


def check(seed: int, drives: int, source: str, offsets: int = 0) -> tuple[int, int]:
    """Solve a tiny road's curve; return how many bounds are of `source`, and how many tight.

    Bounds are looked at before placements cap them, which would hide what is wrong.
    """
    problem = tiny(seed, drives, offsets)
    best = best_values(problem)
    budgets = range(1 + seed % 3, MOST + 1)
    proof = CurveProof(problem, budgets, Run(np.random.default_rng(seed)))
    assert proof.work()
    named = tight = 0
    for k, found in zip(budgets, proof.proposals(Status.FEASIBLE), strict=True):
        assert proof.bound(k) <= best[k] * (1.0 + 1e-9), (seed, k)
        assert not replace(problem.constraints, budget=k).violations(found.selected)
        value = problem.objective.value(np.array(found.selected, dtype=np.int64))
        assert proof.value(k) == pytest.approx(value, rel=1e-12)
        named += found.stats["bound_from"].startswith(source)
        tight += proof.bound(k) >= 0.95 * best[k]
    return named, tight


@pytest.fixture
def poor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the search find little: good placements would cap thresholds, and hide faults."""

    def work(self: CurveSearch) -> None:
        for k, problem in self.known.items():
            order = np.random.default_rng(k // 2).permutation(CANDIDATES)
            rules = replace(
                problem.constraints, budget=max(k - 1, problem.constraints.required.size)
            )
            self.offer(k, rules.trimmed(order).tolist())
            if k - 1 in self.best:
                self.offer(k, self.best[k - 1])

    monkeypatch.setattr(CurveSearch, "work", work)
    monkeypatch.setattr(CurveSearch, "improve", CurveSearch.offer)


@pytest.mark.usefixtures("poor")
@pytest.mark.parametrize("drives", [1, 2])
def test_prices_alone_bound_every_budget(drives: int, monkeypatch: pytest.MonkeyPatch) -> None:
    for other in ("_relax", "_relax_at", "_count"):
        monkeypatch.setattr(CurveProof, other, lambda *_: None)
    found = np.sum([check(seed, drives, PRICED) for seed in range(40)], axis=0)
    assert found[0] >= 15
    assert found[1] >= 30  # and no empty promise


@pytest.mark.usefixtures("poor")
def test_counts_alone_bound_every_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    for other in ("_relax", "_relax_at", "_price"):
        monkeypatch.setattr(CurveProof, other, lambda *_: None)
    monkeypatch.setattr(PricedCurve, "above_hull", lambda *_: 1.0)
    found = np.sum([check(seed, 1 + seed % 2, BOUND_FROM) for seed in range(30)], axis=0)
    assert found[0] >= 30
    assert found[1] >= 40


@pytest.mark.usefixtures("poor")
@pytest.mark.parametrize("means", ["prices", "counts"])
def test_every_budget_is_bounded_where_offsets_persist(
    means: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for other in ("_relax", "_relax_at", "_count" if means == "prices" else "_price"):
        monkeypatch.setattr(CurveProof, other, lambda *_: None)
    source = PRICED
    if means == "counts":
        source = BOUND_FROM
        monkeypatch.setattr(PricedCurve, "above_hull", lambda *_: 1.0)
    found = np.sum([check(seed, 1 + seed % 2, source, 1 + seed % 3) for seed in range(24)], axis=0)
    assert found[0] >= 10


@pytest.mark.slow
@pytest.mark.parametrize("block", range(5))
def test_no_curve_lies_above_the_best_where_offsets_persist(block: int) -> None:
    for seed in range(100):
        check(7000 + 100 * block + seed, 1 + seed % 2, PRICED, 1 + seed % 3)


@pytest.mark.slow
def test_all_means_together_leave_little() -> None:
    tight = sum(check(1000 + seed, 1, PRICED)[1] for seed in range(40))
    assert tight >= 90  # of 120


@pytest.mark.usefixtures("poor")
@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_no_price_lies_above_the_best_on_hundreds_of_roads(
    block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    for other in ("_relax", "_relax_at", "_count"):
        monkeypatch.setattr(CurveProof, other, lambda *_: None)
    for seed in range(100):
        check(5000 + 100 * block + seed, 1 + seed % 2, PRICED)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_no_curve_lies_above_the_best_of_all_placements(block: int) -> None:
    for seed in range(100):
        check(2000 + 100 * block + seed, 1 + seed % 2, PRICED)


def test_without_time_every_camera_at_once_bounds_all_budgets() -> None:
    problem = tiny(1)
    best = best_values(problem)
    for k, found in enumerate(budget_curve(problem, 1, MOST, time_limit_s=0.0).solutions, 1):
        assert found.bound is not None
        assert 0.0 < found.bound <= best[k] * (1.0 + 1e-9)


def test_a_price_lies_between_the_slopes_on_both_sides_of_its_budget() -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        steps = np.sort(rng.exponential(1.0, 9) ** 3)[::-1]
        curve = np.concatenate([[0.0], -np.cumsum(steps)])
        nothing = 1.0 - curve[-1]
        value = {k: float(nothing + curve[k]) for k in range(1, 10)}
        for k in range(1, 10):
            price = price_for(k, value, nothing)
            assert least_at(price, value)[1] == k  # convex: every budget is a corner
        above = int(rng.integers(2, 9))  # lift one: its price is the slope of its side
        value[above] += steps[above - 1] - steps[above] + rng.exponential()
        value[above] = min(value[above], value[above - 1])
        price = price_for(above, value, nothing)
        ends = least_at(price, value)[0]
        others = np.linspace(0.0, 3.0 * price, 300)
        reach = max(least_at(p, value)[0] - p * above for p in others)
        assert ends - price * above >= reach - 1e-9 * abs(reach)


def test_a_flat_curve_has_no_price() -> None:
    assert price_for(2, {1: 3.0, 2: 3.0, 3: 3.0}, 3.0) == 0.0
    assert price_for(1, {1: 3.0}, 3.0) == 0.0


def test_the_search_goes_on_from_neighbours_and_finds_the_best_of_tiny_roads() -> None:
    found_best = tried = 0
    for seed in range(40):
        problem = tiny(seed)
        best = best_values(problem)
        known = {
            k: replace(problem, constraints=replace(problem.constraints, budget=k))
            for k in range(1, MOST + 1)
        }
        search = CurveSearch(known, Run(np.random.default_rng(seed)))
        search.work()
        values = [search.value[k] for k in known]
        assert values == sorted(values, reverse=True)
        for k in known:
            assert not known[k].constraints.violations(search.best[k])
            chosen = np.array(search.best[k], dtype=np.int64)
            assert search.value[k] == problem.objective.value(chosen)
            assert search.value[k] >= best[k] * (1.0 - 1e-9)
            tried += 1
            found_best += search.value[k] <= best[k] * (1.0 + 1e-9)
    assert found_best >= 0.9 * tried
