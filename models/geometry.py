"""Planar poses and angles: the smallest things everything else is built from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@overload
def wrap_angle(angle_rad: float) -> float: ...
@overload
def wrap_angle(angle_rad: FloatArray) -> FloatArray: ...
def wrap_angle(angle_rad: float | FloatArray) -> float | FloatArray:
    """Map an angle to [−π, π)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


@dataclass(frozen=True, slots=True)
class Pose:
    """Place a frame in the plane by (x_m, y_m, heading_rad): heading from +x, counter-clockwise.

    A pose is the transform `parent_from_child`: `pose.apply(p)` gives the parent-frame
    coordinates of a point whose child-frame coordinates are `p`.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0

    def __matmul__(self, other: Pose) -> Pose:
        """Compose: (a_from_b @ b_from_c) = a_from_c."""
        x, y = self.apply(np.array([other.x_m, other.y_m]))
        return Pose(float(x), float(y), wrap_angle(self.heading_rad + other.heading_rad))

    def inverse(self) -> Pose:
        """Return child_from_parent."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        return Pose(
            -c * self.x_m - s * self.y_m,
            s * self.x_m - c * self.y_m,
            wrap_angle(-self.heading_rad),
        )

    def apply(self, points_m: FloatArray) -> FloatArray:
        """Map child-frame points (..., 2) to the parent frame."""
        c, s = math.cos(self.heading_rad), math.sin(self.heading_rad)
        rotation = np.array([[c, -s], [s, c]])
        moved: FloatArray = np.asarray(points_m) @ rotation.T + np.array([self.x_m, self.y_m])
        return moved


def frozen(array: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return a read-only view of `array`, for the fields of immutable values."""
    view = array.view()
    view.flags.writeable = False
    return view
