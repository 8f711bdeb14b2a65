"""What a road is built on: two poses, obstacles, and how far the centre line keeps from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike

from models.geometry import FloatArray, IntArray, Pose

_SAME_M = 1e-6  # nearer corners are one corner, nearer poses one pose


@dataclass(frozen=True, slots=True)
class Site:
    """Hold what `make_site` checked; rings run counter-clockwise, without a repeated corner.

    `keep_m` is what the centre line keeps from every obstacle: clearance and half the width.
    `edges_m` (e, 4) are all edges x0, y0, x1, y1. The convex corners, all arrays (v,), are those
    that a short road may bend round: `corner_m` (v, 2) where, `cone_rad` (v, 2) between which
    outward normals, first to last counter-clockwise, `corner_ring` (v,) of which ring.
    `marks_m` (n, 2) lie one inside each group of obstacles between which no road fits.
    """

    start: Pose
    goal: Pose
    rings: tuple[FloatArray, ...]
    keep_m: float
    edges_m: FloatArray
    corner_m: FloatArray
    cone_rad: FloatArray
    corner_ring: IntArray
    marks_m: FloatArray


def make_site(
    start: Pose,
    goal: Pose,
    obstacles: Sequence[ArrayLike],
    *,
    clearance_m: float,
    width_m: float,
    name: str = "road.construct",
    names: Sequence[str] = (),
) -> Site:
    """Check poses and polygons (each (n, 2), closed or not) and prepare them for the search.

    `names` are what messages call the obstacles, by default `name`.obstacles[n].

    Raises:
        ValueError: one line that names the field: a NaN, a polygon that crosses itself or has no
            area, a start or goal inside an obstacle or nearer than the clearance, a start that
            equals the goal.
    """
    for what, pose in (("start", start), ("goal", goal)):
        if not all(map(math.isfinite, (pose.x_m, pose.y_m, pose.heading_rad))):
            raise ValueError(f"{name}.{what} must be finite, got {_shown(pose)}")
    turned = abs(math.remainder(goal.heading_rad - start.heading_rad, math.tau))
    apart = math.hypot(goal.x_m - start.x_m, goal.y_m - start.y_m)
    if apart < _SAME_M and turned < 1e-9:
        raise ValueError(f"{name}.goal must differ from start, both are {_shown(goal)}")
    if not (math.isfinite(clearance_m) and clearance_m >= 0.0):
        raise ValueError(f"{name}.clearance_m must be finite and at least 0, got {clearance_m}")
    if not (math.isfinite(width_m) and width_m > 0.0):
        raise ValueError(f"road.width_m must be finite and positive, got {width_m}")
    keep = clearance_m + 0.5 * width_m
    names = names or [f"{name}.obstacles[{n}]" for n in range(len(obstacles))]
    polygons = [_polygon(ring, what) for ring, what in zip(obstacles, names, strict=True)]
    for what, pose in (("start", start), ("goal", goal)):
        _refuse_too_near(pose, polygons, keep, f"{name}.{what}", names)
    rings = tuple(_ring(polygon) for polygon in polygons)
    corners = [_corners(ring) for ring in rings]
    return Site(
        start=start,
        goal=goal,
        rings=rings,
        keep_m=keep,
        edges_m=_joined([np.hstack((r, np.roll(r, -1, axis=0))) for r in rings], 4),
        corner_m=_joined([corner for corner, _ in corners], 2),
        cone_rad=_joined([cone for _, cone in corners], 2),
        corner_ring=np.repeat(np.arange(len(rings)), [len(corner) for corner, _ in corners]),
        marks_m=_marks(polygons, keep),
    )


def _polygon(ring: ArrayLike, name: str) -> shapely.Polygon:
    points = np.array(ring, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"{name} must have shape (n, 2), got {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError(f"{name} must be finite, got {points.tolist()}")
    apart = np.hypot(*(points - np.roll(points, 1, axis=0)).T) > _SAME_M
    points = points[apart]
    if len(points) < 3:
        raise ValueError(f"{name} must have at least 3 different corners, got {len(points)}")
    polygon = shapely.Polygon(points)
    if not polygon.is_valid:
        why = shapely.is_valid_reason(polygon)
        raise ValueError(f"{name} must be a simple polygon, got one whose edges meet ({why})")
    if polygon.area < _SAME_M**2:
        raise ValueError(f"{name} must have an area, got corners on one line")
    return shapely.orient_polygons(polygon)


def _refuse_too_near(
    pose: Pose, polygons: Sequence[shapely.Polygon], keep_m: float, what: str, names: Sequence[str]
) -> None:
    point = shapely.Point(pose.x_m, pose.y_m)
    distance = (
        shapely.distance(np.array(polygons, dtype=object), point) if polygons else np.empty(0)
    )
    for n in np.flatnonzero(distance < keep_m - 1e-9).tolist():
        if distance[n] == 0.0:
            raise ValueError(
                f"{what} must lie outside the obstacles, got {_shown(pose)}, inside {names[n]}"
            )
        raise ValueError(
            f"{what} must keep {keep_m:g} m (clearance and half the width) from "
            f"{names[n]}, got {distance[n]:.4g} m"
        )


def _ring(polygon: shapely.Polygon) -> FloatArray:
    ring: FloatArray = np.ascontiguousarray(shapely.get_coordinates(polygon)[:-1])
    return ring


def _corners(ring: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the convex corners of a counter-clockwise ring and their cones of outward normals."""
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turn = np.arctan2(
        before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1)
    )
    first = np.arctan2(before[:, 1], before[:, 0]) - 0.5 * math.pi
    convex = turn > 1e-9
    return ring[convex], np.column_stack((first, first + turn))[convex]


def _marks(polygons: Sequence[shapely.Polygon], keep_m: float) -> FloatArray:
    """Return a point inside one obstacle of each group that growing by `keep_m` joins."""
    if not polygons:
        return np.empty((0, 2))
    # a little less than keep_m: two groups too many do no harm, two classes in one would
    grown = shapely.union_all(shapely.buffer(np.array(polygons, dtype=object), 0.999 * keep_m))
    groups = shapely.get_parts(grown)
    tree = shapely.STRtree(groups)
    # off the middle of symmetric shapes, where ways like to touch: a ray through a way's node
    # counts once, or not, as rounding has it
    aside = 0.01 * keep_m
    inside = [shapely.Point(p.x + aside, p.y) for p in map(shapely.point_on_surface, polygons)]
    point_of: dict[int, tuple[float, float]] = {}
    for n, group in tree.query(inside, predicate="within").T:
        point_of.setdefault(int(group), (inside[n].x, inside[n].y))
    return np.array([point_of[g] for g in sorted(point_of)], dtype=np.float64).reshape(-1, 2)


def _joined(parts: Sequence[FloatArray], columns: int) -> FloatArray:
    joined: FloatArray = np.ascontiguousarray(np.concatenate([np.empty((0, columns)), *parts]))
    return joined


def _shown(pose: Pose) -> str:
    return f"[{pose.x_m:g}, {pose.y_m:g}, {math.degrees(pose.heading_rad):g}]"
