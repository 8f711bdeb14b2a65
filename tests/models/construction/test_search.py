"""Roads round obstacles: checked with shapely, and against Dubins paths through vertices."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from benchmarks.construction_maps import Map, random_map
from benchmarks.dubins_through_vertices import shortest
from models.construction.search import ARCS, CLOTHOIDS, BuiltRoad, Construction, build_roads
from models.construction.site import make_site
from models.geometry import FloatArray, Pose

REASONS = ("shut", "too narrow", "too large", "the time ran out")


def square(x: float, y: float, half: float) -> FloatArray:
    return np.array([x, y]) + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


def built(drawn: Map, **options: float) -> Construction | str:
    try:
        site = make_site(
            drawn.start,
            drawn.goal,
            drawn.obstacles,
            clearance_m=drawn.clearance_m,
            width_m=drawn.width_m,
        )
    except ValueError as error:
        return str(error)
    return build_roads(site, min_radius_m=drawn.radius_m, width_m=drawn.width_m, **options)  # type: ignore[arg-type]


def check_road(road: BuiltRoad, drawn: Map) -> None:
    """Check a road by points 0.1 m apart, with nothing of the search's own geometry."""
    points = road.road().sample(0.1)
    line = shapely.LineString(points.xy)
    step = float(np.hypot(*np.diff(points.xy, axis=0).T).mean())
    sagitta = step**2 / (8.0 * drawn.radius_m)
    for obstacle in drawn.obstacles:
        kept = line.distance(shapely.Polygon(obstacle))
        assert kept >= drawn.clearance_m + 0.5 * drawn.width_m - sagitta - 1e-6
    a, b, c = points.xy[:-2], points.xy[1:-1], points.xy[2:]
    ab, bc, ca = b - a, c - b, a - c
    area = ab[:, 0] * bc[:, 1] - ab[:, 1] * bc[:, 0]
    curvature = 2.0 * np.abs(area) / (np.hypot(*ab.T) * np.hypot(*bc.T) * np.hypot(*ca.T))
    assert curvature.max() <= (1.0 + 1e-4) / drawn.radius_m
    for at, pose in ((0, drawn.start), (-1, drawn.goal)):
        assert points.xy[at] == pytest.approx([pose.x_m, pose.y_m], abs=1e-6)
        turn = math.remainder(points.heading_rad[at] - pose.heading_rad, math.tau)
        assert turn == pytest.approx(0.0, abs=1e-6)
    if road.kind == CLOTHOIDS:
        jumps = [
            abs(p.curvature_end - q.curvature_start)
            for p, q in zip(road.pieces[:-1], road.pieces[1:], strict=True)
        ]
        assert max(jumps, default=0.0) <= 1e-12
        assert abs(road.pieces[0].curvature_start) + abs(road.pieces[-1].curvature_end) <= 1e-12


def check_map(seed: int) -> None:
    drawn = random_map(seed)
    found = built(drawn, time_limit_s=600.0)
    if isinstance(found, str):
        assert "must" in found
        return
    for road in found.roads:
        check_road(road, drawn)
    assert bool(found.roads) != any(word in found.reason for word in REASONS)
    ours = min((r.length_m for r in found.roads if r.kind == ARCS), default=math.inf)
    start, goal = ((p.x_m, p.y_m, p.heading_rad) for p in (drawn.start, drawn.goal))
    far = 1.3 * math.dist(start[:2], goal[:2]) + 6.0 * drawn.radius_m
    theirs = shortest(
        start,
        goal,
        drawn.obstacles,
        radius=drawn.radius_m,
        keep=drawn.clearance_m + 0.5 * drawn.width_m,
        longest=ours + 1.0 if math.isfinite(ours) else far,
    )
    assert ours <= theirs * (1.0 + 1e-9) + 1e-6


@pytest.mark.parametrize("seed", range(12))
def test_roads_keep_everything_and_none_through_vertices_is_shorter(seed: int) -> None:
    check_map(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12, 500))
def test_roads_on_many_maps(seed: int) -> None:
    check_map(seed)


