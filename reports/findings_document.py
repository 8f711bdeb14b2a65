"""Fill the tables of docs/findings.md from the studies: `python -m reports.findings_document DIR`.

DIR is what `placement report all --out DIR` wrote; a study that is not there keeps its old tables.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.documents import markdown, replace_table
from reports import construction_document

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "findings.md"


def accuracy(folder: Path) -> str:
    """Return the 95 % radius of the circle by pitch, ours and the dissertation's."""
    table = pd.read_csv(folder / "error-model" / "bounds_by_pitch.csv")
    rows = []
    for pitch in (90.0, 70.0, 50.0, 40.0):
        cells = [f"{pitch:.0f}°"]
        for protocol in ("image", "road", "dissertation"):
            row = table[(table["protocol"] == protocol) & (table["pitch_deg"] == pitch)].iloc[0]
            cells.append(f"{row['mean_m']:.2f} / {row['median_m']:.2f} / {row['p95_m']:.2f} m")
        rows.append(cells)
    return markdown(["pitch", "ours, over the image", "ours, over a road", "dissertation"], rows)


def poses(folder: Path) -> str:
    """Return the best pose for each objective at the dissertation's curvatures, either side."""
    table = pd.read_csv(folder / "single-camera" / "optima.csv")
    table = table[(table["rank"] == 1) & (table["entry"] == "arc")]
    rows = []
    for curvature in (0.0, 0.05, -0.05, 0.2, -0.2):
        for row in table[np.isclose(table["curvature"], curvature)].to_dict("records"):
            value = float(row["value"])
            metric = row["objective"] in ("trace", "lateral")
            shown = f"{np.sqrt(value):.4f} m rms" if metric else f"{value:.1f}"
            rows.append(
                [
                    f"{curvature:g}" if curvature == 0.0 else f"{curvature:+g} ({row['mount']})",
                    f"`{row['objective']}`",
                    *(f"{row[a]:.0f}°" for a in ("yaw_deg", "pitch_deg", "hfov_deg", "vfov_deg")),
                    shown,
                    f"{row['gap_percent']:.1f} %",
                ]
            )
    header = ["κ (1/m)", "best for", "yaw", "pitch", "hfov", "vfov", "value", "none better by"]
    return markdown(header, rows)


def losses(folder: Path) -> str:
    """Return what the best pose for the cheap score loses against the best for `lateral`."""
    table = pd.read_csv(folder / "single-camera" / "cross_values.csv")
    table = table[table["entry"] == "arc"]
    rows = []
    for curvature in (0.0, 0.05, -0.05, 0.2, -0.2):
        part = table[np.isclose(table["curvature"], curvature)].set_index("placed_for")
        if not len(part):
            continue
        cells = [f"{curvature:g}"]
        for name in ("kalman_gain", "localisation", "entropy", "lateral"):
            predicted = 100.0 * float(np.sqrt(part["lateral"][name]))
            driven = 100.0 * float(part["cross_track_rms_m"][name])
            cells.append(f"{predicted:.1f} / {driven:.1f}")
        rows.append(cells)
    header = ["κ (1/m)", *(f"for `{n}`" for n in ("kalman_gain", "localisation", "entropy"))]
    return markdown([*header, "for `lateral`"], rows)


def pose_ranks(folder: Path) -> str:
    """Return the rank correlations over a thousand poses."""
    table = pd.read_csv(folder / "single-camera" / "ranks.csv")
    rows = [
        [
            f"{row['curvature']:g}",
            f"`{row['objective']}`",
            *(
                f"{row[c]:+.2f}"
                for c in ("with_trace", "with_lateral", "with_error_rms_m",
                          "with_cross_track_rms_m")
            ),
        ]
        for row in table.to_dict("records")
    ]  # fmt: skip
    header = ["κ (1/m)", "objective", "trace", "lateral", "driven error", "driven cross-track"]
    return markdown(header, rows)


def sets_driven(folder: Path) -> str:
    """Return the driven cross-track error of what was placed for each objective."""
    table = pd.read_csv(folder / "camera-sets" / "closed_loop.csv")
    names = [n for n in dict.fromkeys(table["placed_for"]) if n != "nothing"]
    rows = []
    for (road, k), part in table.groupby(["road", "k"], sort=False):
        cells = [str(road), str(k)]
        chosen = part[~part["method"].isin(["uniform", "random"])]
        chosen = chosen[chosen["placed_for"] != "nothing"]
        for name in names:
            best = chosen[chosen["placed_for"] == name]["cross_track_rms_m"].min()
            cells.append(f"{100.0 * best:.1f}")
        for method in ("uniform", "random"):
            plain = part[(part["method"] == method) & (part["placed_for"] != "nothing")]
            cells.append(f"{100.0 * plain['cross_track_rms_m'].min():.1f}")
        loose = part[part["placed_for"] == "nothing"]["cross_track_rms_m"].median()
        rows.append([*cells, f"{100.0 * loose:.1f}"])
    header = ["road", "k", *(f"`{n}`" for n in names), "`uniform`", "`random`"]
    return markdown([*header, "random sets, median"], rows)


def set_ranks(folder: Path) -> str:
    """Return which objective foretells the closed loop: mean rank correlation over sizes."""
    table = pd.read_csv(folder / "camera-sets" / "ranks.csv")
    table = table[table["k"] > 0]
    roads = list(dict.fromkeys(table["road"]))
    rows = []
    for name in dict.fromkeys(table["objective"]):
        part = table[table["objective"] == name]
        means = [part[part["road"] == road]["cross_track"].mean() for road in roads]
        rows.append([f"`{name}`", *(f"{m:+.2f}" for m in means), f"{np.nanmean(means):+.2f}"])
    return markdown(["objective", *roads, "mean"], rows)


