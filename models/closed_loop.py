"""One drive, compiled: plant, wheels, cameras, filter and driver in a loop of 10 ms.

The driver steers by the *estimate*, at the filter's rate; the truth enters only the plant, the
wheels (through the odometry's noise), the pixels (`models.sensing`) and the records.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from models.control import pedal, stanley
from models.filters import (
    BROKEN,
    GATED,
    POSE,
    UPDATED,
    forget,
    normalised_error,
    predict,
    remember,
    update,
)
from models.following import Course, follow, speed_wanted
from models.geometry import BoolArray, FloatArray, IntArray
from models.installation import N_OFFSETS
from models.plants import HEADING, SPEED, STATE_SIZE, X, Y, move, small_turn, wheel_motion
from models.sensing import SEEN_CAMERA, SEEN_X, SEEN_Y, Sensors, believe, install, observe

TICK_S = 0.01

# Columns of a record, one a filter step.
S, LATERAL, ERROR, CLAIMED, CLAIMED_LATERAL, NEES = range(6)
N_RECORDS = 6

# Entries of a drive's summary.
(
    STEPS,
    STATUS,
    UPDATES,
    REJECTED,
    NIS_SUM,
    WHITE_PRODUCT,
    WHITE_PAIRS,
    END_X,
    END_Y,
    END_ALONG,
    TICKS,
) = range(11)
N_SUMMARY = 11

ARRIVED, TOO_LONG, NOT_POSITIVE = 0, 1, 2
"""How a drive ends: at the road's end; out of time; with a covariance that is not positive."""


class Car(NamedTuple):
    """Hold the plant (0 or 1), its parameters, the driver's gains, and where the axles are.

    noise (3,): odometry densities. start_sigma (3,): of the first estimate, in the road's frame.
    slip_per_mps2: the rear wheels' slip angle that the odometry allows for, rad per m/s² of lateral
    acceleration. lateral_limit_mps2: the driver steers no sharper than this allows.
    """

    plant: int
    parameters: FloatArray
    gains: FloatArray
    to_front_m: float
    to_rear_m: float
    noise: FloatArray
    start_sigma: FloatArray
    slip_per_mps2: float
    lateral_limit_mps2: float


class Timing(NamedTuple):
    """Hold the clock in ticks of 10 ms.

    filter_every: ticks between filter steps. frame_ticks: ticks between frames, not always whole.
    latency: ticks from a frame to its arrival. slots: frames under way at most, 0 without latency.
    last: the tick at which a drive that has not arrived is given up.
    """

    filter_every: int
    frame_ticks: float
    latency: int
    slots: int
    last: int


