"""What an OpenDRIVE file says of one road, read and checked, before anything is computed."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from models.files.opendrive.geometry import Piece, ReferenceLine, polynomial_piece, usable
from models.parametric import Cubics

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

DRIVEN = frozenset(
    (
        *("driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "slipLane"),
        *("mwyEntry", "mwyExit", "bidirectional", "roadWorks"),
    )
)
DEFAULT_SPEED_MPS = 50.0 / 3.6
_SPEED_UNITS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704, "": 1.0}
_MOST_M = 1e7


@dataclass(frozen=True, slots=True)
class End:
    """Where a road's end leads: a road (`contact` start or end), a junction, or nowhere."""

    kind: str = ""
    element: str = ""
    contact: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class LaneRecord:
    """One lane of one section: id > 0 on the left, its width by the road's s, and its links."""

    id: int
    kind: str
    width: Cubics
    is_border: bool
    predecessor: int | None
    successor: int | None
    speed_mps: float | None
    direction: str = "standard"

    @property
    def driven(self) -> bool:
        """Whether cars use it."""
        return self.kind in DRIVEN


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """Lanes by id between two values of s."""

    s_m: float
    end_m: float
    lanes: dict[int, LaneRecord]
    single_side: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class RoadRecord:
    """One road: its reference line, its lanes, and what its ends lead to."""

    id: str
    name: str
    junction: str
    line: ReferenceLine
    offset: Cubics
    sections: tuple[Section, ...]
    before: End
    after: End
    speed_mps: float
    left_hand: bool
    kind: str = ""
    buildings: tuple[Element, ...] = field(default=(), repr=False)

    @property
    def end_m(self) -> float:
        """Return the reference line's last s."""
        return float(self.line.breaks[-1])


def read_road(element: Element, where: str, ignored: Counter[str]) -> RoadRecord | None:
    """Read a `<road>`, or return None for one without geometry.

    Raises:
        ValueError: `where` and what is wrong.
    """
    line = _reference_line(element, where, ignored)
    if line is None:
        ignored["roads without length"] += 1
        return None
    lanes = element.find("lanes")
    sections = _sections(lanes, line, where)
    link = element.find("link")
    kind, speed = _type(element)
    for tag, what in (("elevationProfile/elevation", "elevation"),
                      ("lateralProfile/superelevation", "superelevation"),
                      ("lateralProfile/shape", "road shape"),
                      ("lateralProfile/crossfall", "crossfall")):  # fmt: skip
        if any(_matters(each) for each in element.findall(tag)):
            ignored[f"roads with {what} (taken as flat)"] += 1
    ignored["signals"] += len(element.findall("signals/signal"))
    objects = element.findall("objects/object")
    buildings = tuple(each for each in objects if each.get("type") == "building")
    ignored["objects that are no buildings"] += len(objects) - len(buildings)
    return RoadRecord(
        id=element.get("id", ""),
        name=element.get("name", ""),
        junction=element.get("junction", "-1"),
        line=line,
        offset=_cubics([] if lanes is None else lanes.findall("laneOffset"), where, "s", 0.0),
        sections=sections,
        before=_end(link, "predecessor"),
        after=_end(link, "successor"),
        speed_mps=speed,
        left_hand=element.get("rule", "RHT") == "LHT",
        kind=kind,
        buildings=buildings,
    )


def number(element: Element, key: str, where: str, default: float | None = None) -> float:
    """Read an attribute as a finite number.

    Raises:
        ValueError: if it is none, or missing without a default.
    """
    text = element.get(key)
    if text is None and default is not None:
        return default
    try:
        value = float(text or "")
    except ValueError:
        raise ValueError(
            f"{where}: {element.tag} {key} must be a number, got {str(text)[:40]!r}"
        ) from None
    if not math.isfinite(value):
        raise ValueError(f"{where}: {element.tag} {key} must be finite, got {text}")
    return value


def _reference_line(element: Element, where: str, ignored: Counter[str]) -> ReferenceLine | None:
    pieces: list[Piece] = []
    view = element.find("planView")
    for geometry in [] if view is None else view.findall("geometry"):
        length = number(geometry, "length", where)
        if not usable(length):
            ignored["pieces of geometry without length"] += 1
            continue
        if length > _MOST_M:
            raise ValueError(
                f"{where}: geometry length must be at most {_MOST_M:g} m, got {length}"
            )
        base = Piece(
            s_m=number(geometry, "s", where),
            x_m=number(geometry, "x", where),
            y_m=number(geometry, "y", where),
            heading_rad=number(geometry, "hdg", where),
            length_m=length,
        )
        shape = next((each for each in geometry if each.tag in _SHAPES), None)
        if shape is None:
            found = ", ".join(each.tag for each in geometry)[:60] or "nothing"
            raise ValueError(f"{where}: geometry must be one of {', '.join(_SHAPES)}, got {found}")
        pieces.append(_shaped(base, shape, where))
    pieces.sort(key=lambda piece: piece.s_m)
    for before, after in pairwise(pieces):
        if after.s_m <= before.s_m:
            raise ValueError(f"{where}: geometry s must increase, got {after.s_m:g} twice")
    return ReferenceLine(tuple(pieces)) if pieces else None


