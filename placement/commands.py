"""What the command line's verbs do, from an instance to files in a folder."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

from placement.atomic import Content, prepare_folder, prepared_folder, write_files
from placement.cluster import working
from placement.instance import load_instance
from placement.interrupts import held_back, stop_on_request
from placement.solution import Solution, Status

if TYPE_CHECKING:
    from placement.assemble import Scene
    from placement.budget_curve import BudgetCurve
    from placement.construction import Choice
    from placement.prediction import Prediction
    from placement.validation import Validation

# What a new solution must not stand beside, if it is not written anew.
LEFT_BEHIND = (
    "placements.csv",
    "along_path.csv",
    "validation.csv",
    "validation_summary.json",
    "verification.json",
    "budget_curve.csv",
    "budget_curve.png",
    "budget_curve.svg",
    "consistency.png",
    "consistency.svg",
    "map.png",
    "cameras.geojson",
    "cameras.add.xml",
    "bill_of_materials.csv",
    "coverage.png",
    "coverage.svg",
    "map.svg",
    "index.html",
    "problem.npz",
    "pareto.csv",
    "pareto.png",
    "pareto.svg",
)
# Where `solve` keeps what is done of a city's information until its solution is written.
INFORMATION = "information"
# Endings of bare information problems, and of tables of experiments.
BARE = (".npz", ".csv", ".tsv", ".txt", ".dat")


@dataclass(frozen=True, slots=True)
class Result:
    """A solution in its scene, with what is predicted of it and, once driven, what happened.

    This is what every entry point of the group `placement.figures` is given; each returns
    files (name → content) to lie beside the solution's own. `by_budget` holds the placements of a
    budget curve, by their number of cameras, where there is one.
    """

    scene: Scene
    solution: Solution
    prediction: Prediction
    validation: Validation | None = None
    by_budget: Mapping[int, tuple[int, ...]] = field(default_factory=dict)


def solve_into(
    out: Path,
    source: str,
    *,
    method: str = "auto",
    objective: str | None = None,
    budget: str | None = None,
    time_limit_s: float = float("inf"),
    seed: int = 0,
    workers: int | None = None,
    cluster: str | None = None,
    quiet: bool = False,
) -> Solution:
    """Solve the instance `source` (a TOML file or a shipped name) and write the results to `out`.

    A bare information problem (.npz, or a table of experiments) goes to `placement.bare`.

    A `budget` A:B solves every budget from A to B: the folder holds the solution of the last, and
    the curve of all. `workers` and `cluster` say where work runs (`placement.cluster`). Until the
    solution is written, `out/information` holds what is done of a city's information, so that the
    same command goes on after a stop.

    Raises:
        ValueError: for bad input; nothing is written then.
    """
    from placement.watch import watch

    if Path(source).suffix.lower() in BARE:
        from placement.bare import solve_bare_into

        return solve_bare_into(
            out, source, method=method, objective=objective, budget=budget,
            time_limit_s=time_limit_s, seed=seed, quiet=quiet,
            stale=("instance.json", *LEFT_BEHIND),
        )  # fmt: skip
    changes: dict[str, Any] = {}
    if objective is not None:
        changes["objective.kind"] = objective
    budgets: tuple[int, int] | None = None
    if budget is not None:
        if ":" in budget:
            from placement.budget_curve import parse_budgets

            budgets = parse_budgets(budget)
        changes["budget.cameras"] = _count(budget) if budgets is None else budgets[1]
    instance = load_instance(source)
    if changes:
        instance = instance.changed(changes)
    with held_back():
        from placement.assemble import assemble
        from placement.prediction import predict
        from placement.solve import check_call, solve

    check_call(method, time_limit_s, seed)
    with prepared_folder(out), working(workers, cluster) as work, watch(quiet) as report:
        report(f"computing the information of {instance.name}", None)
        curve: dict[str, Content] = {}
        interrupted: Solution | None = None
        took: str | None = None
        if instance.road.constructed is not None and instance.road.constructed.pieces is None:
            from placement.construction import choose_road

            choice = choose_road(
                instance, method, time_limit_s=time_limit_s, seed=seed, progress=report
            )
            instance, curve = choice.instance, _front_files(choice)
            interrupted = choice.so_far()
        scene = assemble(instance, work, keep=out / INFORMATION, progress=report)
        with stop_on_request():  # what was found is written, whenever Ctrl-C comes
            if interrupted is not None:
                solution = interrupted
            elif budgets is None:
                solution = solve(
                    scene.problem,
                    method,
                    time_limit_s=time_limit_s,
                    seed=seed,
                    progress=report,
                    work=work,
                )
            else:
                from placement.budget_curve import budget_curve

                started = time.monotonic()
                found = budget_curve(
                    scene.problem,
                    *budgets,
                    method,
                    time_limit_s=time_limit_s,
                    seed=seed,
                    progress=report,
                )
                seconds = time.monotonic() - started
                took = f"{seconds:.1f} s for the budgets {budgets[0]} to {budgets[1]}"
                solution, curve = found.solutions[-1], {**curve, **_curve_files(found)}
            report("writing", None)
            prediction = None
            if solution.status.has_placement:
                prediction = predict(scene, solution.selected)
            _write_solution(out, scene, solution, prediction, curve)
        if solution.status is not Status.TIME_LIMIT:  # the same command may go on from there
            shutil.rmtree(out / INFORMATION, ignore_errors=True)
        if prediction is not None:
            _write_figures(out, Result(scene, solution, prediction))
    if not quiet:
        from placement.output import solution_lines

        _say(solution_lines(solution, f"{len(solution.selected)} cameras", out, took=took))
    return solution


def validate_in(
    folder: Path,
    *,
    runs: int,
    seed: int,
    plant: str = "kinematic",
    latency_s: float = 0.0,
    missed: float = 0.0,
    false: float = 0.0,
    workers: int | None = None,
    cluster: str | None = None,
    quiet: bool = False,
) -> None:
    """Drive the placement in `folder` in a closed loop and add what happened to the folder.

    `latency_s`, `missed`, `false`: as in `models.simulation.Settings`; `workers`, `cluster`: where
    the drives are computed.

    Raises:
        ValueError: for bad input; nothing is written then.
    """
    from placement.output import read_folder, validation_files
    from placement.watch import watch

    stored = read_folder(folder)
    prepare_folder(folder)
    with working(workers, cluster) as work, watch(quiet) as report:
        report(f"assembling {stored.instance.name}", None)
        from placement.assemble import assemble
        from placement.prediction import predict
        from placement.roadway import nobody_drives
        from placement.validation import NO_DRIVES, validate

        if nobody_drives(stored.instance):  # said now, not when a city's information is there
            raise ValueError(NO_DRIVES)
        scene = assemble(stored.instance, work)
        solution = stored.solution(scene.problem)
        started = time.monotonic()
        validation = validate(
            scene,
            solution.selected,
            runs=runs,
            seed=seed,
            plant=plant,
            latency_s=latency_s,
            missed=missed,
            false=false,
            progress=report,
            work=work,
        )
        seconds = time.monotonic() - started
        report("writing", None)
        prediction = predict(scene, solution.selected)
        write_files(folder, validation_files(validation))
        _write_figures(folder, Result(scene, solution, prediction, validation))
    if not quiet:
        _say(_validation_lines(validation, runs, seconds, folder))


def verify_in(folder: Path, *, quiet: bool = False) -> bool:
    """Let the referee check `folder`, record what it found there, and return whether all holds.

    Raises:
        ValueError: for bad input; nothing is written then.
    """
    from placement.output import to_json
    from placement.verify import verify_folder
    from placement.watch import watch

    with watch(quiet) as report:
        verification = verify_folder(folder, report)
    write_files(folder, {"verification.json": to_json(verification.record())})
    if not quiet:
        _say([verification.summary()])
    return verification.passed


def _write_solution(
    folder: Path,
    scene: Scene,
    solution: Solution,
    prediction: Prediction | None,
    more: Mapping[str, Content],
) -> None:
    """Write the files of a new solution in one go, and remove what an older one left.

    The figures take seconds: a placement that took an hour is safe before the first is drawn.
    """
    from placement.output import left_behind, solution_files

    files = {**more, **solution_files(scene, solution, prediction)}
    write_files(folder, files, remove=left_behind(folder, LEFT_BEHIND, files))


def _write_figures(folder: Path, result: Result) -> None:
    """Write what other rooms draw of a result."""
    from placement.output import placements_by_budget

    n, selected = result.scene.problem.constraints.n, result.solution.selected
    curve = placements_by_budget(folder, n, selected)
    result = replace(result, by_budget=curve)
    figures: dict[str, Content] = {}
    for entry in sorted(entry_points(group="placement.figures"), key=lambda e: e.name):
        draw: Callable[[Result], dict[str, Content]] = entry.load()
        figures |= draw(result)
    write_files(folder, figures)


def _curve_files(curve: BudgetCurve) -> dict[str, Content]:
    """Lay out the curve: its table, and what the group `placement.curves` draws of it."""
    from placement.output import to_csv

    files: dict[str, Content] = {"budget_curve.csv": to_csv(curve.table())}
    if all(solution.status.has_placement for solution in curve.solutions):
        for entry in sorted(entry_points(group="placement.curves"), key=lambda e: e.name):
            draw: Callable[[BudgetCurve], dict[str, Content]] = entry.load()
            files |= draw(curve)
    return files


def _front_files(choice: Choice) -> dict[str, Content]:
    """Lay out the roads to choose from: their table, and what `placement.fronts` draws of them."""
    from placement.output import to_csv

    files: dict[str, Content] = {"pareto.csv": to_csv(choice.table())}
    for entry in sorted(entry_points(group="placement.fronts"), key=lambda e: e.name):
        draw: Callable[[Choice], dict[str, Content]] = entry.load()
        files |= draw(choice)
    return files


def _count(budget: str) -> int:
    try:
        return int(budget)
    except ValueError:
        raise ValueError(f"--budget must be a whole number of cameras, got {budget}") from None


def _say(lines: list[str]) -> None:
    for line in lines:
        sys.stdout.write(line + "\n")


def _validation_lines(validation: Validation, runs: int, seconds: float, folder: Path) -> list[str]:
    drives = validation.summary.get("drives", [])
    each = f" of each of {len(drives)} drives" if drives else ""
    first = f"; of the first, {drives[0]['drive']}:" if drives else ""
    lines = [f"{runs} closed-loop runs{each} in {seconds:.1f} s; results in {folder}{first}"]
    for name, row in validation.summary["filters"].items():
        lines.append(
            f"{name}: rms error {row['simulated_rms_m']:.3f} m (predicted "
            f"{row['predicted_rms_m']:.3f}), cross-track {row['cross_track_rms_m']:.3f} m, "
            f"in tolerance {100 * row['lateral_within_tolerance']:.1f} %"
        )
    return lines
