"""Measure the tables of docs/closed-loop.md anew: `python -m reports.closed_loop_document`.

Files of further roads may follow, as `--road Norisring.csv`.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import pandas as pd

from benchmarks.documents import markdown, replace_tables
from reports.closed_loop import run

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "closed-loop.md"


def fill_document(text: str, folder: Path) -> str:
    """Return `text` with both tables replaced by what the study's CSV files in `folder` say."""
    tables = {
        "consistency": _consistency(pd.read_csv(folder / "consistency.csv")),
        "prediction": _prediction(pd.read_csv(folder / "prediction.csv")),
        "dead_reckoning": _dead_reckoning(pd.read_csv(folder / "dead_reckoning.csv")),
    }
    return replace_tables(text, tables)


def _consistency(table: pd.DataFrame) -> str:
    keys = ["instance", "case"]
    rows = []
    for (instance, case), part in table.groupby(keys, sort=False):
        cells = {
            row["filter"]: f"{row['predicted_rms_m']:.3f} / {row['simulated_rms_m']:.3f}"
            f" / {row['nees_mean']:.2f} / {100.0 * row['nees_steps_in_band']:.0f} %"
            for row in part.to_dict("records")
        }
        rows.append([f"`{instance}`, {case}", cells["ekf"], cells["schmidt"]])
    header = ["", "EKF: predicted / simulated rms (m) / NEES / steps in band", "Schmidt–Kalman"]
    return markdown(header, rows)


def _prediction(table: pd.DataFrame) -> str:
    rows = [
        [
            f"`{row['instance']}`",
            f"{row['runs']:.0f}",
            f"{row['predicted_rms_m']:.4f}",
            f"{row['simulated_rms_m']:.4f}",
            f"{row['difference_percent']:+.1f} % [{row['low_95_percent']:+.1f}, "
            f"{row['high_95_percent']:+.1f}]",
        ]
        for row in table.to_dict("records")
    ]
    return markdown(["", "runs", "predicted rms (m)", "simulated rms (m)", "difference"], rows)


def _dead_reckoning(table: pd.DataFrame) -> str:
    rows = []
    for row in table.to_dict("records"):
        ours = bool(pd.notna(row["runs"]))
        what = f"`{row['odometry']}`, filter at {row['filter_hz']:.0f} Hz, {row['runs']:.0f} runs"
        rows.append(
            [
                what if ours else str(row["odometry"]),
                f"{row['mean_m']:.2f}",
                f"{row['worst_m']:.2f}",
                f"{row['mean_percent_of_distance']:.2f} %",
                f"{row['claimed_rms_m']:.2f} / {row['rms_m']:.2f}" if ours else "–",
            ]
        )
    header = ["odometry", "mean end error (m)", "worst (m)", "mean / distance", "claimed / rms (m)"]
    return markdown(header, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--road", type=Path, action="append", default=[])
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        run(Path(scratch), roads=given.road)
        document = fill_document(DOCUMENT.read_text(encoding="utf-8"), Path(scratch))
    DOCUMENT.write_text(document, encoding="utf-8")
