"""Compiled geometry of roads in the making: legs between circles, distances from obstacles.

A *node* is a row x, y, heading, side, radius: a pose on a circle that turns left (side 1) or right
(side −1). A *leg* joins two nodes: along the first one's circle, straight or round a circle
between, and along the second one's circle.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from models.geometry import FloatArray, IntArray

STRAIGHT, ROUND_LEFT, ROUND_RIGHT = 1, 2, 3  # what lies between the two circles; 0: nothing fits
_TURN_EPS = 1e-9  # a turn this much short of a full one is none


@numba.njit(cache=True)
def wrap(angle: float) -> float:
    """Map an angle to [0, 2π), and what rounding put just below 2π to 0."""
    turn = angle % math.tau
    return 0.0 if turn > math.tau - _TURN_EPS else turn


@numba.njit(cache=True)
def leg(a: FloatArray, b: FloatArray, kind: int, middle_radius: float) -> FloatArray:
    """Return the leg's pieces as rows length, curvature (3, 2); a first length of −1 if none.

    STRAIGHT: the line that is tangent to both circles, n·(c_b − c_a) = side_b r_b − side_a r_a for
    its left normal n. ROUND_*: a circle of `middle_radius` that turns the other way and touches
    both, its centre to the left or right of the line between theirs.
    """
    pieces = np.zeros((3, 2))
    ax = a[0] - a[3] * a[4] * math.sin(a[2])
    ay = a[1] + a[3] * a[4] * math.cos(a[2])
    bx = b[0] - b[3] * b[4] * math.sin(b[2])
    by = b[1] + b[3] * b[4] * math.cos(b[2])
    dx, dy = bx - ax, by - ay
    apart = math.hypot(dx, dy)
    pieces[0, 0] = -1.0
    if kind == STRAIGHT:
        shift = b[3] * b[4] - a[3] * a[4]
        if apart < abs(shift) or apart < 1e-9:
            if apart < 1e-9 and abs(shift) < 1e-9:  # one and the same circle
                pieces[0, 0] = a[4] * wrap(a[3] * (b[2] - a[2]))
                pieces[0, 1] = a[3] / a[4]
            return pieces
        direction = math.atan2(dy, dx) - math.asin(shift / apart)
        pieces[0, 0] = a[4] * wrap(a[3] * (direction - a[2]))
        pieces[1, 0] = math.sqrt(max(0.0, apart * apart - shift * shift))
        pieces[2, 0] = b[4] * wrap(b[3] * (b[2] - direction))
    else:
        if a[3] != b[3]:
            return pieces
        m = middle_radius
        p, q = a[4] + m, b[4] + m
        if apart < 1e-9 or apart > p + q or apart < abs(p - q):
            return pieces
        along = (apart * apart + p * p - q * q) / (2.0 * apart)
        off = math.sqrt(max(0.0, p * p - along * along))
        if kind == ROUND_RIGHT:
            off = -off
        mx = ax + (along * dx - off * dy) / apart
        my = ay + (along * dy + off * dx) / apart
        leave = math.atan2(my - ay, mx - ax) + a[3] * 0.5 * math.pi
        join = math.atan2(my - by, mx - bx) + b[3] * 0.5 * math.pi
        pieces[0, 0] = a[4] * wrap(a[3] * (leave - a[2]))
        pieces[1, 0] = m * wrap(-a[3] * (join - leave))
        pieces[1, 1] = -a[3] / m
        pieces[2, 0] = b[4] * wrap(b[3] * (b[2] - join))
    pieces[0, 1] = a[3] / a[4]
    pieces[2, 1] = b[3] / b[4]
    return pieces


@numba.njit(cache=True)
def advance(
    x: float, y: float, heading: float, length: float, curvature: float
) -> tuple[float, float, float]:
    """Return the pose `length` further along an arc or line."""
    half = 0.5 * curvature * length
    chord = length if abs(half) < 1e-12 else length * math.sin(half) / half
    return (
        x + chord * math.cos(heading + half),
        y + chord * math.sin(heading + half),
        heading + 2.0 * half,
    )


@numba.njit(cache=True)
def distance_of_pieces(
    x: float,
    y: float,
    heading: float,
    pieces: FloatArray,
    edges: FloatArray,
    enough: float,
    too_near: float,
) -> float:
    """Return how near lines and arcs (n, 2: length, curvature) come to edges (e, 4), exactly.

    Edges farther than `enough` count as that far, and the first distance below `too_near` is
    returned at once: that saves most of the work.
    """
    least = enough
    for n in range(len(pieces)):
        length, curvature = pieces[n, 0], pieces[n, 1]
        if length <= 0.0:
            continue
        x1, y1, heading1 = advance(x, y, heading, length, curvature)
        straight = abs(curvature) * length < 1e-12
        # a piece lies within half its length of both ends' midpoint
        reach = 0.5 * length + least
        mx, my = 0.5 * (x + x1), 0.5 * (y + y1)
        for e in range(len(edges)):
            px, py, qx, qy = edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3]
            if (
                min(px, qx) > mx + reach
                or max(px, qx) < mx - reach
                or min(py, qy) > my + reach
                or max(py, qy) < my - reach
            ):
                continue
            if straight:
                d = segment_to_segment(x, y, x1, y1, px, py, qx, qy)
            else:
                d = _arc_to_segment(x, y, heading, x1, y1, length, curvature, px, py, qx, qy)
            if d < least:
                if d < too_near:
                    return d
                least = d
                reach = 0.5 * length + least
        x, y, heading = x1, y1, heading1
    return least


@numba.njit(cache=True)
def point_to_segment(x: float, y: float, px: float, py: float, qx: float, qy: float) -> float:
    """Return the distance of a point from a segment."""
    dx, dy = qx - px, qy - py
    square = dx * dx + dy * dy
    t = 0.0
    if square > 0.0:
        t = min(1.0, max(0.0, ((x - px) * dx + (y - py) * dy) / square))
    return math.hypot(x - px - t * dx, y - py - t * dy)


@numba.njit(cache=True)
def segment_to_segment(
    ax: float, ay: float, bx: float, by: float, px: float, py: float, qx: float, qy: float
) -> float:
    """Return the distance of two segments, 0 where they cross."""
    ux, uy, vx, vy = bx - ax, by - ay, qx - px, qy - py
    p = ux * (py - ay) - uy * (px - ax)
    q = ux * (qy - ay) - uy * (qx - ax)
    a = vx * (ay - py) - vy * (ax - px)
    b = vx * (by - py) - vy * (bx - px)
    if p * q < 0.0 and a * b < 0.0:
        return 0.0
    return min(
        min(point_to_segment(ax, ay, px, py, qx, qy), point_to_segment(bx, by, px, py, qx, qy)),
        min(point_to_segment(px, py, ax, ay, bx, by), point_to_segment(qx, qy, ax, ay, bx, by)),
    )


@numba.njit(cache=True)
def _arc_to_segment(
    x: float, y: float, heading: float, x1: float, y1: float, length: float, curvature: float,
    px: float, py: float, qx: float, qy: float,
) -> float:  # fmt: skip
    """Return the distance of an arc from a segment: of all that can be nearest, the nearest."""
    radius, side = 1.0 / abs(curvature), 1.0 if curvature > 0.0 else -1.0
    cx, cy = x - side * radius * math.sin(heading), y + side * radius * math.cos(heading)
    first, sweep = math.atan2(y - cy, x - cx), abs(curvature) * length
    least = min(point_to_segment(x, y, px, py, qx, qy), point_to_segment(x1, y1, px, py, qx, qy))
    for tx, ty in ((px, py), (qx, qy)):
        if _in_sweep(tx - cx, ty - cy, first, side, sweep):
            least = min(least, abs(math.hypot(tx - cx, ty - cy) - radius))
    dx, dy = qx - px, qy - py
    square = dx * dx + dy * dy
    foot = ((cx - px) * dx + (cy - py) * dy) / square
    fx, fy = px + foot * dx, py + foot * dy
    off = math.hypot(fx - cx, fy - cy)
    if 0.0 < foot < 1.0 and _in_sweep(fx - cx, fy - cy, first, side, sweep):
        least = min(least, abs(off - radius))
    if off < radius:
        half = math.sqrt((radius * radius - off * off) / square)
        for t in (foot - half, foot + half):
            if 0.0 <= t <= 1.0 and _in_sweep(
                px + t * dx - cx, py + t * dy - cy, first, side, sweep
            ):
                return 0.0
    return least


@numba.njit(cache=True)
def _in_sweep(dx: float, dy: float, first: float, side: float, sweep: float) -> bool:
    return bool((side * (math.atan2(dy, dx) - first)) % math.tau <= sweep)


@numba.njit(cache=True)
def legs_from(
    i: int,
    nodes: FloatArray,
    slack: FloatArray,
    ends: IntArray,
    edges: FloatArray,
    keep: float,
    keep_at_ends: float,
    middle_radius: float,
    most_turn: float,
    longest: float,
) -> tuple[FloatArray, IntArray]:
    """Return the shortest clear leg from node `i` to every node: lengths (n,), inf if none; kinds.

    `slack` (n,) is the straight that each node's bend needs for itself. `ends` (n,) is 1 for
    starts, 2 for goals, whose arcs may turn all the way; others turn by at most `most_turn`.
    Legs round a circle are tried where one end is a start or goal and `middle_radius` > 0. Legs
    are left out if a road through them is longer than `longest` as the crow flies.
    """
    n = len(nodes)
    cost, kinds = np.full(n, np.inf), np.zeros(n, dtype=np.int64)
    if ends[i] == 2:
        return cost, kinds
    sx, sy, gx, gy = nodes[0, 0], nodes[0, 1], nodes[n - 1, 0], nodes[n - 1, 1]
    come = math.hypot(nodes[i, 0] - sx, nodes[i, 1] - sy)
    for j in range(n):
        if j == i or ends[j] == 1:
            continue
        go = math.hypot(nodes[j, 0] - gx, nodes[j, 1] - gy)
        between = math.hypot(nodes[j, 0] - nodes[i, 0], nodes[j, 1] - nodes[i, 1])
        if come + between + go > longest:
            continue
        at_end = ends[i] > 0 or ends[j] > 0
        wanted = keep_at_ends if at_end else keep
        last = ROUND_RIGHT if at_end and middle_radius > 0.0 else STRAIGHT
        for kind in range(STRAIGHT, last + 1):
            pieces = leg(nodes[i], nodes[j], kind, middle_radius)
            if pieces[0, 0] < 0.0:
                continue
            if ends[i] == 0 and pieces[0, 0] > most_turn * nodes[i, 4]:
                continue
            if ends[j] == 0 and pieces[2, 0] > most_turn * nodes[j, 4]:
                continue
            same = pieces[2, 0] == 0.0 and pieces[1, 0] == 0.0
            if kind == STRAIGHT and not same and pieces[1, 0] < slack[i] + slack[j] - 1e-12:
                continue
            length = pieces[0, 0] + pieces[1, 0] + pieces[2, 0]
            if length >= cost[j] or come + length + go > longest:
                continue
            x, y, heading = nodes[i, 0], nodes[i, 1], nodes[i, 2]
            near = wanted - 1e-9
            if distance_of_pieces(x, y, heading, pieces, edges, wanted, near) >= near:
                cost[j], kinds[j] = length, kind
    return cost, kinds


@numba.njit(cache=True)
def seen_from(
    i: int,
    points: FloatArray,
    before: FloatArray,
    after: FloatArray,
    edges: FloatArray,
    keep: float,
) -> FloatArray:
    """Return the distances (n,) from point i to those it sees at `keep` from all edges, else inf.

    Of points with neighbours `before`, `after` (n, 2) on an obstacle's border (NaN: none) only
    tangents count: a shortest way leaves a border with both neighbours on one side.
    """
    n = len(points)
    seen = np.full(n, np.inf)
    ax, ay = points[i, 0], points[i, 1]
    far = np.empty(len(edges))
    for e in range(len(edges)):
        far[e] = point_to_segment(ax, ay, edges[e, 0], edges[e, 1], edges[e, 2], edges[e, 3])
    ordered = edges[np.argsort(far)]  # what is near blocks most
    segment = np.zeros((1, 2))
    for j in range(n):
        if j == i:
            continue
        dx, dy = points[j, 0] - ax, points[j, 1] - ay
        length = math.hypot(dx, dy)
        if length < 1e-9:
            continue
        if _cuts(i, points, before, after, dx, dy) or _cuts(j, points, before, after, dx, dy):
            continue
        segment[0, 0] = length
        angle = math.atan2(dy, dx)
        if distance_of_pieces(ax, ay, angle, segment, ordered, keep, keep) >= keep:
            seen[j] = length
    return seen


@numba.njit(cache=True)
def _cuts(
    i: int, points: FloatArray, before: FloatArray, after: FloatArray, dx: float, dy: float
) -> bool:
    a = dx * (before[i, 1] - points[i, 1]) - dy * (before[i, 0] - points[i, 0])
    b = dx * (after[i, 1] - points[i, 1]) - dy * (after[i, 0] - points[i, 0])
    small = 1e-9 * (dx * dx + dy * dy)
    return bool((a > small and b < -small) or (a < -small and b > small))
