"""Write GeoJSON in a file's own coordinates, named so that other programs find the system."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from models.files.geojson import LOCAL
from models.geometry import FloatArray
from models.georeference import LONGITUDE_LATITUDE, Georeference, parse_crs
from models.shadows import Piece

_DEGREES, _METRES = 9, 4  # decimals: a tenth of a millimetre


def feature(
    kind: str, points: FloatArray, where: Georeference, properties: Mapping[str, Any]
) -> dict[str, Any]:
    """Return a Point, LineString or Polygon of points (n, 2) in the file's coordinates."""
    rounded = np.round(points, _METRES if _is_metres(where) else _DEGREES).tolist()
    coordinates: Any = rounded
    if kind == "Point":
        coordinates = rounded[0]
    elif kind == "Polygon":
        coordinates = [rounded]
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": dict(properties),
    }


def area_feature(
    pieces: Sequence[Piece], where: Georeference, properties: Mapping[str, Any]
) -> dict[str, Any]:
    """Return a Polygon, or a MultiPolygon of several pieces, given in the road's frame."""
    digits = _METRES if _is_metres(where) else _DEGREES
    areas = []
    for piece in pieces:
        rings = [np.vstack((ring, ring[:1])) for ring in (piece.outline, *piece.holes)]
        areas.append([np.round(where.to_file(ring), digits).tolist() for ring in rings])
    single = len(areas) == 1
    return {
        "type": "Feature",
        "geometry": {
            "type": "Polygon" if single else "MultiPolygon",
            "coordinates": areas[0] if single else areas,
        },
        "properties": dict(properties),
    }


def collection(features: Iterable[Mapping[str, Any]], where: Georeference) -> dict[str, Any]:
    """Return a FeatureCollection, with the member `crs` unless it is longitude and latitude."""
    found: dict[str, Any] = {"type": "FeatureCollection"}
    if where.file_crs != LONGITUDE_LATITUDE:
        found["crs"] = {"type": "name", "properties": {"name": crs_name(where)}}
    found["features"] = list(features)
    return found


def crs_name(where: Georeference) -> str:
    """Return a name that PROJ reads back: `EPSG:…` where there is one, else the file's own text."""
    if where.file_crs is None:
        return LOCAL
    authority = parse_crs(where.file_crs, "crs").to_authority(min_confidence=100)
    return where.file_crs if authority is None else ":".join(authority)


def _is_metres(where: Georeference) -> bool:
    return where.file_crs is None or not parse_crs(where.file_crs, "crs").is_geographic
