"""What an instance may say: each test spoils one thing of an instance that passes."""

from __future__ import annotations

from typing import Any

import pytest

from placement.instance import InstanceError, instance_from_dict
from placement.instance.schema import Document

ROAD = {"pieces": [{"length": 100.0}]}


def problems(**tables: Any) -> list[str]:
    with pytest.raises(InstanceError) as caught:
        instance_from_dict({"road": ROAD} | tables)
    assert str(caught.value).splitlines() == list(caught.value.problems)
    return list(caught.value.problems)


def test_a_road_is_all_an_instance_needs() -> None:
    instance = instance_from_dict({"road": ROAD})
    assert instance.camera.yaw_deg == (0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0)
    assert instance.camera.fov_deg[2] == (90.0, 68.0)
    assert instance.camera.resolution_px == (2000, 1500)
    assert instance.mounts.sides == ("left", "right")
    assert instance.errors.model == "covariance"
    assert instance.errors.report_limit_m == 2.0
    assert instance.objective.kind == "trace"
    assert instance.vehicle.initial_sigma == (0.1, 0.1, 0.01)
    assert instance.objective.prior_sigma_m == 0.5
    assert instance.budget.cameras == 20
    assert instance.budget.one_per_mount


def test_a_curvature_is_a_number_or_runs_between_two() -> None:
    pieces = [{"length": 1, "curvature": 0.02}, {"length": 1, "curvature": [0, 0.02]}]
    instance = instance_from_dict({"road": {"pieces": pieces}})
    assert instance.road.pieces is not None
    assert [p.curvature for p in instance.road.pieces] == [(0.02, 0.02), (0.0, 0.02)]


