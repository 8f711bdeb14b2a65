"""A sweep of labels along the road that counts cameras: relaxed, so what it needs, all need.

A *label* at sample t is a price m paid so far (in whole units) and covariances P below those of
every placement that it stands for; it dies when its lateral variance exceeds the limit. With one
failure it holds two: the intact filter's and the filter's with some earlier camera dark.

Labels with nothing pending are *free*: they wait a sample, or take one camera from its first sample
to its last. Cameras whose views overlap are followed as *sets*: up to `DEPTH` cameras in view at
once are told apart exactly, each with the covariance of its own failure; where more are in view at
once the label goes *blind*: it knows all that any camera could tell until they are all out of view.

With persistent errors a camera taken alone keeps its offsets unknown; the cameras of a set have
theirs known, which tells at least as much.

Free labels of one sample and price are thinned to a width, sets to a few labels for each set, by
Loewner lower bounds. What a label still needs is found backward along the arcs of the sweep, and is
needed by every label above it: those are the rows of the table by which the next sweep prunes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.diagram.order import below, meet
from placement.objectives.windows.filter import predict, row6, update
from placement.objectives.windows.offsets import (
    enter_state,
    predict_state,
    set_initial,
    update_state,
)

DEPTH = 3  # cameras in view at once that are told apart
NODES, ARCS, POOL, FREE, FULL, BLIND = range(6)
N_COUNTERS = 6
AHEAD = 40.0  # metres over which the heading's variance is weighed when labels are ranked
KEY_BITS = 17  # of a camera in the key of a set; `Course` holds fewer than 2**17
MOST_UNITS = 1000


class Course(NamedTuple):
    """One drive and its cameras, sorted by their first sample (v) and priced in whole units."""

    steps: FloatArray
    p0: FloatArray
    base: FloatArray  # (t, 3) information of cameras that are there in any case
    ptr: IntArray  # (v + 1,) rows of blocks: one a sample from first to last
    blocks: FloatArray  # (n, 3)
    at: IntArray  # (t + 1,) cameras that start at t
    units: IntArray  # (v,)
    floor: FloatArray  # (t, 6) below every covariance before the measurements of t
    limit: float
    failures: int
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


class Store(NamedTuple):
    """What a sweep writes to."""

    head: IntArray  # (t + 1, k + 1) lists of labels waiting for their sample
    pool_next: IntArray
    pool_parent: IntArray
    pool_units: IntArray
    pool_p: FloatArray  # (·, 2, 6)
    node_need: IntArray
    node_t: IntArray  # where free labels are, −1 for others
    node_p: FloatArray  # (nodes, 2, 6)
    arc_from: IntArray
    arc_to: IntArray
    arc_units: IntArray
    set_m: IntArray  # (2, sets) of this sample and the next
    set_n: IntArray
    set_ids: IntArray  # (2, sets, DEPTH)
    set_flag: BoolArray  # whether more than one camera was ever in it
    set_node: IntArray
    set_p: FloatArray  # (2, sets, scenarios, 6)
    key: IntArray  # a hash table of the next sample's sets
    key_first: IntArray
    set_next: IntArray  # sets of one key
    blind_node: IntArray  # (2, k + 1, span + 2) by how long it lasts; −1 for none
    reached: BoolArray
    counter: IntArray


@njit(cache=True, inline="always")
def worth(p):  # type: ignore[no-untyped-def]
    """Return the lateral variance some way ahead: what labels are ranked by."""
    return p[3] + 2.0 * AHEAD * p[4] + AHEAD * AHEAD * p[5]


@njit(cache=True)
def move(p, step):  # type: ignore[no-untyped-def]
    """Return P one step on; compiled once, where `predict` would be at every use."""
    return predict(p, step)


@njit(cache=True)
def one_step(p, base, j0, j1, j2):  # type: ignore[no-untyped-def]
    """Return P after one sample's measurements."""
    q0, q1, q2, q3, q4, q5, _ = update(p, base[0] + j0, base[1] + j1, base[2] + j2)
    return (q0, q1, q2, q3, q4, q5)


