"""All streets of a network laid out for drawing: stretches of one quality, ground, buildings.

Nobody drives all streets in a row, so there is no error along a road to draw: every place has what
a car there knows from its prior and the cameras that see it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from models.footprints import footprint_polygon
from models.geometry import BoolArray, FloatArray, IntArray
from models.shadows import Piece, Shadows
from placement.output import cameras_seeing
from reports.style import BLUE, GREEN, PURPLE

if TYPE_CHECKING:
    from placement.commands import Result

UNSEEN = 0  # the class of streets that no camera sees
COLOURS = ("#a9a9a9", BLUE, GREEN, PURPLE)  # of the classes
_SHARES = (0.15, 0.3)  # of the prior's error, where the classes of what is seen part
_FLAT_M = 0.2  # a line may leave its samples by this much
_JUMP_M = 0.1


@dataclass(frozen=True, slots=True)
class Stretches:
    """Lines (m, 2) along the streets, the class of each, what a class means, a lane's width."""

    lines: tuple[FloatArray, ...]
    kind: IntArray
    labels: tuple[str, ...]
    width_m: float


def stretches_of(result: Result) -> Stretches:
    """Cut all streets where the class of the predicted error changes."""
    scene = result.scene
    journey = scene.journeys[0]
    points, sigma = journey.points, result.prediction.position_sigma_m
    seen = cameras_seeing(journey.information, result.solution.selected) > 0
    limits = error_limits(result)
    kind = np.where(seen, 1 + np.searchsorted(limits, sigma), UNSEEN)
    xy = points.xy
    apart = jumps(xy, points.s_m)
    cuts = np.flatnonzero(apart | (np.diff(kind) != 0)) + 1
    starts = np.concatenate([[0], cuts])
    ends = np.append(cuts, len(xy))
    # A stretch reaches to the first sample of the next, unless the street ends there.
    ends[:-1] += ~apart[cuts - 1]
    long = np.flatnonzero(ends - starts > 1)
    lengths = (ends - starts)[long]
    at = np.repeat(starts[long] - np.cumsum(lengths) + lengths, lengths) + np.arange(lengths.sum())
    lines = shapely.linestrings(xy[at], indices=np.repeat(np.arange(len(long)), lengths))
    flat, owner = shapely.get_coordinates(shapely.simplify(lines, _FLAT_M), return_index=True)
    left, right = scene.road.half_widths(points.s_m)
    low, high = (f"{limit:g}" for limit in limits)
    return Stretches(
        tuple(np.split(flat, np.flatnonzero(np.diff(owner)) + 1)),
        kind[starts[long]].astype(np.int64),
        ("seen by no camera", f"error below {low} m", f"{low} to {high} m", f"above {high} m"),
        float(np.median(left + right)),
    )


def error_limits(result: Result) -> FloatArray:
    """Return the errors (2,) that part good from fair from poor: shares of the prior's, rounded."""
    prior = result.scene.instance.objective.prior_sigma_m * np.sqrt(2.0)
    return np.array([float(f"{share * prior:.1g}") for share in _SHARES])


def jumps(xy: FloatArray, s_m: FloatArray) -> BoolArray:
    """Mark the gaps (t − 1,) between samples where one street ends and another begins."""
    apart: BoolArray = np.hypot(*np.diff(xy, axis=0).T) > 2.0 * np.diff(s_m) + _JUMP_M
    return apart


def visible_ground(result: Result) -> list[list[Piece]]:
    """Return what each camera sees of the ground past the buildings, none or more pieces."""
    scene = result.scene
    chosen = np.array(sorted(result.solution.selected), dtype=np.int64)
    cameras = scene.candidates.cameras.subset(chosen)
    reach, shadows = scene.instance.camera.max_range_m, Shadows(scene.obstacles)
    places = np.column_stack([cameras.x_m, cameras.y_m])
    return [
        shadows.visible(footprint_polygon(cameras, i, reach), places[i], float(cameras.height_m[i]))
        for i in range(len(chosen))
    ]


def buildings_near(result: Result, margin_m: float) -> list[FloatArray]:
    """Return the footprints of buildings within `margin_m` of the box round all samples."""
    xy = result.scene.points.xy
    low, high = xy.min(axis=0) - margin_m, xy.max(axis=0) + margin_m
    return [
        ring
        for ring in result.scene.obstacles.rings
        if np.all(ring.max(axis=0) > low) and np.all(ring.min(axis=0) < high)
    ]
