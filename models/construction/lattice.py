"""Ways to touch obstacles: nodes on circles round their corners and along their edges, and legs.

A shortest road of bounded curvature is made of lines and arcs, and where it bends beyond its ends
it touches an obstacle grown by what the centre line keeps. Round a corner it touches with a circle
of the least radius ρ, or of `keep_m` where that is more: any whose border meets the corner's disc
from outside, its centre ρ − keep_m from the corner. Which one is an angle; the lattice has some
angles of each corner, and `corners` then turns them to where the road is shortest.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import networkx as nx
import numpy as np

from models.construction.clothoids import Bend
from models.construction.homotopy import Word, crossing_word
from models.construction.kernels import advance, leg, legs_from
from models.construction.site import Site
from models.geometry import FloatArray, IntArray

# Between nodes round a corner: finer where there are few corners.
_FINE_RAD, _COARSE_RAD, _FEW_CORNERS = math.radians(10.0), math.radians(20.0), 24
_MOST_TOUCHES = 4  # nodes along an edge, each way
_CHORD_RAD = math.radians(5.0)
_HALF_TURN = math.pi * 1.001


@dataclass(frozen=True, slots=True)
class Lattice:
    """Hold nodes (n, 5) as `kernels` has them, and what each one touches, arrays (n,).

    The first two rows are the start, turning left and right, the last two the goal. `corner`: the
    site's corner that a node goes round, else −1. `angle`: where on its disc it touches. `slack`:
    the straight that its bend needs. `ends`: 1 start, 2 goal, 0 between.
    """

    site: Site
    nodes: FloatArray
    corner: IntArray
    angle: FloatArray
    slack: FloatArray
    ends: IntArray
    at_ends: Bend
    at_corners: Bend

    @property
    def keep_m(self) -> float:
        """What the plain arcs keep so that the bends inside them keep what the site asks."""
        return self.site.keep_m + max(self.at_ends.shift_m, self.at_corners.shift_m)

    def round_corner(self, corner: int, angle: float, side: float) -> FloatArray:
        """Return the node (5,) that goes round `corner` and touches its disc at `angle`."""
        return _round(self.site, self.at_corners, corner, angle, side)

    def legs(self, longest_m: float, deadline: float) -> tuple[nx.DiGraph[int], bool]:
        """Return the clear legs as a graph with `weight` and `kind`, and whether that is all.

        Node n leads to both starts, both goals to node n + 1, at no length.
        """
        n = len(self.nodes)
        graph: nx.DiGraph[int] = nx.DiGraph()
        graph.add_nodes_from(range(n + 2))
        for joint in ((n, 0), (n, 1), (n - 2, n + 1), (n - 1, n + 1)):
            graph.add_edge(*joint, weight=0.0, kind=0)
        plain = self.at_ends.clothoid_m == 0.0
        for i in range(n - 2):
            if time.monotonic() > deadline:
                return graph, False
            cost, kinds = legs_from(
                i,
                self.nodes,
                self.slack,
                self.ends,
                self.site.edges_m,
                self.keep_m,
                self.site.keep_m,
                self.at_ends.radius_m if plain else 0.0,
                _HALF_TURN,
                longest_m,
            )
            for to in np.flatnonzero(np.isfinite(cost)):
                graph.add_edge(i, int(to), weight=float(cost[to]), kind=int(kinds[to]))
        return graph, True

    def word_of_leg(self, i: int, j: int, kind: int) -> Word:
        """Return the crossing word of a leg."""
        if not kind or not len(self.site.marks_m):
            return ()
        pieces = leg(self.nodes[i], self.nodes[j], kind, self.at_ends.radius_m)
        x, y, heading = (float(value) for value in self.nodes[i, :3])
        path = polyline(x, y, heading, pieces)
        path[-1] = self.nodes[j, :2]  # to the bit, so that the next leg starts where this one ends
        return crossing_word(path, self.site.marks_m)


def polyline(x: float, y: float, heading: float, pieces: FloatArray) -> FloatArray:
    """Return points (m, 2) along lines and arcs (n, 2), each chord at most 5° of an arc."""
    points = [(x, y)]
    for length, curvature in pieces:
        chords = max(1, math.ceil(abs(length * curvature) / _CHORD_RAD))
        for _ in range(chords if length > 0.0 else 0):
            x, y, heading = advance(x, y, heading, length / chords, curvature)
            points.append((x, y))
    return np.array(points)


def make_lattice(site: Site, radius_m: float, clothoid_m: float, corners: IntArray) -> Lattice:
    """Lay out the nodes for bends of `radius_m` round some of the site's corners."""
    at_ends = Bend(radius_m, clothoid_m)
    at_corners = Bend(max(radius_m, site.keep_m), clothoid_m)
    keep = site.keep_m + max(at_ends.shift_m, at_corners.shift_m)
    rows: list[FloatArray] = []
    touches: list[tuple[int, float, float, int]] = []  # corner, angle, slack, end

    def add(node: FloatArray, corner: int, angle: float, slack: float, end: int = 0) -> None:
        rows.append(node)
        touches.append((corner, angle, slack, end))

    lead, wide = at_ends.lead_m, at_ends.wide_m
    for side in (1.0, -1.0):
        pose = site.start
        add(_moved(pose.x_m, pose.y_m, pose.heading_rad, lead, side, wide), -1, 0.0, lead, 1)
    apart = _FINE_RAD if len(corners) <= _FEW_CORNERS else _COARSE_RAD
    for corner in corners.tolist():
        first, last = site.cone_rad[corner]
        for angle in np.linspace(first, last, math.ceil((last - first) / apart) + 1):
            for side in (1.0, -1.0):
                node = _round(site, at_corners, int(corner), float(angle), side)
                add(node, int(corner), float(angle), at_corners.lead_m)
    for node in _along_edges(site, keep, at_ends, set(site.corner_ring[corners].tolist())):
        add(node, -1, 0.0, lead)
    for side in (1.0, -1.0):
        pose = site.goal
        add(_moved(pose.x_m, pose.y_m, pose.heading_rad, -lead, side, wide), -1, 0.0, lead, 2)
    corner, angle, slack, ends = (np.array(column) for column in zip(*touches, strict=True))
    lattice = Lattice(
        site, np.array(rows), corner, angle, slack, ends.astype(np.int64), at_ends, at_corners
    )
    return _free(lattice)


