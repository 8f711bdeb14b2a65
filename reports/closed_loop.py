"""The closed-loop study: how far dead reckoning drifts, and which filter tells the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from models.errors import ErrorModel
from models.geometry import FloatArray
from models.simulation import Settings, closed_loop, simulate
from models.vehicle import PROFILES
from placement.assemble import assemble
from placement.atomic import Content, prepare_folder, write_files
from placement.instance import load_instance
from placement.solve import solve
from placement.validation import Validation, validate
from reports.consistency import draw_nees
from reports.style import saved, style

INSTANCES = ("circuit", "straight-80", "bend-20")
PLACED_FOR = {"errors.model": "covariance", "objective.kind": "localisation"}
RUNS = 400
DEAD_RECKONING_RUNS = (20, 1000)
DISSERTATION = {"mean_m": 2.06, "worst_m": 5.85}
REAL_CAR = {"mean_m": 2.4, "worst_m": 5.3}
START = (0.1, 0.1, 0.0)  # the dissertation's P0 = diag(0.01, 0.01, 0)


@dataclass(frozen=True, slots=True)
class Case:
    """One way to drive: the name of its rows, changes to the instance, options of `validate`."""

    name: str
    changes: dict[str, Any] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)


CASES = (
    Case("as installed"),
    Case(
        "perfectly installed",
        changes={"errors.position_95_m": 0.0, "errors.orientation_95_deg": 0.0},
    ),
    Case("80 ms late, 4 % missed", options={"latency_s": 0.08, "missed": 0.04}),
    Case(
        "as before, 1 % false",
        options={"latency_s": 0.08, "missed": 0.04, "false": 0.01},
    ),
    Case("single-track car", options={"plant": "single-track"}),
    Case("odometry of the dissertation", changes={"vehicle.profile": "dissertation"}),
    Case("odometry of a robot", changes={"vehicle.profile": "robot"}),
)


def run(
    out_dir: Path,
    *,
    quick: bool = False,
    seed: int = 0,
    progress: Callable[[str, float | None], None] = lambda _text, _fraction: None,
) -> None:
    """Write `dead_reckoning.csv`, `consistency.csv` and a figure a road into `out_dir`.

    `quick` drives a tenth of the runs. Raises ValueError where the folder cannot be written.
    """
    prepare_folder(out_dir)
    share = 10 if quick else 1
    progress("closed loop: dead reckoning", 0.0)
    drift = dead_reckoning(tuple(max(20, n // share) for n in DEAD_RECKONING_RUNS), seed)
    rows: list[pd.DataFrame] = []
    contents: dict[str, Content] = {"dead_reckoning.csv": _csv(drift)}
    total = len(INSTANCES) * len(CASES)
    for n, (name, case, validation) in enumerate(_validations(max(20, RUNS // share), seed)):
        progress(f"closed loop: {name}, {case.name}", n / total)
        rows.append(_consistency(name, case, validation))
        if case.name == CASES[0].name:
            with style():
                figure = Figure(figsize=(8.0, 3.6))
                draw_nees(figure.subplots(), validation.profile)
            for kind in ("png", "svg"):
                contents[f"nees_{name}.{kind}"] = saved(figure, kind)
    contents["consistency.csv"] = _csv(pd.concat(rows, ignore_index=True))
    progress("closed loop: writing", None)
    write_files(out_dir, contents)


def dead_reckoning(runs: tuple[int, ...] = DEAD_RECKONING_RUNS, seed: int = 0) -> pd.DataFrame:
    """Return end errors after one lap of `circuit` without cameras, beside those of others.

    One row a profile, filter rate and number of runs: mean, worst and rms distance of estimate and
    truth at the end [m], what the filter claims, and the mean as a share of the distance.
    """
    scene = assemble(load_instance("circuit"))
    nobody = scene.candidates.cameras.subset([])
    length = scene.road.length_m
    rows = []
    for profile, noise in PROFILES.items():
        for hz in (25.0, 100.0):
            loop = closed_loop(
                scene.road,
                nobody,
                ErrorModel(),
                odometry=noise,
                settings=Settings(filter_hz=hz, initial_sigma=START),
            )
            for count in runs:
                drives = simulate(loop, filter="ekf", runs=count, seed=seed)
                end = np.hypot(drives.end_error_m[:, 0], drives.end_error_m[:, 1])
                claim = drives.claimed_m2[np.arange(count), drives.steps - 1]
                rows.append(
                    {
                        "odometry": profile,
                        "filter_hz": hz,
                        "runs": count,
                        **_drift(end, length),
                        "claimed_rms_m": float(np.sqrt(claim.mean())),
                    }
                )
    for source, figures in (
        ("the dissertation's simulator", DISSERTATION),
        ("a real car", REAL_CAR),
    ):
        share = 100.0 * figures["mean_m"] / length
        rows.append({"odometry": source, **figures, "mean_percent_of_distance": share})
    return pd.DataFrame(rows)


def _drift(end: FloatArray, length_m: float) -> dict[str, float]:
    return {
        "mean_m": float(end.mean()),
        "worst_m": float(end.max()),
        "rms_m": float(np.sqrt((end**2).mean())),
        "mean_percent_of_distance": 100.0 * float(end.mean()) / length_m,
    }


def _validations(runs: int, seed: int) -> Iterator[tuple[str, Case, Validation]]:
    """Drive every case of every instance; greedy places the cameras once for each, in a second."""
    for name in INSTANCES:
        base = load_instance(name).changed(PLACED_FOR)
        scene = assemble(base)
        selected = solve(scene.problem, "greedy").selected
        for case in CASES:
            # what drives reads the instance, not the information precomputed from it
            changed = replace(scene, instance=base.changed(case.changes))
            yield name, case, validate(changed, selected, runs=runs, seed=seed, **case.options)


def _consistency(name: str, case: Case, validation: Validation) -> pd.DataFrame:
    parts = validation.summary["filters"]
    table = pd.DataFrame(parts.values())
    table.insert(0, "filter", list(parts))
    table.insert(0, "runs", validation.summary["runs"])
    table.insert(0, "case", case.name)
    table.insert(0, "instance", name)
    return table


def _csv(table: pd.DataFrame) -> str:
    text: str = table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    return text
