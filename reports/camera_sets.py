"""Sets of cameras: what each method finds for 1 to 20 of them, and which objective foretells a car.

The dissertation's chapter 6, which drove a few sets of cameras a few times. Four roads (and more
from files), each with the poses of `GRID`; every objective by every method; each placement then
judged by every objective and driven in the closed loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from models.geometry import FloatArray, IntArray
from placement.assemble import Scene, assemble
from placement.atomic import prepare_folder, write_files
from placement.instance import Instance, instance_from_dict
from placement.objectives.base import Objective
from placement.problem import Problem
from placement.roadway import build_road
from placement.solution import Solution, Status
from placement.solve import solve
from placement.validation import validate
from reports import camera_sets_figures as figures
from reports.camera_sets_rank import diminishing_returns, rank_correlations
from reports.parts import Parts
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
METHODS = ("greedy", "exchange", "search", "cascade", "uniform", "random")
SLOW_METHODS = ("relaxation", "hill-climb")
BUDGETS = tuple(range(1, 21))
SLOW_BUDGETS = (1, 2, 5, 10, 20)
# The methods that prove would be stopped by the clock for more cameras, and tables that depend on
# how fast a machine is cannot be compared: so they are asked only what they end by themselves,
# and along a road of kilometres only for `localisation`.
PROOFS: dict[str, tuple[tuple[str, ...], tuple[int, ...]]] = {
    "localisation": (("auto", "mip"), (1, 2)),
    "entropy": (("auto",), (1, 2)),
    "trace": (("auto",), (1,)),
    "lateral": (("auto",), (1,)),
}
LONG_M = 500.0
SAFETY_S = 300.0  # a proof that took so long would have the status `time_limit`
DRIVEN = ("search", "greedy", "exchange", "cascade", "uniform", "random")
DRIVEN_BUDGETS = (2, 5, 10, 20)


@dataclass(frozen=True, slots=True)
class Effort:
    """How much the study does."""

    budgets: tuple[int, ...] = BUDGETS
    slow_budgets: tuple[int, ...] = SLOW_BUDGETS
    driven_budgets: tuple[int, ...] = DRIVEN_BUDGETS
    slow_methods: tuple[str, ...] = SLOW_METHODS
    runs: int = 50
    triples: int = 2000
    random_sets: int = 24


QUICK = Effort((2, 5), (2,), (2, 5), ("relaxation",), 10, 1000, 5)
# Along a road of kilometres everything takes ten times as long.
LONG = Effort((1, 2, 5, 10, 20), (2, 5, 20), (5, 20), ("relaxation",), 20, 1000, 12)


def run(
    out_dir: Path,
    *,
    quick: bool = False,
    seed: int = 0,
    roads: Sequence[Path] = (),
    parts: Parts | None = None,
    progress: Callable[[str, float | None], None] = lambda _text, _fraction: None,
) -> None:
    """Write `values.csv`, `closed_loop.csv`, `ranks.csv`, `diminishing.csv` and their figures.

    `roads` are files of further roads. Raises ValueError for a road that cannot be read, or an
    `out_dir` that cannot be written.
    """
    prepare_folder(out_dir)
    parts = parts or Parts()
    asked = instances_of(["hairpin"] if quick else list(ROADS), roads)
    efforts = {r: _effort(instance, quick) for r, instance in asked.items()}

    def tell(begin: float, end: float) -> Callable[[str, float], None]:
        return lambda name, share: progress(f"camera sets: {name}", begin + (end - begin) * share)

    found = parts.compute(
        _solve_all,
        {f"{r}, {o}": (asked[r], o, efforts[r], seed) for r in asked for o in OBJECTIVES},
        tell(0.0, 0.5),
    )
    values = [row for each in found for row in each]
    driven = parts.compute(
        _drive_all,
        {
            f"driving {k} cameras along {r}": (
                asked[r], k, _sets_found(values, r, k), efforts[r], seed
            )
            for r in asked
            for k in efforts[r].driven_budgets
        },
        tell(0.5, 0.9),
    )  # fmt: skip
    diminishing = parts.compute(
        _diminishing,
        {
            f"returns along {r}": (asked[r], efforts[r].triples, [seed, n])
            for n, r in enumerate(asked)
        },
        tell(0.9, 1.0),
    )
    closed_loop = pd.DataFrame([row for each in driven for row in each])
    tables = {
        "values": pd.DataFrame(values).drop(columns="selected"),
        "closed_loop": closed_loop,
        "ranks": rank_correlations(closed_loop, list(OBJECTIVES)),
        "diminishing": pd.DataFrame([row for each in diminishing for row in each]),
    }
    write_files(out_dir, study_files(tables, figures.draw(tables)))


def _effort(instance: Instance, quick: bool) -> Effort:
    if quick:
        return QUICK
    return LONG if build_road(instance).length_m > LONG_M else Effort()


def instances_of(names: Sequence[str], roads: Sequence[Path]) -> dict[str, Instance]:
    """Return the named roads of `ROADS` and those of the files `roads`, all with `GRID`."""
    documents: dict[str, dict[str, Any]] = {
        name: {"road": {"pieces": ROADS[name]}} for name in names
    }
    documents |= {
        path.name.split(".")[0].lower(): {"road": {"file": str(path.resolve())}} for path in roads
    }
    return {
        name: instance_from_dict({**document, **GRID, "budget": {"cameras": 20}}, name=name)
        for name, document in documents.items()
    }


def problems_of(scene: Scene) -> dict[str, Problem]:
    """Return the scene's problem with each of `OBJECTIVES` in turn."""
    from placement.assemble import build_objective

    problems = {}
    for name, section in OBJECTIVES.items():
        changed = scene.instance.changed({f"objective.{k}": v for k, v in section.items()})
        objective: Objective = build_objective(changed, scene.journeys)
        problems[name] = replace(scene.problem, objective=objective)
    return problems


