"""The closest point of a curve: a tree finds where to look, Newton's method finds it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import cast

import numpy as np
from scipy.spatial import cKDTree

from models.curves import Curve, CurvePoints
from models.geometry import BoolArray, FloatArray, IntArray

_NEIGHBOURS = 4
_TOLERANCE_M = 1e-11
_TIE_M = 1e-9


@dataclass(slots=True)
class ClosestPoint:
    """Find closest points of one curve; its table and tree are built at the first question."""

    curve: Curve
    closed: bool
    _step_m: float = field(init=False, default=0.0)
    _s_m: FloatArray | None = field(init=False, default=None, repr=False)
    _at: CurvePoints | None = field(init=False, default=None, repr=False)
    _tree: cKDTree | None = field(init=False, default=None, repr=False)
    _max_curvature: float = field(init=False, default=0.0)

    def find(
        self, points_m: FloatArray, near_s_m: FloatArray | None = None, window_m: float = 10.0
    ) -> tuple[FloatArray, FloatArray]:
        """Return arc lengths and left offsets (m,), (m,) of the points (m, 2) in the curve's frame.

        With `near_s_m` (m,), look only within `window_m` of it along the curve. Of points equally
        close (to 1e-9 m) the one with the least arc length is returned.
        """
        self._build()
        if len(points_m) == 0:
            return np.zeros(0), np.zeros(0)
        if near_s_m is None:
            owner, sample = self._near_anywhere(points_m)
        else:
            owner, sample = self._near(points_m, near_s_m, window_m)
        owner, low, high = self._brackets(points_m, owner, sample, prune=near_s_m is None)
        s, stationary = self._descend(points_m[owner], low, high)
        if self.closed:
            s = np.mod(s, self.curve.length_m)
        along, left = _along_and_left(points_m[owner], self.curve.evaluate(s), slice(None))
        # A bracket's end is never better than the minimum beside it, and must not tie with it.
        distance = np.hypot(along, left) + np.where(stationary, 0.0, 2.0 * _TIE_M)
        best = _first_of_closest(owner, s, distance, len(points_m))
        return s[best], left[best]

    def _build(self) -> None:
        if self._tree is not None:
            return
        length = self.curve.length_m
        self._max_curvature = self.curve.max_abs_curvature
        wanted = min(0.25, 0.1 / max(self._max_curvature, 1e-9))
        intervals = int(np.clip(np.ceil(length / wanted), 8, 4_000_000))
        self._step_m = length / intervals
        s = np.linspace(0.0, length, intervals + 1)
        self._s_m = s[:-1] if self.closed else s
        self._at = self.curve.evaluate(self._s_m)
        self._tree = cKDTree(np.column_stack((self._at.x_m, self._at.y_m)))

    def _reach(self, distance: FloatArray) -> FloatArray:
        """Return how far a sample may be and still have the closest point within half a step.

        With f = d²/2 along the curve, f'' = 1 − κ·offset, so half a step δ from the closest point
        the squared distance has grown by at most δ²(1 + κ_max·d).
        """
        delta = 0.5 * self._step_m
        growth = 1.0 + 1.1 * self._max_curvature * (distance + delta)
        return np.sqrt(distance**2 + delta**2 * growth) * (1 + 1e-12) + 1e-12

    def _near_anywhere(self, points: FloatArray) -> tuple[IntArray, IntArray]:
        tree = cast("cKDTree", self._tree)
        distance, index = cast("tuple[FloatArray, IntArray]", tree.query(points, k=_NEIGHBOURS))
        reach = self._reach(distance[:, 0])
        wanted: BoolArray = distance <= reach[:, None]
        crowded = wanted[:, -1]
        owner, column = np.nonzero(wanted & ~crowded[:, None])
        sample = index[owner, column]
        for i in np.flatnonzero(crowded):
            found = np.asarray(tree.query_ball_point(points[i], reach[i]), dtype=np.int64)
            owner = np.concatenate((owner, np.full(len(found), i)))
            sample = np.concatenate((sample, found))
        return owner.astype(np.int64), sample.astype(np.int64)

    def _near(
        self, points: FloatArray, near_s_m: FloatArray, window_m: float
    ) -> tuple[IntArray, IntArray]:
        at, n = cast("CurvePoints", self._at), len(cast("FloatArray", self._s_m))
        half = int(np.clip(np.ceil(window_m / self._step_m), 1, (n - 1) // 2))
        index = np.rint(near_s_m / self._step_m).astype(np.int64)[:, None] + np.arange(
            -half, half + 1
        )
        index = np.mod(index, n) if self.closed else np.clip(index, 0, n - 1)
        distance = np.hypot(points[:, :1] - at.x_m[index], points[:, 1:] - at.y_m[index])
        wanted = distance <= self._reach(distance.min(axis=1))[:, None]
        owner, column = np.nonzero(wanted)
        return owner, index[owner, column]

    def _brackets(
        self, points: FloatArray, owner: IntArray, sample: IntArray, *, prune: bool
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the half steps either side of each sample; `prune` those that hold no minimum.

        In a window the least distance may lie at its end, where nothing is stationary: no pruning.
        """
        at, s = cast("CurvePoints", self._at), cast("FloatArray", self._s_m)
        delta = 0.5 * self._step_m
        along, left = _along_and_left(points[owner], at, sample)
        # f' = −along, and f'' ≤ 1 + κ_max·d: too far along, and the half steps hold no root of f'.
        steepest = 1.0 + 1.1 * self._max_curvature * (np.hypot(along, left) + delta)
        keep = (np.abs(along) <= 1.05 * delta * steepest) | (not prune)
        if not self.closed:
            keep |= (sample == 0) | (sample == len(s) - 1)
        owner, sample, left = owner[keep], sample[keep], left[keep]
        low, high = s[sample] - delta, s[sample] + delta
        if not self.closed:
            low, high = np.maximum(low, 0.0), np.minimum(high, self.curve.length_m)
        # Where f'' may vanish (near the centre of curvature) a half step may hold several minima:
        # cut it up finely enough that they differ by nothing (κ'·offset·(δ/8)³).
        flat = 1.0 - at.curvature[sample] * left < 0.2
        if not flat.any():
            return owner, low, high
        edges = low[flat, None] + (high - low)[flat, None] * np.linspace(0.0, 1.0, 17)
        return (
            np.concatenate((owner[~flat], np.repeat(owner[flat], 16))),
            np.concatenate((low[~flat], edges[:, :-1].ravel())),
            np.concatenate((high[~flat], edges[:, 1:].ravel())),
        )

    def _descend(
        self, points: FloatArray, low: FloatArray, high: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Solve (p − r)·t = 0 in each bracket by Newton's method, falling back on bisection.

        A bracket without a change of sign has its least distance at an end, and its flag unset.
        """
        low, high = low.copy(), high.copy()
        along_low, from_low, _ = self._along(points, low)
        along_high, from_high, _ = self._along(points, high)
        s = np.where(from_low <= from_high, low, high)
        stationary = (along_low >= 0.0) & (along_high <= 0.0)
        active = np.flatnonzero(stationary)
        s[active] = 0.5 * (low + high)[active]
        for _ in range(64):
            if len(active) == 0:
                break
            here = s[active]
            along, _, convexity = self._along(points[active], here)
            ahead = along > 0.0
            low[active[ahead]] = here[ahead]
            high[active[~ahead]] = here[~ahead]
            lo, hi = low[active], high[active]
            with np.errstate(divide="ignore", invalid="ignore"):
                newton = here + along / convexity
            good = (convexity > 0.0) & (newton >= lo) & (newton <= hi)
            s[active] = np.where(good, newton, 0.5 * (lo + hi))
            active = active[np.abs(s[active] - here) > _TOLERANCE_M]
        return s, stationary

    def _along(
        self, points: FloatArray, s: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return (p − r)·t, |p − r| and d²f/ds² = 1 − κ (p − r)·n at arc lengths s."""
        at = self.curve.evaluate(np.mod(s, self.curve.length_m) if self.closed else s)
        along, left = _along_and_left(points, at, slice(None))
        return along, np.hypot(along, left), 1.0 - at.curvature * left


def _along_and_left(
    points: FloatArray, at: CurvePoints, index: IntArray | slice
) -> tuple[FloatArray, FloatArray]:
    """Resolve points (m, 2) less the curve's points along its direction and to its left."""
    dx, dy = points[:, 0] - at.x_m[index], points[:, 1] - at.y_m[index]
    c, s = np.cos(at.heading_rad[index]), np.sin(at.heading_rad[index])
    return dx * c + dy * s, dy * c - dx * s


def _first_of_closest(owner: IntArray, s: FloatArray, distance: FloatArray, n: int) -> IntArray:
    """Return, for each of n points, the job with the least s among its closest."""
    least = np.full(n, np.inf)
    np.minimum.at(least, owner, distance)
    close = np.flatnonzero(distance <= least[owner] + _TIE_M)
    order = close[np.lexsort((s[close], owner[close]))]
    first = np.searchsorted(owner[order], np.arange(n))
    return order[first]
