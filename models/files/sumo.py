"""Read SUMO road networks (`.net.xml[.gz]`) and the buildings beside them (`.poly.xml[.gz]`)."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from models.files.xml import stream_elements
from models.geometry import FloatArray, Pose
from models.georeference import Georeference, parse_crs
from models.network import Edge, Lane, RoadNetwork, Turn, lane_length
from models.obstacles import Obstacles, obstacles_from_polygons

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

LANE_WIDTH_M = 3.2  # SUMO's own default
BUILDING_HEIGHT_M = 10.0
_LEAST_LENGTH_M = 0.1
_SAME_STREET_M = 50.0  # between the middles of opposite carriageways
_CARS = {"passenger", "all"}
_MOST_VIA = 8  # internal lanes in one turn: SUMO makes two


@dataclass(slots=True)
class _Found:
    """What one pass over the file gathers."""

    edges: list[Edge] = field(default_factory=list)
    place: dict[str, int] = field(default_factory=dict)  # edge name → index
    lane_of: dict[tuple[str, int], int] = field(default_factory=dict)  # (edge, SUMO's) → ours
    internal: dict[str, tuple[FloatArray, float]] = field(default_factory=dict)
    onward: dict[str, str] = field(default_factory=dict)  # internal lane → the internal one after
    connections: list[dict[str, str]] = field(default_factory=list)
    nodes: dict[str, tuple[float, float]] = field(default_factory=dict)
    ignored: Counter[str] = field(default_factory=Counter)
    georeference: Georeference = field(default_factory=Georeference)


def read_sumo(
    path: str | Path,
    *,
    buildings: str | Path | None = None,
    building_height_m: float = BUILDING_HEIGHT_M,
    beside: bool = True,
) -> RoadNetwork:
    """Read a network; `buildings` is its polygons' file, by default `NAME.poly.xml[.gz]` beside it
    (unless `beside` is false).

    Edges are the carriageways that passenger cars may use; a lane follows its `shape`, corners
    rounded (`models.polyline`). A turn follows the internal lanes of its junction. The frame is
    the file's; its coordinate system and offset are those of `<location>`.

    Raises:
        ValueError: one line that names the file and the element.
    """
    path = Path(path)
    found = _Found()
    for element in stream_elements(path, "net"):
        if element.tag == "location":
            found.georeference = _georeference(element, path)
        elif element.tag == "edge":
            _read_edge(element, found, path)
        elif element.tag == "junction":
            _read_junction(element, found, path)
        elif element.tag == "connection":
            found.connections.append(dict(element.attrib))
    if not found.edges:
        more = f" (left out: {_listed(found.ignored)})" if found.ignored else ""
        raise ValueError(f"{path}: must hold at least one edge that passenger cars may use{more}")
    polygons = None if buildings is None else Path(buildings)
    if polygons is None and beside:
        polygons = polygons_beside(path)
    obstacles = Obstacles()
    if polygons is not None:
        obstacles = read_sumo_polygons(polygons, building_height_m, found.ignored)
    return RoadNetwork(
        edges=_in_streets(found.edges),
        turns=tuple(_turns(found)),
        nodes=_nodes(found),
        obstacles=obstacles,
        georeference=found.georeference,
        ignored=dict(found.ignored),
        source="SUMO",
    )


def read_sumo_polygons(
    path: str | Path,
    height_m: float = BUILDING_HEIGHT_M,
    ignored: Counter[str] | None = None,
) -> Obstacles:
    """Read the buildings of an additional file: `<poly>` whose type starts with `building`.

    A `<param key="height" value="…"/>` (or `building:height`, `building:levels`) gives the height
    of one; others are `height_m` high. `ignored` counts what was left out.
    """
    path = Path(path)
    counts: Counter[str] = Counter() if ignored is None else ignored
    outlines, heights = [], []
    for element in stream_elements(path, "additional"):
        if element.tag == "poi":
            counts["points of interest"] += 1
        if element.tag != "poly":
            continue
        if not element.get("type", "").startswith("building"):
            counts["polygons that are no buildings"] += 1
            continue
        outlines.append((_shape(element.get("shape", ""), f"{path}: poly", least=1)[0], ()))
        heights.append(_height(element, height_m))
    obstacles, mended, empty = obstacles_from_polygons(outlines, heights)
    counts["buildings that crossed themselves (mended)"] += mended
    counts["buildings that enclose nothing"] += empty
    return obstacles


def _georeference(element: Element, path: Path) -> Georeference:
    offset = _numbers(element.get("netOffset", "0,0"), f"{path}: location: netOffset", 2)
    text = element.get("projParameter", "!").strip()
    crs = None
    if text not in ("", "!", "-"):
        crs = text
        parse_crs(crs, f"{path}: location: projParameter")
    return Georeference(crs, crs, Pose(-offset[0], -offset[1], 0.0))


def _read_edge(element: Element, found: _Found, path: Path) -> None:
    name, function = element.get("id", ""), element.get("function", "normal")
    where = f"{path}: edge {name[:60]!r}"
    lanes = element.findall("lane")
    if function == "internal":
        for lane in lanes:
            shape = _shape(lane.get("shape", ""), where, least=1)[0]
            found.internal[lane.get("id", "")] = (shape, _width(lane, where))
        return
    if function not in ("normal", "connector"):
        found.ignored[f"edges of function {function}"] += 1
        return
    if name in found.place:
        raise ValueError(f"{where}: id must differ from the others")
    start, end = element.get("from"), element.get("to")
    if not start or not end:
        raise ValueError(f"{where}: must have from and to")
    open_lanes = [lane for lane in lanes if _for_cars(lane)]
    if len(open_lanes) < len(lanes):
        found.ignored["lanes closed to passenger cars"] += len(lanes) - len(open_lanes)
    if not open_lanes:
        found.ignored["edges closed to passenger cars"] += 1
        return
    open_lanes.sort(key=lambda lane: _number(lane.get("index", "0"), f"{where}: lane index"))
    widths = [_width(lane, where) for lane in open_lanes]
    made: list[Lane] = []
    for k, lane in enumerate(open_lanes):
        shape, deep = _shape(lane.get("shape", "") or element.get("shape", ""), where, least=1)
        found.ignored["heights of shapes"] += deep
        made.append(Lane(shape, 0.5 * widths[k] + sum(widths[k + 1 :]),
                         0.5 * widths[k] + sum(widths[:k])))  # fmt: skip
    if any(lane_length(lane) < _LEAST_LENGTH_M for lane in made):
        found.ignored["edges without length"] += 1
        return
    for k, lane in enumerate(open_lanes):
        found.lane_of[name, int(lane.get("index", k))] = k
    found.place[name] = len(found.edges)
    stated = open_lanes[0].get("length")
    found.edges.append(
        Edge(
            name=name,
            start=start,
            end=end,
            lanes=tuple(made),
            speed_mps=_speed(open_lanes[0], element, where),
            width_m=float(sum(widths)),
            kind=element.get("type", ""),
            stated_length_m=None if stated is None else _number(stated, f"{where}: length"),
        )
    )


def _read_junction(element: Element, found: _Found, path: Path) -> None:
    if element.get("type") == "internal":
        return
    name = element.get("id", "")
    x, y = (_number(element.get(k, ""), f"{path}: junction {name[:60]!r}: {k}") for k in "xy")
    found.nodes[name] = (x, y)


def _in_streets(edges: list[Edge]) -> tuple[Edge, ...]:
    """Give opposite carriageways one street: of edges between the same nodes, the nearest ones."""
    between: dict[tuple[str, str], list[int]] = {}
    for i, edge in enumerate(edges):
        between.setdefault((edge.start, edge.end), []).append(i)
    middles = [edge.lanes[0].outline.mean(axis=0) for edge in edges]
    street = [edge.name for edge in edges]
    for (start, end), ours in between.items():
        free = list(between.get((end, start), [])) if start < end else []
        for i in ours:
            if free:
                near = min(free, key=lambda j: math.dist(middles[i], middles[j]))
                if math.dist(middles[i], middles[near]) < _SAME_STREET_M:
                    street[near] = street[i]
                    free.remove(near)
    return tuple(replace(edge, street=name) for edge, name in zip(edges, street, strict=True))


def _turns(found: _Found) -> list[Turn]:
    """Follow each connection through its internal lanes."""
    turns = []
    for each in found.connections:
        if each.get("from", "").startswith(":") and each.get("via"):
            found.onward[f"{each['from']}_{each.get('fromLane', '0')}"] = each["via"]
    for each in found.connections:
        a, b = found.place.get(each.get("from", "")), found.place.get(each.get("to", ""))
        if a is None or b is None:
            continue
        try:
            lanes = (int(each.get("fromLane", "0")), int(each.get("toLane", "0")))
        except ValueError:
            found.ignored["connections without lanes"] += 1
            continue
        ours = tuple(
            found.lane_of.get((each[k], n)) for k, n in zip(("from", "to"), lanes, strict=True)
        )
        if ours[0] is None or ours[1] is None:
            found.ignored["connections of lanes closed to cars"] += 1
            continue
        path = _through(found, each.get("via"), found.edges[a].lanes[ours[0]],
                        found.edges[b].lanes[ours[1]])  # fmt: skip
        turns.append(Turn(a, b, ours[0], ours[1], path))
    return turns


def _through(found: _Found, via: str | None, before: Lane, after: Lane) -> Lane | None:
    """Join the internal lanes of a turn, or the two lanes' ends where the file has none."""
    ends = np.vstack((before.outline[-1:], after.outline[:1]))
    shapes, width = [ends[:1]], 2.0 * before.right_m
    for _ in range(_MOST_VIA):
        if via is None or via not in found.internal:
            break
        shape, width = found.internal[via]
        shapes.append(shape)
        via = found.onward.get(via)
    whole = np.vstack([*shapes, ends[1:]])
    if float(np.max(np.hypot(*(whole - whole[0]).T))) < _LEAST_LENGTH_M:
        return None
    return Lane(whole, 0.5 * width, 0.5 * width)


