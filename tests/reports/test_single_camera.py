"""One camera: the study's kernel against the library, its boxes against poses drawn inside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from models.geometry import FloatArray
from placement.objectives.entropy import Entropy
from placement.objectives.kalman_gain import kalman_gain
from placement.objectives.localisation import Localisation
from placement.objectives.trace import Trace
from reports.single_camera import study
from reports.single_camera.kernel import OBJECTIVES
from reports.single_camera.search import Optimum, Scorer, find, ranked, refine
from reports.single_camera.setting import HIGH_DEG, LOW_DEG, PRIOR_SIGMA_M, Setting


def draw(n: int, seed: int) -> FloatArray:
    return np.random.default_rng(seed).uniform(LOW_DEG, HIGH_DEG, (n, 4))


@pytest.mark.parametrize("curvature", [0.0, 0.05, -0.2])
def test_scores_are_those_of_the_library(curvature: float) -> None:
    setting, poses = Setting(curvature), draw(60, 1)
    information = setting.information(poses)
    drive = setting.drive(information)
    lone = [np.array([i]) for i in range(60)]
    wanted = {
        "kalman_gain": kalman_gain(setting.cameras(poses), setting.points, information),
        "localisation": Localisation(information, PRIOR_SIGMA_M).state().gains(),
        "entropy": Entropy([drive]).state().gains(),
        "trace": np.array([-Trace([drive]).value(i) for i in lone]),
        "lateral": np.array([-Trace([drive], "lateral").value(i) for i in lone]),
    }
    for name in OBJECTIVES:
        np.testing.assert_allclose(Scorer(setting, name).poses(poses), wanted[name], rtol=2e-6)


@pytest.mark.parametrize("name", OBJECTIVES)
def test_no_pose_in_a_box_beats_the_box(name: str) -> None:
    rng = np.random.default_rng(2)
    for curvature in (0.0, 0.1, -0.05):
        scorer = Scorer(Setting(curvature, "clothoid"), name)
        for size in (0.3, 0.1, 0.02, 0.003):
            width = size * (HIGH_DEG - LOW_DEG)
            low = rng.uniform(LOW_DEG, HIGH_DEG - width, (60, 4))
            ceiling = scorer.boxes(low, low + width)
            inside = low[:, None] + rng.uniform(size=(60, 40, 4)) * width
            scores = scorer.poses(inside.reshape(-1, 4)).reshape(60, 40)
            assert np.all(scores.max(axis=1) <= ceiling + 1e-9 * np.abs(ceiling))


@pytest.mark.parametrize("name", OBJECTIVES)
def test_bounds_tighten_as_boxes_shrink_to_a_pose(name: str) -> None:
    scorer, poses = Scorer(Setting(0.05), name), draw(40, 3)
    scores = scorer.poses(poses)
    loose = scorer.boxes(poses - 5.0, poses + 5.0) - scores
    tight = scorer.boxes(poses - 0.05, poses + 0.05) - scores
    assert np.all(tight <= loose + 1e-12)
    assert np.median(tight) < 0.2 * np.median(loose)


def test_the_certificate_holds_and_thousands_of_poses_find_nothing_better() -> None:
    scorer = Scorer(Setting(0.05), "trace")
    found = find(scorer, tolerance=0.1, most_boxes=60_000)
    assert found.gap <= 0.1 + 1e-9
    assert found.bound <= found.optima[0].value
    assert -scorer.poses(draw(20_000, 4)).max() >= found.optima[0].value


def test_without_boxes_the_bound_is_weak_but_holds() -> None:
    scorer = Scorer(Setting(0.0), "lateral")
    found = find(scorer, tolerance=0.01, most_boxes=20_000)
    assert 0.0 < found.bound <= found.optima[0].value


def test_refining_never_makes_a_pose_worse() -> None:
    scorer, poses = Scorer(Setting(-0.05), "entropy"), draw(5, 5)
    _, values = refine(scorer, poses)
    assert np.all(values >= scorer.poses(poses))


def test_mirror_images_have_equal_values_on_a_straight() -> None:
    """Looking back and looking ahead are one to `localisation`: the straight has no direction."""
    scorer, poses = Scorer(Setting(0.0), "localisation"), draw(30, 6)
    mirrored = poses.copy()
    mirrored[:, 0] = 180.0 - poses[:, 0]
    np.testing.assert_allclose(scorer.poses(poses), scorer.poses(mirrored), rtol=1e-9)


@pytest.mark.slow
def test_the_study_writes_the_same_tables_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = study.Effort((0.05,), ("arc",), 0.3, 20_000, (0.05,), 8, 2)
    monkeypatch.setattr(study, "QUICK", small)
    for name in ("a", "b"):
        study.run(tmp_path / name, quick=True, seed=3)
    for name in ("optima", "cross_values", "ranks", "poses"):
        first = (tmp_path / "a" / f"{name}.csv").read_bytes()
        assert first == (tmp_path / "b" / f"{name}.csv").read_bytes()
    optima = pd.read_csv(tmp_path / "a" / "optima.csv")
    assert set(optima["objective"]) == set(OBJECTIVES)
    assert (optima["gap_percent"] >= 0.0).all()
    assert (tmp_path / "a" / "angles_over_curvature.png").exists()


def test_of_equal_poses_the_one_towards_traffic_comes_first() -> None:
    along, towards, worse = (
        Optimum(np.array([yaw, 50.0, 60.0, 60.0]), value)
        for yaw, value in ((-40.0, 1.0), (-140.0, 0.9995), (180.0, 0.99))
    )
    assert ranked([along, towards, worse]) == [towards, along, worse]
    assert ranked([along, worse]) == [along, worse]
