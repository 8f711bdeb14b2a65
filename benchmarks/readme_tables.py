"""Measure the tables of README.md and write them into it: `python -m benchmarks.readme_tables`.

A table stands between `<!-- table: NAME -->` and `<!-- end -->`; this command replaces what is
between them, so no number in the document is typed by hand.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.documents import markdown, replace_table
from models.geometry import FloatArray
from placement.assemble import Scene, assemble
from placement.instance import Instance, instance_from_dict, load_instance
from placement.solution import Solution
from placement.solve import solve
from placement.validation import validate

README = Path(__file__).resolve().parent.parent / "README.md"
TIME_LIMIT_S = 60.0
RUNS = 200


def norisring_table(data: Path) -> str:
    """Return value, bound, gap and seconds of each method on the Norisring, k = 20."""
    scene = assemble(norisring(data))
    methods = ("greedy", "exchange", "search", "relaxation", "mip", "chain")
    return _solver_table({m: [solve_in(scene, m)] for m in methods}, ["k = 20"])


def winding_table(_data: Path) -> str:
    """Return value and gap of every method on `winding`, k = 10, 20, 40."""
    budgets = (10, 20, 40)
    scenes = [assemble(load_instance("winding").changed({"budget.cameras": k})) for k in budgets]
    methods = ("uniform", "greedy", "exchange", "search", "relaxation", "mip", "chain")
    solutions = {m: [solve_in(scene, m) for scene in scenes] for m in methods}
    return _solver_table(solutions, [f"k = {k}" for k in budgets])


def closed_loop_table(_data: Path) -> str:
    """Return how near the car stays to its lane with `uniform` and with `exchange` on `circuit`."""
    scene = assemble(load_instance("circuit"))
    errors: dict[str, pd.DataFrame] = {}
    rows = []
    for method in ("uniform", "exchange"):
        solution = solve_in(scene, method)
        runs = validate(scene, solution.selected, runs=RUNS, seed=0).rows
        errors[method] = runs[runs["filter"] == "ekf"].set_index("run")
        rows.append(_closed_loop_row(method, errors[method]))
    # Run i has the same noise seed under both placements, so the difference is paired.
    differences = {
        column: (errors["exchange"][column] - errors["uniform"][column]).to_numpy(np.float64)
        for column in ("rms_localisation_error_m", "rms_cross_track_m", "max_cross_track_m")
    }
    rows.append(["exchange − uniform", *(_interval(d) for d in differences.values())])
    header = ["placement", "rms position error (m)", "rms cross-track (m)", "worst cross-track (m)"]
    return markdown(header, rows)


TABLES: Mapping[str, Callable[[Path], str]] = {
    "norisring": norisring_table,
    "winding": winding_table,
    "closed-loop": closed_loop_table,
}


def norisring(data: Path) -> Instance:
    """Return the Norisring, from a file of the user's, with the poses of `winding` and k = 20."""
    document = load_instance("winding").as_dict()
    document["road"] = {"file": str(data / "tracks" / "Norisring.csv")}
    document["mounts"] |= {"spacing_m": 10.0, "side_offset_m": 1.5}
    document["budget"] |= {"cameras": 20}
    return instance_from_dict(document, name="norisring")


def solve_in(scene: Scene, method: str) -> Solution:
    """Solve within the time that these tables allow."""
    return solve(scene.problem, method, time_limit_s=TIME_LIMIT_S, seed=0)


def _solver_table(solutions: Mapping[str, list[Solution]], columns: list[str]) -> str:
    header = ["method", *(f"{c}: value / upper bound / gap / seconds" for c in columns)]
    rows = [[m, *(_cell(s) for s in row)] for m, row in solutions.items()]
    return markdown(header, rows)


def _cell(solution: Solution) -> str:
    bound = "–" if solution.bound is None else f"{solution.bound:.3f}"
    gap = "–" if solution.gap is None else _percent(solution.gap)
    proven = " **optimal**" if solution.status == "optimal" else ""
    return f"{solution.value:.3f} / {bound} / {gap} / {solution.seconds:.1f}{proven}"


def _percent(share: float) -> str:
    return "0 %" if share <= 1e-9 else f"{100 * share:.3g} %"


def _closed_loop_row(method: str, runs: pd.DataFrame) -> list[str]:
    columns = ("rms_localisation_error_m", "rms_cross_track_m", "max_cross_track_m")
    return [method, *(f"{runs[c].mean():.4f}" for c in columns)]


def _interval(differences: FloatArray) -> str:
    """Return the mean of paired differences with its 95 % bootstrap interval."""
    rng = np.random.default_rng(0)
    draws = rng.choice(differences, size=(10_000, len(differences))).mean(axis=1)
    low, high = np.quantile(draws, (0.025, 0.975))
    return f"{differences.mean():+.4f} [{low:+.4f}, {high:+.4f}]"


def main() -> None:
    """Measure the tables that are asked for, all by default, and write them into README.md."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("tables", nargs="*", default=list(TABLES), help=f"of {', '.join(TABLES)}")
    parser.add_argument("--data", type=Path, default=README.parent.parent / "shared" / "data")
    arguments = parser.parse_args()
    for name in arguments.tables:
        table = TABLES[name](arguments.data)
        README.write_text(replace_table(README.read_text("utf-8"), name, table), "utf-8")
        sys.stdout.write(f"{name}\n{table}\n\n")


if __name__ == "__main__":
    main()
