"""The lower bound on number or price: sweeps of rising effort until one cannot be refuted.

`Counting` proves, for k = 0, 1, …, that no placement of k units keeps one drive in tolerance; it
stops at the first k that its finest sweep cannot refute. With persistent errors, cameras whose
views overlap have their offsets known, which tells at least as much. Relaxed besides: who
stands on which mount, money's and separation's rules, how often a camera is used, the count where
cameras have prices, and that required cameras and those that cost nothing might fail.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from models.geometry import BoolArray, FloatArray, IntArray
from placement.diagram.moves import TWINS, floor_information, three_columns, undominated
from placement.fewest import labels
from placement.fewest.labels import DEPTH, KEY_BITS, MOST_UNITS, Course, Known, Store
from placement.objectives.navigation import WhiteDrive
from placement.objectives.windows.filter import (
    empty_messages,
    filter_forward,
    predict,
    row6,
    update,
)
from placement.objectives.windows.offsets import Views

CHUNK = 8  # samples swept between looks at the clock
ROUNDING = 1e-9  # relative, of the limit
MOST_ROWS = 400  # of the table, a sample
MOST_LEVELS = 200  # units that the dearest camera may cost
NODES, ARCS, POOL, SETS = 8_000_000, 24_000_000, 500_000, 60_000


@dataclass(frozen=True, slots=True)
class Effort:
    """How finely a sweep tells labels apart."""

    width: int  # free labels a sample and price
    slots: int  # labels of one set of cameras in view
    epsilon: float  # the least ratio between labels that are merged


EFFORTS = (
    Effort(4, 1, 0.1),
    Effort(12, 2, 0.03),
    Effort(40, 4, 0.01),
    Effort(120, 8, 0.003),
    Effort(300, 16, 0.001),
)
PROBE = Effort(100, 1, 0.02)
MOST_PROBES = 12


class OutOfTime(Exception):  # noqa: N818 - a signal, not an error
    """A sweep was stopped by the clock."""


class Counting:
    """Sweeps over one drive; `need` is the proven number of units."""

    def __init__(
        self,
        drive: WhiteDrive,
        limit: float,
        usable: BoolArray,
        given: IntArray,
        units: IntArray,
        most: int,
        failures: int,
        views: Views | None = None,
    ) -> None:
        """Prepare for placements of at most `most` of the `usable` (c,) cameras beside `given`.

        units (c,) are the candidates' prices, whole and at least 1 where usable. `drive` has the
        cameras' offsets known; `views` tells what is true of a camera by itself, if that differs.
        """
        self.course = course_of(drive, limit, usable, given, units, most, failures, views)
        c = self.course
        self.span = int(np.max(np.diff(c.ptr), initial=0))
        self.reach = floor_reach(c.steps, c.base, c.floor, c.limit)
        first, last = spans(c)
        self.first, self.last = first, last
        t = c.steps.shape[0]
        self.floor = np.zeros(t + 1, dtype=np.int64)
        self.sure = np.zeros(t + 1, dtype=np.int64)  # what even cameras in view at t cannot spare
        stretches(self.reach, first, last, c.units, 1 + failures, self.sure)
        self.floor[:] = self.sure
        self.hope = self.sure.copy()
        if not failures:
            by_chains(self.reach, first, last, c.units, self.floor, self.hope)
        self.rows = (np.zeros(t, np.int64), np.zeros(t, np.int64), np.empty((0, 2, 6)),
                     np.empty(0, np.int64))  # fmt: skip
        self.need = int(self.floor[0])
        self._store: Store | None = None
        self.labels = 0
        self.finest = 0

    def prove(
        self,
        most: int,
        stop: Callable[[], bool],
        tell: Callable[[int, float], None] = lambda _n, _share: None,
        efforts: tuple[Effort, ...] = EFFORTS,
    ) -> bool:
        """Raise `need` as far as it goes, or to `most`; return whether time sufficed."""
        try:
            if not self.course.failures and not self._probe(stop, tell):
                return True
            while self.need < min(most, MOST_UNITS):
                k = self.need
                for n, effort in enumerate(efforts):
                    self.finest = max(self.finest, n)
                    report = lambda share, n=n: tell(n, share)  # noqa: E731
                    if not self.sweep(k, effort, probing=False, stop=stop, report=report):
                        return True  # no room for more: what is proven stays
                    if self.need > k:
                        break
                else:
                    return True
        except OutOfTime:
            return False
        return True

    def _probe(self, stop: Callable[[], bool], tell: Callable[[int, float], None]) -> bool:
        """Learn what the floor needs, until that changes no more; return whether there was room."""
        for _ in range(MOST_PROBES):
            before = int(np.sum(self.floor))
            if not self.sweep(int(self.floor.max()) + 1, PROBE, probing=True, stop=stop,
                              report=lambda share: tell(-1, share)):  # fmt: skip
                return False
            if int(np.sum(self.floor)) - before <= 0.01 * before:
                break
        return True

    def sweep(
        self,
        k: int,
        effort: Effort,
        *,
        probing: bool,
        stop: Callable[[], bool],
        report: Callable[[float], None] = lambda _share: None,
    ) -> bool:
        """Sweep once within k units; return whether there was room. Learns table and `need`."""
        c = self.course
        t = c.steps.shape[0]
        known = Known(self.floor, self.hope, *self.rows)
        store = self._cleared(k)
        if not probing:  # the root waits in the list of sample 0
            store.head[0, 0] = 0
            store.pool_next[0], store.pool_parent[0], store.pool_units[0] = -1, -1, 0
            store.pool_p[0] = c.p0
            store.counter[labels.POOL] = 1
        least = least_of_sets(self.first, self.last, c.units, self.hope)
        bin_epsilon = np.zeros(k + 1)
        for begin in range(0, t, CHUNK):
            if stop():
                raise OutOfTime
            report(begin / t)
            labels.sweep(begin, min(t, begin + CHUNK), k, c, known, store, least, effort.width,
                         effort.slots, effort.epsilon, probing, bin_epsilon)  # fmt: skip
            if store.counter[labels.FULL]:
                return False
        labels.backward(store)
        self.labels += int(store.counter[labels.NODES])
        if not probing:  # the root's own list entry came as an arc without a parent
            self.need = max(self.need, int(store.node_need[int(store.arc_to[0])]))
        self._learn(store)
        return True

    def _cleared(self, k: int) -> Store:
        """Return the storage, made once, empty and with room for k units."""
        if self._store is None:
            self._store = new_store(self.course.failures)
        t, store = self.course.steps.shape[0], self._store
        store.counter[:] = 0
        store.counter[labels.FREE] = -1
        return store._replace(
            head=np.full((t + 1, k + 1), -1, dtype=np.int64),
            blind_node=np.full((2, k + 1, self.span + 2), -1, dtype=np.int64),
            reached=np.zeros(k + 1, dtype=np.bool_),
        )

    def _learn(self, store: Store) -> None:
        """Take the free labels' needs into the table, and what the floor needs from them."""
        c, n = self.course, int(store.counter[labels.NODES])
        t = c.steps.shape[0]
        when = store.node_t[:n]
        free = np.flatnonzero((when >= 0) & (store.node_need[:n] > self.floor[np.maximum(when, 0)]))
        at_floor = np.all(store.node_p[free, 0] == c.floor[when[free]], axis=1) & np.all(
            store.node_p[free, 1] == c.floor[when[free]], axis=1
        )
        np.maximum.at(self.floor, when[free[at_floor]], store.node_need[free[at_floor]])
        chains(self.first, self.last, c.units, self.floor, self.sure, self.hope)
        free = free[store.node_need[free] > self.floor[when[free]]]
        lo, hi, p, need = self.rows
        old_t = np.repeat(np.arange(t), hi - lo)
        keep = need > self.floor[old_t]
        times = np.concatenate([when[free], old_t[keep]])
        needs = np.concatenate([store.node_need[free], need[keep]])
        ps = np.concatenate([store.node_p[free], p[keep]])
        order = np.lexsort((-needs, times))
        times, needs, ps = times[order], needs[order], ps[order]
        place = np.arange(times.size) - np.searchsorted(times, times)
        kept = place < MOST_ROWS
        times, needs, ps = times[kept], needs[kept], ps[kept]
        self.rows = (
            np.searchsorted(times, np.arange(t)), np.searchsorted(times, np.arange(t), "right"),
            np.ascontiguousarray(ps), needs,
        )  # fmt: skip


