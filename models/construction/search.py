"""Roads from start to goal: of every homotopy class the shortest, as arcs and with clothoids."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree

from models.construction.clothoids import join_pieces, with_clothoids
from models.construction.corners import Belt, Touch, belt_of_rows, pull, tighten
from models.construction.homotopy import Way, Word, crossing_word, ways_by_class
from models.construction.lattice import Lattice, make_lattice
from models.construction.reasons import why_none
from models.construction.site import Site
from models.construction.visibility import Visibility, see
from models.geometry import IntArray
from models.roads import Piece, Road, road_from_pieces

ARCS, CLOTHOIDS = "arcs", "clothoids"
_MOST_CORNERS = (
    64  # that a lattice is laid round; those nearest to the ways of the visibility graph
)
_SAME_M = 1e-3
_STEP_M = 0.1
# What checks allow for rounding in pieces added up, and for the chords of a sampled clothoid.
_SLIP_M = 1e-6


@dataclass(frozen=True, slots=True)
class BuiltRoad:
    """Hold one road: its pieces from the site's start, and what was measured of it.

    `clearance_m` is what its edges keep from the obstacles (infinite without any). `word` is its
    homotopy class. `least_radius_m` is what it was built for, `min_radius_m` what it has.
    """

    site: Site
    kind: str
    pieces: tuple[Piece, ...]
    word: Word
    least_radius_m: float
    width_m: float
    length_m: float
    min_radius_m: float
    clearance_m: float
    overlaps_itself: bool

    def road(self) -> Road:
        """Return it as a road in the world."""
        return road_from_pieces(self.pieces, width_m=self.width_m, start=self.site.start)


@dataclass(frozen=True, slots=True)
class Construction:
    """Hold the roads found, shortest first; where there are none, `reason` says why.

    `complete` is false where the time ran out. `ways` are the classes of the visibility graph,
    whose lengths no road of their class undercuts.
    """

    roads: tuple[BuiltRoad, ...]
    reason: str
    complete: bool
    ways: tuple[Way, ...]


def build_roads(
    site: Site,
    *,
    min_radius_m: float,
    width_m: float,
    radius_factors: tuple[float, ...] = (1.0,),
    kinds: tuple[str, ...] = (ARCS, CLOTHOIDS),
    clothoid_m: float | None = None,
    length_factor: float = 1.5,
    most_classes: int = 12,
    per_class: int = 1,
    time_limit_s: float = 60.0,
    progress: Callable[[str, float | None], None] = lambda _text, _fraction: None,
) -> Construction:
    """Find the roads of a site, per class, kind and radius the `per_class` shortest.

    Radii are `min_radius_m` times each of `radius_factors`. `clothoid_m` is the clothoids' length,
    by default a quarter of the radius. Classes beyond `length_factor` times the shortest road of
    their kind and radius, or beyond `most_classes`, are left out. Every road was checked: its end
    to a micrometre, its radius, its clearance.

    Raises:
        ValueError: for a radius that is not positive, a factor below 1, clothoids that turn a
            half circle or more.
    """
    _check(min_radius_m, radius_factors, length_factor, clothoid_m)
    deadline = time.monotonic() + time_limit_s
    progress("looking for ways round the obstacles", None)
    visibility = see(site, deadline=deadline)
    ways = visibility.ways(
        length_factor=length_factor, most_classes=most_classes, deadline=deadline
    )
    if not ways:
        late = time.monotonic() > deadline
        return Construction((), why_none(site, min_radius_m, width_m, late), not late, ())
    complete = visibility.complete
    cases: list[_Case] = []
    wanted = [(factor * min_radius_m, kind) for factor in radius_factors for kind in kinds]
    for n, (radius, kind) in enumerate(wanted):
        progress(f"bending roads of radius {radius:g} m, {kind}", n / len(wanted))
        # the rest of the time in equal parts: a late case must not starve
        until = time.monotonic() + max(0.0, deadline - time.monotonic()) / (len(wanted) - n)
        clothoid = 0.0 if kind == ARCS else clothoid_m or 0.25 * radius
        lattice = make_lattice(site, radius, clothoid, _corners(site, visibility, ways))
        case = _Case(lattice, [])
        complete &= case.search(ways[0].length_m, length_factor, most_classes, per_class, until)
        cases.append(case)
    _exchange(cases, visibility, ways, deadline)
    complete &= time.monotonic() <= deadline
    found = [case.roads(width_m, length_factor, most_classes, per_class) for case in cases]
    roads = sorted((road for part in found for road in part), key=lambda road: road.length_m)
    reason = "" if roads else why_none(site, min_radius_m, width_m, not complete)
    return Construction(tuple(roads), reason, complete, tuple(ways))


def _check(
    radius: float, factors: tuple[float, ...], length_factor: float, clothoid_m: float | None
) -> None:
    if not (math.isfinite(radius) and radius > 0.0):
        raise ValueError(f"min_radius_m must be finite and positive, got {radius}")
    for n, factor in enumerate(factors):
        if not (math.isfinite(factor) and factor >= 1.0):
            raise ValueError(f"radius_factors[{n}] must be at least 1, got {factor}")
    if not (math.isfinite(length_factor) and length_factor >= 1.0):
        raise ValueError(f"length_factor must be at least 1, got {length_factor}")
    if clothoid_m is not None and not 0.0 < clothoid_m < math.pi * radius:
        raise ValueError(
            f"clothoid_m must lie in (0, {math.pi * radius:g}), a half turn of min_radius_m, "
            f"got {clothoid_m}"
        )


@dataclass(frozen=True, slots=True)
class _Case:
    """Hold one radius and kind of bend, and the belts found for it."""

    lattice: Lattice
    belts: list[Belt]

    def search(
        self,
        shortest_m: float,
        length_factor: float,
        most_classes: int,
        per_class: int,
        deadline: float,
    ) -> bool:
        """Find belts through the lattice; return whether there was time for all."""
        lattice, n = self.lattice, len(self.lattice.nodes)
        reach = length_factor * (shortest_m + 4.0 * math.pi * lattice.at_ends.radius_m)
        graph, complete = lattice.legs(reach, deadline)
        words: dict[tuple[int, int], Word] = {}

        def word_of(i: int, j: int) -> Word:
            if max(i, j) >= n:
                return ()
            if (i, j) not in words:
                words[i, j] = lattice.word_of_leg(i, j, graph[i][j]["kind"])
            return words[i, j]

        for way in ways_by_class(
            graph,
            n,
            n + 1,
            word_of,
            length_factor=length_factor,
            most_classes=most_classes,
            per_class=per_class,
            deadline=deadline,
        ):
            rows = way.nodes[1:-1]
            kinds = [graph[i][j]["kind"] for i, j in itertools.pairwise(rows)]
            self.belts.append(tighten(belt_of_rows(lattice, rows, kinds, way.word)))
            if time.monotonic() > deadline:
                break
        return complete and time.monotonic() <= deadline

    def roads(
        self, width_m: float, length_factor: float, most_classes: int, per_class: int
    ) -> list[BuiltRoad]:
        """Return the belts as checked roads, the shortest of each class."""
        roads: list[BuiltRoad] = []
        for belt in sorted(self.belts, key=lambda belt: belt.length_m):
            if sum(road.word == belt.word for road in roads) < per_class:
                road = _road(belt, width_m)
                if road is not None and not _known(road, roads):
                    roads.append(road)
        longest = length_factor * min((road.length_m for road in roads), default=0.0)
        return [road for road in roads if road.length_m <= longest][: most_classes * per_class]


def _exchange(cases: list[_Case], visibility: Visibility, ways: list[Way], deadline: float) -> None:
    """Pull every case tight round the corners of the visibility graph's ways and of all belts."""
    hints: dict[tuple[Word, tuple[Touch, ...]], None] = {}
    for way in ways:
        hints[way.word, tuple(_touches(visibility, way))] = None
    for case in cases:
        for belt in case.belts:
            hints[belt.word, tuple(belt.touches())] = None
    for word, touches in hints:
        for case in cases:
            if time.monotonic() > deadline:
                return
            pulled = pull(case.lattice, touches, word)
            if pulled is not None:
                case.belts.append(pulled)


