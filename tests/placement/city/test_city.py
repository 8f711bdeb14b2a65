"""A small city: chunks against the whole, greedy against its definition, bounds against all."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.errors import ErrorModel
from models.geometry import FloatArray, IntArray
from models.network import Edge, Lane, RoadNetwork
from models.obstacles import Obstacles
from models.projections import Projection
from placement.city.dominance import undominated
from placement.city.information import Site, chunk_task
from placement.city.mounts import network_mounts, network_order
from placement.city.prices import certificate, price_region
from placement.city.regions import region_tasks
from placement.city.solve import (
    METHODS,
    CityProblem,
    alone_gains,
    compute_city,
    greedy,
    load_city,
    open_store,
    prove,
    solve_city,
    swapped,
)
from placement.cluster import Serial
from placement.information import Information, compute_information
from placement.information.chunks import Chunk
from placement.information.surroundings import Surroundings
from placement.instance.schema import CameraSection, MountsSection
from placement.objectives.localisation import Localisation


def grid_network(n: int = 3, block_m: float = 80.0) -> RoadNetwork:
    """Make n × n crossings with a carriageway either way between neighbours."""
    edges, nodes = [], {}
    for i, j in itertools.product(range(n), repeat=2):
        nodes[f"{i}-{j}"] = (i * block_m, j * block_m)
        for di, dj in ((1, 0), (0, 1)):
            if i + di < n and j + dj < n:
                a = np.array([i, j]) * block_m
                b = np.array([i + di, j + dj]) * block_m
                for start, end, p, q in (
                    (f"{i}-{j}", f"{i + di}-{j + dj}", a, b),
                    (f"{i + di}-{j + dj}", f"{i}-{j}", b, a),
                ):
                    along = (q - p) / block_m
                    right = 1.6 * np.array([along[1], -along[0]])
                    shape = np.array([p + 8.0 * along + right, q - 8.0 * along + right])
                    lane = Lane(shape=shape, left_m=1.6, right_m=1.6)
                    edges.append(Edge(f"{start}>{end}", start, end, (lane,), 13.9, 3.2))
    return RoadNetwork(edges=tuple(edges), nodes=nodes)


def house(x: float, y: float, half: float = 15.0) -> FloatArray:
    return np.array([[x, y]]) + half * np.array(
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
    )


def small_site() -> Site:
    obstacles = Obstacles((house(40.0, 40.0, 28.0), house(120.0, 40.0)), np.array([10.0, 10.0]))
    network = replace(grid_network(), obstacles=obstacles)
    order = network_order(network)
    samples = network.sample(1.0, order)
    mounts = network_mounts(
        network,
        order,
        MountsSection(spacing_m=20.0),
        CameraSection(yaw_deg=(0.0, 90.0, 135.0), pitch_deg=(20.0, 40.0), fov_deg=((60.0, 45.0),)),
    )
    return Site(mounts, samples.points, obstacles, ErrorModel("covariance"), 60.0)


@pytest.fixture(scope="module")
def site() -> Site:
    return small_site()


@pytest.fixture(scope="module")
def problem(site: Site, tmp_path_factory: pytest.TempPathFactory) -> CityProblem:
    store = open_store(tmp_path_factory.mktemp("store"), site, {})
    compute_city(site, store)
    return load_city(site, store, 0.5)


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("placement.city.information.CHUNK_MOUNTS", 16)


def test_mounts_stand_right_of_their_carriageway_and_on_none(site: Site) -> None:
    m = site.mounts
    gap = np.hypot(m.x_m[:, None] - site.points.x_m, m.y_m[:, None] - site.points.y_m).min(axis=1)
    assert np.all(gap >= 1.6 - 1e-9)
    assert np.all(gap <= np.hypot(3.1, 0.5) + 1e-9)  # samples stand a metre apart
    cameras = m.cameras(np.arange(m.n_candidates))
    assert np.allclose(cameras.x_m, np.repeat(m.x_m, len(m.poses)))


def test_chunks_hold_what_the_whole_matrix_does(site: Site, problem: CityProblem) -> None:
    everyone = site.mounts.cameras(np.arange(site.mounts.n_candidates))
    whole = compute_information(
        everyone, site.points, site.errors, site.max_range_m, obstacles=site.obstacles
    )
    indptr, indices, blocks = problem.csr
    kept = problem.rows.candidates
    assert np.all(np.diff(kept) > 0)
    assert 0 < len(kept) < site.mounts.n_candidates
    for row, candidate in enumerate(kept):
        here = slice(indptr[row], indptr[row + 1])
        there = slice(whole.indptr[candidate], whole.indptr[candidate + 1])
        np.testing.assert_array_equal(indices[here], whole.indices[there])
        np.testing.assert_array_equal(blocks[here], whole.blocks[there])
    dropped = np.setdiff1d(np.arange(site.mounts.n_candidates), kept)
    for b in dropped:
        rivals = kept[kept // len(site.mounts.poses) == b // len(site.mounts.poses)]
        assert not row_of(whole, int(b)) or any(covers(whole, int(a), int(b)) for a in rivals)


def row_of(information: Information, i: int) -> dict[int, FloatArray]:
    begin, end = information.indptr[i], information.indptr[i + 1]
    return {
        int(t): block.astype(np.float64)
        for t, block in zip(
            information.indices[begin:end], information.blocks[begin:end], strict=True
        )
    }


def covers(information: Information, a: int, b: int) -> bool:
    mine, other = row_of(information, a), row_of(information, b)
    if not set(other) <= set(mine):
        return False
    for t, block in other.items():
        d = mine[t] - block
        if np.linalg.eigvalsh(np.array([[d[0], d[1]], [d[1], d[2]]]))[0] < -1e-9:
            return False
    return True


def random_rows(
    rng: np.random.Generator, c: int, t: int, width: int
) -> tuple[IntArray, IntArray, FloatArray]:
    seen = [np.sort(rng.choice(t, rng.integers(0, t), replace=False)) for _ in range(c)]
    indptr = np.concatenate([[0], np.cumsum([len(s) for s in seen])]).astype(np.int64)
    n = int(indptr[-1])
    a, b = rng.integers(1, 4, (2, n)).astype(float)
    blocks = np.column_stack([a, rng.uniform(-1, 1, n) * np.sqrt(a * b), b])[:, :width]
    return indptr, np.concatenate(seen).astype(np.int32), blocks.astype(np.float32)


@pytest.mark.parametrize("width", [1, 3])
def test_what_is_dropped_is_dominated_and_what_stays_is_not(width: int) -> None:
    rng = np.random.default_rng(width)
    for _ in range(20):
        mount = np.sort(rng.integers(0, 3, 9))
        indptr, indices, blocks = random_rows(rng, 9, 4, width)
        keep = undominated(mount, indptr, indices, blocks)
        three = blocks if width == 3 else np.column_stack([blocks, 0.0 * blocks, blocks])
        information = Information(4, indptr, indices, three)
        for b in range(9):
            rivals = [a for a in np.flatnonzero(keep & (mount == mount[b])) if a != b]
            beaten = not row_of(information, b) or any(covers(information, a, b) for a in rivals)
            assert beaten == (not keep[b])


def small_problem(rng: np.random.Generator, c: int = 10, mounts: int = 6) -> CityProblem:
    indptr, indices, blocks = random_rows(rng, c, 12, 3)
    group = np.sort(rng.integers(0, mounts, c))
    rows = Chunk(np.arange(c), indptr, indices, blocks)
    return CityProblem(rows, group, mounts, 12, rng.uniform(0.5, 2.0, 12), 0.7)


def best_of_all(problem: CityProblem, budget: int) -> float:
    best = 0.0
    for some in itertools.combinations(range(len(problem.group)), budget):
        if len(set(problem.group[list(some)])) == budget:
            best = max(best, problem.value(np.array(some)))
    return best


def test_the_value_is_the_objectives_own(problem: CityProblem) -> None:
    rows = problem.rows
    objective = Localisation(
        Information(problem.n_samples, rows.indptr, rows.indices, rows.blocks), 0.5
    )
    some = np.arange(3, len(problem.group), 11)
    assert problem.value(some) == pytest.approx(objective.value(some), rel=1e-12)


def test_lazy_greedy_takes_the_best_candidate_every_time(problem: CityProblem) -> None:
    chosen, gains = greedy(problem, 8, alone_gains(problem))
    for n in range(8):
        before = problem.value(chosen[:n])
        free = np.flatnonzero(~np.isin(problem.group, problem.group[chosen[:n]]))
        every = np.array([problem.value(np.append(chosen[:n], i)) - before for i in free])
        assert gains[n] == pytest.approx(every.max(), rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", range(6))
def test_no_placement_beats_the_certificate(seed: int, method: str) -> None:
    problem = small_problem(np.random.default_rng(seed))
    for budget in (1, 2, 4):
        solution = solve_city(problem, budget, method=method)
        best = best_of_all(problem, budget)
        assert solution.value <= best + 1e-9
        assert solution.bound >= best
        assert len(set(problem.group[solution.rows])) == len(solution.rows) <= budget


@pytest.mark.parametrize("seed", range(6))
def test_regions_that_share_samples_still_add_up_to_a_bound(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("placement.city.regions.REGION_ENTRIES", 1)
    problem = small_problem(np.random.default_rng(seed), c=12)
    alone = alone_gains(problem)
    chosen, gains = greedy(problem, 3, alone)
    bound, _, _ = prove(problem, 3, alone, chosen, float(gains[-1]), Serial())
    assert bound >= best_of_all(problem, 3)
    # Cut apart by force, mount by mount: looser, and still a bound.
    tasks, mounts = region_tasks(problem, alone, chosen, 0.0, float(gains[-1]), 20)
    parts = []
    for task, _ in tasks:
        for m in range(len(task.start) - 1):
            rows = np.arange(task.start[m], task.start[m + 1])
            at = np.concatenate([np.arange(task.indptr[i], task.indptr[i + 1]) for i in rows])
            counts = np.diff(task.indptr)[rows]
            parts.append(
                price_region(
                    type(task)(
                        np.array([0, len(rows)]),
                        np.concatenate([[0], np.cumsum(counts)]),
                        task.indices[at],
                        task.blocks[at],
                        task.weights,
                        task.scale,
                        np.flatnonzero(np.isin(rows, task.chosen)),
                        task.price,
                        20,
                    )
                )
            )
    apart, _ = certificate(parts, 3, 0.0, problem.n_mounts - mounts)
    assert apart >= best_of_all(problem, 3)


def test_the_certificate_of_a_small_city_is_close(problem: CityProblem) -> None:
    solution = solve_city(problem, 10)
    assert 0.0 <= solution.gap <= 0.05
    assert solution.price > 0.0


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("entries", [1, 10**6])
def test_no_single_swap_is_left_that_helps(
    seed: int, entries: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("placement.city.regions.REGION_ENTRIES", entries)
    problem = small_problem(np.random.default_rng(seed), c=14)
    alone = alone_gains(problem)
    start = np.flatnonzero(np.diff(problem.group, append=99))
    found, swaps = swapped(problem, start[:3], alone, 0.0, Serial())
    value = problem.value(found)
    assert value >= problem.value(start[:3])
    assert swaps > 0 or value == problem.value(start[:3])
    assert len(set(problem.group[found])) == len(found) == 3
    for n, j in itertools.product(range(3), range(len(problem.group))):
        other = np.append(np.delete(found, n), j)
        if len(set(problem.group[other])) == 3:
            assert problem.value(other) <= value * (1.0 + 1e-6)


def test_required_cameras_stay(problem: CityProblem) -> None:
    alone = alone_gains(problem)
    worst = np.array([int(np.argmin(alone))])
    chosen, gains = greedy(problem, 6, alone, required=worst)
    found, _ = swapped(problem, chosen, alone, float(gains[-1]), Serial(), worst)
    assert worst[0] in found


def test_partitions_find_almost_what_greedy_finds(problem: CityProblem) -> None:
    whole = solve_city(problem, 10).value
    assert solve_city(problem, 10, method="partitions").value >= 0.97 * whole
    assert solve_city(problem, 10, method="stochastic").value >= 0.9 * whole


def test_unknown_methods_and_empty_budgets_are_refused(problem: CityProblem) -> None:
    with pytest.raises(ValueError, match="method must be one of lazy, partitions, stochastic"):
        solve_city(problem, 3, method="magic")
    with pytest.raises(ValueError, match=r"budget\.cameras must be at least 1, got 0"):
        solve_city(problem, 0)


def test_a_stop_and_a_resume_compute_no_chunk_twice(
    site: Site,
    problem: CityProblem,
    tmp_path: Path,
    stop_writing_after: Callable[[int], list[int]],
) -> None:
    written = stop_writing_after(2)
    with pytest.raises(KeyboardInterrupt):
        compute_city(site, open_store(tmp_path, site, {}))
    assert compute_city(site, open_store(tmp_path, site, {})) == site.n_chunks - 2
    assert sorted(written) == list(range(site.n_chunks))
    again = load_city(site, open_store(tmp_path, site, {}), 0.5)
    np.testing.assert_array_equal(again.rows.blocks, problem.rows.blocks)
    np.testing.assert_array_equal(again.rows.candidates, problem.rows.candidates)


def test_damaged_chunks_and_those_of_another_city_do_not_count(site: Site, tmp_path: Path) -> None:
    store = open_store(tmp_path, site, {})
    compute_city(site, store)
    assert store.missing(site.n_chunks) == []
    assert open_store(tmp_path, site, {"other": 1}).missing(site.n_chunks) == list(
        range(site.n_chunks)
    )
    file = tmp_path / "chunk-00001.npz"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    (tmp_path / "chunk-00002.json").write_text("{")
    (tmp_path / "chunk-00003.npz").unlink()
    assert store.missing(site.n_chunks) == [1, 2, 3]
    with pytest.raises(ValueError, match=r"chunk-00001\.npz"):
        store.read(1)
    assert compute_city(site, store) == 3


def test_too_many_candidates_are_refused_with_the_figure_and_what_to_change() -> None:
    network = grid_network()
    order = network_order(network)
    camera = CameraSection(yaw_deg=tuple(np.linspace(0.0, 179.0, 180)))
    with (
        warnings.catch_warnings(),
        pytest.raises(ValueError, match=r"50,000,000, got [\d,]+ .*raise mounts\.spacing_m"),
    ):
        network_mounts(network, order, MountsSection(spacing_m=0.001), camera)


def test_a_lens_is_that_of_the_instance() -> None:
    network = grid_network()
    camera = CameraSection(projection="equidistant", distortion=(-0.02, 0.001, 0.0, 0.0))
    mounts = network_mounts(network, network_order(network), MountsSection(spacing_m=40.0), camera)
    cameras = mounts.cameras(np.arange(5))
    np.testing.assert_array_equal(cameras.distortion, np.tile(camera.distortion, (5, 1)))
    assert set(cameras.projection.tolist()) == {int(Projection.EQUIDISTANT)}
    site = Site(mounts, network.sample(1.0).points, Obstacles(), ErrorModel(persistent=False), 40.0)
    task = chunk_task(site, Surroundings(site.points, site.obstacles), 0)
    assert task.mounts.distortion == camera.distortion


def test_two_lenses_share_no_chunk(tmp_path: Path) -> None:
    site = small_site()
    bent = replace(site, mounts=replace(site.mounts, distortion=(0.01, 0.0, 0.0, 0.0)))
    assert open_store(tmp_path, site, {}).key != open_store(tmp_path, bent, {}).key


@pytest.mark.parametrize(
    ("mounts", "camera", "key"),
    [
        ({"file": "poles.geojson"}, {}, "mounts.file"),
        ({"sides": ["left", "right"]}, {}, "mounts.sides"),
        ({"cost": 3.0}, {}, "mounts.cost"),
        ({}, {"catalogue": "types.csv"}, "camera.catalogue"),
        ({}, {"price": 2.0}, "camera.price"),
    ],
)
def test_what_would_be_ignored_is_refused_by_name(
    mounts: dict[str, Any], camera: dict[str, Any], key: str
) -> None:
    network = grid_network()
    with pytest.raises(ValueError, match=rf"^{key} must be"):
        network_mounts(
            network, network_order(network), MountsSection(**mounts), CameraSection(**camera)
        )
