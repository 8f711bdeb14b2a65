"""GeoJSON in any coordinate system, against pyproj and shapely; files that must be refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from models.files.geojson import read_geojson, read_geojson_obstacles
from models.files.geojson_out import collection, crs_name, feature
from models.geometry import Pose
from models.georeference import Georeference
from models.network import RoadNetwork

Read = Callable[..., RoadNetwork]


def line(points: list[list[float]], **properties: Any) -> dict[str, Any]:
    geometry = {"type": "LineString", "coordinates": points}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def polygon(rings: list[list[list[float]]], **properties: Any) -> dict[str, Any]:
    geometry = {"type": "Polygon", "coordinates": rings}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def whole(*features: dict[str, Any], crs: str | None = None) -> dict[str, Any]:
    found: dict[str, Any] = {"type": "FeatureCollection", "features": list(features)}
    if crs is not None:
        found["crs"] = {"type": "name", "properties": {"name": crs}}
    return found


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def reader(content: Any, **more: Any) -> RoadNetwork:
        path = tmp_path / "a.geojson"
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        return read_geojson(path, **more)

    return reader


DEGREES = [[9.99, 48.0], [10.0, 48.001], [10.02, 48.0]]


@pytest.mark.parametrize("crs", [None, "EPSG:4326", "urn:ogc:def:crs:OGC:1.3:CRS84"])
def test_degrees_become_metres_of_the_ellipsoid(read: Read, crs: str | None) -> None:
    network = read(whole(line(DEGREES), crs=crs))
    length = pyproj.Geod(ellps="WGS84").line_length(*np.array(DEGREES).T)
    assert network.edges[0].stated_length_m == pytest.approx(length, rel=1e-5)
    assert network.centreline is not None
    places = network.centreline.evaluate([0.0, network.centreline.length_m]).xy
    np.testing.assert_allclose(
        network.georeference.to_file(places), [DEGREES[0], DEGREES[-1]], atol=1e-9
    )


@pytest.mark.parametrize("crs", ["EPSG:25832", "EPSG:3857", "EPSG:2263", "EPSG:31468"])
def test_any_system_leads_to_the_same_metres_and_back(read: Read, crs: str) -> None:
    middle = (-74.0, 40.7) if crs == "EPSG:2263" else (11.5, 48.1)
    degrees = np.array(middle) + np.array([[0.0, 0.0], [0.004, 0.0], [0.004, 0.003]])
    to = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    points = np.column_stack(to.transform(*degrees.T))
    network = read(whole(line(points.tolist()), crs=crs))
    where = network.georeference
    street = network.edges[0].stated_length_m
    if crs != "EPSG:3857":  # which stretches by 1/cos(latitude): its metres are taken at their word
        geodesic = pyproj.Geod(ellps="WGS84").line_length(*degrees.T)
        assert street == pytest.approx(geodesic, rel=1e-3)
    ends = network.centreline.evaluate([0.0]).xy if network.centreline else np.empty((0, 2))
    np.testing.assert_allclose(where.to_file(ends), points[:1], atol=1e-3)
    np.testing.assert_allclose(where.to_road(points[:1]), ends, atol=1e-3)


def test_lines_meet_at_shared_vertices_and_bring_their_properties(read: Read) -> None:
    content = whole(
        line([[0, 0], [50, 0], [100, 0]], id="main", lanes=4, width_m=14.0, speed_mps=20.0),
        line([[50, 0.004], [50, 80]], oneway=True, maxspeed="30"),
        crs="local",
    )
    network = read(content)
    assert {edge.name for edge in network.edges} == {"main", "-main", "main#2", "-main#2", "1"}
    main = next(edge for edge in network.edges if edge.name == "main")
    assert (len(main.lanes), main.width_m, main.speed_mps) == (2, 7.0, 20.0)
    assert network.parts == 1
    assert network.georeference.file_crs is None
    assert network.centreline is None


def test_a_closed_line_is_a_closed_road(read: Read) -> None:
    network = read(whole(line([[0, 0], [80, 0], [80, 60], [0, 60], [0, 0]]), crs="local"))
    assert network.centreline is not None
    assert network.centreline.closed
    assert network.edges[0].start == network.edges[0].end


def test_polygons_are_buildings_with_holes_and_heights(read: Read) -> None:
    square = [[0, 10], [20, 10], [20, 30], [0, 30], [0, 10]]
    hole = [[5, 15], [15, 15], [15, 25], [5, 25], [5, 15]]
    content = whole(
        line([[0, 0], [50, 0]]),
        polygon([square, hole], height=7),
        polygon([[[30, 10], [40, 20], [40, 10], [30, 20], [30, 10]]]),
        crs="local",
    )
    network = read(content)
    area = sum(shapely.Polygon(ring).area for ring in network.obstacles.rings)
    assert area == pytest.approx(400.0 - 100.0 + 50.0)
    assert network.ignored["buildings that crossed themselves (mended)"] == 1
    assert set(network.obstacles.height_m) == {7.0, 10.0}


def test_other_geometries_are_told(read: Read) -> None:
    point = {"type": "Feature", "geometry": {"type": "Point", "coordinates": [0, 0]}}
    network = read(whole(line(DEGREES), point, {"type": "Feature", "geometry": None}))
    assert network.ignored["geometries of type Point"] == 1
    assert network.ignored["features without geometry"] == 1


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "the file is empty"),
        ("{", "not JSON"),
        ("[" * 100_000, "nested too deeply"),
        ("[]", "must be a GeoJSON object"),
        ({"type": "Topology"}, "type must be a GeoJSON one"),
        (whole(), "at least one line with a length"),
        (whole(line([[0, 0]])), "at least 2 positions"),
        (whole(line([[0, 0], [0, 0]])), "at least one line with a length"),
        (whole(line([[0, 0], ["a", 0]])), "must be .x, y. pairs"),
        (whole(line([[500000, 5400000], [500100, 5400000]])), "or the file name its crs"),
        (whole(line(DEGREES), crs="EPSG:999999"), "PROJ knows"),
        (whole(line(DEGREES), crs="mars"), "PROJ knows"),
        ('{"type":"LineString","coordinates":[[0,NaN],[1,1]]}', "NaN is no number of JSON"),
        ('{"type":"LineString","coordinates":[[0,1e999],[1,1]]}', "must be finite"),
    ],
)
def test_what_is_wrong_is_named_in_one_line(read: Read, content: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        read(content)
    assert "\n" not in str(caught.value)


def test_obstacles_of_another_system_land_in_the_road_s_frame(tmp_path: Path) -> None:
    where = Georeference("EPSG:4326", "EPSG:32632", Pose(500_000.0, 5_300_000.0))
    corners = np.array([[10.0, 20.0], [30.0, 20.0], [30.0, 40.0]])
    degrees = where.to_file(corners)
    path = tmp_path / "b.geojson"
    path.write_text(json.dumps(whole(polygon([[*degrees.tolist(), degrees[0].tolist()]]))))
    (ring,) = read_geojson_obstacles(path, where).rings
    np.testing.assert_allclose(ring, corners, atol=1e-6)


@given(
    st.lists(st.tuples(st.floats(-2000, 2000), st.floats(-2000, 2000)), min_size=2, max_size=8),
    st.sampled_from([None, "EPSG:4326", "EPSG:32632", "EPSG:3035"]),
)
@settings(max_examples=40, deadline=None)
def test_what_is_written_reads_back(points: list[tuple[float, float]], crs: str | None) -> None:
    metric = "EPSG:32632" if crs == "EPSG:4326" else crs
    place = Pose() if crs is None else Pose(600_000.0, 5_300_000.0)
    if crs == "EPSG:3035":
        place = Pose(4_321_000.0, 2_800_000.0)
    where = Georeference(crs, metric, place)
    xy = np.array(points)
    text = json.dumps(collection([feature("LineString", where.to_file(xy), where, {})], where))
    back = json.loads(text)
    assert crs_name(where) == (crs or "local")
    assert ("crs" in back) == (crs != "EPSG:4326")
    coordinates = np.array(back["features"][0]["geometry"]["coordinates"])
    np.testing.assert_allclose(where.to_road(coordinates), xy, atol=1e-3)
