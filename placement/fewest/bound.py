"""The lower bound on number or price: sweeps of rising effort until one cannot be refuted.

`Counting` proves, for k = 0, 1, …, that no placement of k units keeps one drive in tolerance; it
stops at the first k that its finest sweep cannot refute. With persistent errors, cameras whose
views overlap have their offsets known, which tells at least as much. Relaxed besides: who
stands on which mount, money's and separation's rules, how often a camera is used, the count where
cameras have prices, and that required cameras and those that cost nothing might fail.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from models.geometry import BoolArray, IntArray
from placement.fewest import arrays
from placement.fewest.arrays import (
    MOST_NODES,
    MOST_UNITS,
    Effort,
    Known,
    OutOfTime,
    Store,
    new_store,
)
from placement.fewest.course import course_of, spans
from placement.fewest.graph import backward
from placement.fewest.stretches import floor_reach, least_of_sets, mend
from placement.fewest.sweep import sweep
from placement.fewest.tails import PASSES, ask_tails
from placement.objectives.navigation import WhiteDrive
from placement.objectives.windows.offsets import Views

CHUNK = 8  # samples swept between looks at the clock
MOST_ROWS = 400  # of the table, a sample
EFFORTS = (
    Effort(4, 1, 0.1),
    Effort(12, 2, 0.03),
    Effort(40, 4, 0.01),
    Effort(120, 8, 0.003),
    Effort(300, 16, 0.001),
)
PROBE = Effort(100, 1, 0.02)
MOST_PROBES = 12
EASY = 1_200_000  # labels that a sweep between passes has storage for


class Counting:
    """Sweeps over one drive.

    Inside, units are those of the course: `per_unit` to one of the prices given.
    """

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
        group: IntArray | None = None,
    ) -> None:
        """Prepare for placements of at most `most` of the `usable` (c,) cameras beside `given`.

        units (c,) are the candidates' prices, whole and at least 1 where usable. `drive` has the
        cameras' offsets known; `views` tells what is true of a camera by itself, if that differs.
        Of those of one `group` (c,), 0 or more, there is one at most.
        """
        self._begin = np.full(usable.size, drive.n_samples, dtype=np.int64)
        seeing = np.flatnonzero(np.diff(drive.indptr))
        self._begin[seeing] = drive.indices[drive.indptr[seeing]]
        self.course = course_of(drive, limit, usable, given, units, most, failures, views, group)
        c = self.course
        self.span = int(np.max(np.diff(c.ptr), initial=0))
        self.reach = floor_reach(c.steps, c.base, c.floor, c.limit)
        first, last = spans(c)
        self.first, self.last = first, last
        t = c.steps.shape[0]
        self.floor = np.zeros(t + 1, dtype=np.int64)
        self.sure = np.zeros(t + 1, dtype=np.int64)  # what even cameras in view at t cannot spare
        self.hope = np.zeros(t + 1, dtype=np.int64)
        self.mend()
        self.rows = (np.zeros(t, np.int64), np.zeros(t, np.int64), np.empty((0, 2, 6)),
                     np.empty(0, np.int64))  # fmt: skip
        self._need = int(self.floor[0])
        self._store: Store | None = None
        self.labels = 0
        self.finest = 0

    @property
    def need(self) -> int:
        """The proven number of units of price: whole, as every placement's is."""
        need = max(self._need, int(self.floor[0]))  # at the start nothing is pending
        if need >= MOST_UNITS:  # no number of them suffices
            return need
        return -(-need // self.course.per_unit)

    def begins(self, selected: IntArray) -> IntArray:
        """Return the first sample (m,) at which each of some candidates is in view."""
        return self._begin[selected]

    def prove(
        self,
        most: int,
        stop: Callable[[], bool],
        tell: Callable[[int, float], None] = lambda _n, _share: None,
        efforts: tuple[Effort, ...] = EFFORTS,
    ) -> bool:
        """Raise `need` as far as it goes, or to `most`; return whether time sufficed."""
        try:
            if self.course.failures:
                self._easily(most, stop, tell)
            elif self.need < most and not self._probe(stop, tell):
                return True
            for how in PASSES if self.course.failures else ():
                if self.need >= min(most, MOST_UNITS):
                    break
                ask_tails(self, how, stop, partial(tell, -1))
                self._easily(most, stop, tell)
            while self.need < min(most, MOST_UNITS):
                asked = self.need
                k = asked * self.course.per_unit
                for n, effort in enumerate(efforts):
                    self.finest = max(self.finest, n)
                    report = partial(tell, n)
                    if not self.sweep(k, effort, probing=False, stop=stop, report=report):
                        return True  # no room for more: what is proven stays
                    if self.need > asked:
                        break
                else:
                    return True
        except OutOfTime:
            return False
        return True

    def _easily(
        self, most: int, stop: Callable[[], bool], tell: Callable[[int, float], None]
    ) -> None:
        """Raise `need` while a sweep takes few labels."""
        while self.need < min(most, MOST_UNITS):
            asked = self.need
            k = asked * self.course.per_unit
            report = partial(tell, 0)
            room = self.sweep(k, EFFORTS[0], probing=False, stop=stop, report=report, room=EASY)
            if not room or self.need == asked:
                return

    def _probe(self, stop: Callable[[], bool], tell: Callable[[int, float], None]) -> bool:
        """Learn what the floor needs, until that changes no more; return whether there was room."""
        for _ in range(MOST_PROBES):
            # where no number of cameras does there is nothing to learn
            finite = self.floor < MOST_UNITS
            before = int(np.sum(self.floor, where=finite))
            k = int(np.max(self.floor, where=finite, initial=0)) + self.course.per_unit
            if not self.sweep(k, PROBE, probing=True, stop=stop, report=partial(tell, -1)):
                return False
            if int(np.sum(self.floor, where=finite)) - before <= 0.01 * before:
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
        room: int = MOST_NODES,
    ) -> bool:
        """Sweep once within k units of the course; return whether there was room.

        Learns the table and what is needed. `room` is for how many labels.
        """
        t = self.course.steps.shape[0]
        asked = np.full(t, probing)
        return self._swept(k, effort, asked, 0, t, t if probing else 0, stop, report, room)

    def ask(self, asked: BoolArray, horizon: int, effort: Effort, stop: Callable[[], bool]) -> bool:
        """Ask what the floor needs at the samples `asked` (t,); return whether there was room.

        Labels are followed to the horizon: from there on they need what is known already.
        """
        c, when = self.course, np.flatnonzero(asked)
        k = int(self.floor[when].max()) + c.per_unit
        begin, end = int(when[0]), int(when[-1]) + 1
        return self._swept(k, effort, asked, begin, horizon, end, stop, lambda _share: None)

    def _swept(
        self, k: int, effort: Effort, asked: BoolArray, begin: int, horizon: int, probed: int,
        stop: Callable[[], bool], report: Callable[[float], None], room: int = MOST_NODES,
    ) -> bool:  # fmt: skip
        """Sweep from `begin`, to `probed` from the floor, until no label is left; learn from it."""
        c = self.course
        t = c.steps.shape[0]
        self.floor[:] = np.where(c.settled, -(-self.floor // c.per_unit) * c.per_unit, self.floor)
        known = Known(self.floor, self.hope, *self.rows, asked, horizon)
        store = self._cleared(k) if probed else self.started(k)
        store = store._replace(
            node_need=store.node_need[:room], arc_from=store.arc_from[: 4 * room]
        )
        least = least_of_sets(self.first, self.last, c.units, self.hope)
        bin_epsilon = np.zeros(k + 1)
        while begin < t:
            if stop():
                raise OutOfTime
            report(begin / t)
            end = min(t, begin + CHUNK, probed if begin < probed else t)
            mode = arrays.PROBING if begin < probed else arrays.PROVING
            sweep(begin, end, k, c, known, store, least, effort.width, effort.slots,
                  effort.epsilon, mode, bin_epsilon)  # fmt: skip
            if store.counter[arrays.FULL]:
                return False
            begin = end
            if begin >= probed and is_over(store, begin):
                break
        backward(c, store)
        self.labels += int(store.counter[arrays.NODES])
        if not probed:  # the root's own list entry came as an arc without a parent
            self._need = max(self._need, int(store.node_need[int(store.arc_to[0])]))
        self._learn(store)
        return True

    def mend(self) -> None:
        """Raise what is needed by what is known to be needed later."""
        c = self.course
        mend(self.reach, c.at, self.first, self.last, c.units, self.span, 1 + c.failures,
             self.sure, self.floor, self.hope)  # fmt: skip

    def _cleared(self, k: int) -> Store:
        """Return the storage, made once, empty and with room for k units."""
        if self._store is None:
            self._store = new_store(self.course.failures)
        t, store = self.course.steps.shape[0], self._store
        store.counter[:] = 0
        store.key[:] = 0
        store.counter[arrays.NODES] = 1
        store.node_need[arrays.END], store.node_t[arrays.END] = 0, -1
        store.counter[arrays.FREE] = -1
        each = (k + 1) * (self.span + 2)
        counts = arrays.COUNTS if arrays.COUNTS * each <= arrays.MOST_CROWDS else 0
        return store._replace(
            head=np.full((t + 1, k + 1), -1, dtype=np.int64),
            blind_node=np.full((2, k + 1, self.span + 2), -1, dtype=np.int64),
            crowd_node=np.full((2, k + 1, counts, self.span + 2), -1, dtype=np.int64),
            crowd_p=np.empty((2, k + 1, counts, self.span + 2, 3, 6)),
        )

    def started(self, k: int) -> Store:
        """Return the storage with the root waiting in the list of sample 0."""
        store = self._cleared(k)
        store.head[0, 0] = 0
        store.pool_next[0], store.pool_parent[0], store.pool_units[0] = -1, -1, 0
        store.pool_camera[0], store.pool_waited[0] = -1, False
        store.pool_p[0] = self.course.p0
        store.counter[arrays.POOL] = 1
        return store

    def _learn(self, store: Store) -> None:
        """Take the free labels' needs into the table, and what the floor needs from them."""
        c, n = self.course, int(store.counter[arrays.NODES])
        t = c.steps.shape[0]
        when = store.node_t[:n]
        free = np.flatnonzero((when >= 0) & (store.node_need[:n] > self.floor[np.maximum(when, 0)]))
        at_floor = np.all(store.node_p[free, 0] == c.floor[when[free]], axis=1) & np.all(
            store.node_p[free, 1] == c.floor[when[free]], axis=1
        )
        np.maximum.at(self.floor, when[free[at_floor]], store.node_need[free[at_floor]])
        self.mend()
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


def is_over(store: Store, t: int) -> bool:
    """Return whether no label is left that sample t or a later one would see."""
    side = t % 2
    return bool(
        store.counter[arrays.N_COUNTERS] == 0
        and store.head[t:].max(initial=-1) < 0
        and store.blind_node[side].max(initial=-1) < 0
        and store.crowd_node[side].max(initial=-1) < 0
    )