def test_without_obstacles_the_road_is_dubins() -> None:
    site = make_site(Pose(0, 0, 0), Pose(0, 40, math.pi), [], clearance_m=0.0, width_m=3.0)
    roads = build_roads(site, min_radius_m=20.0, width_m=3.0, kinds=(ARCS,)).roads
    assert roads[0].length_m == pytest.approx(20.0 * math.pi, abs=1e-6)
    near = make_site(Pose(0, 0, 0), Pose(4, 0, math.pi), [], clearance_m=0.0, width_m=3.0)
    roads = build_roads(near, min_radius_m=20.0, width_m=3.0, kinds=(ARCS,)).roads
    best = shortest((0, 0, 0), (4, 0, math.pi), [], radius=20.0, keep=1.5)
    assert roads[0].length_m == pytest.approx(best, abs=1e-6)


def test_one_square_has_a_road_on_each_side_of_equal_length() -> None:
    site = make_site(
        Pose(0, 0, 0), Pose(120, 0, 0), [square(60.0, 0.0, 8.0)], clearance_m=1.0, width_m=3.0
    )
    roads = build_roads(
        site, min_radius_m=20.0, width_m=3.0, kinds=(ARCS,), length_factor=1.2
    ).roads
    assert len(roads) == 2
    assert {len(road.word) for road in roads} == {0, 1}
    assert roads[0].length_m == pytest.approx(roads[1].length_m, abs=1e-6)
    # touches one corner's grown disc each side or two: the clearance is used up, not more
    assert all(road.clearance_m == pytest.approx(1.0, abs=1e-3) for road in roads)


def test_roads_move_and_turn_with_the_scene() -> None:
    drawn = random_map(0)
    pose = Pose(1000.0, -500.0, 2.0)
    moved = Map(
        pose @ drawn.start,
        pose @ drawn.goal,
        [pose.apply(ring) for ring in drawn.obstacles],
        drawn.radius_m,
        drawn.clearance_m,
        drawn.width_m,
    )
    here, there = built(drawn), built(moved)
    assert not isinstance(here, str)
    assert not isinstance(there, str)
    shortest_of = [min(r.length_m for r in c.roads if r.kind == ARCS) for c in (here, there)]
    assert shortest_of[0] == pytest.approx(shortest_of[1], rel=1e-6)


@pytest.mark.parametrize(
    ("obstacles", "radius", "reason"),
    [
        ([[[80, -10], [81, -10], [81, 10], [120, 10], [120, -10], [121, -10], [121, 11], [80, 11]],
          [[80, -10], [121, -10], [121, -11], [80, -11]]], 10.0, "shut road.construct.goal in"),
        ([[[55, 2], [55, 50], [150, 50], [150, -50], [55, -50], [55, -2], [60, -2], [60, -45],
           [145, -45], [145, 45], [60, 45], [60, 2]]],
         10.0, "the corridor is too narrow.* needs 5 m, the widest way through has (4|3.99)"),
        ([square(50, 30, 27), square(50, -30, 27), square(-30, 0, 20), square(130, 0, 20)],
         200.0, "the radius is too large"),
    ],
)  # fmt: skip
def test_where_there_is_no_road_it_says_why(
    obstacles: list[object], radius: float, reason: str
) -> None:
    import re

    site = make_site(
        Pose(0, 0, 1.5 if radius > 100 else 0.0),
        Pose(100, 0, 0),
        obstacles,  # type: ignore[arg-type]
        clearance_m=1.0,
        width_m=3.0,
    )
    found = build_roads(site, min_radius_m=radius, width_m=3.0, time_limit_s=60.0)
    assert not found.roads
    assert re.search(reason, found.reason), found.reason


def test_a_spent_clock_ends_the_search_in_words() -> None:
    drawn = random_map(13)
    found = built(drawn, time_limit_s=0.0)
    assert not isinstance(found, str)
    assert not found.complete
    assert "the time ran out" in found.reason


@pytest.mark.slow
def test_a_thousand_obstacles_end_in_time() -> None:
    import time

    obstacles = [
        square(x, y, 1.5) for x in np.arange(20, 420, 12.5) for y in np.arange(-200, 200, 12.5)
    ]
    site = make_site(Pose(0, 0, 0), Pose(450, 0, 0), obstacles, clearance_m=1.0, width_m=3.0)
    before = time.monotonic()
    found = build_roads(site, min_radius_m=15.0, width_m=3.0, time_limit_s=60.0)
    assert time.monotonic() - before < 180.0
    assert found.roads or found.reason
    for road in found.roads[:2]:
        check_road(road, Map(site.start, site.goal, obstacles, 15.0, 1.0, 3.0))
