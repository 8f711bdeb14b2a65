"""What OpenStreetMap tags say of streets and buildings: lanes, directions, widths, speeds, heights.

Defaults by class follow the wiki's "Key:highway", "Key:lanes", "Key:oneway" and "Key:maxspeed".
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

Tags = Mapping[str, str]

LEVEL_M = 3.0
BUILDING_HEIGHT_M = 10.0
_KMH = 1.0 / 3.6
_UNITS = {
    "": 1.0, "m": 1.0, "metres": 1.0, "meters": 1.0, "km": 1000.0, "ft": 0.3048, "'": 0.3048,
    "cm": 0.01,
}  # fmt: skip

# class: speed (km/h), lanes in both directions, lane width (m)
_CLASSES: Mapping[str, tuple[float, int, float]] = {
    "motorway": (120.0, 4, 3.5),
    "motorway_link": (60.0, 2, 3.5),
    "trunk": (100.0, 2, 3.5),
    "trunk_link": (60.0, 2, 3.5),
    "primary": (70.0, 2, 3.25),
    "primary_link": (50.0, 2, 3.25),
    "secondary": (50.0, 2, 3.25),
    "secondary_link": (50.0, 2, 3.25),
    "tertiary": (50.0, 2, 3.0),
    "tertiary_link": (50.0, 2, 3.0),
    "unclassified": (50.0, 2, 3.0),
    "residential": (50.0, 2, 3.0),
    "living_street": (15.0, 2, 2.5),
    "service": (20.0, 2, 2.5),
    "road": (50.0, 2, 3.0),
}
_CLOSED = frozenset(("no", "private", "agricultural", "forestry", "delivery", "emergency"))
_NOT_BUILDINGS = frozenset(("no", "roof", "carport", "collapsed", "demolished", "construction"))


@dataclass(frozen=True, slots=True)
class Carriageways:
    """What a street is like: lanes each way, the width of all of them, m/s."""

    forward: int
    backward: int
    width_m: float
    speed_mps: float
    kind: str
    shared: bool


def is_street(tags: Tags) -> bool:
    """Say whether cars drive on it at all (whether they may is `closed_to_cars`)."""
    return tags.get("highway", "") in _CLASSES and tags.get("area") != "yes"


def closed_to_cars(tags: Tags) -> bool:
    """Say whether the public may not drive here: the most specific key decides."""
    for key in ("motorcar", "motor_vehicle", "vehicle", "access"):
        if key in tags:
            return tags[key] in _CLOSED
    return False


def street_of(tags: Tags) -> Carriageways:
    """Read lanes, direction, width and speed of a street.

    `oneway`, or a roundabout or motorway, says which way; `lanes`, `lanes:forward` and
    `lanes:backward` how many; `width` (or `est_width`) how wide all lanes are together. A two-way
    street of one lane is `shared`. What is missing or no number is its class's default.
    """
    kind = tags.get("highway", "road")
    speed, lanes, lane_width = _CLASSES.get(kind, _CLASSES["road"])
    way = tags.get("oneway", "").lower()
    circle = tags.get("junction") in ("roundabout", "circular")
    implied = circle or kind in ("motorway", "motorway_link")
    one_way = way in ("yes", "1", "true", "-1", "reverse") or (implied and way not in ("no", "0"))
    total = _count(tags.get("lanes"))
    ahead, back = _count(tags.get("lanes:forward")), _count(tags.get("lanes:backward"))
    shared = False
    if one_way:
        forward, backward = total or ahead or max(1, lanes // 2), 0
    elif ahead and back:
        forward, backward = ahead, back
    elif total and (ahead or back):
        forward = ahead or max(1, total - (back or 0))
        backward = back or max(1, total - forward)
    elif total == 1:
        forward = backward = 1
        shared = True
    else:
        total = total or lanes
        backward = max(1, total // 2)
        forward = max(1, total - backward)
    if way in ("-1", "reverse"):
        forward, backward = 0, forward
    width = length_m(tags.get("width")) or length_m(tags.get("est_width"))
    n = 1 if shared else forward + backward
    if width is None or not 2.0 <= width <= 100.0:
        width = n * lane_width
    return Carriageways(
        forward, backward, width, speed_mps(tags.get("maxspeed")) or speed * _KMH, kind, shared
    )


def is_building(tags: Tags) -> bool:
    """Say whether it stands in the way of a look."""
    return tags.get("building", "no") not in _NOT_BUILDINGS


def building_height_m(tags: Tags, default: float = BUILDING_HEIGHT_M) -> float:
    """Return how high it stands: `height`, else 3 m a level, else the default."""
    for key in ("height", "building:height", "est_height", "height_m"):
        height = length_m(tags.get(key))
        if height is not None and 0.0 < height < 1000.0:
            return height
    for key in ("building:levels", "levels"):
        levels = length_m(tags.get(key))
        if levels is not None and 0.0 < levels < 300.0:
            roof = length_m(tags.get("roof:levels"))
            return LEVEL_M * (levels + (roof if roof is not None and 0.0 < roof < 20.0 else 0.0))
    return default


def length_m(text: str | None) -> float | None:
    """Read a length: metres unless it says otherwise; `12`, `12.5 m`, `7,5`, `24'`, `6'6"`."""
    if text is None:
        return None
    words = text.strip().lower().replace(",", ".")
    feet = re.fullmatch(r"(\d+)'\s*(?:(\d+(?:\.\d+)?)\")?", words)
    if feet:
        return 0.3048 * int(feet[1]) + 0.0254 * float(feet[2] or 0.0)
    plain = re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?)\s*([a-z]*)", words)
    if not plain or plain[2] not in _UNITS:
        return None
    return float(plain[1]) * _UNITS[plain[2]]


def speed_mps(text: str | None) -> float | None:
    """Read a speed: km/h unless it says mph or knots; words (`walk`, `none`, `DE:urban`) give None.

    Of several (`50;30`) the first counts.
    """
    if text is None:
        return None
    found = re.match(r"\s*(\d{1,3}(?:\.\d+)?)\s*(mph|knots|km/h|kmh|kph)?\s*(?:;|$)", text.lower())
    if not found:
        return None
    scale = {"mph": 0.44704, "knots": 0.514444}.get(found[2] or "", _KMH)
    speed = float(found[1]) * scale
    return speed if speed > 0.5 else None


def _count(text: str | None) -> int | None:
    """Read a number of lanes; `1.5` is 1, what is no number or beyond 16 is None."""
    if text is None:
        return None
    found = re.match(r"\s*(\d{1,2})(?:\.\d+)?\s*(?:;|$)", text)
    count = int(found[1]) if found else 0
    return count if 1 <= count <= 16 else None
