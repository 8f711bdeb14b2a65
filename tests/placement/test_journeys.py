"""Several drives in one objective: both directions, lanes, weights."""

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import placement
from placement.assemble import Scene, assemble
from placement.cli import main
from placement.information.join import side_by_side
from placement.instance import InstanceError, instance_from_dict

ROAD: dict[str, Any] = {"pieces": [{"length": 60}, {"length": 50, "curvature": 0.02}]}
LANES: list[Any] = [{"offset_m": -1.5}, {"direction": "backward", "offset_m": -1.5, "weight": 3}]


def scene(kind: str, drives: list[Any] | None, **errors: Any) -> Scene:
    document = {
        "road": ROAD,
        "mounts": {"spacing_m": 25.0},
        "camera": {"yaw_deg": [90, 180], "pitch_deg": [35], "fov_deg": [[60, 45]]},
        "errors": errors,
        "objective": {"kind": kind, **({"drives": drives} if drives is not None else {})},
        "budget": {"cameras": 3},
    }
    return assemble(instance_from_dict(document, folder=Path(), name="lanes"))


@pytest.mark.parametrize("persistent", [False, True])
@pytest.mark.parametrize("kind", ["localisation", "entropy", "trace", "final_entropy"])
def test_the_value_is_the_weighted_sum_or_mean_of_the_drives(kind: str, persistent: bool) -> None:
    both = scene(kind, LANES, persistent=persistent)
    alone = [scene(kind, [drive], persistent=persistent) for drive in LANES]
    chosen = np.array([1, 4, 9])
    one, other = (s.problem.objective.value(chosen) for s in alone)
    mean = kind in ("trace", "final_entropy")  # else a single drive of weight 3 is already tripled
    wanted = (one + 3.0 * other) / 4.0 if mean else one + other
    assert both.problem.objective.value(chosen) == pytest.approx(wanted, rel=1e-9)


def test_a_direction_alone_is_a_drive_along_the_centre_line() -> None:
    short = scene("trace", ["forward", "backward"])
    assert [journey.name for journey in short.journeys] == ["forward", "backward"]
    plain = scene("trace", None)
    chosen = np.array([0, 5])
    forward = scene("trace", ["forward"]).problem.objective.value(chosen)
    assert forward == plain.problem.objective.value(chosen)


def test_symmetric_drives_on_a_straight_have_the_same_value() -> None:
    document = {
        "road": {"pieces": [{"length": 100}]},
        "mounts": {"spacing_m": 50.0, "sides": ["left", "right"]},
        "camera": {"yaw_deg": [90, 270], "pitch_deg": [50], "fov_deg": [[60, 45]]},
        "budget": {"cameras": 2},
    }
    # two mounts stand in the middle, left and right: turning the scene round swaps them
    values = []
    for drive in ({"offset_m": -1.0}, {"direction": "backward", "offset_m": -1.0}):
        made = assemble(
            instance_from_dict(
                {**document, "objective": {"drives": [drive]}}, folder=Path(), name="straight"
            )
        )
        middle = np.flatnonzero(made.candidates.arc_length_m == 50.0)
        values.append(made.problem.objective.value(middle))
    assert values[0] == pytest.approx(values[1], rel=1e-6)


def test_joined_information_holds_every_part_in_its_own_samples() -> None:
    made = scene("localisation", LANES)
    parts = [journey.information for journey in made.journeys]
    whole, start = side_by_side(parts), 0
    assert whole.n_samples == sum(part.n_samples for part in parts)
    for part in parts:
        for i in range(part.n_candidates):
            row = slice(*whole.indptr[i : i + 2])
            mine = slice(*part.indptr[i : i + 2])
            here = (whole.indices[row] >= start) & (whole.indices[row] < start + part.n_samples)
            np.testing.assert_array_equal(whole.indices[row][here] - start, part.indices[mine])
            np.testing.assert_array_equal(whole.blocks[row][here], part.blocks[mine])
        start += part.n_samples


def command(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    monkeypatch.setattr(sys, "argv", ["placement", *map(str, words)])
    with pytest.raises(SystemExit) as stop:
        main()
    return int(stop.value.code or 0)


def test_files_of_several_drives_are_solved_driven_and_verified(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "lanes.toml"
    file.write_text(
        "[road]\npieces = [{length = 60}, {length = 50, curvature = 0.02}]\n"
        "[mounts]\nspacing_m = 25.0\n[budget]\ncameras = 2\n"
        '[objective]\ndrives = [{offset_m = -1.5}, {direction = "backward", offset_m = -1.5}]\n',
        encoding="utf-8",
    )
    out = tmp_path / "out"
    assert command(monkeypatch, "solve", file, "--out", out, "--method", "greedy") == 0
    assert command(monkeypatch, "validate", out, "--runs", 2) == 0
    assert command(monkeypatch, "verify", out) == 0
    summary = json.loads((out / "validation_summary.json").read_text(encoding="utf-8"))
    names = ["forward-1.5m", "backward-1.5m"]
    assert [drive["drive"] for drive in summary["drives"]] == names
    rows = (out / "along_path.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0].startswith("drive,s_m,")
    assert {row.split(",")[0] for row in rows[1:]} == set(names)


@pytest.mark.parametrize(
    ("drives", "message"),
    [
        (["sideways"], r"objective\.drives\[0\]\.direction"),
        ([], r"objective\.drives"),
        ([{"weight": 0.0}], r"objective\.drives must have a drive of positive weight"),
        ([{"offset_m": math.nan}], r"objective\.drives\[0\]\.offset_m"),
    ],
)
def test_bad_drives_are_refused_by_name(drives: list[Any], message: str) -> None:
    with pytest.raises(InstanceError, match=message):
        scene("trace", drives)


def test_a_lane_that_cannot_be_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match=r"objective\.drives\[0\]\.offset_m: a lane \+60 m"):
        scene("trace", [{"offset_m": 60.0}])


def test_the_library_offers_the_journeys() -> None:
    assert len(placement.load("straight-80").journeys) == 1
