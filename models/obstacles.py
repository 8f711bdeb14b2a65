"""Obstacles: buildings as prisms, which block a camera's view and, later, a road's way."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from models.geometry import FloatArray

if TYPE_CHECKING:
    from shapely import Geometry, Polygon

_SPLITS = 64  # of one polygon round its holes: a footprint with more is no building


@dataclass(frozen=True, slots=True)
class Obstacles:
    """Hold n prisms on the ground, in metres of the road's frame.

    rings: n arrays (m_i, 2) of corners, m_i ≥ 3, the first not repeated at the end, counter-
        clockwise and simple when made by `obstacles_from_polygons`; each is the prism's footprint,
        its inside included.
    height_m (n,): how high each one stands, above 0; infinite is allowed.

    Raises:
        ValueError: one line that names the ring, for corners that are too few or not finite, or
            a height that is not positive.
    """

    rings: tuple[FloatArray, ...] = ()
    height_m: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        """Check the rings once and make them read-only."""
        rings = tuple(_checked_ring(ring, i) for i, ring in enumerate(self.rings))
        height = np.array(self.height_m, dtype=np.float64)
        if height.shape != (len(rings),):
            raise ValueError(
                f"height_m must have one number for each of {len(rings)} rings, "
                f"got shape {height.shape}"
            )
        for i in np.flatnonzero(~(height > 0.0)):
            raise ValueError(f"height_m[{i}] must be above 0, got {height[i]}")
        height.flags.writeable = False
        object.__setattr__(self, "rings", rings)
        object.__setattr__(self, "height_m", height)

    def __len__(self) -> int:
        """Return the number of prisms, n."""
        return len(self.rings)

    def moved(self, dx_m: float, dy_m: float) -> Obstacles:
        """Return the same prisms, shifted."""
        shift = np.array([dx_m, dy_m])
        return Obstacles(tuple(ring + shift for ring in self.rings), self.height_m)


def obstacles_from_polygons(
    polygons: Iterable[tuple[ArrayLike, Sequence[ArrayLike]]], height_m: ArrayLike
) -> tuple[Obstacles, int, int]:
    """Make prisms of outlines with holes, mended where they cross themselves.

    Each of `polygons` is an outline (m, 2) and its holes; `height_m` (n,) are their heights. What
    crosses itself is split into simple rings by the even–odd rule, what has holes is cut through
    them into rings without, so that rings cover what the polygons cover.

    Returns the obstacles, and how many polygons were mended, and how many left out because they
    enclose nothing.
    """
    import shapely

    heights = np.asarray(height_m, dtype=np.float64)
    rings: list[FloatArray] = []
    tall: list[float] = []
    mended = empty = 0
    for (outline, holes), height in zip(polygons, heights.tolist(), strict=True):
        outer = np.asarray(outline, dtype=np.float64)
        shape: Geometry | None = None
        if len(_open(outer)) >= 3:
            inner = [ring for ring in map(np.asarray, holes) if len(_open(ring)) >= 3]
            shape = shapely.Polygon(outer, inner)
            if not shape.is_valid:
                shape = shapely.make_valid(shape)
                mended += 1
        found = [] if shape is None else [r for part in _parts(shape) for r in _without_holes(part)]
        empty += not found
        rings += found
        tall += [height] * len(found)
    return Obstacles(tuple(rings), np.array(tall)), mended, empty


def _checked_ring(ring: ArrayLike, i: int) -> FloatArray:
    corners = np.array(ring, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise ValueError(f"rings[{i}] must be at least 3 corners (m, 2), got {corners.shape}")
    if not np.isfinite(corners).all():
        raise ValueError(f"rings[{i}] must be finite")
    corners.flags.writeable = False
    return corners


def _open(ring: FloatArray) -> FloatArray:
    """Drop a repeated last corner."""
    closed = len(ring) > 1 and bool(np.all(ring[0] == ring[-1]))
    return ring[:-1] if closed else ring


def _parts(shape: Geometry) -> list[Polygon]:
    """List the polygons of a geometry; lines and points, which hide nothing, drop out."""
    import shapely

    parts: list[Polygon] = []
    for part in shapely.get_parts(shape):
        if isinstance(part, shapely.Polygon):
            parts += [part] if part.area > 0.0 else []
        elif hasattr(part, "geoms"):
            parts += _parts(part)
    return parts


def _without_holes(polygon: Polygon) -> list[FloatArray]:
    """Cut a polygon through its holes, left to right, until no part has one."""
    import shapely

    waiting: list[Polygon] = [polygon]
    done: list[FloatArray] = []
    while waiting:
        part = waiting.pop()
        if not part.interiors or len(done) + len(waiting) > _SPLITS:
            ring = np.array(part.exterior.coords, dtype=np.float64)[:-1, :2]
            done.append(ring if part.exterior.is_ccw else ring[::-1].copy())
            continue
        x0, y0, x1, y1 = part.bounds
        hole = part.interiors[0].bounds
        cut = 0.5 * (hole[0] + hole[2])
        for half in (shapely.box(x0, y0, cut, y1), shapely.box(cut, y0, x1, y1)):
            waiting += _parts(part.intersection(half))
    return done
