"""The floating-point filter of a line of sight: a walk through the grid that knows its own doubt.

The ray visits the cells on its way (Amanatides & Woo 1987), from the car upwards to the height of
the tallest roof: most rays that are blocked are so near their end. Every cross product is compared
with a bound on its rounding errors; a ray that no comparison settles is UNSURE, and
`models.sight_exact` decides it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from models.sight_grid import ROOF, X0, X1, Y0, Y1, SightGrid

CLEAR, BLOCKED, UNSURE = 0, 1, 2
_EPSILON = 2.0**-53
# Without references counted: a ray would count them for every array of the grid, which costs four
# times what its walk does. Functions compiled so may not allocate.
_LEAN: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True, "_nrt": False}


@njit(**_LEAN)
def glance(grid: SightGrid, x: float, y: float, height: float, tx: float, ty: float) -> int:
    """Say CLEAR or BLOCKED where rounded arithmetic can tell, else UNSURE: then `look`.

    Many rays go faster in two loops, of this and of `look`, than in one of `clear`.
    """
    if grid.nx == 0:
        return CLEAR
    answer: int = _walk(
        grid.x_m,
        grid.y_m,
        grid.cell_m,
        grid.per_m,
        grid.nx,
        grid.ny,
        grid.tallest,
        _doubt(grid.longest, grid.cell_m, grid.lowest, x, y, height, tx, ty),
        grid.wall_start,
        grid.walls,
        grid.home_start,
        grid.homes,
        grid.boxes,
        grid.ring_start,
        grid.corners,
        x,
        y,
        height,
        tx,
        ty,
    )
    return answer


@njit(**_LEAN)
def _walk(
    x_m: float,
    y_m: float,
    size: float,
    per_m: float,
    nx: int,
    ny: int,
    tallest: float,
    doubt: float,
    wall_start: IntArray,
    walls: FloatArray,
    home_start: IntArray,
    homes: NDArray[np.int32],
    boxes: FloatArray,
    ring_start: IntArray,
    corners: FloatArray,
    x: float,
    y: float,
    height: float,
    tx: float,
    ty: float,
) -> int:
    """Visit the cells from the car upwards in rounded arithmetic: CLEAR, BLOCKED or UNSURE."""
    dx, dy = x - tx, y - ty
    from_x, from_y = tx - x_m, ty - y_m
    first, last = 0.0, 1.0 if tallest >= height else tallest / height
    per_x = 1.0 / dx if dx != 0.0 else math.inf
    per_y = 1.0 / dy if dy != 0.0 else math.inf
    i, j = math.floor(from_x * per_m), math.floor(from_y * per_m)
    within = 0 <= i < nx and 0 <= j < ny
    # A car that may be inside a prism, and one straight below its camera, are looked at closely.
    unsure = within and (dx == 0.0 and dy == 0.0)
    blocked = False
    if within:
        for e in range(home_start[j * nx + i], home_start[j * nx + i + 1]):
            p = homes[e]
            if boxes[p, 0] <= tx <= boxes[p, 2] and boxes[p, 1] <= ty <= boxes[p, 3]:
                answer = _stands_inside(corners, ring_start[p], ring_start[p + 1], doubt, tx, ty)
                blocked |= answer == BLOCKED
                unsure |= answer == UNSURE
    else:  # only the part of the way, 0 at the car, that lies within the grid
        first, last = _within(from_x, dx, nx * size, first, last)
        first, last = _within(from_y, dy, ny * size, first, last)
        i = min(max(math.floor((from_x + first * dx) * per_m), 0), nx - 1)
        j = min(max(math.floor((from_y + first * dy) * per_m), 0), ny - 1)
    step_i, step_j = 1 if dx > 0.0 else -1, 1 if dy > 0.0 else -1
    per_i, per_j = size * abs(per_x), size * abs(per_y)
    next_i = ((i + 1 if dx > 0.0 else i) * size - from_x) * per_x if dx != 0.0 else math.inf
    next_j = ((j + 1 if dy > 0.0 else j) * size - from_y) * per_y if dy != 0.0 else math.inf
    going = first <= last and not blocked
    while going:
        cell = j * nx + i
        for e in range(wall_start[cell], wall_start[cell + 1]):
            x0, y0 = walls[e, X0] - tx, walls[e, Y0] - ty
            x1, y1 = walls[e, X1] - tx, walls[e, Y1] - ty
            side0, side1 = dx * y0 - dy * x0, dx * y1 - dy * x1
            if (side0 > doubt and side1 > doubt) or (side0 < -doubt and side1 < -doubt):
                continue
            # The wall is met at the share u = at/across of the way, the roof at roof/across.
            at, across = x0 * y1 - y0 * x1, side1 - side0
            if across < 0.0:
                at, across = -at, -across
            roof = across
            if walls[e, ROOF] < height:
                roof *= walls[e, ROOF] / height
            sure = abs(side0) > doubt and abs(side1) > doubt
            if sure and at > doubt and at < roof - doubt:
                blocked = True
                break
            unsure |= not (sure and (at < -doubt or at > roof + doubt))
        if next_i < next_j:
            going = not blocked and next_i <= last
            i += step_i
            next_i += per_i
            going &= 0 <= i < nx
        else:
            going = not blocked and next_j <= last
            j += step_j
            next_j += per_j
            going &= 0 <= j < ny
    return BLOCKED if blocked else (UNSURE if unsure else CLEAR)


@njit(**_LEAN)
def _within(
    start: float, slope: float, end: float, first: float, last: float
) -> tuple[float, float]:
    """Cut [first, last] down to where 0 ≤ start + u·slope ≤ end; first > last where nowhere."""
    if slope == 0.0:
        return (first, last) if 0.0 <= start <= end else (1.0, 0.0)
    a, b = -start / slope, (end - start) / slope
    return max(first, min(a, b)), min(last, max(a, b))


@njit(**_LEAN)
def _stands_inside(
    corners: FloatArray, begin: int, end: int, doubt: float, tx: float, ty: float
) -> int:
    """Say BLOCKED where the car is within the ring of corners begin … end − 1, CLEAR where not."""
    inside, unsure = False, False
    x0, y0 = corners[end - 1, 0] - tx, corners[end - 1, 1] - ty
    for k in range(begin, end):
        x1, y1 = corners[k, 0] - tx, corners[k, 1] - ty
        turn = x0 * y1 - y0 * x1
        if (y0 > 0.0) != (y1 > 0.0):
            unsure |= abs(turn) <= doubt
            inside ^= (turn > 0.0) == (y1 > 0.0)
        else:  # a wall along the line through the car may have the car on it
            unsure |= (y0 == 0.0 or y1 == 0.0) and min(x0, x1) <= 0.0 <= max(x0, x1)
        x0, y0 = x1, y1
    return UNSURE if unsure else (BLOCKED if inside else CLEAR)


@njit(**_LEAN)
def _doubt(
    longest: float,
    cell_m: float,
    lowest: float,
    x: float,
    y: float,
    height: float,
    tx: float,
    ty: float,
) -> float:
    """Bound the rounding errors of a cross product of two ways from t, each to a wall or to C.

    No corner of a wall that a ray comes near is further from t than `far`. Where the ray is cut at
    a roof, C is rounded to the grid of its coordinates, and lies off the line by that.
    """
    far = abs(x - tx) + abs(y - ty) + longest + 4.0 * cell_m
    if lowest >= height:
        return 16.0 * _EPSILON * far * far
    size = abs(x) + abs(y) + abs(tx) + abs(ty)
    return 16.0 * _EPSILON * far * (far + size * height / lowest)
