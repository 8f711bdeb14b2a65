"""What lies near some mounts: the samples and buildings that their cameras may have to do with."""

from __future__ import annotations

import numpy as np

from models.geometry import FloatArray, IntArray
from models.obstacles import Obstacles
from models.roads import RoadPoints

_WIDER = 1.001  # than the reach: borders belong to it


class Surroundings:
    """Cut what is near out of a whole city's samples and buildings, again and again."""

    def __init__(self, points: RoadPoints, obstacles: Obstacles | None) -> None:
        """Look once round every building."""
        self.points = points
        self.obstacles = obstacles or Obstacles()
        rings = self.obstacles.rings
        self._low = np.array([ring.min(axis=0) for ring in rings]).reshape(-1, 2)
        self._high = np.array([ring.max(axis=0) for ring in rings]).reshape(-1, 2)

    def near(
        self, x_m: FloatArray, y_m: FloatArray, reach_m: float
    ) -> tuple[IntArray, RoadPoints, Obstacles]:
        """Return the samples within `reach_m` of a mount, and all buildings that may hide them.

        Mounts (m,) stand at (x_m, y_m). The samples come as their places, rising, and as points.
        """
        from scipy.spatial import cKDTree

        reach = _WIDER * reach_m
        mounts, p = np.column_stack([x_m, y_m]), self.points
        low, high = mounts.min(axis=0) - reach, mounts.max(axis=0) + reach
        place = np.flatnonzero(
            (p.x_m >= low[0]) & (p.x_m <= high[0]) & (p.y_m >= low[1]) & (p.y_m <= high[1])
        )
        # Of one quarter's box other streets' mounts take most: keep what is near one of these.
        xy = np.column_stack([p.x_m[place], p.y_m[place]])
        near = np.isfinite(cKDTree(mounts).query(xy, distance_upper_bound=reach)[0])
        place = place[near]
        rings = np.flatnonzero(np.all((self._high >= low) & (self._low <= high), axis=1))
        obstacles = Obstacles(
            tuple(self.obstacles.rings[i] for i in rings), self.obstacles.height_m[rings]
        )
        return place, points_at(p, place), obstacles


def points_at(points: RoadPoints, place: IntArray) -> RoadPoints:
    """Return the points at `place`, in that order."""
    names = ("s_m", "x_m", "y_m", "heading_rad", "curvature")
    return RoadPoints(*(np.ascontiguousarray(getattr(points, name)[place]) for name in names))
