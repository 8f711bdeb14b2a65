"""Plane curves by arc length: clothoid chains in closed form, and C² splines through points.

A curve starts at the origin of its own frame, so that moving a scene by 100 km costs no digits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import fresnel

from models.geometry import FloatArray, IntArray, wrap_angle

# Beyond this κ²/|κ'|, the Fresnel form loses κ²/(2κ') · 2e-16 of the length to cancellation;
# Gauss–Legendre on the same integrand keeps every digit, as long as the piece is nearly an arc.
_NEARLY_ARC = 1e3
_MOST_TURN = 250.0  # rad, of half a piece: keeps the number of nodes in the hundreds


@dataclass(frozen=True, slots=True)
class CurvePoints:
    """Hold what a curve says at some arc lengths, each array (t,): metres, radians, 1/m."""

    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray  # continuous along the curve, never wrapped
    curvature: FloatArray


class Curve(Protocol):
    """Be a plane curve of `length_m`, parametrised by arc length from the origin of its frame."""

    @property
    def length_m(self) -> float:
        """Return the length."""
        ...

    @property
    def max_abs_curvature(self) -> float:
        """Return the largest |κ| in 1/m, to the resolution of the curve's own table."""
        ...

    def evaluate(self, s_m: FloatArray) -> CurvePoints:
        """Return position, heading and curvature at arc lengths (t,) within [0, length]."""
        ...


@dataclass(frozen=True, slots=True)
class ClothoidChain:
    """Join pieces of linearly varying curvature, each (n,): straights, arcs and clothoids.

    The chain starts at the origin with heading 0. Position and heading are continuous; curvature
    may jump where one piece ends at another value than the next one starts.
    """

    piece_lengths_m: FloatArray
    curvature_start: FloatArray
    curvature_end: FloatArray
    _s_m: FloatArray = field(init=False, repr=False)  # (n + 1,) where pieces start, and the end
    _x_m: FloatArray = field(init=False, repr=False)
    _y_m: FloatArray = field(init=False, repr=False)
    _heading_rad: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Add up the pieces once."""
        lengths, k0, k1 = self.piece_lengths_m, self.curvature_start, self.curvature_end
        turns = 0.5 * (k0 + k1) * lengths
        headings = np.concatenate(([0.0], np.cumsum(turns)))
        dx, dy = clothoid_displacement(lengths, k0, (k1 - k0) / lengths)
        c, s = np.cos(headings[:-1]), np.sin(headings[:-1])
        for name, value in (
            ("_s_m", np.concatenate(([0.0], np.cumsum(lengths)))),
            ("_x_m", np.concatenate(([0.0], np.cumsum(c * dx - s * dy)))),
            ("_y_m", np.concatenate(([0.0], np.cumsum(s * dx + c * dy)))),
            ("_heading_rad", headings),
        ):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    @property
    def length_m(self) -> float:
        """Return the sum of the piece lengths."""
        return float(self._s_m[-1])

    @property
    def max_abs_curvature(self) -> float:
        """Return the largest |κ|, exactly: it lies at the end of a piece."""
        return float(np.max(np.abs([self.curvature_start, self.curvature_end])))

    def evaluate(self, s_m: FloatArray) -> CurvePoints:
        """Return position, heading and curvature at arc lengths (t,) within [0, length]."""
        i = np.clip(np.searchsorted(self._s_m, s_m, side="right") - 1, 0, len(self._s_m) - 2)
        u = s_m - self._s_m[i]
        k0 = self.curvature_start[i]
        rate = ((self.curvature_end - self.curvature_start) / self.piece_lengths_m)[i]
        dx, dy = clothoid_displacement(u, k0, rate)
        c, s = np.cos(self._heading_rad[i]), np.sin(self._heading_rad[i])
        return CurvePoints(
            x_m=self._x_m[i] + c * dx - s * dy,
            y_m=self._y_m[i] + s * dx + c * dy,
            heading_rad=self._heading_rad[i] + u * (k0 + 0.5 * rate * u),
            curvature=k0 + rate * u,
        )


def clothoid_displacement(
    length_m: FloatArray, curvature: FloatArray, rate: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return ∫₀ˢ (cos, sin)(κu + κ'u²/2) du for arrays (t,) of s, κ and κ'.

    Arcs and straights by the chord, clothoids by the Fresnel integrals, and clothoids that are
    nearly arcs (where those cancel) by Gauss–Legendre quadrature with as many nodes as the turn
    needs; 1e-12 of the length throughout (after Bertolazzi and Frego 2015, section 4).
    """
    s, k, r = np.broadcast_arrays(length_m, curvature, rate)
    half_turn = 0.5 * k * s
    chord = s * np.sinc(half_turn / math.pi)
    x, y = chord * np.cos(half_turn), chord * np.sin(half_turn)
    bending = np.abs(r) * s * s > 1e-16  # less moves no end point by an ulp
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        near_arc = bending & ((k * k > _NEARLY_ARC * np.abs(r)) | (np.abs(r) * s * s < 1e-3))
        near_arc &= np.abs(half_turn) < _MOST_TURN  # a road has no business there
    if near_arc.any():
        x[near_arc], y[near_arc] = _by_quadrature(s[near_arc], k[near_arc], r[near_arc])
    euler = bending & ~near_arc
    if euler.any():
        x[euler], y[euler] = _by_fresnel(s[euler], k[euler], r[euler])
    return x, y


