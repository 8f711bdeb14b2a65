"""A four-way crossing: every way through it, straight on, right and left, in one objective.

The study writes the crossing as a planner's file (GeoJSON), the demand, and the instance, so that
`placement solve crossing.toml` repeats any of its placements.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from placement.assemble import Scene, assemble
from placement.atomic import Content, prepare_folder, write_files
from placement.commands import Result
from placement.instance import load_instance
from placement.prediction import predict
from placement.solve import solve
from placement.validation import validate
from reports.parts import Parts
from reports.solution_map import draw_map
from reports.study_files import study_files
from reports.style import CYCLE, GREY, style

ARM_M = 80.0
ARMS = ("east", "north", "west", "south")  # anticlockwise
# Trips a movement, as counted at a crossing where most drive straight on.
TRIPS = {"straight": 4, "right": 2, "left": 2}
BUDGETS = (1, 2, 3, 4, 6, 8, 12)
METHODS = ("search", "exchange", "greedy", "relaxation", "uniform", "random")
QUICK_METHODS = ("exchange", "greedy", "uniform")


def run(
    out_dir: Path,
    *,
    quick: bool = False,
    seed: int = 0,
    parts: Parts | None = None,
    progress: Callable[[str, float | None], None] = lambda _text, _fraction: None,
) -> None:
    """Write the crossing's files, `values.csv`, `movements.csv` and two figures into `out_dir`.

    `movements.csv` has a row for each k and movement: predicted and driven error of the placement
    that `search` found for all of them together. No method is stopped by the clock. Raises
    ValueError where the folder cannot be written.
    """
    prepare_folder(out_dir)
    write_files(out_dir, crossing_files())
    budgets = (2, 4) if quick else BUDGETS
    methods = QUICK_METHODS if quick else METHODS
    found = (parts or Parts()).compute(
        _budget,
        {f"{k} cameras": (out_dir, k, methods, 10 if quick else 100, seed) for k in budgets},
        lambda name, share: progress(f"intersection: {name}", share),
    )
    values = pd.DataFrame([row for each in found for row in each["values"]])
    ways = pd.concat([each["ways"] for each in found], ignore_index=True)
    with style():
        figures = {"movements_over_k": _figure(values, ways)}
    write_files(out_dir, study_files({"values": values, "movements": ways}, figures))


def _budget(
    out_dir: Path, k: int, methods: tuple[str, ...], runs: int, seed: int
) -> dict[str, Any]:
    """Solve the crossing for k cameras by every method; the first is judged way by way.

    With as many as the instance asks for, the map is drawn, too.
    """
    scene = assemble(load_instance(out_dir / "crossing.toml"))
    asked = scene.problem.constraints.budget
    rows = []
    for method in methods:
        solution = solve(with_budget(scene, k).problem, method, seed=seed)
        gap = None if solution.gap is None else 100.0 * solution.gap
        rows.append(
            {
                "k": k,
                "method": method,
                "trace_m2": solution.value,
                "bound_m2": solution.bound,
                "gap_percent": gap,
            }
        )
        if method == methods[0]:
            best = solution
    if k == asked:
        with style():
            figure = Figure(figsize=(6.4, 6.0))
            draw_map(figure.subplots(), Result(scene, best, predict(scene, best.selected)))
        write_files(out_dir, study_files({}, {"crossing": figure}))
    return {"values": rows, "ways": _movements(scene, best.selected, k, runs, seed)}


def crossing_files() -> dict[str, Content]:
    """Return the crossing as GeoJSON in metres, the demand as CSV, and the instance as TOML."""
    features = []
    for n, arm in enumerate(ARMS):
        x, y = (round(ARM_M * f(n * math.pi / 2.0), 9) for f in (math.cos, math.sin))
        features.append(
            {
                "type": "Feature",
                "properties": {"id": arm, "lanes": 2, "width": 7.0, "oneway": False},
                "geometry": {"type": "LineString", "coordinates": [[x, y], [0.0, 0.0]]},
            }
        )
    collection = {
        "type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}},
        "features": features,
    }
    rows = [f"{start},-{end},{TRIPS[turn]}" for start, end, turn in movements()]
    return {
        "crossing.geojson": json.dumps(collection, indent=1) + "\n",
        "demand.csv": "\n".join(["from,to,trips", *rows]) + "\n",
        "crossing.toml": INSTANCE,
    }


def movements() -> list[tuple[str, str, str]]:
    """Return the arm it comes from, the arm it leaves by, and the turn, of all twelve."""
    # who comes in from an arm has the next one anticlockwise on the right
    steps = ((1, "right"), (2, "straight"), (3, "left"))
    return [(arm, ARMS[(n + k) % 4], turn) for n, arm in enumerate(ARMS) for k, turn in steps]


INSTANCE = """\
# A crossing of two streets of 7 m, seen by cameras on poles beside them.
[road]
file = "crossing.geojson"
[traffic]
demand = "demand.csv"
[mounts]
spacing_m = 10.0
[camera]
resolution_px = [900, 900]
pitch_deg = [35, 50]
fov_deg = [[60, 60], [90, 68]]
max_range_m = 100.0
[errors]
model = "radius"
[vehicle]
speed_mps = 10.0
[objective]
kind = "trace"
[budget]
cameras = 4
"""


def with_budget(scene: Scene, k: int) -> Scene:
    """Return the scene with another number of cameras."""
    constraints = replace(scene.problem.constraints, budget=k)
    return replace(scene, problem=replace(scene.problem, constraints=constraints))


def _movements(
    scene: Scene, selected: tuple[int, ...], k: int, runs: int, seed: int
) -> pd.DataFrame:
    """Return each movement's predicted rms and worst 2σ lateral error, and what driving gives."""
    rows = []
    driven = _driven(scene, selected, runs, seed)
    for n, (journey, (start, end, turn)) in enumerate(
        zip(scene.journeys, movements(), strict=True)
    ):
        along = predict(scene, selected, n)
        rows.append(
            {
                "k": k,
                "movement": f"{start} to {end}",
                "turn": turn,
                "weight": journey.weight,
                "predicted_rms_m": float(np.sqrt(np.mean(along.position_sigma_m**2))),
                "worst_2sigma_lateral_m": 2.0 * float(along.lateral_sigma_m.max()),
                "cross_track_rms_m": driven.get(journey.name, float("nan")),
            }
        )
    return pd.DataFrame(rows)


