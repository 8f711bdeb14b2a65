"""The studies of camera counts and of the crossing: their rows, on the quick settings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from placement.assemble import assemble
from placement.instance import load_instance
from placement.objectives.tolerance import Tolerance
from placement.prediction import predict
from placement.solve import solve
from reports import camera_count, intersection


def test_counts_lie_between_what_is_proven_and_what_plainer_plans_need(tmp_path: Path) -> None:
    camera_count.run(tmp_path, quick=True)
    counts = pd.read_csv(tmp_path / "counts.csv")
    assert (counts["at_least"] <= counts["cameras"]).all()
    assert (counts["cameras"] <= counts["uniform"].fillna(np.inf)).all()
    assert (counts["cameras"] <= counts["grid"].fillna(np.inf)).all()
    length = sum(piece["length"] for piece in camera_count.ROADS["bends of 50 m"])
    np.testing.assert_allclose(counts["per_km"], 1000.0 * counts["cameras"] / length, rtol=1e-5)
    assert (tmp_path / "cameras_per_km.svg").exists()


def test_the_cameras_of_a_case_keep_the_prediction_within_tolerance() -> None:
    case = camera_count.Case("tolerance", "bends of 50 m", tolerance_m=0.57)
    scene = assemble(case.instance())
    found = solve(scene.problem, "tolerance", time_limit_s=20.0)
    assert isinstance(scene.problem.objective, Tolerance)
    assert 2.0 * predict(scene, found.selected).lateral_sigma_m.max() <= 0.57 + 1e-9


def test_worse_installation_never_needs_fewer_cameras() -> None:
    needed = []
    for quality in (0.5, 2.0):
        case = camera_count.Case("installation", "bends of 50 m", tolerance_m=0.57, quality=quality)
        found = solve(assemble(case.instance()).problem, "tolerance", time_limit_s=20.0)
        needed.append((found.value, found.bound))
    assert needed[1][0] >= (needed[0][1] or 0.0)


@pytest.fixture(scope="module")
def crossing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("crossing")
    intersection.run(folder, quick=True, seed=1)
    return folder


def test_the_crossing_has_twelve_ways_that_start_and_end_on_their_arms(crossing: Path) -> None:
    scene = assemble(load_instance(crossing / "crossing.toml"))
    assert len(scene.journeys) == len(intersection.movements()) == 12
    direction = {"east": (1, 0), "north": (0, 1), "west": (-1, 0), "south": (0, -1)}
    middle = np.mean([journey.points.xy.mean(axis=0) for journey in scene.journeys], axis=0)
    for journey, (start, end, turn) in zip(scene.journeys, intersection.movements(), strict=True):
        first, last = journey.points.xy[[0, -1]] - middle
        assert np.dot(first, direction[start]) > 60.0
        assert np.dot(last, direction[end]) > 60.0
        turned = journey.points.heading_rad[-1] - journey.points.heading_rad[0]
        wanted = {"right": -np.pi / 2, "straight": 0.0, "left": np.pi / 2}[turn]
        assert turned == pytest.approx(wanted, abs=1e-3)


def test_the_crossing_is_symmetric_in_what_it_asks_and_better_with_more_cameras(
    crossing: Path,
) -> None:
    values = pd.read_csv(crossing / "values.csv").set_index(["k", "method"])["trace_m2"]
    assert values[4, "exchange"] <= values[4, "greedy"] + 1e-12
    assert values[4, "exchange"] < values[2, "exchange"]
    ways = pd.read_csv(crossing / "movements.csv")
    assert ways.groupby("k").size().tolist() == [12, 12]
    four = ways[ways["k"] == 4].groupby("k")["worst_2sigma_lateral_m"].max().item()
    two = ways[ways["k"] == 2].groupby("k")["worst_2sigma_lateral_m"].max().item()
    assert four < two
