"""The closed loop as a plain Python loop with filterpy: the rival, and an independent oracle.

The same car, driver, odometry, cameras and EKF as `models.closed_loop`, written without its
kernels: pinhole cameras by rotation matrices, closest points by a search over nearby samples,
the filter by `filterpy.kalman.KalmanFilter`. Zero latency, no false or missed detections.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter

from models.cameras import Cameras
from models.control import Control, SpeedPolicy
from models.errors import ErrorModel
from models.geometry import FloatArray
from models.roads import Road
from models.vehicle import OdometryNoise, Vehicle

DT = 0.01
FILTER_EVERY, FRAME_EVERY = 4, 10
GATE = -2.0 * math.log(1e-4)
TABLE_M = 0.5


@dataclass(frozen=True, slots=True)
class Drive:
    """Hold one drive: localisation errors [m] by filter step, (steps,), and the plant's ticks."""

    error_m: FloatArray
    ticks: int


class Course:
    """A road as samples; knows the closest of those near the last."""

    def __init__(self, road: Road) -> None:
        """Sample the road every half metre."""
        table = road.table(TABLE_M)
        self.length, self.closed = road.length_m, road.closed
        self.step = road.length_m / (len(table.s_m) - 1)
        self.xy = np.column_stack((table.x_m, table.y_m))
        self.heading, self.curvature = table.heading_rad, table.curvature
        self.speed = SpeedPolicy().along(table.curvature, self.step, road.closed)
        self.rows = len(table.s_m) - 1

    def follow(self, s: float, point: FloatArray) -> tuple[float, float, float]:
        """Return (s, offset to the left, heading of the road) of the closest point near `s`."""
        here = round(s / self.step)
        window = np.arange(here - 12, here + 13)
        rows = window % self.rows if self.closed else np.clip(window, 0, self.rows)
        away = point - self.xy[rows]
        best = int(np.argmin((away**2).sum(axis=1)))
        row = rows[best]
        c, d = math.cos(self.heading[row]), math.sin(self.heading[row])
        along = c * away[best, 0] + d * away[best, 1]
        left = c * away[best, 1] - d * away[best, 0]
        bend = self.curvature[row]
        base = window[best] if self.closed else row
        left -= 0.5 * bend * along**2
        return base * self.step + along, left, self.heading[row] + bend * along

    def wanted(self, s: float) -> float:
        """Return the speed wanted at `s`."""
        row = round(s / self.step)
        return float(self.speed[row % self.rows if self.closed else min(max(row, 0), self.rows)])


