"""Curves given by any parameter, read by arc length: reference lines, and lanes beside them.

A *path* maps a parameter w to the plane and knows three derivatives. From it come exactly

- the path at an offset d(w) to its left: with speed σ = |b'|, tangent T and normal N,
  r = b + d·N,  r' = σ(1 − dκ)·T + d'·N;
- the path driven backwards;
- the curve by arc length, ∫|r'| dw by Gauss–Legendre in cells short enough for 1e-10 m.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from models.curves import CurvePoints
from models.geometry import FloatArray, wrap_angle

_FINE = np.polynomial.legendre.leggauss(8)
_ROUGH = np.polynomial.legendre.leggauss(5)
_MOST_TURN = 0.5  # rad, of a cell: headings are unwrapped from cell to cell
_MOST_HALVINGS = 24


class Jet(NamedTuple):
    """Hold position and derivatives by the parameter, each (2, t)."""

    r: FloatArray
    d1: FloatArray
    d2: FloatArray
    d3: FloatArray


class PlanePath(Protocol):
    """Be a path, smooth between its breaks."""

    @property
    def breaks(self) -> FloatArray:
        """Return the parameter's first value, each place where smoothness ends, and its last."""
        ...

    def jet(self, w: FloatArray) -> Jet:
        """Return position and three derivatives at parameters (t,)."""
        ...


