"""From an OpenDRIVE file to a network: links join roads, connecting roads are turns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from models.chain import chain_roads
from models.files.opendrive.buildings import read_buildings
from models.files.opendrive.lanes import Carriageway, carriageways, whole_road
from models.files.opendrive.records import End, RoadRecord, number, read_road
from models.files.xml import stream_elements
from models.geometry import Pose
from models.georeference import Georeference, parse_crs
from models.network import Edge, Lane, RoadNetwork, Turn

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_START, _END = "start", "end"
_MOST_CONNECTING = 8
Key = tuple[str, bool]  # a road's id and whether it is driven backwards


@dataclass(slots=True)
class _Junction:
    """A junction's connections: incoming road, connecting road, contact point, lane links."""

    kind: str
    connections: list[tuple[str, str, str, list[tuple[int, int]]]]


@dataclass(slots=True)
class _Found:
    """What one pass over the file gathers."""

    roads: dict[str, RoadRecord] = field(default_factory=dict)
    junctions: dict[str, _Junction] = field(default_factory=dict)
    ways: dict[Key, Carriageway] = field(default_factory=dict)
    place: dict[Key, int] = field(default_factory=dict)  # in the network's edges
    ignored: Counter[str] = field(default_factory=Counter)


def read_opendrive(path: str | Path) -> RoadNetwork:
    """Read a file of ASAM OpenDRIVE 1.4–1.8.

    Each road gives an edge for each direction that cars may drive in, whose lanes are the middles
    of those lanes that run through it. Roads of a junction give turns. Heights are ignored: the
    ground is flat. Buildings come from objects of that type. A file with one road has it as
    `centreline`: its reference line between the outermost driven lanes' edges.

    Raises:
        ValueError: one line that names the file, the road and what is wrong.
    """
    path = Path(path)
    found = _Found()
    georeference = Georeference()
    for element in stream_elements(path, "OpenDRIVE"):
        if element.tag == "header":
            georeference = _georeference(element, path, found.ignored)
        elif element.tag == "road":
            where = f"{path}: road {element.get('id', '')[:40]!r}"
            road = read_road(element, where, found.ignored)
            if road is not None and road.id in found.roads:
                raise ValueError(f"{where}: id must differ from the others")
            if road is not None:
                found.roads[road.id] = road
        elif element.tag == "junction":
            _read_junction(element, found)
    if not found.roads:
        raise ValueError(f"{path}: must hold at least one road")
    nodes = _name_ends(found)
    edges = _edges(found, nodes)
    if not edges:
        raise ValueError(f"{path}: must hold at least one road with a driving lane from end to end")
    places: dict[str, tuple[float, float]] = {}
    for edge in edges:
        for name, at in ((edge.start, 0.0), (edge.end, edge.length_m)):
            x, y = edge.road.evaluate([at]).xy[0].tolist()
            places.setdefault(name, (x, y))
    roads = list(found.roads.values())
    return RoadNetwork(
        edges=tuple(edges),
        turns=tuple(_turns(found)),
        nodes=places,
        obstacles=read_buildings(roads, str(path), found.ignored),
        georeference=georeference,
        ignored={what: count for what, count in found.ignored.items() if count},
        source="OpenDRIVE",
        centreline=whole_road(roads[0]) if len(roads) == 1 else None,
        notes=(_joints(roads),),
    )


def _joints(roads: list[RoadRecord]) -> str:
    """Say how well the pieces of reference lines meet."""
    joints = [road.line.joints() for road in roads]
    gap = max(float(each.gap_m.max(initial=0.0)) for each in joints)
    turn = max(float(each.turn_rad.max(initial=0.0)) for each in joints)
    count = sum(len(each.gap_m) for each in joints)
    return f"{count} joints of reference lines close to {gap:.1e} m and {turn:.1e} rad"