def _nodes(found: _Found) -> dict[str, tuple[float, float]]:
    """Return the junctions that edges use; one that the file leaves out lies at an edge's end."""
    nodes: dict[str, tuple[float, float]] = {}
    for edge in found.edges:
        for name, at in ((edge.start, 0), (edge.end, -1)):
            if name not in nodes:
                x, y = edge.lanes[0].outline[at].tolist()
                nodes[name] = found.nodes.get(name, (x, y))
    return nodes


def polygons_beside(path: Path) -> Path | None:
    """Find the polygons' file of a network by its name."""
    stem = path.name.removesuffix(".gz").removesuffix(".xml").removesuffix(".net")
    for suffix in (".poly.xml", ".poly.xml.gz"):
        if (path.parent / (stem + suffix)).is_file():
            return path.parent / (stem + suffix)
    return None


def _for_cars(lane: Element) -> bool:
    allow, disallow = lane.get("allow"), lane.get("disallow")
    if allow is not None:
        return bool(_CARS & set(allow.split()))
    return not (disallow is not None and _CARS & set(disallow.split()))


def _shape(text: str, where: str, *, least: int) -> tuple[FloatArray, bool]:
    """Read `x,y[,z] x,y[,z] …` as (n, 2), and whether there were heights."""
    try:
        rows = [pair.split(",") for pair in text.split()]
        values = np.array(rows, dtype=np.float64)
    except ValueError:
        raise ValueError(f"{where}: shape must be x,y pairs, got {text[:40]!r}") from None
    if len(values) < least or values.ndim != 2 or values.shape[1] not in (2, 3):
        raise ValueError(f"{where}: shape must be x,y pairs, got {text[:40]!r}")
    if not np.isfinite(values).all() or np.abs(values).max() > 1e9:
        raise ValueError(f"{where}: shape must be finite, got {text[:40]!r}")
    return np.ascontiguousarray(values[:, :2]), bool(values.shape[1] == 3)


