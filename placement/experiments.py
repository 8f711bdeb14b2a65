"""Tables of experiments: a row an experiment, numbers between commas, semicolons, tabs or spaces.

The commonest public form of a design problem: row f adds f fᵀ to the information. A header may
name the columns; `cost` and `group` are then what an experiment costs and which it excludes (one
of each group at most, −1 for none), and every other column is part of f. A first line that is no
numbers, or any that begins with '#', is a header or a remark.
"""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.information_problem import InformationProblem

PRIOR = 1e-6  # what is known of every direction before any experiment: next to nothing
_ASIDE = ("cost", "group")


@dataclass(frozen=True, slots=True)
class Experiments:
    """Rank-one factors (c, n, 1), and where the table has them costs (c,) and groups (c,)."""

    factors: FloatArray
    cost: FloatArray | None = None
    group: IntArray | None = None

    def problem(
        self, budget: float, name: str = "experiments", prior: float = PRIOR
    ) -> InformationProblem:
        """Return the design problem with the prior `prior`·I."""
        n = self.factors.shape[1]
        return InformationProblem(
            prior * np.eye(n), self.factors, budget, self.cost, self.group, name=name
        )


def read_table(path: str | Path) -> Experiments:
    """Read a table of experiments.

    Raises:
        ValueError: one line naming the file and the line at fault.
    """
    path = Path(path)
    names: list[str] | None = None
    rows: list[list[float]] = []
    for number, line in enumerate(_lines(path), start=1):
        text = line.strip()
        if not text or text.startswith("#"):
            continue
        cells = _cells(text)
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            if names is None and not rows:
                names = [cell.strip().strip('"').lower() for cell in cells]
                continue
            raise ValueError(f"{path}:{number}: wanted numbers, got {text[:40]!r}") from None
        wanted = len(rows[0]) if rows else len(names) if names is not None else len(row)
        if len(row) != wanted:
            raise ValueError(f"{path}:{number}: wanted {wanted} numbers, got {len(row)}")
        if not all(map(math.isfinite, row)):
            raise ValueError(f"{path}:{number}: wanted finite numbers, got {text[:40]!r}")
        rows.append(row)
    if not rows:
        raise ValueError(f"{path}: holds no experiments")
    table = np.array(rows)
    names = [""] * table.shape[1] if names is None else names
    aside = {name: names.index(name) for name in _ASIDE if name in names}
    inside = [a for a in range(table.shape[1]) if a not in aside.values()]
    if not inside:
        raise ValueError(f"{path}: holds costs and groups but no experiments")
    group = table[:, aside["group"]] if "group" in aside else None
    if group is not None and np.any(group != np.round(group)):
        raise ValueError(f"{path}: group must hold whole numbers")
    return Experiments(
        table[:, inside][:, :, None],
        table[:, aside["cost"]] if "cost" in aside else None,
        None if group is None else group.astype(np.int64),
    )


def write_table(path: str | Path, experiments: Experiments) -> None:
    """Write a table of experiments with a header, in digits that read back exactly.

    Raises:
        ValueError: for factors of a rank other than one, which no row can hold.
    """
    c, n, r = experiments.factors.shape
    if r != 1:
        raise ValueError(f"factors must have rank 1 to be rows of a table, got rank {r}")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    extra = [
        (name, column)
        for name, column in (("cost", experiments.cost), ("group", experiments.group))
        if column is not None
    ]
    writer.writerow([*(f"f{a}" for a in range(n)), *(name for name, _ in extra)])
    for i in range(c):
        row = [repr(float(value)) for value in experiments.factors[i, :, 0]]
        writer.writerow([*row, *(repr(column[i].item()) for _, column in extra)])
    Path(path).write_text(text.getvalue(), encoding="utf-8")


def read_experiments(path: str | Path) -> FloatArray:
    """Read a matrix of experiments as rank-one factors (c, n, 1) alone."""
    return read_table(path).factors


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: must be UTF-8 text, got byte {error.start}") from None


def _cells(text: str) -> list[str]:
    for separator in (",", ";", "\t"):
        if separator in text:
            return text.split(separator)
    return re.split(r"\s+", text)
