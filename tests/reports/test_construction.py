"""The study of roads to build, in its quick version."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from reports.construction import MAPS, instance_of, run
from reports.construction_document import fill_document


def test_the_quick_study_writes_roads_counts_drives_and_figures(tmp_path: Path) -> None:
    run(tmp_path, quick=True)
    names = {path.name for path in tmp_path.iterdir()}
    for stem in ("triangle", "rectangle", "counts"):
        assert {f"construction_{stem}.png", f"construction_{stem}.svg"} <= names
    roads = pd.read_csv(tmp_path / "construction_roads.csv")
    for _, part in roads.groupby("map"):
        assert part["class"].nunique() == 2  # either side of the one obstacle
        assert part["chosen"].sum() == 1
        assert part.loc[part["chosen"], "error_m2"].iloc[0] == part["error_m2"].min()
        assert (part["clearance_m"] > 1.99).all()
        assert (part["min_radius_m"] >= 20.0).all()
    counts = pd.read_csv(tmp_path / "construction_counts.csv")
    for _, part in counts.groupby(["map", "road"]):
        assert part["error_m2"].is_monotonic_decreasing  # one more camera never hurts
    driven = pd.read_csv(tmp_path / "construction_driven.csv")
    assert (driven["lateral_within_tolerance"] > 0.9).all()
    text = "<!-- table: roads -->\n<!-- end -->\n<!-- table: needed -->\n<!-- end -->"
    filled = fill_document(text, tmp_path)
    assert "| `triangle` |" in filled
    assert fill_document(filled, tmp_path) == filled


def test_every_map_is_an_instance() -> None:
    assert len(MAPS) == 5
    for name in MAPS:
        assert instance_of(name).road.constructed is not None