@njit(cache=True)
def needed(known, t, p, past, failures):  # type: ignore[no-untyped-def]
    """Return the units that every placement with covariances above these still needs."""
    best = known.floor[t]
    if t >= known.lo.size:
        return best
    for n in range(known.lo[t], known.hi[t]):
        if known.need[n] <= best:
            break
        if below(row6(known.p[n], 0), p, 1.0) and (
            failures == 0 or below(row6(known.p[n], 1), past, 1.0)
        ):
            best = known.need[n]
            break
    return best


@njit(cache=True)
def lower(a, b, m, v):  # type: ignore[no-untyped-def]
    """Return a covariance below both, as a row; zeros where rounding leaves a doubt."""
    low = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for shrink in (0.999, 0.99, 0.9, 0.7, 0.4, 0.1, 0.01):
        if below(a, b, shrink):
            low = (
                shrink * a[0], shrink * a[1], shrink * a[2], shrink * a[3], shrink * a[4],
                shrink * a[5],
            )  # fmt: skip
            break
    return meet(a, b, low, m, v)


@njit(cache=True)
def record(store, parent, child, units):  # type: ignore[no-untyped-def]
    """Add an arc."""
    a = store.counter[ARCS]
    store.arc_from[a], store.arc_to[a], store.arc_units[a] = parent, child, units
    store.counter[ARCS] += 1


@njit(cache=True)
def new_node(store, t, p, past):  # type: ignore[no-untyped-def]
    """Add a node; t = −1 where it is no free label."""
    n = store.counter[NODES]
    store.node_need[n] = MOST_UNITS
    store.node_t[n] = t
    if t >= 0:
        for x in range(6):
            store.node_p[n, 0, x] = p[x]
            store.node_p[n, 1, x] = past[x]
    store.counter[NODES] += 1
    return n


@njit(cache=True)
def deposit(course, known, store, k, parent, units, m, t, p, past):  # type: ignore[no-untyped-def]
    """Leave a free label of price m for sample t, unless it is known to be too dear."""
    if t >= course.steps.shape[0]:
        store.node_need[parent] = min(store.node_need[parent], units)
        if m <= k:
            store.reached[m] = True
        return
    togo = needed(known, t, p, past, course.failures)
    if m + togo > k:
        store.node_need[parent] = min(store.node_need[parent], units + togo)
        return
    x = store.counter[FREE]
    if x >= 0:
        store.counter[FREE] = store.pool_next[x]
    else:
        x = store.counter[POOL]
        if x >= store.pool_next.size:
            store.counter[FULL] = 1
            return
        store.counter[POOL] += 1
    store.pool_parent[x], store.pool_units[x] = parent, units
    for z in range(6):
        store.pool_p[x, 0, z] = p[z]
        store.pool_p[x, 1, z] = past[z]
    store.pool_next[x] = store.head[t, m]
    store.head[t, m] = x


