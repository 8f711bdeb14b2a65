"""The fewest cameras against every placement of hundreds of tiny roads, views four deep."""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.synthetic_drives import CAR, ROBOT, random_drive
from placement.constraints import Constraints, count_only
from placement.fewest.arrays import Effort
from placement.fewest.beam import Beam
from placement.fewest.bound import PROBE, Counting
from placement.fewest.course import whole_units
from placement.fewest.finding import find
from placement.objectives.navigation_chain import Drive
from placement.objectives.tolerance import Tolerance, white_part
from placement.objectives.windows.offsets import views_of
from placement.problem import Problem
from placement.solution import Status
from placement.solve import solve

C = 7
ROUGH = Effort(2, 1, 0.5)
FINE = Effort(200, 8, 1e-3)


def tiny_drive(rng: np.random.Generator, offsets: int = 0) -> Drive:
    return random_drive(
        rng,
        n_samples=int(rng.integers(10, 40)),
        n_candidates=C,
        isotropic=bool(rng.integers(2)),
        offsets=offsets,
        longest_window=int(rng.integers(3, 16)),
        odometry=CAR if rng.integers(2) else ROBOT,
        initial_sigma=(0.02, 0.02, 0.01 * rng.integers(2)),
        strength=float(10.0 ** rng.uniform(1.0, 4.0)),
    )


def tiny(
    rng: np.random.Generator,
    failures: int = 0,
    cost: np.ndarray | None = None,
    offsets: int = 0,
    drives: int = 1,
    draw: Callable[[np.random.Generator, int], Drive] = tiny_drive,
) -> Tolerance:
    """Draw a road and a tolerance between what all cameras reach, one dark, and what none do."""
    roads = [draw(rng, offsets) for _ in range(drives)]
    loose = Tolerance(roads, 1e6, failures, cost)
    worst = [
        max(float(part.lateral(working).max()) for part in loose.parts)
        for chosen in (np.arange(C), np.empty(0, dtype=np.int64))
        for working in (loose.scenarios(chosen) if chosen.size else [chosen])
    ]
    best, none = max(worst[:-1]), worst[-1]
    share = 10.0 ** rng.uniform(-3.0, -0.3)
    return Tolerance(roads, 2.0 * math.sqrt(best + share * (none - best)) * 1.0001, failures, cost)


def seen_twice(rng: np.random.Generator, offsets: int = 0) -> Drive:
    """Draw a road that some of its cameras see twice, with a long blindness between."""
    n = int(rng.integers(24, 48))
    drive = random_drive(
        rng,
        n_samples=n,
        n_candidates=C + 4,
        isotropic=bool(rng.integers(2)),
        offsets=offsets,
        longest_window=int(rng.integers(3, 7)),
        odometry=CAR if rng.integers(2) else ROBOT,
        initial_sigma=(0.02, 0.02, 0.01 * rng.integers(2)),
        strength=float(10.0 ** rng.uniform(1.0, 4.0)),
    )
    info = drive.information
    rows = [np.arange(info.indptr[i], info.indptr[i + 1]) for i in range(C + 4)]
    for i in range(C, C + 4):  # the last four become what the first three see besides
        seen = np.concatenate([rows[i % 3], rows[i]])
        _, once = np.unique(info.indices[seen], return_index=True)
        rows[i % 3] = seen[once]
    order = np.concatenate(rows[:C])
    merged = replace(
        info,
        indptr=np.concatenate([[0], np.cumsum([r.size for r in rows[:C]])]).astype(np.int64),
        indices=info.indices[order],
        blocks=info.blocks[order],
        white=None if info.white is None else info.white[order],
        offsets=None if info.offsets is None else info.offsets[order],
    )
    return replace(drive, information=merged)


