"""Buildings sorted into cells, for rays to walk through: the data that `models.sight` reads."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from models.obstacles import Obstacles

# Columns of `SightGrid.walls`.
X0, Y0, X1, Y1, ROOF = 0, 1, 2, 3, 4
_MOST_CELLS = 4_000_000
# Cells are this many mean walls long; on Luxembourg half and twice as long cost 15 % more.
_WALLS_LONG = 1.25


class SightGrid(NamedTuple):
    """List n prisms for `clear`, in cells of `cell_m` from (x_m, y_m), nx by ny, row by row.

    walls (e, 5): corner, corner and height of each wall, one row for every cell it comes near;
        those of cell i begin at row wall_start[i].
    homes: the prisms whose box overlaps cell i, from home_start[i] on.
    corners (m, 2): those of prism p from ring_start[p] on.
    boxes (n, 4): least x and y, greatest x and y. roofs (n,): heights.
    tallest, lowest: the greatest and the least of them. longest: the longest wall. per_m: 1/cell_m.
    """

    x_m: float
    y_m: float
    cell_m: float
    nx: int
    ny: int
    wall_start: IntArray
    walls: FloatArray
    home_start: IntArray
    homes: NDArray[np.int32]
    ring_start: IntArray
    corners: FloatArray
    boxes: FloatArray
    roofs: FloatArray
    tallest: float
    lowest: float
    longest: float
    per_m: float


def sight_grid(obstacles: Obstacles | None, cell_m: float | None = None) -> SightGrid:
    """Sort the walls of `obstacles` (None: nothing blocks) into cells, by default of a good size.

    Raises:
        ValueError: for a cell size that is not positive.
    """
    rings = () if obstacles is None else obstacles.rings
    if cell_m is not None and not (math.isfinite(cell_m) and cell_m > 0.0):
        raise ValueError(f"cell_m must be positive, got {cell_m}")
    if not rings or obstacles is None:
        none, no = np.zeros(1, np.int64), np.empty(0)
        return SightGrid(
            *(0.0, 0.0, 1.0, 0, 0, none, no.reshape(0, 5), none, np.empty(0, np.int32)),
            *(none, no.reshape(0, 2), no.reshape(0, 4), no, 0.0, 0.0, 0.0, 1.0),
        )
    sizes = np.array([len(ring) for ring in rings])
    start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    corners = np.ascontiguousarray(np.concatenate(rings), dtype=np.float64)
    roofs = np.array(obstacles.height_m, dtype=np.float64)
    boxes = np.column_stack(
        [np.minimum.reduceat(corners, start[:-1]), np.maximum.reduceat(corners, start[:-1])]
    )
    following = np.arange(len(corners)) + 1
    following[start[1:] - 1] = start[:-1]
    owner = np.repeat(np.arange(len(rings)), sizes)
    walls = np.column_stack([corners, corners[following], roofs[owner]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    span = high - low
    length = np.hypot(*(corners[following] - corners).T)
    if cell_m is None:
        cell_m = max(_WALLS_LONG * float(length.mean()), 1e-9 * float(span.max()), 1e-9)
    cell_m = max(cell_m, math.sqrt(float(span[0] * span[1]) / _MOST_CELLS))
    cell_m = max(cell_m, float(span.max()) / (0.25 * _MOST_CELLS))
    # Everything is listed this much too widely, so that a ray's rounded walk misses nothing.
    slack = 1e-6 * cell_m + 1e-12 * float(np.abs(corners).max())
    x, y = low - 2.0 * slack
    nx, ny = (int(n) + 1 for n in (span + 4.0 * slack) // cell_m)
    geometry = (float(x), float(y), float(cell_m), nx, ny)
    counts = np.zeros(nx * ny + 1, dtype=np.int64)
    _list_walls(walls, *geometry, slack, counts, np.empty(0, np.int64))
    wall_start = np.concatenate([[0], np.cumsum(counts[:-1])])
    rows = np.empty(int(wall_start[-1]), dtype=np.int64)
    _list_walls(walls, *geometry, slack, wall_start[:-1].copy(), rows)
    counts[:] = 0
    _list_boxes(boxes, *geometry, slack, counts, np.empty(0, np.int32))
    home_start = np.concatenate([[0], np.cumsum(counts[:-1])])
    homes = np.empty(int(home_start[-1]), dtype=np.int32)
    _list_boxes(boxes, *geometry, slack, home_start[:-1].copy(), homes)
    return SightGrid(
        *geometry,
        wall_start,
        np.ascontiguousarray(walls[rows]),
        home_start,
        homes,
        start,
        corners,
        boxes,
        roofs,
        float(roofs.max()),
        float(roofs.min()),
        float(length.max()),
        1.0 / float(cell_m),
    )


@njit(cache=True, error_model="numpy", nogil=True)
def _list_walls(
    walls: FloatArray,
    x_m: float,
    y_m: float,
    cell_m: float,
    nx: int,
    ny: int,
    slack: float,
    at: IntArray,
    rows: IntArray,
) -> None:
    """Count, or if `rows` is not empty write, the walls that come within `slack` of each cell."""
    for w in range(len(walls)):
        x0, y0, x1, y1 = walls[w, X0], walls[w, Y0], walls[w, X1], walls[w, Y1]
        j_low = cell_of(min(y0, y1) - slack - y_m, cell_m, ny)
        j_high = cell_of(max(y0, y1) + slack - y_m, cell_m, ny)
        for j in range(j_low, j_high + 1):
            # The wall's part in this row of cells, and that part's cells.
            low, high = 0.0, 1.0
            if y1 != y0:
                a = (y_m + j * cell_m - slack - y0) / (y1 - y0)
                b = (y_m + (j + 1) * cell_m + slack - y0) / (y1 - y0)
                low, high = max(0.0, min(a, b)), min(1.0, max(a, b))
            a, b = x0 + low * (x1 - x0), x0 + high * (x1 - x0)
            i_low = cell_of(min(a, b) - slack - x_m, cell_m, nx)
            i_high = cell_of(max(a, b) + slack - x_m, cell_m, nx)
            for i in range(i_low, i_high + 1):
                cell = j * nx + i
                if len(rows):
                    rows[at[cell]] = w
                at[cell] += 1


@njit(cache=True, error_model="numpy", nogil=True)
def _list_boxes(
    boxes: FloatArray,
    x_m: float,
    y_m: float,
    cell_m: float,
    nx: int,
    ny: int,
    slack: float,
    at: IntArray,
    homes: NDArray[np.int32],
) -> None:
    """Count, or if `homes` is not empty write, the boxes that overlap each cell."""
    for p in range(len(boxes)):
        for j in range(
            cell_of(boxes[p, 1] - slack - y_m, cell_m, ny),
            cell_of(boxes[p, 3] + slack - y_m, cell_m, ny) + 1,
        ):
            for i in range(
                cell_of(boxes[p, 0] - slack - x_m, cell_m, nx),
                cell_of(boxes[p, 2] + slack - x_m, cell_m, nx) + 1,
            ):
                cell = j * nx + i
                if len(homes):
                    homes[at[cell]] = p
                at[cell] += 1


@njit(cache=True, error_model="numpy", nogil=True)
def cell_of(offset: float, cell_m: float, n: int) -> int:
    """Return the cell, 0…n − 1, nearest to `offset` from the grid's side."""
    return min(max(math.floor(offset / cell_m), 0), n - 1)
