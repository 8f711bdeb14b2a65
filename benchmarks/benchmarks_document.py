"""Write the tables of docs/benchmarks.md from what `placement benchmark` left behind.

`python -m benchmarks.benchmarks_document OUT` reads OUT/SUITE/results.csv of every suite that is
there; with --measure each suite is run into OUT first (hours), or goes on where it stopped.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from pathlib import Path
from typing import Any

from benchmarks.documents import replace_table
from benchmarks.runner.commands import run_and_write
from benchmarks.runner.suites import SUITES, make_suite
from benchmarks.runner.summary import instances_markdown, solvers_markdown
from placement.atomic import prepare_folder, write_files
from placement.watch import watch

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "benchmarks.md"
NUMBERS = ("value", "bound", "gap", "seconds_median", "cpu_seconds", "peak_memory_mb", "candidates")


def main() -> None:
    """Fill the tables of the suites that were measured."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("out", type=Path, help="the folder that holds a folder a suite")
    parser.add_argument("--measure", action="store_true", help="run every suite first")
    parser.add_argument("--data", help="where your roads lie")
    parser.add_argument("--suite", action="append", choices=list(SUITES), help="only this one")
    parser.add_argument("--time-limit", type=float, help="seconds a job, else each suite's own")
    given = parser.parse_args()
    names = given.suite or list(SUITES)
    if given.measure:
        for name in names:
            prepare_folder(given.out / name)
            suite = make_suite(name, given.data).changed(time_limit_s=given.time_limit)
            with watch() as report:
                run_and_write(suite, given.out / name, report)
    text = DOCUMENT.read_text(encoding="utf-8")
    for name in names:
        path = given.out / name / "results.csv"
        if path.is_file() and f"<!-- table: {name} -->" in text:
            text = replace_table(text, name, suite_tables(read_results(path)))
            sys.stdout.write(f"{name}\n")
    write_files(DOCUMENT.parent, {DOCUMENT.name: text})


def read_results(path: Path) -> list[dict[str, Any]]:
    """Read `results.csv` with numbers as numbers and yes as True."""
    csv.field_size_limit(10_000_000)
    with path.open(encoding="utf-8", newline="") as file:
        rows: list[dict[str, Any]] = [dict(row) for row in csv.DictReader(file)]
    for row in rows:
        for column in NUMBERS:
            row[column] = float(row[column]) if row[column] else None
        row["verified"] = row["verified"] == "yes"
        row["machine"] = json.loads(row["machine"])
    return rows


def suite_tables(rows: list[dict[str, Any]]) -> str:
    """Return how the suite was run, the table of solvers and that of instances."""
    seconds = sorted({float(row["time_limit_s"]) for row in rows})
    limits = ", ".join(f"{limit:g}" for limit in seconds)
    machine = rows[0]["machine"]
    repeats = max(len(str(row["seconds"]).split()) for row in rows)
    seeds = len({row["seed"] for row in rows})
    counted = ", ".join(
        f"{n} {what}{'' if n == 1 else 's'}" for n, what in ((seeds, "seed"), (repeats, "repeat"))
    )
    how = f"{limits} s a job, {counted}; {machine['processor']}, one thread each."
    return "\n\n".join([how, solvers_markdown(rows), instances_markdown(rows)])


if __name__ == "__main__":
    main()
