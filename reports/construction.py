"""The study of roads that serve cameras: `placement report construction`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from placement.assemble import assemble
from placement.atomic import prepare_folder, write_files
from placement.construction import Choice, Judged, choose_road, judge
from placement.instance import Instance, instance_from_dict
from placement.validation import validate
from reports.construction_figures import draw_choice, draw_counts
from reports.parts import Parts
from reports.study_files import study_files

CAMERAS = 6
COUNTS = (2, 3, 4, 6, 8, 10)
TOLERANCE_M = 0.29  # 2σ lateral on local streets (Reid et al. 2019)
RUNS = 100
METHOD = "exchange"

# name → [road.construct]; the first two are the dissertation's sketches
MAPS: dict[str, dict[str, Any]] = {
    "triangle": {
        "start": [0, 0, 0],
        "goal": [200, 0, 0],
        "obstacles": [[[80, -25], [130, -30], [100, 35]]],
    },
    "rectangle": {
        "start": [0, 0, 0],
        "goal": [200, 10, 0],
        "obstacles": [[[75, -20], [125, -20], [125, 45], [75, 45]]],
    },
    "slalom": {
        "start": [0, 0, 30],
        "goal": [260, 0, -30],
        "obstacles": [
            [[45, -45], [60, -45], [60, 12], [45, 12]],
            [[105, -14], [122, -14], [122, 50], [105, 50]],
            [[165, -50], [180, -42], [184, 15], [163, 8]],
            [[212, 5], [232, -2], [236, 40], [218, 44]],
        ],
    },
    "courtyard": {
        "start": [0, 0, 0],
        "goal": [150, 0, 180],
        "obstacles": [
            [
                [90, -45],
                [190, -45],
                [190, 45],
                [90, 45],
                [90, 38],
                [183, 38],
                [183, -38],
                [90, -38],
            ],
            [[45, -15], [60, -22], [66, 14], [50, 20]],
        ],
        "min_radius_m": 15.0,
        "length_factor": 1.8,
    },
    "blocks": {
        "start": [0, 0, 0],
        "goal": [220, 120, 90],
        "obstacles": [
            [[x, y], [x + 40, y], [x + 40, y + 26], [x, y + 26]]
            for x in (35, 95, 155)
            for y in (-13, 33, 79)
        ],
        "min_radius_m": 15.0,
        "length_factor": 1.25,
    },
}


def instance_of(name: str, *, quick: bool = False) -> Instance:
    """Return the instance of one map."""
    construct = {
        "min_radius_m": 20.0,
        "clearance_m": 2.0,
        "most_roads": 4 if quick else 10,
        "time_limit_s": 3600.0,  # so that no clock changes what is found
    }
    return instance_from_dict(
        {
            "road": {
                "construct": {**construct, **MAPS[name], "choose": "error"},
                "width_m": 6.0,
                "sample_spacing_m": 2.0 if quick else 1.0,
            },
            "mounts": {"spacing_m": 20.0 if quick else 10.0},
            "camera": {
                "yaw_deg": [0, 90, 180, 270] if quick else [45.0 * n for n in range(8)],
                "pitch_deg": [35.0],
                "fov_deg": [[60.0, 45.0]],
            },
            "obstacles": {"height_m": 10.0},
            "objective": {"kind": "trace", "tolerance_m": TOLERANCE_M},
            "budget": {"cameras": CAMERAS},
        },
        name=name,
    )


def run(
    out_dir: Path,
    *,
    quick: bool = False,
    seed: int = 0,
    parts: Parts | None = None,
    progress: Callable[[str, float | None], None] = lambda _text, _fraction: None,
) -> None:
    """Write the roads, their errors by number of cameras, the closed loop and figures.

    `quick` takes the dissertation's two maps, fewer roads and counts, coarser candidates. Raises
    ValueError where the folder cannot be written.
    """
    prepare_folder(out_dir)
    names = list(MAPS)[:2] if quick else list(MAPS)
    found = (parts or Parts()).compute(
        _map,
        {name: (out_dir, name, quick, seed) for name in names},
        lambda name, share: progress(f"construction: {name}", share),
    )

    def together(key: str) -> pd.DataFrame:
        tables: list[pd.DataFrame] = [each[key] for each in found]
        return pd.concat(tables, ignore_index=True)

    counted = together("counts")
    tables = {
        "construction_roads": together("roads"),
        "construction_counts": counted,
        "construction_needed": _needed(counted),
        "construction_driven": together("driven"),
    }
    progress("construction: writing", None)
    write_files(out_dir, study_files(tables, {"construction_counts": draw_counts(counted)}))


def _map(out_dir: Path, name: str, quick: bool, seed: int) -> dict[str, pd.DataFrame]:
    """Find and judge the roads of one map, drive the one chosen, and draw them."""
    choice = choose_road(instance_of(name, quick=quick), "greedy" if quick else METHOD, seed=seed)
    roads = choice.table()
    roads.insert(0, "map", name)
    title = f"{name}: {CAMERAS} cameras, each road its own best"
    write_files(
        out_dir, study_files({}, {f"construction_{name}": draw_choice(choice, title=title)})
    )
    return {
        "roads": roads,
        "counts": _counts(name, choice, COUNTS[::2] if quick else COUNTS, seed),
        "driven": _driven(name, choice, 20 if quick else RUNS, seed),
    }


def _counts(name: str, choice: Choice, counts: tuple[int, ...], seed: int) -> pd.DataFrame:
    """Place k cameras along the best road of each class, for several k."""
    best: dict[tuple[int, ...], int] = {}
    for n, one in enumerate(choice.judged):
        known = best.get(one.road.word)
        better = known is None or one.error_m2 < choice.judged[known].error_m2
        if one.solution is not None and better:
            best[one.road.word] = n
    rows = []
    for n in sorted(best.values()):
        one = choice.judged[n]
        for k in counts:
            found = judge(
                one.instance.changed({"budget.cameras": k}), one.road, "greedy", seed=seed
            )
            if found.solution is not None:
                rows.append(_count_row(name, n, found))
    return pd.DataFrame(rows)


def _count_row(name: str, road: int, found: Judged) -> dict[str, Any]:
    from models.construction.homotopy import spelled

    return {
        "map": name,
        "road": road,
        "class": spelled(found.road.word),
        "bends": found.road.kind,
        "length_m": found.road.length_m,
        "cameras": found.cameras,
        "error_m2": found.error_m2,
        "lateral_2sigma_m": found.lateral_2sigma_m,
        "within_tolerance": found.lateral_2sigma_m <= TOLERANCE_M,
    }


def _needed(counted: pd.DataFrame) -> pd.DataFrame:
    """Return the fewest cameras tried that keep 2σ lateral within the tolerance everywhere."""
    rows = []
    for (name, road), part in counted.groupby(["map", "road"], sort=False):
        kept = part[part["within_tolerance"]]
        rows.append(
            {
                "map": name,
                "road": road,
                "class": part["class"].iloc[0],
                "bends": part["bends"].iloc[0],
                "length_m": part["length_m"].iloc[0],
                "cameras_needed": kept["cameras"].min() if len(kept) else float("nan"),
            }
        )
    return pd.DataFrame(rows)


def _driven(name: str, choice: Choice, runs: int, seed: int) -> pd.DataFrame:
    """Drive the road chosen in the closed loop."""
    one = choice.judged[choice.chosen]
    assert one.solution is not None  # noqa: S101 (choose_road never chooses a road without)
    summary = validate(assemble(one.instance), one.solution.selected, runs=runs, seed=seed).summary
    columns = (
        "predicted_rms_m",
        "simulated_rms_m",
        "cross_track_rms_m",
        "lateral_within_tolerance",
    )
    return pd.DataFrame(
        [
            {
                "map": name,
                "road": choice.chosen,
                "runs": runs,
                "filter": filter_name,
                **{column: part[column] for column in columns},
            }
            for filter_name, part in summary["filters"].items()
        ]
    )
