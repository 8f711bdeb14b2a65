"""Lanes, links and junctions of OpenDRIVE files: small ones of known form, and the shared ones."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from models.files.opendrive import read_opendrive
from models.geometry import Pose
from models.network import RoadNetwork

FILES = ("crest-curve", "curve_r100", "curves", "e6mini", "fabriksgatan", "soderleden",
         "two_plus_one")  # fmt: skip


def geometry(
    s: float, x: float, y: float, hdg: float, length: float, shape: str = "<line/>"
) -> str:
    return f'<geometry s="{s}" x="{x}" y="{y}" hdg="{hdg}" length="{length}">{shape}</geometry>'


def lane(id_: int, *, width: float = 3.5, kind: str = "driving", link: str = "") -> str:
    return (
        f'<lane id="{id_}" type="{kind}"><link>{link}</link>'
        f'<width sOffset="0" a="{width}" b="0" c="0" d="0"/></lane>'
    )


def section(s: float = 0.0, left: str = "", right: str = "", more: str = "") -> str:
    return (
        f'<laneSection s="{s}" {more}><left>{left}</left><center><lane id="0"/></center>'
        f"<right>{right}</right></laneSection>"
    )


def road(
    id_: str, view: str, lanes: str, *, link: str = "", junction: str = "-1", more: str = ""
) -> str:
    return (
        f'<road id="{id_}" junction="{junction}" length="0" {more}><link>{link}</link>'
        f"<planView>{view}</planView><lanes>{lanes}</lanes></road>"
    )


@pytest.fixture
def read(tmp_path: Path) -> Callable[..., RoadNetwork]:
    def reader(*parts: str, header: str = "") -> RoadNetwork:
        path = tmp_path / "a.xodr"
        path.write_text(
            f'<OpenDRIVE><header revMajor="1" revMinor="6">{header}</header>{"".join(parts)}'
            "</OpenDRIVE>"
        )
        return read_opendrive(path)

    return reader


def ends(network: RoadNetwork, edge: int, n: int = 0) -> np.ndarray:
    driven = network.edges[edge].lanes[n].road
    return driven.evaluate([0.0, driven.length_m]).xy


TWO_WAY = section(left=lane(1), right=lane(-1))


def test_a_two_way_road_has_a_carriageway_on_each_side(read: Callable[..., RoadNetwork]) -> None:
    network = read(road("7", geometry(0, 10, 5, 0, 100), TWO_WAY))
    assert [edge.name for edge in network.edges] == ["7+", "7-"]
    np.testing.assert_allclose(ends(network, 0), [[10, 3.25], [110, 3.25]], atol=1e-9)
    np.testing.assert_allclose(ends(network, 1), [[110, 6.75], [10, 6.75]], atol=1e-9)
    left, right = network.edges[0].road.half_widths([50.0])
    assert (left[0], right[0]) == pytest.approx((1.75, 1.75))
    assert network.edges[0].start == network.edges[1].end
    whole = network.centreline
    assert whole is not None
    assert whole.length_m == pytest.approx(100.0)
    assert [float(side[0]) for side in whole.half_widths([1.0])] == pytest.approx([3.5, 3.5])


def test_left_hand_traffic_drives_on_the_left(read: Callable[..., RoadNetwork]) -> None:
    network = read(road("7", geometry(0, 0, 0, 0, 100), TWO_WAY, more='rule="LHT"'))
    np.testing.assert_allclose(ends(network, 0), [[0, 1.75], [100, 1.75]], atol=1e-9)
    np.testing.assert_allclose(ends(network, 1), [[100, -1.75], [0, -1.75]], atol=1e-9)


def test_offsets_and_widths_are_cubics_of_s(read: Callable[..., RoadNetwork]) -> None:
    lanes = (
        '<laneOffset s="0" a="0" b="0" c="0" d="0"/>'
        '<laneOffset s="20" a="0" b="0.05" c="0.001" d="0"/>'
    ) + section(
        right='<lane id="-1" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/>'
        '<width sOffset="30" a="3" b="0.02" c="0" d="1e-5"/></lane>'
    )
    driven = read(road("1", geometry(0, 0, 0, 0, 80), lanes)).edges[0].lanes[0].road
    s = np.linspace(0.0, driven.length_m, 200)
    at = driven.evaluate(s)
    x = at.x_m
    offset = np.where(x < 20, 0.0, 0.05 * (x - 20) + 0.001 * (x - 20) ** 2)
    width = np.where(x < 30, 3.0, 3.0 + 0.02 * (x - 30) + 1e-5 * (x - 30) ** 3)
    np.testing.assert_allclose(at.y_m, offset - 0.5 * width, atol=1e-9)
    left, right = driven.half_widths(s)
    np.testing.assert_allclose(left, 0.5 * width, atol=2e-3)
    np.testing.assert_allclose(right, 0.5 * width, atol=2e-3)


def test_borders_may_stand_for_widths(read: Callable[..., RoadNetwork]) -> None:
    lanes = section(
        right='<lane id="-1" type="driving"><border sOffset="0" a="-3" b="0" c="0" d="0"/></lane>'
        '<lane id="-2" type="driving"><border sOffset="0" a="-7" b="0" c="0" d="0"/></lane>'
    )
    network = read(road("1", geometry(0, 0, 0, 0, 80), lanes))
    assert len(network.edges[0].lanes) == 2
    np.testing.assert_allclose(ends(network, 0, 0)[:, 1], -5.0, atol=1e-9)  # rightmost first
    np.testing.assert_allclose(ends(network, 0, 1)[:, 1], -1.5, atol=1e-9)


def test_a_lane_follows_its_links_from_section_to_section(read: Callable[..., RoadNetwork]) -> None:
    # A lane is added on the left, so that −1 becomes −2; the offset keeps it where it was.
    lanes = (
        '<laneOffset s="0" a="0" b="0" c="0" d="0"/><laneOffset s="50" a="3.5" b="0" c="0" d="0"/>'
        + section(right=lane(-1, link='<successor id="-2"/>'))
        + section(50, right=lane(-1) + lane(-2, link='<predecessor id="-1"/>'))
    )
    network = read(road("1", geometry(0, 0, 0, 0, 100), lanes))
    (edge,) = network.edges
    assert len(edge.lanes) == 1  # the other one does not run from end to end
    s = np.linspace(0.0, 100.0, 30)
    np.testing.assert_allclose(edge.road.evaluate(s).y_m, -1.75, atol=1e-9)
    left, _ = edge.road.half_widths([20.0, 80.0])
    np.testing.assert_allclose(left, [1.75, 5.25], atol=1e-6)


def test_a_road_no_lane_of_which_runs_through_gets_one_that_slides_over(
    read: Callable[..., RoadNetwork],
) -> None:
    lanes = section(right=lane(-1)) + section(
        50, right=lane(-1, kind="median", width=4.0) + lane(-2)
    )
    (edge,) = read(road("1", geometry(0, 0, 0, 0, 100), lanes)).edges
    y = edge.road.evaluate(np.linspace(0.0, edge.length_m, 400)).y_m
    assert (y[0], y[-1]) == pytest.approx((-1.75, -5.75))
    assert np.abs(np.diff(y)).max() < 0.1
    heading = edge.road.evaluate(np.linspace(0.0, edge.length_m, 400)).heading_rad
    assert np.abs(np.diff(heading)).max() < 0.05


@pytest.mark.parametrize("contact", ["start", "end"])
def test_linked_roads_share_a_node_and_turns(
    read: Callable[..., RoadNetwork], contact: str
) -> None:
    lanes = TWO_WAY
    first = road(
        "1",
        geometry(0, 0, 0, 0, 50),
        section(
            left=lane(1, link=f'<successor id="{1 if contact == "start" else -1}"/>'),
            right=lane(-1, link=f'<successor id="{-1 if contact == "start" else 1}"/>'),
        ),
        link=f'<successor elementType="road" elementId="2" contactPoint="{contact}"/>',
    )
    place = (50, 0, 0) if contact == "start" else (90, 0, math.pi)
    sign = -1 if contact == "start" else 1
    tag = "predecessor" if contact == "start" else "successor"
    second = road(
        "2",
        geometry(0, *place, 40),
        section(
            left=lane(1, link=f'<{tag} id="{-sign}"/>'),
            right=lane(-1, link=f'<{tag} id="{sign}"/>'),
        ),
        link=f'<{tag} elementType="road" elementId="1" contactPoint="end"/>',
    )
    network = read(first, second)
    assert lanes
    assert len(network.nodes) == 3
    pairs = {
        (network.edges[t.from_edge].name, network.edges[t.to_edge].name) for t in network.turns
    }
    assert pairs == (
        {("1+", "2+"), ("2-", "1-")} if contact == "start" else {("1+", "2-"), ("2+", "1-")}
    )
    for turn in network.turns:
        a = network.edges[turn.from_edge].lanes[turn.from_lane].road
        b = network.edges[turn.to_edge].lanes[turn.to_lane].road
        np.testing.assert_allclose(a.evaluate([a.length_m]).xy, b.evaluate([0.0]).xy, atol=1e-9)


def test_connecting_roads_of_a_junction_are_turns(read: Callable[..., RoadNetwork]) -> None:
    radius = 10.0
    corner = f'<arc curvature="{-1 / radius}"/>'
    quarter = 0.5 * math.pi * radius
    incoming = road(
        "1", geometry(0, 0, 0, 0, 50), section(right=lane(-1)),
        link='<successor elementType="junction" elementId="9"/>',
    )  # fmt: skip
    outgoing = road(
        "2", geometry(0, 60, -10, -0.5 * math.pi, 30), section(right=lane(-1)),
        link='<predecessor elementType="junction" elementId="9"/>',
    )  # fmt: skip
    through = road(
        "3", geometry(0, 50, 0, 0, quarter, corner),
        section(right=lane(-1, link='<predecessor id="-1"/><successor id="-1"/>')), junction="9",
        link='<predecessor elementType="road" elementId="1" contactPoint="end"/>'
        '<successor elementType="road" elementId="2" contactPoint="start"/>',
    )  # fmt: skip
    junction = (
        '<junction id="9"><connection id="0" incomingRoad="1" connectingRoad="3" '
        'contactPoint="start"><laneLink from="-1" to="-1"/></connection></junction>'
    )
    network = read(incoming, outgoing, through, junction)
    assert [edge.name for edge in network.edges] == ["1+", "2+"]
    (turn,) = network.turns
    assert turn.path is not None
    assert turn.path.road.length_m == pytest.approx(0.5 * math.pi * (radius - 1.75))
    assert network.parts == 1
    assert network.edges[0].end == network.edges[1].start


def test_connecting_roads_of_touching_junctions_are_one_turn(
    read: Callable[..., RoadNetwork],
) -> None:
    def straight(id_: str, x: float, link: str, junction: str = "-1") -> str:
        lanes = section(right=lane(-1, link='<predecessor id="-1"/><successor id="-1"/>'))
        return road(id_, geometry(0, x, 0, 0, 50), lanes, link=link, junction=junction)

    def to(which: str, kind: str, id_: str, contact: str = "") -> str:
        more = f'contactPoint="{contact}"' if contact else ""
        return f'<{which} elementType="{kind}" elementId="{id_}" {more}/>'

    def joint(id_: str, incoming: str, other: str) -> str:
        return (
            f'<junction id="{id_}"><connection id="0" incomingRoad="{incoming}" '
            f'contactPoint="start" connectingRoad="{other}"><laneLink from="-1" to="-1"/>'
            "</connection></junction>"
        )

    network = read(
        straight("1", 0, to("successor", "junction", "8")),
        straight("2", 150, to("predecessor", "junction", "9")),
        straight("3", 50, to("successor", "junction", "9"),
                 "8"),
        straight("4", 100, to("successor", "road", "2", "start"), "9"),
        joint("8", "1", "3"),
        joint("9", "3", "4"),
    )  # fmt: skip
    (turn,) = network.turns
    assert turn.path is not None
    assert turn.path.road.length_m == pytest.approx(100.0)


def test_a_road_that_ends_where_it_starts_is_closed(read: Callable[..., RoadNetwork]) -> None:
    circle = geometry(0, 0, 0, 0, 100 * math.pi, '<arc curvature="0.02"/>')
    centreline = read(road("1", circle, TWO_WAY)).centreline
    assert centreline is not None
    assert centreline.closed
    assert abs(centreline.total_turning_rad) == pytest.approx(2.0 * math.pi)
    assert len(centreline.sample(1.0)) == 315


def test_the_header_s_offset_and_system_lead_back_to_the_file_s_world(
    read: Callable[..., RoadNetwork],
) -> None:
    network = read(
        road("1", geometry(0, 5, 0, 0, 10), TWO_WAY),
        header="<geoReference><![CDATA[EPSG:25832]]></geoReference>"
        f'<offset x="500000" y="5400000" z="0" hdg="{0.5 * math.pi}"/>',
    )
    where = network.georeference
    assert where.file_crs == "EPSG:25832"
    assert where.projected_from_road == Pose(500000.0, 5400000.0, 0.5 * math.pi)
    found = where.to_file(np.array([[5.0, 0.0]]))
    np.testing.assert_allclose(found, [[500000.0, 5400005.0]], atol=1e-6)
    np.testing.assert_allclose(where.to_road(found), [[5.0, 0.0]], atol=1e-6)


def test_an_unknown_system_is_told_and_left_out(read: Callable[..., RoadNetwork]) -> None:
    network = read(
        road("1", geometry(0, 0, 0, 0, 10), TWO_WAY), header="<geoReference>mars</geoReference>"
    )
    assert network.georeference.file_crs is None
    assert network.ignored["geoReference that PROJ does not know"] == 1


def test_buildings_stand_where_their_road_says(read: Callable[..., RoadNetwork]) -> None:
    objects = (
        '<objects><object id="1" type="building" s="10" t="8" hdg="0" length="4" width="2" '
        'height="7"/><object id="2" type="tree" s="1" t="5"/>'
        '<object id="3" type="building" s="20" t="-9" hdg="1"><outline>'
        '<cornerLocal u="0" v="0" z="0" height="5"/><cornerLocal u="1" v="0" z="0" height="5"/>'
        '<cornerLocal u="0" v="1" z="0" height="5"/></outline></object></objects>'
    )
    text = road("1", geometry(0, 0, 0, 0.5 * math.pi, 50), TWO_WAY).replace(
        "</road>", objects + "</road>"
    )
    network = read(text)
    assert network.ignored["objects that are no buildings"] == 1
    np.testing.assert_allclose(network.obstacles.height_m, [7.0, 5.0])
    box, corner = network.obstacles.rings
    np.testing.assert_allclose([box.min(axis=0), box.max(axis=0)], [[-9, 8], [-7, 12]], atol=1e-9)
    assert np.min(np.hypot(*(corner - [9.0, 20.0]).T)) < 1e-9


def test_elevation_is_told_and_taken_as_flat(read: Callable[..., RoadNetwork]) -> None:
    text = road("1", geometry(0, 0, 0, 0, 50), TWO_WAY).replace(
        "<lanes>",
        '<elevationProfile><elevation s="0" a="0" b="0.1" c="0" d="0"/></elevationProfile><lanes>',
        1,
    )
    assert read(text).ignored["roads with elevation (taken as flat)"] == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must hold at least one road"),
        (road("1", "", TWO_WAY), "must hold at least one road"),
        (road("1", geometry(0, 0, 0, 0, 0), TWO_WAY), "must hold at least one road"),
        (road("1", geometry(0, 0, 0, 0, 10), section()), "with a driving lane from end to end"),
        (road("1", geometry(0, 0, 0, 0, 10, "<bezier/>"), TWO_WAY), "must be one of line, arc"),
        (road("1", geometry(0, 0, 0, 0, math.nan), TWO_WAY), "length must be finite"),
        (road("1", geometry(0, 0, 0, 0, 10, '<arc curvature="x"/>'), TWO_WAY), "must be a number"),
        (road("1", geometry(0, 0, 0, 0, 10) * 2, TWO_WAY), "geometry s must increase"),
        (road("1", geometry(0, 0, 0, 0, 9), TWO_WAY) * 2, "id must differ"),
    ],
)
def test_what_is_no_road_is_refused_in_one_line(
    read: Callable[..., RoadNetwork], text: str, message: str
) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        read(text)
    assert "\n" not in str(caught.value)


def test_a_lane_that_folds_in_a_bend_is_left_out_and_told(read: Callable[..., RoadNetwork]) -> None:
    network = read(road("1", geometry(0, 0, 0, 0, 50, '<arc curvature="-0.8"/>'), TWO_WAY))
    assert [edge.name for edge in network.edges] == ["1-"]
    assert network.ignored["lanes that fold in a bend"] == 1


@pytest.mark.parametrize("name", FILES)
def test_turns_of_shared_files_join_on_in_place_and_heading(
    name: str, shared_data: Callable[[str], Path]
) -> None:
    network = read_opendrive(shared_data(f"xodr/{name}.xodr"))
    for edge in network.edges:
        assert edge.length_m == pytest.approx(edge.stated_length_m, rel=0.015)
    for turn in network.turns:
        line = [network.edges[turn.from_edge].lanes[turn.from_lane].road]
        line += [turn.path.road] if turn.path else []
        line.append(network.edges[turn.to_edge].lanes[turn.to_lane].road)
        for before, after in pairwise(line):
            end, start = before.evaluate([before.length_m]), after.evaluate([0.0])
            assert np.hypot(*(end.xy - start.xy)[0]) < 1e-4
            turned = math.remainder(end.heading_rad[0] - start.heading_rad[0], math.tau)
            assert abs(turned) < 1e-4


def test_the_shared_junction_connects_every_way_with_every_other(
    shared_data: Callable[[str], Path],
) -> None:
    network = read_opendrive(shared_data("xodr/fabriksgatan.xodr"))
    assert (len(network.edges), len(network.turns), network.parts) == (8, 12, 1)