def _driven(scene: Scene, selected: tuple[int, ...], runs: int, seed: int) -> dict[str, float]:
    try:
        summary = validate(scene, selected, runs=runs, seed=seed).summary
    except ValueError:  # some movement is never seen
        return {}
    drives = summary.get("drives", [])
    return {
        each["drive"]: each["filters"]["schmidt"]["cross_track_rms_m"]
        for each in drives
        if "filters" in each
    }


def _figure(values: pd.DataFrame, ways: pd.DataFrame) -> Figure:
    """The objective by method over k, and every movement's worst lateral error."""
    figure = Figure(figsize=(7.6, 3.4))
    left, right = figure.subplots(1, 2)
    methods = list(dict.fromkeys(values["method"]))
    for n, (colour, method) in enumerate(zip(CYCLE, methods, strict=False)):
        line = values[values["method"] == method]
        left.plot(line["k"], np.sqrt(line["trace_m2"]), "o-", color=colour, label=method,
                  fillstyle="none", markersize=9 - 1.2 * n, linewidth=0.8)  # fmt: skip
    bound = pd.to_numeric(values["bound_m2"]).groupby(values["k"]).max().dropna()
    left.plot(
        bound.index, np.sqrt(bound.to_numpy()), "_", color=GREY, markersize=9, label="proven bound"
    )
    left.set_xlabel("cameras k")
    left.set_ylabel("rms position error (m)")
    left.set_ylim(bottom=0.0)
    left.legend(fontsize=8)
    for _, line in ways.groupby("movement"):
        right.plot(line["k"], line["worst_2sigma_lateral_m"], ".-", linewidth=0.8, color=CYCLE[0],
                   alpha=0.6)  # fmt: skip
    right.set_xlabel("cameras k")
    right.set_ylabel("worst 2σ lateral (m), each movement")
    right.set_ylim(bottom=0.0)
    return figure
