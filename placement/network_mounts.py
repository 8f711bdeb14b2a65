"""Where poles may stand along the streets of a network, and which ground is carriageway."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.spatial import cKDTree

from models.geometry import BoolArray, FloatArray, IntArray
from models.network import Lane, RoadNetwork
from models.obstacles import Obstacles
from models.polyline import distinct_points, polyline_length

_STEP_M = 1.0
_SLACK_M = 0.3  # beyond half a step: outside a bend, samples fan out
_EDGE_M = 2e-3  # edges belong to the ground they bound, to what a sample a metre off can tell
_OFF_M = 5e-3  # ... so a pole that is to stand on its own street's edge is looked at from here
_TWINS_M = 5.0  # poles nearer together are one: carriageways side by side, corners of junctions
_CHUNK = 8192


@dataclass(frozen=True, slots=True)
class StreetMounts:
    """Hold m mounts beside the edges of a network, each array (m,).

    s_m: arc length along all streets in a row; side: +1 left, −1 right; x_m, y_m: where it stands;
    heading_rad: the street's direction there; edge: which edge that is.
    """

    s_m: FloatArray
    side: IntArray
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    edge: IntArray


@dataclass(frozen=True, slots=True)
class Surface:
    """Know the carriageways by samples a metre apart, turns through junctions included.

    `edge` (n,) is the sample's edge, −1 on a turn; `s_m` its arc length along all streets in a row.
    """

    xy: FloatArray
    heading_rad: FloatArray
    left_m: FloatArray
    right_m: FloatArray
    curvature: FloatArray
    edge: IntArray
    s_m: FloatArray
    tree: cKDTree

    def covers(self, x_m: FloatArray, y_m: FloatArray) -> BoolArray:
        """Mark points (m,) that lie on a carriageway."""
        points = np.column_stack((x_m, y_m))
        on = np.zeros(len(points), dtype=np.bool_)
        reach = float(max(self.left_m.max(), self.right_m.max())) + _STEP_M
        for begin in range(0, len(points), _CHUNK):
            part = points[begin : begin + _CHUNK]
            near = cast("list[list[int]]", self.tree.query_ball_point(part, reach))
            counts = np.array([len(each) for each in near])
            if not counts.sum():
                continue
            which = np.repeat(np.arange(len(part)), counts)
            sample = np.concatenate([np.array(each, dtype=np.int64) for each in near if each])
            along, left = self._resolve(part[which], sample)
            left = left - 0.5 * self.curvature[sample] * along**2
            inside = np.abs(along) <= 0.5 * _STEP_M + _SLACK_M
            inside &= left <= self.left_m[sample] + _EDGE_M
            inside &= left >= -self.right_m[sample] - _EDGE_M
            on[begin + which[inside]] = True
        return on

    def nearest(self, x_m: FloatArray, y_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return, for points (m,), arc length along all streets and signed offset of the nearest.

        The nearest is that of the lanes' middles, to about a metre along.
        """
        streets = np.flatnonzero(self.edge >= 0)
        tree = cKDTree(self.xy[streets])
        points = np.column_stack((x_m, y_m))
        sample = streets[cast("IntArray", tree.query(points)[1])]
        _, left = self._resolve(points, sample)
        return self.s_m[sample], left

    def _resolve(self, points: FloatArray, sample: IntArray) -> tuple[FloatArray, FloatArray]:
        dx, dy = (points - self.xy[sample]).T
        c, s = np.cos(self.heading_rad[sample]), np.sin(self.heading_rad[sample])
        return dx * c + dy * s, dy * c - dx * s


def surface_of(network: RoadNetwork) -> Surface:
    """Sample every edge and every turn of a network."""
    points = network.sample(_STEP_M)
    lengths = np.array([edge.length_m for edge in network.edges])
    begin = np.concatenate(([0.0], np.cumsum(lengths)[:-1]))
    turns = [turn.path for turn in network.turns if turn.path is not None]
    seen: dict[int, Lane] = {id(path): path for path in turns}
    parts = [_sampled(path) for path in seen.values()]
    xy = np.vstack([points.points.xy, *(part[0] for part in parts)])
    counts = [len(part[0]) for part in parts]
    return Surface(
        xy=xy,
        heading_rad=np.concatenate([points.points.heading_rad, *(part[1] for part in parts)]),
        left_m=np.concatenate(
            [points.left_m, np.repeat([path.left_m for path in seen.values()], counts)]
        ),
        right_m=np.concatenate(
            [points.right_m, np.repeat([path.right_m for path in seen.values()], counts)]
        ),
        curvature=np.concatenate([points.points.curvature, np.zeros(sum(counts))]),
        edge=np.concatenate([points.edge, np.full(sum(counts), -1)]).astype(np.int64),
        s_m=np.concatenate([begin[points.edge] + points.points.s_m, np.zeros(sum(counts))]),
        tree=cKDTree(xy),
    )


