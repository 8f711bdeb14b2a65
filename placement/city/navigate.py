"""Cameras for hundreds of drives over a city: the lazy greedy placement for their trajectories.

The objective is `entropy` over all drives (`placement.city.trajectories`), monotone and submodular:
lazy greedy is within 1/2 of the best with one pose a mount, 1 − 1/e without (Nemhauser, Wolsey &
Fisher 1978), and `placement.city.cuts` says how far it can be.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.city.drives import CityDrives
from placement.city.trajectories import (
    Messages,
    Sightings,
    absorb,
    gain_anew,
    no_messages,
    pair_gains,
    renew_drive,
)
from placement.cluster import cores
from placement.information.chunks import Chunk
from placement.objectives.windows.filter import add_rows, empty_messages, filter_forward

Report = Callable[[str, float | None], None]
_SHARE = 4096  # candidates, or a run of drives, that a thread takes at one time


@dataclass(frozen=True, slots=True)
class TrajectoryProblem:
    """Hold the candidates of a city that are worth keeping, and the drives that they watch.

    candidates are numbered among all poses; group (c,) is each row's mount, rising; `pairs` are
    those of `placement.city.trajectories`.
    """

    rows: Chunk
    group: IntArray
    n_mounts: int
    drives: CityDrives
    pairs: tuple[IntArray, NDArray[np.int32], IntArray]

    @property
    def pair_row(self) -> IntArray:
        """Each pair's row (pairs,)."""
        return np.repeat(np.arange(len(self.group)), np.diff(self.pairs[0]))

    @property
    def csr(self) -> tuple[Any, Any, Any]:
        """indptr, indices and blocks."""
        return self.rows.indptr, self.rows.indices, self.rows.blocks

    @property
    def seen(self) -> Sightings:
        """The candidates' rows and the drives as the kernels take them."""
        d = self.drives
        return Sightings(*self.csr, d.frames, d.owner, d.start, d.steps)

    def by_drive(self, selected: IntArray) -> FloatArray:
        """Return each drive's log det ratio (d,) for rows `selected`, filtered from scratch."""
        drives = self.drives
        total = np.zeros((len(drives.points), 3))
        chosen = np.sort(np.asarray(selected, dtype=np.int64))
        add_rows(*self.csr, 1.0, np.ones(len(chosen)), chosen, total)
        total *= drives.frames[:, None]
        found = np.empty(len(drives))
        for d in range(len(drives)):
            here = slice(int(drives.start[d]), int(drives.start[d + 1]))
            t = here.stop - here.start
            found[d] = filter_forward(
                drives.steps[here], drives.p0, total[here], *empty_messages(t)
            )
        return found

    def value(self, selected: IntArray) -> float:
        """Evaluate rows `selected` from scratch, in nats."""
        return float(np.dot(self.drives.weights, self.by_drive(selected)))


def trajectory_problem(
    rows: Chunk, group: IntArray, n_mounts: int, drives: CityDrives
) -> TrajectoryProblem:
    """Find which candidates and drives meet."""
    c = len(group)
    row = np.repeat(np.arange(c, dtype=np.int32), np.diff(rows.indptr))
    seen = drives.owner[rows.indices]
    begins = np.ones(len(seen), dtype=np.bool_)
    begins[1:] = (np.diff(row) != 0) | (np.diff(seen) != 0)
    first = np.flatnonzero(begins)
    indptr = np.concatenate([[0], np.cumsum(np.bincount(row[first], minlength=c))])
    ends = np.append(first, len(seen)).astype(np.int64)
    return TrajectoryProblem(
        rows, group, n_mounts, drives, (indptr.astype(np.int64), seen[first], ends)
    )


@dataclass(slots=True)
class Trajectories:
    """A placement under construction: what makes a gain cost its own window."""

    problem: TrajectoryProblem
    messages: Messages = field(init=False)

    def __post_init__(self) -> None:
        """Start with no camera."""
        self.messages = no_messages(len(self.problem.drives.points))
        self.renew()

    def renew(self, total: FloatArray | None = None) -> FloatArray:
        """Compute every message anew, from `total` (t, 3) if given; return log dets (d,)."""
        drives = self.problem.drives
        if total is not None:
            self.messages.total[:] = total

        def one(d: int) -> float:
            begin, end = int(drives.start[d]), int(drives.start[d + 1])
            return float(renew_drive(begin, end, drives.steps, drives.p0, self.messages))

        with ThreadPoolExecutor(cores()) as pool:
            return np.array(list(pool.map(one, range(len(drives)))))

    def gains(self) -> FloatArray:
        """Return what every pair gains (pairs,), unweighted."""
        _, drive, first = self.problem.pairs
        n, seen = len(drive), self.problem.seen
        out = np.empty(n)

        def some(begin: int) -> None:
            pair_gains(begin, min(begin + _SHARE, n), first, seen, self.messages, out)

        with ThreadPoolExecutor(cores()) as pool:
            for _ in pool.map(some, range(0, n, _SHARE)):
                pass
        return out


def greedy_trajectories(
    problem: TrajectoryProblem,
    budget: int,
    progress: Report | None = None,
    stop: Callable[[], bool] | None = None,
) -> tuple[IntArray, FloatArray, dict[str, int]]:
    """Choose up to `budget` rows, one a mount: in order, with their gains, and what that took.

    A gain from a smaller placement bounds it from above (Minoux 1978): only what is at the heap's
    top is computed anew. Ties go to the lower row. `stop` ends it with what has been chosen.

    Raises:
        ValueError: for a budget that is not positive.
    """
    if budget < 1:
        raise ValueError(f"budget.cameras must be at least 1, got {budget}")
    d, seen, pairs = problem.drives, problem.seen, problem.pairs
    state = Trajectories(problem)
    known = state.gains()
    upper = np.bincount(problem.pair_row, known * d.weights[pairs[1]], len(problem.group))
    when = np.zeros(len(known), dtype=np.int32)
    changed = np.zeros(len(d.points), dtype=np.int32)
    heap = [(-gain, i) for i, gain in enumerate(upper.tolist()) if gain > 0.0]
    heapq.heapify(heap)
    taken = np.zeros(problem.n_mounts, dtype=np.bool_)
    fresh = np.zeros(len(upper), dtype=np.int64)
    chosen: list[int] = []
    gains: list[float] = []
    looks = renewed = 0
    while heap and len(chosen) < budget:
        least, i = heap[0]
        now = len(chosen)
        if taken[problem.group[i]]:
            heapq.heappop(heap)
            continue
        if fresh[i] != now:
            fresh[i] = now
            looks += 1
            gain = gain_anew(i, pairs, seen, d.weights, state.messages, changed, known, when, now)
            gain = min(-least, gain)
            if gain > 0.0:
                heapq.heapreplace(heap, (-gain, i))
            else:
                heapq.heappop(heap)
            continue
        heapq.heappop(heap)
        taken[problem.group[i]] = True
        chosen.append(i)
        gains.append(-least)
        renewed += absorb(i, seen, state.messages, changed, now + 1)
        if progress is not None and len(chosen) % 20 == 0:
            progress(f"greedy: {len(chosen)} of {budget}", len(chosen) / budget)
        if stop is not None and stop():
            break
    work = {"gains looked at": looks, "samples renewed": int(renewed)}
    return np.array(chosen, dtype=np.int64), np.array(gains), work
