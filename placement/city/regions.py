"""Weakly coupled regions: candidates that share samples belong together, as far as it matters.

Only candidates that may be worth a camera count (`placement.city.prices`), and those lie in islands
about junctions and bends; what no common sample links, even by way of others, is apart for good.
Islands are packed in order into regions of about one size, so nothing is lost at their borders.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from models.geometry import FloatArray, IntArray
from placement.city.prices import RegionTask

if TYPE_CHECKING:
    from placement.city.solve import CityProblem

REGION_ENTRIES = 400_000  # of the matrix in a region, unless one island has more


def region_tasks(
    problem: CityProblem,
    alone: FloatArray,
    chosen: IntArray,
    floor: float,
    price: float,
    steps: int,
) -> tuple[list[tuple[RegionTask, IntArray]], int]:
    """Cut the candidates that gain more than `floor` alone into regions; count their mounts.

    Each comes with its rows in the problem.
    """
    indptr, indices, _ = problem.csr
    active = np.flatnonzero(alone > floor)
    if not active.size:
        return [], 0
    counts = np.diff(indptr)[active]
    pointers = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    entries = np.repeat(indptr[active] - pointers[:-1], counts) + np.arange(pointers[-1])
    label = _islands(problem.group[active], pointers, indices[entries])
    # Islands in the order of their first candidates, so many entries a region.
    size = np.bincount(label, counts)
    region = (np.cumsum(size) - size) // REGION_ENTRIES
    place = region[label].astype(np.int64)
    order = np.argsort(place, kind="stable")
    order = order[np.lexsort((problem.group[active[order]], place[order]))]
    rank = np.full(len(indptr) - 1, -1, dtype=np.int64)
    rank[chosen] = np.arange(len(chosen))
    tasks = [
        _task(problem, active[part], rank, price, steps)
        for part in np.split(order, np.flatnonzero(np.diff(place[order])) + 1)
    ]
    return tasks, int(np.unique(problem.group[active]).size)


def whole_task(problem: CityProblem, rows: IntArray, chosen: IntArray) -> RegionTask:
    """Return the candidates `rows` (rising) as one task, `chosen` those of them in place."""
    rank = np.full(len(problem.group), -1, dtype=np.int64)
    rank[chosen] = np.arange(len(chosen))
    return _task(problem, rows, rank, 0.0, 0)[0]


def _task(
    problem: CityProblem, rows: IntArray, rank: IntArray, price: float, steps: int
) -> tuple[RegionTask, IntArray]:
    """Cut candidates `rows` out; `rank` (c,) is the place of each in the placement, −1 if none."""
    indptr, indices, blocks = problem.csr
    many = np.diff(indptr)[rows]
    start = np.flatnonzero(np.diff(problem.group[rows], prepend=-1))
    here = np.concatenate([[0], np.cumsum(many)]).astype(np.int64)
    at = np.repeat(indptr[rows] - here[:-1], many) + np.arange(here[-1])
    samples, local = np.unique(indices[at], return_inverse=True)
    held = np.flatnonzero(rank[rows] >= 0)
    task = RegionTask(
        start=np.append(start, len(rows)).astype(np.int64),
        indptr=here,
        indices=local.astype(np.int32),
        blocks=blocks[at],
        weights=problem.weights[samples],
        scale=problem.scale,
        chosen=held[np.argsort(rank[rows[held]])].astype(np.int64),
        price=price,
        steps=steps,
    )
    return task, rows


def _islands(group: IntArray, indptr: IntArray, indices: IntArray) -> IntArray:
    """Number the islands of candidates (c,), in the order of their first; mounts stay whole."""
    mounts, mount = np.unique(group, return_inverse=True)
    row = np.repeat(mount, np.diff(indptr))
    samples, column = np.unique(indices, return_inverse=True)
    n = len(mounts) + len(samples)
    links = sparse.coo_array(
        (np.ones(len(row), np.int8), (row, column + len(mounts))), shape=(n, n)
    ).tocsr()
    found = connected_components(links, directed=False)[1][mount]
    _, first, label = np.unique(found, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[label]
