"""The closed loop, many runs at once: set it up, drive it, and read what the drives say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from models.cameras import Cameras
from models.closed_loop import (
    ARRIVED,
    CLAIMED,
    CLAIMED_LATERAL,
    END_X,
    END_Y,
    ERROR,
    LATERAL,
    N_RECORDS,
    N_SUMMARY,
    NEES,
    NIS_SUM,
    NOT_POSITIVE,
    REJECTED,
    STATUS,
    STEPS,
    TICK_S,
    TICKS,
    UPDATES,
    WHITE_PAIRS,
    WHITE_PRODUCT,
    Car,
    S,
    Timing,
    drive,
)
from models.control import Control, SpeedPolicy
from models.errors import ErrorModel
from models.following import Course, course
from models.geometry import BoolArray, FloatArray, IntArray
from models.obstacles import Obstacles
from models.plants import Plant, SingleTrack, plant_from_name, plant_parameters
from models.roads import Road
from models.sensing import Sensors, sensors
from models.vehicle import PROFILES, OdometryNoise, Vehicle, check_turnable

FilterName = Literal["ekf", "schmidt"]
FILTERS: tuple[FilterName, ...] = ("ekf", "schmidt")

_TICKS_A_SECOND = round(1.0 / TICK_S)
_CORNERING_MPS2 = 4.0


@dataclass(frozen=True, slots=True)
class Settings:
    """Say how the closed loop runs.

    filter_hz must divide 100; frame_hz, the cameras' rate, is at most 100. latency_s: from a frame
    to its arrival at the car, stamped. missed, false: probabilities, a camera and frame, that a
    visible car is not reported, and that something is reported that is not there. gate: the
    probability with which a fair measurement is rejected; 0 for no gate. initial_sigma: of the
    first estimate along and across the road [m] and in heading [rad].
    """

    filter_hz: float = 25.0
    frame_hz: float = 10.0
    latency_s: float = 0.0
    missed: float = 0.0
    false: float = 0.0
    gate: float = 1e-4
    initial_sigma: tuple[float, float, float] = (0.1, 0.1, 0.01)
    max_range_m: float = 150.0

    def __post_init__(self) -> None:
        """Refuse what no clock or filter can do."""
        every = _TICKS_A_SECOND / self.filter_hz if self.filter_hz > 0.0 else 0.0
        if every < 1.0 or every != round(every):
            raise ValueError(f"simulation.filter_hz must divide 100, got {self.filter_hz}")
        if not 0.0 < self.frame_hz <= _TICKS_A_SECOND:
            raise ValueError(f"camera.rate_hz must lie in (0, 100], got {self.frame_hz}")
        if not 0.0 <= self.latency_s < math.inf:
            raise ValueError(f"simulation.latency_s must be at least 0, got {self.latency_s}")
        if not 0.0 <= self.gate < 1.0:
            raise ValueError(f"simulation.gate must lie in [0, 1), got {self.gate}")
        if not all(0.0 <= sigma < math.inf for sigma in self.initial_sigma):
            raise ValueError(
                f"vehicle.initial_sigma must be finite and at least 0, got {self.initial_sigma}"
            )


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """Hold one set-up: a road, its cameras, a car and a clock; build it with `closed_loop`."""

    course: Course
    car: Car
    sensors: Sensors
    timing: Timing
    gate: float = field(default=math.inf)

    @property
    def duration_s(self) -> float:
        """The time the drive takes at the wanted speed, to first order."""
        speed = self.course.speed_mps
        pace = 0.5 * (1.0 / speed[1:] + 1.0 / speed[:-1])
        return float(pace.sum() * self.course.step_m)


@dataclass(frozen=True, slots=True)
class Drives:
    """Hold m finished drives.

    runs (m,): which. arrived (m,): whether the estimate reached the road's end in twice the time it
    should take; a car that lost the road did not. steps (m,): filter steps of each. ticks (m,): of
    10 ms, of the plant. end_error_m (m, 2): truth less estimate at the end.

    A row a run, a column a filter step, (m, longest), 0 after a run's end (`active` says where):
    s_m and lateral_m: arc length and cross-track distance of the truth. error_m: the distance of
    estimate and truth. claimed_m2 and claimed_lateral_m2: the filter's tr P_xy, and its part across
    the road. nees: the squared normalised error of (x, y, heading).

    updates, rejected (m,): measurements used, and rejected by the gate. nis (m,): the mean squared
    normalised innovation, 2 where the filter is right. autocorrelation (m,): of successive whitened
    innovations, and pairs (m,) how many it is over.
    """

    filter: FilterName
    seed: int
    runs: IntArray
    arrived: BoolArray
    steps: IntArray
    s_m: FloatArray
    lateral_m: FloatArray
    error_m: FloatArray
    claimed_m2: FloatArray
    claimed_lateral_m2: FloatArray
    nees: FloatArray
    updates: IntArray
    rejected: IntArray
    nis: FloatArray
    autocorrelation: FloatArray
    pairs: IntArray
    end_error_m: FloatArray
    ticks: IntArray

    @property
    def active(self) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
        """Where a run was still driving, (m, longest)."""
        return np.arange(self.s_m.shape[1])[None, :] < self.steps[:, None]


def closed_loop(
    road: Road,
    cameras: Cameras,
    errors: ErrorModel,
    *,
    odometry: OdometryNoise = PROFILES["car"],
    speed: SpeedPolicy | None = None,
    plant: str = "kinematic",
    vehicle: Vehicle | None = None,
    control: Control | None = None,
    settings: Settings | None = None,
    obstacles: Obstacles | None = None,
) -> ClosedLoop:
    """Set up a drive along `road` under `cameras`.

    plant: 'kinematic' or 'single-track'; the latter brings its own vehicle. speed: by default
    `speed_policy` at 20 m/s. obstacles: buildings that hide the car from cameras. Raises ValueError
    for a road tighter than the vehicle can turn, naming the place, and for a latency longer than
    the drive.
    """
    settings = settings or Settings()
    kind = plant_from_name(plant)
    dynamic = SingleTrack() if kind is Plant.SINGLE_TRACK else None
    vehicle = vehicle or (dynamic.vehicle() if dynamic else Vehicle())
    speed = speed or speed_policy(20.0, plant)
    table = course(road, speed)
    s_m = table.step_m * np.arange(len(table.x_m), dtype=np.float64)
    check_turnable(vehicle, s_m, table.curvature)
    seen = sensors(
        cameras,
        errors,
        table,
        max_range_m=settings.max_range_m,
        missed=settings.missed,
        false=settings.false,
        obstacles=obstacles,
    )
    car = Car(
        int(kind),
        plant_parameters(vehicle, dynamic),
        (control or Control()).as_array(),
        vehicle.wheelbase_m - vehicle.centre_to_rear_m,
        vehicle.centre_to_rear_m,
        odometry.as_array(),
        np.array(settings.initial_sigma, dtype=np.float64),
        dynamic.rear_slip_rad_per_mps2 if dynamic else 0.0,
        1.5 * speed.lateral_limit_mps2,
    )
    every = round(_TICKS_A_SECOND / settings.filter_hz)
    latency = round(settings.latency_s * _TICKS_A_SECOND)
    frame_ticks = _TICKS_A_SECOND / settings.frame_hz
    # Under way at most: the frames within the latency and the wait for the next filter step.
    slots = math.ceil((latency + every) / frame_ticks) + 1 if latency else 0
    loop = ClosedLoop(
        table,
        car,
        seen,
        Timing(every, frame_ticks, latency, slots, 0),
        -2.0 * math.log(settings.gate) if settings.gate > 0.0 else math.inf,
    )
    if settings.latency_s >= loop.duration_s:
        raise ValueError(
            f"simulation.latency_s must be shorter than the drive of {loop.duration_s:.1f} s, "
            f"got {settings.latency_s}"
        )
    last = round((2.0 * loop.duration_s + 10.0) * _TICKS_A_SECOND)
    return ClosedLoop(table, car, seen, loop.timing._replace(last=last), loop.gate)


def speed_policy(speed_mps: float, plant: str = "kinematic") -> SpeedPolicy:
    """Return the wish for `speed_mps` that a plant can follow.

    The bicycle corners at any speed. The single-track car's v²|κ| is kept below 4 m/s², where its
    tyres are linear; the rule 0.5/|κ| alone would ask 10 m/s² of it at a radius of 40 m.
    """
    limit = _CORNERING_MPS2 if plant_from_name(plant) is Plant.SINGLE_TRACK else math.inf
    return SpeedPolicy(speed_mps=speed_mps, lateral_limit_mps2=limit)


def simulate(
    loop: ClosedLoop,
    *,
    filter: FilterName = "schmidt",  # noqa: A002
    runs: int | Sequence[int] = 100,
    seed: int = 0,
    workers: int = 1,
) -> Drives:
    """Drive `loop` once a run; run number i is the same whatever other runs are asked for.

    runs: how many, or which. Run i draws from SeedSequence(seed, spawn_key=(i,)), so both filters
    meet the same cameras. workers: threads; the result does not depend on them. Raises ValueError
    where a filter's covariance does not stay positive.
    """
    chosen = np.arange(runs) if isinstance(runs, int) else np.asarray(runs, dtype=np.int64)
    if len(chosen) == 0 or chosen.min() < 0:
        raise ValueError(f"runs must be at least 1, got {runs}")
    return _drive_all(loop, filter, chosen, seed, workers, noisy=True)


def nominal_drive(
    loop: ClosedLoop,
    *,
    filter: FilterName = "schmidt",  # noqa: A002
    seed: int = 0,
) -> Drives:
    """Drive without any error, for the covariance the filter predicts along the way (one run).

    With missed or false detections in the set-up the covariance is itself random: 20 runs then.
    """
    chance = loop.sensors.missed > 0.0 or loop.sensors.false > 0.0
    return _drive_all(loop, filter, np.arange(20 if chance else 1), seed, 1, noisy=False)


def predict_along(
    loop: ClosedLoop,
    s_m: FloatArray,
    *,
    filter: FilterName = "schmidt",  # noqa: A002
) -> tuple[FloatArray, FloatArray]:
    """Return what the filter claims at arc lengths (t,) of the nominal drive, one sigma [m].

    The first array is √tr P_xy, to be compared with an rms distance; the second the sigma across
    the road. Linear between filter steps; constant before the first and after the last.
    """
    drives = nominal_drive(loop, filter=filter)
    n = int(drives.steps.min())
    at = drives.s_m[0, :n]
    position = np.interp(s_m, at, drives.claimed_m2[:, :n].mean(axis=0))
    lateral = np.interp(s_m, at, drives.claimed_lateral_m2[:, :n].mean(axis=0))
    return np.sqrt(position), np.sqrt(np.maximum(lateral, 0.0))


def _drive_all(
    loop: ClosedLoop, kind: FilterName, runs: IntArray, seed: int, workers: int, *, noisy: bool
) -> Drives:
    if kind not in FILTERS:
        raise ValueError(f"filter must be one of {', '.join(FILTERS)}, got {kind}")
    room = loop.timing.last // loop.timing.filter_every + 2

    def one(run: int) -> tuple[FloatArray, FloatArray]:
        records, summary = np.empty((room, N_RECORDS)), np.empty(N_SUMMARY)
        streams = np.random.SeedSequence(seed, spawn_key=(run,)).spawn(3)
        install, wheels, frames = (np.random.Generator(np.random.PCG64(s)) for s in streams)
        drive(
            loop.course,
            loop.car,
            loop.sensors,
            loop.timing,
            kind == "schmidt",
            loop.gate,
            noisy,
            install,
            wheels,
            frames,
            records,
            summary,
        )
        return records[: int(summary[STEPS])].copy(), summary

    if workers > 1 and len(runs) > 1:
        with ThreadPoolExecutor(workers) as pool:
            done = list(pool.map(one, (int(run) for run in runs)))
    else:
        done = [one(int(run)) for run in runs]
    summary = np.array([line for _, line in done])
    _check_positive(kind, runs, summary)
    steps = summary[:, STEPS].astype(np.int64)
    table = np.zeros((N_RECORDS, len(runs), int(steps.max())))
    for i, (records, _) in enumerate(done):
        table[:, i, : len(records)] = records.T
    updates = summary[:, UPDATES]
    pairs = summary[:, WHITE_PAIRS]
    return Drives(
        filter=kind,
        seed=seed,
        runs=runs,
        arrived=summary[:, STATUS] == ARRIVED,
        steps=steps,
        s_m=table[S],
        lateral_m=table[LATERAL],
        error_m=table[ERROR],
        claimed_m2=table[CLAIMED],
        claimed_lateral_m2=table[CLAIMED_LATERAL],
        nees=table[NEES],
        updates=updates.astype(np.int64),
        rejected=summary[:, REJECTED].astype(np.int64),
        nis=summary[:, NIS_SUM] / np.maximum(updates, 1.0),
        # each whitened innovation has two components of unit variance
        autocorrelation=summary[:, WHITE_PRODUCT] / np.maximum(2.0 * pairs, 1.0),
        pairs=pairs.astype(np.int64),
        end_error_m=summary[:, [END_X, END_Y]],
        ticks=summary[:, TICKS].astype(np.int64),
    )


def _check_positive(kind: FilterName, runs: IntArray, summary: FloatArray) -> None:
    """Raise ValueError for the first drive whose covariance broke, with the time and the reason."""
    broken = np.flatnonzero(summary[:, STATUS] == NOT_POSITIVE)
    if broken.size:
        first = int(broken[0])
        raise ValueError(
            f"run {runs[first]} ({kind}): the filter's covariance is not positive after "
            f"{summary[first, TICKS] * TICK_S:.2f} s: vehicle.initial_sigma, odometry and errors "
            "must be positive and of sensible size"
        )
