"""Where the one camera stands, what it may do, and the road it looks at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models.cameras import Cameras, make_camera
from models.errors import ErrorModel
from models.geometry import FloatArray
from models.roads import Piece, Road, RoadPoints, road_from_pieces
from models.vehicle import PROFILES
from placement.information import Information, compute_information
from placement.objectives.navigation_chain import Drive, chain_steps

LENGTH_M = 80.0
SPACING_M = 0.5
BESIDE_M = 3.0  # from the centre line: half of 3 m of road, and 1.5 m
HEIGHT_M = 6.0
SIZE_PX = (900, 900)
RATE_HZ, SPEED_MPS = 10.0, 20.0
INITIAL_SIGMA = (0.1, 0.1, 0.01)
PRIOR_SIGMA_M = 0.5
MOST_TURN_RAD = 0.75 * math.pi  # of the bend, so that a tight one does not close on itself
# The box that is searched: yaw (relative to the road at the mount), pitch, hfov, vfov in degrees.
LOW_DEG = np.array([-180.0, 10.0, 20.0, 20.0])
HIGH_DEG = np.array([180.0, 90.0, 90.0, 90.0])


@dataclass(frozen=True, slots=True)
class Setting:
    """A road of curvature κ with one mount on its left at the middle of the bend.

    With κ > 0 the mount is inside the bend, with κ < 0 outside; a mount on the right is the mirror
    image of one on the left with −κ. `entry` is `arc` (straight, arc, straight) or `clothoid`
    (with a clothoid of a third of the bend's length at either end).
    """

    curvature: float
    entry: str = "arc"
    road: Road = field(init=False)
    points: RoadPoints = field(init=False)
    mount: tuple[float, float, float] = field(init=False)  # x, y, heading of the road

    def __post_init__(self) -> None:
        """Lay out the road and its samples."""
        road = road_from_pieces(pieces(self.curvature, self.entry))
        at = road.evaluate([0.5 * road.length_m])
        x, y = road.offset([0.5 * road.length_m], [BESIDE_M])[0]
        object.__setattr__(self, "road", road)
        object.__setattr__(self, "points", road.sample(SPACING_M))
        object.__setattr__(self, "mount", (float(x), float(y), float(at.heading_rad[0])))

    @property
    def offsets_m(self) -> FloatArray:
        """The samples relative to the mount (t, 2), x along the road's heading at the mount."""
        x, y, heading = self.mount
        dx, dy = self.points.x_m - x, self.points.y_m - y
        c, s = math.cos(heading), math.sin(heading)
        return np.column_stack((c * dx + s * dy, c * dy - s * dx))

    @property
    def frames(self) -> float:
        """How many frames the camera takes while the car passes one sample."""
        return RATE_HZ * self.road.length_m / (len(self.points) - 1) / SPEED_MPS

    def steps(self) -> FloatArray:
        """The odometry chain's steps (t, 10) of the profile `car`."""
        return chain_steps(self.points, PROFILES["car"])

    def cameras(self, poses_deg: FloatArray) -> Cameras:
        """Return the cameras of `poses_deg` (n, 4): yaw, pitch, hfov, vfov."""
        return make_cameras(self.mount, poses_deg)

    def information(self, poses_deg: FloatArray) -> Information:
        """Return what those cameras tell, by the kernels that placements use."""
        return compute_information(
            self.cameras(poses_deg), self.points, error_model(), 150.0,
            frames_per_sample=self.frames,
        )  # fmt: skip

    def drive(self, information: Information) -> Drive:
        """Return the drive that the navigation objectives filter."""
        return Drive(self.points, information, PROFILES["car"], np.array(INITIAL_SIGMA))


def pieces(curvature: float, entry: str) -> list[Piece]:
    """Return 80 m of road with a bend of up to 40 m (at most 135°) in the middle."""
    if curvature == 0.0:
        return [Piece(LENGTH_M)]
    bend = min(0.5 * LENGTH_M, MOST_TURN_RAD / abs(curvature))
    straight = Piece(0.5 * (LENGTH_M - bend))
    if entry == "arc":
        return [straight, Piece(bend, curvature, curvature), straight]
    third = bend / 3.0
    return [
        straight,
        Piece(third, 0.0, curvature),
        Piece(third, curvature, curvature),
        Piece(third, curvature, 0.0),
        straight,
    ]


def error_model() -> ErrorModel:
    """Return the dissertation's circle, white, at the default tolerances."""
    return ErrorModel(kind="radius", persistent=False)


def make_cameras(mount: Sequence[float], poses_deg: FloatArray) -> Cameras:
    """Put cameras of `poses_deg` (n, 4) on a mount (x, y, heading)."""
    n = len(poses_deg)
    one: Any = make_camera(size_px=SIZE_PX)
    radians = np.radians(poses_deg)
    return Cameras(
        x_m=np.full(n, mount[0]),
        y_m=np.full(n, mount[1]),
        height_m=np.full(n, HEIGHT_M),
        yaw_rad=mount[2] + radians[:, 0],
        pitch_rad=radians[:, 1],
        roll_rad=np.zeros(n),
        hfov_rad=radians[:, 2],
        vfov_rad=radians[:, 3],
        width_px=np.full(n, SIZE_PX[0]),
        height_px=np.full(n, SIZE_PX[1]),
        projection=np.full(n, one.projection[0]),
        distortion=np.zeros((n, 4)),
    )
