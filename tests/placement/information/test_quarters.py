"""Information by quarters: bitwise the whole's, whatever the order of streets, and kept on disk."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.cameras import Cameras
from models.errors import ErrorModel
from models.geometry import FloatArray
from models.obstacles import Obstacles
from models.roads import RoadPoints
from placement.cluster import Serial
from placement.information import Information, compute_information, quarters
from placement.information.quarters import quarter_information

REACH_M = 40.0
Row = tuple[Cameras, RoadPoints, Obstacles]


def streets(rng: np.random.Generator, n: int = 14, length_m: int = 60) -> RoadPoints:
    """Sample n straight streets that lie about at random, one after the other."""
    start, turn = rng.uniform(0.0, 400.0, (n, 2)), rng.uniform(-3.0, 3.0, n)
    s = np.arange(float(length_m))
    xy = [
        a + s[:, None] * np.array([np.cos(t), np.sin(t)]) for a, t in zip(start, turn, strict=True)
    ]
    at = np.vstack(xy)
    along = np.arange(float(len(at)))
    return RoadPoints(along, at[:, 0], at[:, 1], np.repeat(turn, length_m), 0.0 * along)


def poles(rng: np.random.Generator, points: RoadPoints, m: int = 40) -> Cameras:
    """Put poles of one to four poses beside samples, and one where no street is."""
    at = rng.integers(0, len(points), m)
    places = np.vstack([points.xy[at] + rng.uniform(2.0, 5.0, (m, 2)), [[5000.0, 5000.0]]])
    xy: FloatArray = np.repeat(places, rng.integers(1, 5, len(places)), axis=0)
    c = len(xy)
    return Cameras(
        x_m=xy[:, 0],
        y_m=xy[:, 1],
        height_m=np.full(c, 6.0),
        yaw_rad=rng.uniform(-3.0, 3.0, c),
        pitch_rad=rng.uniform(0.3, 0.8, c),
        roll_rad=np.zeros(c),
        hfov_rad=np.full(c, 1.2),
        vfov_rad=np.full(c, 1.0),
        width_px=np.full(c, 2000),
        height_px=np.full(c, 1500),
        projection=np.zeros(c, np.int64),
        distortion=np.zeros((c, 4)),
    )


@pytest.fixture
def town(monkeypatch: pytest.MonkeyPatch) -> Row:
    monkeypatch.setattr(quarters, "POSES", 12)
    monkeypatch.setattr(quarters, "WORTH_KEEPING", 1)
    rng = np.random.default_rng(3)
    points = streets(rng)
    corners = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]])
    rings = tuple(corners + points.xy[i] + 3.0 for i in range(0, len(points), 90))
    return poles(rng, points), points, Obstacles(rings, np.full(len(rings), 8.0))


def assert_same(found: Information, whole: Information) -> None:
    assert found.n_samples == whole.n_samples
    assert found.frames_per_sample == whole.frames_per_sample
    for name in ("indptr", "indices", "blocks", "white", "offsets"):
        mine, other = getattr(found, name), getattr(whole, name)
        assert (mine is None) == (other is None)
        if mine is not None:
            assert mine.dtype == other.dtype
            np.testing.assert_array_equal(mine, other)


class Posted:
    """Do tasks as a worker elsewhere would: last one first, each sent there and back."""

    def run(self, function: Any, tasks: Any, name: str) -> Iterator[tuple[int, Any]]:
        assert name == "information"
        for i in reversed(range(len(tasks))):
            there = pickle.loads(pickle.dumps(tasks[i]))  # noqa: S301 - our own
            yield i, pickle.loads(pickle.dumps(function(there)))  # noqa: S301

    def close(self) -> None:
        """Hold nothing."""


@pytest.mark.parametrize(
    "errors",
    [ErrorModel("covariance"), ErrorModel("covariance", persistent=False), ErrorModel("radius")],
)
def test_quarters_hold_bitwise_what_the_whole_does(
    town: Row, errors: ErrorModel, tmp_path: Path
) -> None:
    cameras, points, obstacles = town
    whole = compute_information(
        cameras, points, errors, REACH_M, obstacles=obstacles, frames_per_sample=0.5
    )
    hidden = compute_information(cameras, points, errors, REACH_M)
    assert 0 < len(whole.indices) < len(hidden.indices)
    for work in (None, Serial(), Posted()):
        for keep in (None, tmp_path / "kept"):
            found = quarter_information(
                cameras, points, errors, REACH_M, obstacles=obstacles, frames_per_sample=0.5,
                work=work, keep=keep,
            )  # fmt: skip
            assert_same(found, whole)
    assert (tmp_path / "kept").is_dir() != errors.splits


def test_without_buildings_nothing_is_hidden(town: Row) -> None:
    cameras, points, _ = town
    errors = ErrorModel("ellipse")
    assert_same(
        quarter_information(cameras, points, errors, REACH_M),
        compute_information(cameras, points, errors, REACH_M),
    )


def test_a_stop_and_a_resume_compute_no_quarter_twice(
    town: Row, stop_writing_after: Callable[[int], list[int]], tmp_path: Path
) -> None:
    written = stop_writing_after(3)
    cameras, points, obstacles = town
    errors = ErrorModel("covariance", persistent=False)

    def run() -> Information:
        return quarter_information(
            cameras, points, errors, REACH_M, obstacles=obstacles, keep=tmp_path
        )

    with pytest.raises(KeyboardInterrupt):
        run()
    found = run()
    assert len(written) > 5
    assert sorted(written) == list(range(len(written)))
    assert_same(found, compute_information(cameras, points, errors, REACH_M, obstacles=obstacles))
    before = list(written)
    run()
    assert written == before


@pytest.mark.parametrize(
    "change",
    [
        lambda c, p, o, r: (c.subset(np.arange(1, len(c))), p, o, r),
        lambda c, p, o, r: (c, p, o.moved(0.5, 0.0), r),
        lambda c, p, o, r: (c, p, o, r + 1.0),
        lambda c, p, o, r: (c, replace(p, x_m=p.x_m + 0.1), o, r),
    ],
)
def test_what_was_kept_of_another_city_does_not_count(
    town: Row, change: Callable[..., tuple[Cameras, RoadPoints, Obstacles, float]], tmp_path: Path
) -> None:
    errors = ErrorModel("covariance", persistent=False)
    cameras, points, obstacles = town
    quarter_information(cameras, points, errors, REACH_M, obstacles=obstacles, keep=tmp_path)
    cameras, points, obstacles, reach = change(cameras, points, obstacles, REACH_M)
    found = quarter_information(cameras, points, errors, reach, obstacles=obstacles, keep=tmp_path)
    assert_same(found, compute_information(cameras, points, errors, reach, obstacles=obstacles))


def test_few_poses_and_persistent_errors_are_not_kept(
    town: Row, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    cameras, points, _ = town
    quarter_information(cameras, points, ErrorModel("covariance"), REACH_M, keep=tmp_path)
    monkeypatch.setattr(quarters, "WORTH_KEEPING", len(cameras) + 1)
    quarter_information(cameras, points, ErrorModel("radius"), REACH_M, keep=tmp_path)
    assert not list(tmp_path.iterdir())
