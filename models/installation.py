"""Installation: how well a camera was mounted, and what each offset does to what it reports.

A mounted camera differs from its drawing by six offsets that stay: three of position and three of
orientation. They are independent; each position offset has the standard deviation position_95/2,
each rotation orientation_95/2 ("95 %" figures are two standard deviations). The axes are those of
the **mount frame**: ahead (the camera's azimuth, horizontal), left, up; the rotations are one small
rotation vector (roll, pitch, yaw) about those three axes. A rotation vector with equal standard
deviations is the same in every frame, has no singular pitch (looking straight down, yaw and roll
of Euler angles would coincide and one tilt would be missing), and what an installer's spirit level
and compass leave behind is an error about each axis, not about one only.

What is reported of a car at q = (dx, dy, −h) from the mount then errs, to first order, by

    −(offset_xy + (dx, dy)/h · offset_up)                                       position
    −(ω × q)_xy − (dx, dy)/h · (ω × q)_z                                        rotation ω

whatever the lens: along the line of sight σ² = σ_pos² (1 + d²/h²) + σ_ori² (d² + h²)²/h², across it
σ² = σ_pos² + σ_ori² (d² + h²).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from models.cameras import (
    COS_YAW,
    DOWN,
    FORWARD,
    HEIGHT,
    N_COLUMNS,
    RIGHT,
    SIN_YAW,
    X,
    Y,
)
from models.geometry import FloatArray

N_OFFSETS = 6
AHEAD, LEFT, UP, ROLL, PITCH, YAW = 0, 1, 2, 3, 4, 5


@dataclass(frozen=True, slots=True)
class Installation:
    """State how well cameras are installed and cars found: two standard deviations each.

    position_95_m: each of the three mount offsets. orientation_95_deg: each of the three rotations.
    algorithm_95_px: the image algorithm's error in u and in v, fresh in every frame.
    Raises ValueError for what is negative, not finite, or beyond 10 m, 45 degrees, 1000 px.
    """

    position_95_m: float = 0.03
    orientation_95_deg: float = 0.5
    algorithm_95_px: float = 4.0

    def __post_init__(self) -> None:
        """Refuse impossible figures."""
        for name, value, end in (
            ("position_95_m", self.position_95_m, 10.0),
            ("orientation_95_deg", self.orientation_95_deg, 45.0),
            ("algorithm_95_px", self.algorithm_95_px, 1000.0),
        ):
            if not 0.0 <= value <= end:
                raise ValueError(f"errors.{name} must lie in [0, {end:g}], got {value}")

    @property
    def position_sigma_m(self) -> float:
        """The standard deviation of each mount offset."""
        return 0.5 * self.position_95_m

    @property
    def orientation_sigma_rad(self) -> float:
        """The standard deviation of each small rotation."""
        return 0.5 * math.radians(self.orientation_95_deg)

    @property
    def algorithm_sigma_px(self) -> float:
        """The standard deviation of the image algorithm in u and in v."""
        return 0.5 * self.algorithm_95_px

    def sigmas(self) -> FloatArray:
        """Return the standard deviations of the six offsets (6,), in m and rad."""
        return np.array([self.position_sigma_m] * 3 + [self.orientation_sigma_rad] * 3)


@njit(cache=True)
def offset_jacobian(row: FloatArray, dx: float, dy: float, out: FloatArray) -> None:
    """Write ∂(reported − true position)/∂(offsets) into out (2, 6), in world axes.

    (dx, dy) is the car from the mount, in world axes; offsets in metres and radians, in the order
    ahead, left, up, roll, pitch, yaw.
    """
    h, c, s = row[HEIGHT], row[COS_YAW], row[SIN_YAW]
    ahead, left = c * dx + s * dy, c * dy - s * dx
    out[0, AHEAD], out[1, AHEAD] = -c, -s
    out[0, LEFT], out[1, LEFT] = s, -c
    out[0, UP], out[1, UP] = -dx / h, -dy / h
    # In the mount frame: the reported point moves by (column) per unit of each rotation.
    _turned(c, s, -ahead * left / h, -h - left * left / h, out, ROLL)
    _turned(c, s, h + ahead * ahead / h, ahead * left / h, out, PITCH)
    _turned(c, s, left, -ahead, out, YAW)


@njit(cache=True)
def _turned(c: float, s: float, ahead: float, left: float, out: FloatArray, column: int) -> None:
    out[0, column] = c * ahead - s * left
    out[1, column] = s * ahead + c * left


@njit(cache=True)
def displace_camera(row: FloatArray, offsets: FloatArray, out: FloatArray) -> None:
    """Write the camera as it really stands into out (N_COLUMNS,): `row` moved by `offsets` (6,).

    offsets are in metres and radians (ahead, left, up, roll, pitch, yaw); the rotation is exact
    (Rodrigues), however large. Lens and sensor stay.
    """
    for column in range(N_COLUMNS):
        out[column] = row[column]
    c, s = row[COS_YAW], row[SIN_YAW]
    out[X] = row[X] + c * offsets[AHEAD] - s * offsets[LEFT]
    out[Y] = row[Y] + s * offsets[AHEAD] + c * offsets[LEFT]
    out[HEIGHT] = row[HEIGHT] + offsets[UP]
    wx = c * offsets[ROLL] - s * offsets[PITCH]
    wy = s * offsets[ROLL] + c * offsets[PITCH]
    wz = offsets[YAW]
    angle = math.sqrt(wx * wx + wy * wy + wz * wz)
    if angle == 0.0:
        return
    sine, versine = math.sin(angle) / angle, 2.0 * (math.sin(0.5 * angle) / angle) ** 2
    for axis in (RIGHT, DOWN, FORWARD):
        ax, ay, az = row[axis], row[axis + 1], row[axis + 2]
        along = wx * ax + wy * ay + wz * az
        cosine = math.cos(angle)
        out[axis] = cosine * ax + sine * (wy * az - wz * ay) + versine * along * wx
        out[axis + 1] = cosine * ay + sine * (wz * ax - wx * az) + versine * along * wy
        out[axis + 2] = cosine * az + sine * (wx * ay - wy * ax) + versine * along * wz