def _georeference(element: Element, path: Path, ignored: Counter[str]) -> Georeference:
    text = (element.findtext("geoReference") or "").strip()
    crs = None
    if text:
        try:
            parse_crs(text, f"{path}: header geoReference")
            crs = text
        except ValueError:
            ignored["geoReference that PROJ does not know"] += 1
    offset = element.find("offset")
    pose = Pose()
    if offset is not None:
        pose = Pose(*(number(offset, key, f"{path}: header", 0.0) for key in ("x", "y", "hdg")))
    return Georeference(crs, crs, pose)


def _read_junction(element: Element, found: _Found) -> None:
    connections = []
    kind = element.get("type", "default")
    for each in element.findall("connection"):
        links = []
        for link in each.findall("laneLink"):
            try:
                links.append((int(link.get("from", "")), int(link.get("to", ""))))
            except ValueError:
                found.ignored["lane links without ids"] += 1
        other = each.get("connectingRoad") or each.get("linkedRoad") or ""
        contact = each.get("contactPoint", _START)
        connections.append((each.get("incomingRoad", ""), other, contact, links))
    if kind in ("virtual", "crossing"):
        found.ignored[f"junctions of type {kind}"] += 1
        return
    found.junctions[element.get("id", "")] = _Junction(kind, connections)


def _name_ends(found: _Found) -> dict[tuple[str, str], str]:
    """Give each road's start and end a node: ends that are linked share one, junctions are one."""
    parent: dict[str, str] = {}

    def root(name: str) -> str:
        parent.setdefault(name, name)
        while parent[name] != name:
            parent[name] = parent[parent[name]]
            name = parent[name]
        return name

    def of(road: str, contact: str) -> str:
        return f"{road}:{contact}"

    for road in found.roads.values():
        for end, contact in ((road.before, _START), (road.after, _END)):
            here = of(road.id, contact)
            if end.kind == "junction" and end.element in found.junctions:
                parent[root(here)] = root(f"junction:{end.element}")
            elif end.kind == "road" and end.element in found.roads and end.contact:
                parent[root(here)] = root(of(end.element, end.contact))
        if road.junction in found.junctions:
            for contact in (_START, _END):
                parent[root(of(road.id, contact))] = root(f"junction:{road.junction}")
    return {
        (road, contact): root(of(road, contact))
        for road in found.roads
        for contact in (_START, _END)
    }


def _edges(found: _Found, nodes: dict[tuple[str, str], str]) -> list[Edge]:
    """Make each direction of each road; those of junctions become turns, not edges."""
    edges: list[Edge] = []
    for road in found.roads.values():
        ways = carriageways(road, found.ignored)
        if not ways:
            found.ignored["roads without driving lanes from end to end"] += 1
        for way in ways:
            key = (road.id, way.backward)
            found.ways[key] = way
            if road.junction in found.junctions:
                continue
            ends = nodes[road.id, _START], nodes[road.id, _END]
            found.place[key] = len(edges)
            edges.append(
                Edge(
                    name=f"{road.id}{'-' if way.backward else '+'}",
                    start=ends[way.backward],
                    end=ends[not way.backward],
                    lanes=way.lanes,
                    speed_mps=way.speed_mps,
                    width_m=way.width_m,
                    street=road.id,
                    kind=road.kind,
                    stated_length_m=road.end_m - float(road.line.breaks[0]),
                )
            )
    if not edges and found.ways:  # nothing but a junction's roads: then they are the network
        found.junctions.clear()
        return _edges(found, nodes)
    return edges


def _turns(found: _Found) -> list[Turn]:
    turns: dict[Turn, None] = {}
    for key, index in found.place.items():
        road = found.roads[key[0]]
        end = road.before if key[1] else road.after
        if end.kind == "junction":
            for turn in _through_junction(found, key, index, end.element):
                turns[turn] = None
        elif end.kind == "road":
            for turn in _straight_on(found, key, index, end):
                turns[turn] = None
    return list(turns)


