"""The labels as a graph: nodes, arcs with their price, and what each still needs, backward."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.diagram.order import below
from placement.fewest.arrays import (
    ARCS,
    BLIND,
    END,
    FREE,
    FULL,
    LEAN,
    MOST_UNITS,
    NO_CAMERA,
    NODES,
    POOL,
    WAITED,
)
from placement.objectives.windows.filter import row6

NO_SAMPLE = np.int64(-1)


@njit(cache=True, inline="always")
def settle(course, t, units):  # type: ignore[no-untyped-def]
    """Return units paid before t, or needed after it: rounded up where all cameras are whole."""
    if course.settled[t]:
        return -(-units // course.per_unit) * course.per_unit
    return units


@njit(**LEAN)
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


@njit(**LEAN)
def no_room(store, nodes):  # type: ignore[no-untyped-def]
    """Return whether the storage may run out within so many nodes and three arcs for each."""
    if (
        store.counter[NODES] + nodes >= store.node_need.size
        or store.counter[ARCS] + 3 * nodes >= store.arc_from.size
    ):
        store.counter[FULL] = 2
        return True
    return False


@njit(**LEAN)
def record(store, parent, child, units, camera):  # type: ignore[no-untyped-def]
    """Add an arc: what it costs, and which camera is taken by it, −1 for none."""
    a = store.counter[ARCS]
    store.arc_camera[a] = camera
    store.arc_from[a], store.arc_to[a], store.arc_units[a] = parent, child, units
    store.counter[ARCS] += 1


@njit(**LEAN)
def new_node(store, t, p, past):  # type: ignore[no-untyped-def]
    """Add a node; t = NO_SAMPLE where it is no free label."""
    n = store.counter[NODES]
    store.node_need[n] = MOST_UNITS
    store.node_t[n] = t
    if t >= 0:
        for x in range(6):
            store.node_p[n, 0, x] = p[x]
            store.node_p[n, 1, x] = past[x]
    store.counter[NODES] += 1
    return n


@njit(**LEAN)
def deposit(course, known, store, k, parent, units, camera, m, t, p, past):  # type: ignore[no-untyped-def]
    """Leave a free label of price m for sample t, unless it is known to be too dear.

    From the horizon on it is not followed: it needs at least what is known of it.
    """
    if t >= course.steps.shape[0]:
        record(store, parent, np.int64(END), units, camera)
        return
    m = settle(course, t, m)
    togo = needed(known, t, p, past, course.failures)
    if m + togo > k or t >= known.horizon:
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
    store.pool_parent[x], store.pool_units[x], store.pool_camera[x] = parent, units, camera
    store.pool_waited[x] = camera == WAITED
    for z in range(6):
        store.pool_p[x, 0, z] = p[z]
        store.pool_p[x, 1, z] = past[z]
    store.pool_next[x] = store.head[t, m]
    store.head[t, m] = x


@njit(**LEAN)
def go_blind(store, parity, parent, units, m, length):  # type: ignore[no-untyped-def]
    """Let a label know everything for `length` samples more."""
    n = store.blind_node[parity, m, length]
    if n < 0:
        zero = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        n = new_node(store, NO_SAMPLE, zero, zero)
        store.blind_node[parity, m, length] = n
    store.counter[BLIND] += 1
    record(store, parent, n, units, NO_CAMERA)


@njit(**LEAN)
def backward(course, store):  # type: ignore[no-untyped-def]
    """Complete node_need. Arcs into a label were recorded before those it left by afterwards."""
    for n in range(store.counter[ARCS] - 1, -1, -1):
        parent, child = store.arc_from[n], store.arc_to[n]
        t = store.node_t[child]
        if t >= 0:
            store.node_need[child] = settle(course, t, store.node_need[child])
        if parent >= 0:
            need = store.arc_units[n] + store.node_need[child]
            store.node_need[parent] = min(store.node_need[parent], need)
