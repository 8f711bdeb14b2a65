"""The poses a camera may take: mounts along the road × heights, yaws, pitches, kinds of camera."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from models.cameras import Cameras, make_camera
from models.files.catalogue import CameraType, read_catalogue
from models.files.poles import read_poles
from models.geometry import BoolArray, FloatArray, IntArray
from models.network import RoadNetwork
from models.projections import Projection
from models.roads import Road
from placement.instance import Instance
from placement.instance.schema import CameraSection
from placement.network_mounts import count_tries, place_along, surface_of
from placement.roadway import georeference_of, network_of

Scalar = TypeVar("Scalar", bound=np.generic)

MOST_CANDIDATES = 50_000_000
_EDGE_M = 1e-6  # a mount this little inside the road's edge stands on it (rounding)
_LEFT, _RIGHT = 1, -1


@dataclass(frozen=True, slots=True)
class Candidates:
    """Hold c candidate poses on m mounts, ordered by mount, height, yaw, pitch, kind of camera.

    cameras: the c poses in the world.
    mount (c,): each candidate's mount, 0…m − 1; mounts are ordered along the road, left first, or
        as their file has them.
    kind (c,): each candidate's place in `kinds`, the camera types; one without a name is a field
        of view of `[camera]`.
    cost (c,): mount and camera together.
    yaw_deg (c,): yaw relative to the road's direction at the mount (cameras hold the world's).
    mount_s_m, mount_side (m,): arc length, and +1 on the left, −1 on the right.
    mount_x_m, mount_y_m (m,): where the mounts stand.
    """

    cameras: Cameras
    mount: IntArray
    kind: IntArray
    kinds: tuple[CameraType, ...]
    cost: FloatArray
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
    be shorter), `side_offset_m` beyond the road's edge on each side; or where a file of poles has
    them. On a network they stand as `placement.network_mounts` has it, and `road` is all of its
    streets in a row. Dropped are

    - mounts that would stand on the road: nearer to any part of the centre line than its half
      width there, as happens in hairpins and inside bends tighter than the offset. Poles of a
      file keep their numbers, but get no poses there, nor beyond `camera.max_range_m` of the road;
    - poses that look away from the road: those whose optical axis has a horizontal component
      towards the mount's own side. Of eight yaws, three do; 0° and 180°, along the road, stay,
      and so does a camera that looks straight down.

    Raises:
        ValueError: if more than 5e7 candidates or none would remain, or for what is wrong in a
            file of poles or a catalogue.
    """
    camera, mounts = instance.camera, instance.mounts
    kinds = _kinds(instance)
    sides = [_LEFT if side == "left" else _RIGHT for side in mounts.sides]
    if "mounts.file" in instance.files:
        sides = [_LEFT, _RIGHT]
    poses = {side: facing_poses(camera, kinds, side) for side in sides}
    if not any(poses.values()):
        raise ValueError(
            "camera.yaw_deg must hold a yaw that does not look away from the road on one of "
            f"mounts.sides, got {list(camera.yaw_deg)}"
        )
    network = network_of(instance)
    if "mounts.file" in instance.files:
        at = _standing_mounts(instance, road, network)
    elif network is not None:
        steps = count_tries(network, mounts.spacing_m)
        total = steps * len(mounts.height_m) * sum(len(poses[side]) for side in sides)
        refuse_too_many(total, f"{steps:,} places along the streets", mounts.spacing_m)
        at = _street_mounts(network, instance, sides)
    else:
        steps = _count_steps(road, mounts.spacing_m)
        total = steps * len(mounts.height_m) * sum(len(poses[side]) for side in sides)
        refuse_too_many(total, f"{steps:,} places along the road", mounts.spacing_m)
        at = _place_mounts(road, steps, instance, sides)
    if not at.free.any():
        raise ValueError(at.nowhere)
    # One row a pose: height, yaw, pitch, kind.
    menus: list[FloatArray] = []
    known: dict[tuple[int, tuple[float, ...]], FloatArray] = {}
    for side, heights, free in zip(at.side.tolist(), at.heights, at.free, strict=True):
        key = (side, heights if free else ())
        if key not in known:
            rows = [(height, *pose) for height in key[1] for pose in poses[side]]
            known[key] = np.array(rows, dtype=np.float64).reshape(len(rows), 4)
        menus.append(known[key])
    counts = np.array([len(menu) for menu in menus])
    refuse_too_many(int(counts.sum()), f"{len(menus):,} poles", mounts.spacing_m)
    mount = np.repeat(np.arange(len(menus)), counts)
    rows_of = np.concatenate(menus)
    if not len(rows_of):
        raise ValueError(at.nowhere)
    kind = rows_of[:, 3].astype(np.int64)
    heading = road.evaluate(at.s).heading_rad
    price = np.array([each.price for each in kinds])
    return Candidates(
        cameras=_as_cameras(camera, kinds, at.x[mount], at.y[mount], heading[mount], rows_of),
        mount=_fixed(mount),
        kind=_fixed(kind),
        kinds=kinds,
        cost=_fixed(at.cost[mount] + price[kind]),
        yaw_deg=_fixed(np.ascontiguousarray(rows_of[:, 1])),
        mount_s_m=_fixed(at.s),
        mount_side=_fixed(at.side),
        mount_x_m=_fixed(at.x),
        mount_y_m=_fixed(at.y),
    )


