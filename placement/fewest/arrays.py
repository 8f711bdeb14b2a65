"""What a sweep reads and writes: one drive with its cameras, what is known, and the storage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray

# Of kernels that allocate nothing and return no array: with references counted, each would count
# them for the forty arrays of a store at every call, which takes most of the time to compile it.
LEAN: dict[str, Any] = {"cache": True, "_nrt": False, "no_cfunc_wrapper": True}
COUNTED: dict[str, Any] = {"cache": True, "_nrt": True}  # one that allocates, called by a lean one
# What kernels hand to each other is of 64 bits: they would be compiled again for a plain 0 alone.
ZERO = np.int64(0)
NO_CAMERA = np.int64(-1)

DEPTH = 3  # cameras in view at once that are told apart
COUNTS = 3  # sizes of crowds that are told apart, from DEPTH + 1
MOST_CROWDS = 1_000_000  # labels, one sample
PROVING, PROBING, FINDING = range(3)  # what a sweep is for
WAITED = np.int64(-2)  # in place of a camera: none was in view
END = 0  # the node of every drive that is over
NODES, ARCS, POOL, FREE, FULL, BLIND = range(6)
N_COUNTERS = 6
KEY_BITS = 18  # of a camera, or a second one, in the key of a set; `Course` holds fewer than 2**17
MOST_UNITS = 100_000  # as good as infinitely many
MOST_NODES, MOST_ARCS, MOST_WAITING, MOST_SETS = 12_000_000, 48_000_000, 500_000, 60_000


class OutOfTime(Exception):  # noqa: N818 - a signal, not an error
    """A sweep was stopped by the clock."""


@dataclass(frozen=True, slots=True)
class Effort:
    """How finely a sweep tells labels apart."""

    width: int  # free labels a sample and price
    slots: int  # labels of one set of cameras in view
    epsilon: float  # the least ratio between labels that are merged


class Course(NamedTuple):
    """One drive and its cameras, sorted by their first sample (v) and priced in whole units."""

    steps: FloatArray
    p0: FloatArray
    base: FloatArray  # (t, 3) information of cameras that are there in any case
    ptr: IntArray  # (v + 1,) rows of blocks: one a sample from first to last
    blocks: FloatArray  # (n, 3)
    second: FloatArray  # (n, 3) the same of a camera's second copy, of id v + number of cameras
    twice: BoolArray  # (v,) whether that tells anything
    best: FloatArray  # (t, 3) above the block of every camera
    at: IntArray  # (t + 1,) cameras that start at t
    first: IntArray  # (v,) the sample at which each starts
    units: IntArray  # (v,)
    per_unit: int  # units that a unit of the prices given is cut into
    settled: BoolArray  # (t + 1,) whether no camera has pieces on both sides of t: prices are whole
    floor: FloatArray  # (t, 6) below every covariance before the measurements of t
    limit: float
    failures: int
    # cameras as they are, not as the bound relaxes them
    owner: IntArray  # (2 v,) the candidates whose pieces the cameras and their seconds are
    group: IntArray  # (2 v,) their mounts, −1 where others may stand there
    whole: IntArray  # (v,) its price, borne by the piece that tells most; MOST_UNITS of others
    plain: FloatArray  # (t, 3) `base` without what the bound gives to everybody
    # where errors persist: who the cameras are, and what `offsets.Views` holds of them
    who: IntArray
    indptr: IntArray
    indices: NDArray[np.int32]
    white: NDArray[np.float32]
    offsets: NDArray[np.float32]  # (nnz, 2, p), p = 0 where every frame errs afresh
    frames: float


class Known(NamedTuple):
    """What is known to be needed: from the floor, from the end of a set, and from table rows."""

    floor: IntArray  # (t + 1,) units from the floor at t, nothing pending
    hope: IntArray  # (t + 1,) the same where overlapping cameras may still follow
    lo: IntArray  # (t,) rows of the table, most needed first
    hi: IntArray
    p: FloatArray  # (n, 2, 6)
    need: IntArray  # (n,)
    asked: BoolArray  # (t,) where a probing sweep lets the floor start a label
    horizon: int  # from where on free labels are followed no more: they need what they are known to


class Store(NamedTuple):
    """What a sweep writes to."""

    head: IntArray  # (t + 1, k + 1) lists of labels waiting for their sample
    pool_next: IntArray
    pool_parent: IntArray
    pool_units: IntArray
    pool_camera: NDArray[np.int32]
    pool_waited: BoolArray
    pool_p: FloatArray  # (·, 2, 6)
    node_need: IntArray
    node_t: IntArray  # where free labels are, −1 for others
    node_p: FloatArray  # (nodes, 2, 6)
    arc_from: NDArray[np.int32]
    arc_to: NDArray[np.int32]
    arc_units: NDArray[np.int32]
    arc_camera: NDArray[np.int32]
    set_m: IntArray  # (2, sets) of this sample and the next
    set_n: IntArray
    set_ids: IntArray  # (2, sets, DEPTH)
    set_flag: BoolArray  # whether more than one camera was ever in it
    set_node: IntArray
    set_p: FloatArray  # (2, sets, scenarios, 6)
    key: IntArray  # a hash table of the next sample's sets
    key_m: IntArray
    key_first: IntArray
    set_next: IntArray  # sets of one key
    set_at: IntArray  # where in the table that is
    blind_node: IntArray  # (2, k + 1, span + 2) by how long it lasts; −1 for none
    crowd_node: IntArray  # (2, k + 1, counts, span + 2)
    crowd_p: (
        FloatArray  # (2, k + 1, counts, span + 2, 3, 6): intact, an earlier one dark, one of it
    )
    counter: IntArray


def new_store(failures: int) -> Store:
    """Return storage, but for what depends on the units; the system commits it as it fills."""
    scenarios = 2 + DEPTH if failures else 1
    buckets = 1 << int(4 * MOST_SETS - 1).bit_length()
    nothing = np.empty((0, 0), dtype=np.int64)
    return Store(
        head=nothing,
        pool_next=np.empty(MOST_WAITING, dtype=np.int64),
        pool_parent=np.empty(MOST_WAITING, dtype=np.int64),
        pool_units=np.empty(MOST_WAITING, dtype=np.int64),
        pool_camera=np.empty(MOST_WAITING, dtype=np.int32),
        pool_waited=np.empty(MOST_WAITING, dtype=np.bool_),
        pool_p=np.empty((MOST_WAITING, 2, 6)),
        node_need=np.empty(MOST_NODES, dtype=np.int64),
        node_t=np.empty(MOST_NODES, dtype=np.int64),
        node_p=np.empty((MOST_NODES, 2, 6)),
        arc_from=np.empty(MOST_ARCS, dtype=np.int32),
        arc_to=np.empty(MOST_ARCS, dtype=np.int32),
        arc_units=np.empty(MOST_ARCS, dtype=np.int32),
        arc_camera=np.empty(MOST_ARCS, dtype=np.int32),
        set_m=np.empty((2, MOST_SETS), dtype=np.int64),
        set_n=np.empty((2, MOST_SETS), dtype=np.int64),
        set_ids=np.zeros((2, MOST_SETS, DEPTH), dtype=np.int64),
        set_flag=np.zeros((2, MOST_SETS), dtype=np.bool_),
        set_node=np.empty((2, MOST_SETS), dtype=np.int64),
        set_p=np.empty((2, MOST_SETS, scenarios, 6)),
        key=np.zeros(buckets, dtype=np.int64),
        key_m=np.empty(buckets, dtype=np.int64),
        key_first=np.empty(buckets, dtype=np.int64),
        set_next=np.empty(MOST_SETS, dtype=np.int64),
        set_at=np.empty(MOST_SETS, dtype=np.int64),
        blind_node=np.empty((0, 0, 0), dtype=np.int64),
        crowd_node=np.empty((0, 0, 0, 0), dtype=np.int64),
        crowd_p=np.empty((0, 0, 0, 0, 0, 0)),
        counter=np.zeros(N_COUNTERS + 1, dtype=np.int64),
    )
