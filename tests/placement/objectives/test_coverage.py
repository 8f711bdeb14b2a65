"""Coverage counts what is seen often enough, and its exact method agrees with brute force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from placement.bounds import coverage_tree
from placement.bounds.coverage_cuts import CoverageCuts, merged
from placement.bounds.coverage_tree import best_few
from placement.bounds.cut_program import CutProgram
from placement.bounds.matroid import root_choice, without
from placement.objectives.coverage import Coverage
from placement.problem import Run
from placement.solution import Status
from placement.solve import solve
from placement.solvers.dive import dive

Make = Callable[..., Any]


def by_hand(information: Any, selected: tuple[int, ...], times: int, weights: Any) -> float:
    counts = [0] * information.n_samples
    for i in selected:
        for t in set(information.indices[information.indptr[i] : information.indptr[i + 1]]):
            counts[t] += 1
    return float(sum(w for w, n in zip(weights, counts, strict=True) if n >= times))


@pytest.mark.parametrize("times", [1, 2, 3])
@pytest.mark.parametrize("partial", [False, True])
def test_gains_are_changes_of_the_value(times: int, partial: bool, new_information: Make) -> None:
    rng = np.random.default_rng(times)
    f = Coverage(new_information(rng, 12, 30), times, rng.uniform(size=30), partial=partial)
    state = f.state()
    for candidate in (3, 7, 1, 9):
        gains = state.gains()
        assert gains == pytest.approx(state.gains(np.arange(12)))
        assert state.gains(np.array([5])) == pytest.approx(gains[5:6])
        for i in set(range(12)) - set(state.selected):
            here, there = state.selected, [*state.selected, i]
            change = f.value(np.array(there)) - f.value(np.array(here, dtype=np.int64))
            assert gains[i] == pytest.approx(change, abs=1e-12)
        state.add(candidate)
    state.remove(7)
    assert state.score == pytest.approx(f.value(np.array([3, 1, 9])))


def test_values_are_those_counted_by_hand(new_information: Make) -> None:
    rng = np.random.default_rng(0)
    information, weights = new_information(rng, 8, 25), rng.integers(1, 5, 25)
    for times in (1, 2):
        f = Coverage(information, times, weights)
        assert f.step == 1.0
        for chosen in ((), (2,), (0, 5, 7), (1, 2, 3, 4)):
            wanted = by_hand(information, chosen, times, weights)
            assert f.value(np.array(chosen, dtype=np.int64)) == wanted


def test_looks_twice_are_not_submodular_and_say_so(new_information: Make) -> None:
    information = new_information(np.random.default_rng(1), 4, 10)
    assert Coverage(information).submodular
    assert not Coverage(information, 2).submodular
    assert Coverage(information, 2, partial=True).submodular


@pytest.mark.parametrize("times", [1, 2, 3])
@pytest.mark.parametrize("groups", [False, True])
@pytest.mark.parametrize("whole", [False, True])
def test_the_exact_method_finds_and_proves_the_best(
    times: int, groups: bool, whole: bool, new_problem: Make, brute_force: Make
) -> None:
    for seed in range(15):
        rng = np.random.default_rng([seed, times, groups, whole])
        base = new_problem(
            rng,
            n_candidates=int(rng.integers(4, 12)),
            n_samples=20,
            budget=int(rng.integers(1, 5)),
            groups=groups,
            required=(1,) if seed % 3 == 0 else (),
        )
        weights = rng.integers(1, 4, 20) if whole else rng.uniform(0.1, 1.0, 20)
        problem = replace(base, objective=Coverage(base.objective.information, times, weights))
        best, _ = brute_force(problem)
        solution = solve(problem, "mip")
        assert solution.status is Status.OPTIMAL, solution
        assert solution.value == pytest.approx(best, rel=1e-6, abs=1e-9)
        assert solution.bound is not None
        assert solution.bound >= best - 1e-9
        assert solve(problem).value == solution.value


@pytest.mark.parametrize("times", [1, 2, 3])
@pytest.mark.parametrize("limits", ["count", "groups", "money"])
def test_the_tree_alone_finds_and_proves_the_best(
    times: int,
    limits: str,
    new_problem: Make,
    brute_force: Make,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(coverage_tree, "MOST_WORK", 0.0)
    for seed in range(5):
        rng = np.random.default_rng([seed, times, len(limits)])
        base = new_problem(rng, n_candidates=10, n_samples=24, budget=4, groups=limits == "groups")
        constraints = base.constraints
        if limits == "money":
            constraints = replace(constraints, cost=rng.uniform(0.2, 1.0, 10), money=1.5)
        weights = rng.integers(1, 4, 24) if seed % 2 else rng.uniform(0.1, 1.0, 24)
        f = Coverage(base.objective.information, times, weights)
        problem = replace(base, objective=f, constraints=constraints)
        best, _ = brute_force(problem)
        solution = solve(problem, "mip")
        assert solution.status is Status.OPTIMAL, solution
        assert solution.value == pytest.approx(best, rel=1e-6, abs=1e-9)
        assert solution.bound is not None
        assert best - 1e-9 <= solution.bound <= best * (1.0 + 1e-6) + 1e-9


@pytest.mark.parametrize("groups", [False, True])
def test_a_dive_ends_in_a_placement_of_its_node(groups: bool, new_problem: Make) -> None:
    for seed in range(6):
        base = new_problem(
            np.random.default_rng(seed), n_candidates=14, n_samples=30, budget=4, groups=groups
        )
        f = merged(Coverage(base.objective.information, 2))
        maker, choice = CoverageCuts(f), root_choice(base.constraints)
        nobody = np.empty(0, dtype=np.int64)
        program = CutProgram(choice, maker.submodular(nobody), f.information.n_samples)
        node = without(choice, np.array([3, 5]))
        first = program.solve(node, 10.0)
        assert first is not None
        chosen = dive(program, node, first.x, lambda: 10.0)
        assert base.constraints.violations(chosen) == []
        assert not {3, 5} & set(chosen.tolist())
        assert chosen.size > 0
        stopped = dive(program, node, first.x, lambda: 0.0)
        assert base.constraints.violations(stopped) == []


@pytest.mark.parametrize("times", [1, 2, 3])
def test_cuts_lie_above_every_set_and_touch_their_own(times: int, new_information: Make) -> None:
    rng = np.random.default_rng(times)
    information = new_information(rng, 9, 15)
    f = Coverage(information, times, rng.uniform(0.5, 2.0, 15))
    maker = CoverageCuts(f)
    sets = (rng.random((60, 9)) < 0.4).astype(float)
    x = rng.random(9) * 0.6
    makers = [maker.separate(x, np.full(15, 10.0), 0.0)]
    for chosen in sets[:5]:
        tight = maker.submodular(np.flatnonzero(chosen))
        terms = f.weights * (f.seen.T @ chosen >= times)
        assert tight.at(chosen) == pytest.approx(terms[tight.sample], abs=1e-12)
        makers.append(tight)
    for cuts in makers:
        for chosen in sets:
            terms = f.weights * (f.seen.T @ chosen >= times)
            assert np.all(cuts.at(chosen) >= terms[cuts.sample] - 1e-15)


@pytest.mark.parametrize("priced", [False, True])
def test_useless_is_who_sees_no_more_than_another_of_the_group(
    priced: bool, new_problem: Make
) -> None:
    marked = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        base = new_problem(rng, n_candidates=12, n_samples=9, budget=3, groups=True, required=(2,))
        constraints = base.constraints
        if priced:
            cost = rng.integers(1, 4, 12).astype(float)
            constraints = replace(constraints, cost=cost, money=20.0)
        f = Coverage(base.objective.information)
        sees = [set(f.indices[f.indptr[i] : f.indptr[i + 1]].tolist()) for i in range(12)]
        usable = constraints.usable()
        usable[2] = False
        mask = CoverageCuts(f).useless(constraints)
        for i in range(12):
            better = [
                j
                for j in range(12)
                if j != i
                and usable[i]
                and usable[j]
                and constraints.group[i] == constraints.group[j] >= 0
                and sees[i] <= sees[j]
                and (sees[i] < sees[j] or j < i)
                and (not priced or constraints.cost[j] <= constraints.cost[i])
            ]
            assert mask[i] == bool(better)
        marked += int(mask.sum())
    assert marked > 5


def test_merging_samples_changes_no_value(new_information: Make) -> None:
    rng = np.random.default_rng(5)
    f = Coverage(new_information(rng, 4, 60), 2, rng.integers(1, 9, 60))
    small = merged(f)
    assert small.information.n_samples < 16
    for bits in range(16):
        chosen = np.array([i for i in range(4) if bits >> i & 1], dtype=np.int64)
        assert small.value(chosen) == f.value(chosen)


@pytest.mark.parametrize(
    ("times", "weights", "message"),
    [
        (0, None, "times must be at least 1, got 0"),
        (1, np.ones(3), r"weights must have shape \(10,\), got \(3,\)"),
        (1, np.full(10, np.nan), "weights must be finite"),
    ],
)
def test_bad_arguments_are_refused_by_name(
    times: int, weights: Any, message: str, new_information: Make
) -> None:
    information = new_information(np.random.default_rng(1), 4, 10)
    with pytest.raises(ValueError, match=message):
        Coverage(information, times, weights)


def test_shares_have_no_exact_method(new_problem: Make) -> None:
    base = new_problem(np.random.default_rng(1))
    shared = Coverage(base.objective.information, 2, partial=True)
    with pytest.raises(ValueError, match="without partial"):
        solve(replace(base, objective=shared), "mip")


@pytest.mark.parametrize("times", [1, 2, 3])
@pytest.mark.parametrize("limits", ["count", "groups", "money"])
def test_looking_at_all_of_few_finds_the_best(
    times: int, limits: str, new_problem: Make, brute_force: Make
) -> None:
    for seed in range(12):
        rng = np.random.default_rng([seed, times, len(limits)])
        base = new_problem(rng, n_candidates=11, n_samples=25, budget=4, groups=limits == "groups")
        constraints = base.constraints
        if limits == "money":
            constraints = replace(constraints, cost=rng.uniform(0.2, 1.0, 11), money=1.5)
        f = Coverage(base.objective.information, times, rng.uniform(0.1, 1.0, 25))
        best, _ = brute_force(replace(base, objective=f, constraints=constraints))
        found = best_few(f, constraints, np.ones(11, np.bool_), -1.0, Run(rng))
        assert found is not None
        selected, bound, _ = found
        assert constraints.violations(selected) == []
        assert f.value(np.array(selected)) == pytest.approx(best, rel=1e-12)
        assert best <= bound <= best * (1.0 + 1e-9) + 1e-12


def test_looking_at_all_says_when_that_is_too_much(new_problem: Make) -> None:
    base = new_problem(np.random.default_rng(0), n_candidates=400, n_samples=200, budget=9)
    f = Coverage(base.objective.information, 2)
    everybody = np.ones(400, np.bool_)
    assert best_few(f, base.constraints, everybody, 0.0, Run(np.random.default_rng(0))) is None
