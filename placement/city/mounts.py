"""Where cameras may stand along a road network, and how they may look: mounts × one menu of poses.

Candidate i is pose i mod p of mount i div p: nothing is stored for each candidate, so that 10⁷ cost
no memory. Mounts are listed along a space-filling curve, so that a stretch of the list is a quarter
of the city: chunks of information, regions and caches all live on that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from models.cameras import Cameras
from models.geometry import FloatArray, IntArray
from models.network import NetworkPoints, RoadNetwork
from models.obstacles import Obstacles
from models.projections import Projection
from models.sight import line_of_sight
from placement.candidates import MOST_CANDIDATES, looks_away
from placement.instance.schema import CameraSection, MountsSection

_EDGE_M = 1e-6  # a mount this little inside a carriageway stands on its border (rounding)
_RIGHT = -1


@dataclass(frozen=True, slots=True)
class NetworkMounts:
    """Hold m mounts on the right of their carriageways, and the menu of p poses each may take.

    x_m, y_m, heading_rad, s_m (m,): where each stands, the road's direction and arc length there.
    edge (m,): its carriageway. poses (p, 5): height [m], yaw (relative to the road) and pitch
    [rad], fields of view [rad].
    """

    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    s_m: FloatArray
    edge: IntArray
    poses: FloatArray
    size_px: tuple[int, int]
    projection: Projection

    def __len__(self) -> int:
        """Return the number of mounts, m."""
        return len(self.x_m)

    @property
    def n_candidates(self) -> int:
        """The number of candidate poses, m·p."""
        return len(self) * len(self.poses)

    def cameras(self, candidates: IntArray) -> Cameras:
        """Return the cameras of `candidates` (n,)."""
        mount, pose = np.divmod(candidates, len(self.poses))
        n, rows = len(candidates), self.poses[pose]
        return Cameras(
            x_m=self.x_m[mount],
            y_m=self.y_m[mount],
            height_m=rows[:, 0],
            yaw_rad=self.heading_rad[mount] + rows[:, 1],
            pitch_rad=rows[:, 2],
            roll_rad=np.zeros(n),
            hfov_rad=rows[:, 3],
            vfov_rad=rows[:, 4],
            width_px=np.full(n, self.size_px[0]),
            height_px=np.full(n, self.size_px[1]),
            projection=np.full(n, int(self.projection)),
            distortion=np.zeros((n, 4)),
        )


def network_order(network: RoadNetwork) -> list[int]:
    """List the edges along a space-filling curve through their middles, ties by index."""
    middles = np.array([_middle(edge.lanes[0].outline) for edge in network.edges])
    return [int(e) for e in np.lexsort((np.arange(len(middles)), _morton(middles)))]


def network_mounts(
    network: RoadNetwork,
    order: list[int],
    samples: NetworkPoints,
    mounts: MountsSection,
    camera: CameraSection,
    obstacles: Obstacles | None = None,
) -> NetworkMounts:
    """Put a mount every `mounts.spacing_m` on the right of each carriageway in `order`.

    Left out are mounts that would stand on some carriageway (nearer to a sample than its half
    width there) or within a building below its roof.

    Raises:
        ValueError: if more than 5e7 candidates or none would remain.
    """
    from scipy.spatial import cKDTree

    poses = _menu(mounts, camera)
    spacing = mounts.spacing_m
    total = sum(math.floor(network.edges[e].length_m / spacing) + 1 for e in order) * len(poses)
    if total > MOST_CANDIDATES:
        raise ValueError(
            f"candidates must number at most {MOST_CANDIDATES:,}, got {total:,} "
            f"({network.length_m / 1000.0:.0f} km of carriageways, {len(poses)} poses a mount): "
            f"raise mounts.spacing_m ({spacing:g}) to {spacing * total / MOST_CANDIDATES:.3g} or "
            "more, or give fewer of mounts.height_m, camera.yaw_deg, camera.pitch_deg, "
            "camera.fov_deg"
        )
    columns: list[FloatArray] = []
    for e in order:
        road = network.edges[e].road
        s = np.arange(math.floor(road.length_m / spacing + 1e-9) + 1) * spacing
        at = road.evaluate(np.minimum(s, road.length_m))
        _, right = road.half_widths(at.s_m)
        lateral = right + mounts.side_offset_m
        columns.append(
            np.column_stack(
                [
                    at.x_m + lateral * np.sin(at.heading_rad),
                    at.y_m - lateral * np.cos(at.heading_rad),
                    at.heading_rad,
                    at.s_m,
                    np.full(len(s), e),
                ]
            )
        )
    x, y, heading, s_m, edge = np.concatenate(columns).T if columns else np.empty((5, 0))
    half = np.minimum(samples.left_m, samples.right_m)
    tree = cKDTree(samples.points.xy)
    near = tree.query(np.column_stack([x, y]), k=8, distance_upper_bound=float(half.max()) + 1.0)
    half = np.append(half, 0.0)
    free = np.all(near[0] >= half[np.minimum(near[1], len(half) - 1)] - _EDGE_M, axis=1)
    if obstacles is not None and len(obstacles) and free.any():
        free &= line_of_sight(obstacles, x, y, mounts.height_m[0], x, y)
    if not free.any():
        raise ValueError(
            "mounts.side_offset_m must keep some mount off the carriageways and out of buildings, "
            f"got {mounts.side_offset_m:g}, which leaves none"
        )
    return NetworkMounts(
        x_m=np.ascontiguousarray(x[free]),
        y_m=np.ascontiguousarray(y[free]),
        heading_rad=np.ascontiguousarray(heading[free]),
        s_m=np.ascontiguousarray(s_m[free]),
        edge=edge[free].astype(np.int64),
        poses=poses,
        size_px=camera.resolution_px,
        projection=Projection.parse(camera.projection),
    )


def _menu(mounts: MountsSection, camera: CameraSection) -> FloatArray:
    rows = np.array(
        [
            (height, yaw, pitch, *fov)
            for height in mounts.height_m
            for yaw in camera.yaw_deg
            for pitch in camera.pitch_deg
            for fov in camera.fov_deg
        ]
    )
    rows[:, 1:] = np.radians(rows[:, 1:])
    # On the right of the road, what looks to the right looks away.
    kept = rows[~looks_away(rows[:, 1], rows[:, 2], _RIGHT)]
    if not len(kept):
        raise ValueError(
            "camera.yaw_deg must hold a yaw that does not look away from the road, "
            f"got {list(camera.yaw_deg)}"
        )
    return kept


def _middle(outline: FloatArray) -> FloatArray:
    middle: FloatArray = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
    return middle


def _morton(points: FloatArray) -> IntArray:
    """Return each point's place on the Z-order curve through the box round all (n,)."""
    low, high = points.min(axis=0), points.max(axis=0)
    scaled = (points - low) / max(float((high - low).max()), 1e-9) * (2**20 - 1)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(20):
        for axis in range(2):
            code |= ((scaled[:, axis].astype(np.int64) >> bit) & 1) << (2 * bit + axis)
    return code
