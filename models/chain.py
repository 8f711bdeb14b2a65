"""Curves one after the other: a drive through a network, or all of its streets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from models.curves import CurvePoints
from models.geometry import FloatArray, Pose
from models.roads import Road

_STEP_M = 1e-6  # between the widths on both sides of a joint


@dataclass(frozen=True, slots=True)
class ChainCurve:
    """Join the centre lines of open `roads`; each lies where it lies, whatever the last ended at.

    The frame's axes are the world's, its origin the first road's start. Headings are continued
    from road to road (by whole turns only), so they stay continuous where the roads do.
    """

    roads: tuple[Road, ...]
    start_m: FloatArray = field(init=False)  # (2,)
    s_m: FloatArray = field(init=False, repr=False)  # (n + 1,) where roads begin, and the end
    _turns: FloatArray = field(init=False, repr=False)  # (n,) whole turns added to headings
    _most: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Add up lengths and turns."""
        if not self.roads:
            raise ValueError("a chain needs at least one road, got none")
        if any(road.closed for road in self.roads):
            raise ValueError("a chain's roads must be open")
        lengths = np.array([road.length_m for road in self.roads])
        turns, heading = [], None
        for road in self.roads:
            ends = road.evaluate(np.array([0.0, road.length_m])).heading_rad
            turn = 0.0
            if heading is not None:
                turn = math.tau * round((heading - float(ends[0])) / math.tau)
            turns.append(turn)
            heading = float(ends[1]) + turn
        for name, value in (
            ("start_m", self.roads[0].evaluate(np.zeros(1)).xy[0]),
            ("s_m", np.concatenate(([0.0], np.cumsum(lengths)))),
            ("_turns", np.array(turns)),
            ("_most", max(road.curve.max_abs_curvature for road in self.roads)),
        ):
            object.__setattr__(self, name, value)

    @property
    def length_m(self) -> float:
        """Return the sum of the lengths."""
        return float(self.s_m[-1])

    @property
    def max_abs_curvature(self) -> float:
        """Return the largest |κ| of any of the roads."""
        return self._most

    def evaluate(self, s_m: FloatArray) -> CurvePoints:
        """Return position, heading and curvature at arc lengths (t,) within [0, length]."""
        s = np.asarray(s_m, dtype=np.float64)
        which = np.clip(np.searchsorted(self.s_m, s, side="right") - 1, 0, len(self.roads) - 1)
        order = np.argsort(which, kind="stable")
        bounds = np.searchsorted(which[order], np.arange(len(self.roads) + 1))
        out = np.empty((4, len(s)))
        for i in np.flatnonzero(np.diff(bounds)):
            rows = order[bounds[i] : bounds[i + 1]]
            inside = np.clip(s[rows] - self.s_m[i], 0.0, self.roads[i].length_m)
            at = self.roads[i].evaluate(inside)
            out[:, rows] = (
                at.x_m - self.start_m[0],
                at.y_m - self.start_m[1],
                at.heading_rad + self._turns[i],
                at.curvature,
            )
        return CurvePoints(*out)


def chain_roads(roads: Sequence[Road]) -> Road:
    """Return open roads as one, with the widths of each.

    Raises:
        ValueError: for no roads, or a closed one.
    """
    if len(roads) == 1 and not roads[0].closed:
        return roads[0]
    curve = ChainCurve(tuple(roads))
    places, left, right = [], [], []
    for road, begin in zip(roads, curve.s_m, strict=False):
        inner = road.width_s_m[(road.width_s_m > _STEP_M) & (road.width_s_m < road.length_m)]
        s = np.concatenate(([0.0], inner, [road.length_m]))
        widths = road.half_widths(s)
        s[0] += min(_STEP_M, 0.5 * road.length_m) if begin > 0.0 else 0.0
        places.append(begin + s)
        left.append(widths[0])
        right.append(widths[1])
    return Road(
        curve,
        False,
        Pose(float(curve.start_m[0]), float(curve.start_m[1])),
        np.concatenate(places),
        np.concatenate(left),
        np.concatenate(right),
    )
