"""From an instance to a problem, and what is refused on the way."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.vehicle import PROFILES
from placement.assemble import Scene, assemble, build_odometry
from placement.constraints import Infeasible
from placement.instance import instance_from_dict, load_instance


def scene(**tables: Any) -> Scene:
    return assemble(instance_from_dict({"road": {"pieces": [{"length": 100}]}} | tables))


def test_a_scene_is_one_problem_over_its_candidates() -> None:
    made = scene(budget={"cameras": 3})
    assert made.problem.objective.n_candidates == len(made.candidates)
    assert made.information.n_samples == len(made.points) == 101
    assert made.problem.constraints.budget == 3
    assert made.problem.path_length_m == 100.0
    assert made.problem.arc_length_m is not None
    np.testing.assert_array_equal(
        made.problem.arc_length_m, made.candidates.mount_s_m[made.problem.constraints.group]
    )


def test_frames_per_sample_follow_rate_spacing_and_speed() -> None:
    made = scene(camera={"rate_hz": 30}, vehicle={"speed_mps": 10})
    assert made.information.frames_per_sample == pytest.approx(3.0)


def test_without_one_per_mount_every_pose_is_its_own() -> None:
    made = scene(budget={"cameras": 30, "one_per_mount": False})
    assert (made.problem.constraints.group == -1).all()
    assert made.problem.constraints.budget == 30


def test_a_budget_left_out_is_as_many_as_fit() -> None:
    assert scene(mounts={"spacing_m": 50}).problem.constraints.budget == 6


@pytest.mark.parametrize("cameras", [23, 1_000_000_000])
def test_a_budget_beyond_the_mounts_is_refused(cameras: int) -> None:
    with pytest.raises(ValueError, match=rf"at least 1 and at most 22, .* got {cameras}$"):
        scene(budget={"cameras": cameras})


def test_poses_are_required_and_forbidden_by_index_or_by_what_they_are() -> None:
    selector = {"mount": 3, "yaw_deg": 0, "pitch_deg": 35, "fov_deg": [60, 45]}
    made = scene(budget={"required": [selector, 7], "forbidden": [{"pitch_deg": 20}, {"mount": 5}]})
    first, second = made.problem.constraints.required
    assert first == 7
    cameras = made.candidates.cameras
    assert made.candidates.mount[second] == 3
    assert made.candidates.yaw_deg[second] == 0.0
    assert np.degrees(cameras.hfov_rad[second]) == pytest.approx(60.0)
    forbidden = np.zeros(len(cameras), dtype=np.bool_)
    forbidden[made.problem.constraints.forbidden] = True
    wanted = np.isclose(np.degrees(cameras.pitch_rad), 20.0) | (made.candidates.mount == 5)
    np.testing.assert_array_equal(forbidden, wanted)


def test_a_yaw_is_chosen_whichever_way_round_it_is_written() -> None:
    made = scene(budget={"forbidden": [{"yaw_deg": -90}]})
    assert set(made.candidates.yaw_deg[made.problem.constraints.forbidden]) == {270.0}


@pytest.mark.parametrize(
    ("budget", "line"),
    [
        (
            {"required": [1_000_000]},
            r"^budget\.required\[0\] must be a candidate 0…\d+, got 1000000",
        ),
        ({"forbidden": [{"mount": 99}]}, r"^budget\.forbidden\[0\] must fit a candidate, got .*0$"),
        (
            {"required": [{"mount": 3}]},
            r"^budget\.required\[0\] must fit exactly one candidate, got .*, which fits 45$",
        ),
    ],
)
def test_a_choice_that_fits_none_or_many_is_refused(budget: dict[str, Any], line: str) -> None:
    with pytest.raises(ValueError, match=line):
        scene(budget=budget)


def test_a_required_pose_that_is_forbidden_is_a_contradiction() -> None:
    with pytest.raises(Infeasible, match="candidate 4 is both required and forbidden"):
        scene(budget={"required": [4], "forbidden": [4]})


def test_weights_must_match_the_samples() -> None:
    with pytest.raises(
        ValueError, match=r"^objective\.weights must have one number for each of 101"
    ):
        scene(objective={"kind": "localisation", "weights": [1.0, 2.0]})
    made = scene(objective={"kind": "localisation", "weights": [0.5] * 101})
    plain = scene(objective={"kind": "localisation"})
    some = np.array([0, 100])
    assert made.problem.objective.value(some) == pytest.approx(
        0.5 * plain.problem.objective.value(some)
    )


@pytest.mark.parametrize("kind", ["localisation", "entropy", "trace", "final_entropy"])
@pytest.mark.parametrize("model", ["radius", "ellipse", "covariance"])
def test_every_objective_that_is_built_is_assembled(kind: str, model: str) -> None:
    made = scene(objective={"kind": kind}, errors={"model": model})
    assert made.problem.objective.name == kind
    empty = made.problem.objective.state()
    assert np.isfinite(empty.gains(np.array([0, 100, 500]))).all()


def test_weights_are_for_localisation_alone() -> None:
    with pytest.raises(ValueError, match=r"^objective\.weights must be left out for .*= trace"):
        scene(objective={"kind": "trace", "weights": [1.0] * 101})


@pytest.mark.parametrize("weight", ["position", "lateral"])
def test_the_trace_weighs_position_or_the_lateral_direction(weight: str) -> None:
    made = scene(objective={"kind": "trace", "weight": weight})
    both = scene(objective={"kind": "trace"}).problem.objective.value(np.array([7]))
    assert (made.problem.objective.value(np.array([7])) < both) == (weight == "lateral")


@pytest.mark.parametrize("projection", ["pinhole", "stereographic", "equidistant"])
@pytest.mark.parametrize("model", ["radius", "ellipse", "covariance"])
def test_every_lens_and_error_model_is_assembled(projection: str, model: str) -> None:
    made = scene(camera={"projection": projection}, errors={"model": model})
    assert made.information.isotropic == (model == "radius")
    assert (made.information.offsets is not None) == (model == "covariance")


def test_a_closed_road_that_does_not_close_gives_the_miss() -> None:
    with pytest.raises(ValueError, match=r"^road\.pieces: a closed road must end at its start"):
        scene(road={"pieces": [{"length": 100}], "closed": True})


def test_samples_too_fine_are_counted_and_refused() -> None:
    with pytest.raises(ValueError, match=r"^road\.sample_spacing_m must give at most 10,000,000"):
        scene(road={"pieces": [{"length": 100}], "sample_spacing_m": 1e-6})


def test_a_scene_in_which_no_camera_sees_anything_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^none of 990 candidate poses reports a position"):
        scene(errors={"report_limit_m": 0.01})


@pytest.mark.parametrize(
    ("text", "line"),
    [("0,0\nnan,1\n", "line 2"), ("0,0\n0,0\n5,5\n", "differ"), ("0,0\n", "rows"), ("0,x\n", "x")],
)
def test_a_bad_road_file_is_named_with_its_line(tmp_path: Path, text: str, line: str) -> None:
    (tmp_path / "road.csv").write_text(text)
    instance = instance_from_dict({"road": {"file": "road.csv"}}, folder=tmp_path)
    with pytest.raises(ValueError, match=rf"^.*road\.csv.*{line}"):
        assemble(instance)


def test_a_vehicle_is_a_profile_with_densities_replaced_or_four_alphas() -> None:
    base = {"road": {"pieces": [{"length": 100}]}}
    car = build_odometry(instance_from_dict(base | {"vehicle": {"profile": "robot"}}).vehicle)
    assert car == PROFILES["robot"]
    mixed = instance_from_dict(base | {"vehicle": {"heading_deg_per_sqrt_m": 0.1}}).vehicle
    noise = build_odometry(mixed)
    assert noise.heading_rad_per_sqrt_m == pytest.approx(math.radians(0.1))
    assert noise.along_m_per_sqrt_m == PROFILES["car"].along_m_per_sqrt_m
    alphas = instance_from_dict(base | {"vehicle": {"alphas": [1e-4, 1.5e-4, 1.5e-4, 1e-4]}})
    assert build_odometry(alphas.vehicle) == PROFILES["dissertation"]


def test_a_real_circuit_is_assembled_from_its_file(shared_data: Callable[[str], Path]) -> None:
    path = shared_data("tracks/Norisring.csv")
    spec = load_instance("winding").as_dict() | {"road": {"file": path.name}}
    made = assemble(instance_from_dict(spec, folder=path.parent, name="norisring"))
    assert made.road.closed
    assert made.road.total_turning_rad == pytest.approx(
        math.copysign(2 * math.pi, made.road.total_turning_rad), abs=1e-3
    )
    assert made.candidates.n_mounts > 2 * 200
    assert np.diff(made.information.indptr).max() > 10
