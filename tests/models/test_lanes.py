"""Lanes: an exact parallel of the centre line, either way along it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.geometry import Pose
from models.lanes import lane
from models.roads import Piece, Road, road_from_pieces, road_from_points


def bend() -> Road:
    pieces = [
        Piece(50.0),
        Piece(40.0, 0.0, 0.04),
        Piece(60.0, 0.04, 0.04),
        Piece(30.0, 0.04, -0.02),
    ]
    return road_from_pieces(pieces, start=Pose(1e5, -3e4, 2.0))


def circuit() -> Road:
    angle = np.linspace(0.0, math.tau, 60, endpoint=False)
    points = np.column_stack((80.0 * np.cos(angle), 50.0 * np.sin(angle)))
    return road_from_points(points, closed=True, left_m=3.0, right_m=5.0)


@given(st.floats(-8.0, 8.0), st.booleans(), st.sampled_from([bend, circuit]))
def test_every_point_of_a_lane_lies_at_its_offset_and_arc_length_is_distance(
    offset: float, backward: bool, make: type[Road]
) -> None:
    road = make()
    driven = lane(road, offset, backward=backward)
    points = driven.sample(0.1)
    _, left = road.project(points.x_m, points.y_m)
    np.testing.assert_allclose(left, -offset if backward else offset, atol=1e-6)
    steps = np.hypot(np.diff(points.x_m), np.diff(points.y_m))
    np.testing.assert_allclose(steps, np.diff(points.s_m), rtol=1e-4)


@given(st.floats(-8.0, 8.0), st.booleans(), st.sampled_from([bend, circuit]))
def test_heading_and_curvature_are_the_derivatives_of_position_and_heading(
    offset: float, backward: bool, make: type[Road]
) -> None:
    driven = lane(make(), offset, backward=backward)
    s, h = np.linspace(5.0, driven.length_m - 5.0, 40), 1e-3
    before, at, after = (driven.evaluate(s + step) for step in (-h, 0.0, h))
    direction = np.arctan2(after.y_m - before.y_m, after.x_m - before.x_m)
    np.testing.assert_allclose(np.cos(direction - at.heading_rad), 1.0, atol=1e-9)
    slope = (after.heading_rad - before.heading_rad) / (2.0 * h)
    np.testing.assert_allclose(slope, at.curvature, atol=2e-4)


def test_the_right_hand_lanes_of_a_circle_have_the_lengths_of_their_circles() -> None:
    road = road_from_pieces([Piece(math.tau * 50.0, 0.02, 0.02)], closed=True)
    assert lane(road, -1.5).length_m == pytest.approx(math.tau * 51.5, rel=1e-12)
    back = lane(road, -1.5, backward=True)
    assert back.length_m == pytest.approx(math.tau * 48.5, rel=1e-12)
    assert back.total_turning_rad == pytest.approx(-math.tau, rel=1e-12)
    assert back.evaluate([0.0]).curvature[0] == pytest.approx(-1.0 / 48.5, rel=1e-12)


def test_the_edges_stay_where_they_are() -> None:
    road = circuit()
    for offset, backward in ((-2.0, False), (2.0, True), (4.0, False)):
        driven = lane(road, offset, backward=backward)
        left, right = driven.half_widths(np.array([0.0, 20.0, 100.0]))
        wide = (5.0 - offset, 3.0 + offset) if backward else (3.0 - offset, 5.0 + offset)
        np.testing.assert_allclose(left, max(wide[0], 0.0), atol=1e-9)
        np.testing.assert_allclose(right, max(wide[1], 0.0), atol=1e-9)


def test_a_lane_without_an_offset_is_the_road_itself() -> None:
    road = bend()
    assert lane(road) is road


def test_there_and_back_again_is_the_way_one_came() -> None:
    road = bend()
    twice = lane(lane(road, backward=True), backward=True)
    s = np.linspace(0.0, road.length_m, 50)
    np.testing.assert_allclose(twice.evaluate(s).xy, road.evaluate(s).xy, atol=1e-8)


def test_a_lane_beyond_the_centre_of_a_bend_is_refused_with_the_place() -> None:
    with pytest.raises(ValueError, match=r"\+30 m from the centre line .* radius of 25 m at s = 9"):
        lane(bend(), 30.0)
