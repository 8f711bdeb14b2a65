"""Sets of cameras: what each method finds for 1 to 20 of them, and which objective foretells a car.

The dissertation's chapter 6, which drove a few sets of cameras a few times. Four roads (and more
from files), each with the poses of `GRID`; every objective by every method; each placement then
judged by every objective and driven in the closed loop.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from models.geometry import FloatArray, IntArray
from placement.assemble import Scene, assemble
from placement.atomic import prepare_folder, write_files
from placement.instance import instance_from_dict
from placement.objectives.base import Objective
from placement.problem import Problem
from placement.solution import Solution
from placement.solve import solve
from placement.validation import validate
from reports import camera_sets_figures as figures
from reports.camera_sets_rank import diminishing_returns, rank_correlations
from reports.study_files import study_files

ROADS: dict[str, list[dict[str, Any]]] = {
    "straight": [{"length": 200}],
    "bend": [{"length": 60}, {"length": 47.1239, "curvature": 1 / 30}, {"length": 60}],
    "s-bend": [
        {"length": 50},
        {"length": 40, "curvature": 0.025},
        {"length": 20, "curvature": [0.025, -0.025]},
        {"length": 40, "curvature": -0.025},
        {"length": 50},
    ],
    "hairpin": [{"length": 70}, {"length": 31.4159, "curvature": 0.1}, {"length": 70}],
}
GRID: dict[str, Any] = {
    "mounts": {"spacing_m": 10.0},
    "camera": {"pitch_deg": [35, 50], "fov_deg": [[60, 45], [90, 68]], "max_range_m": 100.0},
    "errors": {"model": "radius"},
}
# The objectives by name: kind and weight.
OBJECTIVES: dict[str, dict[str, str]] = {
    "localisation": {"kind": "localisation"},
    "entropy": {"kind": "entropy"},
    "trace": {"kind": "trace", "weight": "position"},
    "lateral": {"kind": "trace", "weight": "lateral"},
    "final_entropy": {"kind": "final_entropy"},
}
QUICK_METHODS = ("greedy", "exchange", "search", "cascade", "uniform", "random")
SLOW_METHODS = ("auto", "relaxation", "hill-climb")
BUDGETS = tuple(range(1, 21))
SLOW_BUDGETS = (1, 2, 5, 10, 20)
DRIVEN = ("auto", "greedy", "exchange", "cascade", "uniform", "random")
DRIVEN_BUDGETS = (2, 5, 10, 20)
LIMIT_S = 20.0  # far more than any case here takes, so that the clock decides nothing


@dataclass(frozen=True, slots=True)
class Effort:
    """How much the study does."""

    budgets: tuple[int, ...] = BUDGETS
    slow_budgets: tuple[int, ...] = SLOW_BUDGETS
    driven_budgets: tuple[int, ...] = DRIVEN_BUDGETS
    slow_methods: tuple[str, ...] = SLOW_METHODS
    runs: int = 100
    triples: int = 2000
    random_sets: int = 30


QUICK = Effort((2, 5), (2,), (2, 5), ("relaxation",), 10, 1000, 5)


def run(
    out_dir: Path,
    *,
    quick: bool = False,
    seed: int = 0,
    roads: Sequence[Path] = (),
    progress: Callable[[str, float | None], None] = lambda _text, _fraction: None,
) -> None:
    """Write `values.csv`, `closed_loop.csv`, `ranks.csv`, `diminishing.csv` and their figures.

    `roads` are files of further roads. Raises ValueError for a road that cannot be read, or an
    `out_dir` that cannot be written.
    """
    prepare_folder(out_dir)
    effort = QUICK if quick else Effort()
    scenes = scenes_of(["hairpin"] if quick else list(ROADS), roads)
    values: list[dict[str, Any]] = []
    driven: list[dict[str, Any]] = []
    diminishing: list[dict[str, Any]] = []
    for n, (road, scene) in enumerate(scenes.items()):
        problems = problems_of(scene)

        def tell(text: str, share: float, n: int = n, road: str = road) -> None:
            progress(f"camera sets: {road}, {text}", (n + share) / len(scenes))

        found = _solve_all(road, problems, effort, seed, tell, values)
        sets = _sets_to_drive(found, scene, effort, seed)
        for m, ((kind, method, k), selected) in enumerate(sets.items()):
            tell(f"driving {k} cameras", 0.7 + 0.2 * m / len(sets))
            row = {"road": road, "placed_for": kind, "method": method, "k": k}
            driven.append({**row, **_judge(scene, problems, selected, effort.runs, seed)})
        tell("diminishing returns", 0.9)
        for name, problem in problems.items():
            rng = np.random.default_rng([seed, n])
            returns = diminishing_returns(
                problem.objective, scene.candidates.mount, effort.triples, rng
            )
            diminishing.append({"road": road, "objective": name, **returns})
    tables = {
        "values": pd.DataFrame(values),
        "closed_loop": pd.DataFrame(driven),
        "ranks": rank_correlations(pd.DataFrame(driven), list(OBJECTIVES)),
        "diminishing": pd.DataFrame(diminishing),
    }
    write_files(out_dir, study_files(tables, figures.draw(tables)))


def scenes_of(names: Sequence[str], roads: Sequence[Path]) -> dict[str, Scene]:
    """Assemble the named roads of `ROADS` and those of the files `roads`, all with `GRID`."""
    documents: dict[str, dict[str, Any]] = {
        name: {"road": {"pieces": ROADS[name]}} for name in names
    }
    documents |= {
        path.name.split(".")[0].lower(): {"road": {"file": str(path.resolve())}} for path in roads
    }
    scenes = {}
    for name, document in documents.items():
        instance = instance_from_dict({**document, **GRID, "budget": {"cameras": 20}}, name=name)
        scenes[name] = assemble(instance)
    return scenes


def problems_of(scene: Scene) -> dict[str, Problem]:
    """Return the scene's problem with each of `OBJECTIVES` in turn."""
    from placement.assemble import build_objective

    problems = {}
    for name, section in OBJECTIVES.items():
        changed = scene.instance.changed({f"objective.{k}": v for k, v in section.items()})
        objective: Objective = build_objective(changed, scene.journeys)
        problems[name] = replace(scene.problem, objective=objective)
    return problems