@dataclass(frozen=True, slots=True)
class Cubics:
    """Be a function of the road's s: on [start_i, start_i+1) it is Σ c_ij (s − start_i)^j.

    start (n,) increases; coefficients (n, 4), constant first. Before the first start its cubic
    goes on, after the last one, too.
    """

    start: FloatArray
    coefficients: FloatArray

    @staticmethod
    def constant(value: float) -> Cubics:
        """Return the function that is `value` everywhere."""
        return Cubics(np.zeros(1), np.array([[value, 0.0, 0.0, 0.0]]))

    def __call__(self, s: FloatArray) -> FloatArray:
        """Return the values at s (t,)."""
        return self.derivatives(s)[0]

    def derivatives(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return value, first and second derivative at s (t,)."""
        i = np.clip(np.searchsorted(self.start, s, side="right") - 1, 0, len(self.start) - 1)
        a, b, c, d = self.coefficients[i].T
        u = s - self.start[i]
        return (
            ((d * u + c) * u + b) * u + a,
            (3.0 * d * u + 2.0 * c) * u + b,
            6.0 * d * u + 2.0 * c,
        )

    def cut(self, start: FloatArray) -> Cubics:
        """Return the same function with pieces that begin at `start` (m,) as well as at its own."""
        places = np.union1d(self.start, start)
        i = np.clip(np.searchsorted(self.start, places, side="right") - 1, 0, len(self.start) - 1)
        a, b, c, d = self.coefficients[i].T
        u = places - self.start[i]
        moved = (((d * u + c) * u + b) * u + a, (3 * d * u + 2 * c) * u + b, 3 * d * u + c, d)
        return Cubics(places, np.column_stack(moved))

    def __add__(self, other: Cubics) -> Cubics:
        """Return the sum."""
        a, b = self.cut(other.start), other.cut(self.start)
        return Cubics(a.start, a.coefficients + b.coefficients)

    def scaled(self, factor: float) -> Cubics:
        """Return the product with a number."""
        return Cubics(self.start, factor * self.coefficients)

    def within(self, low: float, high: float) -> Cubics:
        """Return the pieces that matter on [low, high), the first one starting at `low`."""
        whole = self.cut(np.array([low]))
        keep = (whole.start >= low) & (whole.start < high)
        return Cubics(whole.start[keep], whole.coefficients[keep])

    def then(self, other: Cubics) -> Cubics:
        """Continue with `other` from its first start on."""
        keep = self.start < other.start[0]
        return Cubics(
            np.concatenate((self.start[keep], other.start)),
            np.concatenate((self.coefficients[keep], other.coefficients)),
        )


@dataclass(frozen=True, slots=True)
class OffsetPath:
    """Run beside `base`, `offset` to its left; both are functions of the base's parameter."""

    base: PlanePath
    offset: Cubics

    @property
    def breaks(self) -> FloatArray:
        """Return the breaks of both."""
        own = self.base.breaks
        inner = self.offset.start[(self.offset.start > own[0]) & (self.offset.start < own[-1])]
        return np.union1d(own, inner)

    def jet(self, w: FloatArray) -> Jet:
        """Return position, first and second derivative; the third is not known (NaN)."""
        b = self.base.jet(w)
        d, d1, d2 = self.offset.derivatives(w)
        speed = np.hypot(b.d1[0], b.d1[1])
        t = b.d1 / speed
        n = np.stack((-t[1], t[0]))
        grows = t[0] * b.d2[0] + t[1] * b.d2[1]  # dσ/dw
        bend = _cross(b.d1, b.d2) / speed**3
        bend_grows = _cross(b.d1, b.d3) / speed**3 - 3.0 * bend * grows / speed
        # Beyond the centre of a bend the offset runs back: no lane does, so it stands still here.
        along = speed * np.maximum(1.0 - d * bend, 0.0)
        along_grows = grows * (1.0 - d * bend) - speed * (d1 * bend + d * bend_grows)
        turn = bend * speed
        return Jet(
            b.r + d * n,
            along * t + d1 * n,
            (along_grows - d1 * turn) * t + (d2 + along * turn) * n,
            np.full_like(b.r, np.nan),
        )


@dataclass(frozen=True, slots=True)
class ReversedPath:
    """Run through `base` from its last parameter to its first."""

    base: PlanePath

    @property
    def breaks(self) -> FloatArray:
        """Return the breaks, counted from the other end."""
        own = self.base.breaks
        turned: FloatArray = own[-1] - own[::-1]
        return turned

    def jet(self, w: FloatArray) -> Jet:
        """Return position and derivatives: odd ones change sign."""
        # A break belongs to the piece that the car enters there, so look a little ahead of it.
        last = self.base.breaks[-1]
        at = last - w
        inner = self.base.breaks[1:-1]
        if len(inner):
            near = inner[np.clip(np.searchsorted(inner, at), 0, len(inner) - 1)]
            at = np.where(at == near, np.nextafter(at, -np.inf), at)
        b = self.base.jet(at)
        return Jet(b.r, -b.d1, b.d2, -b.d3)


@dataclass(frozen=True, slots=True)
class ArcLengthCurve:
    """Read `path` by arc length, from the origin of a frame whose axes are the path's.

    Position is the path's to rounding, gaps between its pieces included; arc length is true to
    1e-10 m a piece.

    Raises:
        ValueError: if the path stands still or turns back somewhere (an offset beyond the centre of
            a bend), naming the parameter.
    """

    path: PlanePath
    start_m: FloatArray = field(init=False)  # (2,) where the path begins
    w_cells: FloatArray = field(init=False, repr=False)  # (cells + 1,) of the parameter
    s_cells: FloatArray = field(init=False, repr=False)  # (cells + 1,) of the arc length
    _heading: FloatArray = field(
        init=False, repr=False
    )  # (cells,) at the cells' middles, unwrapped
    _most: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Cut the path into cells and measure them."""
        w, lengths = _cells(self.path)
        middle = 0.5 * (w[:-1] + w[1:])
        at = self.path.jet(middle)
        curvature = np.abs(_curvature(at))
        ends = np.abs(_curvature(self.path.jet(w)))
        for name, value in (
            ("start_m", self.path.jet(w[:1]).r[:, 0]),
            ("w_cells", w),
            ("s_cells", np.concatenate(([0.0], np.cumsum(lengths)))),
            ("_heading", np.unwrap(np.arctan2(at.d1[1], at.d1[0]))),
            ("_most", float(max(curvature.max(), ends.max()))),
        ):
            object.__setattr__(self, name, value)

    @property
    def length_m(self) -> float:
        """Return the arc length."""
        return float(self.s_cells[-1])

    @property
    def max_abs_curvature(self) -> float:
        """Return the largest |κ| at the ends and middles of cells."""
        return self._most

    def evaluate(self, s_m: FloatArray) -> CurvePoints:
        """Return position, heading and curvature at arc lengths (t,) within [0, length]."""
        s = np.asarray(s_m, dtype=np.float64)
        cell = np.clip(
            np.searchsorted(self.s_cells, s, side="right") - 1, 0, len(self._heading) - 1
        )
        low, high = self.w_cells[cell], self.w_cells[cell + 1]
        rest = s - self.s_cells[cell]
        length = self.s_cells[cell + 1] - self.s_cells[cell]
        w = low + (high - low) * np.clip(rest / length, 0.0, 1.0)
        for _ in range(12):
            error = _arc(self.path, low, w) - rest
            speed = np.hypot(*self.path.jet(w).d1)
            w = np.clip(w - error / speed, low, high)
            if np.all(np.abs(error) <= 1e-8 * length):
                break
        at = self.path.jet(w)
        base = self._heading[cell]
        return CurvePoints(
            x_m=at.r[0] - self.start_m[0],
            y_m=at.r[1] - self.start_m[1],
            heading_rad=base + wrap_angle(np.arctan2(at.d1[1], at.d1[0]) - base),
            curvature=_curvature(at),
        )

    def arc_length(self, w: FloatArray) -> FloatArray:
        """Return the arc length (t,) at parameters (t,)."""
        inside = np.clip(w, self.w_cells[0], self.w_cells[-1])
        cell = np.clip(
            np.searchsorted(self.w_cells, inside, side="right") - 1, 0, len(self._heading) - 1
        )
        lengths: FloatArray = self.s_cells[cell] + _arc(self.path, self.w_cells[cell], inside)
        return lengths


def _cells(path: PlanePath) -> tuple[FloatArray, FloatArray]:
    """Halve the intervals between breaks until quadratures agree and none turns by 0.5 rad."""
    w = path.breaks
    for halving in range(_MOST_HALVINGS):
        low, high = w[:-1], w[1:]
        lengths = _arc(path, low, high)
        doubt = np.abs(lengths - _arc(path, low, high, _ROUGH))
        turn = np.zeros_like(lengths)
        slow = np.zeros(len(lengths), dtype=np.bool_)
        for share in (0.02, 0.25, 0.5, 0.75, 0.98):
            at = path.jet(low + share * (high - low))
            speed = np.hypot(at.d1[0], at.d1[1])
            slow |= speed <= 1e-6
            with np.errstate(divide="ignore", invalid="ignore"):
                turn = np.maximum(turn, np.abs(_cross(at.d1, at.d2)) / speed**2 * (high - low))
        if halving > 12 and slow.any():
            break
        bad = (doubt > 1e-11 + 1e-14 * lengths.sum()) | ~(turn < _MOST_TURN) | slow
        if not bad.any():
            return w, lengths
        if len(w) > 1_000_000:
            break
        w = np.union1d(w, 0.5 * (low + high)[bad])
    where = float(w[int(np.argmax(bad))])
    raise ValueError(
        f"the line must move on everywhere, but stands still or folds near s = {where:g}"
    )


def _arc(
    path: PlanePath,
    low: FloatArray,
    high: FloatArray,
    rule: tuple[FloatArray, FloatArray] = _FINE,
) -> FloatArray:
    """Return ∫|r'| dw from low to high (t,)."""
    total = np.zeros_like(low)
    for node, weight in zip(*rule, strict=True):
        at = path.jet(low + 0.5 * (1.0 + node) * (high - low))
        total += weight * np.hypot(at.d1[0], at.d1[1])
    return 0.5 * (high - low) * total


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    product: FloatArray = a[0] * b[1] - a[1] * b[0]
    return product


def _curvature(at: Jet) -> FloatArray:
    speed = np.hypot(at.d1[0], at.d1[1])
    bend: FloatArray = _cross(at.d1, at.d2) / speed**3
    return bend