@njit(cache=True, nogil=True)
def drive(
    course: Course,
    car: Car,
    sensors: Sensors,
    timing: Timing,
    schmidt: bool,
    gate: float,
    noisy: bool,
    rng_install: np.random.Generator,
    rng_wheels: np.random.Generator,
    rng_frames: np.random.Generator,
    records: FloatArray,
    summary: FloatArray,
) -> None:
    """Drive the course once; write a row a filter step into records, and the summary.

    schmidt: consider persistent offsets; else the EKF. noisy off: the nominal drive, in which
    nothing errs and the filter's covariance runs as if it might. records (steps, N_RECORDS) with
    room for every step up to `timing.last`; columns s and cross-track distance of the truth [m],
    distance between estimate and truth [m], the filter's claims tr P_xy and nᵀ P n across the road
    [m²], and the NEES of (x, y, heading): χ² of three degrees of freedom where the filter is right.
    """
    k = len(sensors.table)
    scale = 1.0 if noisy else 0.0
    real = install(sensors, rng_install, scale if sensors.persistent else 0.0)

    # Taken out of their tuple once: what is read at every tick would count references there.
    plant, parameters, noise, gains = car.plant, car.parameters, car.noise, car.gains
    to_rear, to_front, slip = car.to_rear_m, car.to_front_m, car.slip_per_mps2
    # Truth and estimate at the start of the road.
    state = np.zeros(STATE_SIZE)
    state[HEADING] = course.heading_rad[0]
    state[SPEED] = speed_wanted(course, 0.0)
    size = POSE + 2 * timing.slots
    mean = np.zeros(size)
    covariance = np.zeros((size, size))
    considered = k if schmidt and sensors.persistent else 0
    cross = np.zeros((considered, size, N_OFFSETS))
    met = np.zeros(max(k, 1), dtype=np.int64)
    is_met = np.zeros(max(k, 1), dtype=np.bool_)
    n_met: Any = np.int64(0)  # a plain 0 has `predict` compiled for that number alone
    _start(course, car, scale, rng_wheels, mean, covariance)

    seen = np.empty((max(2 * k, 1), 3))
    queue = np.empty((max(2 * k, 1) * max(timing.slots, 1), 5))  # camera, x, y, slot, tick
    n_queue = 0
    next_slot = 0
    work = np.empty((size, 4))
    white = np.empty(3)
    offsets = np.zeros((2, N_OFFSETS))
    innovation = np.zeros(3)
    before = np.zeros(3)  # the innovation before, for the whiteness
    n_before = 0

    odometry = np.zeros(4)  # forward, left, turned, rolled since the filter's last step
    s_true, s_front, s_mean = 0.0, car.to_front_m, 0.0
    steering, acceleration, integral, speed_error = 0.0, 0.0, 0.0, 0.0
    frame = 1
    frame_tick = round(timing.frame_ticks)
    # An open road is driven until the front axle is at its end.
    finish = course.length_m if course.closed else course.length_m - car.to_front_m
    every, latency = timing.filter_every, timing.latency
    steps = 0
    status = TOO_LONG
    summary[:] = 0.0
    tick = 0
    while tick <= timing.last:
        is_step = tick % every == 0
        count = 0
        if tick == frame_tick:
            count = observe(sensors, real, state[X], state[Y], noisy, rng_frames, seen)
            frame += 1
            frame_tick = round(frame * timing.frame_ticks)
        if (count > 0 or is_step) and odometry[3] > 0.0:
            predict(
                mean,
                covariance,
                cross,
                met,
                n_met,
                odometry[0],
                odometry[1],
                odometry[2],
                odometry[3],
                noise,
            )
            odometry[:] = 0.0
        slot = -1
        if count > 0 and latency > 0:
            slot = next_slot
            next_slot = (next_slot + 1) % timing.slots
            remember(mean, covariance, cross, met, n_met, slot)
        for n in range(count):
            queue[n_queue, :3] = seen[n]
            queue[n_queue, 3] = slot
            queue[n_queue, 4] = tick + latency
            n_queue += 1
        taken = 0
        while taken < n_queue and queue[taken, 4] <= tick and (is_step or latency == 0):
            camera = int(queue[taken, SEEN_CAMERA])
            slot = int(queue[taken, 3])
            x, y = queue[taken, SEEN_X], queue[taken, SEEN_Y]
            believe(sensors, camera, x, y, schmidt, white, offsets)
            if considered > 0 and not is_met[camera]:
                is_met[camera] = True
                met[n_met] = camera
                n_met += 1
            row = 0 if slot < 0 else POSE + 2 * slot
            verdict = update(
                mean,
                covariance,
                cross,
                met,
                n_met,
                row,
                camera if considered > 0 else -1,
                x,
                y,
                offsets,
                white,
                gate,
                work,
                innovation,
            )
            if verdict == BROKEN:
                status = NOT_POSITIVE
                break
            if verdict == GATED:
                summary[REJECTED] += 1.0
            if verdict == UPDATED:
                summary[UPDATES] += 1.0
                summary[NIS_SUM] += innovation[2]
                if n_before > 0:
                    summary[WHITE_PRODUCT] += innovation[0] * before[0] + innovation[1] * before[1]
                    summary[WHITE_PAIRS] += 1.0
                before[:] = innovation
                n_before += 1
            taken += 1
            if slot >= 0 and (taken == n_queue or int(queue[taken, 3]) != slot):
                forget(mean, covariance, cross, met, n_met, slot)
        if status == NOT_POSITIVE:
            break
        for n in range(taken, n_queue):
            queue[n - taken] = queue[n]
        n_queue -= taken

        if is_step:
            if n_queue == 0:
                n_met = _leave(sensors, s_mean, cross, met, is_met, n_met)
            s_mean, _, _, _ = follow(course, s_mean, mean[0], mean[1])
            if tick > 0:
                s_true, lateral, heading, _ = follow(course, s_true, state[X], state[Y])
                e_x, e_y = state[X] - mean[0], state[Y] - mean[1]
                turn = state[HEADING] - mean[2]
                turn -= 2.0 * math.pi * round(turn / (2.0 * math.pi))
                records[steps, S] = s_true
                records[steps, LATERAL] = lateral
                records[steps, ERROR] = math.sqrt(e_x * e_x + e_y * e_y)
                records[steps, CLAIMED] = covariance[0, 0] + covariance[1, 1]
                c, s = math.cos(heading), math.sin(heading)
                records[steps, CLAIMED_LATERAL] = (
                    s * s * covariance[0, 0]
                    - 2.0 * s * c * covariance[0, 1]
                    + c * c * covariance[1, 1]
                )
                nees = normalised_error(covariance, e_x, e_y, turn)
                records[steps, NEES] = nees
                steps += 1
                if not (nees >= 0.0 and math.isfinite(records[steps - 1, ERROR])):
                    status = NOT_POSITIVE
                    break
                if s_mean >= finish:
                    status = ARRIVED
                    break
            front_x = mean[0] + to_front * math.cos(mean[2])
            front_y = mean[1] + to_front * math.sin(mean[2])
            s_front, beside, heading, _ = follow(course, s_front, front_x, front_y)
            turn = heading - mean[2]
            turn -= 2.0 * math.pi * round(turn / (2.0 * math.pi))
            steering = stanley(turn, beside, state[SPEED], gains)
            sharpest = math.atan2((to_front + to_rear) * car.lateral_limit_mps2, state[SPEED] ** 2)
            steering = min(max(steering, -sharpest), sharpest)
            acceleration, integral, speed_error = pedal(
                state[SPEED],
                speed_wanted(course, s_mean),
                integral,
                speed_error,
                every * TICK_S,
                gains,
            )
        rolled, turned = move(plant, state, parameters, steering, acceleration, TICK_S)
        _roll(rolled, turned, to_rear, slip, noise, noisy, rng_wheels, odometry)
        tick += 1

    summary[STEPS] = steps
    summary[STATUS] = status
    summary[END_X] = state[X] - mean[0]
    summary[END_Y] = state[Y] - mean[1]
    summary[END_ALONG] = s_mean
    summary[TICKS] = tick


