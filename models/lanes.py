"""Lanes: the curve that keeps a fixed distance from a road's centre line, either way along it.

At an offset d to the left of a curve of curvature κ, arc length, heading and curvature are known
in closed form,

    s' = s − d·(θ(s) − θ(0)),  θ' = θ,  κ' = κ / (1 − κ d),

so a lane of a clothoid is as exact as the clothoid, though it is not one itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from models.curves import Curve, CurvePoints
from models.geometry import FloatArray
from models.roads import Road

_TABLE_M = 0.5
_TOLERANCE_M = 1e-11
_LEAST_STRETCH = (
    1e-3  # of ds'/ds: a lane that hardly moves round a bend is one that cuts its centre
)


@dataclass(frozen=True, slots=True)
class LaneCurve:
    """Run beside `base` at `offset_m` to the left of its direction; `backward`, from end to start.

    Raises:
        ValueError: if the lane would pass the centre of a bend, naming the place.
    """

    base: Curve
    offset_m: float
    backward: bool = False
    _s_m: FloatArray = field(init=False, repr=False)  # (n,) along the base
    _lane_m: FloatArray = field(init=False, repr=False)  # (n,) along the lane, its own way round
    _turn: float = field(init=False, repr=False)  # heading of the base at its start
    _most: float = field(init=False, repr=False)  # the largest |κ'| of the table

    def __post_init__(self) -> None:
        """List the lane's arc length along the base."""
        n = max(8, math.ceil(self.base.length_m / _TABLE_M))
        s = np.linspace(0.0, self.base.length_m, n + 1)
        at = self.base.evaluate(s)
        stretch = 1.0 - at.curvature * self.offset_m
        tight = int(np.argmin(stretch))
        if stretch[tight] < _LEAST_STRETCH:
            raise ValueError(
                f"a lane {self.offset_m:+g} m from the centre line (left > 0) must stay "
                "outside the centre of every bend, got a radius of "
                f"{1.0 / abs(at.curvature[tight]):.3g} m at s = {s[tight]:.1f} m"
            )
        for name, value in (
            ("_s_m", s),
            ("_lane_m", s - self.offset_m * (at.heading_rad - at.heading_rad[0])),
        ):
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        object.__setattr__(self, "_turn", float(at.heading_rad[0]))
        object.__setattr__(self, "_most", float(np.max(np.abs(at.curvature) / stretch)))

    @property
    def length_m(self) -> float:
        """Return the arc length."""
        return float(self._lane_m[-1])

    @property
    def max_abs_curvature(self) -> float:
        """Return the largest |κ'| at the table's places, half a metre apart."""
        return self._most

    def evaluate(self, s_m: FloatArray) -> CurvePoints:
        """Return position, heading and curvature at arc lengths (t,) within [0, length]."""
        s = self._along_base(self.length_m - s_m if self.backward else s_m)
        at = self.base.evaluate(s)
        sine, cosine = np.sin(at.heading_rad), np.cos(at.heading_rad)
        bend = at.curvature / (1.0 - at.curvature * self.offset_m)
        return CurvePoints(
            x_m=at.x_m - self.offset_m * sine,
            y_m=at.y_m + self.offset_m * cosine,
            heading_rad=at.heading_rad + (math.pi if self.backward else 0.0),
            curvature=-bend if self.backward else bend,
        )

    def _along_base(self, lane_m: FloatArray) -> FloatArray:
        """Invert the lane's arc length, which grows with the base's: Newton within a table cell."""
        if self.offset_m == 0.0:
            return np.clip(lane_m, 0.0, self.base.length_m)
        cell = np.clip(
            np.searchsorted(self._lane_m, lane_m, side="right") - 1, 0, len(self._s_m) - 2
        )
        low, high = self._s_m[cell], self._s_m[cell + 1]
        s = low + (high - low) * np.clip(
            (lane_m - self._lane_m[cell]) / (self._lane_m[cell + 1] - self._lane_m[cell]), 0.0, 1.0
        )
        for _ in range(50):
            at = self.base.evaluate(s)
            error = s - self.offset_m * (at.heading_rad - self._turn) - lane_m
            low, high = np.where(error <= 0.0, s, low), np.where(error >= 0.0, s, high)
            step = s - error / (1.0 - at.curvature * self.offset_m)
            s = np.where((step >= low) & (step <= high), step, 0.5 * (low + high))
            if np.all((np.abs(error) <= _TOLERANCE_M) | (high - low <= _TOLERANCE_M)):
                break
        return s


def lane(road: Road, offset_m: float = 0.0, *, backward: bool = False) -> Road:
    """Return the road that a car follows `offset_m` to the left of the way it drives.

    `backward` drives from the road's end to its start, so that −1.5 is the right-hand lane either
    way. The edges stay where they are; an edge that the lane lies beyond is at distance 0.

    Raises:
        ValueError: if the lane would pass the centre of a bend, naming the place.
    """
    if not math.isfinite(offset_m):
        raise ValueError(f"offset_m must be finite, got {offset_m}")
    if offset_m == 0.0 and not backward:
        return road
    left_of_base = -offset_m if backward else offset_m
    curve = LaneCurve(road.curve, left_of_base, backward)
    period = road.length_m if road.closed else None
    places = np.unique(np.concatenate(([0.0], road.width_s_m, [road.length_m])))
    left = np.interp(places, road.width_s_m, road.left_m, period=period) - left_of_base
    right = np.interp(places, road.width_s_m, road.right_m, period=period) + left_of_base
    at = road.curve.evaluate(places)
    along = places - left_of_base * (at.heading_rad - at.heading_rad[0])
    if backward:
        along, left, right = curve.length_m - along[::-1], right[::-1], left[::-1]
    if road.closed:  # the last place is the first again
        along, left, right = along[:-1], left[:-1], right[:-1]
    return replace(
        road,
        curve=curve,
        width_s_m=along,
        left_m=np.maximum(left, 0.0),
        right_m=np.maximum(right, 0.0),
        _closest=None,
    )