def diminishing(folder: Path) -> str:
    """Return the sampled violations of diminishing returns."""
    table = pd.read_csv(folder / "camera-sets" / "diminishing.csv")
    rows = []
    for name, part in table.groupby("objective", sort=False):
        worst = part["worst_gain_ratio"].replace(np.inf, np.nan).max()
        lost = bool(np.isinf(part["worst_gain_ratio"]).any())
        rows.append(
            [
                f"`{name}`",
                f"{int(part['triples'].sum()):,}",
                f"{part['violations_percent'].mean():.2f} %",
                "from a loss to a gain" if lost else f"{worst:.2f}",
            ]
        )
    return markdown(["objective", "triples", "violations", "largest gain on B over A"], rows)


def gaps(folder: Path) -> str:
    """Return how far each method is from the best bound, at k = 5, 10 and 20."""
    table = pd.read_csv(folder / "camera-sets" / "values.csv").dropna(subset=["value"])
    rows = []
    for name, part in table.groupby("objective", sort=False):
        sign = 1.0 if name in ("localisation", "entropy") else -1.0
        best = (sign * part["value"]).groupby([part["road"], part["k"]]).max()
        for method, line in part.groupby("method", sort=False):
            keyed = line.set_index(["road", "k"])
            loss = best.loc[keyed.index] - sign * keyed["value"]
            share = 100.0 * loss / np.abs(best.loc[keyed.index])
            proven = keyed["gap_percent"].dropna()
            rows.append(
                [
                    f"`{name}`",
                    f"`{method}`",
                    str(len(keyed)),
                    f"{share.median():.1f} %",
                    f"{share.max():.1f} %",
                    f"{proven.median():.1f} %" if len(proven) else "–",
                ]
            )
    header = ["objective", "method", "cases", "median loss", "worst loss", "median proven gap"]
    return markdown(header, rows)


def counts(folder: Path) -> str:
    """Return cameras needed, what is proven, and what plainer plans need."""
    table = pd.read_csv(folder / "camera-count" / "counts.csv")
    asked = ["road", "tolerance_m", "height_m", "installation", "failures"]
    table = table.drop_duplicates(asked)  # the reference stands in every series
    rows = []
    for row in table.to_dict("records"):
        cells = [
            str(row["road"]),
            f"{row['tolerance_m']:.2f} m",
            f"{row['height_m']:g} m",
            f"× {row['installation']:g}",
            str(row["failures"]),
        ]
        if pd.isna(row.get("cameras")):
            rows.append([*cells, f"none ({row['status']})", "", "", "", ""])
            continue
        per_km = f"{row['per_km']:.0f}"
        numbers = [row["at_least"], row["uniform"], row["grid"]]
        shown = ["–" if pd.isna(n) else f"{n:.0f}" for n in numbers]
        rows.append([*cells, f"**{row['cameras']:.0f}**", *shown, per_km])
    header = ["road", "τ", "poles", "installation", "dark", "cameras", "at least", "`uniform`"]
    return markdown([*header, "grid", "per km"], rows)


def crossing(folder: Path) -> str:
    """Return the crossing's error by method and number of cameras, with what is proven."""
    table = pd.read_csv(folder / "intersection" / "values.csv")
    ways = pd.read_csv(folder / "intersection" / "movements.csv")
    methods = list(dict.fromkeys(table["method"]))
    rows = []
    for k, part in table.groupby("k"):
        value = part.set_index("method")["trace_m2"]
        bound = part["bound_m2"].max()
        here = ways[ways["k"] == k]
        rows.append(
            [
                str(k),
                *(f"{100.0 * np.sqrt(value[m]):.1f}" for m in methods),
                "–" if pd.isna(bound) else f"{100.0 * np.sqrt(bound):.1f}",
                f"{100.0 * here['worst_2sigma_lateral_m'].max():.0f}",
                f"{100.0 * here['cross_track_rms_m'].mean():.1f}",
            ]
        )
    header = ["k", *(f"`{m}`" for m in methods), "proven", "worst 2σ lateral", "driven cross-track"]
    return markdown(header, rows)


def roads(folder: Path) -> str:
    """Return the roads round obstacles: shortest, and least error."""
    return construction_document.roads_table(folder / "construction")


TABLES: Mapping[str, Callable[[Path], str]] = {
    "accuracy": accuracy,
    "poses": poses,
    "losses": losses,
    "pose ranks": pose_ranks,
    "sets driven": sets_driven,
    "set ranks": set_ranks,
    "diminishing": diminishing,
    "gaps": gaps,
    "counts": counts,
    "crossing": crossing,
    "roads": roads,
}


def fill_document(text: str, folder: Path) -> str:
    """Return `text` with every table whose study lies in `folder` written anew."""
    for name, make in TABLES.items():
        try:
            table = make(folder)
        except FileNotFoundError:
            continue
        text = replace_table(text, name, table)
    return text


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    DOCUMENT.write_text(
        fill_document(DOCUMENT.read_text(encoding="utf-8"), given.folder), encoding="utf-8"
    )
    sys.stdout.write(f"{DOCUMENT} is filled from {given.folder}\n")
