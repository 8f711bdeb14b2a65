"""A search that shares no code with ours: Dubins paths through vertices, shapely, Dijkstra.

Poses stand on the vertices of the obstacles' mitred offsets, at evenly spread headings; Dubins'
six words join them; a joint counts if a line through points 0.25 m apart keeps its distance.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence

import shapely

Pose3 = tuple[float, float, float]


def dubins(a: Pose3, b: Pose3, r: float) -> list[list[tuple[str, float]]]:
    """Return every Dubins word that joins two poses, as (letter, length), shortest first.

    After Shkel and Lumelsky (2001), in the normalised frame.
    """
    dx, dy = b[0] - a[0], b[1] - a[1]
    d, theta = math.hypot(dx, dy) / r, math.atan2(dy, dx)
    p, q = (a[2] - theta) % math.tau, (b[2] - theta) % math.tau
    sp, sq, cp, cq, cpq = math.sin(p), math.sin(q), math.cos(p), math.cos(q), math.cos(p - q)
    found: list[tuple[str, float, float, float]] = []

    def mod(x: float) -> float:
        x %= math.tau
        return 0.0 if x > math.tau - 1e-9 else x

    square = 2 + d * d - 2 * cpq + 2 * d * (sp - sq)
    if square >= 0:
        t = math.atan2(cq - cp, d + sp - sq)
        found.append(("LSL", mod(t - p), math.sqrt(square), mod(q - t)))
    square = 2 + d * d - 2 * cpq + 2 * d * (sq - sp)
    if square >= 0:
        t = math.atan2(cp - cq, d - sp + sq)
        found.append(("RSR", mod(p - t), math.sqrt(square), mod(t - q)))
    square = -2 + d * d + 2 * cpq + 2 * d * (sp + sq)
    if square >= 0:
        s = math.sqrt(square)
        t = math.atan2(-cp - cq, d + sp + sq) - math.atan2(-2.0, s)
        found.append(("LSR", mod(t - p), s, mod(t - q)))
    square = -2 + d * d + 2 * cpq - 2 * d * (sp + sq)
    if square >= 0:
        s = math.sqrt(square)
        t = math.atan2(cp + cq, d - sp - sq) - math.atan2(2.0, s)
        found.append(("RSL", mod(p - t), s, mod(q - t)))
    x = (6 - d * d + 2 * cpq + 2 * d * (sp - sq)) / 8
    if abs(x) <= 1:
        u = mod(-math.acos(x))
        t = mod(p - math.atan2(cp - cq, d - sp + sq) + u / 2)
        found.append(("RLR", t, u, mod(p - q - t + u)))
    x = (6 - d * d + 2 * cpq + 2 * d * (sq - sp)) / 8
    if abs(x) <= 1:
        u = mod(-math.acos(x))
        t = mod(-p - math.atan2(cp - cq, d + sp - sq) + u / 2)
        found.append(("LRL", t, u, mod(q - p - t + u)))
    words = [
        [(letter, r * length) for letter, length in zip(word[0], word[1:], strict=True)]
        for word in sorted(found, key=lambda w: w[1] + w[2] + w[3])
    ]
    return [word for word in words if math.dist(drive(a, word, r)[:2], b[:2]) < 1e-6 * (1 + d * r)]


def drive(a: Pose3, word: Sequence[tuple[str, float]], r: float) -> Pose3:
    """Return where a word ends."""
    x, y, h = a
    for letter, length in word:
        if letter == "S":
            x, y = x + length * math.cos(h), y + length * math.sin(h)
        else:
            side = 1 if letter == "L" else -1
            new = h + side * length / r
            x += side * r * (math.sin(new) - math.sin(h))
            y -= side * r * (math.cos(new) - math.cos(h))
            h = new
    return x, y, h


def points_of(a: Pose3, word: Sequence[tuple[str, float]], r: float) -> list[tuple[float, float]]:
    """Return points along a word, at most 0.25 m apart on arcs."""
    points = [a[:2]]
    for letter, length in word:
        n = 1 if letter == "S" else max(1, math.ceil(length / 0.25))
        for _ in range(n):
            a = drive(a, [(letter, length / n)], r)
            points.append(a[:2])
    return points


def shortest(
    start: Pose3,
    goal: Pose3,
    obstacles: Sequence[Sequence[Sequence[float]]],
    *,
    radius: float,
    keep: float,
    headings: int = 12,
    longest: float = math.inf,
) -> float:
    """Return the length of the best road through vertices, infinite if there is none."""
    polygons = [shapely.Polygon(ring) for ring in obstacles]
    blocked = shapely.union_all(polygons)
    shapely.prepare(blocked)
    nodes: list[Pose3] = [start, goal]
    for polygon in polygons:
        grown = polygon.buffer(keep * 1.0001, join_style="mitre", mitre_limit=3.0)
        for x, y in list(grown.exterior.coords)[:-1]:
            if blocked.distance(shapely.Point(x, y)) >= keep:
                nodes += [(x, y, math.tau * n / headings) for n in range(headings)]

    def clear(a: Pose3, word: list[tuple[str, float]]) -> bool:
        return not polygons or bool(
            blocked.distance(shapely.LineString(points_of(a, word, radius))) >= keep
        )

    ahead = [math.dist(node[:2], goal[:2]) for node in nodes]
    best = [math.inf] * len(nodes)
    best[0] = 0.0
    # lazily: a leg is pushed at its length, and checked only when it is its turn
    heap: list[tuple[float, float, int, int, list[tuple[str, float]]]] = [(ahead[0], 0.0, 0, 0, [])]
    done: set[int] = set()
    while heap:
        total, length, node, before, word = heapq.heappop(heap)
        if total > longest:
            return math.inf
        if node in done or (word and not clear(nodes[before], word)):
            continue
        if node == 1:
            return length
        done.add(node)
        for other, pose in enumerate(nodes):
            if other in done or other == 0:
                continue
            if length + math.dist(nodes[node][:2], pose[:2]) + ahead[other] > longest:
                continue
            for way in dubins(nodes[node], pose, radius):
                size = sum(part for _, part in way)
                if length + size + ahead[other] <= longest:
                    heapq.heappush(
                        heap, (length + size + ahead[other], length + size, other, node, way)
                    )
    return math.inf
