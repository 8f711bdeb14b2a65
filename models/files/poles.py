"""Read the poles that are already there from a GeoJSON file of points."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from models.camera_checks import MAX_HEIGHT_M
from models.files.text import parse_json, read_bytes
from models.geometry import FloatArray
from models.georeference import LONGITUDE_LATITUDE, Georeference, parse_crs

MOST_BYTES = 64_000_000
MOST_POLES = 1_000_000
MOST_METRES = 1e7
SAME_M = 1e-6


@dataclass(frozen=True, slots=True)
class Poles:
    """Hold m poles in the order of the file, each array (m,), in metres of the road's frame.

    `height_m` is NaN and `cost` 0 where the file does not say; `name` is "" there.
    """

    x_m: FloatArray
    y_m: FloatArray
    height_m: FloatArray
    cost: FloatArray
    name: tuple[str, ...]

    def __len__(self) -> int:
        """Return the number of poles, m."""
        return len(self.x_m)


def read_poles(path: str | Path, georeference: Georeference | None = None) -> Poles:
    """Read a FeatureCollection of Point features; coordinates are [x, y] in the road's frame.

    Where the road lies on the Earth, as `georeference` says, they are longitude and latitude or in
    the system that the file names as its `crs`; the name `local` means the road's frame, too.

    Of a feature's properties `name` (text), `height_m` (of a camera on the pole) and `cost` (of a
    camera put there) are read, others ignored; so is a third coordinate.

    Raises a ValueError of one line that names the file and the feature: no such file, more than
    64 MB or a million features, not GeoJSON, other geometry than points, coordinates, heights or
    costs that are no finite numbers or out of range, two poles in one place.
    """
    path = Path(path)
    content = read_bytes(path, MOST_BYTES, f"{MOST_BYTES // 1_000_000} MB of GeoJSON")
    collection = parse_json(path, content)
    if not isinstance(collection, dict) or collection.get("type") != "FeatureCollection":
        raise ValueError(f"{path}: must be a GeoJSON FeatureCollection of points")
    features = collection.get("features")
    if not isinstance(features, list) or not features:
        raise ValueError(f"{path}: features must be a list with at least one pole")
    if len(features) > MOST_POLES:
        raise ValueError(f"{path}: must hold at most {MOST_POLES:,} poles, got {len(features):,}")
    rows = [_pole(feature, f"{path}: features[{n}]") for n, feature in enumerate(features)]
    numbers = np.array([row[:4] for row in rows], dtype=np.float64)
    _refuse_twins(path, numbers[:, :2])
    if georeference is not None and georeference.file_crs is not None:
        numbers[:, :2] = _in_road(path, numbers[:, :2], _crs(path, collection), georeference)
    columns = [_column(numbers, k) for k in range(4)]
    return Poles(
        x_m=columns[0],
        y_m=columns[1],
        height_m=columns[2],
        cost=columns[3],
        name=tuple(row[4] for row in rows),
    )


def _crs(path: Path, collection: dict[str, Any]) -> str:
    crs = collection.get("crs")
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if crs is None:
        return LONGITUDE_LATITUDE
    if not isinstance(name, str):
        raise ValueError(f"{path}: crs must name a coordinate reference system")
    if name != "local":
        parse_crs(name, f"{path}: crs")
    return name


def _in_road(path: Path, points: FloatArray, crs: str, where: Georeference) -> FloatArray:
    if crs == "local":
        return points
    if crs == LONGITUDE_LATITUDE and np.any(np.abs(points) > (180.0, 90.0)):
        bad = int(np.flatnonzero(np.any(np.abs(points) > (180.0, 90.0), axis=1))[0])
        raise ValueError(
            f"{path}: features[{bad}] must be longitude and latitude, or the file name its crs "
            f'("local" for metres of the road\'s frame), got {points[bad, 0]:g}, {points[bad, 1]:g}'
        )
    moved = replace(where, file_crs=crs).to_road(points)
    if not np.isfinite(moved).all():
        bad = int(np.flatnonzero(~np.isfinite(moved).all(axis=1))[0])
        raise ValueError(f"{path}: features[{bad}] must lie where the road's projection holds")
    return moved


def _column(numbers: FloatArray, k: int) -> FloatArray:
    column = np.ascontiguousarray(numbers[:, k])
    column.flags.writeable = False
    return column


def _pole(feature: Any, where: str) -> tuple[float, float, float, float, str]:
    geometry = feature.get("geometry") if isinstance(feature, dict) else None
    if not isinstance(geometry, dict) or geometry.get("type") != "Point":
        kind = geometry.get("type") if isinstance(geometry, dict) else geometry
        raise ValueError(f"{where}.geometry must be a Point, got {str(kind)[:40]}")
    at = geometry.get("coordinates")
    if not isinstance(at, list) or len(at) not in (2, 3):
        raise ValueError(f"{where}.geometry.coordinates must be [x, y], got {str(at)[:40]}")
    name_xy = (f"{where}.geometry.coordinates[{k}]" for k in range(2))
    x, y = (
        _number(value, name, -MOST_METRES, MOST_METRES)
        for name, value in zip(name_xy, at, strict=False)
    )
    properties = feature.get("properties") or {}
    if not isinstance(properties, dict):
        raise ValueError(f"{where}.properties must be an object")
    height, cost = properties.get("height_m"), properties.get("cost")
    if height is not None:
        height = _number(height, f"{where}.properties.height_m", 0.0, MAX_HEIGHT_M)
        if height == 0.0:
            raise ValueError(f"{where}.properties.height_m must lie in (0, 100], got 0")
    if cost is not None:
        cost = _number(cost, f"{where}.properties.cost", 0.0, math.inf)
    name = properties.get("name")
    return (
        x,
        y,
        math.nan if height is None else height,
        0.0 if cost is None else cost,
        name if isinstance(name, str) else "",
    )


def _number(value: Any, name: str, low: float, high: float) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise ValueError(f"{name} must be a number, got {str(value)[:40]!r}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not (math.isfinite(number) and low <= number <= high):
        limits = f"at least {low:g}" if math.isinf(high) else f"in [{low:g}, {high:g}]"
        raise ValueError(f"{name} must be finite and {limits}, got {number:g}")
    return number


def _refuse_twins(path: Path, xy: FloatArray) -> None:
    order = np.lexsort((xy[:, 1], xy[:, 0]))
    close = np.flatnonzero(np.hypot(*np.diff(xy[order], axis=0).T) <= SAME_M)
    if close.size:
        first, second = sorted(order[close[0] : close[0] + 2].tolist())
        raise ValueError(f"{path}: features[{first}] and features[{second}] stand in one place")
