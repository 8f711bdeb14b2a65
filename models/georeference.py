"""Where on the Earth a road's frame lies: from metres back to a file's own coordinates."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.geometry import FloatArray, Pose

if TYPE_CHECKING:
    from pyproj import CRS, Transformer

LONGITUDE_LATITUDE = "EPSG:4326"


@dataclass(frozen=True, slots=True)
class Georeference:
    """Relate the road's frame (metres) to a file's coordinates.

    A point of the road's frame, moved by `projected_from_road`, is given in the projected
    coordinate reference system `metric_crs`; the file's own coordinates are in `file_crs`, which
    may be the same, or longitude and latitude. Without a `file_crs` nothing is known of the Earth
    and the file's coordinates are the moved metres.
    """

    file_crs: str | None = None
    metric_crs: str | None = None
    projected_from_road: Pose = field(default_factory=Pose)

    def to_file(self, points_m: FloatArray) -> FloatArray:
        """Return points (n, 2) in the file's coordinates: x, y or longitude, latitude."""
        moved = self.projected_from_road.apply(points_m)
        if self.file_crs is None or self.file_crs == self.metric_crs:
            return moved
        return _transform(str(self.metric_crs), self.file_crs, moved)

    def to_road(self, points: FloatArray) -> FloatArray:
        """Return points (n, 2) of the file's coordinates in metres of the road's frame."""
        moved = points
        if self.file_crs is not None and self.file_crs != self.metric_crs:
            moved = _transform(self.file_crs, str(self.metric_crs), points)
        return self.projected_from_road.inverse().apply(moved)


def parse_crs(text: str, where: str) -> CRS:
    """Read a coordinate reference system in any form that PROJ knows.

    Raises:
        ValueError: `where` must be one, if it is not.
    """
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return CRS.from_user_input(text)
    except CRSError:
        raise ValueError(
            f"{where} must be a coordinate reference system that PROJ knows, "
            f"got {' '.join(text.split())[:80]!r}"
        ) from None


def local_metric_crs(longitude: float, latitude: float) -> str:
    """Return a transverse Mercator projection about a point: metres are true to 1e-6 within 9 km.

    The scale grows as 1 + x²/(2R²) with the distance x east or west of the point, so by 1.2e-4
    at 100 km; no zone has an end.
    """
    return (
        f"+proj=tmerc +lat_0={latitude:.7f} +lon_0={longitude:.7f} +k=1 +x_0=0 +y_0=0 "
        "+datum=WGS84 +units=m +no_defs"
    )


def project_to_metres(points: FloatArray, file_crs: str, where: str) -> tuple[str, FloatArray]:
    """Return a metric CRS for points (n, 2) of `file_crs`, and the points in it.

    Projected systems in metres stay as they are; all others go to `local_metric_crs` about the
    middle of the points.

    Raises:
        ValueError: if the system is unknown, or the points do not lie within its use.
    """
    crs = parse_crs(file_crs, where)
    if crs.is_projected and all(axis.unit_conversion_factor == 1.0 for axis in crs.axis_info):
        return file_crs, points
    degrees = _transform(file_crs, LONGITUDE_LATITUDE, points)
    if not np.isfinite(degrees).all() or np.any(np.abs(degrees) > (360.0, 90.0)):
        bad = points[~(np.isfinite(degrees).all(axis=1) & (np.abs(degrees[:, 1]) <= 90.0))]
        at = tuple((bad if len(bad) else points)[0].tolist())
        raise ValueError(f"{where}: coordinates must lie where {file_crs[:60]} holds, got {at}")
    middle = 0.5 * (degrees.min(axis=0) + degrees.max(axis=0))
    metric = local_metric_crs(*middle.tolist())
    metres = _transform(file_crs, metric, points)
    if not np.isfinite(metres).all():
        raise ValueError(f"{where}: coordinates must lie within one region of the Earth")
    return metric, metres


def _transform(source: str, target: str, points: FloatArray) -> FloatArray:
    if not len(points):
        return points.copy()
    x, y = _transformer(source, target).transform(points[:, 0], points[:, 1])
    return np.column_stack((x, y))


@lru_cache(maxsize=32)
def _transformer(source: str, target: str) -> Transformer:
    from pyproj import Transformer

    return Transformer.from_crs(source, target, always_xy=True)
