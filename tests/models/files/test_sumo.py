"""SUMO networks against sumolib, small files of known form, and all of Luxembourg."""

from __future__ import annotations

import gzip
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely

from models.files.sumo import read_sumo, read_sumo_polygons
from models.network import RoadNetwork

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import sumolib

LOCATION = (
    '<location netOffset="-500000.00,-5400000.00" convBoundary="0,0,100,100" '
    'origBoundary="9,48,10,49" projParameter="EPSG:32632"/>'
)
CROSS = (
    LOCATION
    + """
<edge id=":J_0" function="internal">
  <lane id=":J_0_0" index="0" speed="6" length="9" shape="50.00,-1.60 55.00,-3.00 56.60,-8.00"/>
</edge>
<edge id="a" from="A" to="J" priority="1">
  <lane id="a_0" index="0" speed="13.9" length="50.00" shape="0.00,-1.60 50.00,-1.60"/>
  <lane id="a_1" index="1" speed="13.9" length="50.00" width="3.0" shape="0,1.5 50,1.5"/>
</edge>
<edge id="b" from="J" to="B" priority="1">
  <lane id="b_0" index="0" speed="8" length="40.00" shape="56.60,-8.00 56.60,-48.00"/>
</edge>
<edge id="tram" from="J" to="B"><lane id="tram_0" index="0" allow="tram" speed="8" length="1"
  shape="0,0 1,0"/></edge>
<edge id="walk" function="walkingarea"><lane id="walk_0" index="0" shape="0,0 1,0"/></edge>
<junction id="A" type="dead_end" x="0" y="0" incLanes="" intLanes=""
  shape="0,0 1,0 1,1"/><junction id="J" type="priority" x="55" y="0" incLanes="" intLanes=""
  shape="0,0 1,0 1,1"/>
<junction id="B" type="dead_end" x="56" y="-48" incLanes="" intLanes=""
  shape="0,0 1,0 1,1"/>
<connection from="a" to="b" fromLane="0" toLane="0" via=":J_0_0" dir="r" state="M"/>
<connection from=":J_0" to="b" fromLane="0" toLane="0" dir="r" state="M"/>
"""
)


def write_net(folder: Path, text: str, name: str = "a.net.xml") -> Path:
    path = folder / name
    content = f'<net version="1.16">{text}</net>'
    if name.endswith(".gz"):
        path.write_bytes(gzip.compress(content.encode()))
    else:
        path.write_text(content)
    return path


@pytest.mark.parametrize("name", ["a.net.xml", "a.net.xml.gz"])
def test_edges_lanes_and_turns_are_read(tmp_path: Path, name: str) -> None:
    network = read_sumo(write_net(tmp_path, CROSS, name))
    a, b = network.edges
    assert (a.name, a.start, a.end, len(a.lanes), a.width_m) == ("a", "A", "J", 2, 6.2)
    assert a.length_m == pytest.approx(50.0)
    assert (a.lanes[0].left_m, a.lanes[0].right_m) == pytest.approx((4.6, 1.6))
    assert (a.lanes[1].left_m, a.lanes[1].right_m) == pytest.approx((1.5, 4.7))
    assert b.speed_mps == 8.0
    (turn,) = network.turns
    assert (turn.from_edge, turn.to_edge, turn.from_lane) == (0, 1, 0)
    assert turn.path is not None
    np.testing.assert_allclose(turn.path.outline[0], [50.0, -1.6])
    np.testing.assert_allclose(turn.path.outline[-1], [56.6, -8.0])
    assert network.ignored["edges closed to passenger cars"] == 1
    assert network.ignored["edges of function walkingarea"] == 1
    assert network.nodes["J"] == (55.0, 0.0)


def test_opposite_carriageways_are_one_street_whatever_their_names(tmp_path: Path) -> None:
    def edge(name: str, start: str, end: str, y: float) -> str:
        return (
            f'<edge id="{name}" from="{start}" to="{end}"><lane id="{name}_0" index="0" speed="9" '
            f'length="90" shape="0,{y} 90,{y}"/></edge>'
        )

    text = edge("x", "A", "B", 0) + edge("y", "B", "A", 3) + edge("z", "B", "A", 300)
    streets = [each.street for each in read_sumo(write_net(tmp_path, text)).edges]
    assert streets == ["x", "x", "z"]


def test_coordinates_lead_back_to_the_projection(tmp_path: Path) -> None:
    where = read_sumo(write_net(tmp_path, CROSS)).georeference
    np.testing.assert_allclose(
        where.to_file(np.array([[10.0, 20.0]])), [[500010.0, 5400020.0]], atol=1e-6
    )


