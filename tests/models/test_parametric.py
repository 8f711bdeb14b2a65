"""Paths by any parameter: offsets, reversal and arc length against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.files.opendrive.geometry import Piece, ReferenceLine
from models.lanes import LaneCurve
from models.parametric import ArcLengthCurve, Cubics, OffsetPath, ReversedPath

ARC = ReferenceLine((Piece(0.0, 0.0, 0.0, 0.0, 50.0, 0.02, 0.0),))
SPIRAL = ReferenceLine((Piece(0.0, 0.0, 0.0, 0.3, 60.0, 0.0, 5e-4),))
numbers = st.floats(-5.0, 5.0)


def test_a_constant_offset_of_an_arc_is_an_arc_of_another_radius() -> None:
    curve = ArcLengthCurve(OffsetPath(ARC, Cubics.constant(-3.0)))
    assert curve.length_m == pytest.approx(50.0 * (1.0 + 0.02 * 3.0), abs=1e-9)
    at = curve.evaluate(np.linspace(0.0, curve.length_m, 11))
    np.testing.assert_allclose(at.curvature, 1.0 / 53.0, rtol=1e-12)
    np.testing.assert_allclose(
        np.hypot(at.x_m, at.y_m - 53.0), 53.0, atol=1e-9
    )  # about the centre, which lies 53 m to the left of the start


def test_a_constant_offset_of_a_spiral_is_the_lane_of_models_lanes() -> None:
    curve = ArcLengthCurve(OffsetPath(SPIRAL, Cubics.constant(2.0)))
    lane = LaneCurve(ArcLengthCurve(SPIRAL), 2.0)
    assert curve.length_m == pytest.approx(lane.length_m, abs=1e-9)
    s = np.linspace(0.0, lane.length_m, 23)
    found, wanted = curve.evaluate(s), lane.evaluate(s)
    start = lane.evaluate(np.zeros(1))
    np.testing.assert_allclose(found.x_m, wanted.x_m - start.x_m, atol=1e-8)
    np.testing.assert_allclose(found.y_m, wanted.y_m - start.y_m, atol=1e-8)
    np.testing.assert_allclose(found.heading_rad, wanted.heading_rad, atol=1e-9)
    np.testing.assert_allclose(found.curvature, wanted.curvature, atol=1e-10)


def test_a_varying_offset_has_the_heading_and_curvature_of_its_points() -> None:
    offset = Cubics(np.array([0.0, 20.0]), np.array([[1.0, 0, 0.01, -3e-4], [2.6, 0.04, 0, 0]]))
    curve = ArcLengthCurve(OffsetPath(SPIRAL, offset))
    s, h = np.linspace(1.0, 15.0, 15), 1e-3
    before, here, after = (curve.evaluate(s + step) for step in (-h, 0.0, h))
    dx, dy = (after.x_m - before.x_m) / (2 * h), (after.y_m - before.y_m) / (2 * h)
    np.testing.assert_allclose(np.hypot(dx, dy), 1.0, atol=1e-6)
    np.testing.assert_allclose(np.arctan2(dy, dx), here.heading_rad, atol=1e-6)
    turn = (after.heading_rad - before.heading_rad) / (2 * h)
    np.testing.assert_allclose(turn, here.curvature, atol=1e-6)


def test_a_path_driven_backwards_visits_the_same_points() -> None:
    forward = ArcLengthCurve(OffsetPath(SPIRAL, Cubics.constant(1.0)))
    back = ArcLengthCurve(ReversedPath(OffsetPath(SPIRAL, Cubics.constant(1.0))))
    s = np.linspace(0.0, forward.length_m, 17)
    a, b = forward.evaluate(s), back.evaluate(forward.length_m - s)
    shift = back.start_m - forward.start_m
    np.testing.assert_allclose(a.x_m, b.x_m + shift[0], atol=1e-9)
    np.testing.assert_allclose(a.y_m, b.y_m + shift[1], atol=1e-9)
    np.testing.assert_allclose(a.curvature, -b.curvature, atol=1e-12)
    turn = np.remainder(a.heading_rad - b.heading_rad, 2.0 * math.pi)
    np.testing.assert_allclose(turn, math.pi, atol=1e-9)


def test_a_lane_that_folds_is_refused() -> None:
    with pytest.raises(ValueError, match="stands still or folds near s"):
        ArcLengthCurve(OffsetPath(SPIRAL, Cubics.constant(40.0)))


@given(st.lists(st.tuples(numbers, numbers, numbers, numbers), min_size=1, max_size=4),
       st.lists(numbers, min_size=1, max_size=3, unique=True))  # fmt: skip
@settings(max_examples=50, deadline=None)
def test_cutting_a_function_of_cubics_changes_no_value(
    rows: list[tuple[float, float, float, float]], places: list[float]
) -> None:
    whole = Cubics(np.arange(len(rows), dtype=float), np.array(rows))
    cut = whole.cut(np.array(sorted(places)))
    s = np.linspace(-1.0, 5.0, 31)
    np.testing.assert_allclose(cut(s), whole(s), atol=1e-7)
    np.testing.assert_allclose((cut + whole)(s), 2.0 * whole(s), atol=1e-7)
