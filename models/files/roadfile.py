"""Read any road file: its name says which reader."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from models.files.centreline import read_centreline
from models.files.geojson import read_geojson
from models.files.opendrive import read_opendrive
from models.files.osm import read_osm
from models.files.sumo import read_sumo
from models.network import Edge, Lane, RoadNetwork
from models.roads import Road

# Longest first, so that .net.xml.gz is not taken for something else.
READERS: tuple[tuple[str, Callable[[Path], RoadNetwork]], ...] = (
    (".net.xml.gz", read_sumo),
    (".net.xml", read_sumo),
    (".xodr.gz", read_opendrive),
    (".xodr", read_opendrive),
    (".osm.pbf", read_osm),
    (".pbf", read_osm),
    (".osm.gz", read_osm),
    (".osm.xml", read_osm),
    (".osm", read_osm),
    (".geojson", read_geojson),
    (".json", read_geojson),
)
SUFFIXES = (".csv", ".xodr", ".net.xml[.gz]", ".osm[.pbf]", ".geojson")


def is_network_file(path: str | Path) -> bool:
    """Say whether a name is that of a format which can hold a network."""
    return str(path).lower().endswith(tuple(suffix for suffix, _ in READERS))


def read_road_file(
    path: str | Path, *, width_m: float | None = None, beside: bool = True
) -> RoadNetwork:
    """Read a network from `path`, by its suffix; a CSV is a network of one road.

    `width_m` is that of GeoJSON lines and CSV rows which do not say how wide they are.
    With `beside`, the polygons that lie beside a SUMO network are read, too.

    Raises:
        ValueError: one line that names the file: an unknown suffix, or what its reader refuses.
    """
    path = Path(path)
    name = path.name.lower()
    for suffix, read in READERS:
        if name.endswith(suffix):
            if read is read_sumo and not beside:
                return read_sumo(path, beside=False)
            if read is read_geojson and width_m is not None:
                return read_geojson(path, width_m=width_m)
            return read(path)
    if name.endswith(".csv"):
        half = 1.5 if width_m is None else 0.5 * width_m
        return network_of_road(read_centreline(path, half_width_m=half), path.stem)
    raise ValueError(f"{path}: a road file must be one of {', '.join(SUFFIXES)}, by its name")


def network_of_road(road: Road, name: str) -> RoadNetwork:
    """Wrap one road, driven forward, as a network; a closed one starts and ends at one node."""
    left, right = road.half_widths([0.0])
    lane = Lane(left_m=float(left[0]), right_m=float(right[0]), made=road)
    start = road.evaluate([0.0]).xy[0].tolist()
    nodes = {"start": (start[0], start[1])}
    end = "start"
    if not road.closed:
        last = road.evaluate([road.length_m]).xy[0].tolist()
        nodes["end"], end = (last[0], last[1]), "end"
    edge = Edge(
        name=name,
        start="start",
        end=end,
        lanes=(lane,),
        speed_mps=50.0 / 3.6,
        width_m=float(left[0] + right[0]),
        street=name,
    )
    return RoadNetwork(edges=(edge,), nodes=nodes, source="CSV", centreline=road)
