"""Reference lines against the specification's formulas, integrated by other means."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from models.files.opendrive.geometry import Piece, ReferenceLine, polynomial_piece
from models.files.opendrive.records import read_road
from models.parametric import ArcLengthCurve

FILES = ("crest-curve", "curve_r100", "curves", "e6mini", "fabriksgatan", "soderleden",
         "two_plus_one")  # fmt: skip
PLACE = {"s_m": 0.0, "x_m": 3.0, "y_m": -2.0, "heading_rad": 0.7}


def line_of(*pieces: Piece) -> ArcLengthCurve:
    return ArcLengthCurve(ReferenceLine(pieces))


def turned(xy: np.ndarray) -> np.ndarray:
    """Turn local points as PLACE's heading does."""
    c, s = math.cos(0.7), math.sin(0.7)
    return xy @ np.array([[c, s], [-s, c]])


@pytest.mark.parametrize("name", FILES)
def test_shared_files_join_to_a_tenth_of_a_millimetre(
    name: str, shared_data: Callable[[str], Path]
) -> None:
    root = ET.parse(shared_data(f"xodr/{name}.xodr")).getroot()  # noqa: S314 (our own data)
    for element in root.findall("road"):
        road = read_road(element, name, Counter())
        assert road is not None
        joints = road.line.joints()
        assert joints.gap_m.max(initial=0.0) < 1e-4
        assert joints.turn_rad.max(initial=0.0) < 1e-6
        assert road.end_m == pytest.approx(float(element.get("length", "")), abs=1e-6)


@pytest.mark.parametrize(("start", "end"), [(0.0, 0.0), (0.02, 0.02), (0.0, -0.03), (0.05, -0.01)])
def test_lines_arcs_and_spirals_follow_their_curvature(start: float, end: float) -> None:
    length = 80.0
    curve = line_of(Piece(**PLACE, length_m=length, curvature=start, rate=(end - start) / length))
    s = np.linspace(0.0, length, 41)

    def slope(at: float, state: np.ndarray) -> list[float]:
        return [math.cos(state[2]), math.sin(state[2]), start + (end - start) * at / length]

    wanted = solve_ivp(slope, (0, length), [0, 0, 0.7], t_eval=s, rtol=1e-11, atol=1e-11).y
    found = curve.evaluate(s)
    np.testing.assert_allclose([found.x_m, found.y_m, found.heading_rad], wanted, atol=1e-8)
    np.testing.assert_allclose(found.curvature, start + (end - start) * s / length, atol=1e-12)
    assert curve.length_m == pytest.approx(length, abs=1e-9)


@pytest.mark.parametrize("slope", [False, True], ids=["paramPoly3", "poly3"])
def test_polynomials_lie_on_their_graph_at_their_own_arc_length(slope: bool) -> None:
    v = np.array([0.0, 0.0, 0.01, -1e-4])
    u = np.array([0.0, 1.0, 0.0, 0.0])
    end = 30.0
    fine = np.linspace(0.0, end, 200_001)
    graph = np.polynomial.polynomial.polyval(fine, v)
    arcs = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(fine), np.diff(graph)))))
    base = Piece(**PLACE, length_m=float(arcs[-1]) if slope else end)
    curve = line_of(polynomial_piece(base, u, v, "arcLength", slope=slope))
    assert curve.length_m == pytest.approx(arcs[-1], abs=1e-6)
    s = np.linspace(0.0, curve.length_m, 25)
    at = curve.evaluate(s)
    local = np.column_stack((np.interp(s, arcs, fine), np.interp(s, arcs, graph)))
    np.testing.assert_allclose(np.column_stack((at.x_m, at.y_m)), turned(local), atol=1e-5)
    first = np.polynomial.polynomial.polyval(local[:, 0], [0.0, 0.02, -3e-4])
    second = np.polynomial.polynomial.polyval(local[:, 0], [0.02, -6e-4])
    np.testing.assert_allclose(at.heading_rad, 0.7 + np.arctan(first), atol=1e-6)
    np.testing.assert_allclose(at.curvature, second / np.hypot(1.0, first) ** 3, atol=1e-7)


def test_both_parameter_ranges_give_one_curve_and_a_missing_one_is_found() -> None:
    length = 20.0
    u, v = np.array([0.0, 1.0, 0.0, -1e-5]), np.array([0.0, 0.0, 0.02, 1e-4])
    scale = length ** np.arange(4)
    base = Piece(**PLACE, length_m=length)
    choices = [
        polynomial_piece(base, u, v, "arcLength"),
        polynomial_piece(base, u * scale, v * scale, "normalized"),
        polynomial_piece(base, u, v, None),
        polynomial_piece(base, u * scale, v * scale, None),
    ]
    s = np.linspace(0.0, 19.9, 9)
    wanted = line_of(choices[0]).evaluate(s)
    for choice in choices[1:]:
        found = line_of(choice).evaluate(s)
        np.testing.assert_allclose(found.x_m, wanted.x_m, atol=1e-9)
        np.testing.assert_allclose(found.curvature, wanted.curvature, atol=1e-9)


@pytest.mark.parametrize(
    "piece",
    [
        Piece(**PLACE, length_m=40.0, curvature=0.01, rate=2e-4),
        polynomial_piece(
            Piece(**PLACE, length_m=25.0),
            np.array([0.0, 1.1, 0.01, -1e-4]),
            np.array([0.0, 0.1, 0.02, 1e-4]),
            "arcLength",
        ),
        polynomial_piece(
            Piece(**PLACE, length_m=25.0),
            np.zeros(4),
            np.array([0.0, 0.2, 0.02, -4e-4]),
            None,
            slope=True,
        ),
    ],
    ids=["spiral", "paramPoly3", "poly3"],
)
def test_derivatives_are_those_of_finite_differences(piece: Piece) -> None:
    line, h = ReferenceLine((piece,)), 1e-3
    w = np.linspace(1.0, piece.length_m - 1.0, 7)
    below, here, above = line.jet(w - h), line.jet(w), line.jet(w + h)
    for lower, upper in (("r", "d1"), ("d1", "d2"), ("d2", "d3")):
        difference = (getattr(above, lower) - getattr(below, lower)) / (2.0 * h)
        np.testing.assert_allclose(getattr(here, upper), difference, atol=2e-6)
