"""Footprints less shadows against exact lines of sight, point by point."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from models.cameras import Cameras, make_camera
from models.footprints import footprint_polygon
from models.geometry import FloatArray
from models.obstacles import Obstacles
from models.shadows import Piece, Shadows
from models.sight import line_of_sight

L_SHAPED = np.array([[8.0, -6.0], [20.0, -6.0], [20.0, 6.0], [14.0, 6.0], [14.0, 0.0], [8.0, 0.0]])


def area_of(pieces: list[Piece]) -> shapely.Geometry:
    return shapely.union_all([shapely.Polygon(p.outline, p.holes) for p in pieces])


@pytest.mark.parametrize("roof", [2.0, 5.5, 6.0, 12.0])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_point_is_visible_where_its_line_of_sight_is_free(roof: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    houses = [L_SHAPED + rng.uniform(-3.0, 3.0, 2), small_house(rng), small_house(rng)]
    obstacles = Obstacles(tuple(houses), np.full(3, roof))
    angles = np.linspace(-1.0, 1.0, 30)
    outline = np.vstack([[[0.5, 0.0]], 45.0 * np.column_stack([np.cos(angles), np.sin(angles)])])
    pieces = Shadows(obstacles).visible(outline, np.zeros(2), 6.0)
    points = rng.uniform([-2.0, -40.0], [46.0, 40.0], (4000, 2))
    inside = shapely.contains_xy(shapely.Polygon(outline), points)
    free = inside & line_of_sight(
        obstacles, np.zeros(4000), np.zeros(4000), 6.0, points[:, 0], points[:, 1]
    )
    found = area_of(pieces)
    clear = shapely.distance(shapely.boundary(found), shapely.points(points)) > 1e-6
    np.testing.assert_array_equal(shapely.contains_xy(found, points)[clear], free[clear])
    assert 0 < free.sum() < inside.sum()
    assert [shapely.Polygon(p.outline).area for p in pieces] == sorted(
        (shapely.Polygon(p.outline).area for p in pieces), reverse=True
    )


def small_house(rng: np.random.Generator) -> FloatArray:
    x, y = rng.uniform([10.0, -15.0], [30.0, 15.0])
    return np.array([[x, y], [x + 4.0, y], [x + 4.0, y + 3.0], [x, y + 3.0]])


def test_a_low_wall_in_the_middle_leaves_a_hole() -> None:
    house = np.array([[9.0, -1.0], [11.0, -1.0], [11.0, 1.0], [9.0, 1.0]])
    outline = np.array([[5.0, -10.0], [30.0, -10.0], [30.0, 10.0], [5.0, 10.0]])
    (piece,) = Shadows(Obstacles((house,), np.array([3.0]))).visible(outline, np.zeros(2), 6.0)
    assert len(piece.holes) == 1
    # the roof at half the camera's height throws its far corners to twice their distance
    assert shapely.Polygon(piece.holes[0]).bounds == pytest.approx((9.0, -2.0, 22.0, 2.0))


def test_nothing_in_the_way_changes_nothing() -> None:
    camera: Cameras = make_camera(fov_deg=(60.0, 45.0), pitch_deg=30.0)
    outline = footprint_polygon(camera, 0, 60.0)
    away = Obstacles((L_SHAPED + 500.0,), np.array([10.0]))
    (piece,) = Shadows(away).visible(outline, np.zeros(2), 6.0)
    assert piece.outline is outline
    assert not Shadows(away).visible(np.empty((0, 2)), np.zeros(2), 6.0)
