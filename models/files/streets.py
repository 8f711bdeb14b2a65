"""From street lines that share nodes to a network: lanes beside each line, turns at nodes."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from models.geometry import FloatArray, wrap_angle
from models.network import Edge, Lane, RoadNetwork, Turn
from models.polyline import (
    cut_polyline,
    distinct_points,
    eased,
    end_headings,
    offset_polyline,
    polyline_length,
)

_LEAST_LENGTH_M = 0.1
_CLEAR_M = 3.0  # a lane ends this far before the surface of the street it meets
_CONTINUES_M = 2.0  # ... or here where just one other street goes on
_MOST_CUT = 0.4  # of the street's length
_STRAIGHT_RAD = math.radians(35.0)


@dataclass(frozen=True, slots=True)
class Street:
    """One street line: nodes and their places (n, 2), lanes each way, `width_m` edge to edge.

    Streets meet where they share nodes. With `shared`, both directions use the whole width.
    """

    name: str
    nodes: tuple[Hashable, ...]
    points_m: FloatArray = field(repr=False)
    forward: int = 1
    backward: int = 1
    width_m: float = 6.0
    speed_mps: float = 50.0 / 3.6
    kind: str = ""
    shared: bool = False

    def turned(self) -> Street:
        """Return the same street, listed from its other end."""
        return replace(
            self,
            nodes=self.nodes[::-1],
            points_m=self.points_m[::-1],
            forward=self.backward,
            backward=self.forward,
        )

    def like(self, other: Street) -> bool:
        """Say whether one could go on as the other."""
        keys = ("forward", "backward", "width_m", "speed_mps", "kind", "shared")
        return all(getattr(self, key) == getattr(other, key) for key in keys)


@dataclass(frozen=True, slots=True)
class _Segment:
    """A street between junctions; the names of the streets at its two ends."""

    street: Street
    first: str
    last: str


# Says whether one may drive from a street through a node to a street: names and the node.
Permission = Callable[[str, Hashable, str], bool]


def network_of_streets(
    streets: Iterable[Street],
    ignored: Counter[str],
    may_turn: Permission = lambda _from, _node, _to: True,
) -> RoadNetwork:
    """Cut streets where they meet, and lay lanes and turns; traffic keeps to the right.

    Streets that go on alike through a node where no third one meets are one edge. Lanes end short
    of a junction, by the half width of the widest street there and 3 m more, and turns lead
    from end to end round the corner. One turns back only where nothing else is possible.
    """
    segments = _merged(_cut(list(streets), ignored), may_turn)
    at: dict[Hashable, list[tuple[int, bool]]] = defaultdict(list)
    for i, segment in enumerate(segments):
        at[segment.street.nodes[0]].append((i, True))
        at[segment.street.nodes[-1]].append((i, False))
    names = {node: f"n{k}" if isinstance(node, tuple) else str(node) for k, node in enumerate(at)}
    edges: list[Edge] = []
    owner: list[tuple[int, bool]] = []  # of each edge: its segment, and whether backward
    used: Counter[str] = Counter()
    for i, segment in enumerate(segments):
        street = segment.street
        cuts = [_set_back(segments, at[node], i) for node in (street.nodes[0], street.nodes[-1])]
        used[street.name] += 1
        name = street.name if used[street.name] == 1 else f"{street.name}#{used[street.name]}"
        for backward in (False, True):
            lanes = street.backward if backward else street.forward
            if lanes == 0:
                continue
            driven = street.turned() if backward else street
            owner.append((i, backward))
            edges.append(
                Edge(
                    name=f"-{name}" if backward else name,
                    start=names[driven.nodes[0]],
                    end=names[driven.nodes[-1]],
                    lanes=_lanes(driven, cuts[::-1] if backward else cuts),
                    speed_mps=street.speed_mps,
                    width_m=_lane_width(street) * lanes,
                    street=name,
                    kind=street.kind,
                    stated_length_m=polyline_length(street.points_m),
                )
            )
    places = {
        names[node]: tuple(segments[ends[0][0]].street.points_m[0 if ends[0][1] else -1].tolist())
        for node, ends in at.items()
    }
    return RoadNetwork(
        edges=tuple(edges),
        turns=tuple(_turns(edges, owner, segments, may_turn)),
        nodes=places,
    )


def _cut(streets: Sequence[Street], ignored: Counter[str]) -> list[_Segment]:
    """Split streets at nodes that are used more than once, and drop what has no length."""
    uses: Counter[Hashable] = Counter()
    for street in streets:
        uses.update(street.nodes)
        uses.update((street.nodes[0], street.nodes[-1]))  # an end that touches a middle cuts it
    segments = []
    for street in streets:
        begin = 0
        for k in range(1, len(street.nodes)):
            last = k == len(street.nodes) - 1
            if not last and uses[street.nodes[k]] == 1:
                continue
            part = replace(
                street, nodes=street.nodes[begin : k + 1], points_m=street.points_m[begin : k + 1]
            )
            begin = k
            if polyline_length(part.points_m) < _LEAST_LENGTH_M:
                ignored["streets without length"] += 1
                continue
            segments.append(_Segment(part, street.name, street.name))
    return segments


def _merged(segments: list[_Segment], may_turn: Permission) -> list[_Segment]:
    """Join pairs that go on alike through a node of their own."""
    at: dict[Hashable, set[int]] = defaultdict(set)
    ends: Counter[Hashable] = Counter()
    alive = dict(enumerate(segments))
    for i, segment in alive.items():
        for node in (segment.street.nodes[0], segment.street.nodes[-1]):
            at[node].add(i)
            ends[node] += 1
    for node in list(at):
        if ends[node] != 2 or len(at[node]) != 2:
            continue
        i, j = sorted(at[node])
        a = alive[i] if alive[i].street.nodes[-1] == node else _turned(alive[i])
        b = alive[j] if alive[j].street.nodes[0] == node else _turned(alive[j])
        allowed = may_turn(a.last, node, b.first) and may_turn(b.first, node, a.last)
        if not a.street.like(b.street) or not allowed:
            continue
        joined = replace(
            a.street,
            nodes=a.street.nodes + b.street.nodes[1:],
            points_m=np.vstack((a.street.points_m, b.street.points_m[1:])),
        )
        alive[i] = _Segment(joined, a.first, b.last)
        del alive[j], at[node]
        other = joined.nodes[-1]
        if j in at[other]:
            at[other].remove(j)
            at[other].add(i)
    return list(alive.values())


def _turned(segment: _Segment) -> _Segment:
    return _Segment(segment.street.turned(), segment.last, segment.first)


def _set_back(segments: list[_Segment], ends: list[tuple[int, bool]], own: int) -> float:
    """Return how far before a node the lanes of segment `own` end."""
    others = [segments[i].street for i, _ in ends if i != own]
    if not others:
        return 0.0
    if len(ends) == 2:
        return _CONTINUES_M
    return 0.5 * max(street.width_m for street in others) + _CLEAR_M


def _lane_width(street: Street) -> float:
    lanes = max(street.forward, street.backward) if street.shared else (
        street.forward + street.backward
    )  # fmt: skip
    return street.width_m / lanes


def _lanes(street: Street, cuts: Sequence[float]) -> tuple[Lane, ...]:
    """Lay the forward lanes beside a street's line, rightmost first."""
    points = distinct_points(street.points_m)
    length = polyline_length(points)
    start, end = (min(cut, _MOST_CUT * length) for cut in cuts)
    if start > 0.0 or end > 0.0:
        points = cut_polyline(points, start, length - end)
    width = _lane_width(street)
    made = []
    for k in range(street.forward):
        beside = -0.5 * street.width_m + width * (k + 0.5)
        shape = points if abs(beside) < 1e-9 else offset_polyline(points, beside)
        made.append(Lane(shape, width * (street.forward - k - 0.5), width * (k + 0.5)))
    return tuple(made)


