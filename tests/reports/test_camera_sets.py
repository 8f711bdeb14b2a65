"""The study of camera sets: its files, its claims on one small road, the same bytes twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from reports import camera_sets
from reports.camera_sets_rank import diminishing_returns, rank_correlations


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    camera_sets.run(folder, quick=True, seed=1)
    return folder


@pytest.mark.slow
def test_the_same_seed_writes_the_same_tables(study: Path, tmp_path: Path) -> None:
    camera_sets.run(tmp_path, quick=True, seed=1)
    names = sorted(path.name for path in study.glob("*.csv"))
    assert names == ["closed_loop.csv", "diminishing.csv", "ranks.csv", "values.csv"]
    for name in names:
        assert (study / name).read_bytes() == (tmp_path / name).read_bytes()


def test_no_value_passes_a_bound_and_search_is_never_worse_than_greedy(study: Path) -> None:
    values = pd.read_csv(study / "values.csv")
    for (objective, _), part in values.dropna(subset=["value"]).groupby(["objective", "k"]):
        sign = 1.0 if objective in ("localisation", "entropy") else -1.0
        score = sign * part.set_index("method")["value"]
        bounds = sign * part["bound"].dropna()
        assert np.all(score.max() <= bounds * (1 + 1e-9 * np.sign(bounds)) + 1e-12)
        assert score["search"] >= score["greedy"] - 1e-9 * abs(score["greedy"])


def test_the_submodular_objectives_never_break_diminishing_returns(study: Path) -> None:
    table = pd.read_csv(study / "diminishing.csv").set_index("objective")
    assert table.loc[["localisation", "entropy"], "violations_percent"].max() == 0.0
    assert (table["worst_gain_ratio"] >= 1.0).all()


def test_sampling_sees_a_violation_where_there_is_one() -> None:
    class Pairs:
        """Worth something only once two cameras are there."""

        maximise = True

        def value(self, selected: np.ndarray[tuple[int], np.dtype[np.int64]]) -> float:
            return float(max(0, len(selected) - 1))

    found = diminishing_returns(Pairs(), np.arange(9), 200, np.random.default_rng(0))  # type: ignore[arg-type]
    assert 5.0 < found["violations_percent"] < 80.0


def test_a_perfect_prophet_has_rank_correlation_one() -> None:
    k = [2] * 5
    error = [0.5, 0.4, 0.3, 0.2, 0.1]
    driven = pd.DataFrame(
        {"road": "r", "k": k, "set": range(5), "trace": error, "entropy": error[::-1],
         "cross_track_rms_m": error,
         "error_rms_m": error}
    )  # fmt: skip
    twice = pd.concat([driven, driven])  # found by two methods: still five sets
    table = rank_correlations(twice, ["trace", "entropy"]).set_index(["k", "objective"])
    assert (table["sets"] == 5).all()
    assert table.loc[(2, "trace"), "cross_track"] == pytest.approx(1.0)
    assert table.loc[(2, "entropy"), "cross_track"] == pytest.approx(1.0)
