"""Lanes of an OpenDRIVE road as curves: the middle of each lane that runs the whole road."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.files.opendrive.records import LaneRecord, RoadRecord, Section
from models.geometry import FloatArray, Pose
from models.network import Lane
from models.parametric import ArcLengthCurve, Cubics, OffsetPath, PlanePath, ReversedPath
from models.roads import Road

_WIDTH_STEP_M = 2.0  # widths are read this often, and at every break
_BRIDGE_M = 20.0  # a line that must change lanes does so over this length
_LEAST_WIDTH_M = 0.5
_CLOSED_M, _CLOSED_RAD = 1e-4, 1e-4  # a reference line that ends like this where it began


@dataclass(frozen=True, slots=True)
class Carriageway:
    """One direction of a road: its lanes, rightmost first, and the ids that they start and end as.

    `first` and `last` (lanes,) are lane ids in traffic's direction: at the end where cars come in,
    and where they leave.
    """

    backward: bool
    lanes: tuple[Lane, ...]
    first: tuple[int, ...]
    last: tuple[int, ...]
    width_m: float
    speed_mps: float


def carriageways(road: RoadRecord, ignored: Counter[str]) -> list[Carriageway]:
    """Return the directions in which cars may use the road, forward first.

    Lanes that fold, because a bend is tighter than they are far from its reference line, are left
    out and counted.
    """
    found = []
    for backward in (False, True):
        chains = _chains(road, backward)
        way = _carriageway(road, chains, backward, ignored) if chains else None
        if way is not None:
            found.append(way)
    return found


def whole_road(road: RoadRecord) -> Road:
    """Return the reference line as a road between the outermost driven lanes' edges.

    It is closed if it ends where and as it starts.
    """
    s = _places(road.line.breaks, road)
    left, right = np.zeros_like(s), np.zeros_like(s)
    for section in road.sections:
        rows = (s >= section.s_m) & (s <= section.end_m)
        for lane in section.lanes.values():
            if lane.driven:
                outer = _border(road, section, lane.id)(s[rows])
                inner = 2.0 * _middle(road, section, lane.id)(s[rows]) - outer
                left[rows] = np.max([left[rows], outer, inner], axis=0)
                right[rows] = np.max([right[rows], -outer, -inner], axis=0)
    if not (left.max() > 0.0 or right.max() > 0.0):
        left[:] = right[:] = 1.5
    curve = ArcLengthCurve(road.line)
    origin = road.line.origin
    frame, places = Pose(float(origin[0]), float(origin[1])), curve.arc_length(s)
    ends = curve.evaluate(np.array([0.0, curve.length_m]))
    gap = max(abs(float(np.diff(ends.x_m)[0])), abs(float(np.diff(ends.y_m)[0])))
    turn = abs(math.remainder(float(np.diff(ends.heading_rad)[0]), math.tau))
    if gap < _CLOSED_M and turn < _CLOSED_RAD:
        return Road(curve, True, frame, places[:-1], left[:-1], right[:-1])
    return Road(curve, False, frame, places, left, right)


def _border(road: RoadRecord, section: Section, lane: int) -> Cubics:
    """Add widths from the middle out, or take a border as it is."""
    side = 1 if lane > 0 else -1
    total = road.offset
    for each in range(side, lane + side, side):
        record = section.lanes.get(each)
        if record is None:
            continue
        if record.is_border:
            total = road.offset + record.width
        else:
            total = total + record.width.scaled(float(side))
    return total


def _middle(road: RoadRecord, section: Section, lane: int) -> Cubics:
    inner = _border(road, section, lane - (1 if lane > 0 else -1)) if abs(lane) > 1 else road.offset
    return (inner + _border(road, section, lane)).scaled(0.5)


def _runs(road: RoadRecord, lane: LaneRecord, backward: bool) -> bool:
    """Say whether cars use a lane in this direction."""
    if not lane.driven:
        return False
    if lane.direction == "both" or lane.kind == "bidirectional":
        return True
    with_road = (lane.id < 0) != road.left_hand
    if lane.direction == "reversed":
        with_road = not with_road
    return with_road != backward


def _chains(road: RoadRecord, backward: bool) -> list[list[tuple[Section, int]]]:
    """Follow lanes from the road's start to its end by their links; nearest the middle first.

    A road with lanes none of which runs through gets one line, which changes lanes where it must.
    """
    sections = _of_side(road, backward)
    if not sections:
        return []
    alive = [[(sections[0], lane)] for lane in _usable(road, sections[0], backward)]
    for section in sections[1:]:
        for chain in alive:
            lane = _onward(road, chain[-1], section, backward)
            if lane is not None and all(other[-1] != (section, lane) for other in alive):
                chain.append((section, lane))
        reached = [chain for chain in alive if chain[-1][0] is section]
        if not reached:
            return [_nearest_chain(road, sections, backward)]
        alive = reached
    return alive


def _of_side(road: RoadRecord, backward: bool) -> list[Section]:
    """Return the sections that hold lanes of this direction; the rest of the road has none."""
    sections: list[Section] = []
    for section in road.sections:
        if _usable(road, section, backward):
            sections.append(section)
        elif section.single_side and sections:  # the other side's: ours goes on as before
            last = sections[-1]
            sections[-1] = Section(last.s_m, section.end_m, last.lanes, last.single_side)
        elif sections:
            return []  # a carriageway that ends on the way leads nowhere
        else:
            return []
    return sections


def _usable(road: RoadRecord, section: Section, backward: bool) -> list[int]:
    lanes = [lane.id for lane in section.lanes.values() if _runs(road, lane, backward)]
    return sorted(lanes, key=lambda lane: (abs(lane), lane))


def _onward(
    road: RoadRecord, at: tuple[Section, int], section: Section, backward: bool
) -> int | None:
    """Return the lane that continues another one: by link, either way, or by the same id."""
    before, lane = at
    usable = _usable(road, section, backward)
    linked = before.lanes[lane].successor
    if linked is not None:
        return linked if linked in usable else None
    claimed = [each for each in usable if section.lanes[each].predecessor == lane]
    if claimed:
        return claimed[0]
    free = all(section.lanes[each].predecessor is None for each in usable)
    return lane if lane in usable and free else None


def _nearest_chain(
    road: RoadRecord, sections: Sequence[Section], backward: bool
) -> list[tuple[Section, int]]:
    chain = [(sections[0], _usable(road, sections[0], backward)[0])]
    for section in sections[1:]:
        at = np.array([section.s_m])
        here = _middle(road, *chain[-1])(at)
        usable = _usable(road, section, backward)
        miss = [abs((_middle(road, section, lane)(at) - here)[0]) for lane in usable]
        chain.append((section, usable[int(np.argmin(miss))]))
    return chain


def _carriageway(
    road: RoadRecord,
    chains: list[list[tuple[Section, int]]],
    backward: bool,
    ignored: Counter[str],
) -> Carriageway | None:
    """Make the lanes of one direction, in the order right to left as drivers see it."""
    s = _places(road.line.breaks, road)
    low, high = _edges(road, s, backward)
    made: list[tuple[float, Lane, int, int]] = []
    for chain in chains:
        middle = _joined(road, chain)
        path: PlanePath = OffsetPath(road.line, middle)
        # The base counts s from the road's own start, so widths are asked for at the same s.
        offsets = middle(s)
        left, right = high - offsets, offsets - low
        first, last = chain[0][1], chain[-1][1]
        if backward:
            path = ReversedPath(path)
            left, right, first, last = right[::-1], left[::-1], last, first
        try:
            curve = ArcLengthCurve(path)
        except ValueError:
            ignored["lanes that fold in a bend"] += 1
            continue
        along = curve.arc_length((s[-1] - s)[::-1] if backward else s)
        x, y = (curve.start_m + road.line.origin).tolist()
        edges = (np.maximum(left, 0.0), np.maximum(right, 0.0))
        lane = Lane(
            left_m=float(np.median(edges[0])),
            right_m=float(np.median(edges[1])),
            made=Road(curve, False, Pose(x, y), along, *edges),
        )
        side = float(np.median(offsets)) * (-1.0 if backward else 1.0)
        made.append((side, lane, first, last))
    if not made:
        return None
    made.sort(key=lambda row: row[0])
    speeds = [section.lanes[lane].speed_mps for chain in chains for section, lane in chain]
    limits = [speed for speed in speeds if speed is not None]
    return Carriageway(
        backward=backward,
        lanes=tuple(row[1] for row in made),
        first=tuple(row[2] for row in made),
        last=tuple(row[3] for row in made),
        width_m=float(np.median(high - low)),
        speed_mps=max(limits) if limits else road.speed_mps,
    )


def _joined(road: RoadRecord, chain: list[tuple[Section, int]]) -> Cubics:
    """Join the middles of a chain's lanes; where they would jump by a lane, slide over before."""
    whole: Cubics | None = None
    for section, lane in chain:
        part = _middle(road, section, lane).within(section.s_m, section.end_m)
        if whole is None:
            whole = part
            continue
        at = np.array([section.s_m])
        (before, _, _), (after, slope_after, _) = whole.derivatives(at), part.derivatives(at)
        if abs(after[0] - before[0]) > 0.05:
            begin = max(float(whole.start[0]), section.s_m - _BRIDGE_M)
            start = whole.derivatives(np.array([begin]))
            bridge = _hermite(
                begin,
                section.s_m,
                (float(start[0][0]), float(start[1][0]), float(after[0]), float(slope_after[0])),
            )
            whole = whole.then(bridge)
        whole = whole.then(part)
    if whole is None:
        raise ValueError("a chain of lanes must not be empty")
    return whole


