"""A city at the front door: what is kept while it is solved, what a stop leaves, who checks it."""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from placement import commands, verify
from placement.assemble import assemble, build_errors
from placement.cli import main
from placement.commands import INFORMATION, solve_into, validate_in
from placement.information import quarters
from placement.information.reference import dense_information
from placement.instance import load_instance
from placement.referee.nearby import information_nearby, localisation_nearby
from placement.referee.values import eyes_of, rebuild, sights_of, whole_value
from placement.referee.views import Views, pairs_within_reach
from placement.solution import Status
from placement.solve import solve
from placement.solvers import auto
from placement.verify import verify_folder

BLOCK_M = 70.0
TOML = """
[road]
file = "grid.geojson"
sample_spacing_m = 2.0
[mounts]
spacing_m = 30.0
[camera]
yaw_deg = [0, 90, 180, 270]
pitch_deg = [20, 40]
fov_deg = [[60, 45]]
max_range_m = 50
[objective]
kind = "localisation"
[budget]
cameras = 8
"""


def grid(n: int = 3) -> dict[str, Any]:
    """Draw n × n crossings, streets between neighbours, and a house in every other block."""
    features = []

    def add(kind: str, coordinates: Any, **properties: Any) -> None:
        geometry = {"type": kind, "coordinates": coordinates}
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})

    for i, j in itertools.product(range(n), repeat=2):
        for di, dj in ((1, 0), (0, 1)):
            if i + di < n and j + dj < n:
                ends = [[i * BLOCK_M, j * BLOCK_M], [(i + di) * BLOCK_M, (j + dj) * BLOCK_M]]
                add("LineString", ends, id=f"{i}-{j}-{di}", width_m=6.0)
        x, y = i * BLOCK_M + 8.0, j * BLOCK_M + 8.0
        if (i + j) % 2:
            ring = [[x, y], [x + 50, y], [x + 50, y + 50], [x, y + 50], [x, y]]
            add("Polygon", [ring], height=12)
    crs = {"type": "name", "properties": {"name": "local"}}
    return {"type": "FeatureCollection", "crs": crs, "features": features}


