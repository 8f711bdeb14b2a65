"""Validation: the columns and numbers of DESIGN 7, and what it refuses."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from models.simulation import FILTERS
from placement.assemble import Scene, assemble
from placement.instance import instance_from_dict
from placement.validation import Validation, validate

INSTANCE = {
    "road": {"pieces": [{"length": 60}, {"length": 40, "curvature": 0.02}, {"length": 60}]},
    "mounts": {"spacing_m": 40.0},
    "camera": {
        "resolution_px": [900, 900],
        "yaw_deg": [180],
        "pitch_deg": [40],
        "fov_deg": [[60, 60]],
    },
    "budget": {"cameras": 2},
}
RUNS = 30


@pytest.fixture(scope="module")
def scene() -> Scene:
    return assemble(instance_from_dict(INSTANCE))


@pytest.fixture(scope="module")
def validation(scene: Scene) -> Validation:
    return validate(scene, [0, 2, 4], runs=RUNS, seed=5)


def test_there_is_a_row_a_run_and_filter(validation: Validation) -> None:
    rows = validation.rows
    assert list(zip(rows["filter"], rows["run"], strict=True)) == [
        (name, run) for name in FILTERS for run in range(RUNS)
    ]
    for column in (
        "seed",
        "rms_localisation_error_m",
        "max_localisation_error_m",
        "rms_cross_track_m",
        "max_cross_track_m",
        "nees_mean",
        "updates",
        "gated",
    ):
        assert column in rows
    assert not rows.isna().any().any()
    assert (rows["rms_localisation_error_m"] <= rows["max_localisation_error_m"]).all()
    assert (rows["rms_cross_track_m"] <= rows["max_cross_track_m"]).all()


def test_the_summary_has_what_the_design_names(validation: Validation) -> None:
    summary = validation.summary
    assert (summary["runs"], summary["seed"]) == (RUNS, 5)
    assert set(summary["filters"]) == {"ekf", "schmidt"}
    for part in summary["filters"].values():
        assert {
            "predicted_rms_m",
            "simulated_rms_m",
            "nees_mean",
            "nees_low_95",
            "nees_high_95",
            "nees_steps_in_band",
            "cross_track_rms_m",
            "lateral_within_tolerance",
        } <= set(part)
        assert part["nees_low_95"] <= part["nees_mean"] <= part["nees_high_95"]
        assert 0.0 <= part["nees_steps_in_band"] <= 1.0
        assert 0.0 <= part["lateral_within_tolerance"] <= 1.0
        assert all(isinstance(value, float) and math.isfinite(value) for value in part.values())
    json.dumps(summary, allow_nan=False)


def test_the_summary_agrees_with_the_rows(validation: Validation) -> None:
    rows = validation.rows
    for name, part in validation.summary["filters"].items():
        mine = rows[rows["filter"] == name]
        # every run takes nearly the same number of steps
        mean_square = float((mine["rms_localisation_error_m"] ** 2).mean())
        assert part["simulated_rms_m"] == pytest.approx(math.sqrt(mean_square), rel=1e-2)
        assert part["nees_mean"] == pytest.approx(float(mine["nees_mean"].mean()), rel=1e-2)


def test_the_profile_runs_along_the_road(validation: Validation, scene: Scene) -> None:
    profile = validation.profile
    assert profile.s_m[0] < 2.0
    assert scene.road.length_m - 4.0 < profile.s_m[-1] < scene.road.length_m
    for name in FILTERS:
        for values in (
            profile.position_rms_m[name],
            profile.cross_track_rms_m[name],
            profile.predicted_rms_m[name],
        ):
            assert values.shape == profile.s_m.shape
            assert np.isfinite(values).all()
        assert profile.nees[name].shape == profile.time_s.shape
    assert profile.nees_low.shape == profile.nees_high.shape == profile.time_s.shape


def test_batches_do_not_show(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = validate(scene, [0, 2], runs=7, seed=1)
    monkeypatch.setattr("placement.validation._BATCH", 3)
    parts = validate(scene, [2, 0], runs=7, seed=1)
    assert whole.rows.equals(parts.rows)
    for name in FILTERS:
        for key, value in whole.summary["filters"][name].items():
            assert parts.summary["filters"][name][key] == pytest.approx(value, rel=1e-12)


def test_progress_is_reported(scene: Scene) -> None:
    heard: list[tuple[str, float | None]] = []
    validate(scene, [2], runs=2, progress=lambda text, share: heard.append((text, share)))
    assert [text for text, _ in heard] == [
        "driving with the ekf filter",
        "driving with the schmidt filter",
    ]


def test_latency_and_missed_detections_are_options(scene: Scene) -> None:
    part = validate(scene, [0, 2], runs=5, latency_s=0.08, missed=0.04, false=0.02)
    assert part.summary["filters"]["schmidt"]["updates_mean"] > 0.0


def test_cameras_that_never_see_the_car_are_refused(scene: Scene) -> None:
    with pytest.raises(ValueError, match="selected: no camera sees the car anywhere"):
        validate(scene, [], runs=2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"runs": 0}, "runs must be at least 1, got 0"),
        ({"seed": -1}, "seed must be at least 0, got -1"),
        ({"plant": "hovercraft"}, "plant must be one of"),
        ({"latency_s": 1e6}, "latency_s must be shorter than the drive"),
        ({"missed": 1.5}, "missed must lie in"),
    ],
)
def test_bad_options_are_refused(scene: Scene, options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        validate(scene, [2], **{"runs": 2, **options})  # type: ignore[arg-type]


def test_a_road_too_tight_is_refused_with_the_place() -> None:
    tight = assemble(
        instance_from_dict(
            INSTANCE | {"road": {"pieces": [{"length": 60}, {"length": 4, "curvature": 0.4}]}}
        )
    )
    with pytest.raises(ValueError, match=r"road: its radius .* got 2\.50 m at s = 60\.\d m"):
        validate(tight, [0], runs=2)
