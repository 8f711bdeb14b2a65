"""The road of `[road.construct]`: what it is built on, which roads there are, the one chosen."""

from __future__ import annotations

import math
from collections.abc import Callable

from models.construction.search import ARCS, CLOTHOIDS, BuiltRoad, Construction, build_roads
from models.construction.site import Site, make_site
from models.geometry import Pose
from models.roads import Piece, Road, road_from_pieces
from placement.instance import Instance
from placement.instance.road_schema import ConstructSection
from placement.obstacles import build_obstacles

NAME = "road.construct"


def constructed_road(instance: Instance) -> Road:
    """Return the road of `road.construct.pieces`, or where none is chosen yet the shortest.

    Raises:
        ValueError: one line: what is wrong with the site, why there is no road, or that the
            pieces do not lead to the goal.
    """
    section = section_of(instance)
    if section.pieces is None:
        return roads_of(instance).roads[0].road()
    start, goal = _pose(section.start), _pose(section.goal)
    pieces = [Piece(piece.length, *piece.curvature) for piece in section.pieces]
    road = road_from_pieces(pieces, width_m=instance.road.width_m, start=start)
    end = road.evaluate([road.length_m])
    miss = math.hypot(end.x_m[0] - goal.x_m, end.y_m[0] - goal.y_m)
    turn = abs(math.remainder(float(end.heading_rad[0]) - goal.heading_rad, math.tau))
    if miss > 1e-3 or turn > 1e-3:
        raise ValueError(
            f"{NAME}.pieces must lead from start to goal, got one that misses it by {miss:.3g} m "
            f"and {math.degrees(turn):.3g}°"
        )
    return road


def roads_of(
    instance: Instance,
    progress: Callable[[str, float | None], None] = lambda _text, _fraction: None,
) -> Construction:
    """Find the roads that `[road.construct]` allows.

    Raises:
        ValueError: one line: what is wrong with the site, or why there is no road.
    """
    section = section_of(instance)
    found = build_roads(
        site_of(instance),
        min_radius_m=section.min_radius_m,
        width_m=instance.road.width_m,
        radius_factors=section.radius_factors,
        kinds={"arcs": (ARCS,), "clothoids": (CLOTHOIDS,), "both": (ARCS, CLOTHOIDS)}[
            section.bends
        ],
        clothoid_m=section.clothoid_m,
        length_factor=section.length_factor,
        time_limit_s=section.time_limit_s,
        progress=progress,
    )
    if not found.roads:
        raise ValueError(f"{NAME}: there is no road: {found.reason}")
    return found


def site_of(instance: Instance) -> Site:
    """Return the site: the construct's obstacles, then those of `[obstacles]`."""
    section = section_of(instance)
    own, others = len(section.obstacles), len(instance.obstacles.polygons)
    names = [
        *(f"{NAME}.obstacles[{n}]" for n in range(own)),
        *(f"obstacles.polygons[{n}]" for n in range(others)),
    ]
    rings: list[object] = [*section.obstacles, *instance.obstacles.polygons]
    if "obstacles.file" in instance.files:
        beside = instance.changed({"road.construct.obstacles": [], "obstacles.polygons": []})
        buildings = build_obstacles(beside).rings
        rings += buildings
        names += [f"obstacles.file, building {n}" for n in range(len(buildings))]
    return make_site(
        _pose(section.start),
        _pose(section.goal),
        rings,  # type: ignore[arg-type]
        clearance_m=section.clearance_m,
        width_m=instance.road.width_m,
        name=NAME,
        names=names,
    )


def section_of(instance: Instance) -> ConstructSection:
    """Return `[road.construct]`.

    Raises:
        ValueError: if the instance has none.
    """
    if instance.road.constructed is None:
        raise ValueError(f"{NAME} must be given, got a road of pieces or a file")
    return instance.road.constructed


def with_road(instance: Instance, road: BuiltRoad) -> Instance:
    """Return the instance with `road` chosen: its pieces in `road.construct.pieces`."""
    pieces = [
        {"length": piece.length_m, "curvature": [piece.curvature_start, piece.curvature_end]}
        for piece in road.pieces
    ]
    return instance.changed({"road.construct.pieces": pieces})


def _pose(given: tuple[float, float, float]) -> Pose:
    return Pose(given[0], given[1], math.radians(given[2]))