def _touches(visibility: Visibility, way: Way) -> list[Touch]:
    """Return the corners that a way of the visibility graph goes round, and on which side."""
    points = visibility.points_m[list(way.nodes)]
    steps = np.diff(points, axis=0)
    turns = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
    found: list[Touch] = []
    for node, turn in zip(way.nodes[1:-1], turns, strict=True):
        touch = (int(visibility.corner[node]), 1.0 if turn > 0.0 else -1.0)
        if not found or found[-1] != touch:
            found.append(touch)
    return found


def _corners(site: Site, visibility: Visibility, ways: list[Way]) -> IntArray:
    corners = np.arange(len(site.corner_m))
    if len(corners) <= _MOST_CORNERS:
        return corners
    lines = shapely.union_all(
        [shapely.LineString(visibility.points_m[list(way.nodes)]) for way in ways]
    )
    distance = shapely.distance(shapely.points(site.corner_m), lines)
    return np.sort(np.argsort(distance, kind="stable")[:_MOST_CORNERS])


def _road(belt: Belt, width_m: float) -> BuiltRoad | None:
    """Turn a belt into a road, and check it; None if a check fails."""
    lattice, site = belt.lattice, belt.lattice.site
    radius, clothoid = lattice.at_ends.radius_m, lattice.at_ends.clothoid_m
    lead = lattice.at_ends.lead_m
    joined = join_pieces([(lead, 0.0), *belt.pieces(), (lead, 0.0)])
    pieces: tuple[Piece, ...] | None = tuple(Piece(length, k, k) for length, k in joined)
    if clothoid:
        pieces = with_clothoids(joined, (lattice.at_ends, lattice.at_corners))
    if not pieces:
        return None
    road = road_from_pieces(pieces, width_m=width_m, start=site.start)
    end = road.evaluate([road.length_m])
    miss = math.hypot(end.x_m[0] - site.goal.x_m, end.y_m[0] - site.goal.y_m)
    turn = abs(math.remainder(float(end.heading_rad[0]) - site.goal.heading_rad, math.tau))
    points = road.sample(_STEP_M).xy
    line = shapely.LineString(points)
    kept = math.inf
    if len(site.edges_m):
        edges = shapely.multilinestrings(site.edges_m.reshape(-1, 2, 2))
        # a chord lies within κ h²/8 of its arc
        kept = float(shapely.distance(line, edges)) - _STEP_M**2 / (8.0 * road.min_radius_m)
    good = (
        miss <= _SLIP_M
        and turn <= _SLIP_M
        and road.min_radius_m >= radius * (1.0 - 1e-9)
        and kept >= site.keep_m - _STEP_M**2 / (4.0 * radius) - _SLIP_M
    )
    if not good or crossing_word(points, site.marks_m) != belt.word:
        return None
    return BuiltRoad(
        site=site,
        kind=CLOTHOIDS if clothoid else ARCS,
        pieces=pieces,
        word=belt.word,
        least_radius_m=radius,
        width_m=width_m,
        length_m=road.length_m,
        min_radius_m=road.min_radius_m,
        clearance_m=kept - 0.5 * width_m,
        overlaps_itself=_overlaps(road, width_m),
    )


def _overlaps(road: Road, width_m: float) -> bool:
    """Return whether the road's surface meets itself: nearer than its width, twice that along it.

    Along one bend of radius R > 0.53 widths, no two points are.
    """
    points = road.sample(min(1.0, 0.25 * width_m))
    pairs = cKDTree(points.xy).query_pairs(width_m, output_type="ndarray")
    return bool(np.any(np.abs(points.s_m[pairs[:, 0]] - points.s_m[pairs[:, 1]]) > 2.0 * width_m))


def _known(road: BuiltRoad, roads: list[BuiltRoad]) -> bool:
    return any(
        other.word == road.word and abs(other.length_m - road.length_m) < _SAME_M for other in roads
    )
