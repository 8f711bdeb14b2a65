"""Read GeoJSON: lines are streets, polygons are buildings, in any coordinate system PROJ knows."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from models.files.osm_tags import building_height_m, street_of
from models.files.streets import Street, network_of_streets
from models.files.text import parse_json, read_bytes
from models.geometry import FloatArray, Pose
from models.georeference import LONGITUDE_LATITUDE, Georeference, project_to_metres
from models.network import RoadNetwork
from models.obstacles import Obstacles, obstacles_from_polygons
from models.polyline import rounded_road
from models.roads import Road, road_from_points

MOST_BYTES = 1 << 30
MOST_METRES = 1e8
LOCAL = "local"  # a crs of this name: metres of the road's frame, nowhere on the Earth
_SAME_M = 0.01
_KNOWN = frozenset(("LineString", "MultiLineString", "Polygon", "MultiPolygon"))


@dataclass(slots=True)
class _Found:
    """Lines and polygons in the file's coordinates, each with its properties."""

    lines: list[tuple[str, Mapping[str, Any], FloatArray]] = field(default_factory=list)
    polygons: list[tuple[Mapping[str, Any], list[FloatArray]]] = field(default_factory=list)
    ignored: Counter[str] = field(default_factory=Counter)


def read_geojson(path: str | Path, *, width_m: float = 6.0) -> RoadNetwork:
    """Read a FeatureCollection, a Feature or a bare geometry.

    Coordinates are longitude and latitude, as the standard has it, unless the file names another
    system as `"crs": {"type": "name", "properties": {"name": "EPSG:25832"}}`; the name `local`
    means metres. A line's properties are those of OpenStreetMap (`oneway`, `lanes`, `width`,
    `maxspeed`, `highway`), with `width_m` and `speed_mps` before them; without any it is `width_m`
    wide and driven both ways. Lines meet where they share a vertex (to 1 cm). A polygon's `height`,
    `height_m` or `building:levels` says how high it is. One single line is the `centreline`.

    Raises:
        ValueError: one line that names the file, the feature and what is wrong.
    """
    path = Path(path)
    found, name = _read(path)
    if not found.lines:
        raise ValueError(f"{path}: must hold at least one line with a length")
    georeference, lines, polygons = _projected(found, name, path)
    streets = list(_streets(found, lines, width_m))
    network = network_of_streets(streets, found.ignored)
    if not network.edges:
        raise ValueError(f"{path}: must hold at least one line with a length")
    return replace(
        network,
        obstacles=_obstacles(found, polygons),
        georeference=georeference,
        ignored={what: count for what, count in found.ignored.items() if count},
        source="GeoJSON",
        centreline=_centreline(streets[0]) if len(streets) == 1 else None,
    )


def read_geojson_obstacles(path: str | Path, georeference: Georeference) -> Obstacles:
    """Read the polygons of a file as buildings in the frame of `georeference`.

    Raises:
        ValueError: as `read_geojson`, or if the file lies on the Earth and the road does not.
    """
    path = Path(path)
    found, name = _read(path)
    if name == LOCAL or georeference.file_crs is None:
        if name not in (None, LOCAL):
            raise ValueError(f"{path}: crs must be local, as the road's is, got {name[:60]!r}")
        return _obstacles(found, [rings for _, rings in found.polygons])
    own = replace(georeference, file_crs=name or LONGITUDE_LATITUDE)
    moved = [[own.to_road(ring) for ring in rings] for _, rings in found.polygons]
    return _obstacles(found, moved)


def _obstacles(found: _Found, polygons: list[list[FloatArray]]) -> Obstacles:
    heights = [building_height_m(_words(tags)) for tags, _ in found.polygons]
    obstacles, mended, empty = obstacles_from_polygons(
        [(rings[0], rings[1:]) for rings in polygons], heights
    )
    found.ignored["buildings that crossed themselves (mended)"] += mended
    found.ignored["buildings that enclose nothing"] += empty
    return obstacles


