"""What a sweep reads and writes, as named tuples of arrays that compiled kernels take.

Sizes: t samples, k cameras at most, v moves, `span` samples in the longest view.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from models.geometry import FloatArray, IntArray

# Counters of a sweep, in an int64 array.
NODES, ARCS, POOL, FREE, FULL, MERGES, PRUNED, LOOKS = range(8)
N_COUNTERS = 8
# Labels inside a cluster are kept apart by the camera whose view lasts longest (its last sample,
# and its family among those of the same) and by how long the second lasts: its class, by share
# of the span; class 0 is a cluster of one so far.
CLASSES = 6


class Road(NamedTuple):
    """The drive: what a step costs, what is known without any camera, and floors below all."""

    steps: FloatArray  # (t, N_STEP)
    base: FloatArray  # (t, 3) information that every placement has
    w_tt: float
    w_nn: float
    floor_p: FloatArray  # (t, 6) below every placement's covariance before the sample
    floor_cost: FloatArray  # (t + 1,) below every placement's cost of the samples before
    near_form: FloatArray  # (t, 6) product with P: how costly a covariance is to carry on


class Views(NamedTuple):
    """The moves, by first sample: see `placement.diagram.moves.Moves`."""

    ptr: IntArray
    blocks: FloatArray
    at: IntArray
    family: IntArray
    families: int
    span: int
    rest: FloatArray  # (t, span, 3) what the cameras beyond the last count may add that start at t
    rest_length: IntArray  # (t,) for how many samples; 0 where all cameras are counted


class Table(NamedTuple):
    """Points (P, togo) by sample and count: rows lo[t, m]…hi[t, m] − 1, togo falling."""

    lo: IntArray
    hi: IntArray
    p: FloatArray
    togo: FloatArray


class Rules(NamedTuple):
    """How finely labels are told apart, and what a placement may cost.

    `threshold`: placements that cost as much are forgotten. `width`: labels a sample and count;
    `epsilon`: labels this near are merged in any case, `slack`: more so where they promise less.
    `coarse`, `coarse_width`: the same for labels from which clusters start. `slots`: labels inside
    clusters for each end and class. `probing`: labels start everywhere, from the floor. `price`:
    what a camera costs, in the unit of the sum; if that is not 0, cameras are paid for and not
    counted: labels have count 0, and inside clusters how many joined at this sample, and 1.
    """

    threshold: float
    width: int
    epsilon: float
    slack: float
    coarse: float
    coarse_width: int
    slots: int
    probing: bool
    price: float


class Pool(NamedTuple):
    """Labels that wait for their sample, in lists from `head`; freed places are used again."""

    head: IntArray  # (t + 1, k + 1)
    next: IntArray
    parent: IntArray
    move: IntArray
    value: FloatArray  # (·, 9): cost, cost of the arc, rank, P


class Pending(NamedTuple):
    """The labels inside clusters, of this sample and of the next, by `slot_of`."""

    node: IntArray
    cost: FloatArray
    near: FloatArray
    p: FloatArray  # (·, 6)
    second: IntArray
    blocks: FloatArray  # (·, span, 3)


class Nodes(NamedTuple):
    """All labels so far; those without anything pending are rows lo[t, m]…hi[t, m] − 1."""

    lo: IntArray
    hi: IntArray
    p: FloatArray
    cost: FloatArray
    togo: FloatArray


class Arcs(NamedTuple):
    """What led from label to label, in the order of recording: into a label before out of it."""

    source: np.typing.NDArray[np.int32]
    target: np.typing.NDArray[np.int32]
    move: np.typing.NDArray[np.int32]
    cost: FloatArray


class Storage(NamedTuple):
    """Everything one sweep fills."""

    pool: Pool
    pending: Pending
    nodes: Nodes
    arcs: Arcs
    counter: IntArray


def new_storage(
    t: int, k: int, views: Views, slots: int, nodes: int, arcs: int, pool: int
) -> Storage:
    """Reserve room for a sweep; the system commits memory as it fills."""
    n_slots = 2 * CLASSES * views.families * (k + 1) * (views.span + 1) * slots
    counter = np.zeros(N_COUNTERS, dtype=np.int64)
    counter[FREE] = -1
    return Storage(
        Pool(
            np.full((t + 1, k + 1), -1, dtype=np.int64),
            np.empty(pool, dtype=np.int64),
            np.empty(pool, dtype=np.int64),
            np.empty(pool, dtype=np.int64),
            np.empty((pool, 9)),
        ),
        Pending(
            np.full(n_slots, -1, dtype=np.int64),
            np.empty(n_slots),
            np.empty(n_slots),
            np.empty((n_slots, 6)),
            np.zeros(n_slots, dtype=np.int64),
            np.empty((n_slots, views.span, 3)),
        ),
        Nodes(
            np.zeros((t, k + 1), dtype=np.int64),
            np.zeros((t, k + 1), dtype=np.int64),
            np.empty((nodes, 6)),
            np.empty(nodes),
            np.empty(nodes),
        ),
        Arcs(
            np.empty(arcs, dtype=np.int32),
            np.empty(arcs, dtype=np.int32),
            np.empty(arcs, dtype=np.int32),
            np.empty(arcs),
        ),
        counter,
    )


def empty_table(t: int, k: int) -> Table:
    """Return a table that knows nothing."""
    zeros = np.zeros((t + 1, k + 1), dtype=np.int64)
    return Table(zeros, zeros.copy(), np.empty((0, 6)), np.empty(0))


def add_root(pool: Pool, counter: IntArray, m: int, cost: float, p0: FloatArray) -> None:
    """Let a label of count `m` wait at the first sample."""
    x = counter[POOL]
    pool.head[0, m] = x
    pool.next[x] = pool.parent[x] = pool.move[x] = -1
    pool.value[x] = [cost, 0.0, -np.inf, *p0]
    counter[POOL] += 1
