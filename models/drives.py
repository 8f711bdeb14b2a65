"""Drives over a network: shortest paths between edges, in lanes, as one curve each."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from models.chain import chain_roads
from models.files.text import read_rows
from models.geometry import FloatArray, IntArray
from models.network import Lane, RoadNetwork, Turn, lane_length
from models.polyline import (
    cut_polyline,
    drivable,
    eased,
    end_headings,
    polyline_length,
    rounded_road,
    without_spikes,
)
from models.roads import Road

DRIVEN_RADIUS_M = 5.0  # of a drive's bends where the streets allow it: cars turn on 4.2 m
_UNREACHED = -9999  # scipy's mark
_CHANGE_FROM, _CHANGE_TO = 0.35, 0.65  # of an edge: where a change of lanes begins and ends
_STEP_M = 1e-3  # from a joint to where the next line's widths begin
_BATCH = 64  # origins whose trees exist at one time
_DEMAND_COLUMNS = ("from", "to", "trips")
_MOST_DEMAND_BYTES = 256_000_000


@dataclass(frozen=True, slots=True)
class Route:
    """Follow `edges` (indices) from the first one's start to the last one's end, `weight` times.

    `lane` is where the car starts; it changes lanes where the next turn asks for it.
    """

    edges: tuple[int, ...]
    lane: int = 0
    weight: float = 1.0


@dataclass(frozen=True, slots=True)
class Demand:
    """Ask for `trips` from one place to another: names of edges or of nodes."""

    start: str
    end: str
    trips: float


def sample_routes(network: RoadNetwork, drives: int, rng: np.random.Generator) -> list[Route]:
    """Draw fastest routes between random edges, both as likely as their length times lanes.

    Ends are drawn from what can be reached of other streets; where there is none of those, the
    drive is its first edge. Equal routes are one, with the sum of their weights, which is `drives`
    over all.
    """
    traffic = np.array([lane_length(edge.lanes[0]) * len(edge.lanes) for edge in network.edges])
    share = traffic / traffic.sum()
    starts = rng.choice(len(share), size=drives, p=share)
    picks = rng.random(drives)
    lanes = [int(rng.integers(len(network.edges[start].lanes))) for start in starts]
    names = {edge.street or edge.name: k for k, edge in enumerate(network.edges)}
    street = np.array([names[edge.street or edge.name] for edge in network.edges])
    found = []
    for origin, reached, before in _trees(network, starts):
        for n in np.flatnonzero(starts == origin):
            weights = np.where(np.isfinite(reached), share, 0.0)
            weights[street == street[origin]] = 0.0
            total = float(weights.sum())
            end = int(origin)
            if total > 0.0:
                end = int(np.searchsorted(np.cumsum(weights), picks[n] * total, side="right"))
                end = min(end, len(share) - 1)
            found.append((int(n), Route(_walk(before, int(origin), end), lanes[n])))
    return _merged(route for _, route in sorted(found, key=lambda row: row[0]))


def demanded_routes(
    network: RoadNetwork, demand: Sequence[Demand], rng: np.random.Generator, drives: int | None
) -> tuple[list[Route], int]:
    """Find the fastest route of each demand; with more than `drives`, draw that many by trips.

    Returns the routes, weighted by trips, and how many demands no route serves.

    Raises:
        ValueError: for a name that is neither an edge's nor a node's, or if no route serves any.
    """
    rows = list(demand)
    weights = np.array([row.trips for row in rows])
    if drives is not None and len(rows) > drives:
        drawn = rng.choice(len(rows), size=drives, p=weights / weights.sum())
        chosen, counts = np.unique(drawn, return_counts=True)
        rows = [rows[i] for i in chosen]
        weights = counts * (weights.sum() / drives)
    starts, ends = ([_edges_of(network, getattr(row, key), at) for row in rows]
                    for key, at in (("start", "start"), ("end", "end")))  # fmt: skip
    trees = {o: (reached, before) for o, reached, before in
             _trees(network, np.unique([e for edges in starts for e in edges]))}  # fmt: skip
    routes, lost = [], 0
    for origins, targets, weight in zip(starts, ends, weights.tolist(), strict=True):
        best = min(((float(trees[o][0][t]), o, t) for o in origins for t in targets), default=None)
        if best is None or not math.isfinite(best[0]):
            lost += 1
            continue
        routes.append(Route(_walk(trees[best[1]][1], best[1], best[2]), 0, weight))
    if not routes:
        raise ValueError("no route serves any of the demand: the network falls apart")
    return _merged(routes), lost


def read_demand(path: str | Path) -> list[Demand]:
    """Read a CSV with the columns `from, to[, trips]`: names of edges or nodes, trips 1 if absent.

    Raises:
        ValueError: one line that names the file and the line.
    """
    path = Path(path)
    rows = read_rows(path, _MOST_DEMAND_BYTES)
    header = [cell.strip().lower() for cell in rows[0]] if rows else []
    for name in _DEMAND_COLUMNS[:2]:
        if name not in header:
            raise ValueError(f"{path}: line 1: must name the columns from, to, trips; {name} is "
                             "missing")  # fmt: skip
    found = []
    for line, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(header):
            raise ValueError(f"{path}: line {line}: must hold {len(header)} fields, got {len(row)}")
        cells = dict(zip(header, (cell.strip() for cell in row), strict=True))
        try:
            trips = float(cells.get("trips", "1"))
        except ValueError:
            trips = math.nan
        if not (math.isfinite(trips) and trips >= 0.0):
            raise ValueError(
                f"{path}: line {line}: trips must be a number of 0 or more, got {cells['trips']!r}"
            )
        if trips > 0.0:
            found.append(Demand(cells["from"], cells["to"], trips))
    if not found:
        raise ValueError(f"{path}: must hold at least one trip")
    return found


def drive_road(network: RoadNetwork, route: Route) -> Road:
    """Return the curve of a route: lanes, changes of lanes, and turns, end to end.

    Where the file gives polylines, those of the whole route are one, rounded at every corner, so
    the heading never jumps, and straightened until a car can follow; elsewhere lanes and turns are
    exact curves that join in the file. A change of lanes takes the middle third of its edge.

    Raises:
        ValueError: if two edges of the route do not follow each other.
    """
    lines = list(_lines(network, route))
    if all(line.shape is not None for line in lines):
        return _rounded(lines)
    return chain_roads([line.road for line in lines])


def _lines(network: RoadNetwork, route: Route) -> Iterator[Lane]:
    """Yield the lanes and turns of a route; a change of lanes is a lane of its own."""
    graph, lane = network.turn_graph, min(route.lane, len(network.edges[route.edges[0]].lanes) - 1)
    for index, edge in enumerate(route.edges):
        lanes = network.edges[edge].lanes
        turn: Turn | None = None
        leave = lane
        if index + 1 < len(route.edges):
            onward = route.edges[index + 1]
            if not graph.has_edge(edge, onward):
                raise ValueError(f"edge {onward} does not follow edge {edge}")
            turn = _nearest(graph[edge][onward]["turns"], lane)
            leave = turn.from_lane
        yield lanes[lane] if leave == lane else _changing(lanes[lane], lanes[leave])
        if turn is not None:
            if turn.path is not None:
                yield turn.path
            lane = turn.to_lane


def _nearest(turns: Sequence[Turn], lane: int) -> Turn:
    return min(turns, key=lambda turn: abs(turn.from_lane - lane))


def _rounded(lines: Sequence[Lane]) -> Road:
    """Round the polylines of all lines as one; widths change from line to line."""
    shapes = [line.outline for line in lines]
    ends = np.cumsum([polyline_length(shape) for shape in shapes])
    points = without_spikes(np.vstack(shapes))
    road = rounded_road(drivable(points, DRIVEN_RADIUS_M))
    # Rounding and what lies between the lines change the length a little: widths go along.
    scale = road.length_m / ends[-1]
    begin = np.concatenate(([0.0], ends[:-1]))
    step = np.minimum(_STEP_M, 0.25 * (ends - begin))
    places = np.column_stack((begin + step, ends - step)).ravel() * scale
    return replace(
        road,
        width_s_m=places,
        left_m=np.repeat([line.left_m for line in lines], 2),
        right_m=np.repeat([line.right_m for line in lines], 2),
    )


def all_streets(network: RoadNetwork) -> Road:
    """Return every edge's rightmost lane, one after the other: a road that jumps between them."""
    roads = [edge.road for edge in network.edges]
    if any(road.closed for road in roads):
        if len(roads) == 1:
            return roads[0]
        raise ValueError("a network of several roads must not have closed ones")
    return chain_roads(roads)