def _turns(
    edges: list[Edge], owner: list[tuple[int, bool]], segments: list[_Segment], may: Permission
) -> list[Turn]:
    leaving: dict[str, list[int]] = defaultdict(list)
    for index, edge in enumerate(edges):
        leaving[edge.start].append(index)
    turns = []
    for a, edge in enumerate(edges):
        segment, backward = owner[a]
        street = segments[segment]
        node = street.street.nodes[0 if backward else -1]
        name = street.first if backward else street.last
        back = [b for b in leaving[edge.end] if owner[b] == (segment, not backward)]
        onward = []
        for b in leaving[edge.end]:
            other, their_back = owner[b]
            to = segments[other].last if their_back else segments[other].first
            if b not in back and may(name, node, to):
                onward.append(b)
        for b in onward or back:
            turns += _lane_turns(edges, a, b)
    return turns


def _lane_turns(edges: list[Edge], a: int, b: int) -> list[Turn]:
    """Connect the lanes of two edges: straight on by order, to the right from the right."""
    start, end = edges[a].lanes, edges[b].lanes
    turn = wrap_angle(_heading(end[0], 0) - _heading(start[0], -1))
    if abs(turn) <= _STRAIGHT_RAD:
        pairs = [(min(k, len(start) - 1), min(k, len(end) - 1))
                 for k in range(max(len(start), len(end)))]  # fmt: skip
    elif turn < 0.0:
        pairs = [(0, 0)]
    else:
        pairs = [(len(start) - 1, len(end) - 1)]
    return [Turn(a, b, i, j, _corner(start[i], end[j])) for i, j in pairs]


def _heading(lane: Lane, at: int) -> float:
    return end_headings(lane.outline)[at]


def _corner(a: Lane, b: Lane) -> Lane | None:
    """Lead from one lane's end to another's start by way of where their directions cross."""
    p, q = a.outline[-1], b.outline[0]
    gap = q - p
    distance = math.hypot(*gap)
    if distance < _LEAST_LENGTH_M:
        return None
    angles = _heading(a, -1), _heading(b, 0)
    u, v = (np.array([math.cos(angle), math.sin(angle)]) for angle in angles)
    cross = float(u[0] * v[1] - u[1] * v[0])
    half = 0.5 * min(a.right_m + a.left_m, b.right_m + b.left_m, 4.0)
    points = list(eased(np.array([p, q]), *angles))
    if abs(cross) > 0.1:
        along = (gap[0] * v[1] - gap[1] * v[0]) / cross
        back = (gap[0] * u[1] - gap[1] * u[0]) / cross
        if 0.0 < along < 4.0 * distance and 0.0 < -back < 4.0 * distance:
            points = [p, p + along * u, q]
        elif float(u @ v) < 0.0:
            points = [p, p + half * u, q - half * v, q]
    elif float(u @ v) < 0.0:  # back the way one came: round in half a circle
        points = [p, p + 0.5 * distance * u, q - 0.5 * distance * v, q]
    return Lane(np.array(points), half, half)
