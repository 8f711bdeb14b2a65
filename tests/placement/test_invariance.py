"""Where a scene lies and how it is turned must not matter."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from models.geometry import FloatArray, Pose
from placement.assemble import Scene, assemble
from placement.instance import instance_from_dict, load_instance
from placement.solve import solve

# Rounding: coordinates of 1e5 m carry 1.5e-11 m, a millionth of a millionth of the distances
# that information depends on; values are sums of logarithms of it.
TOLERANCE = 1e-9


def scene_of(xy: FloatArray, folder: Path, model: str) -> Scene:
    rows = "\n".join(f"{x!r},{y!r},6.0,7.0" for x, y in xy.tolist())
    (folder / "road.csv").write_text("# x_m,y_m,w_tr_right_m,w_tr_left_m\n" + rows + "\n")
    document = load_instance("winding").as_dict()
    document["road"] = {"file": "road.csv"}
    document["mounts"]["spacing_m"] = 20.0
    document["errors"] = {"model": model}
    return assemble(instance_from_dict(document, folder=folder))


def bends() -> FloatArray:
    """An uneven closed curve of about 900 m."""
    u = np.linspace(0.0, 2.0 * np.pi, 73)[:-1]
    radius = 140.0 + 25.0 * np.cos(3.0 * u) + 10.0 * np.sin(2.0 * u)
    return np.column_stack((radius * np.cos(u), radius * np.sin(u)))


@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi / 2, 3.0, -2.2])
@pytest.mark.parametrize("model", ["radius", "covariance"])
def test_moving_the_scene_changes_no_value(tmp_path: Path, angle: float, model: str) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    moved = Pose(1e5, -1e5, angle).apply(bends())
    scenes = [scene_of(bends(), here, model), scene_of(moved, there, model)]
    for method in ("uniform", "greedy", "exchange"):
        a, b = (solve(scene.problem, method).value for scene in scenes)
        assert a == pytest.approx(b, rel=TOLERANCE)


def test_moving_a_real_circuit_changes_no_value(
    tmp_path: Path, shared_data: Callable[[str], Path]
) -> None:
    xy = np.loadtxt(shared_data("tracks/Norisring.csv"), delimiter=",")[:, :2]
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    moved = Pose(-1e5, 1e5, 1.234).apply(xy)
    scenes = [scene_of(xy, here, "radius"), scene_of(moved, there, "radius")]
    for method in ("uniform", "greedy", "exchange"):
        a, b = (solve(scene.problem, method).value for scene in scenes)
        assert a == pytest.approx(b, rel=TOLERANCE)
