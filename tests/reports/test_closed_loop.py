"""The closed-loop study: its files, its claims, and the picture of consistency."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from placement.assemble import assemble
from placement.commands import Result
from placement.instance import instance_from_dict
from placement.prediction import predict
from placement.solve import solve
from placement.validation import validate
from reports import closed_loop
from reports.closed_loop_document import DOCUMENT, fill_document
from reports.consistency import draw, draw_nees


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    closed_loop.run(folder, quick=True, seed=1)
    return folder


@pytest.fixture(scope="module")
def result() -> Result:
    scene = assemble(
        instance_from_dict(
            {
                "road": {"pieces": [{"length": 60}, {"length": 30, "curvature": 0.02}]},
                "camera": {"yaw_deg": [0, 180], "pitch_deg": [35]},
                "objective": {"kind": "localisation"},
                "budget": {"cameras": 3},
            }
        )
    )
    solution = solve(scene.problem, "greedy")
    validation = validate(scene, solution.selected, runs=20, seed=0)
    return Result(scene, solution, predict(scene, solution.selected), validation)


def test_dead_reckoning_claims_what_it_does_at_both_rates(study: Path) -> None:
    table = pd.read_csv(study / "dead_reckoning.csv")
    ours = table[table["odometry"].isin(["dissertation", "car", "robot"])]
    most = ours[ours["runs"] == ours["runs"].max()]
    assert (most["claimed_rms_m"] / most["rms_m"]).between(0.8, 1.25).all()
    for _, rates in most.groupby("odometry"):
        assert rates["mean_m"].max() < 1.01 * rates["mean_m"].min()
    mean = most.groupby("odometry")["mean_m"].first()
    assert mean["dissertation"] < mean["car"] < mean["robot"]
    assert mean["dissertation"] == pytest.approx(2.06, rel=0.6)  # another circuit of 1.8 km


def test_every_case_of_every_road_has_both_filters(study: Path) -> None:
    table = pd.read_csv(study / "consistency.csv")
    assert len(table) == 2 * len(closed_loop.CASES) * len(closed_loop.INSTANCES)
    assert np.isfinite(table.select_dtypes("number")).all().all()
    circuit = table[(table["instance"] == "circuit") & (table["case"] == "as installed")]
    share = circuit.set_index("filter")["nees_steps_in_band"]
    assert share["schmidt"] > 0.85  # forty runs only
    assert share["ekf"] < 0.7
    for name in closed_loop.INSTANCES:
        for kind in ("png", "svg"):
            assert (study / f"nees_{name}.{kind}").stat().st_size > 0


def test_the_picture_shows_both_filters_and_the_band(result: Result) -> None:
    assert result.validation is not None
    axes = Figure().add_subplot()
    draw_nees(axes, result.validation.profile)
    assert len(axes.lines) == 2
    assert len(axes.collections) == 1
    assert set(draw(result)) == {"consistency.png", "consistency.svg"}


def test_nothing_is_drawn_before_a_solution_is_driven(result: Result) -> None:
    assert draw(replace(result, validation=None)) == {}


def test_the_document_s_tables_are_the_study_s(study: Path) -> None:
    text = fill_document(DOCUMENT.read_text(encoding="utf-8"), study)
    circuit = pd.read_csv(study / "consistency.csv").iloc[1]
    assert f"{circuit['predicted_rms_m']:.3f} / {circuit['simulated_rms_m']:.3f}" in text
    roads, cases = len(closed_loop.INSTANCES), len(closed_loop.CASES)
    assert text.count("\n| `") == cases * roads + roads + 12
    assert "nan" not in text