@pytest.mark.parametrize(
    ("tables", "line"),
    [
        (
            {"camera": {"pitch_deg": [20, 30, 135]}},
            "camera.pitch_deg[2] must lie in (0, 90], got 135",
        ),
        ({"camera": {"pitch_deg": [0]}}, "camera.pitch_deg[0] must lie in (0, 90], got 0"),
        ({"camera": {"pitch_deg": []}}, "camera.pitch_deg must not be empty, got []"),
        (
            {"camera": {"pitch_deg": [20, 30, 20]}},
            "camera.pitch_deg[2] must differ from the entries before it, got 20",
        ),
        (
            {"camera": {"fov_deg": [[60, 45], [180, 45]]}},
            "camera.fov_deg[1][0] must lie in (0, 180) for a pinhole camera, got 180",
        ),
        ({"camera": {"fov_deg": [[60]]}}, "camera.fov_deg[0] must have more entries, got [60]"),
        (
            {"camera": {"fov_deg": [[60, 45, 3]]}},
            "camera.fov_deg[0] must have 2 entries, got [60, 45, 3]",
        ),
        (
            {"camera": {"resolution_px": [0, 900]}},
            "camera.resolution_px[0] must lie in [1, 100000], got 0",
        ),
        (
            {"camera": {"projection": "equidistant", "fov_deg": [[361, 45]]}},
            "camera.fov_deg[0][0] must lie in (0, 360], got 361",
        ),
        (
            {"camera": {"distortion": [-0.5, 0, 0, 0]}},
            "camera.distortion must not fold the image inside the field of view, "
            "got [-0.5, 0.0, 0.0, 0.0], one to one up to 46.78 degrees only",
        ),
        ({"camera": {"rate_hz": "fast"}}, 'camera.rate_hz must be a number, got "fast"'),
        ({"camera": {"rate_hz": True}}, "camera.rate_hz must be a number, got true"),
        ({"camera": {"rate_hz": float("nan")}}, "camera.rate_hz must be finite, got nan"),
        ({"camera": {"max_range_m": float("inf")}}, "camera.max_range_m must be finite, got inf"),
        (
            {"camera": {"yaw": [1]}},
            "camera.yaw is not a key of instance files (did you mean camera.yaw_deg?)",
        ),
        ({"bugdet": {}}, "bugdet is not a key of instance files (did you mean budget?)"),
        ({"budget": 3}, "budget must be a table, got 3"),
        ({"budget": {"cameras": 0}}, "budget.cameras must be at least 1, got 0"),
        ({"budget": {"cameras": -1}}, "budget.cameras must be at least 1, got -1"),
        (
            {"budget": {"cameras": 1e9}},
            "budget.cameras must be an integer, got the decimal number 1000000000.0",
        ),
        ({"budget": {"required": ["x"]}}, 'budget.required[0] must be an integer, got "x"'),
        (
            {"budget": {"forbidden": [{}]}},
            "budget.forbidden[0] must give at least one of mount, height_m, yaw_deg, pitch_deg, "
            "fov_deg, type, got {}",
        ),
        (
            {"road": {}},
            "road must have exactly one of pieces, file and construct, got none of them",
        ),
        (
            {"road": {"file": "a.csv", **ROAD}},
            "road must have exactly one of pieces, file and construct, got pieces and file",
        ),
        ({"road": {"pieces": []}}, "road.pieces must not be empty, got []"),
        (
            {"road": {"pieces": [{"length": 0}]}},
            "road.pieces[0].length must lie in (0, 1e+06], got 0",
        ),
        (
            {"road": {"pieces": [{"length": 1, "curvature": [0, float("nan")]}]}},
            "road.pieces[0].curvature[1] must be finite, got nan",
        ),
        (
            {"road": {"pieces": [{"length": 1, "curvature": "left"}]}},
            'road.pieces[0].curvature must be a number or an array of two, got "left"',
        ),
        ({"road": {"pieces": [{}]}}, "road.pieces[0].length is missing"),
        ({"mounts": {"height_m": [6, 0]}}, "mounts.height_m[1] must lie in (0, 100], got 0"),
        ({"mounts": {"sides": ["up"]}}, 'mounts.sides[0] must be "left" or "right", got "up"'),
        ({"mounts": {"spacing_m": 0}}, "mounts.spacing_m must lie in (0, 1e+06], got 0"),
        ({"errors": {"position_95_m": -1}}, "errors.position_95_m must lie in [0, 10], got -1"),
        (
            {"errors": {"orientation_95_deg": 46}},
            "errors.orientation_95_deg must lie in [0, 45], got 46",
        ),
        (
            {"mounts": {"side_offset_m": 1e300}},
            "mounts.side_offset_m must lie in [0, 1000], got 1e+300",
        ),
        (
            {"road": {"pieces": [{"length": 1}], "width_m": 1e300}},
            "road.width_m must lie in (0, 1000], got 1e+300",
        ),
        (
            {"road": {"pieces": [{"length": 1, "curvature": [1e9, 0]}]}},
            "road.pieces[0].curvature[0] must lie in [-10, 10], got 1000000000",
        ),
        (
            {"road": {"pieces": [{"length": 1, "curvature": [0.1, -0.8]}]}},
            "road.pieces[0].curvature must be below 0.666667 (2/width_m), where the inner edge "
            "ends, got 0.8",
        ),
        (
            {"vehicle": {"initial_sigma": [1e10, 0, 0]}},
            "vehicle.initial_sigma[0] must lie in [0, 1000], got 10000000000",
        ),
        ({"errors": {"persistent": 1}}, "errors.persistent must be true or false, got 1"),
        (
            {"vehicle": {"alphas": [1, 2, 3, 4], "profile": "car"}},
            "vehicle must not have both alphas and others, got alphas, profile",
        ),
        (
            {"obstacles": {"polygons": [[[0, 0], [1, 1], [0, 0]]]}},
            "obstacles.polygons[0] must have at least 3 different corners, "
            "got [[0, 0], [1, 1], [0, 0]]",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_name(tables: dict[str, Any], line: str) -> None:
    assert problems(**tables) == [line]


def test_the_road_is_not_optional() -> None:
    with pytest.raises(InstanceError, match=r"^road is missing$"):
        instance_from_dict({})


def test_every_problem_gets_a_line() -> None:
    found = problems(camera={"pitch_deg": [0, 135], "yaw": 3}, budget={"cameras": 0})
    assert len(found) == 4


def test_a_road_to_be_constructed_is_accepted() -> None:
    instance = instance_from_dict({"road": {"construct": {"start": [0, 0, 0], "goal": [9, 0, 0]}}})
    assert instance.road.constructed is not None


def test_every_key_of_the_design_is_known() -> None:
    keys = {name: set(f.annotation.model_fields) for name, f in Document.model_fields.items()}  # type: ignore[union-attr]
    assert {"projection", "resolution_px", "yaw_deg", "pitch_deg", "fov_deg", "rate_hz"} <= keys[
        "camera"
    ]
    assert {"model", "position_95_m", "orientation_95_deg", "algorithm_95_px", "persistent"} < keys[
        "errors"
    ]
    assert {"polygons", "height_m", "file"} == keys["obstacles"]
    assert {"spacing_m", "side_offset_m", "sides", "height_m", "cost", "file"} == keys["mounts"]