def whole_units(cost: FloatArray, usable: BoolArray) -> tuple[IntArray, float]:
    """Return prices (c,) in whole units, rounded down, and the unit.

    The unit is the cheapest positive price over the least whole number for which every price is
    a multiple, if there is one that leaves the dearest at `MOST_LEVELS` or less.
    """
    priced = cost[usable & (cost > 0.0)]
    if not priced.size:
        return np.zeros(cost.size, dtype=np.int64), 1.0
    low, high = float(priced.min()), float(priced.max())
    unit = max(low, high / MOST_LEVELS)
    for parts in range(1, 21):
        trial = low / parts
        if high / trial > MOST_LEVELS:
            break
        share = np.unique(priced) / trial
        if np.all(np.abs(share - np.round(share)) <= 1e-9 * share):
            unit = trial
            break
    units = np.floor(cost / unit * (1.0 + 1e-9) + 1e-12).astype(np.int64)
    return units, unit


def course_of(
    drive: WhiteDrive,
    limit: float,
    usable: BoolArray,
    given: IntArray,
    units: IntArray,
    most: int,
    failures: int,
    views: Views | None,
) -> Course:
    """Lay out the drive and the cameras that none of the same price or cheaper exceeds.

    With persistent errors all that see something stay: offsets are not compared.
    """
    views_of = drive
    drive, tails = without_second_views(drive, usable)
    blocks = three_columns(drive)
    kept = []
    if views is not None:
        kept.append(np.flatnonzero(usable & (np.diff(drive.indptr) > 0)))
    for level in np.unique(units[usable]) if views is None else []:
        best = undominated(drive.indptr, drive.indices, blocks, usable & (units <= level))
        kept.append(best[units[best] == level])
    who = np.concatenate(kept) if kept else np.empty(0, dtype=np.int64)
    if who.size >= 2**KEY_BITS - 1:
        raise ValueError(
            f"method tolerance needs fewer than {2**KEY_BITS - 1:,} useful candidates, "
            f"got {who.size:,}: coarsen mounts or poses"
        )
    first = drive.indices[drive.indptr[who]].astype(np.int64)
    order = np.argsort(first, kind="stable")
    who, first = who[order], first[order]
    last = drive.indices[drive.indptr[who + 1] - 1].astype(np.int64)
    ptr = np.concatenate(([0], np.cumsum(last - first + 1))).astype(np.int64)
    dense = np.zeros((int(ptr[-1]), 3))
    for v, i in enumerate(who):
        row = slice(drive.indptr[i], drive.indptr[i + 1])
        dense[ptr[v] + drive.indices[row] - first[v]] = (1.0 + TWINS) * blocks[row]
    base = drive.total(given) + tails
    floor = base + (1.0 + 1e-9) * floor_information(drive, usable, max(most, 1))
    before, after, logs = empty_messages(drive.n_samples)
    filter_forward(drive.steps, drive.p0, floor, before, after, logs)
    return Course(
        steps=drive.steps,
        p0=drive.p0,
        base=base,
        ptr=ptr,
        blocks=dense,
        at=np.searchsorted(first, np.arange(drive.n_samples + 1)).astype(np.int64),
        units=units[who],
        floor=before * (1.0 - 1e-12),
        limit=limit * (1.0 + ROUNDING),
        failures=failures,
        who=who,
        indptr=views_of.indptr,
        indices=views_of.indices,
        white=np.empty((0, 3), dtype=np.float32) if views is None else views.white,
        offsets=np.empty((0, 2, 0), dtype=np.float32) if views is None else views.offsets,
        frames=drive.frames,
    )


