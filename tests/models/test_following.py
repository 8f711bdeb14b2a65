"""Following a point along a road, against the exact closest point."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.control import SpeedPolicy
from models.following import course, follow, speed_wanted
from models.geometry import Pose
from models.roads import Piece, Road, road_from_pieces

OPEN = road_from_pieces(
    [Piece(50.0), Piece(40.0, 0.0, 0.05), Piece(30.0, 0.05, 0.05), Piece(40.0, 0.05, -0.02)]
)
RING = road_from_pieces([Piece(2.0 * math.pi * 30.0, 1 / 30.0, 1 / 30.0)], closed=True)


@pytest.mark.parametrize("road", [OPEN, OPEN.transformed(Pose(1e5, -2e5, 2.0)), RING])
def test_following_finds_the_exact_closest_point(road: Road) -> None:
    table = course(road, SpeedPolicy())
    rng = np.random.default_rng(1)
    s = np.sort(rng.uniform(1.0, road.length_m - 1.0, 300))
    lateral = rng.uniform(-4.0, 4.0, 300)
    points = road.offset(s, lateral)
    near = 0.0
    for at, side, (x, y) in zip(s, lateral, points, strict=True):
        found, left, heading, bend = follow(table, near, x - table.origin_x_m, y - table.origin_y_m)
        exact = road.evaluate(at)
        # half a step of clothoid: κ'·0.25³/6 in position, more in s where the offset nears a radius
        assert found == pytest.approx(at, abs=1e-3)
        assert left == pytest.approx(side, abs=1e-4)
        assert heading == pytest.approx(float(exact.heading_rad[0]), abs=1e-3)
        assert bend == pytest.approx(float(exact.curvature[0]), abs=1e-3)
        near = found


def test_laps_of_a_closed_road_add_up() -> None:
    table = course(RING, SpeedPolicy())
    s = 0.0
    for at in np.arange(0.0, 2.5 * RING.length_m, 3.0):
        point = RING.evaluate(at)
        s, _, _, _ = follow(table, s, float(point.x_m[0]), float(point.y_m[0]))
    assert s == pytest.approx(at, abs=1e-6)


def test_beyond_the_ends_of_an_open_road_arc_length_runs_on() -> None:
    table = course(road_from_pieces([Piece(10.0)]), SpeedPolicy())
    assert follow(table, 9.0, 13.0, 1.0)[:2] == pytest.approx((13.0, 1.0))
    assert follow(table, 1.0, -2.0, -1.0)[:2] == pytest.approx((-2.0, -1.0))


def test_the_wanted_speed_is_linear_between_rows() -> None:
    table = course(OPEN, SpeedPolicy())
    rows = np.arange(len(table.speed_mps)) * table.step_m
    for s in (0.0, 33.3, 77.7, OPEN.length_m, OPEN.length_m + 5.0):
        assert speed_wanted(table, s) == pytest.approx(np.interp(s, rows, table.speed_mps))
    ring = course(RING, SpeedPolicy())
    assert speed_wanted(ring, RING.length_m + 1.0) == pytest.approx(speed_wanted(ring, 1.0))
