"""Plane curves by arc length: clothoid chains in closed form, and C² splines through points.

A curve starts at the origin of its own frame, so that moving a scene by 100 km costs no digits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import fresnel

from models.geometry import FloatArray, IntArray, wrap_angle

# Beyond this κ²/|κ'|, the Fresnel form loses κ²/(2κ') · 2e-16 of the length to cancellation;
# Gauss–Legendre on the same integrand keeps every digit, as long as the piece is nearly an arc.
_NEARLY_ARC = 1e3


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


_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(10)
_CHECK_NODES, _CHECK_WEIGHTS = np.polynomial.legendre.leggauss(6)


@dataclass(frozen=True, slots=True)
class SplineCurve:
    """Interpolate points (n, 2) by a C² cubic spline over chord length, read by arc length.

    Closed curves are periodic (the first point is not repeated), open ones end “not-a-knot”; two
    points give a line, three a parabola. The frame's origin is the first point. Nothing is
    smoothed: the curve goes through every point, and its curvature shows the points' noise.
    """

    points_m: FloatArray
    closed: bool
    knots_s_m: FloatArray = field(init=False)  # (n,) arc lengths of the points
    _spline: CubicSpline[np.float64] = field(init=False, repr=False)
    _u: FloatArray = field(init=False, repr=False)  # cells fine enough for the quadrature
    _s_m: FloatArray = field(init=False, repr=False)
    _heading_rad: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Fit the spline and measure its length, cell by cell."""
        points = self.points_m - self.points_m[0]
        if self.closed:
            points = np.concatenate((points, points[:1]))
        knots = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
        spline = CubicSpline(knots, points, bc_type="periodic" if self.closed else "not-a-knot")
        u = _cells(spline, knots)
        s = np.concatenate(
            ([0.0], np.cumsum(_lengths(spline, u[:-1], u[1:], _GAUSS_NODES, _GAUSS_WEIGHTS)))
        )
        at_knots = s[np.searchsorted(u, knots)]
        velocity = spline(u, 1)
        for name, value in (
            ("_spline", spline),
            ("_u", u),
            ("_s_m", s),
            ("_heading_rad", np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))),
            ("knots_s_m", at_knots[:-1] if self.closed else at_knots),
        ):
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    @property
    def length_m(self) -> float:
        """Return the arc length."""
        return float(self._s_m[-1])

    @property
    def max_abs_curvature(self) -> float:
        """Return the largest |κ| over the quadrature cells' ends and middles."""
        u = np.concatenate((self._u, 0.5 * (self._u[1:] + self._u[:-1])))
        return float(np.max(np.abs(_curvature(self._spline(u, 1), self._spline(u, 2)))))

    def evaluate(self, s_m: FloatArray) -> CurvePoints:
        """Return position, heading and curvature at arc lengths (t,) within [0, length]."""
        cell = np.clip(np.searchsorted(self._s_m, s_m, side="right") - 1, 0, len(self._u) - 2)
        u = self._parameter(np.asarray(s_m, dtype=np.float64), cell)
        position, velocity = self._spline(u), self._spline(u, 1)
        base = self._heading_rad[cell]
        return CurvePoints(
            x_m=np.ascontiguousarray(position[..., 0]),
            y_m=np.ascontiguousarray(position[..., 1]),
            heading_rad=base + wrap_angle(np.arctan2(velocity[..., 1], velocity[..., 0]) - base),
            curvature=_curvature(velocity, self._spline(u, 2)),
        )

    def _parameter(self, s_m: FloatArray, cell: IntArray) -> FloatArray:
        """Invert s(u) by Newton's method within the cell, to 1e-12 of a metre or so."""
        u0, u1, s0 = self._u[cell], self._u[cell + 1], self._s_m[cell]
        u = u0 + (u1 - u0) * (s_m - s0) / (self._s_m[cell + 1] - s0)
        for _ in range(12):
            error = _lengths(self._spline, u0, u, _GAUSS_NODES, _GAUSS_WEIGHTS) - (s_m - s0)
            step = error / _speed(self._spline, u)
            u = np.clip(u - step, u0, u1)
            if np.max(np.abs(error), initial=0.0) < 1e-12 * max(1.0, self.length_m * 1e-3):
                break
        return u


def _cells(spline: CubicSpline[Any], knots: FloatArray) -> FloatArray:
    """Halve the knots' intervals until two quadratures agree on each one's length."""
    u = np.unique(np.concatenate((knots, 0.5 * (knots[1:] + knots[:-1]))))
    tolerance = 1e-14 * knots[-1]
    for _ in range(12):
        fine = _lengths(spline, u[:-1], u[1:], _GAUSS_NODES, _GAUSS_WEIGHTS)
        rough = _lengths(spline, u[:-1], u[1:], _CHECK_NODES, _CHECK_WEIGHTS)
        bad = np.abs(fine - rough) > np.maximum(tolerance, 1e-11)
        if not bad.any():
            break
        u = np.unique(np.concatenate((u, 0.5 * (u[1:] + u[:-1])[bad])))
    return u


def _lengths(
    spline: CubicSpline[Any], u0: FloatArray, u1: FloatArray, nodes: FloatArray, weights: FloatArray
) -> FloatArray:
    half = 0.5 * (u1 - u0)
    u = (u0 + half)[..., None] + half[..., None] * nodes
    return half * (_speed(spline, u) @ weights)


def _speed(spline: CubicSpline[Any], u: FloatArray) -> FloatArray:
    velocity: FloatArray = spline(u, 1)
    return np.hypot(velocity[..., 0], velocity[..., 1])


def _curvature(velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
    cross = velocity[..., 0] * acceleration[..., 1] - velocity[..., 1] * acceleration[..., 0]
    return cast("FloatArray", cross / np.hypot(velocity[..., 0], velocity[..., 1]) ** 3)
