"""Bends whose curvature never jumps: clothoid in, arc, clothoid out, in the place of plain arcs.

A bend of radius ρ with clothoids of length c meets the same two lines as a plain arc of radius
ρ + p about the same centre, if the clothoids may start t before the arc would: with (x, y) the end
of a clothoid from curvature 0 to 1/ρ and τ = c/(2ρ) its turn, p = y + ρ cos τ − ρ (the shift) and
t = x − ρ sin τ. So a road of lines and arcs of radius ρ + p with straights long enough becomes a
road of lines, clothoids and arcs in closed form; between its two lines it lies outside the circle ρ
and inside the circle ρ + p (Fraichard & Scheuer 2004 turn in the same way).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from models.curves import clothoid_displacement
from models.roads import Piece

_NOTHING_M = 1e-9  # a piece this short is none


@dataclass(frozen=True, slots=True)
class Bend:
    """Say how sharp bends are: `radius_m` ρ, clothoids `clothoid_m` c; 0 for plain arcs.

    `shift_m` p is how much wider the arc is that this bend replaces, `lead_m` t how long before
    that arc it begins.
    """

    radius_m: float
    clothoid_m: float = 0.0
    shift_m: float = field(init=False, default=0.0)
    lead_m: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        """Work out the shift and the lead once."""
        if self.clothoid_m:
            x, y = _end(self.clothoid_m, 1.0 / self.radius_m)
            turn = 0.5 * self.clothoid_m / self.radius_m
            shift = y + self.radius_m * math.cos(turn) - self.radius_m
            object.__setattr__(self, "shift_m", shift)
            object.__setattr__(self, "lead_m", x - self.radius_m * math.sin(turn))

    @property
    def wide_m(self) -> float:
        """The radius of the arc that this bend replaces, ρ + p."""
        return self.radius_m + self.shift_m


def join_pieces(pieces: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Join (length, curvature) neighbours on one line or circle; drop what has no length."""
    joined: list[tuple[float, float]] = []
    for length, curvature in pieces:
        if length <= _NOTHING_M:
            continue
        if joined and joined[-1][1] == curvature:
            length += joined.pop()[0]
        joined.append((length, curvature))
    return joined


def with_clothoids(
    pieces: Sequence[tuple[float, float]], bends: Sequence[Bend]
) -> tuple[Piece, ...] | None:
    """Replace each arc of the joined (length, curvature) pieces by its bend; None if none fits.

    An arc's radius must be the `wide_m` of one of `bends`. A turn smaller than the two clothoids
    take becomes two clothoids of the same sharpness that meet at less curvature.
    """
    shortened = [length for length, _ in pieces]
    made: list[list[Piece]] = []
    for n, (length, curvature) in enumerate(pieces):
        if curvature == 0.0:
            made.append([])
            continue
        bend = min(bends, key=lambda b: abs(b.wide_m - 1.0 / abs(curvature)))
        parts, lead = _bend(bend, length * abs(curvature), math.copysign(1.0, curvature))
        made.append(parts)
        for other in (n - 1, n + 1):
            if not 0 <= other < len(pieces) or pieces[other][1] != 0.0:
                return None  # an arc that meets an arc: no room for clothoids
            shortened[other] -= lead
    road: list[Piece] = []
    for n, (_, curvature) in enumerate(pieces):
        if curvature != 0.0:
            road += made[n]
        elif shortened[n] < -_NOTHING_M:
            return None
        elif shortened[n] > _NOTHING_M:
            road.append(Piece(shortened[n]))
    return tuple(road)


def _bend(bend: Bend, turn: float, side: float) -> tuple[list[Piece], float]:
    """Return clothoid, arc, clothoid for a turn, and how much of the lines before and after go."""
    c, top = bend.clothoid_m, side / bend.radius_m
    arc = bend.radius_m * turn - c
    lead = bend.lead_m
    if arc < 0.0:
        # sharpness top/c kept: κ = c' top/c and κ c' = turn
        shorter = math.sqrt(turn * bend.radius_m * c)
        top *= shorter / c
        c, arc = shorter, 0.0
        x, y = _end(c, abs(top))
        lead = x + (y - bend.wide_m) * math.tan(0.5 * turn)
    parts = [Piece(c, 0.0, top)]
    if arc > _NOTHING_M:
        parts.append(Piece(arc, top, top))
    return [*parts, Piece(c, top, 0.0)], lead


def _end(length: float, curvature: float) -> tuple[float, float]:
    x, y = clothoid_displacement(np.array([length]), np.zeros(1), np.array([curvature / length]))
    return float(x[0]), float(y[0])
