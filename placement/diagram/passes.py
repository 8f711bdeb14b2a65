"""Sweeps of rising width over one drive, each pruned by the labels of those before it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from models.geometry import BoolArray, FloatArray, IntArray
from placement.diagram import sweep
from placement.diagram.moves import Moves, floor_information, make_moves
from placement.objectives.navigation import WhiteDrive
from placement.objectives.windows.filter import empty_messages, filter_forward

CHUNK = 4  # samples swept between looks at the clock
ROUNDING = 1e-8  # relative; what bounds give up for rounding along the sweep
NODES, ARCS, POOL = 24_000_000, 80_000_000, 1_000_000  # committed by the system as they fill
# What labels inside clusters may hold: (cameras + 1)·span², some 3 kB each at eight slots.
MOST_PENDING = 400_000
EPSILON = 1e-4  # the least ratio between labels that are merged
COARSE = 0.03  # the same for labels that try clusters


class OutOfTime(Exception):  # noqa: N818 - a signal, not an error
    """The sweep was stopped by the clock."""


@dataclass(slots=True)
class Table:
    """Points (P, togo) by sample and count: rows lo[t, m]…hi[t, m] − 1, togo falling."""

    lo: IntArray
    hi: IntArray
    p: FloatArray
    togo: FloatArray


@dataclass(slots=True)
class Outcome:
    """What one sweep found: the bound on the sum over samples, and the moves of its best path."""

    bound: float
    path: list[int]
    labels: int
    width: int
    epsilon: float
    seconds: float
    reached: BoolArray
    counters: list[int] = field(default_factory=list)


class Diagram:
    """The relaxed decision diagram of one drive under one weight."""

    def __init__(
        self,
        drive: WhiteDrive,
        weight: tuple[float, float],
        usable: BoolArray,
        required: IntArray,
        budget: int,
        limit: float = np.inf,
    ) -> None:
        """Prepare for at most `budget` of the `usable` (c,) cameras beside the required ones.

        Partial placements whose lateral variance exceeds `limit` somewhere do not count.
        """
        self.drive = drive
        self.weight = weight
        self.limit = limit
        self.budget = budget
        self.base = drive.total(required)
        self.moves: Moves = make_moves(drive, usable)
        if (budget + 1) * self.moves.span**2 > MOST_PENDING:
            raise ValueError(
                "method diagram needs short views, got one whose first and last sample are "
                f"{self.moves.span} samples of {drive.n_samples} apart: use search"
            )
        floor = self.base + floor_information(drive, usable, budget)
        before, after, logs = empty_messages(drive.n_samples)
        filter_forward(drive.steps, drive.p0, floor, before, after, logs)
        self.floor_p = before * (1.0 - 1e-12)
        paid = weight[0] * after[:, 0] + weight[1] * after[:, 3]
        self.floor_cost = np.concatenate(([0.0], np.cumsum(paid))) * (1.0 - 1e-12)
        self.near_form = near_form(
            drive.steps, *weight, max(1, drive.n_samples // (2 * max(budget, 1)))
        )
        self.table = empty_table(drive.n_samples, budget)
        self.bound = float(self.floor_cost[-1])

    def sweep(
        self,
        width: int,
        threshold: float,
        out_of_time: Callable[[], bool],
        *,
        probing: bool = False,
        epsilon: float | None = None,
        slack: float = 0.0,
        coarse_width: int = 4,
        slots: int = 2,
        progress: Callable[[float], None] = lambda _share: None,
    ) -> Outcome | None:
        """Sweep once, forgetting placements that cost `threshold` or more in sum.

        Improves `bound` and the table. Return None if storage ran out.

        Raises:
            OutOfTime: before the bound is known; nothing is changed then.
        """
        start = time.monotonic()
        d, k, moves, table = self.drive, self.budget, self.moves, self.table
        t = d.n_samples
        head = np.full((t + 1, k + 1), -1, dtype=np.int64)
        pool_next = np.empty(POOL, dtype=np.int64)
        pool_parent = np.empty(POOL, dtype=np.int64)
        pool_move = np.empty(POOL, dtype=np.int64)
        pool_float = np.empty((POOL, 9))
        n_slots = 2 * sweep.CLASSES * moves.families * (k + 1) * (moves.span + 1) * slots
        pend_node = np.full(n_slots, -1, dtype=np.int64)
        pend_cost, pend_near, pend_p = np.empty(n_slots), np.empty(n_slots), np.empty((n_slots, 6))
        pend_second = np.zeros(n_slots, dtype=np.int64)
        pend_blocks = np.empty((n_slots, moves.span, 3))
        node_lo, node_hi = (np.zeros((t, k + 1), dtype=np.int64) for _ in range(2))
        node_p, node_cost, node_togo = np.empty((NODES, 6)), np.empty(NODES), np.empty(NODES)
        arc_from, arc_to, arc_move = (np.empty(ARCS, dtype=np.int32) for _ in range(3))
        arc_cost = np.empty(ARCS)
        bin_epsilon = np.zeros(k + 1)
        hope = np.zeros((t + 1, k + 2))
        sweep.hopes(
            self.floor_p, self.floor_cost, moves.span, table.lo, table.hi, table.p, table.togo, hope
        )
        reached = np.zeros(k + 1, dtype=np.bool_)
        counter = np.zeros(sweep.N_COUNTERS, dtype=np.int64)
        counter[sweep.FREE] = -1
        # the root waits in the list of sample 0
        head[0, 0] = 0
        pool_next[0], pool_parent[0], pool_move[0] = -1, -1, -1
        pool_float[0] = [0.0, 0.0, -np.inf, *d.p0]
        counter[sweep.POOL] = 1
        for begin in range(0, t, CHUNK):
            if out_of_time():
                raise OutOfTime
            progress(begin / t)
            sweep.forward(
                begin,
                min(t, begin + CHUNK),
                k,
                *self.weight,
                self.limit,
                d.steps,
                self.base,
                moves.ptr,
                moves.blocks,
                moves.at,
                moves.family,
                moves.families,
                moves.span,
                threshold,
                width,
                EPSILON if epsilon is None else epsilon,
                slack,
                COARSE,
                coarse_width,
                slots,
                probing,
                self.near_form,
                self.floor_p,
                self.floor_cost,
                hope,
                table.lo,
                table.hi,
                table.p,
                table.togo,
                head,
                pool_next,
                pool_parent,
                pool_move,
                pool_float,
                pend_node,
                pend_cost,
                pend_near,
                pend_p,
                pend_second,
                pend_blocks,
                node_lo,
                node_hi,
                node_p,
                node_cost,
                node_togo,
                arc_from,
                arc_to,
                arc_move,
                arc_cost,
                bin_epsilon,
                reached,
                counter,
            )
            if counter[sweep.FULL]:
                return None
        n = int(counter[sweep.NODES])
        best_arc = np.full(n, -1, dtype=np.int64)
        root = int(arc_to[0])  # the root's own list entry came as an arc without a parent
        sweep.backward(int(counter[sweep.ARCS]), arc_from, arc_to, arc_cost, node_togo, best_arc)
        bound = float(node_togo[root]) * (1.0 - ROUNDING)
        path = []
        node = root
        while best_arc[node] >= 0:
            arc = best_arc[node]
            if arc_move[arc] >= 0:
                path.append(int(moves.candidate[arc_move[arc]]))
            node = int(arc_to[arc])
        self.bound = max(self.bound, bound)
        self.table = merged_table(table, node_lo, node_hi, node_p, node_togo)
        return Outcome(
            bound,
            path,
            n,
            width,
            float(bin_epsilon.max()),
            time.monotonic() - start,
            reached,
            counter.tolist(),
        )


def empty_table(t: int, k: int) -> Table:
    """Return a table that knows nothing."""
    zeros = np.zeros((t + 1, k + 1), dtype=np.int64)
    return Table(zeros, zeros.copy(), np.empty((0, 6)), np.empty(0))


def merged_table(
    old: Table, node_lo: IntArray, node_hi: IntArray, node_p: FloatArray, node_togo: FloatArray
) -> Table:
    """Put the labels of a sweep and the rows of `old` into one table."""
    lo, hi = np.zeros_like(old.lo), np.zeros_like(old.hi)
    size = int(np.sum(node_hi - node_lo) + np.sum(old.hi - old.lo))
    p, togo = np.empty((size, 6)), np.empty(size)
    used = _merge(
        old.lo, old.hi, old.p, old.togo, node_lo, node_hi, node_p, node_togo, lo, hi, p, togo
    )
    return Table(lo, hi, p[:used].copy(), togo[:used].copy())


@njit(cache=True)
def _merge(  # type: ignore[no-untyped-def]
    old_lo, old_hi, old_p, old_togo, new_lo, new_hi, new_p, new_togo, lo, hi, p, togo
):
    used = 0
    for t in range(new_lo.shape[0]):
        for m in range(new_lo.shape[1]):
            a, b = new_lo[t, m], new_hi[t, m]
            c, d = old_lo[t, m], old_hi[t, m]
            n = b - a + d - c
            values = np.empty(n)
            values[: b - a] = -new_togo[a:b]
            values[b - a :] = -old_togo[c:d]
            order = np.argsort(values)
            lo[t, m] = used
            for x in range(n):
                o = order[x]
                q = new_p[a + o] if o < b - a else old_p[c + o - (b - a)]
                # a row no better than an earlier one (greater togo) with a smaller P says nothing
                known = False
                for y in range(max(lo[t, m], used - 64), used):
                    known = True
                    for z in range(6):
                        if p[y, z] != q[z]:
                            known = False
                    if known:
                        break
                if known:
                    continue
                p[used] = q
                togo[used] = -values[o]
                used += 1
            hi[t, m] = used
    return used


@njit(cache=True)
def near_form(steps, w_tt, w_nn, reach):  # type: ignore[no-untyped-def]
    """Return (t, 6) the forms whose product with P is the cost of waiting `reach` samples.

    Noise of the way left out: it is the same for all P.
    """
    t_end = steps.shape[0]
    out = np.zeros((t_end, 6))
    for t in range(t_end):
        f = np.eye(3)
        g = np.eye(3)
        for s in range(t, min(t_end, t + reach)):
            if s > t:
                c, sn, y, x = steps[s, 0], steps[s, 1], steps[s, 2], steps[s, 3]
                for j in range(3):
                    g[0, j] = c * f[0, j] + sn * f[1, j] + y * f[2, j]
                    g[1, j] = -sn * f[0, j] + c * f[1, j] + x * f[2, j]
                    g[2, j] = f[2, j]
                f[:] = g
            at = 0
            for i in range(3):
                for j in range(i, 3):
                    out[t, at] += w_tt * f[0, i] * f[0, j] + w_nn * f[1, i] * f[1, j]
                    at += 1
    return out
