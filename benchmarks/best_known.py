"""`benchmarks/instances/best_known.csv`: the best value and bound of each instance, and whose.

`python -m benchmarks.best_known RESULTS.csv …` merges results of `placement benchmark` into it: a
better value replaces the value, a tighter bound the bound, nothing else does. Only rows that the
referee has verified count, and a bound counts only if it is one of this project's methods', which
are certified; others post theirs by `benchmarks.post` (docs/instances.md).
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

from benchmarks.instances.library import BEST_KNOWN, LIBRARY
from placement.atomic import write_files
from placement.solve import METHODS

BETTER = 1e-9  # relative: less is the order of a sum


@dataclass(frozen=True, slots=True)
class Best:
    """One row: what is known of an instance. Empty strings where nothing is."""

    instance: str
    source: str
    difficulty: str
    objective: str
    sense: str
    candidates: str
    budget: str
    value: str
    bound: str
    gap: str
    value_by: str
    bound_by: str
    reproduce: str
    selected: str
    instance_sha256: str


def read_best(path: Path = BEST_KNOWN) -> dict[str, Best]:
    """Read the table by instance name; empty if there is none yet."""
    if not path.is_file():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {row["instance"]: Best(**row) for row in csv.DictReader(file)}


def merged(known: Mapping[str, Best], rows: Iterable[Mapping[str, str]]) -> dict[str, Best]:
    """Return the table with what is better in `rows` (of `results.csv`)."""
    best = dict(known)
    for row in rows:
        name = row["instance"]
        if name in LIBRARY and row["value"] and row["verified"] == "yes":
            best[name] = _improved(best.get(name), row)
    return {name: best[name] for name in LIBRARY if name in best}


def to_csv(best: Mapping[str, Best]) -> str:
    """Write the table in the library's order."""
    stream = io.StringIO()
    names = [field.name for field in fields(Best)]
    writer = csv.DictWriter(stream, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in best.values())
    return stream.getvalue()


def _improved(known: Best | None, row: Mapping[str, str]) -> Best:
    entry = LIBRARY[row["instance"]]
    if known is not None and known.instance_sha256 != row["instance_sha256"]:
        known = None  # another instance by that name
    found = known or Best(
        instance=entry.name,
        source=entry.source,
        difficulty=str(entry.difficulty),
        objective=row["objective"],
        sense=row["sense"],
        candidates=row["candidates"],
        budget=row["budget"],
        value="",
        bound="",
        gap="",
        value_by="",
        bound_by="",
        reproduce="",
        selected="",
        instance_sha256=row["instance_sha256"],
    )
    found = replace(found, difficulty=str(entry.difficulty))
    sign = 1.0 if row["sense"] == "max" else -1.0
    value = float(row["value"])
    # Of equal values the first stays: who came later has found nothing new.
    if not found.value or sign * (value - float(found.value)) > BETTER * abs(value):
        found = replace(
            found,
            value=row["value"],
            value_by=row["solver"],
            selected=row["selected"],
            reproduce=_command(entry.name, row),
        )
    if row["bound"] and row["solver"] in METHODS and row["status"] != "wrong_bound":
        bound = float(row["bound"])
        closer = not found.bound or sign * (float(found.bound) - bound) > BETTER * abs(bound)
        if closer:
            found = replace(found, bound=row["bound"], bound_by=row["solver"])
    return replace(found, gap=_gap(found))


def _gap(row: Best) -> str:
    if not row.bound or not float(row.value):
        return ""
    return f"{abs(float(row.bound) - float(row.value)) / abs(float(row.value)):.3g}"


def _command(name: str, row: Mapping[str, str]) -> str:
    data = " --data DATA" if LIBRARY[name].source == "real" else ""
    limit = f"{float(row['time_limit_s']):g}"
    return (
        f"placement benchmark {row['suite']} --instance {name} --solver {row['solver']} "
        f"--seed {row['seed']} --time-limit {limit}{data} --out out/{name}"
    )


def main() -> None:
    """Merge result files into the table of best known values."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("results", nargs="+", type=Path, help="results.csv of placement benchmark")
    best = read_best()
    csv.field_size_limit(10_000_000)
    for path in parser.parse_args().results:
        with path.open(encoding="utf-8", newline="") as file:
            best = merged(best, csv.DictReader(file))
    write_files(BEST_KNOWN.parent, {BEST_KNOWN.name: to_csv(best)})
    proven = sum(bool(row.gap) and float(row.gap) <= 1e-6 for row in best.values())
    missing = [name for name in LIBRARY if name not in best]
    sys.stdout.write(
        f"{len(best)} of {len(LIBRARY)} instances, {proven} proven"
        f"{'; missing ' + ', '.join(missing) if missing else ''}\n"
    )


if __name__ == "__main__":
    main()
