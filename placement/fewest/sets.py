"""Labels with cameras in view: free labels set out, sets take one camera more or are measured.

A set holds up to `DEPTH` cameras in view at once, each with the covariance of its own failure, and
lasts until the last of them is out of view; it becomes a crowd where there are more.
"""

from __future__ import annotations

from numba import njit

from placement.fewest.arrays import DEPTH, FINDING, LEAN, NO_CAMERA, WAITED, ZERO
from placement.fewest.crossing import alone, end_of, move, one_step, shares_mount, told, worth
from placement.fewest.crowds import join_crowd, more_in_view, worst_dark
from placement.fewest.graph import NO_SAMPLE, deposit, new_node, no_room, record
from placement.fewest.merging import put_set
from placement.objectives.windows.filter import row6


@njit(**LEAN)
def set_out(  # type: ignore[no-untyped-def]
    course, known, store, t, k, parent, m, p, past, least, mode, slot_of, work, mm, vv
):
    """Let a free label wait a sample, take each camera that starts at t alone, and start sets."""
    now, t_end = t % 2, course.steps.shape[0]
    q = one_step(p, course.base[t], 0.0, 0.0, 0.0)
    r = q
    alive = q[3] <= course.limit
    if course.failures and alive:
        r = one_step(past, course.base[t], 0.0, 0.0, 0.0)
        alive = r[3] <= course.limit
    if alive:
        if t + 1 < t_end:
            q = move(q, course.steps[t + 1])
            r = move(r, course.steps[t + 1])
        deposit(course, known, store, k, parent, ZERO, WAITED, m, t + 1, q, r)
    for v in range(course.at[t], course.at[t + 1]):
        units = course.units[v]
        length = course.ptr[v + 1] - course.ptr[v]
        togo = known.floor[t + length]
        if m + units + togo > k:
            store.node_need[parent] = min(store.node_need[parent], units + togo)
        else:
            alive, q, r = alone(course, v, t, p, past)
            if alive:
                deposit(course, known, store, k, parent, units, v, m + units, t + length, q, r)
        if m + least[v] > k:
            store.node_need[parent] = min(store.node_need[parent], least[v])
            continue
        s = slot_of[now]
        if s >= store.set_m.shape[1]:
            if mode != FINDING:
                join_crowd(store, now, parent, units, m + units, 1 + ZERO, length, p, past, p,
                           mm, vv)  # fmt: skip
            continue
        slot_of[now] += 1
        store.set_m[now, s], store.set_n[now, s] = m + units, 1
        store.set_flag[now, s] = False
        store.set_ids[now, s, 0] = v
        for x in range(6):
            work[0, x] = p[x]
            if course.failures:
                work[1, x] = past[x]
                work[2, x] = p[x]
        for c in range(work.shape[0]):
            for x in range(6):
                store.set_p[now, s, c, x] = work[c, x]
        store.set_node[now, s] = new_node(store, NO_SAMPLE, p, past)
        record(store, parent, store.set_node[now, s], units, v)


@njit(**LEAN)
def sets_on(course, known, store, t, k, slots, mode, slot_of, ids, work, mm, vv):  # type: ignore[no-untyped-def]
    """Take every set of sample t to the next; return False where storage runs out."""
    now, then, failures = t % 2, 1 - t % 2, course.failures
    cameras = course.at[t + 1] - course.at[t]
    s = ZERO
    while s < slot_of[now]:
        m, n, node = store.set_m[now, s], store.set_n[now, s], store.set_node[now, s]
        longest, latest = ZERO, ZERO
        for a in range(n):
            v = store.set_ids[now, s, a]
            latest = max(latest, v % course.units.size)
            longest = max(longest, end_of(course, v) - t)
        if n < DEPTH and slot_of[now] + cameras <= store.set_m.shape[1]:
            if not one_more(course, known, store, t, k, s, longest, latest, mode, slot_of):
                return False
        elif mode != FINDING:
            if no_room(store, cameras + 64):
                return False
            q = row6(store.set_p[now, s], 0)
            r, dark = q, q
            if failures:
                r = row6(store.set_p[now, s], 1)
                dark = row6(store.set_p[now, s], worst_dark(store.set_p[now, s], n))
            more_in_view(course, known, store, t, k, node, m, n, longest, q, r, dark, mm, vv)
        if not measured(course, store, t, s, work):
            s += 1
            continue
        remain = ZERO
        for a in range(n):
            v = store.set_ids[now, s, a]
            if end_of(course, v) > t + 1:
                ids[remain] = v
                if failures:
                    for x in range(6):
                        work[2 + remain, x] = work[2 + a, x]
                remain += 1
            elif failures and worth(row6(work, 2 + a)) > worth(row6(work, 1)):
                for x in range(6):
                    work[1, x] = work[2 + a, x]
        q = row6(work, 0)
        r = row6(work, 1) if failures else q
        flag = store.set_flag[now, s]
        if remain == 0:
            if flag:
                deposit(course, known, store, k, node, ZERO, NO_CAMERA, m, t + 1, q, r)
        elif not put_set(store, then, slot_of, slots, m, remain, ids, flag, node, work,
                         mode, mm, vv) and mode != FINDING:  # fmt: skip
            dark = row6(work, worst_dark(work, remain)) if failures else q
            join_crowd(store, then, node, ZERO, m, remain, longest - 1, q, r, dark, mm, vv)
        s += 1
    return True


@njit(**LEAN)
def one_more(course, known, store, t, k, s, longest, latest, mode, slot_of):  # type: ignore[no-untyped-def]
    """Start a set for set s and each camera that starts at t; return False where storage runs out.

    Cameras come in order, so none before the `latest` of the set; that one only as its own second.
    """
    now = t % 2
    m, n, node = store.set_m[now, s], store.set_n[now, s], store.set_node[now, s]
    zero = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for w in range(max(course.at[t], latest), course.at[t + 1]):
        name = w
        if w == latest:
            if not course.twice[w]:
                continue
            name = w + course.units.size
        if mode == FINDING and shares_mount(course, name, store.set_ids[now, s], n):
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
        for c in range(store.set_p.shape[2]):
            for x in range(6):
                store.set_p[now, z, c, x] = store.set_p[now, s, c, x]
        if course.failures:
            for x in range(6):
                store.set_p[now, z, 2 + n, x] = store.set_p[now, s, 0, x]
        store.set_node[now, z] = new_node(store, NO_SAMPLE, zero, zero)
        record(store, node, store.set_node[now, z], units, name)
        if no_room(store, 64 + ZERO):
            return False
    return True


@njit(**LEAN)
def measured(course, store, t, s, work):  # type: ignore[no-untyped-def]
    """Fill work (scenarios, 6) with set s after sample t, each failure's; return whether alive."""
    now, n, t_end = t % 2, store.set_n[t % 2, s], course.steps.shape[0]
    for c in range(2 + n if course.failures else 1):
        j0, j1, j2 = 0.0, 0.0, 0.0
        for a in range(n):
            if a != c - 2:
                b = told(course, store.set_ids[now, s, a], t)
                j0 += b[0]
                j1 += b[1]
                j2 += b[2]
        q = one_step(row6(store.set_p[now, s], c), course.base[t], j0, j1, j2)
        if q[3] > course.limit:
            return False
        if t + 1 < t_end:
            q = move(q, course.steps[t + 1])
        for x in range(6):
            work[c, x] = q[x]
    return True
