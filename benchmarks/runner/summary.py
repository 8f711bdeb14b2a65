"""What a run comes to: a table an instance and a table of solvers, as CSV and as Markdown.

Columns of `summary.csv`: solver, rows, solved (with a verified value), best (values within 1e-6 of
the best of the run), proven (gap at most 1e-6), the median gap to the best value, the median gap
it proves itself, and the geometric mean of its seconds over the fastest solver's that reached the
best value. Seconds are of one processor: what else the machine did does not count.
"""

from __future__ import annotations

import csv
import io
import math
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.documents import markdown
from placement.solution import OPTIMAL_GAP

Row = Mapping[str, Any]
SHORTEST_S = 1e-4  # less is the clock's own step
SAME = 1e-6  # values this near (relative) are one value
WORDS = {
    "cannot_say": "cannot say",
    "not_installed": "not installed",
    "no_data": "no data",
    "broken_rules": "breaks the rules",
    "wrong_bound": "wrong bound",
}


def solved(row: Row) -> bool:
    """Whether a row has a value that the referee confirms."""
    return row.get("value") is not None and bool(row.get("verified"))


def best_values(rows: Sequence[Row]) -> dict[str, float]:
    """Return the best verified value of each instance."""
    best: dict[str, float] = {}
    for row in rows:
        if solved(row):
            sign = 1.0 if row["sense"] == "max" else -1.0
            value, name = float(row["value"]), str(row["instance"])
            if name not in best or sign * value > sign * best[name]:
                best[name] = value
    return best


def seconds_of(row: Row) -> float:
    """Return the processor seconds of a row (median of its repeats), by the clock if not known."""
    spent = row.get("cpu_seconds")
    return max(float(row["seconds_median"] if spent is None else spent), SHORTEST_S)


def behind(row: Row, best: Mapping[str, float]) -> float:
    """Return how far, relative, a row's value is from the best; infinite without a value."""
    if not solved(row):
        return math.inf
    target = best[str(row["instance"])]
    distance = abs(float(row["value"]) - target)
    return distance / abs(target) if target else (math.inf if distance else 0.0)


def solver_table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the columns of `summary.csv`, a row a solver, in the order they first come."""
    best = best_values(rows)
    fastest: dict[str, float] = {}
    for row in rows:
        if behind(row, best) <= SAME and row["seconds_median"] is not None:
            name = str(row["instance"])
            fastest[name] = min(fastest.get(name, math.inf), seconds_of(row))
    table = []
    for solver in dict.fromkeys(str(row["solver"]) for row in rows):
        own = [row for row in rows if row["solver"] == solver]
        good = [row for row in own if solved(row)]
        at_best = [row for row in good if behind(row, best) <= SAME]
        gaps = [float(row["gap"]) for row in good if row.get("gap") is not None]
        ratios = [seconds_of(row) / fastest[str(row["instance"])] for row in at_best]
        table.append(
            {
                "solver": solver,
                "rows": len(own),
                "solved": len(good),
                "best": len(at_best),
                "proven": sum(
                    row.get("gap") is not None
                    and float(row["gap"]) <= OPTIMAL_GAP
                    and row["status"] != "wrong_bound"
                    for row in good
                ),
                "median_behind": _median([behind(row, best) for row in good]),
                "median_gap": _median(gaps),
                "slower_than_fastest": _geometric(ratios),
            }
        )
    return table


def summary_csv(rows: Sequence[Row]) -> str:
    """Write `solver_table` as CSV."""
    table = solver_table(rows)
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(table[0]) if table else ["solver"], lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        {k: "" if v is None else f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()}
        for row in table
    )
    return stream.getvalue()


def summary_markdown(name: str, about: str, rows: Sequence[Row]) -> str:
    """Write both tables in Markdown."""
    limit = rows[0]["time_limit_s"] if rows else 0.0
    unverified = sum(row.get("value") is not None and not row.get("verified") for row in rows)
    lines = [
        f"# Suite {name}",
        "",
        f"{about}; {limit:g} s a job, each in a process of its own. Every value below was computed "
        f"again by the referee; it denied {unverified}.",
        "",
        solvers_markdown(rows),
        "",
        instances_markdown(rows),
    ]
    return "\n".join(lines) + "\n"


def solvers_markdown(rows: Sequence[Row]) -> str:
    """Return the table of solvers in Markdown."""
    header = [
        "solver",
        "rows",
        "solved",
        "best value",
        "proven",
        "behind the best (median)",
        "own gap (median)",
        "seconds over the fastest",
    ]
    body = [
        [
            f"`{row['solver']}`",
            str(row["rows"]),
            str(row["solved"]),
            str(row["best"]),
            str(row["proven"]),
            percent(row["median_behind"]),
            percent(row["median_gap"]),
            "–" if row["slower_than_fastest"] is None else f"{row['slower_than_fastest']:.3g}×",
        ]
        for row in solver_table(rows)
    ]
    return markdown(header, body)


def instances_markdown(rows: Sequence[Row]) -> str:
    """Return value, gap and seconds of every solver on every instance, a row an instance."""
    solvers = list(dict.fromkeys(str(row["solver"]) for row in rows))
    best = best_values(rows)
    body = []
    for name in dict.fromkeys(str(row["instance"]) for row in rows):
        cells = []
        for solver in solvers:
            own = [r for r in rows if r["instance"] == name and r["solver"] == solver]
            cells.append(_cell(own, best) if own else "")
        body.append([f"`{name}`", *cells])
    return markdown(["value, gap, seconds", *(f"`{s}`" for s in solvers)], body)


def percent(share: float | None) -> str:
    """Return a share as per cent: 0 where it is nothing, a dash where there is none."""
    if share is None or not math.isfinite(share):
        return "–"
    return "0" if share <= 1e-9 else f"{100.0 * share:.2g} %"


def _cell(own: Sequence[Row], best: Mapping[str, float]) -> str:
    """Return the cell of one solver on one instance; the first seed stands for all."""
    row = own[0]
    if row.get("value") is None:
        return WORDS.get(str(row["status"]), str(row["status"]).replace("_", " "))
    if not row.get("verified"):
        return "**not verified**"
    value = f"{float(row['value']):.6g}"
    value = f"**{value}**" if behind(row, best) <= SAME else value
    gap = "no bound" if row.get("gap") is None else percent(float(row["gap"]))
    if row["status"] == "wrong_bound":
        gap = "wrong bound"
    return f"{value}, {gap}, {seconds_of(row):.3g} s"


def _median(values: Sequence[float]) -> float | None:
    finite = [v for v in values if math.isfinite(v)]
    return statistics.median(finite) if finite else None


def _geometric(values: Sequence[float]) -> float | None:
    return math.exp(statistics.fmean(map(math.log, values))) if values else None