@njit(cache=True)
def thin(n, p, rank, width, epsilon, probing, failures, assigned, kept_p, own_p, mm, vv):  # type: ignore[no-untyped-def]
    """Merge n labels (n, 2, 6) into at most `width`; return how many, and the ε it took.

    When `probing`, labels far below others stay apart from them.
    """
    order = np.argsort(rank[:n])
    while True:
        kept, fits = 0, True
        for a0 in range(n):
            a = order[a0]
            q0, q1 = row6(p[a], 0), row6(p[a], 1)
            found = -1
            for b in range(0 if probing else kept):
                if below(row6(kept_p[b], 0), q0, 1.0) and (
                    failures == 0 or below(row6(kept_p[b], 1), q1, 1.0)
                ):
                    found = b
                    break
            if found >= 0:
                assigned[a] = found
                continue
            shrink = 1.0 / (1.0 + epsilon)
            for b in range(kept):
                if below(row6(own_p[b], 0), q0, shrink) and (
                    failures == 0 or below(row6(own_p[b], 1), q1, shrink)
                ):
                    if probing and not (
                        below(q0, row6(own_p[b], 0), shrink)
                        and (failures == 0 or below(q1, row6(own_p[b], 1), shrink))
                    ):
                        continue
                    found = b
                    break
            if found < 0 and kept == width:
                if epsilon < 1e3:
                    fits = False
                    break
                found = 0
            if found < 0:
                for x in range(6):
                    kept_p[kept, 0, x] = own_p[kept, 0, x] = q0[x]
                    kept_p[kept, 1, x] = own_p[kept, 1, x] = q1[x]
                assigned[a] = kept
                kept += 1
                continue
            r0 = lower(row6(kept_p[found], 0), q0, mm, vv)
            r1 = lower(row6(kept_p[found], 1), q1, mm, vv) if failures else r0
            for x in range(6):
                kept_p[found, 0, x] = r0[x]
                kept_p[found, 1, x] = r1[x]
            assigned[a] = found
        if fits:
            return kept, epsilon
        epsilon *= 1.5


@njit(cache=True)
def learn(m, n, j0, j1, j2, u, v):  # type: ignore[no-untyped-def]
    """Learn J about the position in a state (n, n) that carries offsets."""
    for i in range(n):
        u[0, i], u[1, i] = m[0, i], m[1, i]
    s00, s01, s11 = u[0, 0], u[0, 1], u[1, 1]
    det_j = j0 * j2 - j1 * j1
    det = 1.0 + s00 * j0 + 2.0 * s01 * j1 + s11 * j2 + (s00 * s11 - s01 * s01) * det_j
    a00, a01, a11 = (j0 + det_j * s11) / det, (j1 - det_j * s01) / det, (j2 + det_j * s00) / det
    for i in range(n):
        v[0, i] = a00 * u[0, i] + a01 * u[1, i]
        v[1, i] = a01 * u[0, i] + a11 * u[1, i]
    for i in range(n):
        for j in range(n):
            m[i, j] -= v[0, i] * u[0, j] + v[1, i] * u[1, j]


@njit(cache=True)
def alone_unsure(course, v, t, p):  # type: ignore[no-untyped-def]
    """Take camera v, its offsets unknown, from its first sample t to its last: (alive, P)."""
    offsets = course.offsets
    most = 3 + offsets.shape[2]
    m, u, w = np.zeros((most, most)), np.empty((2, most)), np.empty((2, most))
    set_initial(m, p)
    n = enter_state(m, 3, offsets.shape[2], 1.0)
    i = course.who[v]
    e, end = course.indptr[i], course.indptr[i + 1]
    for s in range(t, t + course.ptr[v + 1] - course.ptr[v]):
        if s > t:
            predict_state(m, n, course.steps[s])
        b = course.base[s]
        if b[0] + b[2] > 0.0:
            learn(m, n, b[0], b[1], b[2], u, w)
        if e < end and course.indices[e] == s:
            update_state(m, n, 3, course.white, offsets, course.frames, e, 1.0, u, w)
            e += 1
        if m[1, 1] > course.limit:
            return False, p
    return True, (m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2])


