"""Check a placement by driving it: many closed-loop runs, both filters, and what they say."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from models.cameras import Cameras
from models.closed_loop import TICK_S
from models.consistency import StepTally, bootstrap_band, whiteness_band
from models.errors import ErrorModel
from models.geometry import FloatArray
from models.roads import Road
from models.simulation import (
    FILTERS,
    ClosedLoop,
    Drives,
    FilterName,
    Settings,
    closed_loop,
    nominal_drive,
    simulate,
    speed_policy,
)
from models.vehicle import PROFILES, OdometryNoise
from placement.assemble import Scene, build_errors, build_odometry
from placement.cluster import Serial, Work, cores

FILTER_HZ = 25.0
NO_DRIVES = (
    "validate needs drives over the network: nobody drives all streets in a row; "
    "give the instance a [traffic] table"
)
_BATCH = 50
_BIN_M = 2.0


@dataclass(frozen=True, slots=True)
class Profile:
    """Hold rms errors along the road, by filter: s_m (b,), and arrays (b,) in metres.

    nees (t,) by filter is the mean over runs at each filter step, nees_low and nees_high its χ²
    band, time_s (t,) when that is.
    """

    s_m: FloatArray
    position_rms_m: Mapping[str, FloatArray]
    cross_track_rms_m: Mapping[str, FloatArray]
    predicted_rms_m: Mapping[str, FloatArray]
    time_s: FloatArray
    nees: Mapping[str, FloatArray]
    nees_low: FloatArray
    nees_high: FloatArray


@dataclass(frozen=True, slots=True)
class Validation:
    """Hold a validation: `rows` one a run and filter, `summary` as DESIGN 7 has it, `profile`."""

    rows: pd.DataFrame
    summary: dict[str, Any]
    profile: Profile


def validate(
    scene: Scene,
    selected: Sequence[int],
    *,
    runs: int = 200,
    seed: int = 0,
    plant: str = "kinematic",
    latency_s: float = 0.0,
    missed: float = 0.0,
    false: float = 0.0,
    progress: Callable[[str, float | None], None] | None = None,
    work: Work | None = None,
) -> Validation:
    """Drive the selected candidates of `scene`, `runs` times with each filter.

    With several journeys each is driven: rows carry its name in a column `drive`, the summary's
    `drives` holds one summary for each, and `filters` and the profile are those of the first.

    latency_s, missed, false: as in `models.simulation.Settings`. Raises ValueError for no runs, an
    unknown plant, a road tighter than the vehicle can turn, a latency longer than the drive, or
    cameras that never see the car.
    """
    if not all(journey.drivable for journey in scene.journeys):
        raise ValueError(NO_DRIVES)
    found = [
        _drive_journey(
            scene,
            journey.road,
            selected,
            runs=runs,
            seed=seed,
            plant=plant,
            latency_s=latency_s,
            missed=missed,
            false=false,
            progress=progress,
            work=work,
        )
        for journey in scene.journeys
    ]
    if len(found) == 1:
        return found[0]
    names = [journey.name for journey in scene.journeys]
    rows = [v.rows.assign(drive=name) for v, name in zip(found, names, strict=True)]
    drives = [
        {"drive": name, "filters": v.summary["filters"]}
        for v, name in zip(found, names, strict=True)
    ]
    summary = {**found[0].summary, "drives": drives}
    return Validation(pd.concat(rows, ignore_index=True), summary, found[0].profile)


def _drive_journey(
    scene: Scene,
    road: Road,
    selected: Sequence[int],
    *,
    runs: int,
    seed: int,
    plant: str,
    latency_s: float,
    missed: float,
    false: float,
    progress: Callable[[str, float | None], None] | None,
    work: Work | None,
) -> Validation:
    instance = scene.instance
    loop = closed_loop(
        road,
        scene.candidates.cameras.subset(np.array(sorted(selected), dtype=np.int64)),
        build_errors(instance),
        odometry=build_odometry(instance.vehicle),
        speed=speed_policy(instance.vehicle.speed_mps, plant),
        plant=plant,
        settings=Settings(
            filter_hz=FILTER_HZ,
            frame_hz=instance.camera.rate_hz,
            latency_s=latency_s,
            missed=missed,
            false=false,
            initial_sigma=instance.vehicle.initial_sigma,
            max_range_m=instance.camera.max_range_m,
        ),
        obstacles=scene.obstacles,
    )
    return validate_loop(
        loop,
        runs=runs,
        seed=seed,
        tolerance_m=instance.objective.tolerance_m,
        progress=progress,
        work=work,
    )


def validate_cameras(
    road: Road,
    cameras: Cameras,
    errors: ErrorModel,
    *,
    odometry: OdometryNoise = PROFILES["car"],
    speed_mps: float = 20.0,
    plant: str = "kinematic",
    settings: Settings | None = None,
    runs: int = 200,
    seed: int = 0,
    tolerance_m: float = 0.29,
) -> Validation:
    """Drive `road` under `cameras`, for those who have no instance; raises as `validate` does."""
    loop = closed_loop(
        road,
        cameras,
        errors,
        odometry=odometry,
        speed=speed_policy(speed_mps, plant),
        plant=plant,
        settings=settings,
    )
    return validate_loop(loop, runs=runs, seed=seed, tolerance_m=tolerance_m)


def validate_loop(
    loop: ClosedLoop,
    *,
    runs: int,
    seed: int,
    tolerance_m: float,
    progress: Callable[[str, float | None], None] | None = None,
    work: Work | None = None,
) -> Validation:
    """Drive a set-up `runs` times with each filter and sum up what happened.

    `work` says where, by default in threads here; the result is the same to the byte.
    """
    if runs < 1:
        raise ValueError(f"runs must be at least 1, got {runs}")
    if seed < 0:
        raise ValueError(f"seed must be at least 0, got {seed}")
    report = progress or (lambda _text, _fraction: None)
    nominal = {name: nominal_drive(loop, filter=name) for name in FILTERS}
    if not any(drives.updates.any() for drives in nominal.values()):
        raise ValueError(
            f"selected: no camera sees the car anywhere along the drive ({len(loop.sensors.table)} "
            "cameras): nothing to validate"
        )
    place = work or Serial()
    tallies = {}
    for n, name in enumerate(FILTERS):
        tally = _Tally(loop, tolerance_m)
        threads = min(cores(), 8) if work is None else 1
        tasks = [
            _Batch(loop, name, range(first, min(first + _BATCH, runs)), seed, threads)
            for first in range(0, runs, _BATCH)
        ]
        early: dict[int, Drives] = {}
        added = 0
        report(f"driving with the {name} filter", n / len(FILTERS))
        for i, drives in place.run(_drive_batch, tasks, "drives"):
            early[i] = drives
            while added in early:  # sums in the order of the runs, whoever is done first
                tally.add(early.pop(added))
                added += 1
            if added < len(tasks):
                report(f"driving with the {name} filter", (n + added / len(tasks)) / len(FILTERS))
        tallies[name] = tally
    rows = pd.concat([tally.rows(name, seed) for name, tally in tallies.items()], ignore_index=True)
    summary = {
        "runs": runs,
        "seed": seed,
        "filters": {name: tally.summary(nominal[name], seed) for name, tally in tallies.items()},
    }
    return Validation(rows, summary, _profile(loop, tallies, nominal))


@dataclass(frozen=True, slots=True)
class _Batch:
    """Some runs with one filter: a task of its own."""

    loop: ClosedLoop
    filter: FilterName
    runs: range
    seed: int
    threads: int


def _drive_batch(batch: _Batch) -> Drives:
    return simulate(
        batch.loop, filter=batch.filter, runs=batch.runs, seed=batch.seed, workers=batch.threads
    )


class _Tally:
    """Gather the drives of one filter, batch by batch, so that memory does not grow with runs."""

    def __init__(self, loop: ClosedLoop, tolerance_m: float) -> None:
        length = loop.course.length_m
        self.tolerance_m = tolerance_m
        self.steps = StepTally()
        self.bins = max(1, round(length / _BIN_M))
        self.bin_m = length / self.bins
        self.count = np.zeros(self.bins, dtype=np.int64)
        self.error2 = np.zeros(self.bins)
        self.lateral2 = np.zeros(self.bins)
        self.runs: list[pd.DataFrame] = []

    def add(self, drives: Drives) -> None:
        """Take in a batch."""
        self.steps.add(drives)
        on = drives.active
        place = np.clip((drives.s_m[on] / self.bin_m).astype(np.int64), 0, self.bins - 1)
        self.count += np.bincount(place, minlength=self.bins)
        self.error2 += np.bincount(place, drives.error_m[on] ** 2, self.bins)
        self.lateral2 += np.bincount(place, drives.lateral_m[on] ** 2, self.bins)
        within = ((np.abs(drives.lateral_m) <= self.tolerance_m) & on).sum(axis=1)
        self.runs.append(
            pd.DataFrame(
                {
                    "run": drives.runs,
                    "arrived": drives.arrived,
                    "steps": drives.steps,
                    "error2": (drives.error_m**2).sum(axis=1),
                    "max_error_m": drives.error_m.max(axis=1),
                    "lateral2": (drives.lateral_m**2).sum(axis=1),
                    "max_cross_track_m": np.abs(drives.lateral_m).max(axis=1),
                    "nees": drives.nees.sum(axis=1),
                    "within": within,
                    "updates": drives.updates,
                    "gated": drives.rejected,
                    "nis": drives.nis,
                    "autocorrelation": drives.autocorrelation,
                    "pairs": drives.pairs,
                }
            )
        )

    def rows(self, name: str, seed: int) -> pd.DataFrame:
        """Return the rows of `validation.csv`."""
        runs = pd.concat(self.runs, ignore_index=True)
        return pd.DataFrame(
            {
                "run": runs["run"],
                "seed": seed,
                "filter": name,
                "rms_localisation_error_m": np.sqrt(runs["error2"] / runs["steps"]),
                "max_localisation_error_m": runs["max_error_m"],
                "rms_cross_track_m": np.sqrt(runs["lateral2"] / runs["steps"]),
                "max_cross_track_m": runs["max_cross_track_m"],
                "nees_mean": runs["nees"] / runs["steps"],
                "updates": runs["updates"],
                "gated": runs["gated"],
                "nis_mean": runs["nis"],
                "innovation_autocorrelation": runs["autocorrelation"],
                "arrived": runs["arrived"],
            }
        )

    def summary(self, nominal: Drives, seed: int) -> dict[str, float]:
        """Return this filter's part of `validation_summary.json`."""
        runs = pd.concat(self.runs, ignore_index=True)
        steps = float(runs["steps"].sum())
        updates = float(runs["updates"].sum())
        pairs, gated = int(runs["pairs"].sum()), float(runs["gated"].sum())
        low, high = bootstrap_band(
            runs["nees"].to_numpy(dtype=np.float64),
            runs["steps"].to_numpy(dtype=np.float64),
            np.random.default_rng(seed),
        )
        return {
            "predicted_rms_m": _rms(nominal.claimed_m2.sum(), nominal.steps.sum()),
            "simulated_rms_m": _rms(runs["error2"].sum(), steps),
            "nees_mean": float(runs["nees"].sum()) / steps,
            "nees_low_95": low,
            "nees_high_95": high,
            "nees_steps_in_band": self.steps.share_in_band(),
            "cross_track_rms_m": _rms(runs["lateral2"].sum(), steps),
            "lateral_within_tolerance": float(runs["within"].sum()) / steps,
            "lost_share": 1.0 - float(runs["arrived"].mean()),
            "updates_mean": updates / len(runs),
            "gated_share": gated / max(updates + gated, 1.0),
            "nis_mean": float((runs["nis"] * runs["updates"]).sum()) / max(updates, 1.0),
            "innovation_autocorrelation": float((runs["autocorrelation"] * runs["pairs"]).sum())
            / max(pairs, 1),
            "innovation_autocorrelation_95": min(whiteness_band(pairs), 1.0),
        }


