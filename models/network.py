"""Road networks: carriageways with exact lanes, the turns between them, what stands beside them.

A carriageway is one direction of a street. `RoadNetwork.edges` lists them; `turns` says which may
follow which, in which lanes, along which curve; `graph` is the same as a networkx graph.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from models.geometry import FloatArray, IntArray
from models.georeference import Georeference
from models.obstacles import Obstacles
from models.polyline import polyline_length, rounded_road
from models.roads import Road, RoadPoints

if TYPE_CHECKING:
    import networkx as nx


@dataclass(slots=True, eq=False)
class Lane:
    """A line that cars follow: the middle of one lane, or of a turn through a junction.

    It is given as a polyline (n, 2), which `road` rounds off when asked for, or as a `Road`
    already. `left_m` and `right_m` are the distances to the carriageway's edges.
    """

    shape: FloatArray | None = None
    left_m: float = 1.5
    right_m: float = 1.5
    made: Road | None = None

    @property
    def road(self) -> Road:
        """Return the road of this lane, its edges those of the whole carriageway."""
        if self.made is None:
            if self.shape is None:
                raise ValueError("a lane needs a shape or a road")
            self.made = rounded_road(self.shape, self.left_m, self.right_m)
        return self.made

    @property
    def outline(self) -> FloatArray:
        """Return points (n, 2) along the lane: the polyline as it was given, else every metre."""
        return self.road.sample(1.0).xy if self.shape is None else self.shape


@dataclass(frozen=True, slots=True)
class Edge:
    """One carriageway from node `start` to node `end`: lanes driven one way, rightmost first.

    `width_m` is the carriageway's, edge to edge; `stated_length_m` what the file claims, where it
    does. Opposite carriageways of one street carry the same `street`.
    """

    name: str
    start: str
    end: str
    lanes: tuple[Lane, ...]
    speed_mps: float
    width_m: float
    street: str = ""
    kind: str = ""
    stated_length_m: float | None = None

    @property
    def road(self) -> Road:
        """Return the rightmost lane's road: exact geometry with the carriageway's edges."""
        return self.lanes[0].road

    @property
    def length_m(self) -> float:
        """Return the length of the rightmost lane."""
        return self.road.length_m


@dataclass(frozen=True, slots=True)
class Turn:
    """Lead from a lane of one edge to a lane of another (indices), along `path`.

    `path` is None where the one lane ends exactly where the other begins.
    """

    from_edge: int
    to_edge: int
    from_lane: int = 0
    to_lane: int = 0
    path: Lane | None = None


@dataclass(frozen=True, slots=True)
class NetworkPoints:
    """Hold samples of many edges: `points` one edge after the other, `edge` (t,) their indices.

    Edge i has the rows `first[i]:first[i + 1]`; `s_m` starts anew on each. `left_m`, `right_m`
    (t,) are the distances to the carriageway's edges.
    """

    points: RoadPoints
    edge: IntArray
    first: IntArray
    left_m: FloatArray
    right_m: FloatArray


@dataclass(frozen=True)
class RoadNetwork:
    """Hold the roads of a file, in metres of one frame.

    edges, turns: see there. nodes: where each node lies (x_m, y_m).
    obstacles: buildings. georeference: how to get back to the file's own coordinates.
    ignored: what the reader left out, by name, how often. source: the format's name.
    centreline: the whole road with both its edges, if the file holds one road and nothing else.
    notes: what else the reader has to say, a line each.
    """

    edges: tuple[Edge, ...]
    turns: tuple[Turn, ...] = ()
    nodes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    obstacles: Obstacles = field(default_factory=Obstacles)
    georeference: Georeference = field(default_factory=Georeference)
    ignored: Mapping[str, int] = field(default_factory=dict)
    source: str = ""
    centreline: Road | None = None
    notes: tuple[str, ...] = ()

    @cached_property
    def graph(self) -> nx.MultiDiGraph[str]:
        """Return the network as a graph: nodes with x_m and y_m, edges keyed by their names.

        Every edge has `index` (into `edges`), `edge`, `road`, `length_m`, `width_m`, `lanes` and
        `speed_mps`. Not every pair of edges that meet at a node may follow each other:
        `turn_graph` knows.
        """
        import networkx as nx

        graph: nx.MultiDiGraph[str] = nx.MultiDiGraph()
        for name, (x, y) in self.nodes.items():
            graph.add_node(name, x_m=x, y_m=y)
        for index, edge in enumerate(self.edges):
            graph.add_edge(
                edge.start,
                edge.end,
                key=edge.name,
                index=index,
                edge=edge,
                road=edge.road,
                length_m=edge.length_m,
                width_m=edge.width_m,
                lanes=len(edge.lanes),
                speed_mps=edge.speed_mps,
            )
        return graph

    @cached_property
    def turn_graph(self) -> nx.DiGraph[int]:
        """Return which edge may follow which: nodes are edge indices; `turns` lists the lanes."""
        import networkx as nx

        graph: nx.DiGraph[int] = nx.DiGraph()
        graph.add_nodes_from(range(len(self.edges)))
        for turn in self.turns:
            a, b = turn.from_edge, turn.to_edge
            if graph.has_edge(a, b):
                graph[a][b]["turns"].append(turn)
            else:
                graph.add_edge(a, b, turns=[turn])
        return graph

    @cached_property
    def length_m(self) -> float:
        """Return the length of all edges, one lane each."""
        return float(sum(edge.length_m for edge in self.edges))

    @cached_property
    def parts(self) -> int:
        """Return how many parts the streets fall into, one-way or not."""
        import networkx as nx

        return nx.number_weakly_connected_components(self.graph)

    def sample(self, spacing_m: float, edges: Sequence[int] | None = None) -> NetworkPoints:
        """Sample every edge's rightmost lane (or those of `edges`), both ends included."""
        chosen = range(len(self.edges)) if edges is None else edges
        columns: list[RoadPoints] = []
        widths: list[tuple[FloatArray, FloatArray]] = []
        for index in chosen:
            road = self.edges[index].road
            columns.append(road.sample(spacing_m))
            widths.append(road.half_widths(columns[-1].s_m))
        counts = np.array([len(column) for column in columns], dtype=np.int64)

        def joined(name: str) -> FloatArray:
            parts = [getattr(column, name) for column in columns]
            return np.concatenate(parts) if parts else np.empty(0)

        return NetworkPoints(
            points=RoadPoints(
                *(joined(name) for name in ("s_m", "x_m", "y_m", "heading_rad", "curvature"))
            ),
            edge=np.repeat(np.array(list(chosen), dtype=np.int64), counts),
            first=np.concatenate(([0], np.cumsum(counts))),
            left_m=np.concatenate([left for left, _ in widths]) if widths else np.empty(0),
            right_m=np.concatenate([right for _, right in widths]) if widths else np.empty(0),
        )


def lane_length(lane: Lane) -> float:
    """Return a lane's length without making its road: the polyline's, else the road's."""
    return lane.road.length_m if lane.shape is None else polyline_length(lane.shape)