def place_along(
    network: RoadNetwork, spacing_m: float, side_offset_m: float, sides: list[int]
) -> tuple[StreetMounts, int]:
    """Put mounts beside every edge, `spacing_m` apart and half of that from its ends.

    They stand `side_offset_m` beyond the carriageway's edge on `sides` (+1 left, −1 right of the
    traffic) where that is neither on another carriageway nor inside a building; of mounts within
    5 m of each other (or half the spacing) the first stays, so that both directions of a street
    share their poles. An edge shorter than half the spacing gets none unless all are.

    Returns the mounts and how many were tried.
    """
    lengths = np.array([edge.length_m for edge in network.edges])
    begin = np.concatenate(([0.0], np.cumsum(lengths)[:-1]))
    counts = np.floor(lengths / spacing_m + 0.5).astype(np.int64)
    if not counts.any():
        counts[:] = 1
    columns: list[FloatArray] = []
    for index, (edge, n) in enumerate(zip(network.edges, counts.tolist(), strict=True)):
        if n == 0:
            continue
        road = edge.road
        s = np.repeat((np.arange(n) + 0.5) * (road.length_m / n), len(sides))
        side = np.tile(np.array(sorted(sides, reverse=True), dtype=np.float64), n)
        left, right = road.half_widths(s)
        lateral = side * (np.where(side > 0.0, left, right) + side_offset_m)
        at, beyond = road.offset(s, lateral), road.offset(s, lateral + side * _OFF_M)
        heading, on = road.evaluate(s).heading_rad, np.full(len(s), float(index))
        columns.append(np.column_stack((begin[index] + s, side, at, beyond, heading, on)))
    rows = np.vstack(columns)
    free = ~surface_of(network).covers(rows[:, 4], rows[:, 5])
    free &= ~inside_buildings(network.obstacles, rows[:, 2], rows[:, 3])
    kept = rows[free]
    kept = kept[_apart(kept[:, 2:4], min(_TWINS_M, 0.5 * spacing_m))]
    s_m, side_of, x, y, _, _, direction, edge_of = (np.ascontiguousarray(c) for c in kept.T)
    sides_of, edges = side_of.astype(np.int64), edge_of.astype(np.int64)
    return StreetMounts(s_m, sides_of, x, y, direction, edges), len(rows)


def count_tries(network: RoadNetwork, spacing_m: float) -> int:
    """Return how many places along the edges `place_along` would try, at most, on each side."""
    return sum(math.floor(edge.length_m / spacing_m + 0.5) for edge in network.edges)


def inside_buildings(obstacles: Obstacles, x_m: FloatArray, y_m: FloatArray) -> BoolArray:
    """Mark points (m,) inside a building, or on its wall."""
    import shapely

    inside = np.zeros(len(x_m), dtype=np.bool_)
    if not len(obstacles):
        return inside
    tree = shapely.STRtree([shapely.Polygon(ring) for ring in obstacles.rings])
    inside[tree.query(shapely.points(x_m, y_m), predicate="intersects")[0]] = True
    return inside


def _apart(xy: FloatArray, distance_m: float) -> BoolArray:
    """Keep points (m, 2) in order, each unless one that was kept is nearer than `distance_m`."""
    keep = np.ones(len(xy), dtype=np.bool_)
    if not len(xy):
        return keep
    pairs = cKDTree(xy).query_pairs(distance_m, output_type="ndarray")
    for a, b in pairs[np.lexsort((pairs[:, 0], pairs[:, 1]))].tolist():
        if keep[a]:
            keep[b] = False
    return keep


def _sampled(path: Lane) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 2) a metre apart and headings along a turn."""
    if path.shape is None:
        points = path.road.sample(_STEP_M)
        return points.xy, points.heading_rad
    shape = distinct_points(path.shape, 1e-3)
    n = max(1, math.ceil(polyline_length(shape) / _STEP_M))
    steps = np.diff(shape, axis=0)
    s = np.concatenate(([0.0], np.cumsum(np.hypot(*steps.T))))
    at = np.linspace(0.0, s[-1], n + 1)
    cell = np.clip(np.searchsorted(s, at, side="right") - 1, 0, len(steps) - 1)
    xy = np.column_stack([np.interp(at, s, shape[:, k]) for k in range(2)])
    return xy, np.arctan2(steps[cell, 1], steps[cell, 0])
