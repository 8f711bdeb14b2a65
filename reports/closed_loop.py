"""The closed-loop study: how far dead reckoning drifts, and which filter tells the truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from placement.assemble import Scene, assemble
from placement.atomic import prepare_folder, write_files
from placement.instance import Instance, instance_from_dict, load_instance
from placement.solve import solve
from placement.validation import Validation, validate
from reports.consistency import draw_nees
from reports.parts import Parts
from reports.study_files import study_files
from reports.style import style

INSTANCES = ("circuit", "straight-80", "bend-20")
PLACED_FOR = {"errors.model": "covariance", "objective.kind": "localisation"}
RUNS = 400
# On a short road one run is few independent errors: only many runs show a bias of 5 %.
PREDICTION_STEPS = 400 * 2500
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
    roads: Sequence[Path] = (),
    parts: Parts | None = None,
    progress: Callable[[str, float | None], None] = lambda _text, _fraction: None,
) -> None:
    """Write `dead_reckoning.csv`, `consistency.csv`, `prediction.csv` and a figure a road.

    `roads` are files of further roads, driven under the cameras of `circuit`. `quick` drives a
    tenth of the runs. Raises ValueError for a road that cannot be read, or an `out_dir` that
    cannot be written.
    """
    prepare_folder(out_dir)
    parts = parts or Parts()
    share = 10 if quick else 1
    [drift] = parts.compute(
        dead_reckoning,
        {"dead reckoning": (tuple(max(20, n // share) for n in DEAD_RECKONING_RUNS), seed)},
        lambda name, _share: progress(f"closed loop: {name}", 0.1),
    )
    driven = {
        f"{base.name}, {case.name}": (out_dir, base, case, share, seed)
        for base in _instances(roads)
        for case in CASES
    }
    found = parts.compute(
        _drive, driven, lambda name, done: progress(f"closed loop: {name}", 0.1 + 0.9 * done)
    )
    tables = {
        "dead_reckoning": drift,
        "prediction": pd.DataFrame([each["prediction"] for each in found if "prediction" in each]),
        "consistency": pd.concat([each["consistency"] for each in found], ignore_index=True),
    }
    progress("closed loop: writing", None)
    write_files(out_dir, study_files(tables, {}))


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


@dataclass(frozen=True, slots=True)
class Setting:
    """A scene with its cameras placed."""

    scene: Scene
    selected: tuple[int, ...]


def _instances(roads: Sequence[Path]) -> list[Instance]:
    """Return the shipped instances and one for each further road."""
    circuit = load_instance("circuit").as_dict()
    given = [
        instance_from_dict(
            {**circuit, "road": {"file": str(road.resolve())}}, name=road.name.split(".")[0]
        )
        for road in roads
    ]
    return [base.changed(PLACED_FOR) for base in (*map(load_instance, INSTANCES), *given)]


def _drive(out_dir: Path, base: Instance, case: Case, share: int, seed: int) -> dict[str, Any]:
    """Drive one case of one instance; greedy places its cameras in a second.

    The first case is also predicted, and its consistency drawn.
    """
    scene = assemble(base)
    setting = Setting(scene, solve(scene.problem, "greedy").selected)
    # what drives reads the instance, not the information precomputed from it
    changed = replace(scene, instance=base.changed(case.changes))
    runs = max(20, RUNS // share)
    driven = validate(changed, setting.selected, runs=runs, seed=seed, **case.options)
    row: dict[str, Any] = {"consistency": _consistency(base.name, case, driven)}
    if case.name == CASES[0].name:
        row["prediction"] = _prediction(setting, driven, share, seed)
        with style():
            figure = Figure(figsize=(8.0, 3.6))
            draw_nees(figure.subplots(), driven.profile)
        write_files(out_dir, study_files({}, {f"nees_{base.name}": figure}))
    return row


def _prediction(setting: Setting, validation: Validation, share: int, seed: int) -> dict[str, Any]:
    """Return predicted against simulated rms error of the Schmidt filter, with its uncertainty.

    The interval is of the relative difference, by a bootstrap over runs.
    """
    steps = validation.profile.time_s.size
    runs = max(validation.summary["runs"], PREDICTION_STEPS // (steps * share))
    if runs > validation.summary["runs"]:
        validation = validate(setting.scene, setting.selected, runs=runs, seed=seed)
    rows = validation.rows[validation.rows["filter"] == "schmidt"]
    square = rows["rms_localisation_error_m"].to_numpy(np.float64) ** 2
    predicted = validation.summary["filters"]["schmidt"]["predicted_rms_m"]
    draws = np.random.default_rng(seed).choice(square, size=(2000, len(square))).mean(axis=1)
    low, high = np.sqrt(np.quantile(draws, (0.025, 0.975))) / predicted - 1.0
    return {
        "instance": setting.scene.instance.name,
        "runs": runs,
        "predicted_rms_m": predicted,
        "simulated_rms_m": float(np.sqrt(square.mean())),
        "difference_percent": 100.0 * (float(np.sqrt(square.mean())) / predicted - 1.0),
        "low_95_percent": 100.0 * float(low),
        "high_95_percent": 100.0 * float(high),
    }


def _consistency(name: str, case: Case, validation: Validation) -> pd.DataFrame:
    parts = validation.summary["filters"]
    table = pd.DataFrame(parts.values())
    table.insert(0, "filter", list(parts))
    table.insert(0, "runs", validation.summary["runs"])
    table.insert(0, "case", case.name)
    table.insert(0, "instance", name)
    return table
