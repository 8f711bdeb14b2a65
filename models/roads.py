"""Roads: a centre line by arc length with its widths; sampling, mounts' offsets, closest points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from models.closest import ClosestPoint
from models.curves import ClothoidChain, Curve, SplineCurve
from models.geometry import FloatArray, Pose

MIN_STEP_M = 1e-6  # points closer than this count as equal: a curve through them would be noise
_END_M = 1e-9  # how far beyond an open road's ends an arc length may lie (rounding)
_CLOSING_M = 1e-6
_CLOSING_RAD = 1e-6


@dataclass(frozen=True, slots=True)
class RoadPoints:
    """Hold points of a road's centre line, each array (t,): metres, radians, 1/m."""

    s_m: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray  # continuous along the road, never wrapped
    curvature: FloatArray

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.s_m)

    @property
    def xy(self) -> FloatArray:
        """Return the positions (t, 2)."""
        return np.column_stack((self.x_m, self.y_m))


class RoadTable(NamedTuple):
    """List a road finely for compiled kernels, each float64, contiguous and (n,).

    Rows are equally spaced from s = 0 to s = length, both included, closed roads too: the last row
    of a closed road is its first again, with the heading one lap further.
    """

    s_m: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    curvature: FloatArray
    left_m: FloatArray
    right_m: FloatArray