Found = dict[tuple[str, str, int], tuple[int, ...]]


def _solve_all(
    road: str,
    problems: Mapping[str, Problem],
    effort: Effort,
    seed: int,
    tell: Callable[[str, float], None],
    rows: list[dict[str, Any]],
) -> Found:
    found: Found = {}
    jobs = [
        (name, method, k)
        for name in problems
        for method in (*QUICK_METHODS, *effort.slow_methods)
        for k in (effort.budgets if method in QUICK_METHODS else effort.slow_budgets)
    ]
    for n, (name, method, k) in enumerate(jobs):
        tell(f"{name} by {method}, {k} cameras", 0.7 * n / len(jobs))
        problem = problems[name]
        problem = replace(problem, constraints=replace(problem.constraints, budget=k))
        row = {"road": road, "objective": name, "method": method, "k": k}
        try:
            solution = solve(problem, method, time_limit_s=LIMIT_S, seed=seed)
        except ValueError as error:  # the method does not know the objective: a row that says so
            rows.append({**row, "status": str(error).split(",")[0]})
            continue
        rows.append({**row, **_solution_row(solution)})
        if solution.status.has_placement:
            found[name, method, k] = solution.selected
    return found


def _solution_row(solution: Solution) -> dict[str, Any]:
    return {
        "status": str(solution.status),
        "value": solution.value,
        "bound": solution.bound,
        "gap_percent": None if solution.gap is None else 100.0 * solution.gap,
    }


def _sets_to_drive(found: Found, scene: Scene, effort: Effort, seed: int) -> Found:
    """Choose what is driven: what methods found, and random sets, none twice."""
    sets: Found = {}
    seen: set[tuple[int, ...]] = set()
    for (kind, method, k), selected in found.items():
        wanted = method in DRIVEN or method == effort.slow_methods[0]
        if wanted and k in effort.driven_budgets and selected not in seen:
            seen.add(selected)
            sets[kind, method, k] = selected
    rng = np.random.default_rng(seed)
    mount = scene.candidates.mount
    for k in effort.driven_budgets:
        for n in range(effort.random_sets):
            sets["nothing", f"random {n}", k] = _random_set(mount, k, rng)
    return sets


def _random_set(mount: IntArray, k: int, rng: np.random.Generator) -> tuple[int, ...]:
    mounts = rng.choice(np.unique(mount), size=k, replace=False)
    return tuple(sorted(int(rng.choice(np.flatnonzero(mount == m))) for m in mounts))


def _judge(
    scene: Scene,
    problems: Mapping[str, Problem],
    selected: tuple[int, ...],
    runs: int,
    seed: int,
) -> dict[str, Any]:
    """Return the value of every objective, and what the closed loop says."""
    chosen = np.array(selected, dtype=np.int64)
    row: dict[str, Any] = {
        name: problem.objective.value(chosen) for name, problem in problems.items()
    }
    try:
        validation = validate(scene, selected, runs=runs, seed=seed)
    except ValueError:  # no camera sees the car, or it is lost for good
        return row | {"cross_track_rms_m": np.nan, "error_rms_m": np.nan, "in_tolerance": np.nan}
    schmidt = validation.summary["filters"]["schmidt"]
    worst: FloatArray = validation.rows["max_cross_track_m"].to_numpy(np.float64)
    return row | {
        "cross_track_rms_m": schmidt["cross_track_rms_m"],
        "error_rms_m": schmidt["simulated_rms_m"],
        "in_tolerance": schmidt["lateral_within_tolerance"],
        "worst_cross_track_m": float(np.mean(worst)),
    }
