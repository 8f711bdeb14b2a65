"""The CSV files of a solution folder, as the referee reads them: nothing in them is believed."""

from __future__ import annotations

import csv
import math
from pathlib import Path


def read_csv(path: Path) -> list[dict[str, str]]:
    """Read the rows of a table, each by the header's names; ValueError where it cannot be."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or "not a table of text"
        raise ValueError(f"{path}: cannot be read ({reason})") from None
    for n, row in enumerate(rows):
        if None in row or None in row.values():
            raise ValueError(f"{path}: row {n} must have as many fields as the header")
    return rows


def number(text: str | None) -> float:
    """Return the number that a field holds, NaN where it holds none."""
    try:
        return float(text) if text is not None else float("nan")
    except ValueError:
        return float("nan")


def maybe(text: str) -> float | str:
    """Return the number that a field holds, or the field where it holds none."""
    found = number(text)
    return text if math.isnan(found) else found


def whole(text: str) -> int | str:
    """Return the whole number that a field holds, or the field where it holds none."""
    try:
        return int(text)
    except ValueError:
        return text
