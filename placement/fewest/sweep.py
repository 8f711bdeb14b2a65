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
    WAITED,
)
from placement.fewest.crossing import alone, end_of, move, one_step, shares_mount, told, worth
from placement.fewest.crowds import crowds_on, join_crowd, more_in_view, worst_dark
from placement.fewest.graph import deposit, go_blind, new_node, no_room, record
from placement.fewest.merging import WAITING, exceeded, grown, put_set, thin
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
    t_end = course.steps.shape[0]
    failures = course.failures
    probing, finding = mode == PROBING, mode == FINDING
    scenarios = store.set_p.shape[2]
    span = store.blind_node.shape[2] - 2
    mm, vv = np.empty((3, 3)), np.empty((3, 3))
    room = width * (1 + WAITING)
    kept_p, own_p = np.empty((room + 1, 2, 6)), np.empty((room + 1, 2, 6))
    kept_waited = np.empty(room + 1, np.bool_)
    free_p, free_rank = np.empty((width + 1, 2, 6)), np.empty(width + 1)
    free_m, free_node = np.empty(width + 1, np.int64), np.empty(width + 1, np.int64)
    most = 1024
    p_in, rank, waited = np.empty((most, 2, 6)), np.empty(most), np.empty(most, np.bool_)
    assigned, told_by = np.empty(most, np.int64), np.empty(most, np.int64)
    slot_of = np.zeros(2, dtype=np.int64)
    work = np.empty((scenarios, 6))
    ids = np.empty(DEPTH, dtype=np.int64)
    slot_of[begin % 2] = store.counter[N_COUNTERS]
    for t in range(begin, end):
        now, then = t % 2, 1 - t % 2
        slot_of[then] = 0
        store.key[:] = 0
        store.blind_node[then] = -1
        store.crowd_node[then] = -1
        cameras = course.at[t + 1] - course.at[t]
        if no_room(store, store.counter[POOL] + room):
            return
        # free labels: each price thinned; whom a cheaper one exceeds is told by that one
        kept_of = 0
        for m in range(k + 1):
            cheaper = kept_of
            n, e = 0, store.head[t, m]
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
                n, e, own = 0, store.head[t, m], 0
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
                first, kept = store.counter[NODES], 0
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
                n, e, own = 0, store.head[t, m], 0
                while e >= 0:
                    to = told_by[n]
                    if to == -1:
                        to = first + assigned[own] if assigned[own] >= 0 else NOBODY
                        own += 1
                    if to != NOBODY:
                        record(store, store.pool_parent[e], to, store.pool_units[e],
                               store.pool_camera[e])  # fmt: skip
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
        # they wait, take a camera alone, start sets
        for g in range(kept_of):
            parent, m = free_node[g], free_m[g]
            p, past = row6(free_p[g], 0), row6(free_p[g], 1)
            q = one_step(p, course.base[t], 0.0, 0.0, 0.0)
            r = q
            alive = q[3] <= course.limit
            if failures and alive:
                r = one_step(past, course.base[t], 0.0, 0.0, 0.0)
                alive = r[3] <= course.limit
            if alive:
                if t + 1 < t_end:
                    q = move(q, course.steps[t + 1])
                    r = move(r, course.steps[t + 1])
                deposit(course, known, store, k, parent, 0, WAITED, m, t + 1, q, r)
            for v in range(course.at[t], course.at[t + 1]):
                units = course.units[v]
                length = course.ptr[v + 1] - course.ptr[v]
                togo = known.floor[t + length]
                if m + units + togo > k:
                    store.node_need[parent] = min(store.node_need[parent], units + togo)
                else:
                    alive, q, r = alone(course, v, t, p, past)
                    if alive:
                        deposit(course, known, store, k, parent, units, v, m + units, t + length,
                                q, r)  # fmt: skip
                if m + least[v] > k:
                    store.node_need[parent] = min(store.node_need[parent], least[v])
                    continue
                for x in range(6):
                    work[0, x] = p[x]
                    if failures:
                        work[1, x] = past[x]
                        work[2, x] = p[x]
                s = slot_of[now]
                if s >= store.set_m.shape[1] and finding:
                    continue
                if s >= store.set_m.shape[1]:
                    join_crowd(store, now, parent, units, m + units, 1, length, p, past, p, mm, vv)
                    continue
                slot_of[now] += 1
                store.set_m[now, s], store.set_n[now, s] = m + units, 1
                store.set_flag[now, s] = False
                store.set_ids[now, s, 0] = v
                store.set_p[now, s] = work
                store.set_node[now, s] = new_node(store, -1, p, past)
                record(store, parent, store.set_node[now, s], units, v)
            if store.counter[FULL]:
                return
        # sets: one camera more, or on to the next sample
        s = 0
        while s < slot_of[now]:
            m, n, node = store.set_m[now, s], store.set_n[now, s], store.set_node[now, s]
            flag = store.set_flag[now, s]
            longest, latest = 0, 0
            for a in range(n):
                v = store.set_ids[now, s, a]
                latest = max(latest, v % course.units.size)
                longest = max(longest, end_of(course, v) - t)
            whole = n == DEPTH or slot_of[now] + cameras > store.set_m.shape[1]
            if whole and not finding:
                if no_room(store, cameras + 64):
                    return
                q = row6(store.set_p[now, s], 0)
                r, dark = q, q
                if failures:
                    r = row6(store.set_p[now, s], 1)
                    dark = row6(store.set_p[now, s], worst_dark(store.set_p[now, s], n))
                more_in_view(course, known, store, t, k, node, m, n, longest, q, r, dark,
                             mm, vv)  # fmt: skip
            for w in range(max(course.at[t], latest), course.at[t + 1] if not whole else 0):
                name = w
                if w == latest:
                    if not course.twice[w]:
                        continue
                    name = w + course.units.size
                if finding and shares_mount(course, name, store.set_ids[now, s], n):
                    continue
                units = course.units[w]
                length = max(longest, course.ptr[w + 1] - course.ptr[w])
                togo = known.hope[t + length]
                if m + units + togo > k:
                    store.node_need[node] = min(store.node_need[node], units + togo)
                    continue
                z = slot_of[now]
                slot_of[now] += 1
                store.set_m[now, z], store.set_n[now, z] = m + units, n + 1
                store.set_flag[now, z] = True
                for a in range(n):
                    store.set_ids[now, z, a] = store.set_ids[now, s, a]
                store.set_ids[now, z, n] = name
                store.set_p[now, z] = store.set_p[now, s]
                if failures:
                    store.set_p[now, z, 2 + n] = store.set_p[now, s, 0]
                zero = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
                store.set_node[now, z] = new_node(store, -1, zero, zero)
                record(store, node, store.set_node[now, z], units, name)
                if no_room(store, 64):
                    return
            # measure
            alive = True
            t0, t1, t2 = 0.0, 0.0, 0.0
            for a in range(n):
                b = told(course, store.set_ids[now, s, a], t)
                t0 += b[0]
                t1 += b[1]
                t2 += b[2]
            for c in range(2 + n if failures else 1):
                j0, j1, j2 = t0, t1, t2
                if c >= 2:
                    j0, j1, j2 = 0.0, 0.0, 0.0
                    for a in range(n):
                        if a != c - 2:
                            b = told(course, store.set_ids[now, s, a], t)
                            j0 += b[0]
                            j1 += b[1]
                            j2 += b[2]
                q = one_step(row6(store.set_p[now, s], c), course.base[t], j0, j1, j2)
                if q[3] > course.limit:
                    alive = False
                    break
                if t + 1 < t_end:
                    q = move(q, course.steps[t + 1])
                for x in range(6):
                    work[c, x] = q[x]
            if not alive:
                s += 1
                continue
            remain = 0
            for a in range(n):
                v = store.set_ids[now, s, a]
                if end_of(course, v) > t + 1:
                    ids[remain] = v
                    if failures:
                        work[2 + remain] = work[2 + a]
                    remain += 1
                elif failures and worth(work[2 + a]) > worth(work[1]):
                    work[1] = work[2 + a]
            if remain == 0:
                if flag:
                    q = row6(work, 0)
                    r = row6(work, 1) if failures else q
                    deposit(course, known, store, k, node, 0, -1, m, t + 1, q, r)
            elif not put_set(store, then, slot_of, slots, m, remain, ids, flag, node, work,
                             mode, mm, vv) and not finding:  # fmt: skip
                q = row6(work, 0)
                r, dark = q, q
                if failures:
                    r, dark = row6(work, 1), row6(work, worst_dark(work, remain))
                join_crowd(store, then, node, 0, m, remain, longest - 1, q, r, dark, mm, vv)
            s += 1
        if not crowds_on(course, known, store, t, k, mm, vv):
            return
        # blind labels: one camera more, or on to the next sample
        for m in range(k + 1):
            for length in range(1, span + 1):
                node = store.blind_node[now, m, length]
                if node < 0:
                    continue
                if no_room(store, cameras + 64):
                    return
                for w in range(course.at[t], course.at[t + 1]):
                    units = course.units[w]
                    longer = max(length, course.ptr[w + 1] - course.ptr[w])
                    togo = known.hope[t + longer]
                    if m + units + togo > k:
                        store.node_need[node] = min(store.node_need[node], units + togo)
                    elif longer > length:
                        go_blind(store, now, node, units, m + units, longer)
                if length == 1 or t + 1 == t_end:
                    q = row6(course.floor, min(t + 1, t_end - 1))
                    deposit(course, known, store, k, node, 0, -1, m, t + 1, q, q)
                else:
                    go_blind(store, then, node, 0, m, length - 1)
        if store.counter[FULL]:
            return
    store.counter[N_COUNTERS] = slot_of[end % 2]
