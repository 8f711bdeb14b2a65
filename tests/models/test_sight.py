"""Line of sight against exact rational arithmetic, against shapely, and by definition on ties."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from models.geometry import BoolArray, FloatArray
from models.obstacles import Obstacles
from models.orientation import orient
from models.sight import line_of_sight
from models.sight_exact import look
from models.sight_grid import sight_grid
from models.sight_traversal import CLEAR, UNSURE, glance

Point = tuple[Fraction, Fraction]
SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])


def clear(
    obstacles: Obstacles, camera: tuple[float, float, float], car: tuple[float, float]
) -> bool:
    return bool(line_of_sight(obstacles, *camera, *car))


def one(ring: FloatArray, height: float = 20.0) -> Obstacles:
    return Obstacles((ring,), np.array([height]))


def brute_force(
    obstacles: Obstacles, camera: tuple[float, float, float], car: tuple[float, float]
) -> bool:
    """Cut the ray below each roof wherever it meets a wall; ask for each piece's middle."""
    for ring, roof in zip(obstacles.rings, obstacles.height_m, strict=True):
        share = min(1.0, roof / camera[2])
        cut = [
            a if share >= 1.0 else t + share * (a - t) for a, t in zip(camera, car, strict=False)
        ]
        t, c = exact(car), exact(cut)
        corners = [exact(corner) for corner in ring]
        walls = list(zip(corners, corners[1:] + corners[:1], strict=True))
        if t == c:
            if inside(t, walls):
                return False
            continue
        marks = {Fraction(0), Fraction(1)}
        for p, q in walls:
            marks |= meetings(t, c, p, q)
        stops = sorted(marks)
        for u, v in itertools.pairwise(stops):
            middle = (u + v) / 2
            if inside((t[0] + middle * (c[0] - t[0]), t[1] + middle * (c[1] - t[1])), walls):
                return False
    return True


def exact(point: object) -> Point:
    x, y = list(point)[:2]  # type: ignore[call-overload]
    return Fraction(float(x)), Fraction(float(y))


def cross(a: Point, b: Point, c: Point) -> Fraction:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def meetings(t: Point, c: Point, p: Point, q: Point) -> set[Fraction]:
    """Return the shares of the way from t to c at which it touches the wall p–q or its ends."""
    d = (c[0] - t[0], c[1] - t[1])
    w = (q[0] - p[0], q[1] - p[1])
    across = d[0] * w[1] - d[1] * w[0]
    found = set()
    for end in (p, q):
        if cross(t, c, end) == 0:
            square = d[0] ** 2 + d[1] ** 2
            found.add(((end[0] - t[0]) * d[0] + (end[1] - t[1]) * d[1]) / square)
    if across != 0:
        found.add(((p[0] - t[0]) * w[1] - (p[1] - t[1]) * w[0]) / across)
    return {u for u in found if 0 < u < 1}


def inside(point: Point, walls: list[tuple[Point, Point]]) -> bool:
    odd = False
    for p, q in walls:
        if (
            cross(p, q, point) == 0
            and min(p[0], q[0]) <= point[0] <= max(p[0], q[0])
            and min(p[1], q[1]) <= point[1] <= max(p[1], q[1])
        ):
            return False
        if (p[1] > point[1]) != (q[1] > point[1]):
            x = p[0] + (point[1] - p[1]) / (q[1] - p[1]) * (q[0] - p[0])
            odd ^= x > point[0]
    return odd


