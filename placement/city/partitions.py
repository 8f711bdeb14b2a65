"""Greedy by partitions, in two rounds: each part of the city first, then what all parts chose.

The first round runs anywhere, a part a task; the second chooses among a few thousand candidates.
With m parts and k cameras it is within a constant over min(m, k) of the best (Mirzasoleiman et al.
2013); where a camera sees a street and a part is a quarter, parts hardly know of each other,
and the second round finds greedy's own placement again, up to what lies on the borders.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.city.greedy import first_gains, lazy_greedy
from placement.cluster import Work

if TYPE_CHECKING:
    from placement.city.solve import CityProblem

PARTS = 16  # whatever the number of workers: the result must not depend on it


@dataclass(frozen=True, slots=True)
class PartTask:
    """Hold the rows of one part: its mounts numbered from 0, its samples within the part."""

    group: IntArray
    indptr: IntArray
    indices: NDArray[np.int32]
    blocks: NDArray[np.float32]
    weights: FloatArray
    scale: float
    budget: int


@dataclass(frozen=True, slots=True)
class _PartTasks:
    """Cut the parts when they are asked for."""

    problem: CityProblem
    borders: IntArray
    budget: int

    def __len__(self) -> int:
        return len(self.borders) - 1

    def __getitem__(self, i: Any) -> Any:
        begin, end = int(self.borders[i]), int(self.borders[i + 1])
        indptr, indices, blocks = self.problem.csr
        at = slice(int(indptr[begin]), int(indptr[end]))
        samples, local = np.unique(indices[at], return_inverse=True)
        _, group = np.unique(self.problem.group[begin:end], return_inverse=True)
        return PartTask(
            group.astype(np.int64),
            indptr[begin : end + 1] - indptr[begin],
            local.astype(np.int32),
            blocks[at],
            self.problem.weights[samples],
            self.problem.scale,
            self.budget,
        )


def partitioned_greedy(
    problem: CityProblem, budget: int, work: Work, parts: int = PARTS
) -> tuple[IntArray, FloatArray]:
    """Return the chosen rows in the order of the second round, and their gains."""
    c = len(problem.group)
    firsts = np.flatnonzero(np.diff(problem.group, prepend=-1))  # mounts stay whole
    cuts = np.append(firsts[np.arange(parts) * len(firsts) // parts], c) if c else np.zeros(1)
    borders = np.unique(cuts).astype(np.int64)
    tasks: Any = _PartTasks(problem, borders, budget)
    chosen: list[IntArray] = [np.empty(0, np.int64)] * len(tasks)
    for i, rows in work.run(greedy_of_part, tasks, "greedy"):
        chosen[i] = rows + borders[i]
    union = np.sort(np.concatenate(chosen or [np.empty(0, np.int64)]))
    allowed = np.zeros(c, np.bool_)
    allowed[union] = True
    alone = np.zeros(c)
    sums = np.zeros((problem.n_samples, 3))
    for i in union:
        first_gains(*problem.csr, problem.weights, problem.scale, sums, int(i), int(i) + 1, alone)
    picked, gains = np.zeros(budget, np.int64), np.zeros(budget)
    added, _ = lazy_greedy(
        *problem.csr,
        problem.weights,
        problem.scale,
        problem.group,
        allowed,
        np.zeros(problem.n_mounts, np.bool_),
        budget,
        0.0,
        sums,
        alone,
        picked,
        gains,
    )
    return picked[:added], gains[:added]


def greedy_of_part(task: PartTask) -> IntArray:
    """Choose up to the whole budget within one part; return its rows."""
    c = len(task.group)
    rows = (task.indptr, task.indices, task.blocks)
    sums, upper = np.zeros((len(task.weights), 3)), np.empty(c)
    first_gains(*rows, task.weights, task.scale, sums, 0, c, upper)
    chosen, gains = np.zeros(task.budget, np.int64), np.zeros(task.budget)
    added, _ = lazy_greedy(
        *rows,
        task.weights,
        task.scale,
        task.group,
        np.ones(c, np.bool_),
        np.zeros(int(task.group.max(initial=-1)) + 1, np.bool_),
        task.budget,
        0.0,
        sums,
        upper,
        chosen,
        gains,
    )
    return chosen[:added]
