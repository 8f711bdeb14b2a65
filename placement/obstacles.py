"""The buildings of an instance: `[obstacles]` as prisms in the road's frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from models.georeference import Georeference
from models.obstacles import Obstacles, obstacles_from_polygons
from placement.instance import Instance

SUFFIXES = (".geojson", ".json", ".poly.xml", ".poly.xml.gz")


def build_obstacles(instance: Instance, georeference: Georeference | None = None) -> Obstacles:
    """Gather `obstacles.polygons`, all `obstacles.height_m` high, and those of `obstacles.file`.

    A file is GeoJSON, or SUMO's polygons; it may give each building its own height. `georeference`
    is that of the road: without one, coordinates are metres of the road's frame.

    Raises:
        ValueError: one line that names the file and what is wrong.
    """
    section = instance.obstacles
    outlines = [(np.array(polygon, dtype=np.float64), ()) for polygon in section.polygons]
    given, _, _ = obstacles_from_polygons(outlines, np.full(len(outlines), section.height_m))
    path = instance.files.get("obstacles.file")
    if path is None:
        return given
    read = _read(path, section.height_m, georeference or Georeference())
    return Obstacles((*given.rings, *read.rings), np.concatenate([given.height_m, read.height_m]))


def _read(path: Path, height_m: float, georeference: Georeference) -> Obstacles:
    name = path.name.lower()
    if name.endswith((".geojson", ".json")):
        from models.files.geojson import read_geojson_obstacles

        return read_geojson_obstacles(path, georeference)
    if name.endswith((".poly.xml", ".poly.xml.gz")):
        from models.files.sumo import read_sumo_polygons

        return read_sumo_polygons(path, height_m)
    raise ValueError(f"obstacles.file must be one of {', '.join(SUFFIXES)}, got {path}")
