"""Drives over networks: fastest routes by networkx, continuous curves, demands from files."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import networkx as nx
import numpy as np
import pytest

from models.chain import chain_roads
from models.drives import (
    Route,
    all_streets,
    demanded_routes,
    drive_road,
    read_demand,
    sample_routes,
)
from models.files.opendrive import read_opendrive
from models.files.osm import read_osm
from models.files.streets import Street, network_of_streets
from models.network import RoadNetwork
from models.roads import Piece, road_from_pieces


def grid(n: int = 3, *, lanes: int = 1, block_m: float = 100.0) -> RoadNetwork:
    """Lay n × n crossings, a street between neighbours, some of them one-way."""
    from collections import Counter

    streets = []
    for i in range(n):
        for j in range(n):
            for k, (di, dj) in enumerate(((1, 0), (0, 1))):
                if i + di < n and j + dj < n:
                    ends = np.array([[i, j], [i + di, j + dj]], dtype=float) * block_m
                    streets.append(
                        Street(
                            name=f"{'xy'[k]}{i}{j}",
                            nodes=((i, j), (i + di, j + dj)),
                            points_m=ends,
                            forward=lanes,
                            backward=0 if (i + j) % 3 == 2 else lanes,
                            width_m=6.0 * lanes,
                            speed_mps=8.0 + i + 2 * j,
                        )
                    )
    return network_of_streets(streets, Counter())


@pytest.mark.parametrize("seed", range(3))
def test_sampled_routes_are_fastest_and_their_weights_add_up(seed: int) -> None:
    network = grid(4)
    routes = sample_routes(network, 40, np.random.default_rng(seed))
    assert sum(route.weight for route in routes) == pytest.approx(40.0)
    graph = network.turn_graph
    seconds = [edge.lanes[0].road.length_m / edge.speed_mps for edge in network.edges]
    for _, b, data in graph.edges(data=True):
        data["time"] = seconds[b]
    for route in routes:
        a, b = route.edges[0], route.edges[-1]
        best = nx.dijkstra_path_length(graph, a, b, weight="time")
        # Turns cost a little, too: a route may be longer by what fewer of them save.
        taken = sum(seconds[edge] for edge in route.edges[1:])
        assert taken <= best + 4.0 * len(route.edges)
        assert all(graph.has_edge(*pair) for pair in pairwise(route.edges))


def test_the_same_seed_gives_the_same_routes() -> None:
    network = grid(4)
    a, b = (sample_routes(network, 25, np.random.default_rng(5)) for _ in range(2))
    assert a == b


@pytest.mark.parametrize("lanes", [1, 2])
def test_a_drive_is_one_curve_without_jumps(lanes: int) -> None:
    network = grid(4, lanes=lanes)
    for route in sample_routes(network, 30, np.random.default_rng(1)):
        road = drive_road(network, route)
        at = road.sample(0.25)
        step = np.hypot(*np.diff(at.xy, axis=0).T)
        np.testing.assert_allclose(step, road.length_m / (len(at) - 1), rtol=0.05)
        assert np.abs(np.diff(at.heading_rad)).max() < 0.4
        first, last = network.edges[route.edges[0]], network.edges[route.edges[-1]]
        lane = first.lanes[route.lane].outline
        np.testing.assert_allclose(at.xy[0], lane[0], atol=1e-9)
        ends = np.array([each.outline[-1] for each in last.lanes])
        assert np.min(np.hypot(*(ends - at.xy[-1]).T)) < 1e-6


def test_drives_over_opendrive_are_its_own_curves(shared_data: Callable[[str], Path]) -> None:
    network = read_opendrive(shared_data("xodr/fabriksgatan.xodr"))
    for route in sample_routes(network, 12, np.random.default_rng(0)):
        road = drive_road(network, route)
        lengths = [network.edges[edge].length_m for edge in route.edges]
        assert road.length_m >= sum(lengths) - 1e-6
        at = road.sample(0.1)
        assert np.abs(np.diff(at.heading_rad)).max() < 0.05
        assert np.hypot(*np.diff(at.xy, axis=0).T).max() < 0.11


def test_drives_can_be_followed_by_a_car(shared_data: Callable[[str], Path]) -> None:
    network = read_osm(shared_data("osm/town_10.068_48.135.osm"))
    for route in sample_routes(network, 60, np.random.default_rng(0)):
        assert drive_road(network, route).min_radius_m >= 4.2


def test_both_directions_are_driven(shared_data: Callable[[str], Path]) -> None:
    network = read_osm(shared_data("osm/town_10.068_48.135.osm"))
    used = {
        network.edges[edge].name
        for route in sample_routes(network, 60, np.random.default_rng(0))
        for edge in route.edges
    }
    assert used == {edge.name for edge in network.edges}


def test_a_demand_goes_from_node_to_node_or_edge_to_edge(tmp_path: Path) -> None:
    network = grid(3)
    corner, other = network.edges[0].start, network.edges[-1].end
    path = tmp_path / "od.csv"
    path.write_text(f"from,to,trips\n{corner},{other},7\n{network.edges[0].name},{other},2\n")
    routes, lost = demanded_routes(network, read_demand(path), np.random.default_rng(0), None)
    assert lost == 0
    assert sum(route.weight for route in routes) == pytest.approx(9.0)
    for route in routes:
        assert network.edges[route.edges[0]].start == corner
        assert network.edges[route.edges[-1]].end == other
    drawn, _ = demanded_routes(network, read_demand(path), np.random.default_rng(0), 1)
    assert sum(route.weight for route in drawn) == pytest.approx(9.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "must name the columns"),
        ("from,trips\na,1\n", "to is missing"),
        ("from,to,trips\na,b\n", "must hold 3 fields"),
        ("from,to,trips\na,b,many\n", "trips must be a number"),
        ("from,to,trips\na,b,-1\n", "trips must be a number of 0 or more"),
        ("from,to\n", "at least one trip"),
    ],
)
def test_what_is_no_demand_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "od.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_demand(path)


def test_a_demand_from_nowhere_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "od.csv"
    path.write_text("from,to\nnowhere,somewhere\n")
    with pytest.raises(ValueError, match="between edges or nodes of the network, got 'nowhere'"):
        demanded_routes(grid(2), read_demand(path), np.random.default_rng(0), None)


def test_one_street_and_parts_that_do_not_meet_are_driven() -> None:
    from collections import Counter

    lines = {"a": [[0, 0], [50, 0]], "b": [[0, 900], [80, 900]]}
    streets = [
        Street(name, (f"{name}0", f"{name}1"), np.array(points, dtype=float), backward=0)
        for name, points in lines.items()
    ]
    network = network_of_streets(streets, Counter())
    assert network.parts == 2
    routes = sample_routes(network, 20, np.random.default_rng(0))
    assert {route.edges for route in routes} == {(0,), (1,)}


def test_edges_that_do_not_follow_each_other_are_refused() -> None:
    network = grid(3)
    with pytest.raises(ValueError, match="does not follow"):
        drive_road(network, Route((0, len(network.edges) - 1)))


def test_a_chain_is_each_of_its_roads_where_it_lies() -> None:
    from models.geometry import Pose

    a = road_from_pieces([Piece(20.0, 0.0, 0.05)], width_m=4.0)
    end = a.evaluate([20.0])
    pose = Pose(float(end.x_m[0]), float(end.y_m[0]), float(end.heading_rad[0]))
    b = road_from_pieces([Piece(30.0, 0.05, 0.05)], width_m=6.0, start=pose)
    chain = chain_roads([a, b])
    assert chain.length_m == pytest.approx(50.0)
    s = np.linspace(0.0, 50.0, 51)
    at = chain.evaluate(s)
    wanted = road_from_pieces([Piece(20.0, 0.0, 0.05), Piece(30.0, 0.05, 0.05)]).evaluate(s)
    np.testing.assert_allclose(at.xy, wanted.xy, atol=1e-9)
    np.testing.assert_allclose(at.heading_rad, wanted.heading_rad, atol=1e-9)
    np.testing.assert_allclose(chain.half_widths([10.0, 40.0])[0], [2.0, 3.0])
    with pytest.raises(ValueError, match="at least one road"):
        chain_roads([])


def test_all_streets_are_as_long_as_the_network() -> None:
    network = grid(3)
    assert all_streets(network).length_m == pytest.approx(network.length_m)
    points = network.sample(2.0)
    assert len(points.edge) == points.first[-1]
    assert points.points.s_m[points.first[:-1]] == pytest.approx(0.0)
