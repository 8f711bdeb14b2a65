"""What buildings hide, once more: by shapely's intersection matrices instead of our kernels."""

from __future__ import annotations

import numpy as np
import shapely

from models.geometry import BoolArray, FloatArray
from models.obstacles import Obstacles
from placement.referee.sight import Eye


def unhidden(eye: Eye, xy: FloatArray, obstacles: Obstacles) -> BoolArray:
    """Mark the ground points xy (t, 2) that no building hides from `eye`.

    A building hides a point if the part of the ray below its roof meets the inside of its
    footprint; walls, corners and eaves alone do not.
    """
    free = np.ones(len(xy), dtype=np.bool_)
    if not len(xy):
        return free
    mount = np.array([eye.x_m, eye.y_m])
    low, high = np.minimum(xy.min(axis=0), mount), np.maximum(xy.max(axis=0), mount)
    for ring, roof in zip(obstacles.rings, obstacles.height_m.tolist(), strict=True):
        if np.any(ring.max(axis=0) < low) or np.any(ring.min(axis=0) > high):
            continue
        tops = xy + roof / eye.height_m * (mount - xy) if roof < eye.height_m else mount + 0.0 * xy
        footprint = shapely.Polygon(ring)
        rays = shapely.linestrings(np.stack([xy, tops], axis=1))
        free &= ~shapely.relate_pattern(rays, footprint, "T********")
        straight = np.all(xy == tops, axis=1)  # a ray without extent on the ground
        free[straight] &= ~shapely.contains(footprint, shapely.points(xy[straight]))
    return free