def test_the_reader_agrees_with_sumolib(tmp_path: Path) -> None:
    path = write_net(tmp_path, CROSS)
    theirs, ours = sumolib.net.readNet(str(path)), read_sumo(path)
    for edge in ours.edges:
        other = theirs.getEdge(edge.name)
        assert other.getFromNode().getID() == edge.start
        for n, lane in enumerate(edge.lanes):
            np.testing.assert_allclose(lane.outline, np.array(other.getLane(n).getShape()))
    assert set(theirs.getEdge("a").getOutgoing()) == {theirs.getEdge("b")}


def test_buildings_beside_the_network_are_read_and_others_counted(tmp_path: Path) -> None:
    (tmp_path / "a.poly.xml").write_text(
        '<additional><poly id="1" type="building" shape="0,0 4,0 4,4 0,4 0,0"/>'
        '<poly id="2" type="building.house" shape="10,0 14,4 14,0 10,4"/>'
        '<poly id="3" type="water" shape="0,0 4,0 4,4"/>'
        '<poly id="4" type="building" shape="9,9 9,9 9,9"/>'
        '<poly id="5" type="building" shape="20,0 24,0 24,4"><param key="building:levels" '
        'value="4"/></poly><poi id="p" x="1" y="1"/></additional>'
    )
    network = read_sumo(write_net(tmp_path, CROSS))
    assert network.ignored["polygons that are no buildings"] == 1
    assert network.ignored["buildings that crossed themselves (mended)"] == 1
    assert network.ignored["buildings that enclose nothing"] == 1
    areas = [shapely.Polygon(ring).area for ring in network.obstacles.rings]
    assert sum(areas) == pytest.approx(16.0 + 8.0 + 8.0)
    assert sorted(set(network.obstacles.height_m)) == [10.0, 12.0]
    assert len(read_sumo(tmp_path / "a.net.xml", beside=False).obstacles) == 0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('projParameter="EPSG:32632"', 'projParameter="EPSG:999999"', "PROJ knows"),
        ('shape="0.00,-1.60 50.00,-1.60"', 'shape="0,x 5,5"', "shape must be x,y pairs"),
        ('shape="0.00,-1.60 50.00,-1.60"', 'shape="0,nan 5,5"', "shape must be finite"),
        ('id="b" from="J"', 'id="b" ', "must have from and to"),
        ('id="b" from', 'id="a" from', "id must differ"),
        ('speed="8"', 'speed="fast"', "speed must be a number"),
        ('netOffset="-500000.00,-5400000.00"', 'netOffset="0"', "netOffset must be 2 numbers"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        read_sumo(write_net(tmp_path, CROSS.replace(old, new)))
    assert "\n" not in str(caught.value)


def test_a_network_without_streets_for_cars_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least one edge that passenger cars may use"):
        read_sumo(write_net(tmp_path, ""))
    text = CROSS[CROSS.index('<edge id="tram"') : CROSS.index('<edge id="walk"')]
    with pytest.raises(ValueError, match="left out: 1 lanes closed"):
        read_sumo(write_net(tmp_path, text))


def test_an_edge_without_length_is_told_and_left_out(tmp_path: Path) -> None:
    text = CROSS.replace("56.60,-8.00 56.60,-48.00", "56.60,-8.00 56.60,-8.00")
    network = read_sumo(write_net(tmp_path, text))
    assert network.ignored["edges without length"] == 1
    assert [edge.name for edge in network.edges] == ["a"]


@pytest.fixture(scope="module")
def luxembourg(shared_data: Callable[[str], Path]) -> RoadNetwork:
    return read_sumo(shared_data("lust/luxembourg.net.xml.gz"))


@pytest.mark.slow
def test_luxembourg_has_the_length_its_lanes_claim(luxembourg: RoadNetwork) -> None:
    stated = sum(edge.stated_length_m or 0.0 for edge in luxembourg.edges)
    assert len(luxembourg.edges) == 5740
    assert stated == pytest.approx(903_555, abs=1.0)
    assert luxembourg.length_m == pytest.approx(stated, rel=0.01)
    assert luxembourg.parts == 1


@pytest.mark.slow
def test_luxembourg_s_buildings_are_all_there(luxembourg: RoadNetwork) -> None:
    # 13,567 things of that type, 15 of which are points
    assert len(luxembourg.obstacles) == 13_552
    assert luxembourg.ignored["points of interest"] == 26


def test_polygons_alone_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "b.poly.xml"
    path.write_text('<additional><poly type="building" shape="0,0,5 4,0,5 4,4,5"/></additional>')
    assert len(read_sumo_polygons(path, 8.0)) == 1
