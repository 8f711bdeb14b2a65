"""Tempered chains against brute force: value ≤ best ≤ bound, on roads whose windows pile up."""

from __future__ import annotations

import itertools
import time

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from benchmarks.synthetic_drives import CAR, ROBOT, random_drive
from placement.bounds.concave import best_fraction
from placement.bounds.matroid import root_choice
from placement.constraints import Constraints
from placement.objectives.entropy import Entropy
from placement.objectives.navigation_chain import Drive
from placement.problem import Problem, Run
from placement.solution import Status
from placement.solve import solve
from placement.tempered.background import background_of, chains_of, stand_in
from placement.tempered.bound import SecondOrder, Tempered
from placement.tempered.diagram import Diagram
from placement.tempered.line import make_line
from placement.tempered.search import gains_beyond, search

SHARES = (1.0, 0.7, 0.3, 0.02)
NONE = np.empty(0, dtype=np.int64)


def small_drive(rng: np.random.Generator, n: int, seed: int, offsets: int = 0) -> Drive:
    """Draw a short road: windows of up to 12 of 8…30 samples, so three and four overlap."""
    return random_drive(
        rng,
        n_samples=int(rng.integers(8, 30)),
        n_candidates=n,
        isotropic=bool(seed % 2),
        odometry=(CAR, ROBOT)[seed % 3 % 2],
        longest_window=int(rng.integers(2, 13)),
        wrap=seed % 4 == 0,
        offsets=offsets,
    )


