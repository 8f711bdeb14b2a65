"""Measure the closed loop: `python -m benchmarks.closed_loop`, a Markdown table.

Vehicle steps (of 10 ms) a second of processor time on one core, compiled code warm, on `circuit`
with a camera every 150 m: ours with both filters, and a plain Python loop with filterpy, in turns
(A B A B …). The ratio of medians is what counts.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.rivals import filterpy_loop
from models.cameras import Cameras
from models.errors import ErrorModel
from models.roads import Road
from models.simulation import Settings, closed_loop, simulate
from models.vehicle import PROFILES
from placement.assemble import build_road
from placement.instance import load_instance

EVERY_M = 150.0


@dataclass(frozen=True, slots=True)
class Speed:
    """Hold one contestant: its name, vehicle steps a second of each turn, rms error [m]."""

    name: str
    steps_per_s: list[float]
    rms_error_m: float

    @property
    def median(self) -> float:
        """The median speed."""
        return statistics.median(self.steps_per_s)


def circuit() -> Road:
    """Return the road of the shipped instance."""
    return build_road(load_instance("circuit"))


def cameras_every(road: Road, every_m: float = EVERY_M) -> Cameras:
    """Return cameras 3 m left of the road, 6 m up, looking back along it, 40° down, 60° wide."""
    s = np.arange(0.0, road.length_m, every_m)
    n, xy = len(s), road.offset(s, np.full(len(s), 3.0))
    wide = np.full(n, math.radians(60.0))
    return Cameras(
        x_m=xy[:, 0],
        y_m=xy[:, 1],
        height_m=np.full(n, 6.0),
        yaw_rad=road.evaluate(s).heading_rad + math.pi,
        pitch_rad=np.full(n, math.radians(40.0)),
        roll_rad=np.zeros(n),
        hfov_rad=wide,
        vfov_rad=wide,
        width_px=np.full(n, 900),
        height_px=np.full(n, 900),
        projection=np.zeros(n, dtype=np.int64),
        distortion=np.zeros((n, 4)),
    )


def closed_loop_table(runs: int = 100, rival_runs: int = 1, turns: int = 5) -> list[Speed]:
    """Return the three contestants, each turn driving `runs` or, the rival, `rival_runs` laps."""
    road, errors = circuit(), ErrorModel()
    cameras = cameras_every(road)
    loop = closed_loop(road, cameras, errors, settings=Settings())

    def ours(kind: str) -> Callable[[int], tuple[int, float, int]]:
        def lap(turn: int) -> tuple[int, float, int]:
            drives = simulate(loop, filter=kind, runs=runs, seed=turn)  # type: ignore[arg-type]
            squares = float((drives.error_m**2).sum())
            return int(drives.ticks.sum()), squares, int(drives.steps.sum())

        return lap

    def theirs(turn: int) -> tuple[int, float, int]:
        ticks, squares, steps = 0, 0.0, 0
        for run in range(rival_runs):
            rng = np.random.default_rng([turn, run])
            drive = filterpy_loop.drive(road, cameras, errors, PROFILES["car"], rng)
            ticks += drive.ticks
            squares += float((drive.error_m**2).sum())
            steps += len(drive.error_m)
        return ticks, squares, steps

    contestants = {"EKF": ours("ekf"), "Schmidt": ours("schmidt"), "Python + filterpy": theirs}
    simulate(loop, filter="ekf", runs=1)
    simulate(loop, filter="schmidt", runs=1)
    speeds: dict[str, list[float]] = {name: [] for name in contestants}
    squares, steps = dict.fromkeys(contestants, 0.0), dict.fromkeys(contestants, 0)
    for turn in range(turns):
        for name, lap in contestants.items():
            started = time.process_time()
            ticks, square, count = lap(turn)
            speeds[name].append(ticks / (time.process_time() - started))
            squares[name] += square
            steps[name] += count
    return [
        Speed(name, speeds[name], math.sqrt(squares[name] / steps[name])) for name in contestants
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--turns", type=int, default=5, help="measurements of each contestant")
    options = parser.parse_args(arguments)
    rows = closed_loop_table(turns=options.turns)
    rival = rows[-1].median
    header = "| closed loop | vehicle steps/s | spread | times the rival | rms error (m) |\n"
    sys.stdout.write(header + "| --- | --- | --- | --- | --- |\n")
    for row in rows:
        low, high = min(row.steps_per_s), max(row.steps_per_s)
        sys.stdout.write(
            f"| {row.name} | {row.median:,.0f} | {low:,.0f}–{high:,.0f} | "
            f"{row.median / rival:,.0f} | {row.rms_error_m:.3f} |\n"
        )


if __name__ == "__main__":
    main()