def _by_fresnel(s: FloatArray, k: FloatArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Complete the square: κu + κ'u²/2 = (π/2)·w² − κ²/(2κ') with w = (κ + κ'u)/√(π|κ'|)."""
    sign = np.sign(r)
    scale = np.sqrt(math.pi / np.abs(r))
    w0 = sign * k * scale / math.pi
    w1 = w0 + s / scale
    s0, c0 = fresnel(w0)
    s1, c1 = fresnel(w1)
    c, d = scale * (c1 - c0), scale * (s1 - s0)
    phase = 0.5 * math.pi * w0 * w0
    cos, sin = np.cos(phase), np.sin(phase)
    return c * cos + d * sin, sign * (d * cos - c * sin)


def _by_quadrature(s: FloatArray, k: FloatArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
    turn = float(np.max(np.abs(k) * np.abs(s) + 0.5 * np.abs(r) * s * s))
    # The error is about L·(turn/4)^(2n)/(2n)!: below 1e-16 for n = 12 at one radian.
    nodes, weights = np.polynomial.legendre.leggauss(12 + math.ceil(turn))
    u = 0.5 * s[:, None] * (1.0 + nodes)
    angle = u * (k[:, None] + 0.5 * r[:, None] * u)
    return 0.5 * s * (np.cos(angle) @ weights), 0.5 * s * (np.sin(angle) @ weights)


_FINE = np.polynomial.legendre.leggauss(8)
_ROUGH = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True, slots=True)
class SplineCurve:
    """Interpolate points (n, 2) by a C² cubic spline over chord length, read by arc length.

    Closed curves are periodic (the first point is not repeated), open ones end “not-a-knot”; two
    points give a line, three a parabola. The frame's origin is the first point. Nothing is
    smoothed: the curve goes through every point, and its curvature shows the points' noise.

    The parameter is cut into cells short enough that Gauss–Legendre quadrature gives their lengths
    to 1e-11 m; within a cell the curve is a cubic about the cell's start.
    """

    points_m: FloatArray
    closed: bool
    knots_s_m: FloatArray = field(init=False)  # (n,) arc lengths of the points
    _s_m: FloatArray = field(init=False, repr=False)  # (cells + 1,)
    _heading_rad: FloatArray = field(init=False, repr=False)  # (cells + 1,)
    _speed: FloatArray = field(init=False, repr=False)  # (cells + 1,) |dr/du|
    _size: FloatArray = field(init=False, repr=False)  # (cells,) of the parameter
    _cubic: FloatArray = field(init=False, repr=False)  # (4, 2, cells), highest power first

    def __post_init__(self) -> None:
        """Fit the spline and measure its length, cell by cell."""
        points = self.points_m - self.points_m[0]
        if self.closed:
            points = np.concatenate((points, points[:1]))
        knots = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
        spline = CubicSpline(knots, points, bc_type="periodic" if self.closed else "not-a-knot")
        u, cubic, lengths = _cut_into_cells(spline, knots)
        s = np.concatenate(([0.0], np.cumsum(lengths)))
        at_knots = s[np.searchsorted(u, knots)]
        velocity = spline(u, 1)
        for name, value in (
            ("knots_s_m", at_knots[:-1] if self.closed else at_knots),
            ("_s_m", s),
            ("_heading_rad", np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))),
            ("_speed", np.hypot(velocity[:, 0], velocity[:, 1])),
            ("_size", np.diff(u)),
            ("_cubic", cubic),
        ):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    @property
    def length_m(self) -> float:
        """Return the arc length."""
        return float(self._s_m[-1])

    @property
    def max_abs_curvature(self) -> float:
        """Return the largest |κ| over nine places in each cell."""
        w = np.linspace(0.0, 1.0, 9)[:, None] * self._size
        return float(np.max(np.abs(_curvature(self._cubic, w))))

    def evaluate(self, s_m: FloatArray) -> CurvePoints:
        """Return position, heading and curvature at arc lengths (t,) within [0, length]."""
        cell = np.clip(np.searchsorted(self._s_m, s_m, side="right") - 1, 0, len(self._size) - 1)
        w = self._parameter(s_m, cell)
        cubic = self._cubic[:, :, cell]
        x, y = ((cubic[0] * w + cubic[1]) * w + cubic[2]) * w + cubic[3]
        vx, vy = _velocity(cubic, w)
        base = self._heading_rad[cell]
        return CurvePoints(
            x_m=x,
            y_m=y,
            heading_rad=base + wrap_angle(np.arctan2(vy, vx) - base),
            curvature=_curvature(cubic, w),
        )

    def _parameter(self, s_m: FloatArray, cell: IntArray) -> FloatArray:
        """Invert the arc length within the cells: a cubic guess, then Newton's method to 1e-12."""
        cubic, size, s = self._cubic[:, :, cell], self._size[cell], s_m - self._s_m[cell]
        length = self._s_m[cell + 1] - self._s_m[cell]
        f = s / length
        start, end = length / self._speed[cell], length / self._speed[cell + 1]
        w = f * (1 - f) * ((1 - f) * start - f * end) + f * f * (3 - 2 * f) * size
        for _ in range(12):
            error = _lengths(cubic, w, _FINE) - s
            w = np.clip(w - error / np.hypot(*_velocity(cubic, w)), 0.0, size)
            # Newton squares the error, relative to the cell: what is left is below rounding.
            if np.all(np.abs(error) <= 1e-7 * length):
                break
        return w