def without_second_views(drive: WhiteDrive, usable: BoolArray) -> tuple[WhiteDrive, FloatArray]:
    """Return the drive without what cameras see after half a drive's blindness, and that in sum.

    On a closed road a camera near the start sees the car again at the end: as one window that
    would span the whole lap. What it sees at the end is given to every placement instead, (t, 3).
    """
    seen = drive.indices.astype(np.int64)
    row = np.repeat(np.arange(drive.indptr.size - 1), np.diff(drive.indptr))
    jump = np.zeros(seen.size, dtype=np.int64)
    jump[1:] = np.where(row[1:] == row[:-1], seen[1:] - seen[:-1], 0)
    far = np.cumsum(jump > drive.n_samples // 2)
    before = np.concatenate(([0], far))[drive.indptr[row]]
    second = far > before
    tails = np.zeros((drive.n_samples, 3))
    if not second.any():
        return drive, tails
    free = second & usable[row]
    np.add.at(tails, seen[free], three_columns(drive)[free])
    part = copy.copy(drive)
    keep = ~second
    part.indptr = np.concatenate(([0], np.cumsum(keep)))[drive.indptr].astype(np.int64)
    part.indices = np.ascontiguousarray(drive.indices[keep])
    part.blocks = np.ascontiguousarray(drive.blocks[keep])
    return part, tails


def new_store(failures: int) -> Store:
    """Return storage, but for what depends on the units; the system commits it as it fills."""
    scenarios = 2 + DEPTH if failures else 1
    buckets = 1 << int(4 * SETS - 1).bit_length()
    nothing = np.empty((0, 0), dtype=np.int64)
    return Store(
        head=nothing,
        pool_next=np.empty(POOL, dtype=np.int64),
        pool_parent=np.empty(POOL, dtype=np.int64),
        pool_units=np.empty(POOL, dtype=np.int64),
        pool_p=np.empty((POOL, 2, 6)),
        node_need=np.empty(NODES, dtype=np.int64),
        node_t=np.empty(NODES, dtype=np.int64),
        node_p=np.empty((NODES, 2, 6)),
        arc_from=np.empty(ARCS, dtype=np.int64),
        arc_to=np.empty(ARCS, dtype=np.int64),
        arc_units=np.empty(ARCS, dtype=np.int64),
        set_m=np.empty((2, SETS), dtype=np.int64),
        set_n=np.empty((2, SETS), dtype=np.int64),
        set_ids=np.zeros((2, SETS, DEPTH), dtype=np.int64),
        set_flag=np.zeros((2, SETS), dtype=np.bool_),
        set_node=np.empty((2, SETS), dtype=np.int64),
        set_p=np.empty((2, SETS, scenarios, 6)),
        key=np.zeros(buckets, dtype=np.int64),
        key_first=np.empty(buckets, dtype=np.int64),
        set_next=np.empty(SETS, dtype=np.int64),
        blind_node=np.empty((0, 0, 0), dtype=np.int64),
        reached=np.empty(0, dtype=np.bool_),
        counter=np.zeros(labels.N_COUNTERS + 1, dtype=np.int64),
    )


def spans(course: Course) -> tuple[IntArray, IntArray]:
    """Return the first and last sample (v,) of each camera."""
    first = np.repeat(np.arange(course.steps.shape[0]), np.diff(course.at))
    return first, first + np.diff(course.ptr) - 1


@njit(cache=True)
def floor_reach(steps, base, floor, limit):  # type: ignore[no-untyped-def]
    """Return (t,) the first violation of a car that knows all before t, and then drives alone."""
    t_end = steps.shape[0]
    out = np.empty(t_end, dtype=np.int64)
    for t in range(t_end):
        p = row6(floor, t)
        out[t] = t_end
        for s in range(t, t_end):
            if s > t:
                p = predict(p, steps[s])
            q0, q1, q2, q3, q4, q5, _ = update(p, base[s, 0], base[s, 1], base[s, 2])
            p = (q0, q1, q2, q3, q4, q5)
            if q3 > limit:
                out[t] = s
                break
    return out


@njit(cache=True)
def stretches(reach, first, last, units, times, out):  # type: ignore[no-untyped-def]
    """Fill `out` (t + 1,): units that stretches after t need, no camera seeing two of them.

    Within t…reach(t) someone must see the car, `times` over; whoever sees it there sees nothing
    from the end of the last such view on. Cameras may be in view at t already.
    """
    t_end = reach.size
    out[t_end] = 0
    for t in range(t_end - 1, -1, -1):
        out[t] = 0
        if reach[t] == t_end:
            continue
        least, end = np.int64(1_000_000), t
        for v in range(first.size):
            if first[v] <= reach[t] and last[v] >= t:
                least = min(least, units[v])
                end = max(end, last[v] + 1)
        if end == t:
            out[t] = 1_000_000
        else:
            out[t] = min(1_000_000, times * least + out[end])


@njit(cache=True)
def by_chains(reach, first, last, units, floor, hope):  # type: ignore[no-untyped-def]
    """Raise `floor` and `hope` (t + 1,) by the cheapest chain of cameras, each in reach."""
    t_end = reach.size
    for t in range(t_end - 1, -1, -1):
        if reach[t] < t_end:
            best = np.int64(1_000_000)
            for v in range(first.size):
                if t <= first[v] <= reach[t]:
                    best = min(best, units[v] + hope[last[v] + 1])
            floor[t] = max(floor[t], best)
        hope[t] = max(hope[t], hoped(t, first, last, units, floor, hope))


@njit(cache=True)
def hoped(t, first, last, units, floor, hope):  # type: ignore[no-untyped-def]
    """Return the least of `floor` at t and of a camera that sees t, come from before it."""
    best = floor[t]
    for v in range(first.size):
        if first[v] < t <= last[v]:
            best = min(best, units[v] + hope[last[v] + 1])
    return best


@njit(cache=True)
def chains(first, last, units, floor, sure, hope):  # type: ignore[no-untyped-def]
    """Fill `hope` (t + 1,) from `floor`: what the end of a set needs if cameras may follow in it.

    `sure` is needed even then.
    """
    t_end = floor.size - 1
    hope[t_end] = 0
    for t in range(t_end - 1, -1, -1):
        hope[t] = max(sure[t], hope[t], hoped(t, first, last, units, floor, hope))


@njit(cache=True)
def least_of_sets(first, last, units, hope):  # type: ignore[no-untyped-def]
    """Return (v,) what a set takes at least that starts with a camera and holds another."""
    out = np.empty(first.size, dtype=np.int64)
    for v in range(first.size):
        best = np.int64(1_000_000)
        w = v
        while w > 0 and first[w - 1] == first[v]:
            w -= 1
        while w < first.size and first[w] <= last[v]:
            best = min(best, units[w] + hope[max(last[v], last[w]) + 1])
            w += 1
        out[v] = units[v] + best
    return out
