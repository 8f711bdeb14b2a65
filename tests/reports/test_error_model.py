"""The error-model study: its files, columns, seeds, and the claims its document makes."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from reports.error_document import DOCUMENT, TABLES, fill_document
from reports.error_model import run

COLUMNS = {
    "bound_coverage": ["model", "samples", "inside", "percent"],
    "bounds_by_pitch": ["protocol", "pitch_deg", "mean_m", "median_m", "p25_m", "p95_m"],
}
DRAWN = [
    "coverage_by_pitch",
    "first_order_limit",
    "residuals",
    "components_by_pitch",
    "algorithm_error",
    "resolution",
    "bounds_by_pitch",
    "installation",
]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    run(folder, quick=True, seed=3)
    return folder


def read(study: Path, name: str) -> pd.DataFrame:
    return pd.read_csv(study / f"{name}.csv")


def test_the_tables_asked_for_have_the_columns_asked_for(study: Path) -> None:
    for name, columns in COLUMNS.items():
        assert list(read(study, name).columns) == columns
    for name in DRAWN:
        assert len(read(study, name)) > 0
        assert (study / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (study / f"{name}.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_125_000_samples_of_each_model_and_only_covariance_is_at_95_percent(study: Path) -> None:
    table = read(study, "bound_coverage").set_index("model")
    assert (table["samples"] == 125_000).all()
    assert 94.5 < table["percent"]["covariance"] < 95.5
    assert (table["percent"][["radius", "ellipse"]] > 99.0).all()


def test_covariance_is_calibrated_for_every_lens_pitch_and_installation(study: Path) -> None:
    table = read(study, "coverage_by_pitch")
    percent = table[table["model"] == "covariance"]["percent"]
    assert len(percent) == 30
    # 12,500 samples: one standard error is 0.2 %.
    assert percent.between(94.0, 96.0).all()


def test_the_first_order_holds_to_0_08_and_is_broken_at_0_15(study: Path) -> None:
    table = read(study, "first_order_limit")
    pooled = table.assign(inside=table["samples"] * table["percent"]).groupby("epsilon_high")
    share = pooled["inside"].sum() / pooled["samples"].sum()
    assert share[0.08] > 94.0
    assert share[0.15] < 94.0


def test_histograms_count_every_report_once(study: Path) -> None:
    table = read(study, "residuals")
    counts = table.pivot_table("count", "model", "kind", aggfunc="sum")
    assert (counts["absolute_m"] == counts["relative"]).all()
    assert (counts > 11_000).all().all()


def test_the_bound_grows_as_cameras_look_up_and_resolution_flattens(study: Path) -> None:
    bounds = read(study, "bounds_by_pitch")
    for protocol in ("image", "road"):
        rows = bounds[bounds["protocol"] == protocol].sort_values("pitch_deg")
        assert rows["mean_m"].is_monotonic_decreasing
    table = read(study, "resolution")
    for _, rows in table.groupby(["model", "pitch_deg"]):
        mean = rows.set_index("resolution_px")["mean_m"]
        assert mean.is_monotonic_decreasing
        assert mean[2000] - mean[8000] < 0.25 * (mean[250] - mean[2000])


def test_the_same_seed_writes_the_same_bytes(study: Path, tmp_path: Path) -> None:
    run(tmp_path, quick=True, seed=3)
    for path in sorted(study.iterdir()):
        assert path.read_bytes() == (tmp_path / path.name).read_bytes(), path.name


def test_every_table_of_the_document_can_be_filled(study: Path) -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    filled = fill_document(text, study)
    for name in TABLES:
        block = filled.split(f"<!-- table: {name} -->")[1].split("<!-- end -->")[0]
        assert block.count("\n") > 3
    with pytest.raises(ValueError, match="got unknown"):
        fill_document("<!-- table: unknown -->\n<!-- end -->", study)


def test_a_folder_that_cannot_be_written_is_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ValueError, match="must be a folder that can be written"):
        run(tmp_path / "file", quick=True)