def _width(lane: Element, where: str) -> float:
    width = _number(lane.get("width", str(LANE_WIDTH_M)), f"{where}: width")
    return width if width > 0.0 else LANE_WIDTH_M


def _speed(lane: Element, edge: Element, where: str) -> float:
    speed = _number(lane.get("speed") or edge.get("speed") or "13.89", f"{where}: speed")
    return speed if speed > 0.0 else 13.89


def _height(element: Element, default: float) -> float:
    for param in element.findall("param"):
        key, scale = param.get("key", ""), 1.0
        if key in ("building:levels", "levels"):
            scale = 3.0
        elif key not in ("height", "building:height"):
            continue
        try:
            height = scale * float(param.get("value", "").removesuffix("m").strip())
        except ValueError:
            continue
        if 0.0 < height < 1000.0:
            return height
    return default


def _numbers(text: str, where: str, n: int) -> list[float]:
    cells = text.split(",")
    if len(cells) < n:
        raise ValueError(f"{where} must be {n} numbers, got {text[:40]!r}")
    return [_number(cell, where) for cell in cells[:n]]


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{where} must be a number, got {text[:40]!r}") from None
    if not math.isfinite(value):
        raise ValueError(f"{where} must be finite, got {text[:40]}")
    return value


def _listed(ignored: Counter[str]) -> str:
    return ", ".join(f"{count} {what}" for what, count in ignored.items() if count)
