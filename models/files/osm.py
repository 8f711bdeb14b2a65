"""Read OpenStreetMap extracts, `.osm` and `.osm.pbf`: streets and buildings with heights."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from models.files.osm_tags import (
    Tags,
    building_height_m,
    closed_to_cars,
    is_building,
    is_street,
    street_of,
)
from models.files.streets import Street, network_of_streets
from models.files.xml import stream_elements
from models.geometry import FloatArray
from models.georeference import LONGITUDE_LATITUDE, Georeference, project_to_metres
from models.network import RoadNetwork
from models.obstacles import obstacles_from_polygons

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

Way = tuple[int, Tags, list[int]]  # id, tags, node ids
Relation = tuple[Tags, list[tuple[str, int, str]]]  # tags, members: type, id, role


class _Source(Protocol):
    """Give the objects of a file as often as they are asked for."""

    def relations(self) -> Iterator[Relation]: ...

    def ways(self) -> Iterator[Way]: ...

    def nodes(self) -> Iterator[tuple[int, float, float]]: ...


@dataclass(slots=True)
class _Found:
    """What the passes over the file gather."""

    streets: list[Way] = field(default_factory=list)
    buildings: list[tuple[Tags, list[list[int]], list[list[int]]]] = field(default_factory=list)
    no_turn: set[tuple[str, Hashable, str]] = field(default_factory=set)
    only_turn: dict[tuple[str, Hashable], set[str]] = field(
        default_factory=lambda: defaultdict(set)
    )
    ignored: Counter[str] = field(default_factory=Counter)


def read_osm(path: str | Path) -> RoadNetwork:
    """Read the public streets for cars, and the buildings, of an OpenStreetMap extract.

    Streets meet at shared nodes; relations of type `restriction` with a node between are obeyed.
    Buildings are closed ways and multipolygons. Coordinates are projected to metres about the
    extract's middle; the file's own are longitude and latitude. Traffic keeps to the right.

    Raises:
        ValueError: one line that names the file and what is wrong.
    """
    path = Path(path)
    source: _Source = _Pbf(path) if path.name.lower().endswith(".pbf") else _Xml(path)
    found = _Found()
    _gather(source, found)
    if not found.streets:
        raise ValueError(f"{path}: must hold at least one street for cars (highway=…), got none")
    wanted = {node for _, _, nodes in found.streets for node in nodes}
    wanted |= {n for _, outer, inner in found.buildings for ring in outer + inner for n in ring}
    places = {node: (lon, lat) for node, lon, lat in source.nodes() if node in wanted}
    missing = len(wanted) - len(places)
    if missing:
        found.ignored["nodes outside the extract"] += missing
    if not places:
        raise ValueError(f"{path}: must hold the nodes of its streets, got none of them")
    degrees = np.array(list(places.values()), dtype=np.float64)
    metric, metres = project_to_metres(degrees, LONGITUDE_LATITUDE, str(path))
    at = dict(zip(places, metres, strict=True))
    network = network_of_streets(_streets(found, at), found.ignored, _May(found))
    outlines, heights = [], []
    for tags, outer, inner in found.buildings:
        holes = [ring for nodes in inner if (ring := _ring(nodes, at)) is not None]
        for nodes in outer:
            ring = _ring(nodes, at)
            if ring is None:
                found.ignored["buildings cut by the extract"] += 1
                continue
            inside = [hole for hole in holes if _within(hole, ring)]
            outlines.append((ring, inside))
            heights.append(building_height_m(tags))
    obstacles, mended, empty = obstacles_from_polygons(outlines, heights)
    found.ignored["buildings that crossed themselves (mended)"] += mended
    found.ignored["buildings that enclose nothing"] += empty
    return replace(
        network,
        obstacles=obstacles,
        georeference=Georeference(LONGITUDE_LATITUDE, metric),
        ignored={what: count for what, count in found.ignored.items() if count},
        source="OpenStreetMap",
    )


def _gather(source: _Source, found: _Found) -> None:
    """Walk relations, then ways: what belongs to a relation's building has no tags of its own."""
    shapes: list[tuple[Tags, list[int], list[int]]] = []
    members: set[int] = set()
    for tags, parts in source.relations():
        ways = [(ref, role) for kind, ref, role in parts if kind == "way"]
        if tags.get("type") == "restriction":
            _restrict(tags, parts, found)
        elif tags.get("type") == "multipolygon" and is_building(tags):
            outer = [ref for ref, role in ways if role != "inner"]
            inner = [ref for ref, role in ways if role == "inner"]
            shapes.append((tags, outer, inner))
            members |= {*outer, *inner}
    lines: dict[int, list[int]] = {}
    for ref, tags, nodes in source.ways():
        if ref in members:
            lines[ref] = nodes
        if is_street(tags):
            if closed_to_cars(tags):
                found.ignored["streets closed to the public's cars"] += 1
            else:
                found.streets.append((ref, tags, nodes))
        elif is_building(tags) and ref not in members:
            found.buildings.append((tags, [nodes], []))
        elif "highway" in tags:
            found.ignored["ways that are no streets for cars"] += 1
    for tags, outer, inner in shapes:
        rings = [_rings([lines[ref] for ref in refs if ref in lines]) for refs in (outer, inner)]
        found.buildings.append((tags, rings[0], rings[1]))


def _restrict(tags: Tags, parts: list[tuple[str, int, str]], found: _Found) -> None:
    kind = tags.get("restriction", "")
    by_role = {role: (what, ref) for what, ref, role in parts}
    start, via, end = (by_role.get(role) for role in ("from", "via", "to"))
    if not (start and via and end and via[0] == "node" and start[0] == end[0] == "way"):
        found.ignored["turn restrictions that are not way–node–way"] += 1
    elif kind.startswith("no_"):
        found.no_turn.add((str(start[1]), via[1], str(end[1])))
    elif kind.startswith("only_"):
        found.only_turn[str(start[1]), via[1]].add(str(end[1]))


