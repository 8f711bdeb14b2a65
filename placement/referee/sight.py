"""What one camera measures of every path sample, once more from the formulas, in plain NumPy.

Shares no line with `models.cameras`, `models.errors` or the kernels. Derivatives are differences:
of the projection for the ground a pixel covers, and of a camera really moved and turned for what
its installation does. World axes throughout; the objectives do not mind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from models.geometry import BoolArray, FloatArray
from placement.instance.schema import ErrorsSection

TIE = 1.0 + 1e-9  # borders belong to the image, the range and the report limit
CHI2_95 = 5.991464547107979  # of two degrees of freedom
STEP = 1e-3  # of a difference on the ground, in camera heights: fourth order leaves 1e-10
TURN = 1e-4  # of a difference in an installation offset, m and rad


@dataclass(frozen=True, slots=True)
class Eye:
    """One camera: mount (m), angles (rad, yaw in the world), lens and sensor."""

    x_m: float
    y_m: float
    height_m: float
    yaw_rad: float
    pitch_rad: float
    hfov_rad: float
    vfov_rad: float
    width_px: float
    height_px: float
    projection: str
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def axes(self) -> FloatArray:
        """Return the unit vectors right, down, forward as rows (3, 3), in the world."""
        cy, sy = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        forward = np.array([cp * cy, cp * sy, -sp])
        right = np.array([sy, -cy, 0.0])
        return np.stack([right, np.cross(forward, right), forward])


@dataclass(frozen=True, slots=True)
class Sight:
    """What the camera reports of each sample, seen or not.

    seen (t,); whole (t, 2, 2): covariance of one frame, m²; white (t, 2, 2): its part that is
    fresh in every frame; offsets (t, 2, p): metres per persistent offset of unit variance.
    """

    seen: BoolArray
    whole: FloatArray
    white: FloatArray
    offsets: FloatArray


def look(eye: Eye, xy: FloatArray, errors: ErrorsSection, max_range_m: float) -> Sight:
    """Say what `eye` sees of the ground points xy (t, 2), and how well."""
    to = xy - np.array([eye.x_m, eye.y_m])
    distance = np.hypot(to[:, 0], to[:, 1])
    with np.errstate(all="ignore"):
        near = _inside(eye, to) & (distance <= max_range_m * TIE)
        ground = ground_per_pixel(eye, to)
        persistent = np.zeros((len(xy), 2, 0))
        if errors.model == "covariance":
            persistent = _installation(eye, to, errors)
            pixel = (0.5 * errors.algorithm_95_px) ** 2 + 1.0 / 12.0
            white = pixel * ground @ ground.transpose(0, 2, 1)
            whole = white + persistent @ persistent.transpose(0, 2, 1)
            longest = np.full(len(xy), np.inf)
            longest[near] = np.sqrt(CHI2_95 * np.linalg.eigvalsh(whole[near])[:, 1])
        else:
            white = whole = _circle(eye, to, ground, errors)
            largest = 0.5 * (whole[:, 0, 0] + whole[:, 1, 1]) + np.hypot(
                0.5 * (whole[:, 0, 0] - whole[:, 1, 1]), whole[:, 0, 1]
            )
            longest = 2.0 * np.sqrt(largest)
    if not errors.persistent:
        white, persistent = whole, persistent[:, :, :0]
    return Sight(near & (longest <= errors.report_limit_m * TIE), whole, white, persistent)


def _rays(eye: Eye, to: FloatArray) -> FloatArray:
    """Return the rays (t, 3) to ground offsets (t, 2): right, down, forward."""
    spatial = np.column_stack([to, np.full(len(to), -eye.height_m)])
    rays: FloatArray = spatial @ eye.axes().T
    return rays


def _bent(eye: Eye, theta: FloatArray) -> FloatArray:
    k1, k2, k3, k4 = eye.distortion
    square = theta * theta
    bent: FloatArray = theta * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
    return bent


def _image_radius(eye: Eye, theta: FloatArray) -> FloatArray:
    """Return ρ at angle θ off the axis, focal length 1."""
    angle = _bent(eye, theta)
    if eye.projection == "pinhole":
        return np.tan(angle)
    return 2.0 * np.tan(0.5 * angle) if eye.projection == "stereographic" else angle


def _image(eye: Eye, to: FloatArray) -> FloatArray:
    """Return where ground offsets land, (t, 2), in px from the image's middle."""
    right, down, forward = _rays(eye, to).T
    across = np.hypot(right, down)
    rho = _image_radius(eye, np.arctan2(across, forward))
    direction = np.column_stack([right, down]) / np.where(across > 0.0, across, 1.0)[:, None]
    image: FloatArray = rho[:, None] * direction * _focal(eye)
    return image


def _focal(eye: Eye) -> FloatArray:
    half = _image_radius(eye, 0.5 * np.array([eye.hfov_rad, eye.vfov_rad]))
    focal: FloatArray = 0.5 * np.array([eye.width_px, eye.height_px]) / half
    return focal


