"""The poses a camera may take: mounts along the road × heights, yaws, pitches, fields of view."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from models.cameras import Cameras
from models.geometry import BoolArray, FloatArray, IntArray
from models.projections import Projection
from models.roads import Road
from placement.instance import Instance
from placement.instance.schema import CameraSection

Scalar = TypeVar("Scalar", bound=np.generic)

MOST_CANDIDATES = 50_000_000
_EDGE_M = 1e-6  # a mount this little inside the road's edge stands on it (rounding)
_LEFT, _RIGHT = 1, -1


@dataclass(frozen=True, slots=True)
class Candidates:
    """Hold c candidate poses on m mounts, ordered by mount, height, yaw, pitch, field of view.

    cameras: the c poses in the world.
    mount (c,): each candidate's mount, 0…m − 1; mounts are ordered along the road, left first.
    yaw_deg (c,): yaw relative to the road's direction at the mount (cameras hold the world's).
    mount_s_m, mount_side (m,): arc length, and +1 on the left, −1 on the right.
    mount_x_m, mount_y_m (m,): where the mounts stand.
    """

    cameras: Cameras
    mount: IntArray
    yaw_deg: FloatArray
    mount_s_m: FloatArray
    mount_side: IntArray
    mount_x_m: FloatArray
    mount_y_m: FloatArray

    def __len__(self) -> int:
        """Return the number of candidates, c."""
        return len(self.mount)

    @property
    def n_mounts(self) -> int:
        """The number of mounts, m."""
        return len(self.mount_s_m)

    @property
    def arc_length_m(self) -> FloatArray:
        """Each candidate's place along the road, (c,)."""
        places: FloatArray = self.mount_s_m[self.mount]
        return places


def build_candidates(instance: Instance, road: Road) -> Candidates:
    """List every pose that `[mounts]` and `[camera]` allow along `road`.

    Mounts stand at s = 0, spacing, 2·spacing, … up to the end (on a closed road the last gap may
    be shorter), `side_offset_m` beyond the road's edge on each side. Dropped are

    - mounts that would stand on the road: nearer to any part of the centre line than its half
      width there, as happens in hairpins and inside bends tighter than the offset;
    - poses that look away from the road: those whose optical axis has a horizontal component
      towards the mount's own side. Of eight yaws, three do; 0° and 180°, along the road, stay,
      and so does a camera that looks straight down.

    Raises:
        ValueError: if more than 5e7 candidates or none would remain.
    """
    camera, mounts = instance.camera, instance.mounts
    steps = _count_steps(road, mounts.spacing_m)
    poses = {_LEFT: _facing_poses(camera, _LEFT), _RIGHT: _facing_poses(camera, _RIGHT)}
    sides = [_LEFT if side == "left" else _RIGHT for side in mounts.sides]
    total = steps * len(mounts.height_m) * sum(len(poses[side]) for side in sides)
    if total > MOST_CANDIDATES:
        raise ValueError(
            f"candidates must number at most {MOST_CANDIDATES:,}, got {total:,} ({steps:,} places "
            f"along the road): raise mounts.spacing_m ({mounts.spacing_m:g}) or give fewer of "
            "mounts.height_m, camera.yaw_deg, camera.pitch_deg, camera.fov_deg"
        )
    if total == 0:
        raise ValueError(
            "camera.yaw_deg must hold a yaw that does not look away from the road on one of "
            f"mounts.sides, got {list(camera.yaw_deg)}"
        )
    s, side, x, y = _place_mounts(road, steps, mounts.spacing_m, mounts.side_offset_m, sides)
    if not len(s):
        raise ValueError(
            "mounts.side_offset_m must keep some mount off the road, "
            f"got {mounts.side_offset_m:g}, which leaves none"
        )
    # One row a pose: height, yaw, pitch, horizontal and vertical field of view.
    menus = {
        key: np.array([(h, *pose) for h in mounts.height_m for pose in poses[key]]) for key in sides
    }
    counts = np.array([len(menus[key]) for key in side.tolist()])
    mount = np.repeat(np.arange(len(s)), counts)
    rows = np.concatenate([menus[key] for key in side.tolist()])
    heading = road.evaluate(s).heading_rad
    return Candidates(
        cameras=_as_cameras(camera, x[mount], y[mount], heading[mount], rows),
        mount=_fixed(mount),
        yaw_deg=_fixed(np.ascontiguousarray(rows[:, 1])),
        mount_s_m=_fixed(s),
        mount_side=_fixed(side),
        mount_x_m=_fixed(x),
        mount_y_m=_fixed(y),
    )


