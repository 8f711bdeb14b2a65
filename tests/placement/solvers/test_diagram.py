"""The diagram's bound against every placement of thousands of tiny roads, views three deep."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.synthetic_drives import CAR, ROBOT, random_drive
from placement.constraints import Constraints, count_only
from placement.diagram.order import below, block_join, meet_of
from placement.diagram.passes import Diagram
from placement.objectives.base import Objective
from placement.objectives.trace import Trace
from placement.problem import Problem
from placement.solution import Status
from placement.solve import solve
from placement.solvers.diagram import free_choice, offset_drives, white_parts


def tiny(seed: int, c: int = 7, *, wrap: bool = False, offsets: int = 0) -> tuple[Trace, int]:
    rng = np.random.default_rng(seed)
    drive = random_drive(
        rng,
        n_samples=int(rng.integers(6, 22)),
        n_candidates=c,
        isotropic=bool(rng.integers(2)),
        longest_window=int(rng.integers(2, 14)),
        wrap=wrap,
        offsets=offsets,
        odometry=CAR if rng.integers(2) else ROBOT,
        initial_sigma=(0.1, 0.1, 0.01 * rng.integers(2)),
        strength=float(10.0 ** rng.uniform(0.0, 4.0)),
    )
    return Trace([drive], ("position", "lateral")[int(rng.integers(2))]), int(rng.integers(1, 5))


def best_value(objective: Objective, budget: int) -> float:
    c = objective.n_candidates
    sets = itertools.combinations(range(c), min(budget, c))
    return min(objective.value(np.array(s, dtype=np.int64)) for s in sets)


def depth(objective: Trace) -> int:
    """How many views overlap at the most crowded sample."""
    return int(np.bincount(objective.drives[0].information.indices).max())


def check_block(block: int, wrap: bool = False, offsets: int = 0) -> tuple[list[int], int]:
    """Sweep a hundred tiny roads by four efforts; return their depths and how many were tight."""
    depths, tight = [], 0
    for seed in range(100 * block, 100 * block + 100):
        objective, budget = tiny(seed, wrap=wrap, offsets=offsets)
        problem = Problem(objective.offsets_known(), count_only(7, budget))
        best = best_value(objective, budget)
        (_, part) = white_parts(problem)[0]
        persistent = offset_drives(Problem(objective, problem.constraints))[0]
        weights = part.w_tt, part.w_nn
        diagram = Diagram(part.drive, weights, *free_choice(problem), persistent)
        n = part.drive.n_samples
        depths.append(depth(objective))
        for probing, width, coarse, slots, limit in (
            (True, 5, 1, 1, np.inf),
            (False, 1, 1, 1, np.inf),
            # what is pruned shows only where the threshold, which caps the bound, is above the best
            (False, 3, 2, 1, 1.5 * best * n),
            (False, 40, 40, 8, 1.2 * best * n),
        ):
            diagram.sweep(
                width, limit, lambda: False, probing=probing, coarse_width=coarse, slots=slots
            )
            assert diagram.bound / n <= best * (1.0 + 1e-9), (seed, width)
        tight += diagram.bound / n >= 0.99 * best
    return depths, tight


@pytest.mark.parametrize("block", range(4))
def test_no_sweep_bounds_above_the_best_of_all_placements(block: int) -> None:
    depths, tight = check_block(block)
    assert max(depths) >= 4
    assert tight >= 30  # the bound is no empty promise, though views overlap four deep


@pytest.mark.parametrize("offsets", [1, 2, 3])
def test_no_sweep_bounds_above_the_best_where_offsets_persist(offsets: int) -> None:
    _, tight = check_block(3000 + offsets, offsets=offsets)
    assert tight >= 10  # known offsets alone: three to eleven
    check_block(3010 + offsets, wrap=True, offsets=offsets)


def test_a_path_names_the_camera_that_stands_alone() -> None:
    named = 0
    for seed in range(40):
        objective, _ = tiny(seed, offsets=2)
        problem = Problem(objective.offsets_known(), count_only(7, 1))
        value = [objective.value(np.array([i])) for i in range(7)]
        (_, part) = white_parts(problem)[0]
        (persistent,) = offset_drives(Problem(objective, problem.constraints))
        weights = part.w_tt, part.w_nn
        diagram = Diagram(part.drive, weights, *free_choice(problem), persistent)
        outcome = diagram.sweep(200, np.inf, lambda: False, coarse_width=20, slots=8)
        assert outcome is not None
        if outcome.path:  # one camera can meet no other: what the path says is exact
            assert diagram.bound / part.drive.n_samples == pytest.approx(min(value), rel=1e-3)
            assert value[outcome.path[0]] == pytest.approx(min(value), rel=1e-3)
            named += 1
    assert named >= 30


def test_who_stands_in_for_another_in_clusters_need_not_do_so_alone() -> None:
    # whoever exceeds another's white information may err far more for good
    tight = replaced = 0
    for seed in range(60):
        objective, budget = tiny(seed, c=3, offsets=2)
        (drive,) = objective.drives
        info = drive.information
        assert info.white is not None
        assert info.offsets is not None
        twice = replace(
            info,
            indptr=np.concatenate([info.indptr, info.indptr[-1] + info.indptr[1:]]),
            indices=np.tile(info.indices, 2),
            blocks=np.tile(info.blocks, (2, 1)),
            white=np.concatenate([info.white, 2.0 * info.white]),
            offsets=np.concatenate([info.offsets, 30.0 * info.offsets]),
        )
        objective = Trace([replace(drive, information=twice)], objective.weight)
        problem = Problem(objective.offsets_known(), count_only(6, min(budget, 2)))
        best = best_value(objective, min(budget, 2))
        (_, part) = white_parts(problem)[0]
        (persistent,) = offset_drives(Problem(objective, problem.constraints))
        weights = part.w_tt, part.w_nn
        diagram = Diagram(part.drive, weights, *free_choice(problem), persistent)
        replaced += np.setdiff1d(np.arange(3), diagram.moves.candidate).size
        n = part.drive.n_samples
        for width in (3, 30):
            diagram.sweep(width, 1.5 * best * n, lambda: False)
            assert diagram.bound / n <= best * (1.0 + 1e-9), seed
        tight += diagram.bound / n >= 0.99 * best
    assert tight >= 10
    assert replaced >= 50


@pytest.mark.slow
@pytest.mark.parametrize("block", range(4, 44))
def test_no_sweep_bounds_above_the_best_on_thousands_of_roads(block: int) -> None:
    depths, tight = check_block(block)
    assert sum(d >= 3 for d in depths) >= 50
    assert tight >= 30
    check_block(1000 + block, wrap=True)
    check_block(2000 + block, offsets=1 + block % 3)


@pytest.mark.parametrize("offsets", [0, 1, 2])
def test_cameras_that_see_both_ends_of_a_lap_are_bounded_without_their_tails(
    offsets: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # as on long laps: no room for moves from the first sample to the last
    monkeypatch.setattr("placement.diagram.layout.MOST_PENDING", 130)
    split = 0
    for seed in range(100):
        objective, budget = tiny(seed, wrap=True, offsets=offsets)
        problem = Problem(objective.offsets_known(), count_only(7, budget))
        persistent = offset_drives(Problem(objective, problem.constraints))[0]
        (_, part) = white_parts(problem)[0]
        weights = part.w_tt, part.w_nn
        try:
            diagram = Diagram(part.drive, weights, *free_choice(problem), persistent)
        except ValueError as error:
            assert "method diagram needs views of at most" in str(error)
            continue
        split += bool(np.any(diagram.base > 0.0))
        n = part.drive.n_samples
        best = best_value(objective, budget)
        for width in (2, 20):
            diagram.sweep(width, 1.5 * best * n, lambda: False)
            assert diagram.bound / n <= best * (1.0 + 1e-9), seed
    assert split >= 10


def test_a_higher_threshold_forgets_what_was_proven_below_a_lower_one() -> None:
    for seed in range(40):
        objective, budget = tiny(seed)
        problem = Problem(objective, count_only(7, budget))
        (_, part) = white_parts(problem)[0]
        diagram = Diagram(part.drive, (part.w_tt, part.w_nn), *free_choice(problem))
        best = best_value(objective, budget) * part.drive.n_samples
        for share in (0.5, 0.9, 2.0, 1.0 + 1e-9):
            outcome = diagram.sweep(10, share * best, lambda: False)
            assert outcome is not None
            assert outcome.bound <= min(share, 1.0 + 1e-9) * best
            assert diagram.bound <= best * (1.0 + 1e-9)


def test_known_offsets_bound_persistent_ones_from_below_and_auto_says_so() -> None:
    for seed in range(12):
        objective, budget = tiny(seed, offsets=2)
        assert objective.persistent
        known = objective.offsets_known()
        for chosen in itertools.combinations(range(7), 2):
            picked = np.array(chosen, dtype=np.int64)
            assert known.value(picked) <= objective.value(picked) * (1.0 + 1e-12)
        best = best_value(objective, budget)
        for method in ("auto", "diagram"):
            solution = solve(Problem(objective, count_only(7, budget)), method)
            assert solution.bound is not None
            assert solution.bound <= best * (1.0 + 1e-9)
            assert solution.value >= best * (1.0 - 1e-9)
            assert "bound_from" in solution.stats


def test_auto_bounds_trace_whatever_the_constraints_and_the_time() -> None:
    for seed in range(8):
        objective, budget = tiny(seed, c=9, wrap=bool(seed % 2))
        rng = np.random.default_rng(seed)
        constraints = Constraints(
            9,
            budget,
            np.arange(9) // 2,
            np.array([4]),
            np.array([1]),
            cost=rng.integers(0, 4, 9) * 1.0,
            money=5.0,
        )
        problem = Problem(objective, constraints)
        if constraints.violations([4]):
            continue
        best = min(
            objective.value(np.array(s, dtype=np.int64))
            for size in range(budget + 1)
            for s in itertools.combinations(range(9), size)
            if not constraints.violations(s)
        )
        for seconds in (0.0, 0.5, np.inf):
            solution = solve(problem, "auto", time_limit_s=seconds)
            assert solution.bound is not None
            assert 0.0 <= solution.bound <= best * (1.0 + 1e-9)
            assert solution.value >= best * (1.0 - 1e-9)


def test_the_method_proves_optima_and_keeps_groups_and_required_poses() -> None:
    for seed in range(12):
        objective, budget = tiny(seed, c=9)
        group = np.arange(9) // 2
        constraints = Constraints(9, budget, group, np.array([4]), np.array([1]))
        problem = Problem(objective, constraints)
        solution = solve(problem, "diagram", time_limit_s=20.0)
        assert solution.status.has_placement
        allowed = [
            s
            for size in range(budget + 1)
            for s in itertools.combinations(range(9), size)
            if not constraints.violations(s)
        ]
        best = min(objective.value(np.array(s, dtype=np.int64)) for s in allowed)
        assert solution.bound is not None
        assert solution.bound <= best * (1.0 + 1e-9)
        assert 4 in solution.selected


def test_two_drives_are_bounded_together() -> None:
    rng = np.random.default_rng(5)
    drives = [random_drive(rng, 14, 6, isotropic=True) for _ in range(2)]
    objective = Trace(drives)
    solution = solve(Problem(objective, count_only(6, 2)), "diagram")
    assert solution.bound is not None
    assert solution.bound <= best_value(objective, 2) * (1.0 + 1e-9)


def test_no_cameras_and_no_time_still_bound() -> None:
    objective, _ = tiny(3)
    none = solve(Problem(objective, count_only(7, 0)), "diagram")
    assert none.status is Status.OPTIMAL
    hurried = solve(Problem(objective, count_only(7, 3)), "diagram", time_limit_s=0.0)
    assert hurried.bound is not None
    assert hurried.bound <= best_value(objective, 3)


def test_other_objectives_are_refused(new_problem) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ValueError, match="method diagram needs the objective trace"):
        solve(new_problem(np.random.default_rng(0)), "diagram")


def random_covariance(rng: np.random.Generator) -> np.ndarray:
    factor = rng.normal(size=(3, 3)) * np.array([[1.0], [0.3], [0.01]])
    return factor @ factor.T


def six(p: np.ndarray) -> np.ndarray:
    return p[np.triu_indices(3)]


def test_meet_and_join_lie_on_their_sides_of_both() -> None:
    rng = np.random.default_rng(0)
    scale = np.diag([1.0, 1.0 / 0.3, 100.0])
    upper = np.triu_indices(3)
    for _ in range(300):
        a, b = random_covariance(rng), random_covariance(rng)
        low = np.zeros((3, 3))
        low[upper] = meet_of(six(a), six(b), 1e-9 * six(a) * 0.0)
        low = low + low.T - np.diag(np.diag(low))
        for other in (a, b):
            assert np.linalg.eigvalsh(scale @ (other - low) @ scale).min() >= -1e-8
        assert below(tuple(six(a)), tuple(six(1.001 * a)), 1.0)
        assert not below(tuple(six(1.001 * a)), tuple(six(a)), 1.0)
        c, d = (m[:2, :2] for m in (a, b))
        j = np.array(block_join(c[0, 0], c[0, 1], c[1, 1], d[0, 0], d[0, 1], d[1, 1]))
        join = np.array([[j[0], j[1]], [j[1], j[2]]])
        for other in (c, d):
            assert np.linalg.eigvalsh(join - other).min() >= -1e-9