def small_problem(seed: int, offsets: int = 0) -> tuple[Entropy, Constraints]:
    """Draw an entropy problem with groups, required and forbidden poses every few seeds."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 9))
    drives = [small_drive(rng, n, seed, offsets)]
    if seed % 7 == 0:
        other = small_drive(rng, n, seed + 1)
        drives.append(Drive(other.points, other.information, ROBOT, other.initial_sigma, 0.4))
    constraints = Constraints(
        n,
        int(rng.integers(0, min(n, 6) + 1)) or seed % 2,
        np.arange(n) // 2 if seed % 3 == 0 else np.full(n, -1),
        np.array([seed % n]) if seed % 5 == 0 and seed % 2 else NONE,
        np.array([(seed + 1) % n]) if seed % 6 == 0 and n > 2 else NONE,
    )
    return Entropy(drives), constraints


def best_placement(objective: Entropy, constraints: Constraints) -> tuple[float, tuple[int, ...]]:
    found = (
        (objective.value(np.array(s, dtype=np.int64)), s)
        for r in range(constraints.budget + 1)
        for s in itertools.combinations(range(constraints.n), r)
        if not constraints.violations(s)
    )
    return max(found, key=lambda entry: entry[0])


def new_run() -> Run:
    return Run(np.random.default_rng(0))


def hold_bounds_against_brute_force(seed: int, offsets: int = 0) -> None:
    objective, constraints = small_problem(seed, offsets)
    best, placement = best_placement(objective, constraints)
    beat = best * (1.0 - 1e-9)
    relaxed = best_fraction(objective, root_choice(constraints), new_run())
    assert relaxed.bound >= best * (1.0 - 1e-12)
    line = make_line(objective, constraints, np.flatnonzero(constraints.usable()))
    k, white = constraints.budget, stand_in(objective)
    rng = np.random.default_rng([seed, 1])
    anything = rng.uniform(0.0, 1.0, constraints.n)  # any background is valid, even out of budget
    for share, y in itertools.product(SHARES, (relaxed.x, anything)):
        background = background_of(white, y)
        if offsets and y is relaxed.x:
            background = chains_of(objective, y) or background
        first = Tempered(objective, line, k, share, background, new_run())
        assert first.bound() >= best - 1e-12
        left = first.survivors(beat)
        assert set(placement) <= set(left.candidate)
        if k >= 2:
            again = Tempered(objective, left, k, share, background, new_run())
            second = SecondOrder(again, beat)
            assert max(second.bound(), beat) >= best * (1.0 - 1e-9)
            assert second.bound() <= first.bound() * (1.0 + 1e-5) + 1e-4
            assert set(placement) <= set(second.survivors(beat).candidate)
            hold_diagrams(first, second, best, placement, int(rng.integers(1, 5)))


def hold_diagrams(
    first: Tempered, second: SecondOrder, best: float, placement: tuple[int, ...], width: int
) -> None:
    """Hold diagrams over all arcs, and over those that the first order leaves, against the best."""
    beat = best * (1.0 - 1e-9)
    whole = Diagram(first, width, -np.inf)
    assert whole.bound() >= best - 1e-12
    assert whole.bound() <= first.bound() * (1.0 + 1e-6) + 1e-6
    assert set(placement) <= set(whole.survivors(beat).candidate)
    known = {"price": whole.price, "beyond": whole.beyond}
    low = best - 2.0 * whole.price  # so low that paths are told apart by what they waste
    for diagram in (
        Diagram(first, 4 * width, low),
        Diagram(first, width, beat, **known),
        Diagram(second.first, width, beat),
        Diagram(second.first, width, beat, second),
    ):
        assert max(diagram.bound(), beat) >= best * (1.0 - 1e-9)
        assert set(placement) <= set(diagram.survivors(beat).candidate)


@pytest.mark.parametrize("block", range(2))
def test_no_bound_is_below_the_best_placement_of_60_small_roads(block: int) -> None:
    for seed in range(30 * block, 30 * (block + 1)):
        hold_bounds_against_brute_force(seed)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(20))
def test_no_bound_is_below_the_best_placement_of_2000_more(block: int) -> None:
    for seed in range(1000 + 100 * block, 1000 + 100 * (block + 1)):
        hold_bounds_against_brute_force(seed)


@settings(max_examples=15, deadline=None)
@given(st.integers(10_000, 10**9))
@example(65_797_585)  # steps whose noise is nearly singular
def test_no_bound_is_below_the_best_placement_whatever_the_seed(seed: int) -> None:
    hold_bounds_against_brute_force(seed)


def test_search_finds_the_best_placement_and_its_bounds_hold_on_the_way() -> None:
    for seed in range(60):
        objective, constraints = small_problem(seed)
        if constraints.budget < 2:
            continue
        best, _ = best_placement(objective, constraints)
        relaxed = best_fraction(objective, root_choice(constraints), new_run())
        line = make_line(objective, constraints, np.flatnonzero(constraints.usable()))
        for share in (1.0, 0.6):
            first = Tempered(
                objective,
                line,
                constraints.budget,
                share,
                background_of(stand_in(objective), relaxed.x),
                new_run(),
            )
            found, reports = [0.5 * best], []

            def offer(chosen, found=found, objective=objective, constraints=constraints):  # type: ignore[no-untyped-def]
                if not constraints.violations(chosen):
                    found[0] = max(found[0], objective.value(np.sort(chosen)))

            chain = SecondOrder(first, found[0])
            finished = search(
                Diagram(first, 2, found[0], chain) if seed % 2 else chain,
                constraints,
                new_run(),
                lambda found=found: found[0],
                offer,
                reports.append,
            )
            assert finished
            assert found[0] == pytest.approx(best, rel=1e-9)
            assert min(reports) >= best * (1.0 - 1e-9)


@pytest.mark.parametrize("wrap", [False, True])
def test_pair_and_path_gains_equal_differences_of_values(wrap: bool) -> None:
    rng = np.random.default_rng(3)
    objective = Entropy([random_drive(rng, n_samples=80, n_candidates=12, wrap=wrap)])
    line = make_line(objective, Constraints(12, 4, np.full(12, -1), NONE, NONE), np.arange(12))
    y = rng.uniform(0.0, 0.3, 12)
    share = 0.7
    first = Tempered(objective, line, 4, share, background_of(objective, y), new_run())

    def score(positions: list[int]) -> float:
        x = (1.0 - share) * y
        x[line.candidate[positions]] += share
        return objective.relaxed(x)[0] - objective.relaxed((1.0 - share) * y)[0]

    for a in range(12):
        assert first.alone[a] == pytest.approx(score([a]), rel=1e-7, abs=1e-8)
        for b in range(a + 1, 12):
            want = score([a, b]) - score([a])
            assert first.pairs[a, b] >= want - 1e-10
            assert first.pairs[a, b] == pytest.approx(want, rel=1e-6, abs=1e-8)
    second = SecondOrder(first, -np.inf)
    arcs = second.arcs
    for arc in range(0, len(arcs.source), 5):
        h, j = int(arcs.source[arc]), int(arcs.target[arc])
        out = arcs.out[arcs.out_of[j] : arcs.out_of[j + 1]]
        for m, following in enumerate(out):
            i = int(arcs.target[following])
            want = score([h, j, i]) - score([h, j])
            gain = second.gains[arcs.triple[arc] + m]
            assert gain >= want - 1e-10
            assert gain == pytest.approx(want, rel=1e-6, abs=1e-8)
    with_each = gains_beyond(second, np.array([1, 4, 6]), np.array([8, 11]))
    assert with_each == pytest.approx([score([1, 4, 6, 8]), score([1, 4, 6, 11])], rel=1e-7)


def test_a_small_share_bounds_like_the_relaxation_and_a_whole_one_like_the_chain() -> None:
    objective = Entropy([random_drive(np.random.default_rng(8), n_samples=60, n_candidates=20)])
    constraints = Constraints(20, 5, np.full(20, -1), NONE, NONE)
    line = make_line(objective, constraints, np.arange(20))
    relaxed = best_fraction(objective, root_choice(constraints), new_run())
    background = background_of(objective, relaxed.x)
    nearly = Tempered(objective, line, 5, 1e-3, background, new_run()).bound()
    assert nearly == pytest.approx(relaxed.bound, rel=1e-3)
    chain = Tempered(objective, line, 5, 1.0, background, new_run())
    path = chain.path()
    gains = [objective.value(path[:1])]
    for i, j in itertools.pairwise(path):
        pair = objective.value(np.sort(np.array([i, j])))
        gains.append(pair - objective.value(np.array([i])))
    assert chain.bound() == pytest.approx(sum(gains), rel=1e-6)


def test_half_a_second_order_is_a_bound_between_the_first_and_the_second() -> None:
    for seed in (3, 12, 18, 27, 44, 50, 51):
        objective, constraints = small_problem(seed)
        best, _ = best_placement(objective, constraints)
        k = max(constraints.budget, 2)
        line = make_line(objective, constraints, np.flatnonzero(constraints.usable()))
        background = background_of(objective, np.zeros(constraints.n))
        first = Tempered(objective, line, k, 1.0, background, new_run())
        whole = SecondOrder(first, -np.inf)
        first.run = Run(np.random.default_rng(0), deadline=time.monotonic() + 0.9)
        none = SecondOrder(first, -np.inf)
        assert whole.complete
        assert not none.complete or not line.candidate.size
        assert whole.bound() <= none.bound() * (1.0 + 1e-6) + 1e-9
        assert best <= whole.bound()
        assert none.bound() == pytest.approx(first.bound(), rel=1e-6)


def test_bounds_of_all_budgets_rise_and_hold() -> None:
    objective = Entropy([random_drive(np.random.default_rng(9), n_samples=40, n_candidates=8)])
    constraints = Constraints(8, 5, np.full(8, -1), NONE, NONE)
    line = make_line(objective, constraints, np.arange(8))
    background = background_of(objective, np.full(8, 0.3))
    bounds = Tempered(objective, line, 5, 0.8, background, new_run()).bounds()
    assert np.all(np.diff(bounds) >= 0.0)
    for k in range(6):
        smaller = Constraints(8, k, np.full(8, -1), NONE, NONE)
        assert bounds[k] >= best_placement(objective, smaller)[0]


def solved(objective: Entropy, constraints: Constraints, **more: float) -> None:
    """Solve by `tempered` and hold the outcome against brute force."""
    solution = solve(Problem(objective, constraints), "tempered", **more)  # type: ignore[arg-type]
    best, _ = best_placement(objective, constraints)
    assert not constraints.violations(solution.selected)
    assert solution.status is Status.OPTIMAL, solution.stats
    assert solution.value == pytest.approx(best, rel=1e-6)
    assert solution.bound is not None
    assert solution.bound >= best


def test_small_roads_are_solved_to_optimality() -> None:
    for seed in range(40):
        solved(*small_problem(seed))


def test_duplicates_groups_of_one_and_blind_candidates_are_no_trouble() -> None:
    rng = np.random.default_rng(11)
    drive = random_drive(rng, n_samples=20, n_candidates=4)
    info = drive.information
    rows = [np.arange(info.indptr[i], info.indptr[i + 1]) for i in (0, 0, 1, 1, 1, 2)]
    entries = np.concatenate(rows)
    lengths = [*[len(r) for r in rows], 0, 0]
    twice = type(info)(
        info.n_samples,
        np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        info.indices[entries],
        info.blocks[entries],
        frames_per_sample=info.frames_per_sample,
    )
    objective = Entropy([Drive(drive.points, twice, CAR, drive.initial_sigma)])
    for group in (np.full(8, -1), np.arange(8), np.zeros(8, dtype=np.int64), np.arange(8) // 3):
        for k in (0, 1, 3, 8):
            solved(objective, Constraints(8, k, group, NONE, NONE))
    solved(objective, Constraints(8, 3, np.arange(8) // 3, np.array([6]), NONE))


def test_cameras_that_see_nothing_at_all_are_worth_nothing() -> None:
    drive = random_drive(np.random.default_rng(12), n_samples=10, n_candidates=3)
    blind = type(drive.information)(
        10, np.zeros(6, np.int64), np.empty(0, np.int32), np.empty((0, 1), np.float32)
    )
    objective = Entropy([Drive(drive.points, blind, CAR, drive.initial_sigma)])
    solution = solve(Problem(objective, Constraints(5, 2, np.full(5, -1), NONE, NONE)), "tempered")
    assert (solution.value, solution.bound) == (0.0, 0.0)
    assert solution.status is Status.OPTIMAL


@pytest.mark.parametrize("strength", [1e-4, 1e8])
def test_ill_conditioned_information_keeps_bounds_above_values(strength: float) -> None:
    for seed in range(10):
        drive = random_drive(
            np.random.default_rng([13, seed]), n_samples=20, n_candidates=7, strength=strength
        )
        objective = Entropy([drive])
        constraints = Constraints(7, 3, np.full(7, -1), NONE, NONE)
        solution = solve(Problem(objective, constraints), "tempered")
        assert solution.bound is not None
        assert solution.bound >= best_placement(objective, constraints)[0] * (1.0 - 1e-12)


def test_time_is_kept_and_the_incumbent_returned_with_a_bound() -> None:
    drive = random_drive(np.random.default_rng(14), n_samples=400, n_candidates=1500)
    problem = Problem(Entropy([drive]), Constraints(1500, 12, np.arange(1500) // 5, NONE, NONE))
    solution = solve(problem, "tempered", time_limit_s=2.0)
    assert solution.seconds <= 3.0
    assert solution.bound is not None
    assert len(solution.selected) == 12


def test_an_interrupt_keeps_the_placement_and_its_bound() -> None:
    drive = random_drive(np.random.default_rng(15), n_samples=80, n_candidates=60)
    problem = Problem(Entropy([drive]), Constraints(60, 6, np.full(60, -1), NONE, NONE))

    def stop(text: str, _share: float | None) -> None:
        if "first order" in text:
            raise KeyboardInterrupt

    solution = solve(problem, "tempered", progress=stop)
    assert solution.status is Status.TIME_LIMIT
    assert len(solution.selected) == 6
    assert solution.bound is not None
    assert solution.bound >= solution.value