def _changing(a: Lane, b: Lane) -> Lane:
    """Slide from one lane to another over the middle of the edge."""
    before, after = a.outline, b.outline
    lengths = polyline_length(before), polyline_length(after)
    shape = np.vstack(
        (
            cut_polyline(before, 0.0, _CHANGE_FROM * lengths[0]),
            cut_polyline(after, _CHANGE_TO * lengths[1], lengths[1]),
        )
    )
    left, right = 0.5 * (a.left_m + b.left_m), 0.5 * (a.right_m + b.right_m)
    if a.shape is None or b.shape is None:
        shape = eased(shape, end_headings(before)[0], end_headings(after)[1])
        return Lane(left_m=left, right_m=right, made=rounded_road(shape, left, right))
    return Lane(shape, left, right)


def _trees(network: RoadNetwork, starts: IntArray) -> Iterator[tuple[int, FloatArray, IntArray]]:
    """Yield, for each different start, the times to all edges and each edge's predecessor."""
    costs = _costs(network)
    origins = np.unique(starts)
    for begin in range(0, len(origins), _BATCH):
        batch = origins[begin : begin + _BATCH]
        times, before = dijkstra(costs, indices=batch, return_predecessors=True)
        for k, origin in enumerate(batch):
            yield int(origin), times[k], before[k].astype(np.int64)