def with_lesser_twins(rng: np.random.Generator, offsets: int = 0) -> Drive:
    """Draw a road whose last three cameras each tell no more than one of the first: or the same."""
    drive = tiny_drive(rng, offsets)
    info = drive.information
    rows = [np.arange(info.indptr[i], info.indptr[i + 1]) for i in range(C)]
    blocks = [info.blocks[r] for r in rows]
    for i in range(C - 3, C):
        of = int(rng.integers(0, 2))
        rows[i] = rows[of][int(rng.integers(0, 2)) * (rows[of].size > 1) :]
        blocks[i] = info.blocks[rows[i]] * np.float32(rng.choice([1.0, 1.0, 0.8, 0.3]))
    merged = replace(
        info,
        indptr=np.concatenate([[0], np.cumsum([r.size for r in rows])]).astype(np.int64),
        indices=info.indices[np.concatenate(rows)],
        blocks=np.ascontiguousarray(np.concatenate(blocks)),
    )
    return replace(drive, information=merged)


def subsets(c: int) -> list[np.ndarray]:
    return [
        np.array(s, dtype=np.int64)
        for n in range(c + 1)
        for s in itertools.combinations(range(c), n)
    ]


def best_price(objective: Tolerance, constraints: Constraints | None = None) -> float:
    return min(
        (
            objective.price(s)
            for s in subsets(objective.n_candidates)
            if (constraints is None or not constraints.violations(s)) and objective.feasible(s)
        ),
        default=math.inf,
    )


def counting_of(
    objective: Tolerance, number: int = 0, group: np.ndarray | None = None
) -> tuple[Counting, float]:
    usable = np.ones(C, dtype=np.bool_)
    units, unit = whole_units(objective.cost, usable)
    given = np.flatnonzero(units == 0)
    counting = Counting(
        white_part(objective.drives[number]), objective.limit, units > 0, given, units, C,
        objective.failures,
        views_of(objective.drives[number]) if objective.drives[number].persistent else None, group,
    )  # fmt: skip
    return counting, unit


@pytest.mark.parametrize("failures", [0, 1])
def test_the_bound_never_exceeds_the_fewest_of_all_placements(failures: int) -> None:
    tight, several = 0, 0
    for seed in range(70):
        rng = np.random.default_rng([failures, seed])
        objective = tiny(rng, failures)
        best = best_price(objective)
        counting, _ = counting_of(objective)
        assert counting.need <= best, seed  # stretches and chains alone
        for effort, probing in ((PROBE, True), (ROUGH, True), (ROUGH, False), (FINE, False)):
            for k in range(max(counting.need, int(counting.floor.max())), C + 2):
                counting.sweep(k, effort, probing=probing, stop=lambda: False)
                assert counting.need <= best, (seed, effort)
                if not probing and counting.need <= k:
                    break
        tight += counting.need == best
        several += best >= 2
    assert several >= 35
    assert tight >= (45 if not failures else 30)  # a camera used twice is what loosens most


@pytest.mark.parametrize("failures", [0, 1])
def test_no_camera_is_used_twice_but_for_those_it_exceeds(failures: int) -> None:
    check_twins(range(60), failures)


@pytest.mark.slow
@pytest.mark.parametrize("failures", [0, 1])
def test_no_camera_is_used_twice_on_thousands_of_roads(failures: int) -> None:
    check_twins(range(1000, 4000), failures)