def _moved(
    x: float, y: float, heading: float, ahead: float, side: float, radius: float
) -> FloatArray:
    return np.array(
        [x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading, side, radius]
    )


def _round(site: Site, bend: Bend, corner: int, angle: float, side: float) -> FloatArray:
    # the circle ρ touches the disc; the node lies on the wider circle about the same centre
    reach = site.keep_m + bend.shift_m
    x, y = site.corner_m[corner]
    return np.array(
        [
            x + reach * math.cos(angle),
            y + reach * math.sin(angle),
            angle + side * 0.5 * math.pi,
            side,
            bend.wide_m,
        ]
    )


def _along_edges(site: Site, keep: float, bend: Bend, rings: set[int]) -> list[FloatArray]:
    """Return nodes that graze edges, turning away from them, both ways."""
    nodes = []
    for ring in sorted(rings):
        corners = site.rings[ring]
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            length = float(np.hypot(*(b - a)))
            count = min(_MOST_TOUCHES, math.ceil(length / bend.radius_m))
            heading = math.atan2(b[1] - a[1], b[0] - a[0])
            out = np.array([math.sin(heading), -math.cos(heading)])  # right of the edge: outside
            for share in (np.arange(count) + 0.5) / count:
                x, y = a + share * (b - a) + keep * out
                nodes.append(np.array([x, y, heading, -1.0, bend.wide_m]))
                nodes.append(np.array([x, y, heading + math.pi, 1.0, bend.wide_m]))
    return nodes


def _free(lattice: Lattice) -> Lattice:
    """Drop the nodes that lie nearer to another obstacle than they may."""
    import shapely

    points = shapely.points(lattice.nodes[:, :2])
    tree = shapely.STRtree([shapely.Polygon(ring) for ring in lattice.site.rings])
    near = tree.query(points, predicate="dwithin", distance=lattice.keep_m - 1e-7)[0]
    free = np.ones(len(lattice.nodes), dtype=np.bool_)
    free[near] = False
    free |= lattice.ends > 0
    return Lattice(
        lattice.site,
        lattice.nodes[free],
        lattice.corner[free],
        lattice.angle[free],
        lattice.slack[free],
        lattice.ends[free],
        lattice.at_ends,
        lattice.at_corners,
    )
