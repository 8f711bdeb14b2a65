"""How many cameras a kilometre needs: against tolerance, bends, height, installation, failures.

One thing is varied at a time around τ = 0.29 m, poles of 6 m, the default installation and every
camera working; the whole on a straight, on bends of 50 m and on bends of 20 m.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from benchmarks.tolerance import grid_count
from placement.assemble import Scene, assemble
from placement.atomic import prepare_folder, write_files
from placement.instance import Instance, instance_from_dict
from placement.objectives.tolerance import Tolerance
from placement.solve import solve
from reports.counted import solve_counted
from reports.parts import Parts
from reports.study_files import study_files
from reports.style import CYCLE, style

ROADS: dict[str, list[dict[str, Any]]] = {
    "straight": [{"length": 300}],
    "bends of 50 m": [
        {"length": 40},
        {"length": 70, "curvature": 0.02},
        {"length": 40},
        {"length": 70, "curvature": -0.02},
        {"length": 80},
    ],
    "bends of 20 m": [
        {"length": 60},
        {"length": 30, "curvature": 0.05},
        {"length": 60},
        {"length": 30, "curvature": -0.05},
        {"length": 120},
    ],
}
TOLERANCES_M = (0.10, 0.20, 0.29, 0.57)
HEIGHTS_M = (6.0, 8.0, 10.0, 12.0)
QUALITIES = (0.5, 1.0, 2.0)  # times the default errors of installation
POSITION_M, ORIENTATION_DEG = 0.03, 0.5
LOOKS = 500  # at the clock, some seconds to a minute: what ends by them says `time_limit`


@dataclass(frozen=True, slots=True)
class Case:
    """What is asked of the cameras, and what was varied to get there."""

    varied: str
    road: str
    tolerance_m: float = 0.29
    height_m: float = 6.0
    quality: float = 1.0
    failures: int = 0

    def __str__(self) -> str:
        """Name the case."""
        return (
            f"{self.varied}, {self.road}, {self.tolerance_m:g} m, poles of {self.height_m:g} m, "
            f"installation × {self.quality:g}, {self.failures} dark"
        )

    def instance(self) -> Instance:
        """Return the instance of this case; persistent errors, as installed."""
        return instance_from_dict(
            {
                "road": {"pieces": ROADS[self.road]},
                "mounts": {"spacing_m": 10.0, "height_m": [self.height_m]},
                "camera": {"pitch_deg": [35, 50], "fov_deg": [[60, 45], [90, 68]]},
                "errors": {
                    "model": "covariance",
                    "position_95_m": POSITION_M * self.quality,
                    "orientation_95_deg": ORIENTATION_DEG * self.quality,
                },
                "objective": {"kind": "tolerance", "tolerance_m": self.tolerance_m},
                "budget": {"cameras": 60, "failures": self.failures},
            },
            name=self.road,
        )


def cases(quick: bool) -> Iterator[Case]:
    """Yield every case, the reference with the first of each."""
    for road in ["bends of 50 m"] if quick else list(ROADS):
        for failures in (0,) if quick else (0, 1):
            for tolerance in (0.29,) if quick else TOLERANCES_M:
                yield Case("tolerance", road, tolerance_m=tolerance, failures=failures)
        for height in (8.0,) if quick else HEIGHTS_M:
            yield Case("height", road, height_m=height)
        for quality in () if quick else QUALITIES:
            yield Case("installation", road, quality=quality)


def run(
    out_dir: Path,
    *,
    quick: bool = False,
    seed: int = 0,
    parts: Parts | None = None,
    progress: Callable[[str, float | None], None] = lambda _text, _fraction: None,
) -> None:
    """Write `counts.csv` and a figure into `out_dir`.

    Raises ValueError where the folder cannot be written.
    """
    prepare_folder(out_dir)
    every = {str(case): (case, seed) for case in cases(quick)}
    rows = (parts or Parts()).compute(
        _row, every, lambda name, share: progress(f"camera count: {name}", share)
    )
    counts = pd.DataFrame(rows)
    with style():
        figure = _figure(counts)
    write_files(out_dir, study_files({"counts": counts}, {"cameras_per_km": figure}))


def _row(case: Case, seed: int) -> dict[str, Any]:
    row: dict[str, Any] = {
        "varied": case.varied,
        "road": case.road,
        "tolerance_m": case.tolerance_m,
        "height_m": case.height_m,
        "installation": case.quality,
        "failures": case.failures,
    }
    try:
        scene = assemble(case.instance())
        found = solve_counted(scene.problem, "tolerance", LOOKS, seed)
        uniform = solve(scene.problem, "uniform", seed=seed)
    except ValueError as error:  # more than all candidates together can do: a row that says so
        return row | {"status": str(error).split(":")[0]}
    length_km = scene.road.length_m / 1000.0
    bound = 0.0 if found.bound is None else found.bound
    fewest = found.value if found.status.has_placement else np.nan
    even = uniform.value if uniform.status.has_placement else np.nan
    return row | {
        "status": str(found.status),
        "cameras": fewest,
        "at_least": float(np.ceil(bound - 1e-6)),
        "uniform": even,
        "grid": _grid(scene, int(np.ceil(bound - 1e-6))),
        "per_km": fewest / length_km,
        "uniform_per_km": even / length_km,
    }


def _grid(scene: Scene, least: int) -> float:
    objective = scene.problem.objective
    if not isinstance(objective, Tolerance):
        raise TypeError(f"wanted the objective tolerance, got {objective.name}")
    count = grid_count(scene, objective, max(least, 1))
    return float(count) if count.isdecimal() else float("nan")


def _figure(counts: pd.DataFrame) -> Figure:
    """Cameras a kilometre over each thing that was varied; lines for roads, crosses for uniform."""
    panels = [
        ("tolerance", "tolerance_m", "tolerance τ, 2σ lateral (m)", 0),
        ("tolerance", "tolerance_m", "tolerance τ, any one camera dark (m)", 1),
        ("height", "height_m", "height of the poles (m)", 0),
        ("installation", "installation", "installation errors (× default)", 0),
    ]
    figure = Figure(figsize=(7.6, 5.8))
    axes = figure.subplots(2, 2).ravel()
    for panel, (varied, column, label, failures) in zip(axes, panels, strict=True):
        part = counts[(counts["varied"] == varied) & (counts["failures"] == failures)]
        if "per_km" in part:
            lines = part.groupby("road", sort=False)
            for n, (colour, (road, line)) in enumerate(zip(CYCLE, lines, strict=False)):
                size = 9.0 - 2.5 * n  # smaller and smaller, so that equals all show
                panel.plot(line[column], line["per_km"], "o-", color=colour, label=road, ms=size,
                           fillstyle="none", linewidth=0.8)  # fmt: skip
                panel.plot(line[column], line["uniform_per_km"], "x", color=colour, ms=size)
        panel.set_xlabel(label)
        panel.set_ylabel("cameras per km")
        panel.set_ylim(bottom=0.0)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, title="× uniform spacing")
    return figure