def check_twins(seeds: range, failures: int) -> None:
    none = np.empty(0, dtype=np.int64)
    tight, several, told, closer = 0, 0, 0, 0
    for seed in seeds:
        rng = np.random.default_rng([17, failures, seed])
        cost = rng.choice([1.0, 2.0], C) if seed % 3 == 0 else None
        objective = tiny(rng, failures, cost, draw=with_lesser_twins)
        group = rng.permutation(np.arange(C) // 2)
        best = best_price(objective, Constraints(C, C, group, none, none))
        reached = []
        for mounts in (group, None):
            counting, unit = counting_of(objective, group=mounts)
            for effort, probing in ((PROBE, True), (ROUGH, False), (FINE, False)):
                for k in range(counting.need, 2 * C + 2):
                    before = counting.need
                    counting.sweep(k, effort, probing=probing, stop=lambda: False)
                    assert unit * counting.need <= best, (seed, effort)
                    if counting.need == before:
                        break
            reached.append(counting.need)
            told += bool(counting.course.twice.any())
        closer += reached[0] > reached[1]
        tight += unit * reached[0] == best
        several += 2 <= best < math.inf
    assert several >= 0.3 * len(seeds)
    assert tight >= 0.3 * len(seeds)
    assert told >= 0.3 * len(seeds)
    assert closer >= 1


def test_what_sweeps_find_is_in_tolerance_and_often_the_fewest() -> None:
    found_fewest, several = 0, 0
    for seed in range(60):
        rng = np.random.default_rng([19, seed])
        objective = tiny(rng, failures=seed % 2, draw=seen_twice if seed % 3 == 0 else tiny_drive)
        best = best_price(objective)
        if not 2 <= best <= C:
            continue
        several += 1
        counting, _ = counting_of(objective)
        found = find(counting, int(best), FINE, lambda: False)
        if found is not None and objective.feasible(np.array(found)):
            found_fewest += len(found) == best
    assert several >= 20
    assert found_fewest >= 0.6 * several


@pytest.mark.parametrize("offsets", [0, 2])
@pytest.mark.parametrize("failures", [0, 1])
def test_the_bound_holds_where_cameras_see_the_road_twice(failures: int, offsets: int) -> None:
    check_seen_twice(range(40 if not offsets else 15), failures, offsets)


@pytest.mark.slow
@pytest.mark.parametrize("offsets", [0, 2])
@pytest.mark.parametrize("failures", [0, 1])
def test_the_bound_holds_on_thousands_of_roads_seen_twice(failures: int, offsets: int) -> None:
    check_seen_twice(range(1000, 2500), failures, offsets)


def check_seen_twice(seeds: range, failures: int, offsets: int) -> None:
    twice, several, reached = 0, 0, []
    for seed in seeds:
        rng = np.random.default_rng([11, failures, offsets, seed])
        cost = rng.choice([100.0, 150.0, 400.0], C) if seed % 4 == 3 else None
        objective = tiny(rng, failures, cost, offsets, draw=seen_twice)
        best = best_price(objective)
        counting, unit = counting_of(objective)
        per_unit = counting.course.per_unit
        twice += per_unit > 1
        assert unit * counting.need <= best, seed
        for effort, probing in ((PROBE, True), (ROUGH, True), (ROUGH, False), (FINE, False)):
            for k in range(max(counting.need, -(-int(counting.floor.max()) // per_unit)), 10 * C):
                before = counting.need
                counting.sweep(k * per_unit, effort, probing=probing, stop=lambda: False)
                assert unit * counting.need <= best * (1.0 + 1e-9), (seed, effort)
                if counting.need == before:
                    break
        reached.append(unit * counting.need / best if best else 1.0)
        several += best >= 2
    assert twice >= 0.5 * len(seeds)
    assert several >= 0.4 * len(seeds)
    assert np.mean(reached) >= (0.3 if failures or offsets else 0.7)  # and no empty promise


@pytest.mark.parametrize("failures", [0, 1])
def test_the_method_finds_and_proves_the_fewest(failures: int) -> None:
    proven = 0
    for seed in range(14):
        objective = tiny(np.random.default_rng([7, failures, seed]), failures)
        best = best_price(objective)
        solution = solve(Problem(objective, count_only(C, C)), time_limit_s=20.0)
        assert solution.stats["chosen"] == "tolerance"
        assert solution.value == best, seed
        assert solution.bound is not None
        assert solution.bound <= best
        proven += solution.status is Status.OPTIMAL
    assert proven >= (7 if not failures else 5)


def test_the_cheapest_not_the_fewest_where_cameras_have_prices() -> None:
    for seed in range(7):
        rng = np.random.default_rng([3, seed])
        cost = rng.choice([0.0, 100.0, 150.0, 400.0], C) if seed % 2 else rng.uniform(1.0, 9.0, C)
        objective = tiny(rng, seed % 3 == 0, cost)
        best = best_price(objective)
        solution = solve(Problem(objective, count_only(C, C)), time_limit_s=20.0)
        assert solution.unit == "money"
        assert solution.bound is not None
        assert solution.bound <= best * (1.0 + 1e-9) + 1e-9, seed
        assert solution.value <= 1.3 * best + 1e-9, seed
        counting, unit = counting_of(objective)
        counting.prove(100, lambda: False)
        assert unit * counting.need <= best * (1.0 + 1e-9), seed


def test_persistent_errors_are_bounded_by_cameras_whose_offsets_are_known() -> None:
    for seed in range(10):
        objective = tiny(np.random.default_rng([4, seed]), seed % 2, offsets=2)
        best = best_price(objective)
        solution = solve(Problem(objective, count_only(C, C)), time_limit_s=20.0)
        assert solution.value == best, seed
        assert solution.bound is not None
        assert solution.bound <= best
        counting, _ = counting_of(objective)
        counting.prove(C + 1, lambda: False)
        assert counting.need <= best, seed
        assert "offset" in solution.stats["bound_relaxes"]


def test_a_camera_that_sees_both_ends_of_a_lap_is_no_window_of_a_lap() -> None:
    several = 0
    for seed in range(30):
        rng = np.random.default_rng([13, seed])
        offsets = 2 * (seed % 2)
        lap = random_drive(
            rng, 40, C, wrap=True, offsets=offsets, longest_window=14, strength=1e3,
            initial_sigma=(0.02, 0.02, 0.01),
        )  # fmt: skip
        loose = Tolerance([lap], 1e6)
        best, none = (
            float(loose.parts[0].lateral(s).max()) for s in (np.arange(C), np.empty(0, np.int64))
        )
        limit = best + 10.0 ** rng.uniform(-3.0, -0.3) * (none - best)
        objective = Tolerance([lap], 2.0001 * math.sqrt(limit), failures=seed % 3 == 0)
        counting, _ = counting_of(objective)
        assert counting.span <= 20
        counting.prove(C + 1, lambda: False)
        found = best_price(objective)
        assert counting.need <= found, seed
        several += 2 <= found <= C
    assert several >= 8


def test_every_drive_must_be_in_tolerance() -> None:
    for seed in range(8):
        objective = tiny(np.random.default_rng([5, seed]), drives=2)
        solution = solve(Problem(objective, count_only(C, C)), time_limit_s=20.0)
        assert solution.value == best_price(objective), seed
        assert solution.bound is not None
        assert solution.bound <= solution.value


def test_groups_required_and_forbidden_poses_are_kept() -> None:
    none = np.empty(0, dtype=np.int64)
    for seed in range(12):
        objective = tiny(np.random.default_rng([6, seed]))
        group = np.arange(C) // 2
        constraints = Constraints(C, C, group, np.array([2]), none)
        best = best_price(objective, constraints)
        solution = solve(Problem(objective, constraints), time_limit_s=20.0)
        if math.isinf(best):
            assert solution.status is Status.INFEASIBLE
            continue
        assert 2 in solution.selected
        assert solution.bound is not None
        assert solution.bound <= best
        assert solution.value <= best + 1


def test_what_is_in_tolerance_already_needs_no_camera() -> None:
    drive = tiny_drive(np.random.default_rng(0))
    for failures in (0, 1):
        objective = Tolerance([drive], 1e6, failures)
        solution = solve(Problem(objective, count_only(C, C)))
        assert solution.status is Status.OPTIMAL
        assert (solution.selected, solution.value, solution.bound) == ((), 0.0, 0.0)


def test_a_tolerance_beyond_all_candidates_is_refused_with_the_best_and_its_place() -> None:
    drive = tiny_drive(np.random.default_rng(1))
    with pytest.raises(ValueError, match=r"^objective.tolerance_m must be at least \S+, the 2σ"):
        Tolerance([drive], 1e-6)
    try:
        Tolerance([drive], 1e-6)
    except ValueError as error:
        best = float(str(error).split()[5].rstrip(","))
        place = float(str(error).split("s = ")[1].split()[0])
    objective = Tolerance([drive], 1.001 * best)
    lateral = objective.parts[0].lateral(np.arange(C))
    assert drive.points.s_m[int(np.argmax(lateral))] == pytest.approx(place, abs=0.51)


def test_too_small_a_budget_is_infeasible_in_clear_words() -> None:
    seen = 0
    for seed in range(30):
        objective = tiny(np.random.default_rng([8, seed]))
        best = best_price(objective)
        if best < 2 or best > C:
            continue
        solution = solve(Problem(objective, count_only(C, int(best) - 1)), time_limit_s=20.0)
        assert solution.status is Status.INFEASIBLE
        assert solution.selected == ()
        assert f"at most budget.cameras = {int(best) - 1}" in solution.stats["reason"]
        assert "are known to do" in solution.stats["reason"]
        seen += 1
    assert seen >= 5


def test_other_methods_either_meet_the_tolerance_or_say_that_they_did_not() -> None:
    met = 0
    for seed in range(6):
        objective = tiny(np.random.default_rng([9, seed]), seed % 2)
        best = best_price(objective)
        for method in ("greedy", "exchange", "search"):
            problem = Problem(objective, count_only(C, C), np.linspace(0.0, 30.0, C), 40.0)
            solution = solve(problem, method)
            if solution.status is Status.INFEASIBLE:
                assert "nothing in tolerance was found" in solution.stats["reason"]
            else:
                assert solution.value >= best
                met += 1
    assert met >= 12


def test_gains_are_changes_of_the_value() -> None:
    for seed in range(8):
        rng = np.random.default_rng([10, seed])
        objective = tiny(rng, seed % 2, offsets=2 * (seed % 3 == 0))
        chosen = rng.permutation(C)[: int(rng.integers(0, 4))]
        state = objective.state(np.sort(chosen))
        gains = state.gains()
        for i in range(C):
            if i not in chosen:
                after = objective.value(np.sort(np.append(chosen, i)))
                assert gains[i] == pytest.approx(objective.value(np.sort(chosen)) - after, rel=1e-9)


def test_reach_with_persistent_offsets_is_that_of_the_whole_filter() -> None:
    for seed in range(20):
        rng = np.random.default_rng([11, seed])
        objective = tiny(rng, offsets=3)
        part = objective.parts[0]
        chosen = np.sort(rng.permutation(C)[: int(rng.integers(0, 4))]).astype(np.int64)
        rows = np.setdiff1d(np.arange(C), chosen)
        _, reach = part.reach(chosen, rows)
        for i, got in zip(rows, reach, strict=True):
            lateral = part.lateral(np.sort(np.append(chosen, i)))
            above = np.flatnonzero(lateral > objective.limit)
            wanted = above[0] if above.size else part.n_samples
            assert int(got) == wanted, seed


def test_no_time_gives_a_placement_with_a_bound_and_a_stopped_beam_nothing() -> None:
    objective = tiny(np.random.default_rng(12))
    hurried = solve(Problem(objective, count_only(C, C)), time_limit_s=0.0)
    assert hurried.status in (Status.TIME_LIMIT, Status.OPTIMAL)
    assert hurried.bound is not None
    assert hurried.bound <= best_price(objective) <= hurried.value
    assert Beam(objective, count_only(C, C), 3, lambda: True).search() is None


def test_other_objectives_are_refused(new_problem) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError, match="method tolerance needs the objective tolerance"):
        solve(new_problem(np.random.default_rng(0)), "tolerance")
