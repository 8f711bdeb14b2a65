"""`results.csv`: one row for each instance, solver and seed, with the seconds of every repeat.

Repeats of one seed must give one value; where they do not, the row says so. All columns but those
of `TIMES` are the same in every run with the same seeds, unless a time limit cut it short.
"""

from __future__ import annotations

import csv
import io
import json
import statistics
from collections.abc import Iterable, Mapping
from typing import Any

COLUMNS = (
    "suite",
    "instance",
    "kind",
    "objective",
    "sense",
    "candidates",
    "budget",
    "solver",
    "seed",
    "status",
    "value",
    "bound",
    "gap",
    "verified",
    "evaluations",
    "nodes",
    "seconds",
    "seconds_median",
    "cpu_seconds",
    "peak_memory_mb",
    "build_s",
    "time_limit_s",
    "note",
    "selected",
    "instance_sha256",
    "versions",
    "machine",
)
# What differs from run to run.
TIMES = ("seconds", "seconds_median", "cpu_seconds", "peak_memory_mb", "build_s")


def merge_repeats(suite: str, rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return one row for each (instance, solver, seed), in the order they first come."""
    groups: dict[tuple[str, str, int], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault((row["instance"], row["solver"], row["seed"]), []).append(row)
    return [_merged(suite, group) for group in groups.values()]


def to_csv(rows: Iterable[Mapping[str, Any]]) -> str:
    """Write the rows as CSV; lists and tables as JSON without spaces."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        writer.writerow([_cell(row.get(column)) for column in COLUMNS])
    return stream.getvalue()


def _merged(suite: str, group: list[Mapping[str, Any]]) -> dict[str, Any]:
    # A repeat that failed is the one to show: what works sometimes does not work.
    shown = next((row for row in group if row.get("value") is None), group[0])
    row: dict[str, Any] = {"suite": suite, **shown}
    seconds = [r["seconds"] for r in group if r.get("seconds") is not None]
    row["seconds"] = [round(s, 6) for s in seconds]
    row["seconds_median"] = statistics.median(seconds) if seconds else None
    spent = [r["cpu_seconds"] for r in group if r.get("cpu_seconds") is not None]
    row["cpu_seconds"] = statistics.median(spent) if spent else None
    memory = [r["peak_memory_mb"] for r in group if r.get("peak_memory_mb") is not None]
    row["peak_memory_mb"] = max(memory) if memory else None
    row["instance_sha256"] = row.get("sha256")
    values = [r.get("value") for r in group]
    if any(not _alike(value, values[0]) for value in values):
        words = ", ".join(sorted({str(value) for value in values}))
        row["note"] = f"repeats differ: {words}; {row.get('note') or ''}"
    return row


def _alike(a: float | None, b: float | None) -> bool:
    """Whether two repeats agree, to what the order of a sum may change."""
    if a is None or b is None:
        return a is b
    return abs(a - b) <= 1e-12 * abs(b)


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, list | tuple):
        return " ".join(str(item) for item in value)
    if isinstance(value, Mapping):
        return json.dumps(dict(value), separators=(",", ":"), sort_keys=True)
    return str(value)