def _cut_into_cells(
    spline: CubicSpline[Any], knots: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Halve the knots' intervals until two quadratures agree on each one's length.

    Returns the cells' ends (cells + 1,), their cubics (4, 2, cells) and their lengths (cells,).
    """
    u = np.unique(np.concatenate((knots, 0.5 * (knots[1:] + knots[:-1]))))
    for _ in range(20):
        cubic = np.stack(
            [spline(u[:-1], order).T / math.factorial(order) for order in (3, 2, 1, 0)]
        )
        lengths = _lengths(cubic, np.diff(u), _FINE)
        doubt = np.abs(lengths - _lengths(cubic, np.diff(u), _ROUGH))
        bad = doubt > np.maximum(1e-11, 1e-15 * knots[-1])
        if not bad.any():
            break
        u = np.unique(np.concatenate((u, 0.5 * (u[1:] + u[:-1])[bad])))
    return u, cubic, lengths


def _lengths(cubic: FloatArray, w: FloatArray, rule: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Return ∫₀ʷ |dr/dw| dw, each cell's own."""
    total = np.zeros_like(w)
    for node, weight in zip(*rule, strict=True):
        total += weight * np.hypot(*_velocity(cubic, 0.5 * (1.0 + node) * w))
    return 0.5 * w * total


def _velocity(cubic: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    vx, vy = ((3.0 * cubic[0, i] * w + 2.0 * cubic[1, i]) * w + cubic[2, i] for i in (0, 1))
    return vx, vy


def _curvature(cubic: FloatArray, w: FloatArray) -> FloatArray:
    vx, vy = _velocity(cubic, w)
    ax, ay = (6.0 * cubic[0, i] * w + 2.0 * cubic[1, i] for i in (0, 1))
    curvature: FloatArray = (vx * ay - vy * ax) / np.hypot(vx, vy) ** 3
    return curvature
