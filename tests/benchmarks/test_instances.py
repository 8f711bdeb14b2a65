"""The named instances are the roads and pose grids the design describes."""

from __future__ import annotations

import math
import tomllib
from importlib import resources
from typing import Any

import numpy as np
import pytest

from models.roads import Piece, Road, road_from_pieces

NAMES = ("winding", "circuit", "straight-80", "bend-20")


def read(name: str) -> dict[str, Any]:
    file = resources.files("benchmarks.instances") / f"{name}.toml"
    return tomllib.loads(file.read_text(encoding="utf-8"))


def road_of(name: str) -> Road:
    section = read(name)["road"]
    pieces = []
    for piece in section["pieces"]:
        curvature = np.broadcast_to(piece.get("curvature", 0.0), (2,))
        pieces.append(Piece(piece["length"], float(curvature[0]), float(curvature[1])))
    return road_from_pieces(pieces, closed=section.get("closed", False))


def test_every_instance_is_shipped() -> None:
    found = {file.name for file in resources.files("benchmarks.instances").iterdir()}
    assert {f"{name}.toml" for name in NAMES} <= found


def test_winding_offers_the_poses_of_the_design() -> None:
    section, road = read("winding"), road_of("winding")
    assert road.length_m == 1150.0
    assert section["road"]["width_m"] / 2 + section["mounts"]["side_offset_m"] == 5.0
    camera = section["camera"]
    facing = [yaw for yaw in camera["yaw_deg"] if math.sin(math.radians(yaw)) < 1e-9]
    places = road.length_m / section["mounts"]["spacing_m"] + 1
    poses = len(facing) * len(camera["pitch_deg"]) * len(camera["fov_deg"])
    assert places * 2 * poses == 10_440


def test_the_circuit_closes_and_can_be_driven() -> None:
    road = road_of("circuit")
    assert road.closed
    assert road.length_m == pytest.approx(1800.0, abs=1e-9)
    assert road.total_turning_rad == pytest.approx(2.0 * math.pi, abs=1e-12)
    table = road.table(0.5)
    end = math.hypot(table.x_m[-1] - table.x_m[0], table.y_m[-1] - table.y_m[0])
    assert end < 1e-9
    # Curvature runs on without a jump: a clothoid on either side of every bend.
    assert np.abs(np.diff(table.curvature)).max() < 0.5 * 0.0034
    # Steering to the tightest bend takes atan(2.7 m / 15 m) = 10°, well within any car's limit.
    assert road.min_radius_m == pytest.approx(15.0)
    speed = np.minimum(20.0, 0.5 / np.maximum(np.abs(table.curvature), 1e-9))
    assert speed.min() == pytest.approx(7.5, abs=0.01)
    # No part of the circuit comes near another.
    points = road.sample(5.0)
    apart = np.abs(points.s_m[:, None] - points.s_m)
    apart = np.minimum(apart, road.length_m - apart)
    distance = np.hypot(points.x_m[:, None] - points.x_m, points.y_m[:, None] - points.y_m)
    assert distance[apart > 100.0].min() > 60.0


def test_the_single_camera_cases_have_the_dissertations_roads() -> None:
    assert road_of("straight-80").length_m == 80.0
    assert road_of("straight-80").min_radius_m == math.inf
    bend = road_of("bend-20")
    assert bend.min_radius_m == pytest.approx(20.0)
    assert bend.total_turning_rad == pytest.approx(math.pi / 2)
    for name in ("straight-80", "bend-20"):
        assert read(name)["budget"]["cameras"] == 1
        assert 52 in read(name)["camera"]["pitch_deg"]
