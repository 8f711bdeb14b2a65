"""The sparse information of every candidate pose about every path sample, precomputed."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.cameras import Cameras
from models.errors import ErrorModel
from models.geometry import FloatArray, IntArray
from models.installation import N_OFFSETS
from models.obstacles import Obstacles
from models.roads import RoadPoints
from models.sight_grid import SightGrid, sight_grid
from placement.cluster import cores
from placement.information import kernels
from placement.information.sample_tree import SampleTree, build_tree

CHUNK = 16_384  # poses whose camera tables exist at one time: 3.4 MB, which the caches hold
SHARE = 512  # poses a thread takes at one time


@dataclass(frozen=True, slots=True)
class Information:
    """Hold what each candidate tells about each path sample it sees, as CSR rows.

    Row i spans `indptr[i]:indptr[i + 1]` of the arrays below; `indices` increase within a row.
    Blocks are in the sample's road frame (t along the heading, n to the left), so they do not
    change when the scene is rotated or shifted; float32 storage, to be summed in float64.

    blocks (nnz, 1 | 3): information of one frame taken alone, 1/m²: [J] where the model is
        isotropic (J·I), else [J_tt, J_tn, J_nn]. White and persistent errors both count.
    white (nnz, 1 | 3) or None: one frame's information against its white error alone; None where
        the whole error is white, and then `blocks` is that.
    offsets (nnz, 2, p) or None: derivative of the measured (t, n) position with respect to the
        camera's p persistent offsets, each scaled to unit variance, in metres; None where white.
    frames_per_sample: how many frames the camera takes while the car passes one sample.
    """

    n_samples: int
    indptr: IntArray
    indices: NDArray[np.int32]
    blocks: NDArray[np.float32]
    white: NDArray[np.float32] | None = None
    offsets: NDArray[np.float32] | None = None
    frames_per_sample: float = 1.0

    @property
    def n_candidates(self) -> int:
        """The number of candidates, c."""
        return len(self.indptr) - 1

    @property
    def isotropic(self) -> bool:
        """Whether each block is one number times the identity."""
        return int(self.blocks.shape[1]) == 1


def compute_information(
    cameras: Cameras,
    points: RoadPoints,
    errors: ErrorModel,
    max_range_m: float,
    *,
    obstacles: Obstacles | None = None,
    frames_per_sample: float = 1.0,
    workers: int | None = None,
) -> Information:
    """Compute what every camera learns about every path sample, by the compiled kernels.

    A camera sees a sample that lies inside both fields of view, within `max_range_m` on the
    ground, is found within `errors.report_limit_m` (95 %), and is hidden by no building of
    `obstacles` (`models.sight`); all borders belong, to 1e-9 relative. Poses are walked twice, to
    count and to write, so nothing else as large as the result exists; the work grows with the
    visible pairs, by way of `placement.information.sample_tree`.

    `workers` threads (default: one a core, but no more than there is work for) give bitwise the
    same result.

    Raises:
        ValueError: if the path has more than 2^31 samples.
    """
    if len(points) >= 1 << 31:
        raise ValueError(f"a path must have fewer than 2^31 samples, got {len(points)}")
    tree = build_tree(points.x_m, points.y_m, points.heading_rad)
    c, width = len(cameras), 1 if errors.isotropic else 3
    if workers is None:
        workers = max(1, min(cores(), c // (2 * SHARE)))
    tables = _Tables(cameras)
    grid = sight_grid(obstacles)
    indptr = np.zeros(c + 1, dtype=np.int64)
    found = _Entries.of(0, width, splits=False)
    with ThreadPoolExecutor(workers) as pool:
        _walk(pool, tables, errors, max_range_m, tree, grid, indptr, found, write=False)
        np.cumsum(indptr, out=indptr)
        found = _Entries.of(int(indptr[-1]), width, splits=errors.splits)
        _walk(pool, tables, errors, max_range_m, tree, grid, indptr, found, write=True)
    return Information(
        n_samples=len(points),
        indptr=indptr,
        indices=found.indices,
        blocks=found.blocks,
        white=found.white if errors.splits else None,
        offsets=found.offsets if errors.splits else None,
        frames_per_sample=frames_per_sample,
    )


@dataclass(frozen=True, slots=True)
class _Entries:
    indices: NDArray[np.int32]
    blocks: NDArray[np.float32]
    white: NDArray[np.float32]
    offsets: NDArray[np.float32]

    @staticmethod
    def of(n: int, width: int, *, splits: bool) -> _Entries:
        more = n if splits else 0
        return _Entries(
            np.empty(n, np.int32),
            np.empty((n, width), np.float32),
            np.empty((more, width), np.float32),
            np.empty((more, 2, N_OFFSETS), np.float32),
        )


class _Tables:
    """Make the kernels' tables of a chunk of poses, and keep the last one."""

    def __init__(self, cameras: Cameras) -> None:
        self.cameras = cameras
        self._begin = -1
        self._table = np.empty((0, 0))

    def chunks(self) -> Iterator[tuple[int, FloatArray]]:
        """Yield each chunk's first pose and table (n, N_COLUMNS)."""
        for begin in range(0, len(self.cameras), CHUNK):
            if begin != self._begin:
                rows = np.arange(begin, min(begin + CHUNK, len(self.cameras)))
                whole = len(rows) == len(self.cameras)
                self._table = (self.cameras if whole else self.cameras.subset(rows)).table()
                self._begin = begin
            yield begin, self._table


def _walk(
    pool: ThreadPoolExecutor,
    tables: _Tables,
    errors: ErrorModel,
    max_range_m: float,
    tree: SampleTree,
    grid: SightGrid,
    indptr: IntArray,
    found: _Entries,
    *,
    write: bool,
) -> None:
    parameters, sigmas = errors.parameters(), errors.installation.sigmas()
    for begin, table in tables.chunks():
        pointers = indptr[begin : begin + len(table) + 1]

        def walk(first: int, table: FloatArray = table, pointers: IntArray = pointers) -> None:
            kernels.walk_poses(
                table,
                parameters,
                sigmas,
                max_range_m,
                tree.samples,
                tree.circles,
                tree.first_leaf,
                grid,
                first,
                min(first + SHARE, len(table)),
                write,
                pointers,
                found.indices,
                found.blocks,
                found.white,
                found.offsets,
            )

        for _ in pool.map(walk, range(0, len(table), SHARE)):
            pass