@njit(cache=True)
def alone(course, v, t, p, past):  # type: ignore[no-untyped-def]
    """Take camera v from its first sample t to its last; return (alive, P, past) after that."""
    t_end, limit = course.steps.shape[0], course.limit
    dark = p
    if course.offsets.shape[2]:
        alive, p = alone_unsure(course, v, t, p)
        if alive and course.failures:
            alive, past = alone_unsure(course, v, t, past)
        if not alive:
            return False, p, past
        stop = t + course.ptr[v + 1] - course.ptr[v]
        if course.failures:
            for s in range(t, stop):
                if s > t:
                    dark = move(dark, course.steps[s])
                dark = one_step(dark, course.base[s], 0.0, 0.0, 0.0)
                if dark[3] > limit:
                    return False, p, past
            if worth(dark) > worth(past):
                past = dark
        if stop < t_end:
            p = move(p, course.steps[stop])
            if course.failures:
                past = move(past, course.steps[stop])
        return True, p, past
    stop = t + course.ptr[v + 1] - course.ptr[v]
    e = course.ptr[v]
    for s in range(t, stop):
        j0, j1, j2 = course.blocks[e, 0], course.blocks[e, 1], course.blocks[e, 2]
        e += 1
        p = one_step(p, course.base[s], j0, j1, j2)
        if p[3] > limit:
            return False, p, past
        if course.failures:
            past = one_step(past, course.base[s], j0, j1, j2)
            dark = one_step(dark, course.base[s], 0.0, 0.0, 0.0)
            if past[3] > limit or dark[3] > limit:
                return False, p, past
        if s + 1 < t_end:
            p = move(p, course.steps[s + 1])
            if course.failures:
                past, dark = move(past, course.steps[s + 1]), move(dark, course.steps[s + 1])
    if course.failures and worth(dark) > worth(past):
        past = dark
    return True, p, past


@njit(cache=True)
def go_blind(store, parity, parent, units, m, length):  # type: ignore[no-untyped-def]
    """Let a label know everything for `length` samples more."""
    n = store.blind_node[parity, m, length]
    if n < 0:
        zero = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        n = new_node(store, -1, zero, zero)
        store.blind_node[parity, m, length] = n
    store.counter[BLIND] += 1
    record(store, parent, n, units)


@njit(cache=True)
def put_set(store, side, slot_of, slots, m, n, ids, flag, node, p, scratch_m, scratch_v):  # type: ignore[no-untyped-def]
    """Put a label of a set on the next sample's list, merged with those of the same set.

    Return False where there is no room.
    """
    scenarios = p.shape[0]
    key = np.int64(2 * m + (1 if flag else 0)) + 1
    for a in range(DEPTH):
        key = (key << KEY_BITS) | (ids[a] + 1 if a < n else 0)
    mask = store.key.size - 1
    h = (key * np.int64(-7046029254386353131) >> 20) & mask
    while store.key[h] != 0 and store.key[h] != key:
        h = (h + 1) & mask
    fresh = store.key[h] == 0
    if fresh:
        store.key[h] = key
        store.key_first[h] = -1
    best, gap, count = -1, np.inf, 0
    rank = worth(p[0]) + (worth(p[1]) if scenarios > 1 else 0.0)
    s = store.key_first[h]
    while s >= 0:
        count += 1
        own = store.set_p[side, s]
        other = worth(own[0]) + (worth(own[1]) if scenarios > 1 else 0.0)
        d = abs(rank - other) / max(other, 1e-300)
        if d < gap:
            best, gap = s, d
        s = store.set_next[s]
    if best < 0 or (count < slots and gap > 1e-3):
        s = slot_of[side]
        if s >= store.set_m.shape[1] or 2 * s > store.key.size:
            return False
        slot_of[side] += 1
        store.set_m[side, s], store.set_n[side, s], store.set_flag[side, s] = m, n, flag
        store.set_node[side, s] = node
        for a in range(n):
            store.set_ids[side, s, a] = ids[a]
        store.set_p[side, s] = p
        store.set_next[s] = store.key_first[h]
        store.key_first[h] = s
        return True
    for c in range(scenarios):
        if c >= 2 + n:
            break
        r = lower(row6(store.set_p[side, best], c), row6(p, c), scratch_m, scratch_v)
        for x in range(6):
            store.set_p[side, best, c, x] = r[x]
    record(store, node, store.set_node[side, best], 0)
    return True


