"""The visibility graph round grown corners: is there a way at all, how short, of which classes.

It is a relaxation of the road: its points lie on the border of the obstacles grown by what the
centre line keeps from them, its ways may cut that border's round corners, and know no radius. So
no road of a class is shorter than the class's way here, and where there is no way there is no road.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import networkx as nx
import numpy as np
import shapely

from models.construction.homotopy import Way, Word, crossing_word, ways_by_class
from models.construction.kernels import seen_from
from models.construction.site import Site
from models.geometry import BoolArray, FloatArray, IntArray

# Points round a corner are this far apart; coarser beyond so many corners.
_FINE_RAD, _COARSE_RAD, _FINE_CORNERS = 0.25 * math.pi, 0.5 * math.pi, 250
_MOST_POINTS, _STRETCHES = 1500, (1.02, 1.1, 1.3, 1.8)


@dataclass(frozen=True, slots=True)
class Visibility:
    """Hold the graph: node 0 is the start, node 1 the goal, the others points round corners.

    `points_m` (n, 2); `corner` (n,) of the site that a point goes round, −1 for start and goal.
    """

    graph: nx.DiGraph[int]
    points_m: FloatArray
    corner: IntArray
    site: Site
    complete: bool  # False: the time ran out, and edges are missing

    @property
    def shortest_m(self) -> float:
        """The length of the shortest way, infinite if there is none."""
        try:
            return float(nx.dijkstra_path_length(self.graph, 0, 1))
        except nx.NetworkXNoPath:
            return math.inf

    def word_of(self, i: int, j: int) -> Word:
        """Return the crossing word of the edge from i to j."""
        return crossing_word(self.points_m[[i, j]], self.site.marks_m)

    def ways(
        self, *, length_factor: float, most_classes: int, deadline: float = math.inf
    ) -> list[Way]:
        """Return the shortest way of each class, shortest first."""
        return list(
            ways_by_class(
                self.graph,
                0,
                1,
                self.word_of,
                length_factor=length_factor,
                most_classes=most_classes,
                deadline=deadline,
            )
        )


def see(site: Site, *, deadline: float = math.inf) -> Visibility:
    """Build the visibility graph of a site, until the deadline (time.monotonic()).

    With many corners, only those in an ellipse about start and goal are looked at, in widening
    ellipses until one holds a way: a way as short as that leaves its ellipse nowhere.
    """
    points, before, after, corner, keep = _points(site)
    apart = math.hypot(site.goal.x_m - site.start.x_m, site.goal.y_m - site.start.y_m)
    detour = np.hypot(*(points - points[0]).T) + np.hypot(*(points - points[1]).T)
    for stretch in (*_STRETCHES, math.inf) if len(points) > _MOST_POINTS else (math.inf,):
        inside = detour <= stretch * apart + 2.0 * site.keep_m
        inside[:2] = True
        found = _graph(
            site, points[inside], before[inside], after[inside], corner[inside], keep, deadline
        )
        if not found.complete or found.shortest_m <= stretch * apart:
            break
    return found


def _graph(
    site: Site,
    points: FloatArray,
    before: FloatArray,
    after: FloatArray,
    corner: IntArray,
    keep: float,
    deadline: float,
) -> Visibility:
    graph: nx.DiGraph[int] = nx.DiGraph()
    graph.add_nodes_from(range(len(points)))
    for i in range(len(points)):
        if time.monotonic() > deadline:
            return Visibility(graph, points, corner, site, complete=False)
        seen = seen_from(i, points, before, after, site.edges_m, keep)
        graph.add_weighted_edges_from(
            (i, int(j), float(seen[j])) for j in np.flatnonzero(np.isfinite(seen))
        )
    return Visibility(graph, points, corner, site, complete=True)


def _points(site: Site) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, float]:
    """Return points round the convex corners, their neighbours, corners, and what ways keep."""
    cones = site.cone_rad
    step = _FINE_RAD if len(cones) <= _FINE_CORNERS else _COARSE_RAD
    shares = np.ceil((cones[:, 1] - cones[:, 0]) / step - 1e-9).astype(np.int64)
    corner = np.repeat(np.arange(len(cones)), shares + 1)
    first = np.concatenate(([0], np.cumsum(shares + 1)))[:-1]
    share = (np.arange(len(corner)) - first[corner]) / shares[corner]
    angle = cones[corner, 0] + share * (cones[:, 1] - cones[:, 0])[corner]
    at = site.corner_m[corner] + site.keep_m * np.column_stack((np.cos(angle), np.sin(angle)))
    # the middle of the chord between neighbours is cos(step/2) as far as they are, or farther
    keep = 0.995 * math.cos(0.5 * step) * site.keep_m
    before, after = at.copy(), at.copy()
    for n in np.unique(site.corner_ring[corner]):
        ring = np.flatnonzero(site.corner_ring[corner] == n)
        before[ring], after[ring] = at[np.roll(ring, 1)], at[np.roll(ring, -1)]
    free = _free(at, site, keep)
    nothing = np.full((2, 2), np.nan)
    ends = np.array(
        [[site.start.x_m, site.start.y_m], [site.goal.x_m, site.goal.y_m]], dtype=np.float64
    )
    return (
        np.ascontiguousarray(np.vstack((ends, at[free]))),
        np.ascontiguousarray(np.vstack((nothing, before[free]))),
        np.ascontiguousarray(np.vstack((nothing, after[free]))),
        np.concatenate((np.array([-1, -1], dtype=np.int64), corner[free])),
        keep,
    )


def _free(points: FloatArray, site: Site, keep: float) -> BoolArray:
    """Mark the points that lie outside every obstacle, at least `keep` away."""
    tree = shapely.STRtree([shapely.Polygon(ring) for ring in site.rings])
    free = np.ones(len(points), dtype=np.bool_)
    near = tree.query(shapely.points(points), predicate="dwithin", distance=keep)[0]
    free[near] = False
    return free
