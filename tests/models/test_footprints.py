"""Footprints against brute force: which ground points the camera says it sees."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely import Polygon, contains, points

from models.cameras import Cameras, make_camera
from models.footprints import footprint_pieces, footprint_polygon, pixel_areas

VIEWS = [
    ("pinhole", 45.0, (60.0, 60.0), 20.0),
    ("pinhole", 20.0, (90.0, 68.0), 150.0),
    ("pinhole", 90.0, (60.0, 60.0), 20.0),
    ("pinhole", 5.0, (60.0, 4.0), 150.0),
    ("stereographic", 30.0, (150.0, 100.0), 40.0),
    ("stereographic", 60.0, (200.0, 200.0), 40.0),
    ("equidistant", 90.0, (200.0, 200.0), 40.0),
    ("equidistant", 45.0, (100.0, 300.0), 40.0),
    ("equidistant", 45.0, (360.0, 100.0), 40.0),
]


def camera_at(lens: str, pitch_deg: float, fov_deg: tuple[float, float]) -> Cameras:
    return make_camera(
        x_m=5.0, y_m=1.0, yaw_deg=30.0, pitch_deg=pitch_deg, roll_deg=3.0,
        fov_deg=fov_deg, projection=lens,
    )  # fmt: skip


@pytest.mark.parametrize(("lens", "pitch_deg", "fov_deg", "reach"), VIEWS)
def test_the_polygon_holds_what_the_camera_sees(
    lens: str, pitch_deg: float, fov_deg: tuple[float, float], reach: float
) -> None:
    camera = camera_at(lens, pitch_deg, fov_deg)
    rng = np.random.default_rng(0)
    azimuth, distance = rng.uniform(0, 2 * math.pi, 5000), reach * np.sqrt(rng.random(5000))
    xy = np.column_stack([5 + distance * np.cos(azimuth), 1 + distance * np.sin(azimuth)])
    _, seen = camera.pixel_from_ground(np.zeros(5000, dtype=np.int64), xy)
    outline = Polygon(footprint_polygon(camera, 0, reach))
    assert outline.is_valid
    # The arcs are chords of 2°, 0.02 % of the disc's area.
    assert np.mean(contains(outline, points(xy)) != seen) < 2e-3


@pytest.mark.parametrize(("lens", "pitch_deg", "fov_deg", "reach"), VIEWS)
def test_the_polygon_runs_counter_clockwise(
    lens: str, pitch_deg: float, fov_deg: tuple[float, float], reach: float
) -> None:
    polygon = footprint_polygon(camera_at(lens, pitch_deg, fov_deg), 0, reach)
    assert Polygon(polygon).exterior.is_ccw
    assert np.hypot(*(polygon - [5.0, 1.0]).T).max() <= reach * (1 + 1e-12)


def test_a_camera_straight_down_sees_a_rectangle() -> None:
    polygon = footprint_polygon(make_camera(pitch_deg=90.0, fov_deg=(60.0, 40.0)), 0, 50.0)
    sides = 12.0 * math.tan(math.radians(30)) * 12.0 * math.tan(math.radians(20))
    assert Polygon(polygon).area == pytest.approx(sides, rel=1e-12)


def test_a_camera_that_sees_no_ground_has_an_empty_polygon() -> None:
    assert footprint_polygon(make_camera(pitch_deg=10.0, fov_deg=(60.0, 60.0)), 0, 3.0).size == 0
    assert footprint_pieces(make_camera(pitch_deg=5.0, fov_deg=(30.0, 4.0)), 0, 20.0) == []


def test_a_range_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ValueError, match=r"camera\.max_range_m must be positive, got 0"):
        footprint_polygon(make_camera(), 0, 0.0)


def test_pixel_areas_add_up_to_the_footprint() -> None:
    camera = make_camera(pitch_deg=60.0, fov_deg=(50.0, 40.0), size_px=(80, 64))
    u, v = np.meshgrid(np.arange(80) + 0.5, np.arange(64) + 0.5)
    index = np.zeros(u.size, dtype=np.int64)
    xy, _ = camera.ground_from_pixel(index, np.column_stack([u.ravel(), v.ravel()]))
    area = Polygon(footprint_polygon(camera, 0, 100.0)).area
    assert pixel_areas(camera, index, xy).sum() == pytest.approx(area, rel=1e-3)
