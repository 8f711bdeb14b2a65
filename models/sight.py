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
the walls that come near it; `models.sight_traversal` walks through it in rounded arithmetic, and
`models.sight_exact` decides the few rays that it leaves open.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from models.geometry import BoolArray, FloatArray
from models.obstacles import Obstacles
from models.sight_exact import look
from models.sight_grid import SightGrid, sight_grid
from models.sight_traversal import CLEAR, UNSURE, glance


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
