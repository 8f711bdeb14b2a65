"""Cameras with persistent offsets that stand alone: their whole view as one map of the covariance.

The diagram knows the offsets of cameras whose views meet. That of a camera alone in its cluster it
need not know: with P the covariance at the first sample it sees, that after each sample x of its
view, the offset learnt along the way, is

    P_x = A_x (P⁻¹ + M_x)⁻¹ A_xᵀ + R_x

(`placement.tempered.crossings`), as monotone in P as any filter, and from λP at least λ times as
dear, since the offset's own covariance is not made smaller. So it is what a label is extended by,
and exact. Which cameras are alone is decided by the views of those that stand in for them in
clusters; each then moves by its own view, which lies inside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange

from models.geometry import BoolArray, FloatArray, IntArray
from placement.diagram.arrays import FULL
from placement.diagram.extension import deposit
from placement.diagram.merging import row
from placement.diagram.moves import TWINS
from placement.objectives.navigation_chain import Drive
from placement.objectives.windows.entropy import covariance_across
from placement.objectives.windows.filter import parallel_far, predict
from placement.objectives.windows.offsets import enter_state, views_of
from placement.tempered.crossings import learn, predict_wide, work_space

COLUMNS = 21  # A (9), M (6) and R (6) after each sample


class Alone(NamedTuple):
    """The moves of cameras alone, sorted by their first sample; nothing where offsets are known.

    `rows` ptr[v] … ptr[v + 1] − 1 are those of move v, from its first sample to its last.
    """

    candidate: IntArray  # (v,)
    at: IntArray  # (t + 1,) those that start at sample t are at[t] … at[t + 1] − 1
    ptr: IntArray  # (v + 1,)
    rows: FloatArray  # (n, COLUMNS)


def alone_moves(drive: Drive | None, usable: BoolArray, base: FloatArray, longest: int) -> Alone:
    """Lay out the `usable` (c,) cameras of a drive that see something, each by itself.

    Without a drive whose offsets persist nobody is: cameras alone are moves like any other.
    `base` (t, 3) is the information that every placement has. Of a view longer than `longest`
    samples only the head is a move; what it sees beyond is given to everybody with its offset
    known, so here it is known, too.
    """
    if drive is None:
        none = np.empty(0, dtype=np.int64)
        return Alone(none, none, np.zeros(1, dtype=np.int64), np.empty((0, COLUMNS)))
    views = views_of(drive)
    first, last, stop = _spans(views.indptr, views.indices, longest)
    cameras = np.flatnonzero(usable & (last >= 0))
    cameras = cameras[np.argsort(first[cameras], kind="stable")]
    t = drive.information.n_samples
    ptr = np.concatenate([[0], np.cumsum(last[cameras] - first[cameras] + 1)]).astype(np.int64)
    rows = np.zeros((int(ptr[-1]), COLUMNS))
    steps = drive.steps()
    c, s, y, x = steps[:, :4].T
    zero = np.zeros(t)
    f = np.column_stack([c, s, y, -s, c, x, zero, zero, zero + 1.0])
    q = np.ascontiguousarray(steps[:, 4:10])
    known = stop < views.indptr[1:]  # whose view is longer
    _fill(f, q, base, views, cameras, first, stop, known, ptr, rows)
    return Alone(cameras, np.searchsorted(first[cameras], np.arange(t + 1)), ptr, rows)


@njit(cache=True)
def _spans(indptr, indices, longest):  # type: ignore[no-untyped-def]
    n = indptr.size - 1
    first, last = np.zeros(n, np.int64), np.full(n, -1)
    stop = indptr[1:].copy()
    for i in range(n):
        if indptr[i] == indptr[i + 1]:
            continue
        first[i] = indices[indptr[i]]
        while indices[stop[i] - 1] >= first[i] + longest:
            stop[i] -= 1
        last[i] = indices[stop[i] - 1]
    return first, last, stop


@njit(cache=True, parallel=True)
def _fill(f, q, base, views, cameras, first, stop, known, ptr, rows):  # type: ignore[no-untyped-def]
    for v in prange(cameras.size):
        i = cameras[v]
        out = rows[ptr[v] : ptr[v + 1]]
        _run(f, q, base, views, views.indptr[i], stop[i], first[i], known[i], out)


@njit(cache=True)
def _run(f, q, base, views, entry, stop, begin, known, out):  # type: ignore[no-untyped-def]
    p = views.offsets.shape[2]
    m, phi, told, u, v, _, _, _ = work_space(1, p)
    phi[:3] = np.eye(3)
    n = 3
    none = np.zeros((1, 2, 0), np.float32)
    certain = np.zeros((1, 2, p), np.float32)
    here, white = np.empty((1, 3), np.float64), np.empty((1, views.white.shape[1]), np.float32)
    frames = (1.0 + TWINS) * views.frames  # where others may be stood in for
    n = enter_state(m, n, p, 1.0)
    phi[3:n] = 0.0
    for x in range(out.shape[0]):
        t = begin + x
        if x > 0:
            predict_wide(m, n, phi, f, q, t)
        if base[t, 0] > 0.0 or base[t, 2] > 0.0:
            here[0] = base[t]
            learn(m, n, 3, phi, told, here, none, 1.0, 0, 1.0, u, v)
        if entry < stop and views.indices[entry] == t:
            if known:
                white[0] = views.white[entry]
                learn(m, n, 3, phi, told, white, certain, frames, 0, 1.0, u, v)
            else:
                learn(
                    m, n, 3, phi, told, views.white, views.offsets, views.frames, entry, 1.0, u, v
                )
            entry += 1
        for i in range(3):
            for j in range(3):
                out[x, 3 * i + j] = phi[i, j]
        out[x, 9:15] = told
        out[x, 15], out[x, 16], out[x, 17] = m[0, 0], m[0, 1], m[0, 2]
        out[x, 18], out[x, 19], out[x, 20] = m[1, 1], m[1, 2], m[2, 2]


@njit(cache=True, inline="always")
def covariance_after(p, r):  # type: ignore[no-untyped-def]
    """Return A (P⁻¹ + M)⁻¹ Aᵀ + R (6,) of one row `r` (COLUMNS,)."""
    return covariance_across(parallel_far(p, (r[9], r[10], r[11], r[12], r[13], r[14])), r)


@njit(cache=True)
def extend_by_one(t, m, first, kept, road, alone, after_moves, rules, table, storage):  # type: ignore[no-untyped-def]
    """Extend labels first…first + kept − 1, of m cameras at t, by each camera alone from t on.

    Moves are numbered from `after_moves` on.
    """
    w_tt, w_nn, steps = road.w_tt, road.w_nn, road.steps
    at, ptr, rows = alone.at, alone.ptr, alone.rows
    lo, hi, table_p, table_togo = table.lo, table.hi, table.p, table.togo
    node_p, node_cost, togo = storage.nodes.p, storage.nodes.cost, storage.nodes.togo
    head, following, pool = storage.pool.head, storage.pool.next, storage.pool
    parents, moves, values = pool.parent, pool.move, pool.value
    counter = storage.counter
    price, probing, threshold = rules.price, rules.probing, rules.threshold
    t_end = steps.shape[0]
    for parent in range(first, first + kept):
        p = row(node_p, parent)
        for v in range(at[t], at[t + 1]):
            paid, q = price, p
            for e in range(ptr[v], ptr[v + 1]):
                q = covariance_after(p, rows[e])
                paid += w_tt * q[0] + w_nn * q[3]
            stop = t + ptr[v + 1] - ptr[v]
            if stop < t_end:
                q = predict(q, steps[stop])
            deposit(
                parent, 0.0 if probing else node_cost[parent], paid, q, stop,
                m if price > 0.0 else m + 1, after_moves + v, threshold, lo, hi, table_p,
                table_togo, head, following, parents, moves, values, togo, counter,
            )  # fmt: skip
            if counter[FULL]:
                return
