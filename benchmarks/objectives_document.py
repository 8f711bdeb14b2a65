"""Measure the tables of docs/objectives.md anew: `python -m benchmarks.objectives_document`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.documents import markdown, replace_table
from benchmarks.monte_carlo_information import compare
from benchmarks.navigation_methods import methods_table
from benchmarks.navigation_sweep import compare_with_refiltering, grow_the_road
from benchmarks.synthetic_drives import Samples
from models.vehicle import OdometryNoise
from placement.information import Information
from placement.objectives.navigation_chain import Drive
from placement.objectives.trace import Trace

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "objectives.md"
Row = Mapping[str, object]
SUBSETS: tuple[tuple[int, ...], ...] = ((), (0,), (1,), (0, 1))


def main() -> None:
    """Fill every table of the document."""
    text = DOCUMENT.read_text(encoding="utf-8")
    tables = {
        "violations": violations_table,
        "sweep": sweep_table,
        "road length": road_length_table,
        "simulated": simulated_table,
        "methods": methods_table,
    }
    for name, make in tables.items():
        text = replace_table(text, name, make())
    DOCUMENT.write_text(text, encoding="utf-8")


def violations_table() -> str:
    """Return `trace` on the two smallest examples that break diminishing returns."""
    header = ["example", "∅", "A", "B", "A, B", "B gains alone", "B gains after A"]
    rows = []
    for name, drive in (("three samples", heading_example()), ("one sample", oblique_example())):
        none, a, b, both = (
            Trace([drive]).value(np.array(subset, dtype=np.int64)) for subset in SUBSETS
        )
        values = [none, a, b, both, none - b, a - both]
        rows.append([name, *(f"{value:.4f}" for value in values)])
    return markdown(header, rows)


def heading_example() -> Drive:
    """Two cameras 10 m apart, then 90 m that nobody sees: only both together tell the heading."""
    return two_cameras([0.0, 10.0, 100.0], [[0], [1]], [[400.0], [400.0]], [1.0, 1.0, 0.1])


def oblique_example() -> Drive:
    """One place, one camera that sees across the road and one that sees along the diagonal."""
    blocks = [[0.0, 0.0, 1e4], [5e3, 5e3, 5e3]]
    return two_cameras([0.0], [[0], [0]], blocks, [10.0, 1.0, 0.0])


def two_cameras(
    s_m: list[float], rows: list[list[int]], blocks: list[list[float]], sigma: list[float]
) -> Drive:
    """Return a straight drive past two cameras; `rows` are the samples that each sees."""
    information = Information(
        len(s_m),
        np.cumsum([0, *map(len, rows)]),
        np.concatenate(rows).astype(np.int32),
        np.array(blocks, dtype=np.float32),
    )
    return Drive(
        Samples(np.array(s_m), np.zeros(len(s_m))),
        information,
        OdometryNoise(1e-4, 1e-3, 1e-3),
        np.array(sigma),
    )


def sweep_table() -> str:
    """Return the time of one sweep by windows and by filtering the road again."""
    header = ["profile", "windows", "same kernels, whole road", "3×3 matrices, whole road"]
    by_profile: dict[str, dict[str, Row]] = {}
    for row in compare_with_refiltering():
        by_profile.setdefault(str(row["profile"]), {})[str(row["method"])] = row
    rows = []
    for profile, methods in by_profile.items():
        rivals = [methods["kernel"], methods["textbook"]]
        own = f"{1e3 * number(methods['window'], 'seconds'):.1f} ms"
        ratios = [
            f"{number(r, 'seconds'):.2f} s, {number(r, 'ratio'):,.0f}×, "
            f"differs by {number(r, 'largest_difference_nats'):.0e}"
            for r in rivals
        ]
        rows.append([f"`{profile}`", own, *ratios])
    return markdown(header, rows)


def road_length_table() -> str:
    """Return the time of a sweep on ever longer roads."""
    seconds: dict[float, dict[str, float]] = {}
    for row in grow_the_road():
        seconds.setdefault(number(row, "road_m"), {})[str(row["objective"])] = number(
            row, "seconds"
        )
    rows = [
        [f"{length / 1e3:.1f} km", f"{1e3 * s['entropy']:.1f} ms", f"{1e3 * s['trace']:.1f} ms"]
        for length, s in seconds.items()
    ]
    return markdown(["road", "`entropy`", "`trace`"], rows)


def number(row: Row, column: str) -> float:
    """Return one numeric cell of a measured row."""
    return float(str(row[column]))


def simulated_table() -> str:
    """Return the mutual information in closed form and by simulated runs."""
    rows = [
        [
            f"`{row['errors']}`",
            f"`{row['profile']}`",
            f"{row['closed_form_nats']:.2f}",
            f"{row['simulated_nats']:.2f} ± {row['standard_error_nats']:.2f}",
            f"{row['z']:+.1f}",
            f"{1e3 * float(str(row['closed_form_s'])):.1f} ms",
            f"{1e3 * float(str(row['simulated_s'])):.0f} ms",
        ]
        for row in compare(runs=4000, seed=0)
    ]
    header = ["errors", "profile", "closed form", "simulated", "z", "time", "time simulated"]
    return markdown(header, rows)


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