@dataclass(frozen=True, slots=True)
class _Mounts:
    """Where m mounts stand, which of them may hold a camera, and what to say if none may."""

    s: FloatArray
    side: IntArray
    x: FloatArray
    y: FloatArray
    heights: list[tuple[float, ...]]
    cost: FloatArray
    free: BoolArray
    nowhere: str


def _kinds(instance: Instance) -> tuple[CameraType, ...]:
    """List the camera types there are: those of the catalogue, or one for each field of view."""
    camera = instance.camera
    if "camera.catalogue" not in instance.files:
        width, height = camera.resolution_px
        return tuple(CameraType("", width, height, *fov, camera.price) for fov in camera.fov_deg)
    path = instance.files["camera.catalogue"]
    kinds = read_catalogue(path)
    for kind in kinds:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the candidates' cameras will say it
                make_camera(
                    fov_deg=(kind.hfov_deg, kind.vfov_deg),
                    size_px=(kind.width_px, kind.height_px),
                    projection=camera.projection,
                    distortion=camera.distortion,
                )
        except ValueError as error:
            raise ValueError(f"{path}: {kind.name}: {error}") from None
    return kinds


def refuse_too_many(total: int, where: str, spacing_m: float) -> None:
    """Refuse more than `MOST_CANDIDATES` poses, with the figure and what to change."""
    if total > MOST_CANDIDATES:
        wide = spacing_m * total / MOST_CANDIDATES
        raise ValueError(
            f"candidates must number at most {MOST_CANDIDATES:,}, got {total:,} ({where}): "
            f"raise mounts.spacing_m ({spacing_m:g}) to {wide:.3g} or more, or give fewer of "
            "mounts.height_m, camera.yaw_deg, camera.pitch_deg, camera.fov_deg"
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


def facing_poses(
    camera: CameraSection, kinds: tuple[CameraType, ...], side: int
) -> list[tuple[float, float, float]]:
    """List yaw, pitch (degrees) and kind of every pose that does not look away on `side`."""
    poses = [
        (yaw, pitch, float(kind))
        for yaw in camera.yaw_deg
        for pitch in camera.pitch_deg
        for kind in range(len(kinds))
    ]
    angles = np.radians([pose[:2] for pose in poses])
    away = looks_away(angles[:, 0], angles[:, 1], side)
    return [pose for pose, drop in zip(poses, away, strict=True) if not drop]


def _place_mounts(road: Road, steps: int, instance: Instance, sides: list[int]) -> _Mounts:
    mounts = instance.mounts
    s = np.repeat(np.minimum(np.arange(steps) * mounts.spacing_m, road.length_m), len(sides))
    side = np.tile(np.array(sorted(sides, reverse=True), dtype=np.int64), steps)
    left, right = road.half_widths(s)
    at = road.evaluate(s)
    lateral = side * (np.where(side == _LEFT, left, right) + mounts.side_offset_m)
    x = at.x_m - lateral * np.sin(at.heading_rad)
    y = at.y_m + lateral * np.cos(at.heading_rad)
    free = _off_the_road(road, x, y)[2]
    n = int(free.sum())
    return _Mounts(
        s[free],
        side[free],
        x[free],
        y[free],
        [mounts.height_m] * n,
        np.full(n, mounts.cost),
        np.ones(n, dtype=np.bool_),
        "mounts.side_offset_m must keep some mount off the road, "
        f"got {mounts.side_offset_m:g}, which leaves none",
    )


def _street_mounts(network: RoadNetwork, instance: Instance, sides: list[int]) -> _Mounts:
    mounts = instance.mounts
    at, tried = place_along(network, mounts.spacing_m, mounts.side_offset_m, sides)
    n = len(at.s_m)
    return _Mounts(
        at.s_m,
        at.side,
        at.x_m,
        at.y_m,
        [mounts.height_m] * n,
        np.full(n, mounts.cost),
        np.ones(n, dtype=np.bool_),
        f"mounts must stand off every street and building, got none of {tried:,} places free: "
        f"change mounts.side_offset_m ({mounts.side_offset_m:g}) or mounts.sides",
    )


def _standing_mounts(instance: Instance, road: Road, network: RoadNetwork | None) -> _Mounts:
    """Find the poles of a file along the road, in the file's order."""
    mounts, path = instance.mounts, instance.files["mounts.file"]
    poles = read_poles(path, georeference_of(instance))
    if network is None:
        s, lateral, off = _off_the_road(road, poles.x_m, poles.y_m)
    else:
        surface = surface_of(network)
        s, lateral = surface.nearest(poles.x_m, poles.y_m)
        off = ~surface.covers(poles.x_m, poles.y_m)
    reach = instance.camera.max_range_m
    for n in np.flatnonzero(~off)[:1]:
        more = int(np.sum(~off)) - 1
        warnings.warn(
            f"{path}: features[{n}] stands on the road and gets no camera"
            + (f", as do {more} more" if more else ""),
            stacklevel=2,
        )
    foot = road.evaluate(s)
    near = np.hypot(poles.x_m - foot.x_m, poles.y_m - foot.y_m) <= reach
    heights = [
        mounts.height_m if math.isnan(height) else (height,) for height in poles.height_m.tolist()
    ]
    return _Mounts(
        s,
        np.where(lateral >= 0.0, _LEFT, _RIGHT).astype(np.int64),
        poles.x_m,
        poles.y_m,
        heights,
        mounts.cost + poles.cost,
        off & near,
        f"mounts.file must hold a pole beside the road and within camera.max_range_m ({reach:g} m) "
        f"of it, got none in {path}: coordinates are metres in the road's frame",
    )


def _off_the_road(
    road: Road, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return arc length and lateral distance of points, and which stand beyond the road's edges."""
    nearest, signed = road.project(x, y)
    left, right = road.half_widths(nearest)
    foot = road.evaluate(nearest)
    distance = np.hypot(x - foot.x_m, y - foot.y_m)
    free: BoolArray = distance >= np.where(signed >= 0.0, left, right) - _EDGE_M
    return nearest, signed, free


def _as_cameras(
    camera: CameraSection,
    kinds: tuple[CameraType, ...],
    x: FloatArray,
    y: FloatArray,
    heading: FloatArray,
    rows: FloatArray,
) -> Cameras:
    c = len(rows)
    kind = rows[:, 3].astype(np.int64)
    return Cameras(
        x_m=x,
        y_m=y,
        height_m=rows[:, 0].copy(),
        yaw_rad=heading + np.radians(rows[:, 1]),
        pitch_rad=np.radians(rows[:, 2]),
        roll_rad=np.zeros(c),
        hfov_rad=np.radians(np.array([each.hfov_deg for each in kinds]))[kind],
        vfov_rad=np.radians(np.array([each.vfov_deg for each in kinds]))[kind],
        width_px=np.array([each.width_px for each in kinds])[kind],
        height_px=np.array([each.height_px for each in kinds])[kind],
        projection=np.full(c, int(Projection.parse(camera.projection)), dtype=np.int64),
        distortion=np.tile(np.array(camera.distortion, dtype=np.float64), (c, 1)),
    )


def _fixed(array: NDArray[Scalar]) -> NDArray[Scalar]:
    fixed = np.ascontiguousarray(array)
    fixed.flags.writeable = False
    return fixed
