"""Where cameras may stand along a road network, and how they may look: mounts × one menu of poses.

Candidate i is pose i mod p of mount i div p: nothing is stored for each candidate, so that 10⁷ cost
no memory. Mounts are listed along a space-filling curve, so that a stretch of the list is a quarter
of the city: chunks of information, regions and caches all live on that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.cameras import Cameras
from models.files.catalogue import CameraType
from models.geometry import FloatArray, IntArray
from models.network import RoadNetwork
from models.projections import Projection
from models.z_order import z_order
from placement.candidates import facing_poses, refuse_too_many
from placement.instance.schema import CameraSection, MountsSection
from placement.network_mounts import count_tries, place_along

_RIGHT = -1
_ALONG = "mounts stand on the right of every carriageway"
_ONE = "all mounts hold cameras of one kind"


@dataclass(frozen=True, slots=True)
class NetworkMounts:
    """Hold m mounts on the right of their carriageways, and the menu of p poses each may take.

    x_m, y_m, heading_rad, s_m (m,): where each stands, the road's direction there, and arc length
    along all streets in a row.
    edge (m,): its carriageway. poses (p, 5): height [m], yaw (relative to the road) and pitch
    [rad], fields of view [rad]. All have one lens: projection and distortion (4,).
    """

    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    s_m: FloatArray
    edge: IntArray
    poses: FloatArray
    size_px: tuple[int, int]
    projection: Projection
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

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
            distortion=np.tile(np.array(self.distortion), (n, 1)),
        )


def network_order(network: RoadNetwork) -> list[int]:
    """List the edges along a space-filling curve through their middles, ties by index."""
    middles = np.array([_middle(edge.lanes[0].outline) for edge in network.edges])
    return [int(e) for e in np.lexsort((np.arange(len(middles)), z_order(middles)))]


def network_mounts(
    network: RoadNetwork, order: list[int], mounts: MountsSection, camera: CameraSection
) -> NetworkMounts:
    """Put a mount every `mounts.spacing_m` on the right of each carriageway in `order`.

    They stand where `placement.network_mounts.place_along` puts them, on no carriageway and in no
    building.

    Raises:
        ValueError: if more than 5e7 candidates or none would remain, or for a key that would be
            ignored.
    """
    refuse_unknown(mounts, camera)
    menu = _menu(mounts, camera)
    tries = count_tries(network, mounts.spacing_m)
    where = f"{tries:,} places along {network.length_m / 1000.0:.0f} km of carriageways"
    refuse_too_many(tries * len(menu), where, mounts.spacing_m)
    at, _ = place_along(network, mounts.spacing_m, mounts.side_offset_m, [_RIGHT])
    rank = np.full(len(network.edges), -1, dtype=np.int64)
    rank[order] = np.arange(len(order))
    here = np.flatnonzero(rank[at.edge] >= 0)
    here = here[np.argsort(rank[at.edge[here]], kind="stable")]
    if not len(here):
        raise ValueError(
            "mounts.side_offset_m must keep some mount off the carriageways and out of buildings, "
            f"got {mounts.side_offset_m:g}, which leaves none"
        )
    return NetworkMounts(
        x_m=at.x_m[here],
        y_m=at.y_m[here],
        heading_rad=at.heading_rad[here],
        s_m=at.s_m[here],
        edge=at.edge[here],
        poses=menu,
        size_px=camera.resolution_px,
        projection=Projection.parse(camera.projection),
        distortion=camera.distortion,
    )


def refuse_unknown(mounts: MountsSection, camera: CameraSection) -> None:
    """Refuse what mounts along a network's streets, all with one menu, would ignore.

    Raises:
        ValueError: naming the key.
    """
    if mounts.file is not None:
        raise ValueError(f"mounts.file must be left out: {_ALONG}, got {mounts.file}")
    if "sides" in mounts.model_fields_set and mounts.sides != ("right",):
        raise ValueError(f'mounts.sides must be ["right"]: {_ALONG}, got {list(mounts.sides)}')
    if camera.catalogue is not None:
        raise ValueError(f"camera.catalogue must be left out: {_ONE}, got {camera.catalogue}")
    for key, price in (("mounts.cost", mounts.cost), ("camera.price", camera.price)):
        if price:
            raise ValueError(f"{key} must be 0: cameras are counted here, not paid, got {price:g}")


def _menu(mounts: MountsSection, camera: CameraSection) -> FloatArray:
    width, height = camera.resolution_px
    kinds = tuple(CameraType("", width, height, *fov, 0.0) for fov in camera.fov_deg)
    facing = facing_poses(camera, kinds, _RIGHT)
    if not facing:
        raise ValueError(
            "camera.yaw_deg must hold a yaw that does not look away from the road, "
            f"got {list(camera.yaw_deg)}"
        )
    rows = np.array(
        [
            (up, yaw, pitch, *camera.fov_deg[int(kind)])
            for up in mounts.height_m
            for yaw, pitch, kind in facing
        ]
    )
    rows[:, 1:] = np.radians(rows[:, 1:])
    return rows


def _middle(outline: FloatArray) -> FloatArray:
    middle: FloatArray = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
    return middle
