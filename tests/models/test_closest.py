"""Closest points against brute force and against the conditions that define them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.closest import ClosestPoint
from models.curves import ClothoidChain, Curve, SplineCurve
from models.geometry import FloatArray


def chain(*pieces: tuple[float, float, float]) -> ClothoidChain:
    lengths, k0, k1 = (np.array(column) for column in zip(*pieces, strict=True))
    return ClothoidChain(lengths, k0, k1)


T = np.linspace(0.0, 2.0 * math.pi, 30, endpoint=False)
CURVES: dict[str, tuple[Curve, bool]] = {
    "winding": (
        chain((50.0, 0, 0), (40.0, 0.05, 0.05), (30.0, 0, 0), (50.0, -0.05, -0.05), (40.0, 0, 0)),
        False,
    ),
    "clothoids": (chain((60.0, 0, 0.08), (30.0, 0.08, -0.1), (50.0, -0.1, 0)), False),
    "hairpin": (chain((80.0, 0, 0), (10 * math.pi, 0.1, 0.1), (80.0, 0, 0)), False),
    "ring": (chain((40 * math.pi, 0.05, 0.05)), True),
    "kidney": (
        SplineCurve(np.column_stack(((60 + 25 * np.cos(2 * T)) * np.cos(T), 40 * np.sin(T))), True),
        True,
    ),
}


def check_is_closest(curve: Curve, closed: bool, points: FloatArray) -> None:
    """Check that no sample is nearer, and that the way to the point is square to the curve."""
    s, left = ClosestPoint(curve, closed).find(points)
    at = curve.evaluate(s)
    dx, dy = points[:, 0] - at.x_m, points[:, 1] - at.y_m
    distance = np.hypot(dx, dy)
    fine = curve.evaluate(np.linspace(0.0, curve.length_m, 20_001))
    samples = np.hypot(points[:, :1] - fine.x_m, points[:, 1:] - fine.y_m).min(axis=1)
    assert np.all(distance <= samples + 1e-9)
    normal = dy * np.cos(at.heading_rad) - dx * np.sin(at.heading_rad)
    assert np.allclose(left, normal, atol=1e-12)
    along = dx * np.cos(at.heading_rad) + dy * np.sin(at.heading_rad)
    # f'' = 1 − κ·left turns an error in s into one of `along`.
    square = np.abs(along) <= 1e-9 * np.maximum(1.0, np.abs(1.0 - at.curvature * left))
    if closed:
        assert square.all()
        assert np.all((s >= 0.0) & (s < curve.length_m))
    else:
        assert np.all(square | ((s == 0.0) & (along < 0)) | ((s == curve.length_m) & (along > 0)))


@pytest.mark.parametrize("name", CURVES)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_closest_points_are_closest(name: str, seed: int) -> None:
    curve, closed = CURVES[name]
    rng = np.random.default_rng(seed)
    at = curve.evaluate(rng.uniform(0.0, curve.length_m, 30))
    spread = 10.0 ** rng.uniform(-3.0, 4.0, (30, 1))
    points = np.column_stack((at.x_m, at.y_m)) + spread * rng.normal(size=(30, 2))
    check_is_closest(curve, closed, points)


@pytest.mark.parametrize("name", CURVES)
def test_closest_points_are_closest_near_the_centres_of_curvature(name: str) -> None:
    curve, closed = CURVES[name]
    rng = np.random.default_rng(7)
    at = curve.evaluate(rng.uniform(0.0, curve.length_m, 200))
    bent = np.abs(at.curvature) > 0.01
    lateral = 1.0 / at.curvature[bent] + rng.choice([0.0, 1e-6, -1e-3, 0.1], bent.sum())
    points = np.column_stack(
        (
            at.x_m[bent] - lateral * np.sin(at.heading_rad[bent]),
            at.y_m[bent] + lateral * np.cos(at.heading_rad[bent]),
        )
    )
    s, _ = ClosestPoint(curve, closed).find(points)
    here = curve.evaluate(s)
    fine = curve.evaluate(np.linspace(0.0, curve.length_m, 50_001))
    samples = np.hypot(points[:, :1] - fine.x_m, points[:, 1:] - fine.y_m).min(axis=1)
    distance = np.hypot(points[:, 0] - here.x_m, points[:, 1] - here.y_m)
    assert np.all(distance <= samples + 1e-8)


@pytest.mark.parametrize("name", CURVES)
def test_points_offset_from_the_curve_are_found_again(name: str) -> None:
    curve, closed = CURVES[name]
    rng = np.random.default_rng(3)
    s = rng.uniform(0.0, curve.length_m, 500)
    at = curve.evaluate(s)
    lateral = rng.uniform(-4.0, 4.0, 500)
    points = np.column_stack(
        (at.x_m - lateral * np.sin(at.heading_rad), at.y_m + lateral * np.cos(at.heading_rad))
    )
    found, left = ClosestPoint(curve, closed).find(points)
    assert np.allclose(found, s, atol=1e-9)
    assert np.allclose(left, lateral, atol=1e-9)


def test_a_point_just_beyond_a_vertexs_centre_of_curvature_finds_the_deeper_of_two_dips() -> None:
    curve, closed = CURVES["clothoids"]  # |κ| peaks at s = 60 m, where the radius is 12.5 m
    at = curve.evaluate(np.array([60.0]))
    lateral = 12.5 + np.logspace(-5.0, -1.0, 200)
    points = np.column_stack(
        (
            at.x_m - lateral * np.sin(at.heading_rad),
            at.y_m + lateral * np.cos(at.heading_rad),
        )
    )
    s, _ = ClosestPoint(curve, closed).find(points)
    here, fine = curve.evaluate(s), curve.evaluate(np.linspace(50.0, 70.0, 40_001))
    distance = np.hypot(points[:, 0] - here.x_m, points[:, 1] - here.y_m)
    samples = np.hypot(points[:, :1] - fine.x_m, points[:, 1:] - fine.y_m).min(axis=1)
    assert np.all(distance <= samples + 1.1e-9)  # points equal to 1e-9 m count as ties


def test_the_edge_of_a_bracket_never_passes_for_the_closest_point() -> None:
    curve, closed = CURVES["winding"]  # sampled every 0.25 m: brackets end at odd multiples of 1/8
    s = 0.125 + 0.25 * np.arange(10, 100) + 5e-5
    at = curve.evaluate(s)
    points = np.column_stack(
        (at.x_m - 4.0 * np.sin(at.heading_rad), at.y_m + 4.0 * np.cos(at.heading_rad))
    )
    assert np.allclose(ClosestPoint(curve, closed).find(points)[0], s, rtol=0, atol=1e-9)


def test_the_nearest_sample_need_not_be_beside_the_closest_point() -> None:
    curve, closed = CURVES["hairpin"]
    x = np.random.default_rng(1).uniform(10.0, 70.0, 200)
    _, left = ClosestPoint(curve, closed).find(np.column_stack((x, np.full(200, 10.0 - 1e-6))))
    assert np.allclose(left, 10.0 - 1e-6, rtol=0, atol=1e-9)


def test_many_almost_equal_dips_are_all_looked_at() -> None:
    phi = np.linspace(0.0, 2.0 * math.pi, 140, endpoint=False)
    radius = 30.0 + 5.0 * np.cos(7 * phi)
    xy = np.column_stack((radius * np.cos(phi), radius * np.sin(phi)))
    direction = np.random.default_rng(2).uniform(0.0, 2.0 * math.pi, 60)
    centre = -xy[0] + 1e-5 * np.column_stack((np.cos(direction), np.sin(direction)))
    check_is_closest(SplineCurve(xy, closed=True), True, centre)


def test_the_left_of_the_road_is_positive() -> None:
    s, left = ClosestPoint(chain((10.0, 0, 0)), False).find(np.array([[4.0, 2.0], [5.0, -3.0]]))
    assert np.allclose(s, [4.0, 5.0], atol=1e-9)
    assert np.allclose(left, [2.0, -3.0], atol=1e-12)


def test_points_beyond_an_open_end_belong_to_the_end() -> None:
    points = np.array([[-3.0, 1.0], [14.0, -2.0], [1e6, 0.0]])
    s, left = ClosestPoint(chain((10.0, 0, 0)), False).find(points)
    assert np.array_equal(s, [0.0, 10.0, 10.0])
    assert np.allclose(left, [1.0, -2.0, 0.0], atol=1e-9)


def test_equally_close_points_yield_the_first_along_the_road() -> None:
    curve, closed = CURVES["hairpin"]
    s, left = ClosestPoint(curve, closed).find(np.array([[40.0, 10.0], [20.0, 10.0]]))
    assert np.allclose(s, [40.0, 20.0], atol=1e-9)
    assert np.allclose(left, 10.0, atol=1e-9)


def test_a_window_keeps_to_the_near_leg_of_a_hairpin() -> None:
    curve, closed = CURVES["hairpin"]
    point = np.array([[40.0, 9.0]])
    back = curve.length_m - 40.0
    s, left = ClosestPoint(curve, closed).find(point, np.array([back]), 10.0)
    assert s[0] == pytest.approx(back, abs=1e-9)
    assert left[0] == pytest.approx(11.0, abs=1e-9)


def test_a_window_without_the_closest_point_gives_its_nearest_end() -> None:
    s, _ = ClosestPoint(chain((100.0, 0, 0)), False).find(
        np.array([[80.0, 1.0], [50.0, 1.0]]), np.array([20.0, 49.0]), 5.0
    )
    assert s[0] == pytest.approx(25.0, abs=0.25)
    assert s[1] == pytest.approx(50.0, abs=1e-9)


def test_a_window_wraps_round_a_closed_curve() -> None:
    curve, closed = CURVES["ring"]
    at = curve.evaluate(np.array([curve.length_m - 1.0]))
    point = np.column_stack((at.x_m, at.y_m))
    s, left = ClosestPoint(curve, closed).find(point, np.array([2.0]), 10.0)
    assert s[0] == pytest.approx(curve.length_m - 1.0, abs=1e-9)
    assert left[0] == pytest.approx(0.0, abs=1e-9)


def test_no_points_give_no_answers() -> None:
    s, left = ClosestPoint(chain((10.0, 0, 0)), False).find(np.zeros((0, 2)))
    assert len(s) == len(left) == 0
