"""The ground that a camera sees past buildings, as polygons: its footprint less their shadows.

A ray from the ground point g to a camera at height h above m passes below a roof of height r on the
share λ ≤ min(1, r/h) of its way. It meets the footprint F of the building there if
g ∈ (F − λ m)/(1 − λ) for one such λ: copies of F, scaled about m by 1 to 1/(1 − r/h), and without
end where the roof is as high as the camera. Scaled, each wall sweeps a quadrilateral, so the shadow
is F and those of its walls, and `models.sight` says the same of every point that is on no border.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from models.geometry import FloatArray
from models.obstacles import Obstacles

_BEYOND = 2.0  # ranges: so far reach shadows without end
_LEAST_M2 = 1e-6  # a piece of less ground is rounding


@dataclass(frozen=True, slots=True)
class Piece:
    """One connected piece of ground: its border and the borders of its holes, (m, 2), open."""

    outline: FloatArray
    holes: tuple[FloatArray, ...] = ()


class Shadows:
    """Cut footprints by the shadows of the buildings near them."""

    def __init__(self, obstacles: Obstacles) -> None:
        """Index the buildings."""
        self._rings = obstacles.rings
        self._heights = obstacles.height_m
        self._shapes = [shapely.Polygon(ring) for ring in obstacles.rings]
        self._tree = shapely.STRtree(self._shapes)

    def visible(self, outline: FloatArray, mount: FloatArray, height_m: float) -> list[Piece]:
        """Return what is left of the footprint `outline` (m, 2) of a camera at `mount` (2,).

        Pieces come largest first; one whole piece where nothing stands in the way.
        """
        if len(outline) < 3:
            return []
        seen: Any = shapely.Polygon(outline)
        hull = shapely.union(shapely.Point(mount), seen).convex_hull
        near = np.sort(self._tree.query(hull, predicate="intersects"))
        if not len(near):
            return [Piece(outline)]
        reach = float(np.hypot(*(outline - mount).T).max())
        shadows = [self._shadow(int(i), mount, height_m, reach) for i in near]
        rest = shapely.difference(shapely.make_valid(seen), shapely.union_all(shadows))
        parts = [p for p in shapely.get_parts(rest) if p.geom_type == "Polygon"]
        parts = sorted((p for p in parts if p.area > _LEAST_M2), key=lambda p: -p.area)
        return [
            Piece(_ring(part.exterior), tuple(_ring(hole) for hole in part.interiors))
            for part in parts
        ]

    def _shadow(self, i: int, mount: FloatArray, height_m: float, reach_m: float) -> Any:
        ring, roof = self._rings[i], float(self._heights[i])
        nearest = max(shapely.distance(self._shapes[i], shapely.Point(mount)), 1e-6 * reach_m)
        largest = _BEYOND * reach_m / nearest + 1.0
        if roof < height_m:
            largest = min(largest, 1.0 / (1.0 - roof / height_m))
        far = mount + largest * (ring - mount)
        walls = [np.array([ring[j - 1], ring[j], far[j], far[j - 1]]) for j in range(len(ring))]
        swept = [shapely.make_valid(shapely.Polygon(wall)) for wall in walls]
        return shapely.union_all([self._shapes[i], *swept])


def _ring(line: Any) -> FloatArray:
    points: FloatArray = np.asarray(line.coords)[:-1]
    return points
