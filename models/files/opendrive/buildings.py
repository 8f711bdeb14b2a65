"""Buildings of an OpenDRIVE file: objects of that type, as outlines, boxes or circles."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from models.files.opendrive.records import RoadRecord, number
from models.geometry import FloatArray, Pose
from models.obstacles import Obstacles, obstacles_from_polygons

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

BUILDING_HEIGHT_M = 10.0
_CIRCLE = 32


def read_buildings(roads: Iterable[RoadRecord], path: str, ignored: Counter[str]) -> Obstacles:
    """Place every building along its road: (s, t) and a turn against the road's direction."""
    outlines: list[tuple[FloatArray, tuple[FloatArray, ...]]] = []
    heights: list[float] = []
    for road in roads:
        for element in road.buildings:
            where = f"{path}: road {road.id!r}"
            for corners, height in _outlines(element, road, where):
                outlines.append((corners, ()))
                heights.append(height)
    obstacles, mended, empty = obstacles_from_polygons(outlines, heights)
    ignored["buildings that crossed themselves (mended)"] += mended
    ignored["buildings that enclose nothing"] += empty
    return obstacles


def _outlines(element: Element, road: RoadRecord, where: str) -> list[tuple[FloatArray, float]]:
    at = _pose(road, number(element, "s", where), number(element, "t", where, 0.0))
    frame = at @ Pose(0.0, 0.0, number(element, "hdg", where, 0.0))
    default = number(element, "height", where, 0.0) or BUILDING_HEIGHT_M
    found = []
    single = element.findall("outline")
    for outline in single + element.findall("outlines/outline"):
        corners, height = [], 0.0
        for corner in outline:
            if corner.tag == "cornerLocal":
                uv = np.array([number(corner, "u", where), number(corner, "v", where)])
                corners.append(frame.apply(uv))
            elif corner.tag == "cornerRoad":
                foot = _pose(road, number(corner, "s", where), number(corner, "t", where))
                corners.append(np.array([foot.x_m, foot.y_m]))
            else:
                continue
            height = max(height, number(corner, "height", where, 0.0))
        if len(corners) >= 3 and outline.get("outer", "true") != "false":
            found.append((np.array(corners), height or default))
    if found:
        return found
    radius = number(element, "radius", where, 0.0)
    if radius > 0.0:
        angle = np.linspace(0.0, 2.0 * math.pi, _CIRCLE, endpoint=False)
        return [(frame.apply(radius * np.column_stack((np.cos(angle), np.sin(angle)))), default)]
    a, b = (0.5 * number(element, key, where, 0.0) for key in ("length", "width"))
    if a > 0.0 and b > 0.0:
        return [(frame.apply(np.array([[-a, -b], [a, -b], [a, b], [-a, b]])), default)]
    return []


def _pose(road: RoadRecord, s: float, t: float) -> Pose:
    """Return the place (s, t) of a road, looking along it."""
    low, high = road.line.breaks[[0, -1]].tolist()
    jet = road.line.jet(np.array([min(max(s, low), high)]))
    heading = math.atan2(jet.d1[1, 0], jet.d1[0, 0])
    x, y = (jet.r[:, 0] + road.line.origin).tolist()
    foot = Pose(x, y, heading)
    moved = foot.apply(np.array([0.0, t]))
    return Pose(float(moved[0]), float(moved[1]), heading)
