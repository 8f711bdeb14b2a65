"""The plan view of an OpenDRIVE road: line, arc, spiral, poly3 and paramPoly3 by their formulas.

Sources: ASAM OpenDRIVE 1.8, sections 9.3–9.7. A piece starts at (x, y, hdg) in the file, whatever
the one before it ended at; how well they meet is `Joints`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from models.curves import clothoid_displacement
from models.geometry import FloatArray, wrap_angle
from models.parametric import Jet

_LEAST_M = 1e-9
_POLY3_TABLE = 64


class Joints(NamedTuple):
    """Hold how far pieces miss their successors: metres and radians, each (n − 1,)."""

    gap_m: FloatArray
    turn_rad: FloatArray


@dataclass(frozen=True, slots=True)
class Piece:
    """One `<geometry>`: where it starts on the road and in the plane, and its shape.

    Spirals (lines and arcs among them) have `curvature` and `rate`; polynomials have `u` and `v`
    (4,), constant first, by the parameter p = scale·(s − s_start). `slope` marks poly3, whose
    parameter is u itself, found from the arc length.
    """

    s_m: float
    x_m: float
    y_m: float
    heading_rad: float
    length_m: float
    curvature: float = 0.0
    rate: float = 0.0
    u: FloatArray | None = None
    v: FloatArray | None = None
    scale: float = 1.0
    slope: bool = False


class _Local(NamedTuple):
    """Hold a piece's own coordinates and derivatives by s, each (2, t)."""

    r: FloatArray
    d1: FloatArray
    d2: FloatArray
    d3: FloatArray


@dataclass(frozen=True, slots=True)
class ReferenceLine:
    """Be the path of all `pieces` by the road's s, from `pieces[0].s_m` to the last one's end.

    Coordinates are relative to (`x_m`, `y_m`), the start of the first piece.
    """

    pieces: tuple[Piece, ...]

    @property
    def breaks(self) -> FloatArray:
        """Return where pieces start, and the end."""
        last = self.pieces[-1]
        return np.array([*(piece.s_m for piece in self.pieces), last.s_m + last.length_m])

    @property
    def origin(self) -> FloatArray:
        """Return where the first piece starts, (2,)."""
        return np.array([self.pieces[0].x_m, self.pieces[0].y_m])

    def jet(self, w: FloatArray) -> Jet:
        """Return position and three derivatives by s at s (t,)."""
        s = np.asarray(w, dtype=np.float64)
        starts = np.array([piece.s_m for piece in self.pieces])
        which = np.clip(np.searchsorted(starts, s, side="right") - 1, 0, len(starts) - 1)
        out = np.zeros((4, 2, len(s)))
        for i in np.unique(which):
            rows = which == i
            out[:, :, rows] = self._placed(self.pieces[i], s[rows] - starts[i])
        return Jet(*out)

    def joints(self) -> Joints:
        """Return how far each piece's end misses the next one's start."""
        gaps, turns = [], []
        for before, after in zip(self.pieces, self.pieces[1:], strict=False):
            end = self._placed(before, np.array([before.length_m]))
            start = self._placed(after, np.zeros(1))
            gaps.append(math.hypot(*(end[0, :, 0] - start[0, :, 0])))
            headings = [math.atan2(at[1, 1, 0], at[1, 0, 0]) for at in (end, start)]
            turns.append(abs(wrap_angle(headings[1] - headings[0])))
        return Joints(np.array(gaps), np.array(turns))

    def _placed(self, piece: Piece, ds: FloatArray) -> FloatArray:
        """Return a piece's jet (4, 2, t), turned and moved to where it lies."""
        c, s = math.cos(piece.heading_rad), math.sin(piece.heading_rad)
        rotation = np.array([[c, -s], [s, c]])
        jet = np.stack([rotation @ part for part in _local(piece, ds)])
        start = np.array([[piece.x_m], [piece.y_m]]) - self.origin[:, None]
        jet[0] += start
        return jet


