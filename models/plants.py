"""The car that really drives: a kinematic bicycle, and a dynamic single-track model.

Both move a state (x, y, heading, speed, steering, yaw_rate, slip), (7,), through one time step
under a wanted steering angle and acceleration; actuators limit both. Both return what the wheels
turned: the distance the rear wheels rolled and the change of heading. `wheel_motion` turns that
into a motion of the reference point as odometry computes it, which assumes that no wheel slips
sideways: true for the bicycle, not for the single-track car.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numba import njit

from models.geometry import FloatArray
from models.vehicle import Vehicle

X, Y, HEADING, SPEED, STEERING, YAW_RATE, SLIP = range(7)
STATE_SIZE = 7
_GRAVITY = 9.81
_CREEP_MPS = 1.0  # below it the tyre equations, stiff in 1/v, give way to the kinematic ones


class Plant(IntEnum):
    """Name the plants; `plant_from_name` reads the command line's spelling."""

    KINEMATIC = 0
    SINGLE_TRACK = 1


def plant_from_name(name: str) -> Plant:
    """Return the plant called 'kinematic' or 'single-track'; raises ValueError for others."""
    plants = {"kinematic": Plant.KINEMATIC, "single-track": Plant.SINGLE_TRACK}
    if name not in plants:
        raise ValueError(f"plant must be one of {', '.join(plants)}, got {name}")
    return plants[name]


@dataclass(frozen=True, slots=True)
class SingleTrack:
    """Hold the parameters of a mid-size car (BMW 320i), with its centre of gravity as reference.

    Source: Althoff and Würsching, CommonRoad: Vehicle Models (2020), vehicle 2 and its tyre table:
    friction p_dy1 = 1.0489 and cornering stiffness −p_ky1/p_dy1 = 21.92/1.0489 for both axles.
    """

    front_m: float = 1.1561957064
    rear_m: float = 1.4227170936
    mass_kg: float = 1093.2952334674046
    yaw_inertia_kgm2: float = 1791.5995300122856
    height_m: float = 0.61373004
    friction: float = 1.0489
    stiffness: float = 21.92 / 1.0489
    steering_limit_rad: float = 1.066
    steering_rate_limit_rad_s: float = 0.4

    @property
    def rear_slip_rad_per_mps2(self) -> float:
        """The rear tyres' slip angle in steady cornering, per lateral acceleration: 1/(μ C g)."""
        return 1.0 / (self.friction * self.stiffness * _GRAVITY)

    def vehicle(self) -> Vehicle:
        """Return the same car as the controller and the odometry know it."""
        return Vehicle(
            wheelbase_m=self.front_m + self.rear_m,
            centre_to_rear_m=self.rear_m,
            steering_limit_rad=self.steering_limit_rad,
            steering_rate_limit_rad_s=self.steering_rate_limit_rad_s,
        )


# Indices of the plant's parameters, as `plant_parameters` lays them out.
(
    _WHEELBASE,
    _REAR,
    _STEERING_LIMIT,
    _STEERING_RATE,
    _ACCELERATION,
    _BRAKING,
    _MASS,
    _INERTIA,
    _HEIGHT,
    _FRICTION,
    _STIFFNESS,
) = range(11)


def plant_parameters(vehicle: Vehicle, single_track: SingleTrack | None = None) -> FloatArray:
    """Lay the parameters out for the kernels, (11,); the dynamic ones are 0 for the bicycle."""
    dynamic = (0.0, 0.0, 0.0, 0.0, 0.0)
    if single_track is not None:
        dynamic = (
            single_track.mass_kg,
            single_track.yaw_inertia_kgm2,
            single_track.height_m,
            single_track.friction,
            single_track.stiffness,
        )
    return np.array(
        [
            vehicle.wheelbase_m,
            vehicle.centre_to_rear_m,
            vehicle.steering_limit_rad,
            vehicle.steering_rate_limit_rad_s,
            vehicle.acceleration_limit_mps2,
            vehicle.braking_limit_mps2,
            *dynamic,
        ]
    )


@njit(cache=True)
def move(
    plant: int,
    state: FloatArray,
    parameters: FloatArray,
    steering_wanted: float,
    acceleration: float,
    dt: float,
) -> tuple[float, float]:
    """Move `state` (7,) in place by `dt`; return (rolled_m, turned_rad) of the rear wheels.

    The steering angle moves towards `steering_wanted` at no more than its rate limit; both commands
    then hold for the step.
    """
    limit = parameters[_STEERING_LIMIT]
    wanted = min(max(steering_wanted, -limit), limit)
    reach = parameters[_STEERING_RATE] * dt
    before = state[STEERING]
    state[STEERING] = before + min(max(wanted - before, -reach), reach)
    pedal = min(max(acceleration, -parameters[_BRAKING]), parameters[_ACCELERATION])
    if plant == 0 or state[SPEED] < _CREEP_MPS:
        return _move_bicycle(state, parameters, pedal, dt)
    return _move_single_track(state, parameters, (state[STEERING] - before) / dt, pedal, dt)


