"""The information of poses that stand all over a city, a quarter at a time, kept on disk.

A path's samples are neighbours of those before and after them, which is what the tree of
`sample_tree` lives on; the streets of a network in a row jump through the whole city. So mounts are
taken in the order of a space-filling curve, some hundreds at a time, and each such quarter is given
only the samples and buildings within reach of its mounts, in the order of the same curve. What is
found is bitwise what `compute_information` finds.

Where nothing but each frame's own information is asked for, a folder may keep what is done: a run
that was stopped computes no quarter twice. The key of what lies there is a hash of all that the
information is made of.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from models.cameras import Cameras
from models.errors import ErrorModel
from models.geometry import FloatArray, IntArray
from models.installation import N_OFFSETS
from models.obstacles import Obstacles
from models.roads import RoadPoints
from models.z_order import z_order
from placement.cluster import Threads, Work, cores
from placement.information.chunks import Chunk, ChunkStore, fill
from placement.information.precompute import CHUNK, Information, compute_information
from placement.information.surroundings import Surroundings, points_at

POSES = CHUNK  # of a quarter, but for one mount that has more
WORTH_KEEPING = 100_000  # poses; fewer are computed in a second or two

Report = Callable[[str, float | None], None]


@dataclass(frozen=True, slots=True)
class QuarterTask:
    """Hold all that one quarter is computed from; `place` (t,) says which samples `points` are."""

    cameras: Cameras
    points: RoadPoints
    place: IntArray
    obstacles: Obstacles
    errors: ErrorModel
    max_range_m: float


def quarter_information(
    cameras: Cameras,
    points: RoadPoints,
    errors: ErrorModel,
    max_range_m: float,
    *,
    obstacles: Obstacles | None = None,
    frames_per_sample: float = 1.0,
    work: Work | None = None,
    keep: Path | None = None,
    progress: Report | None = None,
) -> Information:
    """Return bitwise what `compute_information` returns; poses of one mount must follow each other.

    `work` computes the quarters, by default threads, one a core. `keep` is a folder for those
    that are done: it is used for many poses (`WORTH_KEEPING`) without persistent errors.
    """
    report = progress or _silent
    work = work or Threads(cores())
    tasks = _Tasks(cameras, points, errors, max_range_m, obstacles)
    if keep is not None and len(cameras) >= WORTH_KEEPING and not errors.splits:
        store = ChunkStore(keep, _key(cameras, points, errors, max_range_m, obstacles))

        def compute(missing: list[int]) -> Iterator[tuple[int, bytes]]:
            for i, found in work.run(compute_quarter, _Some(tasks, missing), "information"):
                number = missing[i]
                chunk = Chunk(tasks.poses[number], found.indptr, found.indices, found.blocks)
                yield number, chunk.as_bytes()

        fill(store, len(tasks), compute, report)
        rows = join_rows(len(cameras), lambda: store.chunks(len(tasks)))
        return _informed(rows, len(points), frames_per_sample)
    parts: dict[int, Information] = {}
    for i, found in work.run(compute_quarter, tasks, "information"):
        parts[i] = found
        report(f"information: part {len(parts)} of {len(tasks)}", len(parts) / len(tasks))
    ordered = [_Rows.of(tasks.poses[i], parts[i]) for i in range(len(tasks))]
    return _informed(join_rows(len(cameras), lambda: ordered), len(points), frames_per_sample)


def compute_quarter(task: QuarterTask) -> Information:
    """Compute one quarter in one thread; sample numbers are the whole city's."""
    if not len(task.points):
        return _nothing(len(task.cameras), task.errors)
    found = compute_information(
        task.cameras,
        task.points,
        task.errors,
        task.max_range_m,
        obstacles=task.obstacles,
        workers=1,
    )
    # Along the curve samples have other places in a row than along the streets.
    n = int(task.place.max(initial=-1)) + 1
    rows = sparse.csr_array(
        (np.arange(len(found.indices)), task.place[found.indices], found.indptr),
        shape=(len(task.cameras), n),
    )
    rows.sort_indices()
    order = rows.data
    return Information(
        n_samples=n,
        indptr=found.indptr,
        indices=rows.indices.astype(np.int32),
        blocks=found.blocks[order],
        white=None if found.white is None else found.white[order],
        offsets=None if found.offsets is None else found.offsets[order],
    )


@dataclass(frozen=True, slots=True)
class _Rows:
    """Hold the rows of some candidates, as a `Chunk` does, and what persistent errors add."""

    candidates: IntArray
    indptr: IntArray
    indices: Any
    blocks: Any
    white: Any = None
    offsets: Any = None

    @staticmethod
    def of(candidates: IntArray, part: Information) -> _Rows:
        return _Rows(candidates, part.indptr, part.indices, part.blocks, part.white, part.offsets)


