"""Words, distances, legs and clothoid bends against brute force and closed forms."""

from __future__ import annotations

import math

import networkx as nx
import numpy as np
import pytest
import shapely

from benchmarks.dubins_through_vertices import dubins
from models.construction.clothoids import Bend, join_pieces, with_clothoids
from models.construction.homotopy import crossing_word, reduced, spelled, ways_by_class
from models.construction.kernels import (
    ROUND_LEFT,
    ROUND_RIGHT,
    STRAIGHT,
    distance_of_pieces,
    leg,
)
from models.construction.lattice import polyline
from models.curves import ClothoidChain
from models.roads import road_from_pieces


def test_opposite_letters_cancel_until_none_are_left() -> None:
    assert reduced((1, 2), (-2, -1)) == ()
    assert reduced((1, -1, 2, 3), (-3, 4)) == (2, 4)
    assert spelled((2, -4)) == "E2 W4"
    assert spelled(()) == "direct"


def test_a_word_tells_sides_and_windings() -> None:
    marks = np.array([[0.0, 0.0], [10.0, 0.0]])
    over = np.array([[-5.0, 1.0], [5.0, 1.0], [15.0, 1.0]])
    weave = np.array([[-5.0, 1.0], [5.0, 1.0], [5.0, -1.0], [15.0, -1.0]])
    ring = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [1.0, 1.0]])
    assert crossing_word(over, marks) == (1, 2)
    assert crossing_word(over[::-1], marks) == (-2, -1)
    assert crossing_word(weave, marks) == (1,)
    assert crossing_word(np.vstack((ring, ring)), marks) == (-1, -1)


def test_ways_come_by_length_and_class() -> None:
    graph: nx.DiGraph[int] = nx.DiGraph()
    letters = {(0, 1): (), (1, 3): (1,), (0, 2): (), (2, 3): (), (0, 3): (1,)}
    for (i, j), weight in zip(letters, (1.0, 1.0, 1.5, 1.5, 2.5), strict=True):
        graph.add_edge(i, j, weight=weight)

    def word(i: int, j: int) -> tuple[int, ...]:
        return letters[i, j]

    ways = list(ways_by_class(graph, 0, 3, word, length_factor=2.0, most_classes=9))
    assert [(w.length_m, w.word) for w in ways] == [(2.0, (1,)), (3.0, ())]
    both = list(ways_by_class(graph, 0, 3, word, length_factor=2.0, most_classes=9, per_class=2))
    assert [w.nodes for w in both] == [(0, 1, 3), (0, 3), (0, 2, 3)]
    assert len(list(ways_by_class(graph, 0, 3, word, length_factor=1.2, most_classes=9))) == 1


def test_distances_of_pieces_are_those_of_shapely() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        pieces = np.column_stack((rng.uniform(0.0, 8.0, 3), rng.uniform(-0.5, 0.5, 3)))
        pieces[rng.integers(3), 1] = 0.0
        edges = rng.uniform(-15.0, 15.0, (4, 4))
        heading = float(rng.uniform(0.0, math.tau))
        got = distance_of_pieces(0.0, 0.0, heading, pieces, edges, 1e9, -1.0)
        chain = ClothoidChain(pieces[:, 0], pieces[:, 1], pieces[:, 1])
        at = chain.evaluate(np.linspace(0.0, chain.length_m, 3000))
        c, s = math.cos(heading), math.sin(heading)
        line = shapely.LineString(
            np.column_stack((c * at.x_m - s * at.y_m, s * at.x_m + c * at.y_m))
        )
        wanted = line.distance(shapely.multilinestrings(edges.reshape(-1, 2, 2)))
        assert got == pytest.approx(wanted, abs=2e-5)


def test_the_shortest_leg_of_all_sides_is_dubins() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        a, b = rng.uniform(-30.0, 30.0, 3), rng.uniform(-30.0, 30.0, 3)
        lengths = []
        for first in (1.0, -1.0):
            for last in (1.0, -1.0):
                for kind in (STRAIGHT, ROUND_LEFT, ROUND_RIGHT):
                    ends = np.array([[*a, first, 10.0], [*b, last, 10.0]])
                    pieces = leg(ends[0], ends[1], kind, 10.0)
                    if pieces[0, 0] >= 0.0:
                        lengths.append(float(pieces[:, 0].sum()))
                        end = polyline(*a, pieces)[-1]
                        assert end == pytest.approx(b[:2], abs=1e-6)
        word = dubins(tuple(a), tuple(b), 10.0)[0]
        assert min(lengths) == pytest.approx(sum(size for _, size in word), abs=1e-6)


@pytest.mark.parametrize("turn_deg", [2.0, 10.0, 14.0, 40.0, 120.0, 200.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_bend_with_clothoids_joins_the_same_two_lines(turn_deg: float, side: float) -> None:
    bend = Bend(40.0, 10.0)
    arc = bend.wide_m * math.radians(turn_deg)
    plain = [(50.0, 0.0), (arc, side / bend.wide_m), (50.0, 0.0)]
    smooth = with_clothoids(join_pieces(plain), [bend])
    assert smooth is not None
    ends = []
    sizes = np.array([size for size, _ in plain])
    curvatures = np.array([k for _, k in plain])
    for curve in (ClothoidChain(sizes, curvatures, curvatures), road_from_pieces(smooth).curve):
        at = curve.evaluate(np.array([curve.length_m]))
        ends.append((at.x_m[0], at.y_m[0], at.heading_rad[0]))
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    assert max(abs(p.curvature_end) for p in smooth) <= 1.0 / 40.0 + 1e-15


def test_clothoids_without_room_are_refused() -> None:
    bend = Bend(40.0, 10.0)
    k = 1.0 / bend.wide_m
    assert with_clothoids([(2.0, 0.0), (30.0, k), (50.0, 0.0)], [bend]) is None
    assert with_clothoids([(9.0, 0.0), (30.0, k), (30.0, -k), (9.0, 0.0)], [bend]) is None