def simple_ring(rng: np.random.Generator, size: int) -> FloatArray:
    """Draw a star-shaped ring with whole coordinates, so that ties are common."""
    while True:
        n = int(rng.integers(3, 8))
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, n))
        radius = rng.uniform(1.0, 4.0, n)
        ring = np.rint(
            rng.uniform(0, size, 2)
            + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        )
        if shapely.Polygon(ring).is_valid and shapely.Polygon(ring).area > 0.0:
            return ring


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_rays_on_a_lattice_are_what_rational_arithmetic_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    obstacles = Obstacles(
        tuple(simple_ring(rng, 12) for _ in range(n)), rng.choice([2.0, 3.0, 4.0, 8.0], n)
    )
    grid = sight_grid(obstacles, float(rng.choice([0.7, 3.0, 50.0])))
    for _ in range(25):
        x, y, tx, ty = (float(v) for v in rng.integers(-3, 16, 4))
        h = float(rng.choice([2.0, 4.0, 6.0]))
        assert line_of_sight(grid, x, y, h, tx, ty) == brute_force(
            obstacles, (x, y, h), (tx, ty)
        ), (x, y, h, tx, ty)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_what_a_glance_is_sure_of_is_what_a_look_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    obstacles = Obstacles(
        tuple(simple_ring(rng, 12) / 3.0 + 5e5 for _ in range(4)), rng.choice([2.0, 8.0], 4)
    )
    grid = sight_grid(obstacles)
    sure = 0
    for _ in range(100):
        x, y, tx, ty = rng.uniform(5e5 - 1.0, 5e5 + 5.0, 4)
        answer = glance(grid, x, y, 6.0, tx, ty)
        sure += answer != UNSURE
        assert answer == UNSURE or (answer == CLEAR) == look(grid, x, y, 6.0, tx, ty)
    assert sure > 50


def test_random_rays_agree_with_shapely() -> None:
    rng = np.random.default_rng(5)
    centres = rng.uniform(0.0, 300.0, (120, 2))
    rings, heights = [], rng.uniform(2.0, 12.0, 120)
    for centre in centres:
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 6))
        rings.append(
            centre
            + rng.uniform(3.0, 12.0, (6, 1)) * np.column_stack([np.cos(angle), np.sin(angle)])
        )
    obstacles = Obstacles(tuple(rings), heights)
    n = 4000
    camera, car = rng.uniform(-20.0, 320.0, (2, n, 2))
    height = rng.uniform(3.0, 10.0, n)
    got = line_of_sight(obstacles, camera[:, 0], camera[:, 1], height, car[:, 0], car[:, 1])
    assert np.array_equal(got, by_shapely(obstacles, camera, height, car))
    assert 0.1 < got.mean() < 0.9


def by_shapely(
    obstacles: Obstacles, camera: FloatArray, height: FloatArray, car: FloatArray
) -> BoolArray:
    out = np.ones(len(camera), dtype=np.bool_)
    for ring, roof in zip(obstacles.rings, obstacles.height_m, strict=True):
        polygon = shapely.Polygon(ring)
        share = np.minimum(1.0, roof / height)[:, None]
        top = np.where(share >= 1.0, camera, car + share * (camera - car))
        lines = shapely.linestrings(np.stack([car, top], axis=1))
        out &= ~shapely.relate_pattern(lines, polygon, "T********")
    return out


def test_a_ray_along_a_wall_or_past_a_corner_is_clear() -> None:
    house = one(SQUARE)
    assert clear(house, (-5.0, 0.0, 6.0), (15.0, 0.0))  # along the southern wall
    assert clear(house, (-5.0, 5.0, 6.0), (5.0, -5.0))  # past the corner (0, 0)
    assert not clear(house, (-5.0, 1e-9, 6.0), (15.0, 1e-9))
    assert not clear(house, (-5.0, -5.0, 6.0), (15.0, 15.0))  # in and out by corners


def test_a_camera_on_a_wall_sees_outwards_only() -> None:
    house = one(SQUARE)
    assert clear(house, (5.0, 0.0, 6.0), (5.0, -20.0))
    assert clear(house, (5.0, 0.0, 6.0), (20.0, 0.0))
    assert not clear(house, (5.0, 0.0, 6.0), (5.0, 20.0))
    assert clear(house, (0.0, 0.0, 6.0), (-3.0, 4.0))  # on a corner


def test_a_car_on_a_wall_is_seen_from_outside_and_one_within_is_not() -> None:
    house = one(SQUARE)
    assert clear(house, (5.0, -20.0, 6.0), (5.0, 0.0))
    assert not clear(house, (5.0, 20.0, 6.0), (5.0, 0.0))
    assert not clear(house, (5.0, -20.0, 6.0), (5.0, 5.0))
    assert not clear(house, (5.0, 5.0, 6.0), (5.0, -20.0))  # the camera within