def polynomial_piece(
    piece: Piece, u: FloatArray, v: FloatArray, parameter: str | None, *, slope: bool = False
) -> Piece:
    """Make a paramPoly3 (`parameter` is its pRange) or, with `slope`, a poly3 piece.

    Where pRange is missing, which 1.4 allowed writers to leave out, it is the one whose arc length
    comes nearer to the piece's.
    """
    if parameter is None and not slope:
        choices = [polynomial_piece(piece, u, v, each) for each in ("normalized", "arcLength")]
        misses = [abs(_arc_length(choice) - piece.length_m) for choice in choices]
        return choices[int(np.argmin(misses))]
    scale = 1.0 / piece.length_m if parameter == "normalized" else 1.0
    return Piece(
        piece.s_m,
        piece.x_m,
        piece.y_m,
        piece.heading_rad,
        piece.length_m,
        u=u,
        v=v,
        scale=scale,
        slope=slope,
    )


def _local(piece: Piece, ds: FloatArray) -> _Local:
    if piece.u is None or piece.v is None:
        return _spiral(piece, ds)
    if piece.slope:
        return _poly3(piece, ds)
    p = piece.scale * ds
    parts = [
        np.stack([_power(row, p, order) for row in (piece.u, piece.v)]) * piece.scale**order
        for order in range(4)
    ]
    return _Local(*parts)


def _spiral(piece: Piece, ds: FloatArray) -> _Local:
    k = np.full_like(ds, piece.curvature)
    x, y = clothoid_displacement(ds, k, np.full_like(ds, piece.rate))
    heading = ds * (k + 0.5 * piece.rate * ds)
    return _by_curvature(np.stack((x, y)), heading, k + piece.rate * ds, piece.rate)


def _by_curvature(
    r: FloatArray, heading: FloatArray, bend: FloatArray, rate: FloatArray | float
) -> _Local:
    """Differentiate by arc length: T, κN, κ'N − κ²T."""
    t = np.stack((np.cos(heading), np.sin(heading)))
    n = np.stack((-t[1], t[0]))
    return _Local(r, t, bend * n, rate * n - bend**2 * t)


def _poly3(piece: Piece, ds: FloatArray) -> _Local:
    """Evaluate v(u), the arc length of which is s: u by Newton's method."""
    assert piece.v is not None  # noqa: S101 (polynomial_piece sets it)
    v = piece.v
    nodes, weights = np.polynomial.legendre.leggauss(8)
    # A table of the arc length at even steps of u, which is never longer than the arc.
    grid = np.linspace(0.0, piece.length_m, _POLY3_TABLE + 1)
    step = grid[1]
    at = grid[:-1, None] + 0.5 * step * (1.0 + nodes)
    arcs = 0.5 * step * (np.hypot(1.0, _power(v, at, 1)) @ weights)
    table = np.concatenate(([0.0], np.cumsum(arcs)))
    cell = np.clip(np.searchsorted(table, ds, side="right") - 1, 0, _POLY3_TABLE - 1)
    low, rest = grid[cell], ds - table[cell]
    u = low + step * rest / arcs[cell]
    for _ in range(8):
        inner = low + 0.5 * (u - low) * (1.0 + nodes[:, None])
        reached = 0.5 * (u - low) * (weights @ np.hypot(1.0, _power(v, inner, 1)))
        u = u - (reached - rest) / np.hypot(1.0, _power(v, u, 1))
    v1, v2, v3 = (_power(v, u, order) for order in (1, 2, 3))
    speed = np.hypot(1.0, v1)
    bend = v2 / speed**3
    rate = (v3 / speed**3 - 3.0 * v1 * v2 * v2 / speed**5) / speed
    return _by_curvature(np.stack((u, _power(v, u, 0))), np.arctan(v1), bend, rate)


def _power(c: FloatArray, p: FloatArray, order: int) -> FloatArray:
    """Return the derivative of c0 + c1 p + c2 p² + c3 p³."""
    a, b, q, d = c
    value: FloatArray
    if order == 0:
        value = ((d * p + q) * p + b) * p + a
    elif order == 1:
        value = (3.0 * d * p + 2.0 * q) * p + b
    else:
        value = 6.0 * d * p + 2.0 * q if order == 2 else np.full_like(p, 6.0 * d)
    return value


def _arc_length(piece: Piece) -> float:
    nodes, weights = np.polynomial.legendre.leggauss(24)
    at = _local(piece, 0.5 * piece.length_m * (1.0 + nodes))
    return float(0.5 * piece.length_m * np.sum(weights * np.hypot(at.d1[0], at.d1[1])))


def usable(length_m: float) -> bool:
    """Say whether a piece is long enough to be one."""
    return length_m > _LEAST_M