def _read(path: Path) -> tuple[_Found, str | None]:
    """Return what the file holds, and the name of its coordinate system if it has one."""
    whole = _parse(path)
    if not isinstance(whole, dict):
        raise ValueError(f"{path}: must be a GeoJSON object, got a {type(whole).__name__}")
    found = _Found()
    for n, feature in _features(whole, path):
        where = f"{path}: features[{n}]"
        geometry = feature.get("geometry")
        if geometry is None:
            found.ignored["features without geometry"] += 1
            continue
        tags = feature.get("properties") or {}
        if not isinstance(tags, dict):
            raise ValueError(f"{where}.properties must be an object")
        label = str(tags.get("id", feature.get("id", tags.get("name", n))))[:60]
        _add(geometry, label or str(n), tags, where, found)
    return found, _crs_name(whole, path)


def _features(whole: dict[str, Any], path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    kind = whole.get("type")
    if kind == "FeatureCollection":
        features = whole.get("features")
        if not isinstance(features, list):
            raise ValueError(f"{path}: features must be a list")
        for n, feature in enumerate(features):
            if not isinstance(feature, dict):
                raise ValueError(f"{path}: features[{n}] must be an object")
            yield n, feature
    elif kind == "Feature":
        yield 0, whole
    elif kind in _KNOWN or kind == "GeometryCollection":
        yield 0, {"geometry": whole}
    else:
        raise ValueError(f"{path}: type must be a GeoJSON one, got {str(kind)[:40]!r}")


def _add(
    geometry: Any, label: str, tags: Mapping[str, Any], where: str, found: _Found, depth: int = 0
) -> None:
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind == "GeometryCollection" and depth < 8:
        for each in geometry.get("geometries") or []:
            _add(each, label, tags, where, found, depth + 1)
        return
    if kind not in _KNOWN:
        found.ignored[f"geometries of type {str(kind)[:20]}"] += 1
        return
    at = geometry.get("coordinates")
    if kind in ("LineString", "MultiLineString"):
        for k, line in enumerate([at] if kind == "LineString" else _list(at, where)):
            points = _points(line, where, 2)
            found.ignored["heights of coordinates"] += _has_heights(line)
            found.lines.append((label if k == 0 else f"{label}.{k}", tags, points))
        return
    for polygon in [at] if kind == "Polygon" else _list(at, where):
        rings = [_points(ring, where, 1) for ring in _list(polygon, where)]
        if rings:
            found.polygons.append((tags, rings))


def _list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError(
            f"{where}.geometry.coordinates must be nested lists, got {str(value)[:40]}"
        )
    return value


def _points(value: Any, where: str, least: int) -> FloatArray:
    """Read positions; a third coordinate is left out."""
    rows = _list(value, where)
    pairs = []
    for row in rows:
        ok = isinstance(row, list) and len(row) >= 2
        if not ok or any(isinstance(x, bool) or not isinstance(x, int | float) for x in row[:2]):
            raise ValueError(
                f"{where}.geometry.coordinates must be [x, y] pairs, got {str(row)[:40]}"
            )
        pairs.append((row[0], row[1]))
    if len(pairs) < least:
        raise ValueError(
            f"{where}.geometry.coordinates must hold at least {least} positions, got {len(pairs)}"
        )
    try:
        points = np.array(pairs, dtype=np.float64)
    except OverflowError:
        points = np.array([[math.inf, 0.0]])
    if not (np.isfinite(points).all() and np.abs(points).max() <= MOST_METRES):
        raise ValueError(f"{where}.geometry.coordinates must be finite and within ±{MOST_METRES:g}")
    return points


def _has_heights(rows: list[list[Any]]) -> bool:
    return any(len(row) > 2 and bool(row[2]) for row in rows)


def _crs_name(whole: dict[str, Any], path: Path) -> str | None:
    crs = whole.get("crs")
    if crs is None:
        return None
    name = crs
    if isinstance(crs, dict):
        properties = crs.get("properties")
        name = properties.get("name") if isinstance(properties, dict) else None
    if not isinstance(name, str):
        raise ValueError(f"{path}: crs must name a coordinate reference system")
    return LONGITUDE_LATITUDE if name.endswith("CRS84") else name


def _projected(
    found: _Found, name: str | None, path: Path
) -> tuple[Georeference, list[FloatArray], list[list[FloatArray]]]:
    """Bring all coordinates to metres about the first point of the roads' box."""
    lines = [line for _, _, line in found.lines]
    rings = [rings for _, rings in found.polygons]
    if name == LOCAL:
        return Georeference(), lines, rings
    everything = np.vstack([*lines, *(ring for each in rings for ring in each)])
    if name is None and np.any(np.abs(everything) > (180.0, 90.0)):
        bad = everything[np.any(np.abs(everything) > (180.0, 90.0), axis=1)][0]
        raise ValueError(
            f"{path}: coordinates must be longitude and latitude, or the file name its crs, "
            f'got {bad[0]:g}, {bad[1]:g} (metres of a frame of one\'s own: crs "{LOCAL}")'
        )
    crs = name or LONGITUDE_LATITUDE
    metric, metres = project_to_metres(everything, crs, f"{path}: crs")
    # A projection's false origin costs digits and pictures their axes: start near the roads.
    corner = np.floor(metres.min(axis=0)) if metric == crs else np.zeros(2)
    metres = metres - corner
    parts = np.split(metres, np.cumsum([len(p) for p in [*lines, *_flat(rings)]])[:-1])
    moved = iter(parts)
    return (
        Georeference(crs, metric, Pose(float(corner[0]), float(corner[1]))),
        [next(moved) for _ in lines],
        [[next(moved) for _ in each] for each in rings],
    )


def _flat(rings: list[list[FloatArray]]) -> list[FloatArray]:
    return [ring for each in rings for ring in each]


def _streets(found: _Found, lines: list[FloatArray], width_m: float) -> Iterator[Street]:
    """Yield the lines as streets; vertices within 1 cm are one node."""
    node = _nodes(np.vstack(lines))
    begin = 0
    for (label, properties, _), points in zip(found.lines, lines, strict=True):
        nodes = node[begin : begin + len(points)]
        begin += len(points)
        keep = np.concatenate(([True], nodes[1:] != nodes[:-1]))
        if keep.sum() < 2:
            found.ignored["streets without length"] += 1
            continue
        tags = _words(properties)
        ways = street_of(tags)
        width = _positive(properties.get("width_m"))
        if width is None:
            said = {"width", "lanes", "highway", "lanes:forward", "lanes:backward"} & tags.keys()
            width = ways.width_m if said else width_m
        yield Street(
            name=label,
            nodes=tuple(nodes[keep].tolist()),
            points_m=points[keep],
            forward=ways.forward,
            backward=ways.backward,
            width_m=width,
            speed_mps=_positive(properties.get("speed_mps")) or ways.speed_mps,
            kind=str(properties.get("highway", "")),
            shared=ways.shared,
        )


def _nodes(points: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Number points (n, 2) so that those within 1 cm have one number."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(_SAME_M, output_type="ndarray")
    n = len(points)
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    labels: np.ndarray[tuple[int], np.dtype[np.int64]] = connected_components(
        links, directed=False
    )[1].astype(np.int64)
    return labels


def _words(properties: Mapping[str, Any]) -> dict[str, str]:
    """Return properties as OpenStreetMap's tags are: text; true is yes."""
    words = {}
    for key, value in properties.items():
        if isinstance(value, bool):
            words[key] = "yes" if value else "no"
        elif isinstance(value, str | int | float):
            words[key] = str(value)
    return words


def _positive(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) and 0.0 < value < 1000.0 else None


def _centreline(street: Street) -> Road:
    half = 0.5 * street.width_m
    points = street.points_m
    if street.nodes[0] == street.nodes[-1] and len(points) > 3:
        return road_from_points(points[:-1], closed=True, left_m=half, right_m=half)
    return rounded_road(points, half, half)


def _parse(path: Path) -> Any:
    content = read_bytes(path, MOST_BYTES, f"{MOST_BYTES >> 30} GB of GeoJSON")
    if not content.strip():
        raise ValueError(f"{path}: must be GeoJSON, the file is empty")
    return parse_json(path, content)