def _straight_on(found: _Found, key: Key, index: int, end: End) -> Iterator[Turn]:
    """Yield the turns from a road to the one that its end is linked with."""
    onward = _entered(found, end.element, end.contact)
    if onward is None or onward not in found.place:
        return
    for lane, id_ in enumerate(found.ways[key].last):
        for other in _linked_lanes(found, key, id_, onward):
            yield Turn(index, found.place[onward], lane, other)


def _through_junction(found: _Found, key: Key, index: int, junction: str) -> Iterator[Turn]:
    """Yield the turns through each connecting road that starts from this road."""
    for lane, entered, on in _connected(found, key, junction):
        if entered in found.place:  # a direct junction: the linked road itself
            yield Turn(index, found.place[entered], lane, on)
            continue
        path = (found.ways[entered].lanes[on],)
        for to_edge, to_lane, through in _onward(found, entered, on, path):
            yield Turn(index, to_edge, lane, to_lane, _one(through))


def _connected(found: _Found, key: Key, junction: str) -> Iterator[tuple[int, Key, int]]:
    """Yield lane by lane what a junction connects a road to: its lane, the road entered, the lane.

    Without lane links every lane is connected with every other.
    """
    known = found.junctions.get(junction)
    for incoming, other, contact, links in [] if known is None else known.connections:
        entered = _entered(found, other, contact)
        if incoming != key[0] or entered is None or entered not in found.ways:
            continue
        last, first = found.ways[key].last, found.ways[entered].first
        for from_id, to_id in links or [(a, b) for a in last for b in first]:
            if from_id in last and to_id in first:
                yield last.index(from_id), entered, first.index(to_id)


def _onward(
    found: _Found, key: Key, lane: int, path: tuple[Lane, ...]
) -> Iterator[tuple[int, int, tuple[Lane, ...]]]:
    """Yield the edges and lanes that a lane of a connecting road leads to, by what lanes.

    Where junctions touch, a connecting road may lead to another one.
    """
    road = found.roads[key[0]]
    end = road.before if key[1] else road.after
    if len(path) > _MOST_CONNECTING:
        return
    lanes: list[tuple[Key, int]] = []
    if end.kind == "junction":
        lanes = [(to, on) for at, to, on in _connected(found, key, end.element) if at == lane]
    elif (onward := _entered(found, end.element, end.contact)) is not None:
        last = found.ways[key].last[lane]
        lanes = [(onward, other) for other in _linked_lanes(found, key, last, onward)]
    for to, on in lanes:
        if to in found.place:
            yield found.place[to], on, path
        else:
            yield from _onward(found, to, on, (*path, found.ways[to].lanes[on]))


def _one(path: tuple[Lane, ...]) -> Lane:
    if len(path) == 1:
        return path[0]
    return Lane(
        left_m=path[0].left_m,
        right_m=path[0].right_m,
        made=chain_roads([lane.road for lane in path]),
    )


def _entered(found: _Found, road: str, contact: str) -> Key | None:
    """Return the direction in which a road is driven that is entered at `contact`."""
    if road not in found.roads or contact not in (_START, _END):
        return None
    return road, contact == _END


def _linked_lanes(found: _Found, key: Key, id_: int, onward: Key) -> list[int]:
    """Return which lanes of `onward` continue lane `id_` of `key`: by links, else by place."""
    if onward not in found.ways:
        return []
    first = found.ways[onward].first
    road, backward = found.roads[key[0]], key[1]
    lane = road.sections[0 if backward else -1].lanes.get(id_)
    linked = None if lane is None else (lane.predecessor if backward else lane.successor)
    if linked in first:
        return [first.index(linked)]
    if linked is not None:
        return []
    other = found.roads[onward[0]]
    entered = other.sections[-1 if onward[1] else 0].lanes
    return [
        n
        for n, each in enumerate(first)
        if (entered[each].successor if onward[1] else entered[each].predecessor) == id_
    ]