class _May:
    """Say whether the restrictions allow a turn."""

    def __init__(self, found: _Found) -> None:
        self._found = found

    def __call__(self, start: str, node: Hashable, end: str) -> bool:
        if (start, node, end) in self._found.no_turn:
            return False
        only = self._found.only_turn.get((start, node))
        return only is None or end in only


def _streets(found: _Found, at: dict[int, FloatArray]) -> Iterable[Street]:
    """Yield each way's runs of known nodes."""
    for ref, tags, nodes in found.streets:
        ways = street_of(tags)
        run: list[int] = []
        for node in [*nodes, None]:
            if node is not None and node in at:
                if not run or run[-1] != node:
                    run.append(node)
                continue
            if len(run) >= 2:
                yield Street(
                    name=str(ref),
                    nodes=tuple(run),
                    points_m=np.array([at[each] for each in run]),
                    forward=ways.forward,
                    backward=ways.backward,
                    width_m=ways.width_m,
                    speed_mps=ways.speed_mps,
                    kind=f"highway.{ways.kind}",
                    shared=ways.shared,
                )
            run = []


def _ring(nodes: Sequence[int], at: dict[int, FloatArray]) -> FloatArray | None:
    """Return a closed line's corners, or None if it is open or nodes are missing."""
    if len(nodes) < 4 or nodes[0] != nodes[-1] or any(node not in at for node in nodes):
        return None
    return np.array([at[node] for node in nodes])


def _rings(lines: list[list[int]]) -> list[list[int]]:
    """Join lines that meet at their ends into closed rings; what stays open is returned open."""
    waiting = [list(line) for line in lines if len(line) >= 2]
    rings = []
    while waiting:
        ring = waiting.pop()
        while ring[0] != ring[-1]:
            for k, line in enumerate(waiting):
                if ring[-1] in (line[0], line[-1]):
                    ring += (line if line[0] == ring[-1] else line[::-1])[1:]
                    del waiting[k]
                    break
            else:
                break
        rings.append(ring)
    return rings


def _within(hole: FloatArray, ring: FloatArray) -> bool:
    import shapely

    inside = shapely.Polygon(ring).buffer(1e-6)
    return bool(shapely.covers(inside, shapely.Point(hole[0])))


class _Xml:
    """Read `.osm` XML, gzipped or not."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def relations(self) -> Iterator[Relation]:
        for element in self._each("relation"):
            parts = [
                (each.get("type", ""), self._ref(each, "ref"), each.get("role", ""))
                for each in element.findall("member")
            ]
            yield _tags(element), parts

    def ways(self) -> Iterator[Way]:
        for element in self._each("way"):
            nodes = [self._ref(each, "ref") for each in element.findall("nd")]
            yield self._ref(element, "id"), _tags(element), nodes

    def nodes(self) -> Iterator[tuple[int, float, float]]:
        for element in self._each("node"):
            if element.get("lat") is None:  # deleted, in a file of changes
                continue
            try:
                lon, lat = float(element.get("lon", "")), float(element.get("lat", ""))
            except ValueError:
                lon = lat = float("nan")
            if not (abs(lon) <= 180.0 and abs(lat) <= 90.0):
                raise ValueError(
                    f"{self._path}: node {element.get('id')} must lie at a longitude and latitude, "
                    f"got {element.get('lon')}, {element.get('lat')}"
                )
            yield self._ref(element, "id"), lon, lat

    def _each(self, tag: str) -> Iterator[Element]:
        for element in stream_elements(self._path, "osm"):
            if element.tag == tag and element.get("visible") != "false":
                yield element

    def _ref(self, element: Element, key: str) -> int:
        try:
            return int(element.get(key, ""))
        except ValueError:
            raise ValueError(
                f"{self._path}: {element.tag} {key} must be a whole number, "
                f"got {element.get(key, '')[:40]!r}"
            ) from None


def _tags(element: Element) -> Tags:
    return {each.get("k", ""): each.get("v", "") for each in element.findall("tag")}


class _Pbf:
    """Read `.osm.pbf` with libosmium."""

    def __init__(self, path: Path) -> None:
        try:
            with path.open("rb") as file:
                empty = not file.read(1)
        except FileNotFoundError:
            raise ValueError(f"{path}: no such file") from None
        except OSError as error:
            raise ValueError(f"{path}: cannot be read: {error.strerror or error}") from None
        if empty:
            raise ValueError(f"{path}: must be an OpenStreetMap extract, the file is empty")
        self._path = path

    def relations(self) -> Iterator[Relation]:
        import osmium.osm

        kinds = {"w": "way", "n": "node", "r": "relation"}
        for each in self._each(osmium.osm.RELATION):
            parts = [(kinds.get(m.type, ""), m.ref, m.role) for m in each.members]
            yield {tag.k: tag.v for tag in each.tags}, parts

    def ways(self) -> Iterator[Way]:
        import osmium.osm

        for each in self._each(osmium.osm.WAY):
            yield each.id, {tag.k: tag.v for tag in each.tags}, [node.ref for node in each.nodes]

    def nodes(self) -> Iterator[tuple[int, float, float]]:
        import osmium.osm

        for each in self._each(osmium.osm.NODE):
            if each.location.valid():
                yield each.id, each.location.lon, each.location.lat

    def _each(self, entity: Any) -> Iterator[Any]:
        import osmium

        try:
            yield from osmium.FileProcessor(str(self._path), entity)
        except RuntimeError as error:
            raise ValueError(f"{self._path}: not an OpenStreetMap extract ({error})") from None
