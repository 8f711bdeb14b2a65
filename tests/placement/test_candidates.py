"""Where cameras may stand and look."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from models.geometry import Pose
from models.roads import Piece, Road, road_from_pieces, road_from_points
from placement.candidates import Candidates, build_candidates, looks_away
from placement.instance import Instance, instance_from_dict, load_instance

STRAIGHT = road_from_pieces([Piece(100.0)])


def instance(**tables: Any) -> Instance:
    return instance_from_dict({"road": {"pieces": [{"length": 100}]}} | tables)


def on_road(candidates: Candidates, road: Road) -> float:
    """Return the least distance of a mount to the centre line."""
    x, y = candidates.mount_x_m, candidates.mount_y_m
    foot = road.evaluate(road.project(x, y)[0])
    return float(np.hypot(x - foot.x_m, y - foot.y_m).min())


def test_winding_has_the_candidates_of_the_design() -> None:
    winding = load_instance("winding")
    assert winding.road.pieces is not None
    pieces = [Piece(piece.length, *piece.curvature) for piece in winding.road.pieces]
    candidates = build_candidates(winding, road_from_pieces(pieces))
    assert len(candidates) == 10_440
    assert candidates.n_mounts == 232
    assert on_road(candidates, road_from_pieces(pieces)) == pytest.approx(5.0)


def test_mounts_stand_every_spacing_from_the_start_on_both_sides() -> None:
    candidates = build_candidates(instance(mounts={"spacing_m": 30}), STRAIGHT)
    assert candidates.mount_s_m.tolist() == [0, 0, 30, 30, 60, 60, 90, 90]
    assert candidates.mount_side.tolist() == [1, -1] * 4
    np.testing.assert_allclose(candidates.mount_y_m, [3, -3] * 4, atol=1e-12)


def test_the_end_of_an_open_road_has_a_mount_where_the_spacing_meets_it() -> None:
    candidates = build_candidates(instance(mounts={"spacing_m": 0.1, "sides": ["left"]}), STRAIGHT)
    assert candidates.n_mounts == 1001
    assert candidates.mount_s_m[-1] == 100.0


def test_a_closed_road_does_not_repeat_its_first_mount() -> None:
    angle = np.linspace(0.0, 2.0 * math.pi, 200, endpoint=False)
    circle = road_from_points(50.0 * np.column_stack([np.cos(angle), np.sin(angle)]), closed=True)
    spacing = circle.length_m / 20.0
    candidates = build_candidates(instance(mounts={"spacing_m": spacing}), circle)
    assert candidates.n_mounts == 40
    places = np.column_stack([candidates.mount_x_m, candidates.mount_y_m])
    assert len(np.unique(np.round(places, 6), axis=0)) == 40


def test_poses_are_ordered_by_mount_height_yaw_pitch_and_field_of_view() -> None:
    candidates = build_candidates(
        instance(
            mounts={"spacing_m": 100, "sides": ["left"], "height_m": [6, 10]},
            camera={"yaw_deg": [270, 180], "pitch_deg": [20, 50], "fov_deg": [[60, 45], [45, 34]]},
        ),
        STRAIGHT,
    )
    cameras = candidates.cameras
    rows = np.column_stack(
        [
            candidates.mount,
            cameras.height_m,
            candidates.yaw_deg,
            np.degrees(cameras.pitch_rad),
            np.degrees(cameras.hfov_rad),
        ]
    )
    expected = [
        [m, h, yaw, pitch, fov]
        for m in (0, 1)
        for h in (6, 10)
        for yaw in (270, 180)
        for pitch in (20, 50)
        for fov in (60, 45)
    ]
    np.testing.assert_allclose(rows, expected)


def test_yaw_is_relative_to_the_road_and_turns_with_it() -> None:
    turned = STRAIGHT.transformed(Pose(0.0, 0.0, math.radians(30.0)))
    spec = instance(camera={"yaw_deg": [180], "pitch_deg": [30], "fov_deg": [[60, 45]]})
    assert np.degrees(build_candidates(spec, turned).cameras.yaw_rad) == pytest.approx(210.0)


@pytest.mark.parametrize(
    ("yaw_deg", "left_mount_drops"),
    [(0, 0), (45, 1), (90, 1), (135, 1), (180, 0), (225, 0), (270, 0), (315, 0)],
)
def test_a_pose_looks_away_when_its_axis_points_to_its_own_side(
    yaw_deg: float, left_mount_drops: int
) -> None:
    yaw, pitch = np.radians([yaw_deg, -yaw_deg]), np.radians([35.0, 35.0])
    assert looks_away(yaw, pitch, 1).tolist()[0] == bool(left_mount_drops)
    assert looks_away(yaw, pitch, -1).tolist()[1] == bool(left_mount_drops)


def test_a_camera_that_looks_straight_down_looks_nowhere_away() -> None:
    assert not looks_away(np.radians([90.0]), np.radians([90.0]), 1).any()


def test_mounts_that_would_stand_on_another_part_of_the_road_are_dropped() -> None:
    # Legs 6 m apart: a pole 6 m to the left of one leg stands on the other.
    hairpin = road_from_pieces([Piece(60.0), Piece(3.0 * math.pi, 1 / 3, 1 / 3), Piece(60.0)])
    candidates = build_candidates(instance(mounts={"side_offset_m": 4.5}), hairpin)
    assert on_road(candidates, hairpin) >= 1.5 - 1e-6
    assert (candidates.mount_side[candidates.mount_s_m < 60.0] == -1).all()
    assert np.diff(np.unique(candidates.mount)).tolist() == [1] * (candidates.n_mounts - 1)


def test_mounts_on_the_very_edge_stay() -> None:
    assert build_candidates(instance(mounts={"side_offset_m": 0}), STRAIGHT).n_mounts == 22


def test_too_many_candidates_are_counted_and_refused() -> None:
    with pytest.raises(
        ValueError, match=r"at most 50,000,000, got 90,000,000,090 .*mounts\.spacing_m"
    ):
        build_candidates(instance(mounts={"spacing_m": 1e-7}), STRAIGHT)


def test_yaws_that_all_look_away_are_refused() -> None:
    spec = instance(mounts={"sides": ["left"]}, camera={"yaw_deg": [90]})
    with pytest.raises(ValueError, match=r"^camera\.yaw_deg must hold a yaw that does not"):
        build_candidates(spec, STRAIGHT)
