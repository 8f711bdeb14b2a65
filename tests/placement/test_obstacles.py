"""Buildings from the instance file to the matrix, the loop, the referee and the picture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from models.errors import ErrorModel
from models.obstacles import Obstacles
from placement.assemble import Scene, assemble
from placement.information import compute_information
from placement.information.reference import dense_information
from placement.instance import Instance, instance_from_dict
from placement.obstacles import build_obstacles
from placement.referee.values import eyes_of, rebuild, whole_value
from placement.validation import validate
from tests.placement.information.test_information import ROAD, as_dense, some_cameras

# A long house south of a straight road and a small one north of it.
HOUSES = [
    [[20.0, -4.0], [60.0, -4.0], [60.0, -8.0], [20.0, -8.0]],
    [[70.0, 3.0], [75.0, 3.0], [75.0, 9.0], [70.0, 9.0]],
]


def street(**obstacles: object) -> Instance:
    return instance_from_dict(
        {
            "road": {"pieces": [{"length": 100.0}], "width_m": 4.0},
            "mounts": {"spacing_m": 20.0, "side_offset_m": 8.0},
            "camera": {"pitch_deg": [20.0, 35.0], "fov_deg": [[60.0, 45.0]]},
            "budget": {"cameras": 3},
            "objective": {"kind": "localisation"},
            "obstacles": obstacles,
        }
    )


@pytest.fixture(scope="module")
def scene() -> Scene:
    return assemble(street(polygons=HOUSES, height_m=4.0))


@pytest.mark.parametrize("kind", ["radius", "covariance"])
@pytest.mark.parametrize("workers", [1, 3])
def test_kernel_and_twin_agree_behind_buildings(kind: str, workers: int) -> None:
    rng = np.random.default_rng(3)
    cameras, points = some_cameras(every=9), ROAD.sample(1.0)
    rings = []
    for centre in points.xy[rng.integers(0, len(points), 25)] + rng.normal(0.0, 8.0, (25, 2)):
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 5))
        rings.append(centre + 3.0 * np.column_stack([np.cos(angle), np.sin(angle)]))
    obstacles = Obstacles(tuple(rings), rng.uniform(1.0, 9.0, 25))
    errors = ErrorModel(kind)  # type: ignore[arg-type]
    found = compute_information(cameras, points, errors, 60.0, obstacles=obstacles, workers=workers)
    wanted = dense_information(cameras, points, errors, 60.0, obstacles)
    open_view = dense_information(cameras, points, errors, 60.0)
    np.testing.assert_array_equal(as_dense(found)[..., 0] > 0.0, wanted[..., 0] > 0.0)
    np.testing.assert_allclose(as_dense(found), wanted, rtol=1e-6, atol=1e-6 * wanted.max())
    assert 0.2 < (wanted[..., 0] > 0.0).sum() / (open_view[..., 0] > 0.0).sum() < 0.9


def test_a_building_can_only_take_information_away(scene: Scene) -> None:
    free = assemble(street())
    hidden = as_dense(free.information)[..., 0] - as_dense(scene.information)[..., 0]
    assert (hidden >= 0.0).all()
    assert (hidden > 0.0).any()


def test_the_referee_sees_past_the_same_buildings(scene: Scene) -> None:
    some = np.arange(0, len(scene.candidates), 7)
    eyes = eyes_of(scene.candidates, some.tolist())
    value = scene.problem.objective.value(some)
    assert whole_value(rebuild(scene.instance), eyes) == pytest.approx(value, rel=1e-6)
    assert whole_value(rebuild(street()), eyes) > 1.01 * value


def test_a_camera_behind_a_building_reports_nothing_in_the_closed_loop() -> None:
    wall = [[[-50.0, 3.0], [150.0, 3.0], [150.0, 5.0], [-50.0, 5.0]]]
    free = assemble(street())
    north = np.flatnonzero(free.candidates.mount_side[free.candidates.mount] > 0)
    best = int(north[np.argmax(np.diff(free.information.indptr)[north])])
    seen = validate(free, [best], runs=2)
    assert seen.rows["updates"].min() > 0
    tall = assemble(
        street(polygons=[*wall, [[200.0, 50.0], [201.0, 50.0], [201.0, 51.0]]], height_m=30.0)
    )
    with pytest.raises(ValueError, match="no camera sees the car"):
        validate(tall, [best], runs=2)


def test_files_of_buildings_give_what_polygons_do(tmp_path: Path) -> None:
    features = [
        {
            "type": "Feature",
            "properties": {"height": 4.0},
            "geometry": {"type": "Polygon", "coordinates": [[*house, house[0]]]},
        }
        for house in HOUSES
    ]
    collection = {
        "type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": "local"}},
        "features": features,
    }
    (tmp_path / "b.geojson").write_text(json.dumps(collection))
    shapes = "".join(
        f'<poly id="{n}" type="building" shape="{" ".join(f"{x},{y}" for x, y in house)}"/>'
        for n, house in enumerate(HOUSES)
    )
    (tmp_path / "b.poly.xml").write_text(f"<additional>{shapes}</additional>")
    wanted = build_obstacles(street(polygons=HOUSES, height_m=4.0))
    for name in ("b.geojson", "b.poly.xml"):
        data = street().as_dict() | {"obstacles": {"file": name, "height_m": 4.0}}
        found = build_obstacles(instance_from_dict(data, folder=tmp_path))
        np.testing.assert_array_equal(found.height_m, wanted.height_m)
        for ring, other in zip(found.rings, wanted.rings, strict=True):
            assert {tuple(c) for c in ring.tolist()} == {tuple(c) for c in other.tolist()}


def test_an_unknown_kind_of_file_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "b.dxf").write_text("")
    data = street().as_dict() | {"obstacles": {"file": "b.dxf"}}
    with pytest.raises(ValueError, match=r"obstacles\.file must be one of .*b\.dxf"):
        build_obstacles(instance_from_dict(data, folder=tmp_path))