@njit(cache=True)
def small_turn(angle: float) -> tuple[float, float]:
    """Return (cos, sin), below 0.1 rad by series, to 3e-14 relative: twice as fast."""
    if abs(angle) > 0.1:
        return math.cos(angle), math.sin(angle)
    square = angle * angle
    cosine = 1.0 - 0.5 * square * (
        1.0 - square / 12.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0))
    )
    sine = angle * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)))
    return cosine, sine


@njit(cache=True)
def wheel_motion(rolled: float, turned: float, rear: float) -> tuple[float, float]:
    """Return the body-frame motion (forward, left) of a point `rear` metres ahead of the rear axle.

    The rear axle rolls `rolled` metres along an arc that turns by t = `turned`, so forward is
    rolled·sin t/t + rear (cos t − 1), left rolled (1 − cos t)/t + rear sin t. By series to t⁷,
    exact to rounding for the few hundredths of a radian of a tick; half the loop's time otherwise.
    """
    t2 = turned * turned
    versine = turned * (0.5 - t2 * (1.0 / 24.0 - t2 / 720.0))  # (1 − cos t)/t
    sine = 1.0 - t2 * (1.0 / 6.0 - t2 * (1.0 / 120.0 - t2 / 5040.0))  # sin t/t
    return rolled * sine - rear * turned * versine, rolled * versine + rear * turned * sine


@njit(cache=True)
def _move_bicycle(
    state: FloatArray, parameters: FloatArray, acceleration: float, dt: float
) -> tuple[float, float]:
    """Roll the rear axle along the arc that the front wheels prescribe (Ackermann)."""
    before = state[SPEED]
    state[SPEED] = max(before + acceleration * dt, 0.0)
    rolled = 0.5 * (before + state[SPEED]) * dt
    bend = math.tan(state[STEERING]) / parameters[_WHEELBASE]
    turned = rolled * bend
    forward, left = wheel_motion(rolled, turned, parameters[_REAR])
    c, s = math.cos(state[HEADING]), math.sin(state[HEADING])
    state[X] += c * forward - s * left
    state[Y] += s * forward + c * left
    state[HEADING] += turned
    if parameters[_MASS] > 0.0:  # the single-track car creeps: hand over a consistent state
        state[YAW_RATE] = state[SPEED] * bend
        state[SLIP] = math.atan(bend * parameters[_REAR])
    return rolled, turned


@njit(cache=True)
def _move_single_track(
    state: FloatArray, parameters: FloatArray, steering_rate: float, acceleration: float, dt: float
) -> tuple[float, float]:
    """Integrate the single-track equations over `dt` by the classical Runge–Kutta method."""
    k1 = single_track_rates(state, parameters, steering_rate, acceleration)
    k2 = single_track_rates(state + 0.5 * dt * k1, parameters, steering_rate, acceleration)
    k3 = single_track_rates(state + 0.5 * dt * k2, parameters, steering_rate, acceleration)
    k4 = single_track_rates(state + dt * k3, parameters, steering_rate, acceleration)
    change = (dt / 6.0) * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    rolled = (state[SPEED] + 0.5 * change[SPEED]) * math.cos(state[SLIP] + 0.5 * change[SLIP]) * dt
    steering = state[STEERING]
    for i in range(STATE_SIZE):
        state[i] += change[i]
    state[STEERING] = steering  # already moved: the rate enters only the equations
    return rolled, change[HEADING]


@njit(cache=True)
def single_track_rates(
    state: FloatArray, parameters: FloatArray, steering_rate: float, acceleration: float
) -> FloatArray:
    """Return d/dt of the state (7,) of a car with linear tyres and load transfer.

    Althoff and Würsching (2020), single-track model: slip angle β and yaw rate ψ̇ under cornering
    forces proportional to the axle loads g·l_r − a·h (front) and g·l_f + a·h (rear).
    """
    speed, yaw_rate, slip = state[SPEED], state[YAW_RATE], state[SLIP]
    rear = parameters[_REAR]
    wheelbase = parameters[_WHEELBASE]
    front = wheelbase - rear
    mu, h = parameters[_FRICTION], parameters[_HEIGHT]
    grip_front = parameters[_STIFFNESS] * (_GRAVITY * rear - acceleration * h)
    grip_rear = parameters[_STIFFNESS] * (_GRAVITY * front + acceleration * h)
    turn = mu * parameters[_MASS] / (parameters[_INERTIA] * wheelbase)
    side = mu / (speed * wheelbase)
    rates = np.empty(STATE_SIZE)
    rates[X] = speed * math.cos(state[HEADING] + slip)
    rates[Y] = speed * math.sin(state[HEADING] + slip)
    rates[HEADING] = yaw_rate
    rates[SPEED] = acceleration
    rates[STEERING] = steering_rate
    rates[YAW_RATE] = turn * (
        -(front * front * grip_front + rear * rear * grip_rear) * yaw_rate / speed
        + (rear * grip_rear - front * grip_front) * slip
        + front * grip_front * state[STEERING]
    )
    rates[SLIP] = (
        (side / speed * (rear * grip_rear - front * grip_front) - 1.0) * yaw_rate
        - side * (grip_rear + grip_front) * slip
        + side * grip_front * state[STEERING]
    )
    return rates
