"""What the roadside cameras tell a passing car: the one place where truth becomes measurement.

Each run installs every camera with its own offsets (`install`). In a frame (`observe`), the car's
*true* position goes through the camera as it really stands to a pixel, the pixel is perturbed and
rounded, and is projected back through the camera as drawn; unless a building hides the car. Only
that point leaves; its covariance is the error model's at that point (`believe`). No kernel here
returns anything else of the truth.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from models.cameras import (
    HEIGHT,
    HEIGHT_PX,
    N_COLUMNS,
    WIDTH,
    Cameras,
    X,
    Y,
    offset_from_pixel,
    pixel_from_offset,
)
from models.errors import (
    ALGORITHM_VARIANCE,
    CHI2_95,
    COVARIANCE,
    FORM,
    ORIENTATION_VARIANCE,
    PIXEL_VARIANCE,
    POSITION_95,
    POSITION_VARIANCE,
    REPORT_LIMIT,
    TAN_ORIENTATION,
    ErrorModel,
    measurement_covariance,
    persistent_variances,
    pixel_covariance,
    radius_from_area,
    white_and_whole,
)
from models.following import Course
from models.geometry import FloatArray
from models.installation import N_OFFSETS, displace_camera, offset_jacobian
from models.obstacles import Obstacles
from models.sampling import perturbed_pixel
from models.sight import clear
from models.sight_grid import SightGrid, sight_grid

SEEN_CAMERA, SEEN_X, SEEN_Y = 0, 1, 2
_SLACK = 2.5  # in report limits: a report nearer than the car by more is six sigma off
_BESIDE_M = (
    5.0  # how far from the centre line a car may be when a camera's last sight is worked out
)


class Sensors(NamedTuple):
    """List k cameras for the closed loop.

    table (k, N_COLUMNS): as drawn, positions relative to the course's origin. model: the error
    model's parameters. sigmas (6,): standard deviations of the installation offsets. persistent:
    whether offsets are drawn once a run, or afresh in every frame. reach_m (k,): ground distance
    beyond which the report limit or the range silences a camera. last_s_m (k,): how far along the
    drive a camera can still see the car. missed, false: probabilities a camera and frame.
    buildings: what hides the car, relative to the course's origin, too.
    """

    table: FloatArray
    model: FloatArray
    sigmas: FloatArray
    persistent: bool
    max_range_m: float
    reach_m: FloatArray
    last_s_m: FloatArray
    missed: float
    false: float
    buildings: SightGrid


def sensors(
    cameras: Cameras,
    errors: ErrorModel,
    course: Course,
    *,
    max_range_m: float = 150.0,
    missed: float = 0.0,
    false: float = 0.0,
    obstacles: Obstacles | None = None,
) -> Sensors:
    """Gather what kernels need of `cameras` past `obstacles`; raises ValueError on bad shares."""
    for name, share in (("missed", missed), ("false", false)):
        if not 0.0 <= share < 1.0:
            raise ValueError(f"simulation.{name} must lie in [0, 1), got {share}")
    if not max_range_m > 0.0:
        raise ValueError(f"camera.max_range_m must be above 0, got {max_range_m}")
    table = cameras.table().reshape(len(cameras), N_COLUMNS)
    table[:, X] -= course.origin_x_m
    table[:, Y] -= course.origin_y_m
    model = errors.parameters()
    reach = np.array([_reach(row, model, max_range_m) for row in table])
    slack = _SLACK * errors.report_limit_m
    last_sight = np.array(
        [_last_sight(table[i], reach[i] + slack, course) for i in range(len(table))]
    )
    return Sensors(
        table,
        model,
        errors.installation.sigmas(),
        bool(errors.persistent),
        float(max_range_m),
        reach,
        last_sight,
        float(missed),
        float(false),
        sight_grid(obstacles.moved(-course.origin_x_m, -course.origin_y_m) if obstacles else None),
    )


@njit(cache=True)
def install(sensors: Sensors, rng: np.random.Generator, scale: float) -> FloatArray:
    """Return the cameras as they really stand, (k, N_COLUMNS): offsets scaled by `scale`."""
    real = np.empty_like(sensors.table)
    offsets = np.empty(N_OFFSETS)
    for i in range(len(real)):
        for j in range(N_OFFSETS):
            offsets[j] = scale * sensors.sigmas[j] * rng.standard_normal()
        displace_camera(sensors.table[i], offsets, real[i])
    return real


@njit(cache=True)
def observe(
    sensors: Sensors,
    real: FloatArray,
    x: float,
    y: float,
    noisy: bool,
    rng: np.random.Generator,
    seen: FloatArray,
) -> int:
    """Take one frame with every camera; write (camera, x, y) rows into seen (2k, 3), count them.

    real (k, N_COLUMNS) are the cameras as they stand. `noisy` off leaves the pixel as it is.
    """
    count = 0
    limit = sensors.model[REPORT_LIMIT]
    sigma = math.sqrt(sensors.model[ALGORITHM_VARIANCE])
    fresh = noisy and not sensors.persistent
    moved = np.empty(N_COLUMNS)
    offsets = np.empty(N_OFFSETS)
    for i in range(len(real)):
        drawn = sensors.table[i]
        if sensors.false > 0.0 and rng.random() < sensors.false:
            u = rng.random() * drawn[WIDTH]
            v = rng.random() * drawn[HEIGHT_PX]
            count = _report(sensors, i, u, v, seen, count)
        dx, dy = x - drawn[X], y - drawn[Y]
        far = sensors.reach_m[i] + _SLACK * limit
        if dx * dx + dy * dy > far * far:
            continue
        standing = real[i]
        if fresh:
            for j in range(N_OFFSETS):
                offsets[j] = sensors.sigmas[j] * rng.standard_normal()
            displace_camera(drawn, offsets, moved)
            standing = moved
        u, v, inside = pixel_from_offset(standing, x - standing[X], y - standing[Y])
        if not inside:
            continue
        if sensors.buildings.nx and not clear(
            sensors.buildings, standing[X], standing[Y], standing[HEIGHT], x, y
        ):
            continue
        if sensors.missed > 0.0 and rng.random() < sensors.missed:
            continue
        if noisy:
            u, v = perturbed_pixel(
                u, v, sigma * rng.standard_normal(), sigma * rng.standard_normal()
            )
        count = _report(sensors, i, u, v, seen, count)
    return count


@njit(cache=True)
def _report(sensors: Sensors, i: int, u: float, v: float, seen: FloatArray, count: int) -> int:
    """Project a pixel to the ground as drawn, and report it if the model trusts it enough."""
    drawn = sensors.table[i]
    dx, dy, hits = offset_from_pixel(drawn, u, v)
    if not hits or dx * dx + dy * dy > sensors.max_range_m * sensors.max_range_m:
        return count
    if measurement_covariance(drawn, dx, dy, sensors.model)[3] > sensors.model[REPORT_LIMIT]:
        return count
    seen[count, SEEN_CAMERA] = i
    seen[count, SEEN_X] = drawn[X] + dx
    seen[count, SEEN_Y] = drawn[Y] + dy
    return count + 1


@njit(cache=True)
def believe(
    sensors: Sensors,
    i: int,
    x: float,
    y: float,
    schmidt: bool,
    white: FloatArray,
    offsets: FloatArray,
) -> None:
    """Write what a filter believes of camera i's report (x, y): white (3,) and offsets (2, 6).

    The EKF takes the whole covariance of the chosen error form for white. The Schmidt filter always
    takes the calibrated form: pixels white, installation in `offsets`, per unit variance; where the
    installation is not persistent, everything is white for it, too.
    """
    row = sensors.table[i]
    dx, dy = x - row[X], y - row[Y]
    if not schmidt:
        white[0], white[1], white[2], _ = measurement_covariance(row, dx, dy, sensors.model)
        return
    if not sensors.persistent:
        _, _, _, white[0], white[1], white[2] = white_and_whole(row, dx, dy, sensors.model)
        return
    pixel = sensors.model[PIXEL_VARIANCE]
    xx, xy, yy = pixel_covariance(row, dx, dy)
    white[0], white[1], white[2] = pixel * xx, pixel * xy, pixel * yy
    offset_jacobian(row, dx, dy, offsets)
    for j in range(N_OFFSETS):
        offsets[0, j] *= sensors.sigmas[j]
        offsets[1, j] *= sensors.sigmas[j]


def _reach(row: FloatArray, model: FloatArray, max_range_m: float) -> float:
    """Return the distance at which the installation alone exceeds the report limit (bisection)."""
    near, far = 0.0, max_range_m
    if _installation_radius(row[HEIGHT], far, model) <= model[REPORT_LIMIT]:
        return max_range_m
    for _ in range(40):
        middle = 0.5 * (near + far)
        if _installation_radius(row[HEIGHT], middle, model) <= model[REPORT_LIMIT]:
            near = middle
        else:
            far = middle
    return far


def _installation_radius(h: float, d: float, p: FloatArray) -> float:
    """Return the 95 % radius at distance d without pixel noise: a lower bound, rising with d."""
    if p[FORM] == COVARIANCE:
        along, _ = persistent_variances(h, d * d, p[POSITION_VARIANCE], p[ORIENTATION_VARIANCE])
        return math.sqrt(CHI2_95 * along)
    # an ellipse of the same area is longer than the circle
    return radius_from_area(d, h, 0.0, p[POSITION_95], p[TAN_ORIENTATION], 0.0)


def _last_sight(row: FloatArray, reach: float, course: Course) -> float:
    """Return the last arc length of the course within the camera's reach, −1 if there is none."""
    near = np.hypot(course.x_m - row[X], course.y_m - row[Y])
    within = np.flatnonzero(near <= reach + _BESIDE_M)
    return float(within[-1]) * course.step_m if within.size else -1.0