def join_rows(c: int, parts: Callable[[], Iterable[Chunk | _Rows]]) -> _Rows:
    """Put the rows of all `parts` in the order of the c candidates.

    `parts()` is called twice: to count, and to copy, so that chunks on disk are held one at a time.
    """
    indptr = np.zeros(c + 1, dtype=np.int64)
    shapes: dict[str, tuple[Any, ...]] = {}
    for part in parts():
        indptr[part.candidates + 1] = np.diff(part.indptr)
        for name in ("indices", "blocks", "white", "offsets"):
            column = getattr(part, name, None)
            if column is not None:
                shapes[name] = (column.dtype, column.shape[1:])
    np.cumsum(indptr, out=indptr)
    columns = {
        name: np.empty((int(indptr[-1]), *shape), dtype) for name, (dtype, shape) in shapes.items()
    }
    for part in parts():
        counts = np.diff(part.indptr)
        to = np.repeat(indptr[part.candidates] - part.indptr[:-1], counts)
        to += np.arange(len(to))
        for name, column in columns.items():
            column[to] = getattr(part, name)
    return _Rows(np.arange(c), indptr, **columns)


def _nothing(c: int, errors: ErrorModel) -> Information:
    """Return what c poses tell that no street comes near to."""
    width = 1 if errors.isotropic else 3
    empty = np.empty((0, width), np.float32)
    return Information(
        n_samples=0,
        indptr=np.zeros(c + 1, np.int64),
        indices=np.empty(0, np.int32),
        blocks=empty,
        white=empty if errors.splits else None,
        offsets=np.empty((0, 2, N_OFFSETS), np.float32) if errors.splits else None,
    )


def _informed(rows: _Rows, n_samples: int, frames_per_sample: float) -> Information:
    return Information(
        n_samples,
        rows.indptr,
        rows.indices,
        rows.blocks,
        rows.white,
        rows.offsets,
        frames_per_sample,
    )


class _Tasks(Sequence[QuarterTask]):
    """Cut each quarter's task only when somebody is about to run it.

    poses: the candidates of each quarter, mounts along the curve.
    """

    def __init__(
        self,
        cameras: Cameras,
        points: RoadPoints,
        errors: ErrorModel,
        max_range_m: float,
        obstacles: Obstacles | None,
    ) -> None:
        self.cameras, self.errors, self.max_range_m = cameras, errors, max_range_m
        # Samples in the order of the curve; `_place` says which each is.
        self._place = np.argsort(z_order(points.xy), kind="stable")
        self._around = Surroundings(points_at(points, self._place), obstacles)
        self.poses = _quarters(cameras.x_m, cameras.y_m)

    def __len__(self) -> int:
        return len(self.poses)

    def __getitem__(self, i: Any) -> Any:
        cameras = self.cameras.subset(self.poses[i])
        at, points, obstacles = self._around.near(cameras.x_m, cameras.y_m, self.max_range_m)
        return QuarterTask(
            cameras, points, self._place[at], obstacles, self.errors, self.max_range_m
        )


class _Some(Sequence[QuarterTask]):
    """Some of the tasks, by their numbers."""

    def __init__(self, tasks: _Tasks, numbers: list[int]) -> None:
        self._tasks, self._numbers = tasks, numbers

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, i: Any) -> Any:
        return self._tasks[self._numbers[i]]


def _quarters(x_m: FloatArray, y_m: FloatArray) -> list[IntArray]:
    """Deal poses (c,) into quarters: whole mounts, along the curve, about `POSES` each."""
    c = len(x_m)
    begin = np.flatnonzero(
        np.concatenate([[True], (np.diff(x_m) != 0.0) | (np.diff(y_m) != 0.0)])[:c]
    )
    counts = np.diff(np.append(begin, c))
    mounts = np.argsort(z_order(np.column_stack([x_m[begin], y_m[begin]])), kind="stable")
    before = np.cumsum(counts[mounts]) - counts[mounts]
    cuts = np.flatnonzero(np.diff(before // POSES)) + 1
    return [
        np.concatenate([np.arange(begin[m], begin[m] + counts[m]) for m in part])
        for part in np.split(mounts, cuts)
        if len(part)
    ]


def _key(
    cameras: Cameras,
    points: RoadPoints,
    errors: ErrorModel,
    max_range_m: float,
    obstacles: Obstacles | None,
) -> dict[str, Any]:
    """Say what the information is made of, arrays by their hashes."""
    buildings = obstacles or Obstacles()
    return {
        "poses": len(cameras),
        "of a quarter": POSES,
        "cameras": _hash(getattr(cameras, field.name) for field in fields(cameras)),
        "samples": _hash((points.x_m, points.y_m, points.heading_rad)),
        "obstacles": _hash((*buildings.rings, buildings.height_m)),
        "errors": repr(errors),
        "max_range_m": max_range_m,
    }


def _hash(arrays: Iterable[Any]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.shape} {array.dtype.str} ".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _silent(_text: str, _fraction: float | None) -> None:
    """Say nothing."""