_SHAPES = ("line", "arc", "spiral", "poly3", "paramPoly3")


def _shaped(base: Piece, shape: Element, where: str) -> Piece:
    place = (base.s_m, base.x_m, base.y_m, base.heading_rad, base.length_m)
    if shape.tag == "line":
        return base
    if shape.tag == "arc":
        return Piece(*place, number(shape, "curvature", where))
    if shape.tag == "spiral":
        start, end = number(shape, "curvStart", where), number(shape, "curvEnd", where)
        return Piece(*place, start, (end - start) / base.length_m)
    if shape.tag == "poly3":
        v = np.array([number(shape, key, where, 0.0) for key in "abcd"])
        return polynomial_piece(base, np.array([0.0, 1.0, 0.0, 0.0]), v, None, slope=True)
    u, v = (np.array([number(shape, k + axis, where, 0.0) for k in "abcd"]) for axis in "UV")
    parameter = shape.get("pRange")
    if parameter not in (None, "arcLength", "normalized"):
        raise ValueError(
            f"{where}: paramPoly3 pRange must be arcLength or normalized, got {parameter[:40]!r}"
        )
    return polynomial_piece(base, u, v, parameter)


def _sections(lanes: Element | None, line: ReferenceLine, where: str) -> tuple[Section, ...]:
    low, high = line.breaks[0], line.breaks[-1]
    elements = [] if lanes is None else lanes.findall("laneSection")
    elements.sort(key=lambda each: number(each, "s", where, 0.0))
    starts = [max(low, number(each, "s", where, 0.0)) for each in elements]
    if starts:
        starts[0] = low
    sections = []
    for element, start, end in zip(elements, starts, [*starts[1:], high], strict=True):
        if end - start <= 1e-6:
            continue
        found = {}
        for side in ("left", "right"):
            for each in element.findall(f"{side}/lane"):
                lane = _lane(each, start, where)
                if lane.id != 0:
                    found[lane.id] = lane
        single = element.get("singleSide") == "true"
        sections.append(Section(start, end, found, single))
    return tuple(sections)


def _lane(element: Element, start: float, where: str) -> LaneRecord:
    number_ = int(number(element, "id", where))
    widths, borders = element.findall("width"), element.findall("border")
    link = element.find("link")
    speeds = element.findall("speed")
    return LaneRecord(
        id=number_,
        kind=element.get("type", ""),
        width=_cubics(widths or borders, where, "sOffset", start),
        is_border=not widths and bool(borders),
        predecessor=_linked(link, "predecessor"),
        successor=_linked(link, "successor"),
        speed_mps=_speed(speeds[0]) if speeds else None,
        direction=element.get("direction", "standard"),
    )


def _linked(link: Element | None, which: str) -> int | None:
    found = None if link is None else link.find(which)
    if found is None:
        return None
    try:
        return int(found.get("id", ""))
    except ValueError:
        return None


def _cubics(elements: list[Element], where: str, key: str, start: float) -> Cubics:
    """Read `a, b, c, d` with their starts; nothing is the constant 0."""
    rows: dict[float, list[float]] = {}
    for each in elements:
        rows[start + number(each, key, where, 0.0)] = [number(each, k, where, 0.0) for k in "abcd"]
    if not rows:
        return Cubics.constant(0.0)
    places = sorted(rows)
    return Cubics(np.array(places), np.array([rows[place] for place in places]))


def _end(link: Element | None, which: str) -> End:
    found = None if link is None else link.find(which)
    if found is None:
        return End()
    return End(
        found.get("elementType", "road"), found.get("elementId", ""), found.get("contactPoint", "")
    )


def _type(element: Element) -> tuple[str, float]:
    """Return the road's first type and its speed limit."""
    kinds = element.findall("type")
    for kind in kinds:
        speed = kind.find("speed")
        value = None if speed is None else _speed(speed)
        if value is not None:
            return kinds[0].get("type", ""), value
    return (kinds[0].get("type", "") if kinds else ""), DEFAULT_SPEED_MPS


def _speed(element: Element) -> float | None:
    """Return a `max` in m/s; None for "no limit", "undefined" and what is no speed."""
    try:
        value = float(element.get("max", "")) * _SPEED_UNITS[element.get("unit", "")]
    except (ValueError, KeyError):
        return None
    return value if 0.1 < value < 200.0 else None


def _matters(element: Element) -> bool:
    """Say whether a profile's row is anything but zero (and is a number at all)."""
    for key in "abcd":
        try:
            if float(element.get(key, "0")) != 0.0:
                return True
        except ValueError:
            return True
    return element.tag == "shape"
