"""What a cheap score is worth: how it ranks a thousand poses, and what its own best loses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import spearmanr

from models.errors import ErrorModel
from models.geometry import FloatArray
from models.simulation import Settings
from placement.validation import validate_cameras
from reports.single_camera.kernel import MAXIMISED, OBJECTIVES
from reports.single_camera.search import Scorer
from reports.single_camera.setting import (
    HIGH_DEG,
    INITIAL_SIGMA,
    LOW_DEG,
    RATE_HZ,
    SPEED_MPS,
    Setting,
)

DRIVEN = ("cross_track_rms_m", "error_rms_m")


def judged_poses(
    setting: Setting, count: int, runs: int, rng: np.random.Generator, seed: int
) -> pd.DataFrame:
    """Draw `count` poses that see the road, and judge each by every objective and by driving it.

    Driven as installed (`covariance`, persistent offsets, drawn anew for every run) under the
    Schmidt filter. A pose that the closed loop cannot be set up with has NaN.
    """
    scorers = {name: Scorer(setting, name) for name in OBJECTIVES}
    poses: FloatArray = np.empty((0, 4))
    while len(poses) < count:
        drawn = rng.uniform(LOW_DEG, HIGH_DEG, (4 * count, 4))
        poses = np.vstack((poses, drawn[scorers["localisation"].poses(drawn) > 0.0]))[:count]
    table = pd.DataFrame(poses, columns=["yaw_deg", "pitch_deg", "hfov_deg", "vfov_deg"])
    for (name, scorer), maximised in zip(scorers.items(), MAXIMISED, strict=True):
        table[name] = (1.0 if maximised else -1.0) * scorer.poses(poses)
    driven = [drive(setting, pose, runs, seed) for pose in poses]
    for column in DRIVEN:
        table[column] = [each[column] for each in driven]
    return table


def drive(setting: Setting, pose_deg: FloatArray, runs: int, seed: int) -> dict[str, float]:
    """Return the Schmidt filter's rms errors in the closed loop with this one camera."""
    try:
        validation = validate_cameras(
            setting.road,
            setting.cameras(np.atleast_2d(pose_deg)),
            ErrorModel(kind="covariance"),
            speed_mps=SPEED_MPS,
            settings=Settings(frame_hz=RATE_HZ, initial_sigma=INITIAL_SIGMA),
            runs=runs,
            seed=seed,
        )
    except ValueError:  # the camera never sees the car at the moments of its frames
        return dict.fromkeys(DRIVEN, float("nan"))
    schmidt = validation.summary["filters"]["schmidt"]
    return {
        "cross_track_rms_m": schmidt["cross_track_rms_m"],
        "error_rms_m": schmidt["simulated_rms_m"],
    }


def correlations(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return Spearman's ρ between every objective and each judge, 1 where both agree on better."""
    judges = {"trace": 1.0, "lateral": 1.0, **dict.fromkeys(DRIVEN, 1.0)}
    rows = []
    for name, maximised in zip(OBJECTIVES, MAXIMISED, strict=True):
        row: dict[str, Any] = {"objective": name, "poses": len(table)}
        for judge in judges:
            part = table.dropna(subset=[judge])
            rho = float(spearmanr(part[name], part[judge]).statistic)
            row[f"with_{judge}"] = -rho if maximised else rho
        rows.append(row)
    return rows