def _costs(network: RoadNetwork) -> csr_matrix:
    """Return the seconds from the end of one edge to the end of another that may follow it."""
    seconds = [lane_length(edge.lanes[0]) / edge.speed_mps for edge in network.edges]
    best: dict[tuple[int, int], float] = {}
    for turn in network.turns:
        a, b = network.edges[turn.from_edge], network.edges[turn.to_edge]
        across = 0.0 if turn.path is None else lane_length(turn.path) / min(a.speed_mps, 10.0)
        if a.street == b.street and (a.start, a.end) == (b.end, b.start):
            continue  # nobody turns back within the width of a street
        key = (turn.from_edge, turn.to_edge)
        cost = seconds[turn.to_edge] + across
        best[key] = min(cost, best.get(key, math.inf))
    rows = np.array([key[0] for key in best], dtype=np.int64)
    columns = np.array([key[1] for key in best], dtype=np.int64)
    n = len(network.edges)
    return csr_matrix((np.array(list(best.values())), (rows, columns)), shape=(n, n))


def _walk(before: IntArray, origin: int, end: int) -> tuple[int, ...]:
    """Follow predecessors back from `end`."""
    path = [end]
    while path[-1] != origin:
        path.append(int(before[path[-1]]))
        if path[-1] == _UNREACHED:
            raise ValueError(f"edge {end} cannot be reached from edge {origin}")
    return tuple(path[::-1])


def _edges_of(network: RoadNetwork, name: str, at: str) -> list[int]:
    """Return the edge of a name, or the edges that start or end at the node of that name."""
    named = [i for i, edge in enumerate(network.edges) if edge.name == name]
    if named:
        return named
    if name not in network.nodes:
        raise ValueError(f"demand must be between edges or nodes of the network, got {name[:60]!r}")
    return [i for i, edge in enumerate(network.edges) if getattr(edge, at) == name]


def _merged(routes: Iterator[Route] | Sequence[Route]) -> list[Route]:
    """Add up the weights of equal routes, in the order of their first one."""
    weights: dict[tuple[tuple[int, ...], int], float] = {}
    for route in routes:
        key = (route.edges, route.lane)
        weights[key] = weights.get(key, 0.0) + route.weight
    return [Route(edges, lane, weight) for (edges, lane), weight in weights.items()]
