"""More cameras in view than are told apart: a *crowd* knows what as many of the best would tell.

Of n cameras in view at once each tells at most the join J* of what the candidates tell, so all of
them at most n J*, and (n − 1) J* with one of them dark. A crowd keeps the covariances that its
cameras came with, and all are taken to be in view until the last one is out of it. There is one
label for each price, count and length; those that meet in it are merged. Where there are more
cameras than are counted, a label goes blind: it knows all that any camera could tell.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.diagram.order import block_join
from placement.fewest.arrays import DEPTH, LEAN, MOST_UNITS, NO_CAMERA, ZERO
from placement.fewest.crossing import move, one_step, worth
from placement.fewest.graph import NO_SAMPLE, deposit, go_blind, new_node, no_room, record
from placement.fewest.merging import lower
from placement.objectives.windows.filter import row6

LEAST = DEPTH + 1  # cameras of the smallest crowd


@njit(cache=True)
def join_of_all(at, ptr, blocks, out):  # type: ignore[no-untyped-def]
    """Fill out (t, 3) with blocks above those of every camera at every sample."""
    out[:] = 0.0
    for t in range(out.shape[0]):
        for v in range(at[t], at[t + 1]):
            for e in range(ptr[v], ptr[v + 1]):
                o, b = out[t + e - ptr[v]], blocks[e]
                o[0], o[1], o[2] = block_join(o[0], o[1], o[2], b[0], b[1], b[2])


@njit(**LEAN)
def worst_dark(p, n):  # type: ignore[no-untyped-def]
    """Return which of the n failures p[2:] of a set looks worst: a crowd keeps that one."""
    worst = 2
    for a in range(3, 2 + n):
        if worth(row6(p, a)) > worth(row6(p, worst)):
            worst = a
    return worst


@njit(**LEAN)
def join_crowd(store, side, parent, units, m, count, length, p, past, dark, mm, vv):  # type: ignore[no-untyped-def]
    """Let `count` cameras be a crowd for `length` samples more."""
    n = max(count, LEAST) - LEAST
    if n >= store.crowd_node.shape[2]:
        go_blind(store, side, parent, units, m, length)
        return
    node = store.crowd_node[side, m, n, length]
    kept = store.crowd_p[side, m, n, length]
    if node < 0:
        zero = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        node = new_node(store, NO_SAMPLE, zero, zero)
        store.crowd_node[side, m, n, length] = node
        for x in range(6):
            kept[0, x], kept[1, x], kept[2, x] = p[x], past[x], dark[x]
    else:
        low = lower(row6(kept, 0), p, mm, vv)
        low1 = lower(row6(kept, 1), past, mm, vv)
        low2 = lower(row6(kept, 2), dark, mm, vv)
        for x in range(6):
            kept[0, x], kept[1, x], kept[2, x] = low[x], low1[x], low2[x]
    record(store, parent, node, units, NO_CAMERA)


@njit(**LEAN)
def more_in_view(course, known, store, t, k, node, m, count, length, p, past, dark, mm, vv):  # type: ignore[no-untyped-def]
    """Let a label become a larger crowd by the cameras that start at t.

    One stands for all that can be paid for: as cheap as the cheapest, as long in view as the last.
    """
    cheapest, longest = np.int64(MOST_UNITS), ZERO
    for w in range(course.at[t], course.at[t + 1]):
        units = course.units[w]
        longer = max(length, course.ptr[w + 1] - course.ptr[w])
        togo = known.hope[t + longer]
        if m + units + togo > k:
            store.node_need[node] = min(store.node_need[node], units + togo)
        else:
            cheapest, longest = min(cheapest, units), max(longest, longer)
    if longest:
        join_crowd(store, t % 2, node, cheapest, m + cheapest, count + 1, longest, p, past, dark,
                   mm, vv)  # fmt: skip


@njit(**LEAN)
def crowds_on(course, known, store, t, k, mm, vv):  # type: ignore[no-untyped-def]
    """Take every crowd of sample t to the next; return False where storage runs out."""
    now, then, t_end = t % 2, 1 - t % 2, course.steps.shape[0]
    span = store.blind_node.shape[2] - 2
    cameras = course.at[t + 1] - course.at[t]
    best = course.best[t]
    for n in range(store.crowd_node.shape[2]):
        count = n + LEAST
        for m in range(k + 1):
            for length in range(1, span + 1):
                node = store.crowd_node[now, m, n, length]
                if node < 0:
                    continue
                if no_room(store, cameras + 64):
                    return False
                kept = store.crowd_p[now, m, n, length]
                p, past, dark = row6(kept, 0), row6(kept, 1), row6(kept, 2)
                more_in_view(course, known, store, t, k, node, m, count, length, p, past, dark,
                             mm, vv)  # fmt: skip
                x, y = float(count), float(count - 1)
                p = one_step(p, course.base[t], x * best[0], x * best[1], x * best[2])
                if p[3] > course.limit:
                    continue
                if course.failures:
                    past = one_step(past, course.base[t], x * best[0], x * best[1], x * best[2])
                    dark = one_step(dark, course.base[t], y * best[0], y * best[1], y * best[2])
                    if past[3] > course.limit or dark[3] > course.limit:
                        continue
                else:
                    past, dark = p, p
                if t + 1 < t_end:
                    p = move(p, course.steps[t + 1])
                    past, dark = move(past, course.steps[t + 1]), move(dark, course.steps[t + 1])
                if length == 1 or t + 1 == t_end:
                    if worth(dark) > worth(past):
                        past = dark
                    deposit(course, known, store, k, node, ZERO, NO_CAMERA, m, t + 1, p, past)
                else:
                    join_crowd(store, then, node, ZERO, m, count, length - 1, p, past, dark, mm, vv)
    return True


@njit(**LEAN)
def blind_on(course, known, store, t, k):  # type: ignore[no-untyped-def]
    """Take every blind label of sample t to the next; return False where storage runs out."""
    now, then, t_end = t % 2, 1 - t % 2, course.steps.shape[0]
    span = store.blind_node.shape[2] - 2
    cameras = course.at[t + 1] - course.at[t]
    for m in range(k + 1):
        for length in range(1, span + 1):
            node = store.blind_node[now, m, length]
            if node < 0:
                continue
            if no_room(store, cameras + 64):
                return False
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
                deposit(course, known, store, k, node, ZERO, NO_CAMERA, m, t + 1, q, q)
            else:
                go_blind(store, then, node, ZERO, m, length - 1)
    return True
