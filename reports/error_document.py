"""Measure the tables of docs/error-model.md anew: `python -m reports.error_document`."""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.documents import markdown, replace_tables
from reports.error_model import run

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "error-model.md"

Read = Callable[[str], pd.DataFrame]


def fill_document(text: str, folder: Path) -> str:
    """Return `text` with every table replaced by what the study's CSV files in `folder` say.

    A table stands between `<!-- table: NAME -->` and `<!-- end -->`. Raises ValueError for a name
    that is not known.
    """
    tables = {
        name: make(lambda csv: pd.read_csv(folder / f"{csv}.csv")) for name, make in TABLES.items()
    }
    return replace_tables(text, tables)


def _coverage(read: Read) -> str:
    rows = read("bound_coverage")
    return markdown(
        ["model", "samples", "inside", "percent"],
        [
            [f"`{r.model}`", f"{r.samples:,}", f"{r.inside:,}", f"{r.percent:.3f}"]
            for r in rows.itertuples()
        ],
    )


def _by_pitch(read: Read) -> str:
    table = read("coverage_by_pitch")
    table = table[table["model"] == "covariance"]
    pitches = sorted(table["pitch_deg"].unique(), reverse=True)
    rows = []
    keys = ["orientation_95_deg", "position_95_m", "projection"]
    for (orientation, position, lens), part in _groups(table, keys):
        by_pitch = part.set_index("pitch_deg")["percent"]
        rows.append(
            [
                f"{orientation}°, {position:g} m",
                str(lens),
                *(f"{by_pitch[pitch]:.2f}" for pitch in pitches),
            ]
        )
    return markdown(["installation", "lens", *(f"{p:g}°" for p in pitches)], rows)


def _first_order(read: Read) -> str:
    table = read("first_order_limit")
    wide = table.pivot_table("percent", "orientation_95_deg", "epsilon_high")
    rows = [
        [f"{orientation}°", *("–" if math.isnan(x) else f"{x:.1f}" for x in line)]
        for orientation, line in zip(wide.index, wide.to_numpy(), strict=True)
    ]
    return markdown(["orientation", *(f"ε < {e:g}" for e in wide.columns)], rows)


def _components(read: Read) -> str:
    table = read("components_by_pitch")
    table = table[table["model"] == "covariance"]
    names = list(dict.fromkeys(table["component"]))
    wide = table.pivot_table("median_m", "pitch_deg", "component")[names].sort_index(
        ascending=False
    )
    rows = [
        [f"{pitch:g}°", *(f"{x:.3f}" for x in line)]
        for pitch, line in zip(wide.index, wide.to_numpy(), strict=True)
    ]
    return markdown(["pitch", *names], rows)


def _installer(read: Read) -> str:
    table = read("installation")
    table = table[(table["position_95_m"] == 0.03) & table["achieves_0_25_m"]]
    end = 1.4  # the table's last orientation
    rows = []
    for (model, pitch), part in _groups(table, ["model", "pitch_deg"]):
        best = float(part["orientation_95_deg"].max())
        rows.append([f"`{model}`", f"{pitch:g}°", f"{best:g}°" + " or worse" * (best >= end)])
    return markdown(["model", "pitch", "orientation to, 95 %"], rows)


def _bounds(read: Read) -> str:
    bounds = read("bounds_by_pitch")
    merged = bounds.merge(read("distances_by_pitch"), on=["protocol", "pitch_deg"])
    columns = ["mean_m", "median_m", "p95_m"]
    rows = [
        [
            f"{pitch:g}°",
            str(protocol),
            *(f"{x:.4f}" for x in part[columns].to_numpy()[0]),
            f"{part['median_distance_m'].iloc[0]:.1f}",
        ]
        for (protocol, pitch), part in _groups(merged, ["protocol", "pitch_deg"])
    ]
    rows.sort(key=lambda row: -float(row[0][:-1]))
    return markdown(["pitch", "protocol", "mean", "median", "95th", "distance (m)"], rows)


def _algorithm(read: Read) -> str:
    table = read("algorithm_error")
    wide = table.pivot_table("median_m", "algorithm_95_px", "model")
    theirs = table.dropna(subset="dissertation_median_m").set_index("algorithm_95_px")
    rows = [
        [
            f"{px:g} px",
            *(f"{wide.loc[px, kind]:.3f}" for kind in ("radius", "ellipse", "covariance")),
            f"{theirs.loc[px, 'dissertation_median_m']:.3f}",
        ]
        for px in theirs.index
    ]
    header = ["Δ_alg", "`radius`, median (m)", "`ellipse`", "`covariance`", "dissertation"]
    return markdown(header, rows)


def _groups(table: pd.DataFrame, keys: list[str]) -> Iterator[tuple[tuple[Any, ...], pd.DataFrame]]:
    for key, part in table.groupby(keys, sort=False):
        yield (key if isinstance(key, tuple) else (key,)), part


TABLES: dict[str, Callable[[Read], str]] = {
    "coverage": _coverage,
    "by_pitch": _by_pitch,
    "first_order": _first_order,
    "components": _components,
    "installer": _installer,
    "bounds": _bounds,
    "algorithm": _algorithm,
}


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        run(Path(scratch))
        document = fill_document(DOCUMENT.read_text(encoding="utf-8"), Path(scratch))
    DOCUMENT.write_text(document, encoding="utf-8")
