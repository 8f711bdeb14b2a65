"""What every study writes: its tables as CSV, its figures as PNG and SVG."""

from __future__ import annotations

from collections.abc import Mapping

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
