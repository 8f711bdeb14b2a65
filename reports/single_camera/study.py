"""The study of one camera: the dissertation's chapter 6.1, continuous in every angle and κ."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from models.geometry import FloatArray
from placement.atomic import prepare_folder, write_files
from reports.parts import Parts
from reports.single_camera import figures
from reports.single_camera.kernel import MAXIMISED, OBJECTIVES
from reports.single_camera.ranking import correlations, drive, judged_poses
from reports.single_camera.search import Found, Scorer, find
from reports.single_camera.setting import Setting
from reports.study_files import study_files

RADII_M = (5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0, 30.0, 40.0, 60.0, 100.0, 200.0)
CLOTHOID_RADII_M = (5.0, 10.0, 20.0, 40.0, 100.0)
RANKED = (0.0, 0.05, 0.2)  # the dissertation's curvatures


@dataclass(frozen=True, slots=True)
class Effort:
    """How much the study does; the tolerance is that of the certificate, relative."""

    curvatures: tuple[float, ...]
    with_clothoids: tuple[float, ...] = ()
    tolerance: float = 0.01
    most_boxes: int = 400_000
    ranked: tuple[float, ...] = RANKED
    poses: int = 1000
    runs: int = 20


def _either_side(radii_m: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(sorted(side / radius for radius in radii_m for side in (-1.0, 1.0)))


FULL = Effort(tuple(sorted((0.0, *_either_side(RADII_M)))), _either_side(CLOTHOID_RADII_M))
QUICK = Effort((-0.05, 0.0, 0.05), (), 0.1, 50_000, (0.05,), 40, 4)


def run(
    out_dir: Path,
    *,
    quick: bool = False,
    seed: int = 0,
    parts: Parts | None = None,
    progress: Callable[[str, float | None], None] = lambda _text, _fraction: None,
) -> None:
    """Write `optima.csv`, `cross_values.csv`, `ranks.csv`, `poses.csv` and their figures.

    Raises ValueError where the folder cannot be written.
    """
    prepare_folder(out_dir)
    parts = parts or Parts()
    effort = QUICK if quick else FULL
    bends = {
        f"κ = {curvature:+.3f} per m, {entry}": (curvature, entry, effort, seed)
        for entry, curvatures in (("arc", effort.curvatures), ("clothoid", effort.with_clothoids))
        for curvature in curvatures
    }
    found = parts.compute(
        _bend, bends, lambda name, share: progress(f"single camera: {name}", 0.8 * share)
    )
    drawn = {
        f"{effort.poses} poses, κ = {curvature:g} per m": (curvature, n, effort, seed)
        for n, curvature in enumerate(effort.ranked)
    }
    judged = parts.compute(
        _poses, drawn, lambda name, share: progress(f"single camera: {name}", 0.8 + 0.2 * share)
    )
    ranks = [
        {"curvature": curvature, **row}
        for curvature, table in zip(effort.ranked, judged, strict=True)
        for row in correlations(table)
    ]
    tables = {
        "optima": pd.DataFrame([row for each in found for row in each["optima"]]),
        "cross_values": pd.DataFrame([row for each in found for row in each["cross"]]),
        "ranks": pd.DataFrame(ranks),
        "poses": pd.concat(judged, ignore_index=True),
    }
    write_files(out_dir, study_files(tables, figures.draw(tables)))


def _bend(
    curvature: float, entry: str, effort: Effort, seed: int
) -> dict[str, list[dict[str, Any]]]:
    """Find the best poses for one bend, and judge each by all objectives."""
    setting = Setting(curvature, entry)
    optima: list[dict[str, Any]] = []
    best: dict[str, FloatArray] = {}
    for name in OBJECTIVES:
        found = find(
            Scorer(setting, name), tolerance=effort.tolerance, most_boxes=effort.most_boxes
        )
        optima += _optima_rows(curvature, entry, name, found)
        best[name] = found.optima[0].pose_deg
    return {"optima": optima, "cross": _cross_rows(setting, best, effort.runs, seed)}


def _poses(curvature: float, n: int, effort: Effort, seed: int) -> pd.DataFrame:
    """Judge random poses at the n-th curvature."""
    rng = np.random.default_rng([seed, n])
    table = judged_poses(Setting(curvature), effort.poses, effort.runs, rng, seed)
    return table.assign(curvature=curvature)


def side_of(curvature: float) -> str:
    """Say where the mount stands: on the left of a road that turns left it is inside."""
    return "straight" if curvature == 0.0 else "inside" if curvature > 0.0 else "outside"


def _optima_rows(curvature: float, entry: str, name: str, found: Found) -> list[dict[str, Any]]:
    return [
        {
            "curvature": curvature,
            "entry": entry,
            "mount": side_of(curvature),
            "objective": name,
            "rank": rank,
            "yaw_deg": (optimum.pose_deg[0] + 180.0) % 360.0 - 180.0,
            "pitch_deg": optimum.pose_deg[1],
            "hfov_deg": optimum.pose_deg[2],
            "vfov_deg": optimum.pose_deg[3],
            "value": optimum.value,
            "bound": found.bound,
            "gap_percent": 100.0 * found.gap,
            "boxes": found.boxes,
        }
        for rank, optimum in enumerate(found.optima, start=1)
    ]


def _cross_rows(
    setting: Setting, best: dict[str, FloatArray], runs: int, seed: int
) -> list[dict[str, Any]]:
    """Judge the best pose for each objective by every other, and by driving it."""
    rows = []
    for name, pose in best.items():
        row: dict[str, Any] = {
            "curvature": setting.curvature,
            "entry": setting.entry,
            "placed_for": name,
        }
        for judge, maximised in zip(OBJECTIVES, MAXIMISED, strict=True):
            score = float(Scorer(setting, judge).poses(pose[None])[0])
            row[judge] = score if maximised else -score
        rows.append(row | drive(setting, pose, 10 * runs, seed))
    return rows
