"""Whether a ray is clear, decided exactly: every prism near its box is asked by exact orientations.

Where rounded arithmetic can tell, `models.sight_traversal` is faster. What blocks is said in
`models.sight`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.geometry import FloatArray, IntArray
from models.orientation import orient
from models.sight_grid import SightGrid, cell_of


@njit(cache=True, error_model="numpy", nogil=True)
def look(grid: SightGrid, x: float, y: float, height: float, tx: float, ty: float) -> bool:
    """Say exactly whether a ray is clear, asking every prism that comes near the box round it."""
    reach = 1e-6 * grid.cell_m
    i_low = cell_of(min(x, tx) - reach - grid.x_m, grid.cell_m, grid.nx)
    i_high = cell_of(max(x, tx) + reach - grid.x_m, grid.cell_m, grid.nx)
    j_low = cell_of(min(y, ty) - reach - grid.y_m, grid.cell_m, grid.ny)
    j_high = cell_of(max(y, ty) + reach - grid.y_m, grid.cell_m, grid.ny)
    for j in range(j_low, j_high + 1):
        for i in range(i_low, i_high + 1):
            for e in range(grid.home_start[j * grid.nx + i], grid.home_start[j * grid.nx + i + 1]):
                p = int(grid.homes[e])
                apart = (
                    max(x, tx) < grid.boxes[p, 0]
                    or min(x, tx) > grid.boxes[p, 2]
                    or max(y, ty) < grid.boxes[p, 1]
                    or min(y, ty) > grid.boxes[p, 3]
                )
                if not apart and _hides(grid, p, x, y, height, tx, ty):
                    return False
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def _hides(
    grid: SightGrid, p: int, x: float, y: float, height: float, tx: float, ty: float
) -> bool:
    """Say exactly whether prism p alone blocks the ray."""
    cx, cy = _below_roof(grid.roofs[p], x, y, height, tx, ty)
    return _meets(grid, p, tx, ty, cx, cy)


@njit(cache=True, error_model="numpy", nogil=True)
def _below_roof(
    roof: float, x: float, y: float, height: float, tx: float, ty: float
) -> tuple[float, float]:
    """Return where the ray sinks below a roof: C of the module's first lines."""
    if roof >= height:
        return x, y
    share = roof / height
    return tx + share * (x - tx), ty + share * (y - ty)


@njit(cache=True, error_model="numpy", nogil=True)
def _meets(grid: SightGrid, p: int, tx: float, ty: float, cx: float, cy: float) -> bool:
    """Say exactly whether the segment from t to C meets the inside of prism p's footprint.

    The line is moved to its left by less than any coordinate can show, and likewise to its right:
    then it passes no corner, and is inside after an odd number of walls. A stretch of the segment
    lies inside exactly if it is inside by both. Stretches begin at t and at corners on the way.
    """
    begin, end = grid.ring_start[p], grid.ring_start[p + 1]
    if tx == cx and ty == cy:
        return _strictly_inside(grid.corners, begin, end, tx, ty)
    ring = grid.corners[begin:end]
    n = len(ring)
    side = np.empty(n, dtype=np.int64)
    for k in range(n):
        side[k] = orient(tx, ty, cx, cy, ring[k, 0], ring[k, 1])
    along_x = abs(cx - tx) >= abs(cy - ty)
    for k in range(n):
        q = k + 1 if k + 1 < n else 0
        if side[k] * side[q] < 0:
            a = orient(ring[k, 0], ring[k, 1], ring[q, 0], ring[q, 1], tx, ty)
            b = orient(ring[k, 0], ring[k, 1], ring[q, 0], ring[q, 1], cx, cy)
            if a * b < 0:
                return True
    if _inside_after(ring, side, along_x, tx, ty, cx, cy, tx, ty):
        return True
    for k in range(n):
        if side[k] == 0:
            x, y = ring[k, 0], ring[k, 1]
            between = min(tx, cx) < x < max(tx, cx) if along_x else min(ty, cy) < y < max(ty, cy)
            if between and _inside_after(ring, side, along_x, tx, ty, cx, cy, x, y):
                return True
    return False


@njit(cache=True, error_model="numpy", nogil=True)
def _inside_after(
    ring: FloatArray,
    side: IntArray,
    along_x: bool,
    tx: float,
    ty: float,
    cx: float,
    cy: float,
    x: float,
    y: float,
) -> bool:
    """Say whether the line from t to C is inside just after its point (x, y), left and right."""
    left, right = False, False
    forwards = cx > tx if along_x else cy > ty
    n = len(ring)
    for k in range(n):
        q = k + 1 if k + 1 < n else 0
        from_left = (side[k] > 0) != (side[q] > 0)
        from_right = (side[k] < 0) != (side[q] < 0)
        if not (from_left or from_right):
            continue
        if side[k] == 0 or side[q] == 0:
            corner = k if side[k] == 0 else q
            ahead = ring[corner, 0] - x if along_x else ring[corner, 1] - y
            before = ahead <= 0.0 if forwards else ahead >= 0.0
        else:
            turn = orient(ring[k, 0], ring[k, 1], ring[q, 0], ring[q, 1], x, y)
            before = turn <= 0 if side[k] < 0 else turn >= 0
        if before:
            left ^= from_left
            right ^= from_right
    return left and right


@njit(cache=True, error_model="numpy", nogil=True)
def _strictly_inside(corners: FloatArray, begin: int, end: int, x: float, y: float) -> bool:
    """Say whether (x, y) is inside the ring of corners begin … end − 1, and on no wall of it."""
    inside = False
    x0, y0 = corners[end - 1, 0], corners[end - 1, 1]
    for k in range(begin, end):
        x1, y1 = corners[k, 0], corners[k, 1]
        above = y1 > y
        if (y0 > y) != above:
            turn = orient(x0, y0, x1, y1, x, y)
            if turn == 0:
                return False
            inside ^= (turn > 0) == above
        elif (
            (y0 == y or y1 == y)
            and min(x0, x1) <= x <= max(x0, x1)
            and orient(x0, y0, x1, y1, x, y) == 0
        ):
            return False
        x0, y0 = x1, y1
    return inside
