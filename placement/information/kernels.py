"""The compiled half of the information matrix: walk the poses, count or write what they see.

A tree of circles decides which leaves of samples are worth a look; `pair_kernels` looks at a whole
leaf at once; what is seen is packed into CSR rows. Threads share the work by taking poses apart:
the kernels hold no lock, allocate nothing but small scratch, and write to disjoint rows.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.camera_checks import BORDER
from models.cameras import (
    ANGLE_LIMIT,
    DOWN,
    FORWARD,
    HALF_U,
    HALF_V,
    HEIGHT,
    K1,
    K2,
    K3,
    K4,
    KIND,
    RIGHT,
    X,
    Y,
)
from models.errors import (
    CHI2_95,
    COVARIANCE,
    FORM,
    ORIENTATION_VARIANCE,
    POSITION_95,
    POSITION_VARIANCE,
    REPORT_LIMIT,
    TAN_ORIENTATION,
    white_and_whole,
)
from models.geometry import FloatArray, IntArray
from models.installation import N_OFFSETS, offset_jacobian
from models.projections import lens_angle
from models.sight_exact import look
from models.sight_grid import SightGrid
from models.sight_traversal import BLOCKED, CLEAR, UNSURE, glance
from placement.information.pairs import inform, is_plain_pinhole, road_block
from placement.information.sample_tree import LEAF, find_leaves

_UNKNOWN = 255


@njit(cache=True, error_model="numpy", nogil=True)
def walk_poses(
    table: FloatArray,
    parameters: FloatArray,
    sigmas: FloatArray,
    max_range_m: float,
    samples: FloatArray,
    circles: FloatArray,
    first_leaf: int,
    grid: SightGrid,
    begin: int,
    end: int,
    write: bool,
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    white: NDArray[np.float32],
    offsets: NDArray[np.float32],
) -> None:
    """Count, or write, the information of poses begin … end − 1 of `table`.

    Counting puts each pose's number of visible samples into indptr[i + 1]. Writing fills indices
    and blocks (nnz, 1 | 3), and white (nnz, 3) and offsets (nnz, 2, 6) unless they are empty, from
    indptr[i] on. `sigmas` (6,) scales the offsets; `samples`, `circles` are a `SampleTree`'s.
    Only what is in a pose's field of view is looked for behind the buildings of `grid`, and once
    for all poses in a row that stand at one place.
    """
    stack = np.empty(72, dtype=np.int64)
    leaves = np.empty(first_leaf, dtype=np.int64)
    planes = np.empty((5, 3))
    out = np.empty((blocks.shape[1], LEAF))
    jacobian = np.empty((2, N_OFFSETS))
    # What is known of the sight from the place that `known_from` stands at.
    known = np.zeros(first_leaf * LEAF if grid.nx else 0, dtype=np.uint8)
    known_from = -1
    for i in range(begin, end):
        if write and indptr[i + 1] == indptr[i]:
            continue
        row = table[i]
        bound_view(row, planes)
        far = reach(row, parameters, max_range_m)
        if grid.nx and (known_from < 0 or not _same_place(row, table[known_from])):
            known[:] = _UNKNOWN
            known_from = i
        found = find_leaves(circles, first_leaf, planes, row[X], row[Y], far, stack, leaves)
        at = indptr[i] if write else 0
        for k in range(found):
            start = leaves[k] * LEAF
            inform(row, parameters, max_range_m, samples, start, start + LEAF, out)
            if grid.nx:
                _hide(grid, row, samples, start, known, out)
            for j in range(LEAF):
                if out[0, j] > 0.0:
                    if write:
                        indices[at] = start + j
                        for b in range(blocks.shape[1]):
                            blocks[at, b] = out[b, j]
                        if offsets.shape[0] > 0:
                            dx, dy = samples[0, start + j] - row[X], samples[1, start + j] - row[Y]
                            cos, sin = samples[2, start + j], samples[3, start + j]
                            _write_white(row, parameters, dx, dy, cos, sin, white, at)
                            _write_offsets(row, sigmas, dx, dy, cos, sin, jacobian, offsets, at)
                    at += 1
        if not write:
            indptr[i + 1] = at


@njit(cache=True, error_model="numpy", nogil=True)
def _same_place(row: FloatArray, other: FloatArray) -> bool:
    same: bool = row[X] == other[X] and row[Y] == other[Y] and row[HEIGHT] == other[HEIGHT]
    return same


@njit(cache=True, error_model="numpy", nogil=True)
def _hide(
    grid: SightGrid,
    row: FloatArray,
    samples: FloatArray,
    start: int,
    known: NDArray[np.uint8],
    out: FloatArray,
) -> None:
    """Put out[0] to 0 for the samples of a leaf that buildings hide; remember them in `known`."""
    x, y, h = row[X], row[Y], row[HEIGHT]
    for j in range(LEAF):
        if out[0, j] > 0.0 and known[start + j] == _UNKNOWN:
            known[start + j] = glance(grid, x, y, h, samples[0, start + j], samples[1, start + j])
    for j in range(LEAF):
        if out[0, j] > 0.0:
            if known[start + j] == UNSURE:
                seen = look(grid, x, y, h, samples[0, start + j], samples[1, start + j])
                known[start + j] = CLEAR if seen else BLOCKED
            if known[start + j] != CLEAR:
                out[0, j] = 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def dense_blocks(
    table: FloatArray,
    parameters: FloatArray,
    max_range_m: float,
    samples: FloatArray,
    out: FloatArray,
) -> None:
    """Write the information of every pose about every sample, out (c, 1 | 3, t); 0 where unseen."""
    begin: Any = np.int64(0)  # a plain 0 has `inform` compiled for that number alone
    for i in range(table.shape[0]):
        inform(table[i], parameters, max_range_m, samples, begin, samples.shape[1], out[i])


@njit(cache=True, error_model="numpy", nogil=True)
def _write_white(
    row: FloatArray,
    parameters: FloatArray,
    dx: float,
    dy: float,
    cos: float,
    sin: float,
    out: NDArray[np.float32],
    at: int,
) -> None:
    xx, xy, yy, _, _, _ = white_and_whole(row, dx, dy, parameters)
    out[at, 0], out[at, 1], out[at, 2] = road_block(xx, xy, yy, cos, sin)


@njit(cache=True, error_model="numpy", nogil=True)
def _write_offsets(
    row: FloatArray,
    sigmas: FloatArray,
    dx: float,
    dy: float,
    cos: float,
    sin: float,
    jacobian: FloatArray,
    out: NDArray[np.float32],
    at: int,
) -> None:
    offset_jacobian(row, dx, dy, jacobian)
    for j in range(N_OFFSETS):
        x, y = sigmas[j] * jacobian[0, j], sigmas[j] * jacobian[1, j]
        out[at, 0, j] = cos * x + sin * y
        out[at, 1, j] = cos * y - sin * x


@njit(cache=True, error_model="numpy", nogil=True)
def reach(row: FloatArray, parameters: FloatArray, max_range_m: float) -> float:
    """Return a ground distance [m] beyond which a pose reports nothing: range, or report limit.

    The installation's error alone reaches the limit there, at the root of a quadratic in d (or in
    R² = d² + h²); pixels only add to it.
    """
    h = row[HEIGHT]
    limit = parameters[REPORT_LIMIT] * BORDER
    if parameters[FORM] == COVARIANCE:
        # χ² (σ_pos² + σ_ori² R²) R²/h² ≤ limit²
        position, orientation = parameters[POSITION_VARIANCE], parameters[ORIENTATION_VARIANCE]
        allowed = limit * limit * h * h / CHI2_95
        root = position + math.sqrt(position * position + 4.0 * orientation * allowed)
        square = 2.0 * allowed / root - h * h if root > 0.0 else math.inf
        if square < 0.0:
            return 0.0
        return min(max_range_m, math.sqrt(square)) * (1.0 + 1e-6)
    # e_pos (1 + d/h) + T (h² + d²)/(h − d T) ≤ limit
    position, tangent = parameters[POSITION_95], parameters[TAN_ORIENTATION]
    a = tangent * (1.0 - position / h)
    b = position * (1.0 - tangent) + limit * tangent
    c = (position - limit) * h + tangent * h * h
    if c > 0.0:
        return 0.0
    if a < 0.0 or b <= 0.0:
        return max_range_m * (1.0 + 1e-6)
    far: float = min(max_range_m, -2.0 * c / (b + math.sqrt(b * b - 4.0 * a * c)))
    return far * (1.0 + 1e-6)


@njit(cache=True, error_model="numpy", nogil=True)
def bound_view(row: FloatArray, planes: FloatArray) -> None:
    """Write half-planes (5, 3) of the ground that hold all a pose sees: a·dx + b·dy + c ≤ 0.

    They are the sides of the image and what lies ahead, (a, b) of length 1; of other lenses than
    the pinhole, the sides of a pinhole wide enough for the image's corner, if there is one.
    """
    planes[:] = 0.0
    planes[:, 2] = -math.inf
    wide_u, wide_v = row[HALF_U] * BORDER, row[HALF_V] * BORDER
    if not is_plain_pinhole(row):
        corner = _corner_angle(row)
        if not corner < 1.5:
            return
        wide_u = math.tan(corner) * (1.0 + 1e-6)
        wide_v = wide_u
    _half_plane(row, 0.0, 0.0, -1.0, planes[0])
    _half_plane(row, 1.0, 0.0, -wide_u, planes[1])
    _half_plane(row, -1.0, 0.0, -wide_u, planes[2])
    _half_plane(row, 0.0, 1.0, -wide_v, planes[3])
    _half_plane(row, 0.0, -1.0, -wide_v, planes[4])


@njit(cache=True, error_model="numpy", nogil=True)
def _corner_angle(row: FloatArray) -> float:
    """Return the angle of the image's corner off the axis, NaN where the lens ends before it."""
    corner = math.sqrt(row[HALF_U] ** 2 + row[HALF_V] ** 2)
    return lens_angle(int(row[KIND]), corner, row[K1], row[K2], row[K3], row[K4], row[ANGLE_LIMIT])


@njit(cache=True, error_model="numpy", nogil=True)
def _half_plane(
    row: FloatArray, right: float, down: float, forward: float, out: FloatArray
) -> None:
    """Write the ground part of right·R + down·D + forward·F ≤ 0, (R, D, F) a ray's components."""
    a = right * row[RIGHT] + down * row[DOWN] + forward * row[FORWARD]
    b = right * row[RIGHT + 1] + down * row[DOWN + 1] + forward * row[FORWARD + 1]
    c = right * row[RIGHT + 2] + down * row[DOWN + 2] + forward * row[FORWARD + 2]
    c *= -row[HEIGHT]
    length = math.sqrt(a * a + b * b)
    if length > 1e-12:
        out[0], out[1], out[2] = a / length, b / length, c / length
    else:  # parallel to the ground, which lies on one side of it
        out[0], out[1], out[2] = 0.0, 0.0, math.inf if c > 0.0 else -math.inf
