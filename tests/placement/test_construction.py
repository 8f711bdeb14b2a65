"""Choosing a road with its cameras: the front, the choice, and the commands end to end."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from placement.commands import solve_into, validate_in, verify_in
from placement.constructed import constructed_road, roads_of
from placement.construction import choose_road, pareto
from placement.instance import InstanceError, instance_from_dict, load_instance
from placement.obstacles import build_obstacles

TOML = """
[road]
width_m = 6.0
sample_spacing_m = 2.0
[road.construct]
start = [0, 0, 0]
goal = [120, 0, 0]
obstacles = [ [[45, -12], [80, -15], [60, 20]] ]
min_radius_m = 15
clearance_m = 2
radius_factors = [1]
bends = "clothoids"
cost_per_m = 10.0
[mounts]
spacing_m = 20
[camera]
yaw_deg = [0, 180]
pitch_deg = [35]
fov_deg = [[60, 45]]
[obstacles]
height_m = 5.0
[budget]
cameras = 3
"""


def site(**changes: Any) -> dict[str, Any]:
    construct = {"start": [0, 0, 0], "goal": [100, 0, 0], "min_radius_m": 10.0}
    return {"road": {"construct": {**construct, **changes}}}


def test_solve_validate_and_verify_a_construct_end_to_end(tmp_path: Path) -> None:
    source = tmp_path / "site.toml"
    source.write_text(TOML)
    out = tmp_path / "out"
    solution = solve_into(out, str(source), method="greedy", quiet=True)
    assert solution.status.has_placement
    table = pd.read_csv(out / "pareto.csv")
    assert len(table) == 2
    assert table["chosen"].sum() == 1
    chosen = table[table["chosen"]].iloc[0]
    assert chosen["error_m2"] == table["error_m2"].min()
    assert np.allclose(table["cost"], 10.0 * table["length_m"])
    record = json.loads((out / "solution.json").read_text())
    assert record["value"] == pytest.approx(chosen["value"], rel=1e-9)
    path = pd.read_csv(out / "along_path.csv")
    assert path["s_m"].iloc[-1] == pytest.approx(chosen["length_m"], abs=1e-6)
    assert {"pareto.png", "pareto.svg"} <= {file.name for file in out.iterdir()}
    assert verify_in(out, quiet=True)
    validate_in(out, runs=3, seed=0, quiet=True)
    assert (out / "validation.csv").exists()
    # a road that is bent to pass nearer does not get past the referee
    stored = json.loads((out / "instance.json").read_text())
    stored["instance"]["road"]["construct"]["clearance_m"] = 4.0
    (out / "instance.json").write_text(json.dumps(stored))
    assert not verify_in(out, quiet=True)
    checks = json.loads((out / "verification.json").read_text())["checks"]
    assert "road.clearance" in {check["name"] for check in checks if not check["passed"]}


@pytest.mark.parametrize("how", ["error", "length", "cost", "knee"])
def test_choose_says_which_road_is_built(how: str, tmp_path: Path) -> None:
    source = tmp_path / "site.toml"
    source.write_text(TOML.replace('bends = "clothoids"', f'bends = "arcs"\nchoose = "{how}"'))
    choice = choose_road(load_instance(source), "greedy")
    table = choice.table()
    chosen = table.iloc[choice.chosen]
    assert chosen["pareto"] or how == "cost"
    if how != "knee":
        column = {"error": "error_m2", "length": "length_m", "cost": "cost"}[how]
        assert chosen[column] == table[column].min()
    road = constructed_road(choice.instance)
    assert road.length_m == pytest.approx(chosen["length_m"], abs=1e-9)


def test_obstacles_of_the_construct_block_views_too() -> None:
    ring = [[45, -12], [80, -15], [60, 20]]
    instance = instance_from_dict({**site(obstacles=[ring]), "obstacles": {"height_m": 7.0}})
    obstacles = build_obstacles(instance)
    assert len(obstacles) == 1
    assert obstacles.height_m.tolist() == [7.0]


def test_obstacles_of_both_tables_are_kept_clear_of() -> None:
    box = [[40, -10], [60, -10], [60, 10], [40, 10]]
    instance = instance_from_dict({**site(), "obstacles": {"polygons": [box]}})
    assert min(road.length_m for road in roads_of(instance).roads) > 101.0
    with pytest.raises(ValueError, match=r"obstacles.polygons\[0\]"):
        roads_of(instance_from_dict({**site(goal=[50, 0, 0]), "obstacles": {"polygons": [box]}}))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"goal": [0, 0, 0]}, "road.construct.goal must differ from start"),
        (
            {"obstacles": [[[40, -9], [60, 9], [60, -9], [40, 9]]]},
            r"road.construct.obstacles\[0\] must be a simple polygon",
        ),
        (
            {"obstacles": [[[90, -9], [95, -9], [95, 9], [115, 9], [115, -9], [116, -9], [116, 10],
                            [90, 10]], [[90, -9], [116, -9], [116, -10], [90, -10]]]},
            "there is no road: obstacles shut road.construct.goal in",
        ),
        ({"pieces": [{"length": 90.0}]}, "road.construct.pieces must lead from start to goal"),
    ],
)  # fmt: skip
def test_a_bad_construct_is_told_why(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        constructed_road(instance_from_dict(site(**changes)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"length_factor": 0.5}, r"road.construct.length_factor must lie in \[1, 10\], got 0.5"),
        ({"radius_factors": []}, "road.construct.radius_factors must not be empty"),
        ({"choose": "best"}, "road.construct.choose must be"),
        ({"clothoid_m": 40.0}, "road.construct.clothoid_m must be below 31.4159"),
        ({"pieces": []}, "road.construct.pieces must not be empty"),
    ],
)
def test_impossible_keys_are_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InstanceError, match=message):
        instance_from_dict(site(**changes))


def test_the_front_is_what_nothing_beats() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        a, b = rng.integers(0, 6, (2, 12)).astype(np.float64)
        b[rng.uniform(size=12) < 0.2] = math.inf
        got = pareto(a, b)
        for n in range(12):
            beaten = any(
                (a[m] <= a[n] and b[m] <= b[n] and (a[m] < a[n] or b[m] < b[n]))
                or (a[m] == a[n] and b[m] == b[n] and m < n)
                for m in range(12)
            )
            assert got[n] == (not beaten and math.isfinite(b[n]))