def _profile(
    loop: ClosedLoop, tallies: Mapping[FilterName, _Tally], nominal: Mapping[FilterName, Drives]
) -> Profile:
    first = next(iter(tallies.values()))
    # the end of an open road, which only the front axle reaches, has no record
    driven = np.all([tally.count > 0 for tally in tallies.values()], axis=0)
    s: FloatArray = (first.bin_m * (np.flatnonzero(driven) + 0.5)).astype(np.float64)
    judged = {name: tally.steps.judged() for name, tally in tallies.items()}
    steps = min(len(mean) for mean, _, _ in judged.values())
    _, low, high = next(iter(judged.values()))
    predicted: dict[str, FloatArray] = {}
    for name, drives in nominal.items():
        n = int(drives.steps.min())
        claim = drives.claimed_m2[:, :n].mean(axis=0)
        predicted[name] = np.sqrt(np.interp(s, drives.s_m[0, :n], claim))
    return Profile(
        s_m=s,
        position_rms_m={
            n: np.sqrt((y.error2[driven]) / y.count[driven]) for n, y in tallies.items()
        },
        cross_track_rms_m={
            n: np.sqrt((y.lateral2[driven]) / y.count[driven]) for n, y in tallies.items()
        },
        predicted_rms_m=predicted,
        time_s=np.arange(1.0, steps + 1.0) * (loop.timing.filter_every * TICK_S),
        nees={name: mean[:steps] for name, (mean, _, _) in judged.items()},
        nees_low=low[:steps],
        nees_high=high[:steps],
    )


def _rms(total: float, count: float) -> float:
    return math.sqrt(float(total) / float(count))
