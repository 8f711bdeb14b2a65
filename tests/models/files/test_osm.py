"""OpenStreetMap extracts: tags, junctions, restrictions, buildings; XML and PBF alike."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely

from models.files.osm import read_osm
from models.files.osm_tags import building_height_m, length_m, speed_mps, street_of

# A cross of four streets about node 1, 0.001° long each, and a square building.
NODES = {
    1: (10.0, 48.0), 2: (10.001, 48.0), 3: (9.999, 48.0), 4: (10.0, 48.001), 5: (10.0, 47.999),
    11: (10.0003, 48.0003), 12: (10.0005, 48.0003), 13: (10.0005, 48.0005), 14: (10.0003, 48.0005),
    15: (10.00035, 48.00035), 16: (10.00045, 48.00035), 17: (10.00045, 48.00045),
}  # fmt: skip
CROSS = {
    "21": ([3, 1], {"highway": "residential"}),
    "22": ([1, 2], {"highway": "residential"}),
    "23": ([5, 1, 4], {"highway": "secondary", "lanes": "2", "maxspeed": "30 mph"}),
}
HOUSE = {"31": ([11, 12, 13, 14, 11], {"building": "yes", "height": "12.5 m"})}
RESTRICTION = (
    '<relation id="41"><member type="way" ref="21" role="from"/>'
    '<member type="node" ref="1" role="via"/><member type="way" ref="23" role="to"/>'
    '<tag k="type" v="restriction"/><tag k="restriction" v="{kind}"/></relation>'
)

Ways = dict[str, tuple[list[int], dict[str, str]]]


def osm_text(ways: Ways, more: str = "", without: tuple[int, ...] = ()) -> str:
    lines = ['<osm version="0.6">']
    lines += [
        f'<node id="{i}" lon="{x}" lat="{y}" version="1"/>'
        for i, (x, y) in NODES.items()
        if i not in without
    ]
    for ref, (nodes, tags) in ways.items():
        inner = "".join(f'<nd ref="{node}"/>' for node in nodes)
        inner += "".join(f'<tag k="{k}" v="{v}"/>' for k, v in tags.items())
        lines.append(f'<way id="{ref}" version="1">{inner}</way>')
    return "\n".join([*lines, more, "</osm>"])


def write_osm(folder: Path, ways: Ways, more: str = "", without: tuple[int, ...] = ()) -> Path:
    path = folder / "a.osm"
    path.write_text(osm_text(ways, more, without))
    return path


def test_streets_meet_at_shared_nodes_and_their_lengths_are_geodesic(tmp_path: Path) -> None:
    network = read_osm(write_osm(tmp_path, CROSS | HOUSE))
    assert len(network.edges) == 8
    east = next(edge for edge in network.edges if edge.name == "22")
    geodesic = pyproj.Geod(ellps="WGS84").line_length([10.0, 10.001], [48.0, 48.0])
    assert east.stated_length_m == pytest.approx(geodesic, rel=1e-6)
    assert (east.start, east.end) == ("1", "2")
    north = next(edge for edge in network.edges if edge.kind == "highway.secondary")
    assert north.speed_mps == pytest.approx(30 * 0.44704)
    # Straight on and left and right from each of four arms; back only where a street ends.
    assert len(network.turns) == 4 * 3 + 4


def test_a_lane_lies_on_the_right_of_its_line_and_ends_short_of_the_junction(
    tmp_path: Path,
) -> None:
    network = read_osm(write_osm(tmp_path, CROSS))
    middle = network.georeference.to_road(np.array([NODES[1], NODES[2]]))
    east = next(edge for edge in network.edges if edge.name == "22")
    road = east.road
    begin, end = road.evaluate([0.0, road.length_m]).xy
    assert begin[1] == pytest.approx(middle[0, 1] - 1.5, abs=0.01)
    assert begin[0] - middle[0, 0] == pytest.approx(0.5 * 6.5 + 3.0, abs=0.01)
    assert end[0] == pytest.approx(middle[1, 0], abs=0.01)


@pytest.mark.parametrize(
    ("kind", "allowed"), [("no_left_turn", {"22", "-21"} - {"-21"}), ("only_left_turn", set())]
)
def test_turn_restrictions_are_obeyed(tmp_path: Path, kind: str, allowed: set[str]) -> None:
    text = RESTRICTION.replace("{kind}", kind)
    network = read_osm(write_osm(tmp_path, CROSS, text))
    start = next(i for i, edge in enumerate(network.edges) if edge.name == "21")
    onward = {network.edges[turn.to_edge] for turn in network.turns if turn.from_edge == start}
    streets = {edge.kind for edge in onward}
    assert streets == ({"highway.residential"} if allowed else {"highway.secondary"})


def test_ways_that_go_on_alike_are_one_edge(tmp_path: Path) -> None:
    ways: Ways = {
        "21": ([3, 1], {"highway": "residential"}),
        "22": ([2, 1], {"highway": "residential"}),
    }
    network = read_osm(write_osm(tmp_path, ways))
    assert len(network.edges) == 2
    assert set(network.nodes) == {"2", "3"}


def test_one_way_streets_and_closed_ones(tmp_path: Path) -> None:
    ways: Ways = {
        "21": ([3, 1], {"highway": "residential", "oneway": "yes"}),
        "22": ([1, 2], {"highway": "residential", "oneway": "-1"}),
        "23": ([1, 4], {"highway": "residential", "access": "private"}),
        "24": ([1, 5], {"highway": "footway"}),
    }
    network = read_osm(write_osm(tmp_path, ways))
    assert {(edge.start, edge.end) for edge in network.edges} == {("3", "1"), ("2", "1")}
    assert network.ignored["streets closed to the public's cars"] == 1
    assert network.ignored["ways that are no streets for cars"] == 1


def test_missing_nodes_cut_a_way_and_are_told(tmp_path: Path) -> None:
    network = read_osm(write_osm(tmp_path, CROSS | HOUSE, without=(4, 13)))
    assert network.ignored["nodes outside the extract"] == 2
    assert network.ignored["buildings cut by the extract"] == 1
    assert len(network.edges) == 6


def test_buildings_of_relations_have_their_holes(tmp_path: Path) -> None:
    ways: Ways = {
        "31": ([11, 12, 13], {}),
        "32": ([11, 14, 13], {}),
        "33": ([15, 16, 17, 15], {}),
    }
    relation = (
        '<relation id="51"><member type="way" ref="31" role="outer"/>'
        '<member type="way" ref="32" role="outer"/><member type="way" ref="33" role="inner"/>'
        '<tag k="type" v="multipolygon"/><tag k="building" v="yes"/>'
        '<tag k="building:levels" v="3"/></relation>'
    )
    network = read_osm(write_osm(tmp_path, CROSS | ways, relation))
    assert set(network.obstacles.height_m) == {9.0}
    area = sum(shapely.Polygon(ring).area for ring in network.obstacles.rings)
    geod = pyproj.Geod(ellps="WGS84")
    outer = abs(geod.polygon_area_perimeter(*np.array([NODES[n] for n in (11, 12, 13, 14)]).T)[0])
    inner = abs(geod.polygon_area_perimeter(*np.array([NODES[n] for n in (15, 16, 17)]).T)[0])
    assert area == pytest.approx(outer - inner, rel=1e-4)


def test_pbf_gives_the_same_network_as_xml(tmp_path: Path) -> None:
    import osmium

    path = write_osm(tmp_path, CROSS | HOUSE, RESTRICTION.replace("{kind}", "no_left_turn"))
    packed = tmp_path / "a.osm.pbf"
    with osmium.SimpleWriter(str(packed)) as writer:
        for each in osmium.FileProcessor(str(path)):
            writer.add(each)
    a, b = read_osm(path), read_osm(packed)
    assert [edge.name for edge in a.edges] == [edge.name for edge in b.edges]
    assert len(a.turns) == len(b.turns)
    for one, other in zip(a.edges, b.edges, strict=True):
        np.testing.assert_allclose(one.lanes[0].outline, other.lanes[0].outline, atol=1e-6)
    np.testing.assert_allclose(a.obstacles.rings[0], b.obstacles.rings[0], atol=1e-6)


@pytest.mark.parametrize("content", [b"", b"no protocol buffer", bytes(range(256)) * 4])
def test_a_damaged_pbf_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.osm.pbf"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="OpenStreetMap extract") as caught:
        read_osm(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('lat="48.0"', 'lat="148"', "longitude and latitude"),
        ('lat="48.0"', 'lat="here"', "longitude and latitude"),
        ('<nd ref="3"/>', '<nd ref="x"/>', "must be a whole number"),
        ("highway", "lowway", "at least one street for cars"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "a.osm"
    path.write_text(osm_text(CROSS).replace(old, new))
    with pytest.raises(ValueError, match=message) as caught:
        read_osm(path)
    assert "\n" not in str(caught.value)


def test_the_shared_town_has_its_streets_and_buildings(shared_data: Callable[[str], Path]) -> None:
    network = read_osm(shared_data("osm/town_10.068_48.135.osm"))
    assert len(network.obstacles) == 33
    assert network.parts == 1
    assert sum(e.stated_length_m or 0.0 for e in network.edges) == pytest.approx(557.8, abs=0.5)


@pytest.mark.parametrize(
    ("tags", "lanes", "width", "speed_kmh"),
    [
        ({"highway": "residential"}, (1, 1), 6.0, 50.0),
        ({"highway": "residential", "lanes": "1"}, (1, 1), 3.0, 50.0),
        ({"highway": "primary", "lanes": "3", "lanes:forward": "2"}, (2, 1), 9.75, 70.0),
        ({"highway": "motorway", "lanes": "3", "maxspeed": "none"}, (3, 0), 10.5, 120.0),
        ({"highway": "tertiary", "width": "7,5", "maxspeed": "30"}, (1, 1), 7.5, 30.0),
        ({"highway": "tertiary", "junction": "roundabout"}, (1, 0), 3.0, 50.0),
        ({"highway": "residential", "oneway": "-1", "lanes": "2"}, (0, 2), 6.0, 50.0),
        ({"highway": "residential", "lanes": "many", "width": "wide"}, (1, 1), 6.0, 50.0),
    ],
)
def test_tags_say_how_a_street_is(
    tags: dict[str, str], lanes: tuple[int, int], width: float, speed_kmh: float
) -> None:
    street = street_of(tags)
    assert (street.forward, street.backward) == lanes
    assert street.width_m == pytest.approx(width)
    assert 3.6 * street.speed_mps == pytest.approx(speed_kmh)


@pytest.mark.parametrize(
    ("text", "metres"),
    [("12", 12.0), ("12.5 m", 12.5), ("7,5", 7.5), ("24'", 7.3152), ("6'6\"", 1.9812),
     ("30 ft", 9.144), ("1e9", None), ("-3", None), ("tall", None), (None, None)],
)  # fmt: skip
def test_lengths_are_read_with_their_units(text: str | None, metres: float | None) -> None:
    found = length_m(text)
    assert found is None if metres is None else found == pytest.approx(metres)


def test_speeds_and_heights_fall_back_where_they_say_nothing() -> None:
    assert speed_mps("DE:urban") is None
    assert speed_mps("50;30") == pytest.approx(50 / 3.6)
    assert building_height_m({"building:levels": "4", "roof:levels": "1"}) == 15.0
    assert building_height_m({"height": "unknown"}, 8.0) == 8.0
    assert math.isfinite(building_height_m({}))