@njit(cache=True)
def sweep(begin, end, k, course, known, store, least, width, slots, epsilon, probing, bin_epsilon):  # type: ignore[no-untyped-def]
    """Sweep samples begin…end − 1 within k units; counter[FULL] is set if storage runs out.

    least (v,) is what a set that starts with camera v takes at least, from before v on. When
    `probing`, the floor itself starts a label at every sample, at the greatest price at which it
    is not known to be too dear.
    """
    t_end = course.steps.shape[0]
    failures = course.failures
    scenarios = store.set_p.shape[2]
    span = store.blind_node.shape[2] - 2
    mm, vv = np.empty((3, 3)), np.empty((3, 3))
    kept_p, own_p = np.empty((width + 1, 2, 6)), np.empty((width + 1, 2, 6))
    most = 1024
    p_in, rank = np.empty((most, 2, 6)), np.empty(most)
    assigned = np.empty(most, dtype=np.int64)
    slot_of = np.zeros(2, dtype=np.int64)
    work = np.empty((scenarios, 6))
    ids = np.empty(DEPTH, dtype=np.int64)
    slot_of[begin % 2] = store.counter[N_COUNTERS]
    for t in range(begin, end):
        now, then = t % 2, 1 - t % 2
        slot_of[then] = 0
        store.key[:] = 0
        store.blind_node[then] = -1
        room = 4 * width * (2 + course.at[t + 1] - course.at[t]) * (k + 1)
        if (
            store.counter[NODES] + room + 4 * store.set_m.shape[1] >= store.node_need.size
            or store.counter[ARCS] + 4 * room + 8 * store.set_m.shape[1] >= store.arc_from.size
        ):
            store.counter[FULL] = 2
            return
        # free labels: thin, wait, take a camera alone, start sets
        for m in range(k + 1):
            n, e = 0, store.head[t, m]
            while e >= 0:
                n += 1
                e = store.pool_next[e]
            probe = probing and m == k - known.floor[t]
            if n == 0 and not probe:
                continue
            if n > most:
                most = 2 * n
                p_in, rank = np.empty((most, 2, 6)), np.empty(most)
                assigned = np.empty(most, dtype=np.int64)
            first = store.counter[NODES]
            kept = 0
            if n:
                n, e = 0, store.head[t, m]
                while e >= 0:
                    p_in[n] = store.pool_p[e]
                    rank[n] = worth(p_in[n, 0]) + (worth(p_in[n, 1]) if failures else 0.0)
                    n += 1
                    e = store.pool_next[e]
                eps = max(epsilon, bin_epsilon[m] / 2.25)
                kept, bin_epsilon[m] = thin(
                    n, p_in, rank, width, eps, probing, failures, assigned, kept_p, own_p, mm, vv
                )
                for b in range(kept):
                    new_node(store, t, kept_p[b, 0], kept_p[b, 1])
                n, e = 0, store.head[t, m]
                while e >= 0:
                    record(store, store.pool_parent[e], first + assigned[n], store.pool_units[e])
                    n += 1
                    following = store.pool_next[e]
                    store.pool_next[e] = store.counter[FREE]
                    store.counter[FREE] = e
                    e = following
                store.head[t, m] = -1
            if probe:
                new_node(store, t, course.floor[t], course.floor[t])
                for x in range(6):
                    kept_p[kept, 0, x] = kept_p[kept, 1, x] = course.floor[t, x]
                kept += 1
            for g in range(kept):
                parent = first + g
                p, past = row6(kept_p[g], 0), row6(kept_p[g], 1)
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
                    deposit(course, known, store, k, parent, 0, m, t + 1, q, r)
                for v in range(course.at[t], course.at[t + 1]):
                    units = course.units[v]
                    length = course.ptr[v + 1] - course.ptr[v]
                    togo = known.floor[t + length]
                    if m + units + togo > k:
                        store.node_need[parent] = min(store.node_need[parent], units + togo)
                    else:
                        alive, q, r = alone(course, v, t, p, past)
                        if alive:
                            deposit(course, known, store, k, parent, units, m + units, t + length,
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
                    if s >= store.set_m.shape[1]:
                        go_blind(store, now, parent, units, m + units, length)
                        continue
                    slot_of[now] += 1
                    store.set_m[now, s], store.set_n[now, s] = m + units, 1
                    store.set_flag[now, s] = False
                    store.set_ids[now, s, 0] = v
                    store.set_p[now, s] = work
                    store.set_node[now, s] = new_node(store, -1, p, past)
                    record(store, parent, store.set_node[now, s], units)
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
                latest = max(latest, v)
                started = np.searchsorted(course.at, v, side="right") - 1
                longest = max(longest, started + course.ptr[v + 1] - course.ptr[v] - t)
            for w in range(max(course.at[t], latest), course.at[t + 1]):
                units = course.units[w]
                length = max(longest, course.ptr[w + 1] - course.ptr[w])
                togo = known.hope[t + length]
                if m + units + togo > k:
                    store.node_need[node] = min(store.node_need[node], units + togo)
                    continue
                z = slot_of[now]
                if n == DEPTH or z >= store.set_m.shape[1]:
                    go_blind(store, now, node, units, m + units, length)
                    continue
                slot_of[now] += 1
                store.set_m[now, z], store.set_n[now, z] = m + units, n + 1
                store.set_flag[now, z] = True
                for a in range(n):
                    store.set_ids[now, z, a] = store.set_ids[now, s, a]
                store.set_ids[now, z, n] = w
                store.set_p[now, z] = store.set_p[now, s]
                if failures:
                    store.set_p[now, z, 2 + n] = store.set_p[now, s, 0]
                zero = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
                store.set_node[now, z] = new_node(store, -1, zero, zero)
                record(store, node, store.set_node[now, z], units)
                if store.counter[NODES] + 64 >= store.node_need.size or (
                    store.counter[ARCS] + 64 >= store.arc_from.size
                ):
                    store.counter[FULL] = 2
                    return
            # measure
            alive = True
            t0, t1, t2 = 0.0, 0.0, 0.0
            for a in range(n):
                v = store.set_ids[now, s, a]
                started = np.searchsorted(course.at, v, side="right") - 1
                e = course.ptr[v] + t - started
                t0 += course.blocks[e, 0]
                t1 += course.blocks[e, 1]
                t2 += course.blocks[e, 2]
            for c in range(2 + n if failures else 1):
                j0, j1, j2 = t0, t1, t2
                if c >= 2:
                    j0, j1, j2 = 0.0, 0.0, 0.0
                    for a in range(n):
                        if a != c - 2:
                            v = store.set_ids[now, s, a]
                            started = np.searchsorted(course.at, v, side="right") - 1
                            e = course.ptr[v] + t - started
                            j0 += course.blocks[e, 0]
                            j1 += course.blocks[e, 1]
                            j2 += course.blocks[e, 2]
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
                started = np.searchsorted(course.at, v, side="right") - 1
                if started + course.ptr[v + 1] - course.ptr[v] > t + 1:
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
                    deposit(course, known, store, k, node, 0, m, t + 1, q, r)
            elif not put_set(store, then, slot_of, slots, m, remain, ids, flag, node, work,
                             mm, vv):  # fmt: skip
                go_blind(store, then, node, 0, m, longest - 1)
            s += 1
        # blind labels: one camera more, or on to the next sample
        for m in range(k + 1):
            for length in range(1, span + 1):
                node = store.blind_node[now, m, length]
                if node < 0:
                    continue
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
                    deposit(course, known, store, k, node, 0, m, t + 1, q, q)
                else:
                    go_blind(store, then, node, 0, m, length - 1)
        if store.counter[FULL]:
            return
    store.counter[N_COUNTERS] = slot_of[end % 2]


@njit(cache=True)
def backward(store):  # type: ignore[no-untyped-def]
    """Complete node_need. Arcs into a label were recorded before those it left by afterwards."""
    for a in range(store.counter[ARCS] - 1, -1, -1):
        parent = store.arc_from[a]
        if parent >= 0:
            need = store.arc_units[a] + store.node_need[store.arc_to[a]]
            store.node_need[parent] = min(store.node_need[parent], need)
