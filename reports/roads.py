"""`placement roads FILE`: what a road file holds, in words, as a map, or as GeoJSON."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from models.geometry import FloatArray
    from models.network import RoadNetwork
    from placement.atomic import Content

_FIGURES = (".png", ".svg")
_STEP_M = 1.0
_INCHES = 9.0


def register(app: typer.Typer) -> None:
    """Add `roads` to the command line."""
    app.command()(roads)


def roads(
    file: Annotated[
        Path, typer.Argument(help="A .csv, .xodr, .net.xml[.gz], .osm[.pbf], .geojson.")
    ],
    out: Annotated[
        Path | None, typer.Option(help="A map (.png, .svg), or what was read (.geojson).")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No summary.")] = False,
) -> None:
    """Tell what a road file holds, as the importer reads it, and draw it."""
    from models.files.roadfile import read_road_file
    from placement.atomic import write_files

    if out is not None and out.suffix.lower() not in (*_FIGURES, ".geojson"):
        raise ValueError(f"--out must end in {', '.join(_FIGURES)} or .geojson, got {out.name!r}")
    network = read_road_file(file)
    if not quiet:
        for line in describe(network, file.name):
            typer.echo(line)
    if out is None:
        return
    if out.suffix.lower() == ".geojson":
        write_files(out.parent, {out.name: json.dumps(as_geojson(network)) + "\n"})
    else:
        write_files(out.parent, {out.name: draw(network, file.name, out.suffix.lower()[1:])})
    if not quiet:
        typer.echo(f"written to {out}")


def describe(network: RoadNetwork, name: str) -> Iterator[str]:
    """Yield lines: size, lengths, curvature, lanes, buildings, coordinates, what was left out."""
    import numpy as np

    edges = network.edges
    points = network.sample(_STEP_M).points
    lanes = np.array([len(edge.lanes) for edge in edges])
    widths = np.array([edge.width_m for edge in edges])
    speeds = 3.6 * np.array([edge.speed_mps for edge in edges])
    lengths = np.array([edge.length_m for edge in edges])
    parts = "" if network.parts == 1 else f", in {network.parts} parts"
    yield (
        f"{name}: {network.source}, {len(edges):,} carriageways between {len(network.nodes):,} "
        f"nodes{parts}, {len(network.turns):,} turns"
    )
    own = [edge.stated_length_m or edge.length_m for edge in edges]
    streets = {edge.street or edge.name: length for edge, length in zip(edges, own, strict=True)}
    yield (
        f"length: {_km(network.length_m)} of carriageways, one lane each, between junctions; "
        f"by the file's own figures {_km(sum(own))}, on {_km(sum(streets.values()))} of streets"
    )
    yield f"lanes: {_km(float(lengths @ lanes))}, {_span(lanes)} a carriageway"
    tightest = max(abs(float(points.curvature.min())), abs(float(points.curvature.max())))
    radius = "all straight" if tightest < 1e-9 else f"tightest radius {1.0 / tightest:.3g} m"
    yield (
        f"curvature: {points.curvature.min():.4g} to {points.curvature.max():.4g} 1/m, every "
        f"{_STEP_M:g} m ({radius})"
    )
    yield f"carriageways: width {_span(widths)} m; speed {_span(speeds)} km/h"
    if network.centreline is not None:
        yield f"one road: its line of {_km(network.centreline.length_m)} is the path of an instance"
    if len(network.obstacles):
        yield (f"buildings: {len(network.obstacles):,}, {_span(network.obstacles.height_m)} m high")
    crs = network.georeference.file_crs
    yield f"coordinates: {'metres of a frame of their own' if crs is None else crs}"
    yield from network.notes
    left = [f"{count:,} {what}" for what, count in sorted(network.ignored.items()) if count]
    yield f"left out or mended: {'; '.join(left) or 'nothing'}"


def draw(network: RoadNetwork, name: str, kind: str) -> Content:
    """Draw carriageways as wide as they are, turns, and buildings; `kind` is png or svg."""
    import numpy as np
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.figure import Figure

    from reports.style import BLACK, BLUE, GREY, saved, style

    with style():
        figure = Figure(figsize=(_INCHES, _INCHES))
        axes = figure.subplots()
        lines = [edge.lanes[0].outline for edge in network.edges]
        if len(network.obstacles):
            axes.add_collection(
                PolyCollection(list(network.obstacles.rings), facecolors=GREY, alpha=0.4)
            )
        turns = [turn.path.outline for turn in network.turns if turn.path is not None]
        axes.add_collection(LineCollection(turns, colors=GREY, linewidths=0.4))
        axes.add_collection(LineCollection(lines, colors=BLUE, linewidths=_width(network)))
        places = np.array(list(network.nodes.values()), dtype=np.float64).reshape(-1, 2)
        if len(places) <= 200:
            axes.plot(*places.T, ".", color=BLACK, markersize=4)
        axes.autoscale_view()
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("east x (m)")
        axes.set_ylabel("north y (m)")
        axes.set_title(
            f"{name}: {_km(network.length_m)} of carriageways, "
            f"{len(network.obstacles):,} buildings".replace("$", r"\$")
        )
    return saved(figure, kind)


def as_geojson(network: RoadNetwork) -> dict[str, Any]:
    """Return carriageways and buildings as GeoJSON in the file's own coordinates."""
    from models.files.geojson_out import collection, feature

    where, edges = network.georeference, network.edges
    features = []
    for edge in edges:
        line = where.to_file(edge.lanes[0].outline)
        features.append(
            feature(
                "LineString",
                line,
                where,
                {
                    "id": edge.name,
                    "from": edge.start,
                    "to": edge.end,
                    "oneway": True,
                    "lanes": len(edge.lanes),
                    "width_m": round(edge.width_m, 3),
                    "speed_mps": round(edge.speed_mps, 3),
                    "length_m": round(edge.length_m, 3),
                },
            )
        )
    # Turns, too, so that whoever reads this back finds the carriageways connected.
    for turn in network.turns:
        if turn.path is not None:
            about = {"turn": True, "oneway": True, "lanes": 1, "from": edges[turn.from_edge].name}
            line = where.to_file(turn.path.outline)
            features.append(feature("LineString", line, where, about))
    for ring, height in zip(network.obstacles.rings, network.obstacles.height_m, strict=True):
        corners = where.to_file(_closed(ring))
        features.append(feature("Polygon", corners, where, {"height_m": float(height)}))
    return collection(features, where)


def _closed(ring: FloatArray) -> FloatArray:
    import numpy as np

    return np.vstack((ring, ring[:1]))


def _width(network: RoadNetwork) -> float:
    """Return a line width in points: the middle width's own on paper, if that can be seen."""
    import numpy as np

    places = np.vstack([edge.lanes[0].outline for edge in network.edges])
    across = max(float(np.ptp(places, axis=0).max()), 1.0)
    middle = float(np.median([edge.width_m for edge in network.edges]))
    return min(max(72.0 * 0.8 * _INCHES * middle / across, 0.4), 8.0)


def _km(length_m: float) -> str:
    return f"{length_m / 1000.0:,.3f} km" if length_m < 1e5 else f"{length_m / 1000.0:,.1f} km"


def _span(values: Any) -> str:
    low, high = float(min(values)), float(max(values))
    return f"{low:.3g}" if low == high else f"{low:.3g}–{high:.3g}"
