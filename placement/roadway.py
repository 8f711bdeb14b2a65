"""Where cars drive: one road, or the streets of a network with drives over them."""

from __future__ import annotations

import warnings
from functools import lru_cache
from pathlib import Path

import numpy as np

from models.drives import (
    Route,
    all_streets,
    demanded_routes,
    drive_road,
    read_demand,
    sample_routes,
)
from models.files.centreline import read_centreline
from models.files.roadfile import SUFFIXES, is_network_file, network_of_road, read_road_file
from models.georeference import Georeference
from models.network import RoadNetwork
from models.obstacles import Obstacles
from models.roads import Piece, Road, road_from_pieces
from placement.instance import Instance

STREETS = "streets"  # the journey over all streets, which jumps from one to the next


def build_road(instance: Instance) -> Road:
    """Make the road of `[road]`: pieces, a file's one road, or all streets of a network in a row.

    Raises:
        ValueError: one line that names the field or the file, and what is wrong.
    """
    section = instance.road
    if section.pieces is not None:
        pieces = [Piece(piece.length, *piece.curvature) for piece in section.pieces]
        try:
            return road_from_pieces(pieces, width_m=section.width_m, closed=section.closed is True)
        except ValueError as error:
            raise ValueError(f"road.pieces: {error}") from None
    if section.constructed is not None:
        from placement.constructed import constructed_road

        return constructed_road(instance)
    network = network_of(instance)
    if network is not None:
        return all_streets(network)
    whole = file_network(instance)
    if whole is not None and whole.centreline is not None:
        return whole.centreline
    return _centreline(instance)


def network_of(instance: Instance) -> RoadNetwork | None:
    """Return the network that cameras are placed on, or None where there is one road.

    A file that holds one road is that road, unless `[traffic]` asks for drives over it.

    Raises:
        ValueError: if `[traffic]` is given without a file, or `objective.drives` with a network.
    """
    traffic = "traffic" in instance.document.model_fields_set
    network = file_network(instance)
    if network is None and traffic:
        if "road.file" not in instance.files:
            raise ValueError("traffic must be left out without road.file: use objective.drives")
        network = network_of_road(_centreline(instance), instance.files["road.file"].stem)
    if network is None or (network.centreline is not None and not traffic):
        return None
    if instance.objective.drives is not None:
        raise ValueError(
            "objective.drives must be left out for a network of streets: [traffic] says who drives"
        )
    return network


def file_network(instance: Instance) -> RoadNetwork | None:
    """Return what `road.file` holds, if it is of a format for networks (read once)."""
    path = instance.files.get("road.file")
    if path is None or not is_network_file(path):
        return None
    status = path.stat()
    width = instance.road.width_m if "width_m" in instance.road.model_fields_set else None
    beside = "road.buildings" in instance.files
    return _read(path, status.st_mtime_ns, status.st_size, width, beside)


def file_obstacles(instance: Instance) -> Obstacles:
    """Return the buildings that `road.file` holds, or that lie beside it."""
    network = file_network(instance)
    return Obstacles() if network is None else network.obstacles


def georeference_of(instance: Instance) -> Georeference:
    """Return how the road's frame lies in the coordinates of `road.file`."""
    network = file_network(instance)
    return Georeference() if network is None else network.georeference


def network_drives(instance: Instance, network: RoadNetwork) -> list[tuple[str, Road, float]]:
    """Return name, road and weight of each drive over a network.

    `localisation` without `[traffic]` is about all streets alike; everything else about the
    fastest routes between random places, or of `traffic.demand`.

    Raises:
        ValueError: for a demand that the network cannot serve at all, naming the file.
    """
    if _about_streets(instance):
        return [(STREETS, all_streets(network), 1.0)]
    routes = build_routes(instance, network)
    return [(f"drive-{n}", drive_road(network, r), r.weight) for n, r in enumerate(routes)]


def nobody_drives(instance: Instance) -> bool:
    """Whether the objective is about all streets of a network alike, which nobody drives."""
    return _about_streets(instance) and network_of(instance) is not None


def _about_streets(instance: Instance) -> bool:
    given = "traffic" in instance.document.model_fields_set
    return instance.objective.kind == "localisation" and not given


def build_routes(instance: Instance, network: RoadNetwork) -> list[Route]:
    """Choose the routes of `[traffic]`."""
    section = instance.document.traffic
    rng = np.random.default_rng(section.seed)
    path = instance.files.get("traffic.demand")
    if path is None:
        return sample_routes(network, section.drives, rng)
    drives = section.drives if "drives" in section.model_fields_set else None
    try:
        routes, lost = demanded_routes(network, read_demand(path), rng, drives)
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith(str(path)) else f"{path}: {text}") from None
    if lost:
        warnings.warn(f"{path}: no route serves {lost} of the demands", stacklevel=2)
    return routes


def _centreline(instance: Instance) -> Road:
    section, path = instance.road, instance.files["road.file"]
    try:
        return read_centreline(path, closed=section.closed, half_width_m=0.5 * section.width_m)
    except ValueError as error:
        if path.suffix.lower() == ".csv":
            raise
        known = f"{', '.join(SUFFIXES)} tell other formats by their names"
        raise ValueError(f"{error} (read as CSV: {known})") from None


@lru_cache(maxsize=2)
def _read(
    path: Path, _changed_ns: int, _bytes: int, width_m: float | None, beside: bool
) -> RoadNetwork:
    network = read_road_file(path, width_m=width_m, beside=beside)
    said = [f"{count:,} {what}" for what, count in sorted(network.ignored.items()) if count]
    if said:
        warnings.warn(f"{path}: left out or mended: {'; '.join(said)}", stacklevel=3)
    if network.parts > 1:
        warnings.warn(f"{path}: the streets fall into {network.parts} parts", stacklevel=3)
    return network
