"""What cameras tell a car: through displaced cameras, pixels, and the nominal camera back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.cameras import Cameras, X, make_camera
from models.control import SpeedPolicy
from models.errors import (
    ErrorModel,
    error_covariance,
    measurement_covariance,
    split_covariance,
)
from models.following import Course, course
from models.installation import Installation
from models.roads import Piece, road_from_pieces
from models.sensing import Sensors, believe, install, observe, sensors

ROAD = road_from_pieces([Piece(100.0)])
CAMERA = make_camera(x_m=30.0, y_m=3.0, yaw_deg=190.0, pitch_deg=40.0, size_px=(900, 900))


def course_of_road() -> Course:
    return course(ROAD, SpeedPolicy())


def look(
    s: Sensors, real: np.ndarray, x: float, y: float, rng: np.random.Generator, noisy: bool = True
) -> np.ndarray:
    seen = np.empty((2 * len(real), 3))
    return seen[: observe(s, real, x, y, noisy, rng, seen)]


def test_a_perfect_camera_reports_the_truth() -> None:
    s = sensors(CAMERA, ErrorModel(), course_of_road())
    rng = np.random.default_rng(0)
    real = install(s, rng, 0.0)
    np.testing.assert_array_equal(real, s.table)
    seen = look(s, real, 22.0, 0.3, rng, noisy=False)
    np.testing.assert_allclose(seen, [[0.0, 22.0, 0.3]], atol=1e-9)


def test_reports_scatter_as_the_filter_believes() -> None:
    errors = ErrorModel("covariance", Installation(0.03, 0.5, 4.0))
    s = sensors(CAMERA, errors, course_of_road())
    rng = np.random.default_rng(1)
    truth = np.array([21.0, -0.5])
    reports = []
    for _ in range(4000):
        reports += list(look(s, install(s, rng, 1.0), *truth, rng)[:, 1:])
    found = np.cov(np.array(reports).T)
    white, offsets = np.empty(3), np.empty((2, 6))
    believe(s, 0, *truth, True, white, offsets)
    believed = offsets @ offsets.T + [[white[0], white[1]], [white[1], white[2]]]
    # 4000 samples: a variance is known to 2.2 % (one sigma)
    np.testing.assert_allclose(found, believed, atol=0.07 * believed.max())


def test_one_installation_is_one_bias() -> None:
    s = sensors(CAMERA, ErrorModel(), course_of_road())
    rng = np.random.default_rng(2)
    white, offsets = np.empty(3), np.empty((2, 6))
    believe(s, 0, 21.0, 0.0, True, white, offsets)
    means = []
    for _ in range(200):
        real = install(s, rng, 1.0)
        reports = np.concatenate([look(s, real, 21.0, 0.0, rng) for _ in range(30)])
        means.append(reports[:, 1:].mean(axis=0))
        assert reports[:, 1].var() < 2.0 * white[0]
    assert np.var(means, axis=0)[0] == pytest.approx((offsets @ offsets.T)[0, 0], rel=0.4)


def test_installation_errors_that_do_not_persist_are_drawn_for_each_frame() -> None:
    errors = ErrorModel("covariance", persistent=False)
    s = sensors(CAMERA, errors, course_of_road())
    rng = np.random.default_rng(3)
    reports = np.concatenate([look(s, s.table, 21.0, 0.0, rng) for _ in range(2000)])[:, 1:]
    whole = error_covariance(CAMERA, np.array([0]), np.array([[21.0, 0.0]]), errors)[0]
    assert reports[:, 0].var() == pytest.approx(whole[0], rel=0.15)
    white, offsets = np.empty(3), np.zeros((2, 6))
    believe(s, 0, 21.0, 0.0, True, white, offsets)
    np.testing.assert_allclose(white, whole)
    np.testing.assert_array_equal(offsets, 0.0)


@pytest.mark.parametrize("kind", ["radius", "ellipse", "covariance"])
def test_the_filters_believe_what_the_error_model_says(kind: str) -> None:
    errors = ErrorModel(kind)
    s = sensors(CAMERA, errors, course_of_road())
    at = np.array([[20.0, 1.0]])
    white, offsets = np.empty(3), np.empty((2, 6))
    believe(s, 0, 20.0, 1.0, False, white, offsets)
    np.testing.assert_allclose(white, error_covariance(CAMERA, np.array([0]), at, errors)[0])
    believe(s, 0, 20.0, 1.0, True, white, offsets)
    calibrated = split_covariance(CAMERA, np.array([0]), at, ErrorModel("covariance"))
    np.testing.assert_allclose(white, calibrated[0][0])
    np.testing.assert_allclose(offsets, calibrated[1][0])


def test_nothing_beyond_the_report_limit_or_the_range_is_reported() -> None:
    rng = np.random.default_rng(4)
    far = make_camera(x_m=60.0, y_m=3.0, yaw_deg=180.0, pitch_deg=20.0, fov_deg=(60.0, 38.0))
    for change, reach in (
        ({"errors": ErrorModel(report_limit_m=0.8)}, 22.0),
        ({"errors": ErrorModel(), "max_range_m": 15.0}, 15.0),
    ):
        s = sensors(far, course=course_of_road(), **change)
        assert s.reach_m[0] <= reach
        for x in np.arange(5.0, 59.0, 1.0):
            seen = look(s, s.table, x, 0.0, rng)
            if math.hypot(60.0 - x, 3.0) > reach + 1.0:
                assert len(seen) == 0
        assert len(look(s, s.table, 48.0, 0.0, rng)) == 1


def test_every_report_is_within_the_report_limit_as_the_model_has_it() -> None:
    rng = np.random.default_rng(6)
    far = make_camera(x_m=60.0, y_m=3.0, yaw_deg=180.0, pitch_deg=20.0, fov_deg=(60.0, 38.0))
    errors = ErrorModel(report_limit_m=0.8)
    s = sensors(far, errors, course_of_road())
    counts = []
    for x in np.arange(30.0, 55.0, 0.25):
        seen = look(s, s.table, x, 0.0, rng)
        counts.append(len(seen))
        for report in seen:
            dx, dy = report[1] - 60.0, report[2] - 3.0
            assert measurement_covariance(s.table[0], dx, dy, s.model)[3] <= 0.8
    assert 0 < sum(counts) < len(counts)


def test_missed_and_false_detections_come_at_their_rate() -> None:
    rng = np.random.default_rng(5)
    s = sensors(CAMERA, ErrorModel(), course_of_road(), missed=0.25)
    seen = sum(len(look(s, s.table, 21.0, 0.0, rng)) for _ in range(4000))
    assert seen == pytest.approx(3000, abs=100)
    s = sensors(CAMERA, ErrorModel(), course_of_road(), false=0.25)
    away = [look(s, s.table, 90.0, 0.0, rng) for _ in range(4000)]
    reports = np.concatenate(away)
    assert 0 < len(reports) <= 1100  # some lie beyond the report limit
    assert len(np.unique(reports[:, 1])) == len(reports)


def test_a_camera_s_last_sight_is_where_the_road_leaves_its_reach() -> None:
    s = sensors(CAMERA, ErrorModel(), course_of_road())
    assert 30.0 < s.last_s_m[0] < 100.0
    nowhere = make_camera(x_m=-500.0)
    assert sensors(nowhere, ErrorModel(), course_of_road()).last_s_m[0] == -1.0


def test_positions_are_relative_to_the_start_of_the_road() -> None:
    road = road_from_pieces([Piece(100.0)])
    far = Cameras(
        **{
            name: getattr(CAMERA, name) + (1e5 if name == "x_m" else 0)
            for name in Cameras.__slots__
        }
    )
    moved = course(road, SpeedPolicy())._replace(origin_x_m=1e5)
    table = sensors(far, ErrorModel(), moved).table
    assert table[0, X] == pytest.approx(30.0)


@pytest.mark.parametrize("change", [{"missed": 1.0}, {"false": -0.1}, {"max_range_m": 0.0}])
def test_bad_shares_and_ranges_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must"):
        sensors(CAMERA, ErrorModel(), course_of_road(), **change)