def _hermite(low: float, high: float, ends: tuple[float, float, float, float]) -> Cubics:
    """Return the cubic with these values and slopes at both ends."""
    y0, m0, y1, m1 = ends
    h = high - low
    c = (3.0 * (y1 - y0) / h - 2.0 * m0 - m1) / h
    d = (m0 + m1 - 2.0 * (y1 - y0) / h) / (h * h)
    return Cubics(np.array([low]), np.array([[y0, m0, c, d]]))


def _edges(road: RoadRecord, s: FloatArray, backward: bool) -> tuple[FloatArray, FloatArray]:
    """Return the carriageway's edges at s (t,), to the left of the reference line: low, high."""
    low, high = np.zeros_like(s), np.zeros_like(s)
    for section in _of_side(road, backward):
        rows = (s >= section.s_m) & (s <= section.end_m)
        borders: list[FloatArray] = []
        for lane in _usable(road, section, backward):
            outer = _border(road, section, lane)(s[rows])
            borders += [outer, 2.0 * _middle(road, section, lane)(s[rows]) - outer]
        low[rows], high[rows] = np.min(borders, axis=0), np.max(borders, axis=0)
    narrow = high - low < _LEAST_WIDTH_M
    middle = 0.5 * (low + high)
    low[narrow] = middle[narrow] - 0.5 * _LEAST_WIDTH_M
    high[narrow] = middle[narrow] + 0.5 * _LEAST_WIDTH_M
    return low, high


def _places(breaks: FloatArray, road: RoadRecord) -> FloatArray:
    """Return values of s (t,) at which widths are read: every 2 m, and where anything changes."""
    low, high = float(breaks[0]), float(breaks[-1])
    n = max(2, int(np.ceil((high - low) / _WIDTH_STEP_M)))
    starts = [np.linspace(low, high, n + 1), road.offset.start]
    starts += [np.array([section.s_m]) for section in road.sections]
    places = np.unique(np.concatenate(starts))
    inside = places[(places >= low) & (places <= high)]
    keep = np.concatenate(([True], np.diff(inside) > 1e-6))
    keep[-1] = True
    if len(inside) > 2 and inside[-1] - inside[-2] <= 1e-6:
        keep[-2] = False
    return inside[keep]
