"""Curves against numerical integration of their own definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.curves import ClothoidChain, SplineCurve, clothoid_displacement
from models.geometry import FloatArray


def integrate(s: float, k: float, r: float) -> tuple[float, float]:
    """Integrate (cos, sin) of the heading by 30-point Gauss–Legendre on 100 panels."""
    nodes, weights = np.polynomial.legendre.leggauss(30)
    edges = np.linspace(0.0, s, 101)
    half = 0.5 * np.diff(edges)
    u = (edges[:-1] + half)[:, None] + half[:, None] * nodes
    angle = u * (k + 0.5 * r * u)
    return float(half @ (np.cos(angle) @ weights)), float(half @ (np.sin(angle) @ weights))


@given(
    s=st.floats(1e-3, 500.0),
    k=st.floats(-0.2, 0.2),
    exponent=st.floats(-14.0, -2.0),
    sign=st.sampled_from([-1.0, 0.0, 1.0]),
)
@settings(max_examples=400, deadline=None)
def test_clothoids_agree_with_the_integral_of_their_heading(
    s: float, k: float, exponent: float, sign: float
) -> None:
    rate = sign * 10.0**exponent
    x, y = clothoid_displacement(np.array([s]), np.array([k]), np.array([rate]))
    expected = integrate(s, k, rate)
    assert abs(x[0] - expected[0]) < 1e-9
    assert abs(y[0] - expected[1]) < 1e-9


@pytest.mark.parametrize("rate", [0.0, 1e-18, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("curvature", [0.0, 1e-12, 1e-4, 1 / 15, -0.2])
@pytest.mark.parametrize("length", [1e-6, 1.0, 250.0])
def test_clothoids_keep_their_digits_where_methods_change(
    rate: float, curvature: float, length: float
) -> None:
    x, y = clothoid_displacement(np.array([length]), np.array([curvature]), np.array([rate]))
    assert np.allclose((x[0], y[0]), integrate(length, curvature, rate), rtol=0, atol=1e-11)


def test_arcs_lie_on_their_circle_and_straights_on_their_line() -> None:
    s = np.linspace(0.0, 150.0, 301)
    arc = ClothoidChain(np.array([150.0]), np.array([0.02]), np.array([0.02])).evaluate(s)
    assert np.allclose(np.hypot(arc.x_m, arc.y_m - 50.0), 50.0, atol=1e-12)
    assert np.allclose(arc.heading_rad, s / 50.0, atol=1e-14)
    line = ClothoidChain(np.array([150.0]), np.zeros(1), np.zeros(1)).evaluate(s)
    assert np.array_equal(line.x_m, s)
    assert not line.y_m.any()


@pytest.mark.parametrize(
    ("k0", "k1"), [([0.0, 0.0, 0.05, 0.05], [0.0, 0.05, 0.05, -0.02]), ([0.1], [0.1])]
)
def test_heading_is_the_curves_direction_and_curvature_its_rate(
    k0: list[float], k1: list[float]
) -> None:
    chain = ClothoidChain(np.full(len(k0), 25.0), np.array(k0), np.array(k1))
    check_derivatives(chain, np.linspace(0.3, chain.length_m - 0.3, 97))


def test_a_chain_of_pieces_is_the_same_curve_as_its_halves() -> None:
    s = np.linspace(0.0, 80.0, 401)
    whole = ClothoidChain(np.array([80.0]), np.array([-0.01]), np.array([0.05])).evaluate(s)
    middle = np.array([0.02])
    halves = ClothoidChain(
        np.array([40.0, 40.0]),
        np.array([-0.01, *middle]),
        np.array([*middle, 0.05]),
    ).evaluate(s)
    for name in ("x_m", "y_m", "heading_rad", "curvature"):
        assert np.allclose(getattr(whole, name), getattr(halves, name), atol=1e-12)


def ellipse(n: int, a: float = 60.0, b: float = 25.0) -> FloatArray:
    """Return points on an ellipse, unevenly spaced."""
    t = np.linspace(0.0, 2.0 * math.pi, n, endpoint=False)
    t = t + 0.2 * np.sin(t)
    return np.column_stack((a * np.cos(t), b * np.sin(t)))


def check_derivatives(curve: ClothoidChain | SplineCurve, s: FloatArray) -> None:
    """Compare heading with the chord's direction and curvature with the heading's rate."""
    h = 1e-4
    before, here, after = (curve.evaluate(s + d) for d in (-h, 0.0, h))
    dx, dy = after.x_m - before.x_m, after.y_m - before.y_m
    assert np.allclose(np.hypot(dx, dy) / (2 * h), 1.0, atol=1e-7)
    turn = np.angle(np.exp(1j * (np.arctan2(dy, dx) - here.heading_rad)))
    assert np.allclose(turn, 0.0, atol=1e-6)
    rate = (after.heading_rad - before.heading_rad) / (2 * h)
    assert np.allclose(rate, here.curvature, atol=1e-5)


@pytest.mark.parametrize("closed", [True, False])
def test_splines_are_parametrised_by_arc_length(closed: bool) -> None:
    curve = SplineCurve(ellipse(24), closed)
    check_derivatives(curve, np.linspace(0.01, curve.length_m - 0.01, 501))


@pytest.mark.parametrize("closed", [True, False])
def test_splines_pass_through_their_points(closed: bool) -> None:
    points = ellipse(24)
    at = SplineCurve(points, closed)
    here = at.evaluate(at.knots_s_m)
    assert np.allclose(np.column_stack((here.x_m, here.y_m)), points - points[0], atol=1e-9)


ZIGZAG = np.array([[0.0, 0.0], [30.0, 0.5], [31.0, 2.0], [2.0, 3.0], [1.0, 40.0], [1.5, 42.0]])


@pytest.mark.parametrize(("points", "closed"), [(ellipse(24), True), (ZIGZAG, False)])
def test_spline_length_is_the_limit_of_polylines(points: FloatArray, closed: bool) -> None:
    curve = SplineCurve(points, closed)
    lengths = []
    for n in (20_000, 40_000):
        at = curve.evaluate(np.linspace(0.0, curve.length_m, n + 1))
        lengths.append(np.hypot(np.diff(at.x_m), np.diff(at.y_m)).sum())
    # Chords fall short by L·κ²h²/24; Richardson's step leaves h⁴.
    assert curve.length_m == pytest.approx((4.0 * lengths[1] - lengths[0]) / 3.0, abs=1e-9)


def test_a_spline_approaches_the_circle_it_interpolates_at_fourth_order() -> None:
    errors = []
    for n in (20, 40, 80):
        t = np.linspace(0.0, 2.0 * math.pi, n, endpoint=False)
        curve = SplineCurve(30.0 * np.column_stack((np.cos(t), np.sin(t))), closed=True)
        errors.append(abs(curve.length_m - 60.0 * math.pi))
        assert curve.evaluate(np.array([curve.length_m])).heading_rad[0] == pytest.approx(
            2.5 * math.pi, abs=1e-9
        )
    assert errors[0] / errors[1] > 14.0
    assert errors[1] / errors[2] > 14.0


def test_a_closed_spline_joins_its_end_to_its_start_with_equal_curvature() -> None:
    curve = SplineCurve(ellipse(17), closed=True)
    ends = curve.evaluate(np.array([0.0, curve.length_m]))
    assert np.allclose((ends.x_m, ends.y_m), 0.0, atol=1e-10)
    assert ends.heading_rad[1] - ends.heading_rad[0] == pytest.approx(2 * math.pi, abs=1e-10)
    assert ends.curvature[1] == pytest.approx(ends.curvature[0], abs=1e-9)


def test_two_points_give_a_straight_line() -> None:
    curve = SplineCurve(np.array([[0.0, 0.0], [3.0, 4.0]]), closed=False)
    at = curve.evaluate(np.array([0.0, 2.5, 5.0]))
    assert curve.length_m == pytest.approx(5.0, abs=1e-12)
    assert np.allclose(at.x_m, [0.0, 1.5, 3.0])
    assert np.allclose(at.curvature, 0.0)