@njit(cache=True)
def _start(
    course: Course,
    car: Car,
    scale: float,
    rng: np.random.Generator,
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    """Draw the first estimate about the start of the road: sigmas along, across, heading."""
    heading = course.heading_rad[0]
    c, s = math.cos(heading), math.sin(heading)
    along, across, turn = car.start_sigma[0], car.start_sigma[1], car.start_sigma[2]
    a = scale * along * rng.standard_normal()
    b = scale * across * rng.standard_normal()
    mean[0], mean[1] = c * a - s * b, s * a + c * b
    mean[2] = heading + scale * turn * rng.standard_normal()
    covariance[0, 0] = c * c * along * along + s * s * across * across
    covariance[1, 1] = s * s * along * along + c * c * across * across
    covariance[0, 1] = covariance[1, 0] = c * s * (along * along - across * across)
    covariance[2, 2] = turn * turn


@njit(cache=True)
def _roll(
    rolled: float,
    turned: float,
    to_rear: float,
    slip: float,
    noise: FloatArray,
    noisy: bool,
    rng: np.random.Generator,
    odometry: FloatArray,
) -> None:
    """Add what the wheels say of one tick to the odometry since the filter's last step.

    The noise of a tick has exactly the covariance of `OdometryNoise.covariance(rolled)`, so the
    composition of any number of ticks has that of their whole distance.
    """
    forward, left = wheel_motion(rolled, turned, to_rear)
    left -= slip * (rolled * turned / (TICK_S * TICK_S)) * rolled
    if noisy and rolled > 0.0:
        root = math.sqrt(rolled)
        swing = noise[0] * root * rng.standard_normal()
        forward += noise[1] * root * rng.standard_normal()
        bow = noise[0] * rolled
        across = math.sqrt(noise[2] * noise[2] + bow * bow / 12.0) * root
        left += across * rng.standard_normal() + 0.5 * rolled * swing
        turned += swing
    if odometry[2] == 0.0:  # the first tick after a filter step
        odometry[0] += forward
        odometry[1] += left
    else:
        c, s = small_turn(odometry[2])
        odometry[0] += c * forward - s * left
        odometry[1] += s * forward + c * left
    odometry[2] += turned
    odometry[3] += rolled


@njit(cache=True)
def _leave(
    sensors: Sensors,
    s: float,
    cross: FloatArray,
    met: IntArray,
    is_met: BoolArray,
    n_met: int,
) -> int:
    """Drop the cross-covariance of cameras that cannot see the car again; exact (see filters)."""
    n = 0
    while n < n_met:
        camera = met[n]
        if s > sensors.last_s_m[camera]:
            cross[camera, :, :] = 0.0
            is_met[camera] = False
            n_met -= 1
            met[n] = met[n_met]
        else:
            n += 1
    return n_met
