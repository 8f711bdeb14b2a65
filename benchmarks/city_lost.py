"""Why cars of a city are lost: `python -m benchmarks.city_lost INSTANCE --cameras CAMERAS.csv`.

CAMERAS.csv is what `benchmarks.city_drives --out` wrote. Each of `--drives` is driven in the
closed loop with the filter's gate, which rejects measurements that a right filter would hardly
expect, and without it; the rows say what is predicted at worst, how many cars are lost (more than
`LOST_M` from where they think they are), and what becomes of the others.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.city_drives import (
    GATE,
    build_site,
    city_instance,
    drive_loop,
    near_drive,
    traffic_of,
)
from benchmarks.documents import existing, fill, markdown
from models.simulation import ClosedLoop, nominal_drive
from placement.validation import validate_loop

LOST_M = 10.0


def main(arguments: Sequence[str] | None = None) -> None:
    """Drive, print, and fill the table of a document."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("instance", type=existing)
    parser.add_argument("--cameras", type=existing, required=True, help="what city_drives wrote")
    parser.add_argument("--drives", type=int, nargs="+", default=[0, 55, 111, 223, 335])
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--document", type=existing, help="fill the table of this document")
    options = parser.parse_args(arguments)
    try:
        rows = lost(options.instance, options.cameras, options.drives, options.runs)
    except ValueError as error:
        parser.exit(2, f"error: {error}\n")
    table = markdown(list(rows[0]), [[str(item) for item in row.values()] for row in rows])
    sys.stdout.write(table + "\n")
    if options.document is not None:
        fill(options.document, {"drives: lost": table})


def lost(instance_path: Path, cameras: Path, which: list[int], runs: int) -> list[dict[str, Any]]:
    """Return one row a drive and gate."""
    instance = city_instance(instance_path)
    network, drives = traffic_of(instance)
    site = build_site(instance, network, drives)
    candidates = np.sort(pd.read_csv(cameras)["candidate"].to_numpy(dtype=np.int64))
    rows = []
    for d in which:
        if not 0 <= d < len(drives):
            raise ValueError(f"--drives must lie in 0…{len(drives) - 1}, got {d}")
        here = slice(int(drives.start[d]), int(drives.start[d + 1]))
        near = near_drive(instance, site, candidates, drives.points.xy[here])
        gated, free = (drive_loop(instance, drives.roads[d], site, near, g) for g in (GATE, 0.0))
        rows.append({"drive": d, **_told(gated, free, runs, d)})
    return rows


def _told(loop: ClosedLoop, without_gate: ClosedLoop, runs: int, seed: int) -> dict[str, Any]:
    """Drive both and sum up the runs of the first, those that are lost apart from the others."""
    nominal = nominal_drive(loop, filter="ekf")
    every, free = (_runs(each, runs, seed) for each in (loop, without_gate))
    gone = every["max_localisation_error_m"] > LOST_M
    kept, away = every[~gone], every[gone]
    claimed = np.sqrt(nominal.claimed_m2[0, : int(nominal.steps[0])])
    return {
        "predicted rms m": round(float(np.sqrt(np.mean(claimed**2))), 2),
        "worst predicted m": round(float(claimed.max()), 2),
        "driven rms m": round(_rms(every), 2),
        "median run m": round(float(every["rms_localisation_error_m"].median()), 2),
        "lost %": round(100.0 * float(gone.mean()), 1),
        "lost %, no gate": round(
            100.0 * float((free["max_localisation_error_m"] > LOST_M).mean()), 1
        ),
        "rms of the others m": round(_rms(kept), 2),
        "frames used, lost": _mean(away, "updates"),
        "others": _mean(kept, "updates"),
        "rejected, lost": _mean(away, "gated"),
    }


def _runs(loop: ClosedLoop, runs: int, seed: int) -> pd.DataFrame:
    rows = validate_loop(loop, runs=runs, seed=seed, tolerance_m=0.3).rows
    return rows[rows["filter"] == "ekf"]


def _rms(rows: pd.DataFrame) -> float:
    return float(np.sqrt((rows["rms_localisation_error_m"] ** 2).mean())) if len(rows) else 0.0


def _mean(rows: pd.DataFrame, name: str) -> str:
    return f"{rows[name].mean():.0f}" if len(rows) else ""


if __name__ == "__main__":
    main()
