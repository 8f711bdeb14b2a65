"""Measure the tables of docs/construction.md anew: `python -m reports.construction_document`."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import pandas as pd

from benchmarks.documents import markdown, replace_tables
from reports.construction import run

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "construction.md"


def fill_document(text: str, folder: Path) -> str:
    """Return `text` with its tables replaced by what the study's CSV files in `folder` say."""
    tables = {
        "roads": _roads(pd.read_csv(folder / "construction_roads.csv")),
        "driven": _driven(pd.read_csv(folder / "construction_driven.csv")),
        "needed": _needed(pd.read_csv(folder / "construction_needed.csv")),
    }
    return replace_tables(text, tables)


def roads_table(folder: Path) -> str:
    """Return the table of the shortest road and that of least error from the study's `folder`."""
    return _roads(pd.read_csv(folder / "construction_roads.csv"))


def _roads(table: pd.DataFrame) -> str:
    rows = []
    for name, part in table.groupby("map", sort=False):
        shortest = part.iloc[0]
        chosen = part[part["chosen"]].iloc[0]
        rows.append(
            [
                f"`{name}`",
                f"{len(part)} of {part['class'].nunique()}",
                str(int(part["pareto"].sum())),
                _one(shortest),
                _one(chosen),
                f"{100.0 * (chosen['length_m'] / shortest['length_m'] - 1.0):.1f} %",
                f"{100.0 * (1.0 - chosen['error_m2'] / shortest['error_m2']):.1f} %",
            ]
        )
    header = ["map", "roads of classes", "on the front", "shortest", "least error"]
    header += ["longer", "less trace"]
    return markdown(header, rows)


def _one(row: pd.Series) -> str:
    rms = 100.0 * float(row["error_m2"]) ** 0.5
    return (
        f"{row['class']}, {row['bends']} {row['min_radius_m']:.0f} m: "
        f"{row['length_m']:.1f} m, {rms:.2f} cm"
    )


def _driven(table: pd.DataFrame) -> str:
    rows = [
        [
            f"`{row['map']}`",
            row["filter"],
            f"{row['predicted_rms_m']:.3f} / {row['simulated_rms_m']:.3f} m",
            f"{row['cross_track_rms_m']:.3f} m",
            f"{100.0 * row['lateral_within_tolerance']:.1f} %",
        ]
        for row in table.to_dict("records")
    ]
    return markdown(["map", "filter", "rms error", "cross-track", "within"], rows)


def _needed(table: pd.DataFrame) -> str:
    rows = [
        [
            f"`{row['map']}`",
            row["class"],
            f"{row['length_m']:.1f} m, {row['bends']}",
            "more than 10" if pd.isna(row["cameras_needed"]) else f"{row['cameras_needed']:.0f}",
        ]
        for row in table.to_dict("records")
    ]
    return markdown(["map", "class", "road", "cameras"], rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--from", dest="source", type=Path, help="CSV files of an earlier run")
    given = parser.parse_args().source
    with tempfile.TemporaryDirectory() as scratch:
        if given is None:
            run(Path(scratch))
        document = fill_document(DOCUMENT.read_text(encoding="utf-8"), given or Path(scratch))
    DOCUMENT.write_text(document, encoding="utf-8")
