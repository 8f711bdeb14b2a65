"""A sweep of labels along the road that counts cameras: relaxed, so what it needs, all need.

A *label* at sample t is a price m paid so far (in whole units) and covariances P below those of
every placement that it stands for; it dies when its lateral variance exceeds the limit. With one
failure it holds two: the intact filter's and the filter's with some earlier camera dark.

Labels with nothing pending are *free*: they wait a sample, or take one camera from its first sample
to its last. Cameras whose views overlap are followed as *sets*: up to `DEPTH` cameras in view at
once are told apart exactly, each with the covariance of its own failure; more are a *crowd*
(`crowds`), and beyond what is counted a label goes *blind*: it knows all that any camera could tell
until they are all out of view.

With persistent errors a camera taken alone keeps its offsets unknown; the cameras of a set have
theirs known, which tells at least as much.

Free labels of one sample and price are thinned to a width, sets to a few labels for each set, by
Loewner lower bounds. What a label still needs is found backward along the arcs of the sweep, and is
needed by every label above it: those are the rows of the table by which the next sweep prunes.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.fewest.arrays import (
    DEPTH,
    FINDING,
    FREE,
    FULL,
    N_COUNTERS,
    NODES,
    POOL,
    PROBING,
    ZERO,
)
from placement.fewest.crossing import worth
from placement.fewest.crowds import blind_on, crowds_on
from placement.fewest.graph import new_node, no_room, record
from placement.fewest.merging import WAITING, exceeded, forget_keys, grown, thin
from placement.fewest.sets import set_out, sets_on
from placement.objectives.windows.filter import row6

NOBODY = -2  # whom a label that is left out is told by


@njit(cache=True)
def sweep(begin, end, k, course, known, store, least, width, slots, epsilon, mode, bin_epsilon):  # type: ignore[no-untyped-def]
    """Sweep samples begin…end − 1 within k units; counter[FULL] is set if storage runs out.

    least (v,) is what a set that starts with camera v takes at least, from before v on. mode:
    PROVING; PROBING, where the floor itself starts a label at every sample asked, at the greatest
    whole price at which it is not known to be too dear; or FINDING, where labels are not merged
    but left out, and cameras are what they are.
    """
    failures = course.failures
    probing, finding = mode == PROBING, mode == FINDING
    scenarios = store.set_p.shape[2]
    mm, vv = np.empty((3, 3)), np.empty((3, 3))
    room = width * (1 + WAITING)
    kept_p, own_p = np.empty((room + 1, 2, 6)), np.empty((room + 1, 2, 6))
    kept_waited = np.empty(room + 1, np.bool_)
    free_p, free_rank = np.empty((width + 1, 2, 6)), np.empty(width + 1)
    free_m, free_node = np.empty(width + 1, np.int64), np.empty(width + 1, np.int64)
    most = np.int64(1024)
    p_in, rank, waited = np.empty((most, 2, 6)), np.empty(most), np.empty(most, np.bool_)
    assigned, told_by = np.empty(most, np.int64), np.empty(most, np.int64)
    slot_of = np.zeros(2, dtype=np.int64)
    work = np.empty((scenarios, 6))
    ids = np.empty(DEPTH, dtype=np.int64)
    slot_of[begin % 2] = store.counter[N_COUNTERS]
    for t in range(begin, end):
        then = 1 - t % 2
        slot_of[then] = 0
        forget_keys(store, slot_of[t % 2])
        store.blind_node[then] = -1
        store.crowd_node[then] = -1
        cameras = course.at[t + 1] - course.at[t]
        if no_room(store, store.counter[POOL] + room):
            return
        # free labels: each price thinned; whom a cheaper one exceeds is told by that one
        kept_of = ZERO
        for m in range(k + 1):
            cheaper = kept_of
            n, e = ZERO, store.head[t, m]
            while e >= 0:
                n += 1
                e = store.pool_next[e]
            probe = probing and known.asked[t] and m == k - known.floor[t] - (course.per_unit - 1)
            if n == 0 and not probe:
                continue
            if n > most:
                most = 2 * n
                p_in, rank = np.empty((most, 2, 6)), np.empty(most)
                waited = np.empty(most, np.bool_)
                assigned, told_by = np.empty(most, np.int64), np.empty(most, np.int64)
            if kept_of + room + 1 > free_p.shape[0]:
                free_p, free_rank, free_m, free_node = grown(
                    free_p, free_rank, free_m, free_node, kept_of, room + 1
                )
            if n:
                n, e, own = ZERO, store.head[t, m], ZERO
                while e >= 0:
                    q, r = row6(store.pool_p[e], 0), row6(store.pool_p[e], 1)
                    w = worth(q) + (worth(r) if failures else 0.0)
                    found = -1
                    if not probing:
                        found = exceeded(q, r, w, failures, free_p, free_rank, cheaper)
                    told_by[n] = free_node[found] if found >= 0 else -1
                    if found >= 0 and finding:
                        told_by[n] = NOBODY
                    if found < 0:
                        p_in[own] = store.pool_p[e]
                        rank[own] = w
                        waited[own] = store.pool_waited[e]
                        own += 1
                    n += 1
                    e = store.pool_next[e]
                first, kept = store.counter[NODES], ZERO
                if own:
                    eps = max(epsilon, bin_epsilon[m] / 2.25)
                    kept, bin_epsilon[m] = thin(
                        own, p_in, rank, waited, width, eps, mode, failures, assigned, kept_p,
                        own_p, kept_waited, mm, vv,
                    )  # fmt: skip
                for b in range(kept):
                    q, r = row6(kept_p[b], 0), row6(kept_p[b], 1)
                    free_node[kept_of] = new_node(store, t, q, r)
                    free_p[kept_of] = kept_p[b]
                    free_rank[kept_of] = worth(q) + (worth(r) if failures else 0.0)
                    free_m[kept_of] = m
                    kept_of += 1
                n, e, own = ZERO, store.head[t, m], ZERO
                while e >= 0:
                    to = told_by[n]
                    if to == -1:
                        to = first + assigned[own] if assigned[own] >= 0 else NOBODY
                        own += 1
                    if to != NOBODY:
                        record(store, store.pool_parent[e], to, store.pool_units[e],
                               np.int64(store.pool_camera[e]))  # fmt: skip
                    n += 1
                    following = store.pool_next[e]
                    store.pool_next[e] = store.counter[FREE]
                    store.counter[FREE] = e
                    e = following
                store.head[t, m] = -1
            if probe:
                q = row6(course.floor, t)
                free_node[kept_of] = new_node(store, t, q, q)
                for x in range(6):
                    free_p[kept_of, 0, x] = free_p[kept_of, 1, x] = course.floor[t, x]
                free_m[kept_of] = m
                kept_of += 1
        if no_room(store, kept_of * (cameras + 1) + 4 * store.set_m.shape[1]):
            return
        for g in range(kept_of):
            p, past = row6(free_p[g], 0), row6(free_p[g], 1)
            set_out(course, known, store, t, k, free_node[g], free_m[g], p, past, least, mode,
                    slot_of, work, mm, vv)  # fmt: skip
            if store.counter[FULL]:
                return
        if not sets_on(course, known, store, t, k, slots, mode, slot_of, ids, work, mm, vv):
            return
        if not crowds_on(course, known, store, t, k, mm, vv):
            return
        if not blind_on(course, known, store, t, k):
            return
        if store.counter[FULL]:
            return
    store.counter[N_COUNTERS] = slot_of[end % 2]
