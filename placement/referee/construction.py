"""Is the road that was chosen one that `[road.construct]` allows? By points and shapely alone."""

from __future__ import annotations

import math

import numpy as np
import shapely

from models.roads import Road
from placement.instance import Instance
from placement.obstacles import build_obstacles
from placement.referee.checks import Check

_STEP_M = 0.1
_SLIP_M = 1e-3  # what a chord of 0.1 m and a polygon mended by shapely may lose


def construct_checks(instance: Instance, road: Road) -> list[Check]:
    """Check clearance, radius and both end poses at every 0.1 m; nothing without a construct."""
    section = instance.road.constructed
    if section is None:
        return []
    points = road.sample(_STEP_M).xy
    line = shapely.LineString(points)
    rings = build_obstacles(instance).rings
    wanted = section.clearance_m + 0.5 * instance.road.width_m
    kept = min((line.distance(shapely.Polygon(ring)) for ring in rings), default=math.inf)
    steps = np.diff(points, axis=0)
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    bend = float(np.abs(np.diff(headings)).max(initial=0.0)) / float(np.hypot(*steps.T).mean())
    ends = road.evaluate([0.0, road.length_m])
    misses = [
        math.hypot(ends.x_m[n] - pose[0], ends.y_m[n] - pose[1])
        + abs(math.remainder(float(ends.heading_rad[n]) - math.radians(pose[2]), math.tau))
        for n, pose in enumerate((section.start, section.goal))
    ]
    most = 1.0 / section.min_radius_m
    return [
        Check("road.clearance", kept >= wanted - _SLIP_M, f"at least {wanted!r}", kept, _SLIP_M),
        Check("road.curvature", bend <= most * (1.0 + 1e-3), f"at most {most!r}", bend, 1e-3),
        Check("road.ends", max(misses) <= 1e-6, "start and goal", misses, 1e-6),
    ]