@dataclass(frozen=True, slots=True)
class Road:
    """Place a curve in the world and give it two edges.

    `frame` is world_from_curve; `left_m` and `right_m` (n,) are the distances from the centre line
    to the edges at arc lengths `width_s_m` (n,), linear in between (round the lap when closed).
    Build one with `road_from_pieces`, `road_from_points` or a reader of `models.files`.
    """

    curve: Curve
    closed: bool
    frame: Pose
    width_s_m: FloatArray
    left_m: FloatArray
    right_m: FloatArray
    _closest: ClosestPoint | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the widths."""
        for name in ("left_m", "right_m"):
            widths = getattr(self, name)
            if not np.all(np.isfinite(widths) & (widths >= 0.0)):
                bad = int(np.flatnonzero(~(np.isfinite(widths) & (widths >= 0.0)))[0])
                raise ValueError(f"{name}[{bad}] must be a width of 0 or more, got {widths[bad]}")
        if self._closest is None:
            object.__setattr__(self, "_closest", ClosestPoint(self.curve, self.closed))

    @property
    def length_m(self) -> float:
        """Return the length of the centre line."""
        return self.curve.length_m

    @property
    def total_turning_rad(self) -> float:
        """Return the heading gained from start to end; ±2π for a simple closed road."""
        ends = self.curve.evaluate(np.array([0.0, self.length_m]))
        return float(ends.heading_rad[1] - ends.heading_rad[0])

    @property
    def min_radius_m(self) -> float:
        """Return 1/max|κ|, infinite for a straight."""
        curvature = self.curve.max_abs_curvature
        return 1.0 / curvature if curvature > 0.0 else math.inf

    def evaluate(self, s_m: ArrayLike) -> RoadPoints:
        """Return the centre line at arc lengths (t,).

        Closed roads wrap. On open ones, arc lengths must lie in [0, length] up to 1e-9 m, or a
        ValueError says so.
        """
        s = self._within(s_m)
        at = self.curve.evaluate(s)
        c, d = math.cos(self.frame.heading_rad), math.sin(self.frame.heading_rad)
        return RoadPoints(
            s_m=s,
            x_m=self.frame.x_m + (c * at.x_m - d * at.y_m),
            y_m=self.frame.y_m + (d * at.x_m + c * at.y_m),
            heading_rad=self.frame.heading_rad + at.heading_rad,
            curvature=at.curvature,
        )

    def sample(self, spacing_m: float) -> RoadPoints:
        """Return equally spaced points at most `spacing_m` apart (up to rounding).

        An open road's points include both ends; a closed road's first point is not repeated.
        """
        if not (math.isfinite(spacing_m) and spacing_m > 0.0):
            raise ValueError(f"spacing_m must be finite and positive, got {spacing_m}")
        n = max(1, math.ceil(self.length_m / spacing_m - 1e-9))
        steps = np.arange(n if self.closed else n + 1)
        return self.evaluate(steps * (self.length_m / n))

    def table(self, step_m: float) -> RoadTable:
        """List the road at steps of at most `step_m`, for kernels that cannot call `evaluate`."""
        if not (math.isfinite(step_m) and step_m > 0.0):
            raise ValueError(f"step_m must be finite and positive, got {step_m}")
        n = max(1, math.ceil(self.length_m / step_m - 1e-9))
        s = np.linspace(0.0, self.length_m, n + 1)
        points = replace(self, closed=False, _closest=self._closest).evaluate(s)
        left, right = self.half_widths(s)
        return RoadTable(
            *(
                np.ascontiguousarray(column, dtype=np.float64)
                for column in (
                    s,
                    points.x_m,
                    points.y_m,
                    points.heading_rad,
                    points.curvature,
                    left,
                    right,
                )
            )
        )

    def half_widths(self, s_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the distances (t,), (t,) from the centre line to the left and right edges."""
        s = self._within(s_m)
        period = self.length_m if self.closed else None
        left = np.interp(s, self.width_s_m, self.left_m, period=period)
        right = np.interp(s, self.width_s_m, self.right_m, period=period)
        return left, right

    def offset(self, s_m: ArrayLike, lateral_m: ArrayLike) -> FloatArray:
        """Return the points (t, 2) at `lateral_m` to the left of the centre line (< 0: right)."""
        at = self.evaluate(s_m)
        d = np.asarray(lateral_m, dtype=np.float64)
        return np.column_stack(
            (at.x_m - d * np.sin(at.heading_rad), at.y_m + d * np.cos(at.heading_rad))
        )

    def project(
        self,
        x_m: ArrayLike,
        y_m: ArrayLike,
        near_s_m: ArrayLike | None = None,
        *,
        window_m: float = 10.0,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the closest centre-line points of (m,), (m,) as arc length and signed offset.

        The offset is along the left normal, > 0 on the left; its magnitude is the distance except
        beyond the ends of an open road, where the part along the road is left out. The arc length
        is exact to 1e-9 m where the curve is not locally a circle about the point. Of points
        equally close (to 1e-9 m) the first along the road is returned. With `near_s_m` (m,), only
        arc lengths within `window_m` of it are looked at: for a car whose place is roughly known,
        on a road that passes close to itself.
        """
        x, y = np.broadcast_arrays(
            np.atleast_1d(np.asarray(x_m, dtype=np.float64)),
            np.atleast_1d(np.asarray(y_m, dtype=np.float64)),
        )
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise ValueError("points to project must be finite")
        dx, dy = x - self.frame.x_m, y - self.frame.y_m
        c, d = math.cos(self.frame.heading_rad), math.sin(self.frame.heading_rad)
        local = np.column_stack((c * dx + d * dy, c * dy - d * dx))
        near = None
        if near_s_m is not None:
            near = np.broadcast_to(np.asarray(near_s_m, dtype=np.float64), x.shape)
        closest = self._closest or ClosestPoint(self.curve, self.closed)
        return closest.find(local, near, window_m)

    def transformed(self, pose: Pose) -> Road:
        """Return the road moved by `pose`: its points p become pose.apply(p)."""
        return replace(self, frame=pose @ self.frame, _closest=self._closest)

    def _within(self, s_m: ArrayLike) -> FloatArray:
        s = np.atleast_1d(np.asarray(s_m, dtype=np.float64))
        if not np.isfinite(s).all():
            raise ValueError("s_m must be finite")
        if self.closed:
            return np.mod(s, self.length_m)
        outside = (s < -_END_M) | (s > self.length_m + _END_M)
        if outside.any():
            bad = float(s[outside][0])
            raise ValueError(f"s_m must lie in [0, {self.length_m:.6f}], got {bad}")
        return np.clip(s, 0.0, self.length_m)


@dataclass(frozen=True, slots=True)
class Piece:
    """Describe `length_m` of road over which curvature (1/m, left > 0) varies linearly.

    Both curvatures 0: a straight; equal: an arc; different: a clothoid.
    """

    length_m: float
    curvature_start: float = 0.0
    curvature_end: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (math.isfinite(self.length_m) and self.length_m > 0.0):
            raise ValueError(f"length_m must be finite and positive, got {self.length_m}")
        for name in ("curvature_start", "curvature_end"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"{name} must be finite, got {getattr(self, name)}")


def road_from_pieces(
    pieces: Sequence[Piece],
    *,
    width_m: float = 3.0,
    start: Pose | None = None,
    closed: bool = False,
) -> Road:
    """Join straights, arcs and clothoids, starting at pose `start`.

    A closed road must end where and as it starts, to 1e-6 m and 1e-6 rad; a ValueError gives the
    miss.
    """
    if not pieces:
        raise ValueError("pieces must hold at least one piece, got none")
    if not (math.isfinite(width_m) and width_m > 0.0):
        raise ValueError(f"width_m must be finite and positive, got {width_m}")
    curve = ClothoidChain(
        np.array([piece.length_m for piece in pieces], dtype=np.float64),
        np.array([piece.curvature_start for piece in pieces], dtype=np.float64),
        np.array([piece.curvature_end for piece in pieces], dtype=np.float64),
    )
    if closed:
        end = curve.evaluate(np.array([curve.length_m]))
        miss = math.hypot(end.x_m[0], end.y_m[0])
        turn = abs(math.remainder(float(end.heading_rad[0]), math.tau))
        if miss > _CLOSING_M or turn > _CLOSING_RAD:
            raise ValueError(
                f"a closed road must end at its start to {_CLOSING_M:g} m and {_CLOSING_RAD:g} "
                f"rad, got {miss:.3g} m and {turn:.3g} rad"
            )
    half = np.array([0.5 * width_m])
    return Road(curve, closed, start or Pose(), np.zeros(1), half, half)


def road_from_points(
    points_m: ArrayLike,
    *,
    closed: bool,
    left_m: ArrayLike = 1.5,
    right_m: ArrayLike = 1.5,
) -> Road:
    """Interpolate points (n, 2) by a C² curve by arc length, with edges at scalars or (n,) widths.

    The curve goes through every point: nothing is smoothed. A closed road's first point is not
    repeated at the end. Refused: fewer than two points (three when closed), NaN, and neighbours
    less than 1e-6 m apart.
    """
    points = np.array(points_m, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points must have shape (n, 2), got {points.shape}")
    least = 3 if closed else 2
    if len(points) < least:
        kind = "a closed" if closed else "an open"
        raise ValueError(f"{kind} road needs at least {least} points, got {len(points)}")
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise ValueError(f"points[{bad}] must be finite, got {tuple(points[bad].tolist())}")
    following = np.roll(points, -1, axis=0) if closed else points[1:]
    steps = np.hypot(*(following - points[: len(following)]).T)
    for i in np.flatnonzero(steps <= MIN_STEP_M):
        raise ValueError(
            f"points[{i}] and points[{(i + 1) % len(points)}] must differ, "
            f"both are at ({points[i, 0]:g}, {points[i, 1]:g})"
        )
    curve = SplineCurve(points, closed)
    widths = [
        np.ascontiguousarray(np.broadcast_to(np.asarray(w, dtype=np.float64), (len(points),)))
        for w in (left_m, right_m)
    ]
    frame = Pose(float(points[0, 0]), float(points[0, 1]), 0.0)
    return Road(curve, closed, frame, curve.knots_s_m, widths[0], widths[1])
