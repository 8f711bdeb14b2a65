"""The information of many poses, a few thousand a task, wherever work runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.cameras import Cameras
from models.errors import ErrorModel
from models.obstacles import Obstacles
from models.roads import RoadPoints
from placement.cluster import Work
from placement.information.precompute import Information, compute_information

PART = 4096  # poses a task, whatever the number of workers


@dataclass(frozen=True, slots=True)
class PartTask:
    """Hold the arguments of `compute_information` for some of the poses."""

    cameras: Cameras
    points: RoadPoints
    errors: ErrorModel
    max_range_m: float
    obstacles: Obstacles | None
    frames_per_sample: float


def compute_part(task: PartTask) -> Information:
    """Compute one task, in one thread."""
    return compute_information(
        task.cameras,
        task.points,
        task.errors,
        task.max_range_m,
        obstacles=task.obstacles,
        frames_per_sample=task.frames_per_sample,
        workers=1,
    )


def spread_information(
    work: Work,
    cameras: Cameras,
    points: RoadPoints,
    errors: ErrorModel,
    max_range_m: float,
    *,
    obstacles: Obstacles | None = None,
    frames_per_sample: float = 1.0,
) -> Information:
    """Return bitwise what `compute_information` returns, computed by `work`."""
    tasks = [
        PartTask(
            cameras.subset(np.arange(begin, min(begin + PART, len(cameras)))),
            points,
            errors,
            max_range_m,
            obstacles,
            frames_per_sample,
        )
        for begin in range(0, len(cameras), PART)
    ]
    found: dict[int, Information] = dict(work.run(compute_part, tasks, "information"))
    parts = [found[i] for i in range(len(tasks))]
    counts = np.concatenate([np.diff(part.indptr) for part in parts])
    white = [part.white for part in parts if part.white is not None]
    offsets = [part.offsets for part in parts if part.offsets is not None]
    return Information(
        n_samples=len(points),
        indptr=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        indices=np.concatenate([part.indices for part in parts]),
        blocks=np.concatenate([part.blocks for part in parts]),
        white=np.concatenate(white) if white else None,
        offsets=np.concatenate(offsets) if offsets else None,
        frames_per_sample=frames_per_sample,
    )
