"""The sweep along the road: labels extended, merged downward, and bounded from behind.

A *label* at (t, m) stands for every partial placement of m cameras whose clusters end before
sample t: `cost`, at most the sum of tr(W P) so far, and P, below their covariance at t before its
measurements. It is extended by waiting, and by every camera that starts at t, alone
(`diagram.extension`, `diagram.alone`) or with others (`diagram.clusters`).

Labels that meet are thinned (`diagram.merging`): one that another dominates (cost and P no
greater) is dropped, and near ones are merged into the lesser cost and a Loewner lower bound of
both P. The Riccati map is monotone in P and in the information, so the least cost at the end is
below every placement's, whatever is merged: docs/trace-bound.md has the proof.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.diagram.alone import extend_by_one
from placement.diagram.arrays import ARCS, CLASSES, FREE, FULL, LOOKS, MERGES, NODES
from placement.diagram.clusters import begin_clusters, continue_clusters
from placement.diagram.extension import extend_alone, record
from placement.diagram.merging import thin

STORAGE_FULL = 1  # the value of counter[FULL]


@njit(cache=True)
def forward(begin, end, k, road, views, alone, rules, hope, table, bin_epsilon, storage):  # type: ignore[no-untyped-def]
    """Sweep samples begin…end − 1; stop early with counter[FULL] set if storage runs out."""
    nodes, pool, arcs, counter = storage.nodes, storage.pool, storage.arcs, storage.counter
    sources, targets, moves, costs = arcs.source, arcs.target, arcs.move, arcs.cost
    mat, vec = np.empty((3, 3)), np.empty((3, 3))
    most = rules.width + 1
    kept_cost, kept_p = np.empty(most), np.empty((most, 6))
    own_cost, own_p = np.empty(most), np.empty((most, 6))
    own_near, own_rank = np.empty(most), np.empty(most)
    rough_cost, rough_p = np.empty(most), np.empty((most, 6))
    rough_own_cost, rough_own_p = np.empty(most), np.empty((most, 6))
    rough_near, rough_rank = np.empty(most), np.empty(most)
    rough_of = np.empty(most, dtype=np.int64)
    n_most = 1024
    cost, rank, near = np.empty(n_most), np.empty(n_most), np.empty(n_most)
    p_in = np.empty((n_most, 6))
    assigned = np.empty(n_most, dtype=np.int64)
    for t in range(begin, end):
        starting = views.at[t + 1] - views.at[t]
        for m in range(k + 1):
            nodes.lo[t, m] = counter[NODES]
            nodes.hi[t, m] = counter[NODES]
            start = rules.probing and (m == 0 or rules.price == 0.0)
            n = 1 if start else 0
            e = pool.head[t, m]
            while e >= 0:
                n += 1
                e = pool.next[e]
            in_clusters = views.families * CLASSES * (views.span + 1) * rules.slots
            room = n + 2 * rules.width + in_clusters * (2 + starting)
            if counter[ARCS] + room >= arcs.cost.size or counter[NODES] + room >= nodes.cost.size:
                counter[FULL] = STORAGE_FULL
                return
            if n > n_most:
                n_most = 2 * n
                cost, rank, near = np.empty(n_most), np.empty(n_most), np.empty(n_most)
                p_in = np.empty((n_most, 6))
                assigned = np.empty(n_most, dtype=np.int64)
            arrived = 0
            e = pool.head[t, m]
            while e >= 0:
                cost[arrived] = pool.value[e, 0]
                rank[arrived] = pool.value[e, 2]
                for x in range(6):
                    p_in[arrived, x] = pool.value[e, 3 + x]
                e = pool.next[e]
                arrived += 1
            if start:
                cost[arrived], rank[arrived] = 0.0, 0.0
                for x in range(6):
                    p_in[arrived, x] = road.floor_p[t, x]
            kept, rough = 0, 0
            first, lead = counter[NODES], counter[NODES]
            if n > 0:
                for a in range(n):
                    near[a] = product(road.near_form[t], p_in[a])
                    if table.p.shape[0] == 0:
                        rank[a] = cost[a] + near[a]
                kept, used, merges = thin(
                    n,
                    cost,
                    p_in,
                    rank,
                    near,
                    rules.width,
                    max(rules.epsilon, bin_epsilon[m] / 2.25),
                    rules.slack,
                    rules.probing,
                    assigned,
                    kept_cost,
                    kept_p,
                    own_cost,
                    own_p,
                    own_near,
                    own_rank,
                    mat,
                    vec,
                )
                bin_epsilon[m] = used
                counter[MERGES] += merges
                counter[LOOKS] += n * kept
                for b in range(kept):
                    nodes.cost[first + b] = kept_cost[b]
                    nodes.togo[first + b] = np.inf
                    for x in range(6):
                        nodes.p[first + b, x] = kept_p[b, x]
                nodes.hi[t, m] = first + kept
                counter[NODES] += kept
                # what led here, and give the pool back
                e = pool.head[t, m]
                for a in range(arrived):
                    record(
                        sources,
                        targets,
                        moves,
                        costs,
                        counter,
                        pool.parent[e],
                        first + assigned[a],
                        pool.move[e],
                        pool.value[e, 1],
                    )
                    following = pool.next[e]
                    pool.next[e] = counter[FREE]
                    counter[FREE] = e
                    e = following
                pool.head[t, m] = -1
                if k - m > 1 and starting:
                    rough, _, _ = thin(
                        kept,
                        kept_cost,
                        kept_p,
                        own_rank,
                        own_near,
                        min(rules.width, rules.coarse_width),
                        rules.coarse,
                        0.0,
                        rules.probing,
                        rough_of,
                        rough_cost,
                        rough_p,
                        rough_own_cost,
                        rough_own_p,
                        rough_near,
                        rough_rank,
                        mat,
                        vec,
                    )
                    lead = counter[NODES]
                    for b in range(rough):
                        nodes.togo[lead + b] = np.inf
                    counter[NODES] += rough
                    for b in range(kept):
                        record(
                            sources,
                            targets,
                            moves,
                            costs,
                            counter,
                            first + b,
                            lead + rough_of[b],
                            -1,
                            0.0,
                        )
            # where offsets persist, cameras alone are moves of their own
            apart = alone.at.size > 0
            most_now = m if apart else k
            extend_alone(t, m, first, kept, most_now, road, views, rules, table, storage)
            if apart and m < k and not counter[FULL]:
                extend_by_one(
                    t, m, first, kept, road, alone, views.ptr.size - 1, rules, table, storage
                )
            if counter[FULL]:
                return
            begin_clusters(
                t,
                m,
                lead,
                rough,
                rough_cost,
                rough_p,
                k,
                road,
                views,
                rules,
                hope,
                storage,
                mat,
                vec,
            )
            if m > 0:
                continue_clusters(t, m, k, road, views, rules, hope, table, storage, mat, vec)
                if counter[FULL]:
                    return


@njit(cache=True, inline="always")
def product(form, p):  # type: ignore[no-untyped-def]
    """Return the inner product of two symmetric (6,)."""
    return (
        form[0] * p[0]
        + form[3] * p[3]
        + form[5] * p[5]
        + 2.0 * (form[1] * p[1] + form[2] * p[2] + form[4] * p[4])
    )


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
