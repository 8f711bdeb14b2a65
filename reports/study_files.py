"""What every study writes: its tables as CSV, its figures as PNG and SVG; and which those are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from placement.atomic import Content
from reports.style import saved


def study_files(
    tables: Mapping[str, pd.DataFrame], figures: Mapping[str, Figure]
) -> dict[str, Content]:
    """Return the files of a study, by name: `TABLE.csv`, `FIGURE.png` and `FIGURE.svg`.

    Numbers have six digits, so that the same study writes the same bytes.
    """
    files: dict[str, Content] = {
        f"{name}.csv": table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
        for name, table in tables.items()
    }
    for name, figure in figures.items():
        files |= {f"{name}.{kind}": saved(figure, kind) for kind in ("png", "svg")}
    return files


def stamps(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Return what changes of each file in `folder` when it is written anew, by name."""
    files = [path for path in folder.iterdir() if path.is_file()] if folder.is_dir() else []
    found = {path.name: path.stat() for path in files}
    return {name: (s.st_mtime_ns, s.st_ino, s.st_size) for name, s in found.items()}


def written_since(folder: Path, before: Mapping[str, tuple[int, int, int]]) -> set[str]:
    """Return which files of `folder` were written since `stamps` gave `before`."""
    return {name for name, stamp in stamps(folder).items() if before.get(name) != stamp}