def test_the_roof_decides_and_its_eaves_do_not_block() -> None:
    house = one(SQUARE, height=4.0)
    # From 8 m the ray is below 4 m on the second half of its way.
    assert clear(house, (-30.0, 5.0, 8.0), (50.0, 5.0))  # sinks below 4 m at x = 10, the far wall
    assert not clear(house, (-30.0, 5.0, 8.0), (49.0, 5.0))  # at x = 9.5, still inside
    assert clear(house, (5.0, 5.0, 8.0), (15.0, 5.0))  # from above the roof, over the eaves
    assert not clear(house, (5.0, 5.0, 8.0), (14.0, 5.0))
    assert clear(one(SQUARE, np.inf), (-5.0, -1.0, 6.0), (50.0, -1.0))


def test_a_camera_straight_above_the_car_is_blocked_strictly_inside_only() -> None:
    house = one(SQUARE, height=4.0)
    assert not clear(house, (5.0, 5.0, 8.0), (5.0, 5.0))
    assert clear(house, (0.0, 5.0, 8.0), (0.0, 5.0))
    assert clear(house, (-1.0, 5.0, 8.0), (-1.0, 5.0))


def test_a_slit_between_two_houses_that_share_a_wall_is_clear() -> None:
    east = SQUARE + np.array([10.0, 0.0])
    both = Obstacles((SQUARE, east), np.array([20.0, 20.0]))
    assert clear(both, (10.0, -5.0, 6.0), (10.0, 15.0))
    assert not clear(both, (10.0, -5.0, 6.0), (10.5, 15.0))


def test_a_footprint_that_crosses_itself_has_two_insides() -> None:
    bow = one(np.array([[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]]))
    assert not clear(bow, (2.0, -5.0, 6.0), (2.0, 15.0))
    assert not clear(bow, (-5.0, 5.0, 6.0), (3.0, 5.0))
    assert clear(bow, (5.0, -5.0, 6.0), (5.0, 4.0))  # into the notch


def test_nothing_blocks_without_obstacles_nor_beyond_the_grid() -> None:
    assert clear(Obstacles(), (0.0, 0.0, 6.0), (30.0, 0.0))
    house = one(SQUARE)
    assert clear(house, (-100.0, -100.0, 6.0), (-50.0, 300.0))
    assert not clear(house, (-100.0, 5.0, 6.0), (100.0, 5.0))  # across the whole grid


def test_answers_do_not_depend_on_the_cells() -> None:
    rng = np.random.default_rng(2)
    obstacles = Obstacles(tuple(simple_ring(rng, 60) for _ in range(30)), np.full(30, 9.0))
    ends = rng.uniform(-5.0, 65.0, (4, 2000))
    answers = [
        line_of_sight(sight_grid(obstacles, cell), ends[0], ends[1], 6.0, ends[2], ends[3])
        for cell in (1.0, 7.3, 200.0)
    ]
    assert np.array_equal(answers[0], answers[1])
    assert np.array_equal(answers[0], answers[2])


def test_bad_rays_and_cells_are_refused_by_name() -> None:
    house = one(SQUARE)
    with pytest.raises(ValueError, match=r"target_x_m must be finite"):
        line_of_sight(house, 0.0, 0.0, 6.0, np.nan, 0.0)
    with pytest.raises(ValueError, match=r"height_m must be above 0, got 0"):
        line_of_sight(house, 0.0, 0.0, 0.0, 1.0, 0.0)
    with pytest.raises(ValueError, match=r"cell_m must be positive, got -1"):
        sight_grid(house, -1.0)


@given(st.lists(st.integers(-(2**20), 2**20), min_size=6, max_size=6), st.integers(-3, 3))
@settings(max_examples=300, deadline=None)
def test_orientation_is_exact(whole: list[int], nudge: int) -> None:
    x = [0.1 * w for w in whole]
    # c near the line from a to b, off it by a few units in the last place
    x[4] = 0.5 * (x[0] + x[2]) + nudge * np.spacing(x[0])
    x[5] = 0.5 * (x[1] + x[3])
    a, b, c = (exact(x[i : i + 2]) for i in (0, 2, 4))
    det = cross(a, b, c)
    assert orient(*x) == (det > 0) - (det < 0)
