"""Cameras: pose, lens and sensor, and the way between a pixel and the ground.

Pixel coordinates have (0, 0) at the image's top left corner and (width, height) at the bottom
right; the centre of the first pixel is (0.5, 0.5) and the optical axis meets the image's middle.
The focal lengths follow from the fields of view: the middle of the left and right edge is hfov/2
off the axis, the middle of the upper and lower one vfov/2, distortion included.

Kernels take a camera as one row of `Cameras.table()`; its columns are named here. Everything inside
a kernel is relative to the mount (dx, dy), so a scene shifted by 10⁵ m loses no digit.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, fields

import numpy as np
from numba import njit

from models.camera_checks import BORDER, angle_limits, check_cameras
from models.geometry import BoolArray, FloatArray, IntArray, frozen
from models.projections import (
    PINHOLE,
    STEREOGRAPHIC,
    Projection,
    image_from_ray,
    lens_frame,
    lens_radius,
    ray_from_image,
)

# Columns of the table: the mount, the axes right, down, forward in the world frame (x, y, z each),
# focal lengths [px], image size [px], lens, last angle it maps [rad], half image sizes at focal
# length 1, and the azimuth of the view.
X, Y, HEIGHT = 0, 1, 2
RIGHT, DOWN, FORWARD = 3, 6, 9
FOCAL_U, FOCAL_V, WIDTH, HEIGHT_PX = 12, 13, 14, 15
KIND, K1, K2, K3, K4, ANGLE_LIMIT = 16, 17, 18, 19, 20, 21
HALF_U, HALF_V = 22, 23
COS_YAW, SIN_YAW = 24, 25
N_COLUMNS = 26


@dataclass(frozen=True, slots=True)
class Cameras:
    """Hold c cameras, each field an array (c,), `distortion` (c, 4).

    Yaw is in the world frame, counter-clockwise from +x; pitch is below the horizon (π/2 looks
    straight down, the upper image edge towards the yaw); roll turns the image clockwise as the
    camera sees it. Fields of view are full angles. Raises ValueError naming the first field and
    camera that is impossible; warns about pinholes wider than 90°, which stretch their corners.
    """

    x_m: FloatArray
    y_m: FloatArray
    height_m: FloatArray
    yaw_rad: FloatArray
    pitch_rad: FloatArray
    roll_rad: FloatArray
    hfov_rad: FloatArray
    vfov_rad: FloatArray
    width_px: IntArray
    height_px: IntArray
    projection: IntArray
    distortion: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays and refuse impossible cameras."""
        integers = ("width_px", "height_px", "projection")
        for field in fields(self):
            kind = np.int64 if field.name in integers else np.float64
            array = np.array(getattr(self, field.name), dtype=kind)
            shape = (len(self.x_m), 4) if field.name == "distortion" else (len(self.x_m),)
            if array.shape != shape:
                raise ValueError(f"camera.{field.name} must have shape {shape}, got {array.shape}")
            object.__setattr__(self, field.name, frozen(array))
        check_cameras(self)

    def __len__(self) -> int:
        """Return the number of cameras, c."""
        return len(self.x_m)

    def subset(self, indices: IntArray | BoolArray | list[int]) -> Cameras:
        """Return the cameras at `indices`, in that order."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # said when the whole set was made
            return Cameras(
                **{field.name: getattr(self, field.name)[indices] for field in fields(self)}
            )

    def axes(self) -> FloatArray:
        """Return world_from_camera rotations (c, 3, 3): columns right, down, forward."""
        cy, sy = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        cp, sp = np.cos(self.pitch_rad), np.sin(self.pitch_rad)
        cr, sr = np.cos(self.roll_rad), np.sin(self.roll_rad)
        zero = np.zeros(len(self))
        right = np.stack([sy, -cy, zero], axis=1)
        down = np.stack([-sp * cy, -sp * sy, -cp], axis=1)
        forward = np.stack([cp * cy, cp * sy, -sp], axis=1)
        rolled_right = cr[:, None] * right + sr[:, None] * down
        rolled_down = cr[:, None] * down - sr[:, None] * right
        return np.stack([rolled_right, rolled_down, forward], axis=2)

    def half_sizes(self) -> FloatArray:
        """Return half the image's width and height at focal length 1, (c, 2)."""
        return _half_sizes(self.projection, self.hfov_rad, self.vfov_rad, self.distortion)

    def table(self) -> FloatArray:
        """Return what kernels need of each camera, (c, N_COLUMNS), columns as named above."""
        rows = np.empty((len(self), N_COLUMNS))
        rows[:, X], rows[:, Y], rows[:, HEIGHT] = self.x_m, self.y_m, self.height_m
        axes = self.axes()
        rows[:, RIGHT : RIGHT + 3] = axes[:, :, 0]
        rows[:, DOWN : DOWN + 3] = axes[:, :, 1]
        rows[:, FORWARD : FORWARD + 3] = axes[:, :, 2]
        rows[:, WIDTH], rows[:, HEIGHT_PX] = self.width_px, self.height_px
        rows[:, KIND] = self.projection
        rows[:, K1 : K4 + 1] = self.distortion
        rows[:, HALF_U : HALF_V + 1] = self.half_sizes()
        rows[:, FOCAL_U] = 0.5 * rows[:, WIDTH] / rows[:, HALF_U]
        rows[:, FOCAL_V] = 0.5 * rows[:, HEIGHT_PX] / rows[:, HALF_V]
        limits = angle_limits(self.projection, self.distortion)
        rows[:, ANGLE_LIMIT] = limits
        rows[:, COS_YAW], rows[:, SIN_YAW] = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return rows

    def pixel_from_ground(self, camera: IntArray, xy_m: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Map ground points (n, 2), each seen by camera[n], to pixels (n, 2) and whether inside.

        A point the lens cannot map is NaN and not inside.
        """
        return _pixels_from_ground(self.table(), np.asarray(camera, np.int64), np.asarray(xy_m))

    def ground_from_pixel(
        self, camera: IntArray, pixel: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Map pixels (n, 2) of camera[n] to ground points (n, 2) and whether the ray hits ground.

        A ray at or above the horizon hits nothing: NaN and False, no error.
        """
        return _ground_from_pixels(self.table(), np.asarray(camera, np.int64), np.asarray(pixel))


def make_camera(
    *,
    x_m: float = 0.0,
    y_m: float = 0.0,
    height_m: float = 6.0,
    yaw_deg: float = 0.0,
    pitch_deg: float = 45.0,
    roll_deg: float = 0.0,
    fov_deg: tuple[float, float] = (60.0, 60.0),
    size_px: tuple[int, int] = (2000, 2000),
    projection: str = "pinhole",
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
) -> Cameras:
    """Return one camera (c = 1), in degrees."""
    return Cameras(
        x_m=np.array([x_m]),
        y_m=np.array([y_m]),
        height_m=np.array([height_m]),
        yaw_rad=np.radians([yaw_deg]),
        pitch_rad=np.radians([pitch_deg]),
        roll_rad=np.radians([roll_deg]),
        hfov_rad=np.radians([fov_deg[0]]),
        vfov_rad=np.radians([fov_deg[1]]),
        width_px=np.array([size_px[0]]),
        height_px=np.array([size_px[1]]),
        projection=np.array([Projection.parse(projection)]),
        distortion=np.array([distortion]),
    )


@njit(cache=True)
def camera_ray(row: FloatArray, dx: float, dy: float) -> tuple[float, float, float]:
    """Return the ray (right, down, forward) from the camera to the ground point at (dx, dy).

    (dx, dy) is relative to the mount, in world axes; the ray's length is the distance in metres.
    """
    h = row[HEIGHT]
    return (
        row[RIGHT] * dx + row[RIGHT + 1] * dy - row[RIGHT + 2] * h,
        row[DOWN] * dx + row[DOWN + 1] * dy - row[DOWN + 2] * h,
        row[FORWARD] * dx + row[FORWARD + 1] * dy - row[FORWARD + 2] * h,
    )


@njit(cache=True)
def pixel_from_offset(row: FloatArray, dx: float, dy: float) -> tuple[float, float, bool]:
    """Return the pixel (u, v) that sees the ground at (dx, dy) from the mount, and if inside."""
    right, down, forward = camera_ray(row, dx, dy)
    kind = int(row[KIND])
    u, v = image_from_ray(kind, right, down, forward, row[K1], row[K2], row[K3], row[K4])
    angle = math.atan2(math.sqrt(right * right + down * down), forward)
    inside = (
        abs(u) <= row[HALF_U] * BORDER
        and abs(v) <= row[HALF_V] * BORDER
        and angle <= row[ANGLE_LIMIT] * BORDER
    )
    return 0.5 * row[WIDTH] + row[FOCAL_U] * u, 0.5 * row[HEIGHT_PX] + row[FOCAL_V] * v, inside


@njit(cache=True)
def offset_from_pixel(row: FloatArray, u_px: float, v_px: float) -> tuple[float, float, bool]:
    """Return the ground point (dx, dy) from the mount that pixel (u, v) sees, and if it hits.

    The pixel need not lie on the sensor. At or above the horizon: NaN, NaN, False.
    """
    u = (u_px - 0.5 * row[WIDTH]) / row[FOCAL_U]
    v = (v_px - 0.5 * row[HEIGHT_PX]) / row[FOCAL_V]
    kind = int(row[KIND])
    right, down, forward = ray_from_image(
        kind, u, v, row[K1], row[K2], row[K3], row[K4], row[ANGLE_LIMIT]
    )
    drop = -(right * row[RIGHT + 2] + down * row[DOWN + 2] + forward * row[FORWARD + 2])
    if not drop > 0.0:
        return math.nan, math.nan, False
    scale = row[HEIGHT] / drop
    return (
        scale * (right * row[RIGHT] + down * row[DOWN] + forward * row[FORWARD]),
        scale * (right * row[RIGHT + 1] + down * row[DOWN + 1] + forward * row[FORWARD + 1]),
        True,
    )


@njit(cache=True)
def pixel_from_ground(row: FloatArray, x: float, y: float) -> tuple[float, float, bool]:
    """Return the pixel (u, v) that sees the ground point (x, y), and whether it is inside."""
    return pixel_from_offset(row, x - row[X], y - row[Y])


@njit(cache=True)
def ground_from_pixel(row: FloatArray, u_px: float, v_px: float) -> tuple[float, float, bool]:
    """Return the ground point (x, y) that pixel (u, v) sees, and whether its ray hits ground."""
    dx, dy, hits = offset_from_pixel(row, u_px, v_px)
    return row[X] + dx, row[Y] + dy, hits


@njit(cache=True)
def ground_jacobian(row: FloatArray, dx: float, dy: float) -> tuple[float, float, float, float]:
    """Return ∂(x, y)/∂(u_px, v_px) row by row [m/px], at the ground point (dx, dy) from the mount.

    A pinhole has it in a line; other lenses through the frame in which each is diagonal.
    """
    h = row[HEIGHT]
    right, down, forward = camera_ray(row, dx, dy)
    undistorted = row[K1] == 0.0 and row[K2] == 0.0 and row[K3] == 0.0 and row[K4] == 0.0
    if row[KIND] == PINHOLE and undistorted:
        # q = z (right·u + down·v + forward) with q_z = −h, so ∂q/∂u = z (right + q·right_z/h).
        pull_u, pull_v = row[RIGHT + 2] / h, row[DOWN + 2] / h
        per_u, per_v = forward / row[FOCAL_U], forward / row[FOCAL_V]
        return (
            per_u * (row[RIGHT] + dx * pull_u),
            per_v * (row[DOWN] + dx * pull_v),
            per_u * (row[RIGHT + 1] + dy * pull_u),
            per_v * (row[DOWN + 1] + dy * pull_v),
        )
    kind = int(row[KIND])
    ca, sa, st, ct, radial, around = lens_frame(
        kind, right, down, forward, row[K1], row[K2], row[K3], row[K4]
    )
    length = math.sqrt(dx * dx + dy * dy + h * h)
    # A unit ray moved by w ⊥ ray moves the ground point by length·(w_xy + (dx, dy)·w_z/h).
    ax, ay = _swing(row, ct * ca, ct * sa, -st, dx, dy)
    tx, ty = _swing(row, -sa, ca, 0.0, dx, dy)
    outward, aside = length / radial, length / around
    return (
        (ax * outward * ca - tx * aside * sa) / row[FOCAL_U],
        (ax * outward * sa + tx * aside * ca) / row[FOCAL_V],
        (ay * outward * ca - ty * aside * sa) / row[FOCAL_U],
        (ay * outward * sa + ty * aside * ca) / row[FOCAL_V],
    )


@njit(cache=True)
def _swing(
    row: FloatArray, right: float, down: float, forward: float, dx: float, dy: float
) -> tuple[float, float]:
    wx = right * row[RIGHT] + down * row[DOWN] + forward * row[FORWARD]
    wy = right * row[RIGHT + 1] + down * row[DOWN + 1] + forward * row[FORWARD + 1]
    wz = right * row[RIGHT + 2] + down * row[DOWN + 2] + forward * row[FORWARD + 2]
    return wx + dx * wz / row[HEIGHT], wy + dy * wz / row[HEIGHT]


@njit(cache=True)
def pixel_jacobian(row: FloatArray, dx: float, dy: float) -> tuple[float, float, float, float]:
    """Return ∂(u_px, v_px)/∂(x, y) row by row [px/m], at the ground point (dx, dy)."""
    xu, xv, yu, yv = ground_jacobian(row, dx, dy)
    determinant = xu * yv - xv * yu
    return yv / determinant, -xv / determinant, -yu / determinant, xu / determinant


@njit(cache=True)
def pixel_area(row: FloatArray, dx: float, dy: float) -> float:
    """Return the ground area [m²] of the pixel that sees the ground point (dx, dy).

    First order: |det ∂(x, y)/∂(u, v)| = (R³/h) · sin θ/(ρ ρ') / (f_u f_v), R the distance. For a
    pinhole z³/h over the focal lengths, z the depth along the axis; for a stereographic lens
    R (R + z)²/(4h).
    """
    h = row[HEIGHT]
    right, down, forward = camera_ray(row, dx, dy)
    square = dx * dx + dy * dy + h * h
    density = row[FOCAL_U] * row[FOCAL_V]
    undistorted = row[K1] == 0.0 and row[K2] == 0.0 and row[K3] == 0.0 and row[K4] == 0.0
    if undistorted and row[KIND] == PINHOLE:
        return forward * forward * forward / (h * density)  # type: ignore[no-any-return]
    length = math.sqrt(square)
    if undistorted and row[KIND] == STEREOGRAPHIC:
        side = length + forward
        return 0.25 * length * side * side / (h * density)  # type: ignore[no-any-return]
    kind = int(row[KIND])
    _, _, _, _, radial, around = lens_frame(
        kind, right, down, forward, row[K1], row[K2], row[K3], row[K4]
    )
    return square * length / (h * density * radial * around)  # type: ignore[no-any-return]


@njit(cache=True)
def _half_sizes(
    projection: IntArray, hfov: FloatArray, vfov: FloatArray, k: FloatArray
) -> FloatArray:
    half = np.empty((len(hfov), 2))
    for i in range(len(hfov)):
        for axis, fov in enumerate((hfov[i], vfov[i])):
            rho, _ = lens_radius(projection[i], 0.5 * fov, k[i, 0], k[i, 1], k[i, 2], k[i, 3])
            half[i, axis] = rho
    return half


@njit(cache=True)
def _pixels_from_ground(
    table: FloatArray, camera: IntArray, xy: FloatArray
) -> tuple[FloatArray, BoolArray]:
    pixels = np.empty((len(xy), 2))
    inside = np.empty(len(xy), dtype=np.bool_)
    for n in range(len(xy)):
        pixels[n, 0], pixels[n, 1], inside[n] = pixel_from_ground(
            table[camera[n]], xy[n, 0], xy[n, 1]
        )
    return pixels, inside


@njit(cache=True)
def _ground_from_pixels(
    table: FloatArray, camera: IntArray, pixels: FloatArray
) -> tuple[FloatArray, BoolArray]:
    xy = np.empty((len(pixels), 2))
    hits = np.empty(len(pixels), dtype=np.bool_)
    for n in range(len(pixels)):
        xy[n, 0], xy[n, 1], hits[n] = ground_from_pixel(
            table[camera[n]], pixels[n, 0], pixels[n, 1]
        )
    return xy, hits
