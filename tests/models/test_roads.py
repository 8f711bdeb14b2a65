"""Roads as their users see them: built, sampled, moved, projected upon, refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.geometry import Pose
from models.roads import Piece, Road, road_from_pieces, road_from_points


def winding() -> Road:
    return road_from_pieces(
        [
            Piece(200.0),
            Piece(100.0, 1 / 50, 1 / 50),
            Piece(150.0),
            Piece(80.0, 0.0, -1 / 30),
            Piece(120.0, -1 / 30, 1 / 80),
        ]
    )


def oval(shift: float = 0.0) -> Road:
    t = np.linspace(0.0, 2.0 * math.pi, 40, endpoint=False)
    xy = np.column_stack((90.0 * np.cos(t), 50.0 * np.sin(t)))
    return road_from_points(xy + shift, closed=True, left_m=2.0 + np.cos(t), right_m=1.5)


ROADS = {"winding": winding, "oval": oval}


def test_pieces_continue_one_another() -> None:
    road = winding()
    assert road.length_m == 650.0
    at = road.evaluate([200.0, 300.0, 450.0])
    assert np.allclose(at.xy[0], [200.0, 0.0])
    assert np.allclose(at.xy[1], [200.0 + 50 * math.sin(2.0), 50 * (1 - math.cos(2.0))])
    assert np.allclose(at.xy[2] - at.xy[1], 150.0 * np.array([math.cos(2.0), math.sin(2.0)]))
    assert road.total_turning_rad == pytest.approx(2.0 - 80 / 60 + 120 * (1 / 80 - 1 / 30) / 2)
    assert road.min_radius_m == pytest.approx(30.0)


def test_a_road_starts_at_its_start_pose() -> None:
    at = road_from_pieces([Piece(10.0)], start=Pose(3.0, 4.0, math.pi / 2)).evaluate([0.0, 10.0])
    assert np.allclose(at.xy, [[3.0, 4.0], [3.0, 14.0]])
    assert np.allclose(at.heading_rad, math.pi / 2)


def test_open_samples_include_both_ends_equally_spaced() -> None:
    points = winding().sample(0.99)
    assert points.s_m[0] == 0.0
    assert points.s_m[-1] == pytest.approx(650.0, abs=1e-9)
    steps = np.diff(points.s_m)
    assert np.allclose(steps, steps[0])
    assert 0.98 < steps[0] <= 0.99
    assert len(winding().sample(1.0)) == 651
    assert len(winding().sample(1e4)) == 2


def test_closed_samples_do_not_repeat_the_first() -> None:
    road = oval()
    points = road.sample(1.0)
    assert len(points) == math.ceil(road.length_m)
    gaps = np.hypot(*np.diff(np.vstack((points.xy, points.xy[:1])), axis=0).T)
    assert gaps.min() > 0.9 * gaps.max()


@pytest.mark.parametrize("spacing", [0.0, -1.0, math.nan, math.inf])
def test_impossible_spacings_are_refused(spacing: float) -> None:
    with pytest.raises(ValueError, match="spacing_m must be finite and positive, got"):
        winding().sample(spacing)


def test_closed_roads_wrap_and_open_ones_end() -> None:
    road = oval()
    assert np.allclose(road.evaluate([-5.0]).xy, road.evaluate([road.length_m - 5.0]).xy)
    with pytest.raises(ValueError, match=r"s_m must lie in \[0, 650\.000000\], got 650\.1"):
        winding().evaluate([1.0, 650.1])
    assert winding().evaluate([650.0 + 5e-10]).s_m[0] == 650.0
    with pytest.raises(ValueError, match="s_m must be finite"):
        winding().evaluate([math.nan])


def test_half_widths_are_linear_in_between_and_round_the_lap() -> None:
    road = road_from_points(
        [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]],
        closed=True,
        left_m=[1.0, 2.0, 3.0, 5.0],
        right_m=4.0,
    )
    quarter = road.length_m / 4  # by symmetry
    left, right = road.half_widths(np.array([0.0, 0.5, 1.0, 2.0, 3.5, 4.0]) * quarter)
    assert np.allclose(left, [1.0, 1.5, 2.0, 3.0, 3.0, 1.0])
    assert np.allclose(right, 4.0)
    assert np.allclose(winding().half_widths([0.0, 300.0]), 1.5)


def test_offsets_lie_on_the_side_of_their_sign() -> None:
    xy = road_from_pieces([Piece(10.0)]).offset([5.0, 5.0], [2.0, -3.0])
    assert np.allclose(xy, [[5.0, 2.0], [5.0, -3.0]])


@pytest.mark.parametrize("name", ROADS)
@given(
    angle=st.floats(-10.0, 10.0),
    x=st.floats(-1e5, 1e5),
    y=st.floats(-1e5, 1e5),
)
@settings(max_examples=20, deadline=None)
def test_moving_a_road_moves_its_points_and_changes_no_measure(
    name: str, angle: float, x: float, y: float
) -> None:
    road, pose = ROADS[name](), Pose(x, y, angle)
    moved = road.transformed(pose)
    s = np.linspace(0.0, road.length_m, 50)
    before, after = road.evaluate(s), moved.evaluate(s)
    assert np.allclose(after.xy, pose.apply(before.xy), rtol=0, atol=1e-10)
    assert np.array_equal(after.curvature, before.curvature)
    turned = np.exp(1j * (after.heading_rad - before.heading_rad))
    assert np.allclose(turned, np.exp(1j * angle), atol=1e-12)
    lateral = np.linspace(-3.0, 3.0, 50)
    for one, other in zip(
        road.project(*road.offset(s, lateral).T),
        moved.project(*moved.offset(s, lateral).T),
        strict=True,
    ):
        difference = np.abs(one - other)
        assert np.all(np.minimum(difference, np.abs(difference - road.length_m)) < 1e-9)


def test_points_far_from_the_origin_give_the_same_curve() -> None:
    # 2¹⁷ m: near the 10⁵ of the brief, and exact to shift by up to the points' own rounding.
    near, far = oval(), oval(2.0**17)
    assert far.length_m == pytest.approx(near.length_m, abs=1e-9)
    s = np.linspace(0.0, near.length_m, 200, endpoint=False)
    assert np.allclose(far.evaluate(s).xy - 2.0**17, near.evaluate(s).xy, rtol=0, atol=1e-9)
    assert np.allclose(far.evaluate(s).curvature, near.evaluate(s).curvature, rtol=0, atol=1e-10)


def test_projecting_recovers_arc_length_and_offset() -> None:
    for road in (winding(), oval().transformed(Pose(100.0, -50.0, 1.0))):
        s = np.linspace(0.0, road.length_m, 300, endpoint=False)
        lateral = 4.0 * np.sin(s)
        found, left = road.project(*road.offset(s, lateral).T)
        assert np.allclose(found, s, atol=1e-9)
        assert np.allclose(left, lateral, atol=1e-9)
    with pytest.raises(ValueError, match="must be finite"):
        winding().project(math.nan, 0.0)


@pytest.mark.parametrize("name", ROADS)
def test_the_table_lists_the_road_with_both_ends(name: str) -> None:
    road = ROADS[name]().transformed(Pose(5.0, 6.0, 2.0))
    table = road.table(0.5)
    assert all(c.dtype == np.float64 and c.flags.c_contiguous for c in table)
    assert table.s_m[0] == 0.0
    assert table.s_m[-1] == road.length_m
    at = road.evaluate(table.s_m[:-1])
    assert np.array_equal(table.x_m[:-1], at.x_m)
    assert np.array_equal(table.heading_rad[:-1], at.heading_rad)
    assert np.array_equal(table.curvature[:-1], at.curvature)
    gained = table.heading_rad[-1] - table.heading_rad[0]
    assert gained == pytest.approx(road.total_turning_rad, abs=1e-12)
    assert np.abs(np.diff(table.heading_rad)).max() < 0.1
    left, right = road.half_widths(table.s_m)
    assert np.array_equal(table.left_m, left)
    assert np.array_equal(table.right_m, right)


def test_a_closed_road_must_close() -> None:
    ring = [Piece(20.0 * math.pi, 0.1, 0.1)]
    assert road_from_pieces(ring, closed=True).total_turning_rad == pytest.approx(2.0 * math.pi)
    with pytest.raises(ValueError, match=r"must end at its start .*got 2e-05 m and 2e-06 rad"):
        road_from_pieces([Piece(20.0 * math.pi + 2e-5, 0.1, 0.1)], closed=True)


@pytest.mark.parametrize("length", [0.0, -1.0, math.nan, math.inf])
def test_pieces_of_impossible_length_are_refused(length: float) -> None:
    with pytest.raises(ValueError, match="length_m must be finite and positive, got"):
        Piece(length)


def test_bad_points_are_refused_by_index() -> None:
    square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    for bad, closed, message in (
        (square[:1], False, "an open road needs at least 2 points, got 1"),
        (square[:2], True, "a closed road needs at least 3 points, got 2"),
        ([*square, [0.0, math.nan]], False, r"points\[4\] must be finite"),
        ([*square, square[3]], False, r"points\[3\] and points\[4\] must differ"),
        ([*square, square[0]], True, r"points\[4\] and points\[0\] must differ"),
        ([0.0, 1.0], False, r"points must have shape \(n, 2\), got \(2,\)"),
    ):
        with pytest.raises(ValueError, match=message):
            road_from_points(bad, closed=closed)
    with pytest.raises(ValueError, match=r"left_m\[2\] must be a width of 0 or more, got -1"):
        road_from_points(square, closed=True, left_m=[1.0, 1.0, -1.0, 1.0])
    with pytest.raises(ValueError, match="pieces must hold at least one piece"):
        road_from_pieces([])
