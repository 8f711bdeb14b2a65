"""Drives over a small city: gains, greedy and bound against all placements."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.drives import drive_road, sample_routes
from models.geometry import IntArray
from models.vehicle import PROFILES
from placement.city.cuts import bound_trajectories, drawn_set
from placement.city.drives import CityDrives, city_drives
from placement.city.navigate import (
    Trajectories,
    TrajectoryProblem,
    greedy_trajectories,
    trajectory_problem,
)
from placement.city.solve import compute_city, open_store
from placement.city.trajectories import absorb
from placement.information import Information
from placement.information.chunks import Chunk, gather
from placement.objectives.entropy import Entropy
from placement.objectives.navigation_chain import Drive
from tests.placement.city.test_city import grid_network, small_site

SIGMA = (0.1, 0.1, 0.01)


@pytest.fixture(scope="module")
def drives() -> CityDrives:
    network = grid_network()
    rng = np.random.default_rng(2)
    routes = sample_routes(network, 5, rng)
    roads = [(drive_road(network, route), route.weight) for route in routes]
    return city_drives(roads, PROFILES["car"], spacing_m=2.0, speed_mps=10.0)


@pytest.fixture(scope="module")
def problem(drives: CityDrives, tmp_path_factory: pytest.TempPathFactory) -> TrajectoryProblem:
    site = replace(small_site(), points=drives.points)
    store = open_store(tmp_path_factory.mktemp("store"), site, {})
    compute_city(site, store)
    rows = gather(store, site.n_chunks)
    return trajectory_problem(
        rows, rows.candidates // len(site.mounts.poses), len(site.mounts), drives
    )


@pytest.fixture(scope="module")
def oracle(problem: TrajectoryProblem) -> Entropy:
    return entropy_of(problem)


def entropy_of(problem: TrajectoryProblem) -> Entropy:
    """Cut the rows drive by drive for the objective that knows single drives."""
    indptr, indices, blocks = problem.csr
    found = []
    for d in range(len(problem.drives)):
        begin, end = problem.drives.start[d], problem.drives.start[d + 1]
        inside = (indices >= begin) & (indices < end)
        counts = np.concatenate([[0], np.cumsum(inside)])[indptr]
        points = problem.drives.roads[d].sample(2.0)
        information = Information(
            n_samples=int(end - begin),
            indptr=counts.astype(np.int64),
            indices=(indices[inside] - begin).astype(np.int32),
            blocks=blocks[inside],
            frames_per_sample=float(problem.drives.frames[begin]),
        )
        weight = float(problem.drives.weights[d])
        found.append(Drive(points, information, PROFILES["car"], np.array(SIGMA), weight))
    return Entropy(found)


def test_drives_lie_end_to_end(drives: CityDrives) -> None:
    assert len(drives) == 5
    assert drives.start[-1] == len(drives.points) == len(drives.frames) == len(drives.steps)
    for d, road in enumerate(drives.roads):
        here = slice(drives.start[d], drives.start[d + 1])
        assert set(drives.owner[here]) == {d}
        assert drives.points.s_m[here][-1] == pytest.approx(road.length_m)
        spacing = float(np.diff(drives.points.s_m[here])[0])
        assert drives.frames[here] == pytest.approx(10.0 * spacing / 10.0)
    with pytest.raises(ValueError, match="drives must hold at least one drive"):
        city_drives([], PROFILES["car"])


def test_the_value_is_the_objectives_own(problem: TrajectoryProblem, oracle: Entropy) -> None:
    rng = np.random.default_rng(0)
    for size in (0, 1, 4, 20):
        rows = rng.choice(len(problem.group), size, replace=False)
        assert problem.value(rows) == pytest.approx(oracle.value(rows), rel=1e-12, abs=1e-12)


def test_gains_are_the_objectives_own_whatever_was_added_before(
    problem: TrajectoryProblem, oracle: Entropy
) -> None:
    rng = np.random.default_rng(1)
    rows = rng.choice(len(problem.group), 12, replace=False)
    mended, theirs = Trajectories(problem), oracle.state()
    d = problem.drives
    changed = np.zeros(len(d.points), np.int32)
    for now, i in enumerate(rows.tolist(), start=1):
        gains = np.bincount(
            problem.pair_row, mended.gains() * d.weights[problem.pairs[1]], len(problem.group)
        )
        free = ~np.isin(np.arange(len(gains)), rows[: now - 1])
        np.testing.assert_allclose(gains[free], theirs.gains()[free], rtol=1e-9, atol=1e-9)
        before = [array.copy() for array in mended.messages]
        absorb(i, problem.seen, mended.messages, changed, now)
        theirs.add(i)
        for old, new in zip(before[3:], mended.messages[3:], strict=True):
            assert np.all(changed[old != new] == now)
    afresh = Trajectories(problem)
    afresh.renew(mended.messages.total)
    for one, other in zip(mended.messages, afresh.messages, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)


def test_lazy_greedy_takes_the_best_candidate_every_time(
    problem: TrajectoryProblem, oracle: Entropy
) -> None:
    chosen, gains, work = greedy_trajectories(problem, 8)
    state = oracle.state()
    taken: set[int] = set()
    for i, gain in zip(chosen.tolist(), gains.tolist(), strict=True):
        free = np.array([int(g) not in taken for g in problem.group])
        best = np.where(free, state.gains(), -1.0)
        assert gain == pytest.approx(best.max(), rel=1e-9)
        assert best[i] == pytest.approx(best.max(), rel=1e-9)
        taken.add(int(problem.group[i]))
        state.add(i)
    assert gains.sum() == pytest.approx(problem.value(chosen), rel=1e-9)
    assert work["gains looked at"] < len(problem.group) * len(chosen)


def test_greedy_stops_when_asked_and_refuses_no_cameras(problem: TrajectoryProblem) -> None:
    chosen, gains, _ = greedy_trajectories(problem, 8, stop=lambda: True)
    assert len(chosen) == len(gains) == 1
    everything, _, _ = greedy_trajectories(problem, 10_000)
    assert len(everything) <= problem.n_mounts
    with pytest.raises(ValueError, match=r"budget\.cameras must be at least 1, got 0"):
        greedy_trajectories(problem, 0)


@pytest.mark.parametrize("seed", range(6))
def test_no_placement_beats_the_bound(problem: TrajectoryProblem, seed: int) -> None:
    rng = np.random.default_rng(seed)
    few = some_rows(problem, np.sort(rng.choice(len(problem.group), 9, replace=False)))
    budget = 1 + seed % 3
    best = max(
        few.value(np.array(rows))
        for size in range(budget + 1)
        for rows in itertools.combinations(range(9), size)
        if len({int(few.group[i]) for i in rows}) == size
    )
    chosen, _, _ = greedy_trajectories(few, budget)
    bound = bound_trajectories(few, budget, chosen, rounds=2, steps=30)
    assert few.value(chosen) <= best * (1.0 + 1e-12) <= bound * (1.0 + 1e-12)
    # any mixture and any sets are a bound: also those of a bad placement
    wrong = bound_trajectories(few, budget, np.array([8, 0, 4]), rounds=1, steps=3)
    assert best <= wrong * (1.0 + 1e-12)


def some_rows(problem: TrajectoryProblem, rows: IntArray) -> TrajectoryProblem:
    """Cut the problem down to a few candidates."""
    indptr, indices, blocks = problem.csr
    counts = np.diff(indptr)[rows]
    at = np.concatenate([np.arange(indptr[i], indptr[i + 1]) for i in rows])
    chunk = Chunk(
        problem.rows.candidates[rows],
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        indices[at],
        blocks[at],
    )
    return trajectory_problem(chunk, problem.group[rows], problem.n_mounts, problem.drives)


def test_the_bound_of_greedy_is_not_far_away(problem: TrajectoryProblem) -> None:
    chosen, gains, _ = greedy_trajectories(problem, 6)
    bound = bound_trajectories(problem, 6, chosen)
    assert gains.sum() <= bound <= 1.6 * gains.sum()


def test_sets_are_drawn_one_a_mount(problem: TrajectoryProblem) -> None:
    rng = np.random.default_rng(0)
    share = rng.random(len(problem.group))
    rows = drawn_set(problem, share, 0.3, rng)
    assert 0 < len(rows) == len(set(problem.group[rows].tolist()))
    assert not len(drawn_set(problem, 0.0 * share, 1.0, rng))


def test_a_chunk_that_no_drive_passes_is_empty(drives: CityDrives, tmp_path: Path) -> None:
    site = small_site()
    away = replace(site, points=replace(drives.points, x_m=drives.points.x_m + 1e6))
    store = open_store(tmp_path, away, {})
    compute_city(away, store)
    rows = gather(store, away.n_chunks)
    assert len(rows.candidates) == len(rows.indices) == 0
