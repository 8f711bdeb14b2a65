"""Line of sight from a camera on its pole to a car on the ground, past buildings.

A building is a prism: its footprint P, raised to its height H. The ray runs straight from the
camera at (x, y, h) down to the car at (t_x, t_y, 0); it is below the roof on its last min(1, H/h),
from C = t + min(1, H/h)·((x, y) − t) to the car at t. Then

    blocked  ⇔  the ray below the roof meets the inside of P, or crosses one of its walls.

Walls, corners and the roof itself do not block: a ray along a wall, or past a corner, or over the
very eaves is clear, and so is that of a camera mounted *on* a wall that looks away from it; two
houses that share a wall leave a slit without width between them. A camera within a building and
below its roof sees nothing, a car within one is not seen, and a camera above a roof looks over it
only where the ray has left the footprint before it sinks below the roof. A footprint that crosses
itself has its inside by the even–odd rule. A camera straight above the car (C = t) is blocked where
the car stands strictly inside.

All of this is decided exactly for the float64 coordinates of t, C and the corners
(`models.orientation`): no answer depends on rounding, nor on the grid. The grid lists in each cell
the walls that come near it, and a ray visits the cells on its way (Amanatides & Woo 1987), from the
car upwards to the height of the tallest roof: most rays that are blocked are so near their end.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from models.obstacles import Obstacles
from models.orientation import orient
from models.sight_grid import ROOF, X0, X1, Y0, Y1, SightGrid, cell_of, sight_grid

CLEAR, BLOCKED, UNSURE = 0, 1, 2
_EPSILON = 2.0**-53
# Without references counted: a ray would count them for every array of the grid, which costs four
# times what its walk does. Functions compiled so may not allocate.
_LEAN: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True, "_nrt": False}


def line_of_sight(
    obstacles: Obstacles | SightGrid,
    x_m: ArrayLike,
    y_m: ArrayLike,
    height_m: ArrayLike,
    target_x_m: ArrayLike,
    target_y_m: ArrayLike,
) -> BoolArray:
    """Say of each ray whether it is clear; arguments broadcast against each other.

    Cameras stand at (x, y), `height_m` above the ground; targets lie on it.

    Raises:
        ValueError: for coordinates that are not finite or heights that are not above 0.
    """
    arrays = np.broadcast_arrays(
        *(np.asarray(a, dtype=np.float64) for a in (x_m, y_m, height_m, target_x_m, target_y_m))
    )
    names = ("x_m", "y_m", "height_m", "target_x_m", "target_y_m")
    for name, array in zip(names, arrays, strict=True):
        if not np.isfinite(array).all():
            raise ValueError(f"{name} must be finite")
    if np.any(arrays[2] <= 0.0):
        raise ValueError(f"height_m must be above 0, got {arrays[2].min():g}")
    grid = obstacles if isinstance(obstacles, SightGrid) else sight_grid(obstacles)
    out = np.empty(arrays[0].size, dtype=np.bool_)
    x, y, height, tx, ty = (np.ascontiguousarray(array).ravel() for array in arrays)
    clear_rays(grid, x, y, height, tx, ty, out)
    return out.reshape(arrays[0].shape)


@njit(cache=True, error_model="numpy", nogil=True)
def clear_rays(
    grid: SightGrid,
    x: FloatArray,
    y: FloatArray,
    height: FloatArray,
    target_x: FloatArray,
    target_y: FloatArray,
    out: BoolArray,
) -> None:
    """Write `clear` of every ray into `out`, all arrays (n,)."""
    answers = np.empty(len(out), dtype=np.uint8)
    for i in range(len(out)):
        answers[i] = glance(grid, x[i], y[i], height[i], target_x[i], target_y[i])
    for i in range(len(out)):
        out[i] = answers[i] == CLEAR
        if answers[i] == UNSURE:
            out[i] = look(grid, x[i], y[i], height[i], target_x[i], target_y[i])


@njit(cache=True, error_model="numpy", nogil=True)
def clear(grid: SightGrid, x: float, y: float, height: float, tx: float, ty: float) -> bool:
    """Say whether a camera at (x, y), `height` above the ground, sees the ground at (tx, ty)."""
    answer = glance(grid, x, y, height, tx, ty)
    return look(grid, x, y, height, tx, ty) if answer == UNSURE else answer == CLEAR


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


@njit(**_LEAN)
def _within(
    start: float, slope: float, end: float, first: float, last: float
) -> tuple[float, float]:
    """Cut [first, last] down to where 0 ≤ start + u·slope ≤ end; first > last where nowhere."""
    if slope == 0.0:
        return (first, last) if 0.0 <= start <= end else (1.0, 0.0)
    a, b = -start / slope, (end - start) / slope
    return max(first, min(a, b)), min(last, max(a, b))


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
