"""Outlines become simple rings that cover what the outlines cover; shapely is the oracle."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from models.obstacles import Obstacles, obstacles_from_polygons

corner = st.tuples(st.integers(0, 20), st.integers(0, 20))


@given(st.lists(corner, min_size=3, max_size=9), st.lists(corner, min_size=3, max_size=5))
@settings(max_examples=80, deadline=None)
def test_rings_cover_what_the_polygon_covers(
    outline: list[tuple[int, int]], hole: list[tuple[int, int]]
) -> None:
    assume(len(set(outline)) >= 3)  # what encloses nothing has no holes either
    found, mended, empty = obstacles_from_polygons([(np.array(outline, float), [hole])], [4.0])
    wanted = shapely.make_valid(shapely.Polygon(outline, [hole]))
    rings = [shapely.Polygon(ring) for ring in found.rings]
    covered = shapely.union_all(rings)
    assert covered.symmetric_difference(wanted).area < 1e-6
    assert all(ring.is_valid and ring.exterior.is_ccw and not ring.interiors for ring in rings)
    assert sum(ring.area for ring in rings) == pytest.approx(covered.area)  # none overlap
    assert bool(empty) == (not rings)
    assert mended in (0, 1)
    assert all(np.any(ring[0] != ring[-1]) for ring in found.rings)


def test_heights_follow_their_polygons() -> None:
    bow = [(0, 0), (2, 2), (2, 0), (0, 2)]
    square = [(5, 5), (6, 5), (6, 6), (5, 6), (5, 5)]
    found, mended, empty = obstacles_from_polygons(
        [(bow, []), ([(0, 0), (1, 1)], []), (square, [])], [3.0, 4.0, 5.0]
    )
    assert (mended, empty) == (1, 1)
    np.testing.assert_array_equal(found.height_m, [3.0, 3.0, 5.0])


@pytest.mark.parametrize(
    ("rings", "heights", "message"),
    [
        ([[(0, 0), (1, 0)]], [1.0], "at least 3 corners"),
        ([[(0, 0), (1, 0), (np.nan, 1)]], [1.0], "must be finite"),
        ([[(0, 0), (1, 0), (0, 1)]], [0.0], r"height_m\[0\] must be above 0"),
        ([[(0, 0), (1, 0), (0, 1)]], [1.0, 2.0], "one number for each of 1 rings"),
    ],
)
def test_what_is_no_prism_is_refused(
    rings: list[list[tuple[float, float]]], heights: list[float], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Obstacles(tuple(np.array(ring) for ring in rings), np.array(heights))


def test_moving_shifts_every_corner() -> None:
    found = Obstacles((np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),), np.ones(1)).moved(2.0, 3.0)
    np.testing.assert_array_equal(found.rings[0], [[2, 3], [3, 3], [2, 4]])
