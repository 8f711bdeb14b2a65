"""Rounded polylines: ends kept, headings continuous, lengths by the formula."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from models.polyline import (
    CUT_M,
    cut_polyline,
    distinct_points,
    drivable,
    eased,
    end_headings,
    offset_polyline,
    polyline_length,
    rounded_road,
    without_spikes,
)

point = st.tuples(st.floats(-300, 300), st.floats(-300, 300))


@given(st.lists(point, min_size=2, max_size=9))
@settings(max_examples=80, deadline=None)
def test_a_rounded_road_keeps_its_ends_and_never_jumps(points: list[tuple[float, float]]) -> None:
    given_ = np.array(points)
    assume(math.dist(given_[0], given_[-1]) > 1.0)
    kept = distinct_points(given_)
    road = rounded_road(given_)
    ends = road.evaluate([0.0, road.length_m])
    np.testing.assert_allclose(ends.xy, given_[[0, -1]], atol=1e-6)
    headings = end_headings(given_)
    steps = np.diff(kept, axis=0)
    turns = np.diff(np.arctan2(steps[:, 1], steps[:, 0]))
    spiky = any(abs(math.remainder(turn, math.tau)) > math.radians(169.0) for turn in turns)
    for at, heading in zip(ends.heading_rad, headings, strict=True):  # a blunt spike leans a bit
        assert abs(math.remainder(at - heading, math.tau)) < (0.5 if spiky else 1e-6)
    s = np.linspace(0.0, road.length_m, 500)
    xy = road.evaluate(s).xy
    assert np.all(np.hypot(*np.diff(xy, axis=0).T) <= (s[1] - s[0]) * (1 + 1e-9))
    assert road.length_m <= polyline_length(kept) + 0.5  # a spike's blunt end adds centimetres
    off = shapely.distance(shapely.LineString(kept), shapely.points(xy))
    assert off.max() < 10.0


def test_a_right_angle_is_cut_off_as_the_formula_says() -> None:
    road = rounded_road([[0, 0], [50, 0], [50, 40]], radius_m=8.0)
    assert road.length_m == pytest.approx(90.0 - 8.0 * (2.0 - 0.5 * math.pi), abs=1e-9)
    assert road.min_radius_m == pytest.approx(8.0)
    bend = rounded_road([[0, 0], [100, 0], [200, 2]])
    corner = shapely.Point(100, 0)
    line = shapely.LineString(bend.sample(0.05).xy)
    assert corner.distance(line) == pytest.approx(CUT_M, abs=1e-3)


def test_a_line_that_turns_back_stays_drivable() -> None:
    road = rounded_road([[0, 0], [20, 0], [5, 0]])
    assert road.length_m == pytest.approx(35.0, abs=0.2)
    assert abs(road.total_turning_rad) == pytest.approx(math.pi, abs=0.05)


@pytest.mark.parametrize("points", [[[0, 0]], [[0, 0], [0, 0]], [[0, 0], [np.nan, 1]], [0, 1]])
def test_what_is_no_line_is_refused(points: list[list[float]]) -> None:
    with pytest.raises(ValueError, match="a line"):
        rounded_road(points)


def test_an_offset_line_keeps_its_distance() -> None:
    line = np.array([[0.0, 0.0], [30.0, 0.0], [60.0, 20.0], [60.0, 60.0]])
    for left in (-3.0, 2.0):
        beside = offset_polyline(line, left)
        wanted = shapely.LineString(line).offset_curve(left, join_style="mitre")
        assert shapely.LineString(beside).hausdorff_distance(wanted) < 1e-9


def test_a_part_of_a_line_is_shapely_s_substring() -> None:
    from shapely.ops import substring

    line = np.array([[0.0, 0.0], [30.0, 0.0], [60.0, 20.0], [60.0, 60.0]])
    part = cut_polyline(line, 10.0, 70.0)
    assert shapely.LineString(part).equals_exact(substring(shapely.LineString(line), 10, 70), 1e-9)


def test_eased_ends_have_the_headings_asked_for() -> None:
    line = eased(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]), 0.4, 2.0)
    assert end_headings(line) == pytest.approx((0.4, 2.0))
    np.testing.assert_array_equal(line[[0, -1]], [[0, 0], [10, 10]])


def test_spikes_of_overlapping_lines_are_dropped() -> None:
    line = np.array([[0, 0], [20, 0], [19.5, 0.1], [30, 0], [40, 5]], dtype=float)
    cleaned = without_spikes(line)
    steps = np.diff(cleaned, axis=0)
    turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    assert np.abs(turns).max() < 1.0
    np.testing.assert_array_equal(cleaned[[0, -1]], line[[0, -1]])


@given(st.lists(point, min_size=4, max_size=12))
@settings(max_examples=60, deadline=None)
def test_a_straightened_line_keeps_its_ends_and_loses_no_room(
    points: list[tuple[float, float]],
) -> None:
    given_ = np.array(points)
    assume(math.dist(given_[0], given_[-1]) > 1.0)
    line = distinct_points(given_)
    straight = drivable(line, 5.0)
    assert len(straight) <= len(line)
    np.testing.assert_allclose(straight[[0, -1]], line[[0, -1]])


def test_a_turn_drawn_in_short_pieces_becomes_one_that_a_car_can_follow() -> None:
    angle = np.linspace(0.0, 0.5 * math.pi, 5)
    turn = np.column_stack((50.0 + 1.6 * np.sin(angle), -1.6 + 1.6 * np.cos(angle)))
    line = np.vstack(([[0.0, 0.0]], turn, [[51.6, -60.0]]))
    assert rounded_road(line).min_radius_m < 4.0
    road = rounded_road(drivable(line, 5.0))
    assert road.min_radius_m >= 5.0
    off = shapely.distance(shapely.LineString(line), shapely.points(road.sample(0.5).xy))
    assert off.max() < 3.4  # a radius of 8 m cuts a right angle by 3.3 m