class Pinhole:
    """One camera as drawn and as it stands in this run."""

    def __init__(self, cameras: Cameras, i: int, errors: ErrorModel, rng: np.random.Generator):
        """Draw the installation."""
        sigma = errors.installation
        self.mount = np.array([cameras.x_m[i], cameras.y_m[i], cameras.height_m[i]])
        self.axes = cameras.axes()[i]
        self.size = np.array([cameras.width_px[i], cameras.height_px[i]], dtype=float)
        half = np.array([math.tan(0.5 * cameras.hfov_rad[i]), math.tan(0.5 * cameras.vfov_rad[i])])
        self.focal = 0.5 * self.size / half
        self.noise_px = sigma.algorithm_sigma_px
        self.position_sigma, self.turn_sigma = sigma.position_sigma_m, sigma.orientation_sigma_rad
        self.limit = errors.report_limit_m
        self.real_mount = self.mount + rng.normal(scale=self.position_sigma, size=3)
        turn = rng.normal(scale=self.turn_sigma, size=3)
        self.real_axes = _rotation(turn) @ self.axes

    def report(
        self, x: float, y: float, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return the position reported of a car at (x, y) and its covariance, if it is seen."""
        ray = self.real_axes.T @ (np.array([x, y, 0.0]) - self.real_mount)
        if ray[2] <= 0.0:
            return None
        pixel = 0.5 * self.size + self.focal * ray[:2] / ray[2]
        if (pixel < 0.0).any() or (pixel > self.size).any():
            return None
        pixel = np.floor(pixel + rng.normal(scale=self.noise_px, size=2)) + 0.5
        ray = self.axes @ np.append((pixel - 0.5 * self.size) / self.focal, 1.0)
        if ray[2] >= 0.0:
            return None
        depth = -self.mount[2] / ray[2]
        q = depth * ray
        # ground = q − z·q_z⁻¹…: a change dq moves the ground point by dq_xy − q_xy/q_z·dq_z
        down = np.column_stack((np.eye(2), -q[:2] / q[2]))
        by_pixel = down @ (depth * self.axes[:, :2] / self.focal)
        cross = np.array([[0.0, q[2], -q[1]], [-q[2], 0.0, q[0]], [q[1], -q[0], 0.0]])
        white = (self.noise_px**2 + 1.0 / 12.0) * by_pixel @ by_pixel.T
        moved = self.position_sigma**2 * down @ down.T
        turned = self.turn_sigma**2 * (down @ cross) @ (down @ cross).T
        covariance: FloatArray = white + moved + turned
        if math.sqrt(5.991464547 * np.linalg.eigvalsh(covariance)[1]) > self.limit:
            return None
        return self.mount[:2] + q[:2], covariance


def drive(
    road: Road,
    cameras: Cameras,
    errors: ErrorModel,
    odometry: OdometryNoise,
    rng: np.random.Generator,
    initial_sigma: tuple[float, float, float] = (0.1, 0.1, 0.01),
) -> Drive:
    """Drive the road once with the EKF."""
    course, car, gains = Course(road), Vehicle(), Control()
    rear, front = car.centre_to_rear_m, car.wheelbase_m - car.centre_to_rear_m
    poles = [Pinhole(cameras, i, errors, rng) for i in range(len(cameras))]
    x, y, heading = float(course.xy[0, 0]), float(course.xy[0, 1]), float(course.heading[0])
    speed, steering, wheel = course.wanted(0.0), 0.0, 0.0
    ekf = KalmanFilter(dim_x=3, dim_z=2)  # type: ignore[no-untyped-call]
    ekf.H = np.eye(2, 3)
    turn = np.eye(3)
    turn[:2, :2] = _plane(heading)
    ekf.P = turn @ np.diag(np.square(initial_sigma)) @ turn.T
    start = np.array([x, y, heading])
    ekf.x = start + turn @ (rng.normal(size=3) * np.array(initial_sigma))
    moved, rolled_since = np.zeros(3), 0.0
    s, s_front, integral, slip, pedal = 0.0, front, 0.0, 0.0, 0.0
    errors_m: list[float] = []
    finish = course.length if course.closed else course.length - front
    tick = 0
    while True:
        seen = []
        if tick % FRAME_EVERY == 0 and tick:
            reports = (pole.report(x, y, rng) for pole in poles)
            seen = [report for report in reports if report is not None]
        if (seen or tick % FILTER_EVERY == 0) and rolled_since > 0.0:
            _predict(ekf, moved, rolled_since, odometry)
            moved, rolled_since = np.zeros(3), 0.0
        for z, covariance in seen:
            gap = z - ekf.x[:2]
            if gap @ np.linalg.solve(ekf.P[:2, :2] + covariance, gap) <= GATE:
                ekf.update(z, R=covariance)  # type: ignore[no-untyped-call]
        if tick % FILTER_EVERY == 0:
            s, _, _ = course.follow(s, ekf.x[:2])
            if tick:
                errors_m.append(math.hypot(x - ekf.x[0], y - ekf.x[1]))
                if s >= finish:
                    return Drive(np.array(errors_m), tick)
            tip = ekf.x[:2] + front * np.array([math.cos(ekf.x[2]), math.sin(ekf.x[2])])
            s_front, beside, along = course.follow(s_front, tip)
            off = math.remainder(along - ekf.x[2], 2.0 * math.pi)
            bite = gains.stanley_per_s * beside / (speed + gains.softening_mps)
            wheel = min(max(off - math.atan(bite), -car.steering_limit_rad), car.steering_limit_rad)
            gap_v = course.wanted(s) - speed
            integral = min(max(integral + gap_v * DT * FILTER_EVERY, -2.0), 2.0)
            pedal = (
                gains.proportional_per_s * gap_v
                + gains.integral_per_s2 * integral
                + gains.derivative * (gap_v - slip) / (DT * FILTER_EVERY)
            )
            slip = gap_v
            pedal = min(max(pedal, -car.braking_limit_mps2), car.acceleration_limit_mps2)
        reach = car.steering_rate_limit_rad_s * DT
        steering += min(max(wheel - steering, -reach), reach)
        before, speed = speed, max(speed + pedal * DT, 0.0)
        rolled = 0.5 * (before + speed) * DT
        turned = rolled * math.tan(steering) / car.wheelbase_m
        forward = rolled * math.cos(0.5 * turned) + rear * (math.cos(turned) - 1.0)
        left = rolled * math.sin(0.5 * turned) + rear * math.sin(turned)
        c, d = math.cos(heading), math.sin(heading)
        x, y = x + c * forward - d * left, y + d * forward + c * left
        heading += turned
        noise = np.linalg.cholesky(odometry.covariance(rolled) + 1e-24 * np.eye(3))
        said = np.array([forward, left, turned]) + noise @ rng.normal(size=3)
        moved[:2] += _plane(moved[2]) @ said[:2]
        moved[2] += said[2]
        rolled_since += rolled
        tick += 1


def _predict(ekf: KalmanFilter, moved: FloatArray, rolled: float, odometry: OdometryNoise) -> None:
    step = _plane(ekf.x[2]) @ moved[:2]
    ekf.F = np.array([[1.0, 0.0, -step[1]], [0.0, 1.0, step[0]], [0.0, 0.0, 1.0]])
    turn = np.eye(3)
    turn[:2, :2] = _plane(ekf.x[2] + 0.5 * moved[2])
    ekf.P = ekf.F @ ekf.P @ ekf.F.T + turn @ odometry.covariance(rolled) @ turn.T
    ekf.x = ekf.x + np.append(step, moved[2])


def _plane(angle: float) -> FloatArray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _rotation(vector: FloatArray) -> FloatArray:
    """Return the rotation by a vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: FloatArray = np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * k @ k
    return rotation
