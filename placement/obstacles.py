"""The buildings of an instance: `[obstacles]` as prisms in the road's frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from models.georeference import Georeference
from models.obstacles import Obstacles, obstacles_from_polygons
from placement.instance import Instance
from placement.roadway import file_obstacles, georeference_of

SUFFIXES = (".geojson", ".json", ".poly.xml", ".poly.xml.gz")


def build_obstacles(instance: Instance) -> Obstacles:
    """Gather the buildings of `road.file`, `obstacles.*` and `road.construct.obstacles`.

    Polygons are all `obstacles.height_m` high. A file is GeoJSON, or SUMO's polygons; it may give
    each building its own height. Its coordinates are those of the road's file where that lies on
    the Earth, else metres of the road's frame.

    Raises:
        ValueError: one line that names the file and what is wrong.
    """
    section = instance.obstacles
    construct = instance.road.constructed
    polygons = (*section.polygons, *(construct.obstacles if construct is not None else ()))
    outlines = [(np.array(polygon, dtype=np.float64), ()) for polygon in polygons]
    given, _, _ = obstacles_from_polygons(outlines, np.full(len(outlines), section.height_m))
    parts = [file_obstacles(instance), given]
    path = instance.files.get("obstacles.file")
    if path is not None:
        parts.append(_read(path, section.height_m, georeference_of(instance)))
    return Obstacles(
        tuple(ring for part in parts for ring in part.rings),
        np.concatenate([part.height_m for part in parts]),
    )


def _read(path: Path, height_m: float, georeference: Georeference) -> Obstacles:
    name = path.name.lower()
    if name.endswith((".geojson", ".json")):
        from models.files.geojson import read_geojson_obstacles

        return read_geojson_obstacles(path, georeference)
    if name.endswith((".poly.xml", ".poly.xml.gz")):
        from models.files.sumo import read_sumo_polygons

        return read_sumo_polygons(path, height_m)
    raise ValueError(f"obstacles.file must be one of {', '.join(SUFFIXES)}, got {path}")