def _solve_all(instance: Instance, name: str, effort: Effort, seed: int) -> list[dict[str, Any]]:
    """Optimise one objective along one road by every method for every number of cameras."""
    problem = problems_of(assemble(instance))[name]
    proofs, few = PROOFS.get(name, ((), ()))
    if effort == LONG and name != "localisation":
        proofs = ()
    jobs = [(method, k) for method in METHODS for k in effort.budgets]
    jobs += [(method, k) for method in effort.slow_methods for k in effort.slow_budgets]
    jobs += [(method, k) for method in proofs for k in few if k in effort.slow_budgets]
    rows = []
    for method, k in jobs:
        constraints = replace(problem.constraints, budget=k)
        row = {"road": instance.name, "objective": name, "method": method, "k": k}
        try:
            solution = solve(
                replace(problem, constraints=constraints), method,
                time_limit_s=SAFETY_S if method in proofs else math.inf, seed=seed,
            )  # fmt: skip
        except ValueError as error:  # the method does not know the objective: a row that says so
            rows.append({**row, "status": str(error).split(",")[0], "selected": []})
            continue
        rows.append({**row, **_solution_row(solution)})
    return rows


def _solution_row(solution: Solution) -> dict[str, Any]:
    optimal = solution.status is Status.OPTIMAL  # to a millionth: how near depends on the clock
    return {
        "status": str(solution.status),
        "value": solution.value,
        "bound": solution.value if optimal else solution.bound,
        "gap_percent": 0.0 if optimal else None if solution.gap is None else 100.0 * solution.gap,
        "selected": list(solution.selected) if solution.status.has_placement else [],
    }


Chosen = tuple[str, str, tuple[int, ...]]  # the objective placed for, the method, the cameras


def _sets_found(rows: Sequence[dict[str, Any]], road: str, k: int) -> list[Chosen]:
    """Return what methods found for k cameras along one road."""
    return [
        (row["objective"], row["method"], tuple(row["selected"]))
        for row in rows
        if row["road"] == road and row["k"] == k and row["method"] in DRIVEN and row["selected"]
    ]


def _drive_all(
    instance: Instance, k: int, sets: Sequence[Chosen], effort: Effort, seed: int
) -> list[dict[str, Any]]:
    """Judge sets of k cameras, and as many random ones, by every objective and by driving.

    A set that several methods found, or for several objectives, is driven once; its rows have the
    same number in `set`.
    """
    scene = assemble(instance)
    problems = problems_of(scene)
    rng = np.random.default_rng([seed, k])
    mount = scene.candidates.mount
    loose: list[Chosen] = [
        ("nothing", f"random {n}", _random_set(mount, k, rng)) for n in range(effort.random_sets)
    ]
    judged: dict[tuple[int, ...], dict[str, Any]] = {}
    rows = []
    for objective, method, selected in (*sets, *loose):
        if selected not in judged:
            judged[selected] = _judge(scene, problems, selected, effort.runs, seed)
        row = {"road": instance.name, "placed_for": objective, "method": method, "k": k}
        rows.append(row | {"set": list(judged).index(selected)} | judged[selected])
    return rows


def _diminishing(instance: Instance, triples: int, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Sample diminishing returns of every objective along one road, on the same sets."""
    scene = assemble(instance)
    return [
        {"road": instance.name, "objective": name}
        | diminishing_returns(
            problem.objective, scene.candidates.mount, triples, np.random.default_rng(seeds)
        )
        for name, problem in problems_of(scene).items()
    ]


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
