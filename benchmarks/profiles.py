"""Where the time goes: `python -m benchmarks.profiles` profiles every method and prints shares.

Each method runs once to compile and once under cProfile, on an instance it is made for. Shares are
of the time spent in functions themselves, by module; a compiled kernel counts for the module
that calls it by name. Between the marks of docs/benchmarks.md stands the same table.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.documents import markdown, replace_table
from benchmarks.instances.library import LIBRARY
from benchmarks.runner.subjects import Case, load_subject
from placement.problem import Problem
from placement.solve import solve

ROOT = Path(__file__).resolve().parent.parent
DOCUMENT = ROOT / "docs" / "benchmarks.md"
TIME_LIMIT_S = 20.0
SHOWN = 5

MILLION: Mapping[str, object] = {
    "candidates": 1_000_000,
    "samples": 200_000,
    "window": 20,
    "budget": 300,
    "seed": 0,
}
# Which method is looked at on which instance.
PROFILED: Sequence[tuple[str, str]] = (
    ("greedy", "winding"),
    ("greedy", "sparse-million"),
    ("greedy", "dense-2000"),
    ("exchange", "winding"),
    ("search", "s-bend"),
    ("relaxation", "s-bend"),
    ("mip", "s-bend"),
    ("mip", "winding-seen-once"),
    ("chain", "winding"),
    ("tempered", "entropy-car"),
    ("diagram", "trace-robot"),
    ("search", "trace-car"),
    ("branch", "gauss-10-100"),
)


def shares(problem: Problem, method: str) -> tuple[float, list[tuple[str, float]]]:
    """Return the processor seconds of one solve, and the share of each module, largest first."""
    solve(problem, method, time_limit_s=TIME_LIMIT_S)
    profile = cProfile.Profile(time.process_time)  # others on the machine do not count
    profile.enable()
    solve(problem, method, time_limit_s=TIME_LIMIT_S)
    profile.disable()
    own: dict[str, float] = {}
    for (file, _line, function), row in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        name = _module(file, function)
        own[name] = own.get(name, 0.0) + row[2]
    total = sum(own.values())
    ranked = sorted(((name, seconds / total) for name, seconds in own.items()), key=lambda p: -p[1])
    return total, ranked


def _module(file: str, function: str) -> str:
    """Name what a profiled function belongs to: our module, or the library."""
    path = Path(file)
    if path.is_relative_to(ROOT) and ".venv" not in path.parts:
        return ".".join(path.relative_to(ROOT).with_suffix("").parts[1:])
    for library in ("highspy", "clarabel", "cvxpy", "scipy", "numpy", "pandas", "numba"):
        if library in path.parts or library in function:
            return library
    return "built in" if file == "~" else "others"


def problem_of(name: str) -> Problem:
    """Return the problem of an instance of `PROFILED`."""
    if name == "sparse-million":
        return load_subject(Case(name, "synthetic", MILLION)).problem
    if name.endswith("-seen-once"):
        spec = {**LIBRARY[name.removesuffix("-seen-once")].case().spec, "times": 1}
        return load_subject(Case(name, "coverage", spec)).problem
    return load_subject(LIBRARY[name].case()).problem


def table() -> str:
    """Profile everything and return the table in Markdown."""
    rows = []
    for method, name in PROFILED:
        seconds, ranked = shares(problem_of(name), method)
        parts = ", ".join(f"{module} {100 * share:.0f} %" for module, share in ranked[:SHOWN])
        rows.append([f"`{method}`", f"`{name}`", f"{seconds:.2f}", parts])
        sys.stdout.write(f"{method:10} {name:18} {seconds:8.2f} s  {parts}\n")
        sys.stdout.flush()
    return markdown(["method", "instance", "processor seconds, profiled", "where"], rows)


def main() -> None:
    """Print the shares, and with --write put them into the document."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--write", action="store_true", help="into docs/benchmarks.md")
    write = parser.parse_args().write
    text = table()
    if write:
        DOCUMENT.write_text(
            replace_table(DOCUMENT.read_text(encoding="utf-8"), "profiles", text),
            encoding="utf-8",
        )


if __name__ == "__main__":
    main()
