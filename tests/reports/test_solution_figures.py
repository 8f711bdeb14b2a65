from __future__ import annotations

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from placement.assemble import assemble
from placement.atomic import write_files
from placement.commands import Result
from placement.instance import instance_from_dict
from placement.prediction import predict
from placement.solve import solve
from placement.validation import validate
from reports.solution_map import draw, draw_map, draw_profile


@pytest.fixture(scope="module")
def result() -> Result:
    instance = instance_from_dict(
        {
            "road": {"pieces": [{"length": 60}, {"length": 30, "curvature": 0.02}]},
            "camera": {"yaw_deg": [0, 180], "pitch_deg": [35]},
            "errors": {"model": "radius"},
            "objective": {"kind": "localisation"},
            "budget": {"cameras": 3},
        },
        name='a "name" for $5 & <tags>',
    )
    scene = assemble(instance)
    solution = solve(scene.problem, "greedy")
    validation = validate(scene, solution.selected, runs=3, seed=0)
    return Result(scene, solution, predict(scene, solution.selected), validation)


def test_the_map_shows_every_camera_and_its_footprint(result: Result) -> None:
    axes = Figure().add_subplot()
    draw_map(axes, result)
    drawn = next(line for line in axes.lines if line.get_label() == "camera")
    assert len(drawn.get_xdata()) == len(result.solution.selected)
    assert len(axes.patches) == len(result.solution.selected)
    assert "(m)" in axes.get_xlabel()
    assert "(m)" in axes.get_ylabel()


def test_the_profile_shows_what_was_predicted_and_simulated(result: Result) -> None:
    axes = Figure().add_subplot()
    draw_profile(axes, result)
    labels = {str(line.get_label()) for line in axes.lines}
    assert any("predicted" in label for label in labels)
    assert {"simulated, ekf", "simulated, schmidt"} <= labels


def test_drawing_twice_gives_the_same_bytes(result: Result, tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_files(tmp_path / name, draw(result))
    for file in ("map.png", "map.svg"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
