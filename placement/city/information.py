"""What every pose of a city tells about every sample, chunk by chunk of neighbouring mounts.

A chunk needs the samples and buildings within reach of its mounts and nothing else, so that it is
a task of a few megabytes, wherever it is run. Poses that see nothing, or that another of their
mount dominates, are dropped before anything is stored.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.errors import ErrorModel
from models.geometry import IntArray
from models.obstacles import Obstacles
from models.roads import RoadPoints
from placement.city.dominance import undominated
from placement.city.mounts import NetworkMounts
from placement.information import compute_information
from placement.information.chunks import Chunk
from placement.information.surroundings import Surroundings

CHUNK_MOUNTS = 512


@dataclass(frozen=True, slots=True)
class ChunkTask:
    """Hold all that one chunk is made from: some mounts, and the city within their reach.

    first: the first mount's number in the whole city. place (t,): which samples `points` are.
    """

    first: int
    mounts: NetworkMounts
    points: RoadPoints
    place: IntArray
    obstacles: Obstacles
    errors: ErrorModel
    max_range_m: float


@dataclass(frozen=True, slots=True)
class Site:
    """Hold a city: mounts, samples, buildings, and how cameras measure."""

    mounts: NetworkMounts
    points: RoadPoints
    obstacles: Obstacles
    errors: ErrorModel
    max_range_m: float

    @property
    def n_chunks(self) -> int:
        """How many chunks of `CHUNK_MOUNTS` mounts there are."""
        return -(-len(self.mounts) // CHUNK_MOUNTS)


def chunk_task(site: Site, around: Surroundings, number: int) -> ChunkTask:
    """Cut what chunk `number` needs out of the city, `around` being what surrounds its mounts."""
    first = number * CHUNK_MOUNTS
    here = slice(first, min(first + CHUNK_MOUNTS, len(site.mounts)))
    m = site.mounts
    part = NetworkMounts(
        m.x_m[here],
        m.y_m[here],
        m.heading_rad[here],
        m.s_m[here],
        m.edge[here],
        m.poses,
        m.size_px,
        m.projection,
        m.distortion,
    )
    place, points, obstacles = around.near(part.x_m, part.y_m, site.max_range_m)
    return ChunkTask(first, part, points, place, obstacles, site.errors, site.max_range_m)


def compute_chunk(task: ChunkTask) -> bytes:
    """Compute a chunk and return it as it is stored; one thread, the same bytes anywhere."""
    poses = len(task.mounts.poses)
    if not len(task.points):  # no drive comes by
        width = 1 if task.errors.isotropic else 3
        none = np.empty(0, np.int64)
        return Chunk(
            none, np.zeros(1, np.int64), none.astype(np.int32), np.empty((0, width), np.float32)
        ).as_bytes()
    candidates = np.arange(len(task.mounts) * poses)
    found = compute_information(
        task.mounts.cameras(candidates),
        task.points,
        task.errors,
        task.max_range_m,
        obstacles=task.obstacles,
        workers=1,
    )
    keep = undominated(candidates // poses, found.indptr, found.indices, found.blocks)
    rows = np.flatnonzero(keep)
    entries = np.repeat(keep, np.diff(found.indptr))
    counts = np.diff(found.indptr)[rows]
    return Chunk(
        rows + task.first * poses,
        np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        task.place[found.indices[entries]].astype(np.int32),
        found.blocks[entries],
    ).as_bytes()
