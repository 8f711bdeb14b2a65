"""Instances whose road is a file with streets: mounts, drives, buildings, refusals."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from models.errors import ErrorModel
from placement.assemble import Scene, assemble, build_errors, build_road
from placement.candidates import build_candidates
from placement.information import compute_information
from placement.information.join import side_by_side, split_samples
from placement.instance import Instance, InstanceError, instance_from_dict
from placement.journeys import journey_roads, sample_road
from placement.network_mounts import place_along
from placement.prediction import predict
from placement.roadway import network_of
from placement.solve import solve
from placement.validation import validate

BLOCK = {"type": "Polygon", "coordinates": [[[20, 8], [80, 8], [80, 60], [20, 60], [20, 8]]]}
LINES = {
    "a": [[0, 0], [100, 0]],
    "b": [[100, 0], [200, 0]],
    "c": [[100, 0], [100, 90]],
    "d": [[100, 90], [200, 90], [200, 0]],
}


def town(**more: Any) -> dict[str, Any]:
    features: list[dict[str, Any]] = [
        {
            "type": "Feature",
            "properties": {"id": name, "width_m": 6.0},
            "geometry": {"type": "LineString", "coordinates": points},
        }
        for name, points in LINES.items()
    ]
    features.append({"type": "Feature", "properties": {"height": 12}, "geometry": BLOCK})
    crs = {"type": "name", "properties": {"name": "local"}}
    return {"type": "FeatureCollection", "crs": crs, "features": features, **more}


@pytest.fixture
def instance(tmp_path: Path) -> Callable[..., Instance]:
    (tmp_path / "town.geojson").write_text(json.dumps(town()))

    def make(**changes: Any) -> Instance:
        data: dict[str, Any] = {
            "road": {"file": "town.geojson", "sample_spacing_m": 2.0},
            "mounts": {"spacing_m": 25.0},
            "camera": {"yaw_deg": [0, 90, 270], "pitch_deg": [30], "fov_deg": [[60, 45]]},
            "errors": {"model": "radius", "persistent": False},
            "objective": {"kind": "trace"},
            "budget": {"cameras": 4},
        }
        for key, value in changes.items():
            table, _, name = key.partition("__")
            data.setdefault(table, {})[name] = value
        return instance_from_dict(data, folder=tmp_path)

    return make


def test_mounts_stand_beside_every_street_and_on_none(
    instance: Callable[..., Instance],
) -> None:
    network = network_of(instance())
    assert network is not None
    mounts, tried = place_along(network, 25.0, 1.5, [1, -1])
    at = shapely.points(mounts.x_m, mounts.y_m)
    for name, points in LINES.items():
        ground = shapely.LineString(points).buffer(3.0, cap_style="flat", join_style="mitre")
        # At a corner the road is the arc that rounds it, not the mitre.
        corners = shapely.MultiPoint([(200, 90), (100, 90), (200, 0)]).buffer(9.5)
        ground = ground.buffer(-0.1).difference(corners)
        assert not ground.intersects(at).any(), name
        # A street of 100 m has four poles on each side, 4.5 m from its middle.
        near = shapely.LineString(points).distance(at) < 4.6
        assert near.sum() >= 2 * (len(points) - 1) * 3, name
    assert not shapely.Polygon(BLOCK["coordinates"][0]).intersects(at).any()
    assert len(mounts.s_m) < tried
    apart = shapely.STRtree(at).query(at, predicate="dwithin", distance=4.99)
    assert len(apart[0]) == len(at)  # each meets itself alone: no pole is there twice


def test_left_sides_of_two_way_streets_hold_no_poles(instance: Callable[..., Instance]) -> None:
    network = network_of(instance())
    assert network is not None
    mounts, _ = place_along(network, 25.0, 1.5, [1])
    assert len(mounts.s_m) == 0
    with pytest.raises(ValueError, match=r"got none of .* places free"):
        build_candidates(instance(mounts__sides=["left"]), build_road(instance()))


def test_localisation_without_traffic_is_about_all_streets(
    instance: Callable[..., Instance],
) -> None:
    made = instance(objective__kind="localisation")
    network, scene = network_of(made), assemble(made)
    assert network is not None
    (journey,) = scene.journeys
    assert not journey.drivable
    assert journey.road.length_m == pytest.approx(network.length_m)
    solution = solve(scene.problem, "greedy")
    sigma = predict(scene, solution.selected).position_sigma_m
    assert sigma.max() <= 0.5 * np.sqrt(2.0) + 1e-12
    assert sigma.min() < 0.5
    with pytest.raises(ValueError, match=r"give the instance a \[traffic\] table"):
        validate(scene, solution.selected, runs=2)


def test_the_localisation_sigma_is_that_of_the_summed_information(
    instance: Callable[..., Instance],
) -> None:
    scene = assemble(instance(objective__kind="localisation"))
    chosen = solve(scene.problem, "greedy").selected
    information = scene.information
    wanted = np.tile(np.eye(2) / 0.25, (information.n_samples, 1, 1))
    for i in chosen:
        rows = slice(information.indptr[i], information.indptr[i + 1])
        for t, block in zip(information.indices[rows], information.blocks[rows], strict=True):
            wanted[t] += float(block[0]) * np.eye(2)
    expected = np.sqrt(np.trace(np.linalg.inv(wanted), axis1=1, axis2=2))
    np.testing.assert_allclose(predict(scene, chosen).position_sigma_m, expected, rtol=1e-6)


def test_drives_are_weighted_and_buildings_hide(instance: Callable[..., Instance]) -> None:
    scene = assemble(instance(traffic__drives=12, traffic__seed=3))
    assert sum(journey.weight for journey in scene.journeys) == pytest.approx(12.0)
    assert all(journey.drivable for journey in scene.journeys)
    assert len(scene.obstacles) == 1
    assert scene.obstacles.height_m[0] == 12.0
    value = scene.problem.objective.value(np.array([0, 5]))
    assert np.isfinite(value)


def test_samples_computed_together_are_those_computed_apart(
    instance: Callable[..., Instance],
) -> None:
    made = instance(traffic__drives=5, errors__model="covariance", errors__persistent=True)
    road = build_road(made)
    cameras = build_candidates(made, road).cameras
    errors: ErrorModel = build_errors(made)
    points = [sample_road(made, driven) for _, driven, _ in journey_roads(made, road)]
    apart = [compute_information(cameras, each, errors, 60.0) for each in points]
    whole = assemble(made.changed({"camera.max_range_m": 60.0}))
    for one, journey in zip(apart, whole.journeys, strict=True):
        other = journey.information
        for name in ("indptr", "indices", "blocks", "white", "offsets"):
            if len(whole.obstacles) == 0:
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    joined = side_by_side(apart)
    again = split_samples(joined, [len(each) for each in points], [1.0] * len(points))
    for one, other in zip(apart, again, strict=True):
        np.testing.assert_array_equal(one.indptr, other.indptr)
        np.testing.assert_array_equal(one.indices, other.indices)
        np.testing.assert_array_equal(one.blocks, other.blocks)
    with pytest.raises(ValueError, match="counts must add up"):
        split_samples(joined, [1], [1.0])


def test_a_file_with_one_road_is_the_path_unless_there_is_traffic(
    tmp_path: Path, instance: Callable[..., Instance]
) -> None:
    line = {"type": "LineString", "coordinates": [[0, 0], [120, 0]]}
    text = json.dumps({**line, "crs": {"type": "name", "properties": {"name": "local"}}})
    (tmp_path / "one.geojson").write_text(text)
    made = instance(road__file="one.geojson", road__width_m=7.0)
    assert network_of(made) is None
    road = build_road(made)
    assert road.length_m == pytest.approx(120.0)
    assert float(road.half_widths([1.0])[0][0]) == 3.5
    scene: Scene = assemble(made)
    assert [journey.name for journey in scene.journeys] == ["forward"]
    both = instance(road__file="one.geojson", objective__drives=["forward", "backward"])
    assert len(assemble(both).journeys) == 2
    busy = assemble(instance(road__file="one.geojson", traffic__drives=6))
    assert {round(journey.road.length_m) for journey in busy.journeys} == {120}


def test_csv_roads_may_have_traffic_too(tmp_path: Path, instance: Callable[..., Instance]) -> None:
    (tmp_path / "road.csv").write_text("x_m,y_m\n0,0\n40,0\n80,5\n120,5\n")
    scene = assemble(instance(road__file="road.csv", traffic__drives=3))
    (journey,) = scene.journeys
    assert journey.weight == 3.0


def test_a_demand_says_who_drives(tmp_path: Path, instance: Callable[..., Instance]) -> None:
    network = network_of(instance())
    assert network is not None
    assert {edge.name for edge in network.edges} == {"a", "-a", "b", "-b"}  # b, c, d are one
    (tmp_path / "od.csv").write_text("from,to,trips\na,b,3\n-b,-a,1\n")
    scene = assemble(instance(traffic__demand="od.csv"))
    assert [journey.weight for journey in scene.journeys] == [3.0, 1.0]
    (tmp_path / "od.csv").write_text("from,to,trips\na,moon,3\n")
    with pytest.raises(ValueError, match=r"od\.csv: demand must be between edges or nodes"):
        assemble(instance(traffic__demand="od.csv"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"objective__drives": ["forward"]}, r"objective\.drives must be left out for a network"),
        ({"traffic__drives": 0}, r"traffic\.drives must"),
        ({"traffic__demand": "none.csv"}, r"traffic\.demand must name a readable file"),
        ({"mounts__spacing_m": 1e-5}, "candidates must number at most"),
        ({"road__sample_spacing_m": 1e-5, "traffic__drives": 50}, "must have at most|must give"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    instance: Callable[..., Instance], changes: dict[str, Any], message: str
) -> None:
    with pytest.raises((ValueError, InstanceError), match=message) as caught:
        assemble(instance(**changes))
    assert "\n" not in str(caught.value)


def test_a_file_of_another_name_is_told_which_names_there_are(
    tmp_path: Path, instance: Callable[..., Instance]
) -> None:
    (tmp_path / "road.dxf").write_text("0\nSECTION\n")
    with pytest.raises(ValueError, match=r"road\.dxf: line .*read as CSV: \.csv, \.xodr"):
        build_road(instance(road__file="road.dxf"))


def test_traffic_needs_a_file() -> None:
    made = instance_from_dict({"road": {"pieces": [{"length": 50}]}, "traffic": {"drives": 2}})
    with pytest.raises(ValueError, match=r"traffic must be left out without road\.file"):
        network_of(made)


def test_poles_of_a_file_are_found_beside_their_street(
    tmp_path: Path, instance: Callable[..., Instance]
) -> None:
    places = [[50.0, -5.0], [150.0, 0.0], [104.5, 45.0]]
    poles = {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": xy}}
            for xy in places
        ],
    }
    (tmp_path / "poles.geojson").write_text(json.dumps(poles))
    base = instance()
    data = base.as_dict()
    data["mounts"] = {"file": "poles.geojson"}
    made = instance_from_dict(data, folder=tmp_path)
    with pytest.warns(UserWarning, match=r"features\[1\] stands on the road"):
        candidates = build_candidates(made, build_road(made))
    assert set(candidates.mount.tolist()) == {0, 2}
    assert candidates.mount_side[0] == -1
    assert candidates.mount_side[2] == -1  # of the carriageway that drives north, on its right


def test_buildings_beside_a_sumo_network_belong_to_the_instance(tmp_path: Path) -> None:
    (tmp_path / "n.net.xml").write_text(
        '<net><edge id="a" from="A" to="B"><lane id="a_0" index="0" speed="9" length="90" '
        'shape="0,0 90,0"/></edge></net>'
    )
    poly = tmp_path / "n.poly.xml"
    poly.write_text('<additional><poly type="building" shape="0,9 9,9 9,19"/></additional>')
    data = {"road": {"file": "n.net.xml"}, "objective": {"kind": "localisation"}}
    with_house = instance_from_dict(data, folder=tmp_path)
    assert len(assemble(with_house).obstacles) == 1
    before = with_house.sha256()
    poly.write_text('<additional><poly type="building" shape="0,9 9,9 9,29"/></additional>')
    assert with_house.sha256() != before
    shutil.copy(poly, tmp_path / "other.poly.xml")
    named = instance_from_dict({**data, "obstacles": {"file": "other.poly.xml"}}, folder=tmp_path)
    assert len(assemble(named).obstacles) == 1  # those named, not those beside as well