def _inside(eye: Eye, to: FloatArray) -> BoolArray:
    right, down, forward = _rays(eye, to).T
    theta = np.arctan2(np.hypot(right, down), forward)
    image = np.abs(_image(eye, to))
    limit = 0.5 * np.array([eye.width_px, eye.height_px]) * TIE
    inside: BoolArray = _maps(eye, theta) & np.all(image <= limit, axis=1)
    return inside


def _maps(eye: Eye, theta: FloatArray) -> BoolArray:
    """Mark the angles before the lens folds or its projection ends."""
    end = 0.5 * math.pi if eye.projection == "pinhole" else math.pi
    if not any(eye.distortion):
        mapped: BoolArray = theta < end if eye.projection == "pinhole" else theta <= end
        return mapped
    grid = np.linspace(0.0, math.pi, 20_001)
    bent = _bent(eye, grid)
    over = (np.diff(bent, append=np.inf) <= 0.0) | (
        (bent >= end) & (eye.projection != "equidistant")
    )
    last = grid[int(np.argmax(over))] if over.any() else math.pi
    before: BoolArray = theta <= last
    return before


def ground_per_pixel(eye: Eye, to: FloatArray) -> FloatArray:
    """Return ∂(x, y)/∂(u, v) (t, 2, 2), m/px: the inverse of differences of the projection."""
    step = STEP * eye.height_m
    columns = []
    for axis in np.eye(2) * step:
        one = _image(eye, to + axis) - _image(eye, to - axis)
        two = _image(eye, to + 2.0 * axis) - _image(eye, to - 2.0 * axis)
        columns.append((8.0 * one - two) / (12.0 * step))
    (ux, vx), (uy, vy) = columns[0].T, columns[1].T
    determinant = ux * vy - uy * vx
    inverse = np.array([[vy, -uy], [-vx, ux]]) / determinant
    result: FloatArray = np.moveaxis(inverse, -1, 0)
    return result


def _circle(eye: Eye, to: FloatArray, ground: FloatArray, errors: ErrorsSection) -> FloatArray:
    """Return (r/2)² I, or for `ellipse` the same area stretched along the sight, (t, 2, 2)."""
    h, d = eye.height_m, np.hypot(to[:, 0], to[:, 1])
    angle = np.arctan(d / h) + math.radians(errors.orientation_95_deg)
    tilt = np.where(angle < 0.5 * math.pi, h * np.tan(angle) - d, np.inf)
    area = np.abs(np.linalg.det(ground))
    r = errors.position_95_m * (1.0 + d / h) + tilt + errors.algorithm_95_px * np.sqrt(2.0 * area)
    stretch = np.ones(len(to))
    along = to / np.where(d > 0.0, d, 1.0)[:, None]
    if errors.model == "ellipse":
        across = np.column_stack([-along[:, 1], along[:, 0]])
        reach = [
            np.linalg.norm(np.einsum("ti,tij->tj", axis, ground), axis=1)
            for axis in (along, across)
        ]
        stretch = np.maximum(1.0, np.where(d > 0.0, reach[0] / reach[1], 1.0))
    sight = along[:, :, None] * along[:, None, :]
    s = stretch[:, None, None]
    circle: FloatArray = (0.25 * r * r)[:, None, None] * (np.eye(2) / s + (s - 1.0 / s) * sight)
    return circle


def _installation(eye: Eye, to: FloatArray, errors: ErrorsSection) -> FloatArray:
    """Return by how much each of six offsets of unit variance moves what is reported, (t, 2, 6).

    The camera is really moved and turned, the sample seen through it, and the pixel's ray laid
    back through the camera as drawn; no lens enters, as the pixel is the same in both.
    """
    sigmas = [0.5 * errors.position_95_m] * 3 + [0.5 * math.radians(errors.orientation_95_deg)] * 3
    cy, sy = math.cos(eye.yaw_rad), math.sin(eye.yaw_rad)
    frame = np.array([[cy, sy, 0.0], [-sy, cy, 0.0], [0.0, 0.0, 1.0]])  # ahead, left, up
    spatial = np.column_stack([to, np.full(len(to), -eye.height_m)])
    columns = []
    for number, sigma in enumerate(sigmas):
        axis = frame[number % 3]
        ends = []
        for amount in (TURN, -TURN):
            ray = spatial - amount * axis if number < 3 else _turned(spatial, axis, -amount)
            ends.append(ray[:, :2] * (eye.height_m / -ray[:, 2])[:, None])
        columns.append(sigma * (ends[0] - ends[1]) / (2.0 * TURN))
    return np.stack(columns, axis=2)


def _turned(vectors: FloatArray, axis: FloatArray, angle: float) -> FloatArray:
    """Turn `vectors` (t, 3) by `angle` about the unit `axis`."""
    along = (vectors @ axis)[:, None] * axis
    turned: FloatArray = (
        along
        + math.cos(angle) * (vectors - along)
        + math.sin(angle) * np.cross(np.broadcast_to(axis, vectors.shape), vectors)
    )
    return turned