def looks_away(yaw_rad: FloatArray, pitch_rad: FloatArray, side: int) -> BoolArray:
    """Mark poses whose optical axis points away from the road; `side` is +1 on its left.

    The rule is cos(pitch)·sin(yaw)·side > 0, with 1e-9 to spare for rounding; yaw is relative to
    the road's direction.
    """
    away: BoolArray = np.cos(pitch_rad) * np.sin(yaw_rad) * side > 1e-9
    return away


def _count_steps(road: Road, spacing_m: float) -> int:
    gaps = road.length_m / spacing_m
    if road.closed:
        return max(1, math.ceil(gaps - 1e-6))
    return math.floor(gaps + 1e-6) + 1


def _facing_poses(camera: CameraSection, side: int) -> list[tuple[float, float, float, float]]:
    poses = [
        (yaw, pitch, *fields)
        for yaw in camera.yaw_deg
        for pitch in camera.pitch_deg
        for fields in camera.fov_deg
    ]
    angles = np.radians([pose[:2] for pose in poses])
    away = looks_away(angles[:, 0], angles[:, 1], side)
    return [pose for pose, drop in zip(poses, away, strict=True) if not drop]


def _place_mounts(
    road: Road, steps: int, spacing_m: float, offset_m: float, sides: list[int]
) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    s = np.repeat(np.minimum(np.arange(steps) * spacing_m, road.length_m), len(sides))
    side = np.tile(np.array(sorted(sides, reverse=True), dtype=np.int64), steps)
    left, right = road.half_widths(s)
    at = road.evaluate(s)
    lateral = side * (np.where(side == _LEFT, left, right) + offset_m)
    x = at.x_m - lateral * np.sin(at.heading_rad)
    y = at.y_m + lateral * np.cos(at.heading_rad)
    nearest, signed = road.project(x, y)
    left, right = road.half_widths(nearest)
    foot = road.evaluate(nearest)
    distance = np.hypot(x - foot.x_m, y - foot.y_m)
    free = distance >= np.where(signed >= 0.0, left, right) - _EDGE_M
    return s[free], side[free], x[free], y[free]


def _as_cameras(
    camera: CameraSection, x: FloatArray, y: FloatArray, heading: FloatArray, rows: FloatArray
) -> Cameras:
    c = len(rows)
    return Cameras(
        x_m=x,
        y_m=y,
        height_m=rows[:, 0].copy(),
        yaw_rad=heading + np.radians(rows[:, 1]),
        pitch_rad=np.radians(rows[:, 2]),
        roll_rad=np.zeros(c),
        hfov_rad=np.radians(rows[:, 3]),
        vfov_rad=np.radians(rows[:, 4]),
        width_px=np.full(c, float(camera.resolution_px[0])),
        height_px=np.full(c, float(camera.resolution_px[1])),
        projection=np.full(c, int(Projection.parse(camera.projection)), dtype=np.int64),
        distortion=np.tile(np.array(camera.distortion, dtype=np.float64), (c, 1)),
    )


def _fixed(array: NDArray[Scalar]) -> NDArray[Scalar]:
    fixed = np.ascontiguousarray(array)
    fixed.flags.writeable = False
    return fixed