@pytest.fixture
def town(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write an instance that is treated as a city's, quarter by quarter; no figures are drawn."""
    monkeypatch.setattr(quarters, "POSES", 40)
    monkeypatch.setattr(quarters, "WORTH_KEEPING", 1)
    monkeypatch.setattr(auto, "CITY", 1)
    monkeypatch.setattr(commands, "entry_points", lambda group: [])
    (tmp_path / "grid.geojson").write_text(json.dumps(grid()))
    path = tmp_path / "town.toml"
    path.write_text(TOML)
    return path


def test_auto_cuts_a_city_into_regions_and_the_referee_finds_the_same(
    town: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = town.parent / "out"
    status = solve_into(out, str(town), quiet=True).status
    assert status in (Status.FEASIBLE, Status.OPTIMAL)
    assert not (out / INFORMATION).exists()
    record = json.loads((out / "solution.json").read_text())
    assert record["stats"]["chosen"] == "regions"
    found = verify_folder(out)
    assert found.passed
    assert found.bound["derived"] is not None
    # Where nobody looks through every pair, the bound is said to be on trust.
    monkeypatch.setattr(verify, "MOST_PAIRS", 10)
    trusting = verify_folder(out)
    assert trusting.passed
    assert trusting.bound["derived"] is None
    assert "too many to look through one by one" in trusting.trusted[0]


def test_auto_leaves_money_to_greedy(town: Path) -> None:
    town.write_text(TOML + "money = 5\n")
    instance = load_instance(town).changed({"camera.price": 1.0})
    solution = solve(assemble(instance).problem, "auto")
    assert solution.stats["chosen"] == "greedy"
    assert len(solution.selected) == 5


def test_ctrl_c_leaves_what_is_done_and_the_same_command_goes_on(
    town: Path,
    stop_writing_after: Callable[[int], list[int]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    written = stop_writing_after(2)
    out = town.parent / "out"
    words = ["placement", "solve", str(town), "--out", str(out), "--quiet"]

    def run() -> int:
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as stop:
            main()
        return int(stop.value.code or 0)

    assert run() == 3
    assert "the same command goes on from here" in capsys.readouterr().err
    assert (out / INFORMATION).is_dir()
    assert not (out / "solution.json").exists()
    assert run() == 0
    assert sorted(written) == list(range(len(written)))
    assert len(written) > 3
    assert not (out / INFORMATION).exists()
    resumed = json.loads((out / "solution.json").read_text())
    straight = solve(assemble(load_instance(town)).problem, "auto")
    assert resumed["selected"] == list(straight.selected)
    assert resumed["value"] == straight.value
    assert resumed["upper_bound"] == straight.bound


def test_a_solve_that_ran_out_of_time_leaves_its_information(town: Path) -> None:
    out = town.parent / "out"
    assert solve_into(out, str(town), time_limit_s=0.0, quiet=True).status is Status.TIME_LIMIT
    assert (out / INFORMATION).is_dir()
    solve_into(out, str(town), quiet=True)
    assert not (out / INFORMATION).exists()


def test_a_city_that_nobody_drives_is_not_validated_and_that_is_said_at_once(
    town: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = town.parent / "out"
    solve_into(out, str(town), quiet=True)
    monkeypatch.setattr("placement.assemble.assemble", lambda *_: pytest.fail("too late"))
    with pytest.raises(ValueError, match=r"give the instance a \[traffic\] table"):
        validate_in(out, runs=2, seed=0, quiet=True)


@pytest.mark.parametrize("model", ["covariance", "radius"])
def test_the_referee_views_nearby_what_the_twin_sees_of_everything(town: Path, model: str) -> None:
    instance = load_instance(town).changed({"errors.model": model})
    scene = assemble(instance)
    again = rebuild(instance)
    views = Views(again, scene.candidates)
    cameras, points = scene.candidates.cameras, scene.points
    reach, errors = instance.camera.max_range_m, build_errors(instance)
    dense = dense_information(cameras, points, errors, reach, scene.obstacles)
    assert 0 < views.parts[0].nnz == np.count_nonzero(dense[:, :, 0])
    for k, part in enumerate(views.parts):
        if dense.shape[2] == 1:
            wanted = np.zeros(dense.shape[:2]) if k == 1 else dense[:, :, 0]
        else:
            wanted = dense[:, :, k]
        np.testing.assert_allclose(part.toarray(), wanted, rtol=1e-6, atol=1e-9 * dense.max())
    places = np.column_stack([cameras.x_m, cameras.y_m])
    gaps = np.hypot(*(places[:, None] - points.xy).transpose(2, 0, 1))
    assert pairs_within_reach(again, scene.candidates) == np.sum(gaps <= reach * (1.0 + 1e-6))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*left out or mended")
def test_luxembourg_is_solved_and_verified_whole(
    shared_data: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commands, "entry_points", lambda group: [])
    network = shared_data("lust/luxembourg.net.xml.gz")
    source = Path(__file__).parents[2] / "benchmarks" / "luxembourg-city.toml"
    path = tmp_path / "city.toml"
    path.write_text(source.read_text().replace("../../shared/data/lust", str(network.parent)))
    out = tmp_path / "out"
    assert solve_into(out, str(path), quiet=True).status is Status.FEASIBLE
    record = json.loads((out / "solution.json").read_text())
    assert record["candidates"] > 1_000_000
    assert len(record["selected"]) == 2000
    assert 0.0 < record["gap"] < 0.05
    found = verify_folder(out)
    assert found.passed
    assert len(found.trusted) == 1


def test_the_referee_sees_nearby_what_it_sees_along_the_whole_path(town: Path) -> None:
    instance = load_instance(town)
    candidates = assemble(instance).candidates
    scene = rebuild(instance)
    eyes = eyes_of(candidates, list(range(0, len(candidates), 7)))
    information, seeing = information_nearby(scene, eyes)
    sights = sights_of(scene, eyes)
    np.testing.assert_array_equal(seeing, np.sum([sight.seen for sight in sights], axis=0))
    expected = np.tile(np.eye(2) / 0.25, (len(scene.xy), 1, 1))
    for sight in sights:
        expected[sight.seen] += np.linalg.inv(sight.whole[sight.seen])
    np.testing.assert_allclose(information, expected, rtol=1e-12)
    assert localisation_nearby(scene, eyes) == pytest.approx(whole_value(scene, eyes), rel=1e-12)
    assert seeing.max() > 1
    assert not seeing.all()
