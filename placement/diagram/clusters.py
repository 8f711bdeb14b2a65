"""Labels inside clusters: cameras whose views overlap, with their information still pending.

A placement, its cameras in the order of their first samples, falls apart into *clusters*: a
camera that starts at or before the last sample that the cluster sees joins it, the next one
starts a new cluster. Between clusters nothing is pending. Inside, a label also carries the
information still pending, sample by sample, and is kept by its count, by the camera whose
view lasts longest, and by the class of the one before; merged labels take the Loewner join of what
they have pending. Overlaps may be of any depth. Clusters start from labels merged further, since
cameras that see the same stretch are rarely any good.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.diagram.arrays import CLASSES, FULL
from placement.diagram.extension import deposit, record
from placement.diagram.merging import merge_block, put_pending, row, second_class, slot_of
from placement.objectives.windows.filter import predict, update


@njit(cache=True)
def begin_clusters(  # type: ignore[no-untyped-def]
    t, m, lead, rough, rough_cost, rough_p, k, road, views, rules, hope, storage, mat, vec
):
    """Start a cluster with every camera of sample t, from `rough` labels numbered from `lead`."""
    pending, arcs, counter = storage.pending, storage.arcs, storage.counter
    node, cost_of, near_of, p_of = pending.node, pending.cost, pending.near, pending.p
    blocks_of, second_of, togo = pending.blocks, pending.second, storage.nodes.togo
    sources, targets, moves, costs = arcs.source, arcs.target, arcs.move, arcs.cost
    ptr, blocks, families, span = views.ptr, views.blocks, views.families, views.span
    floor_cost, t_end, slots = road.floor_cost, road.steps.shape[0], rules.slots
    price, threshold = rules.price, rules.threshold
    with_another = 0 if price > 0.0 else m + 2
    for g in range(rough):
        q = row(rough_p, g)
        for v in range(views.at[t], views.at[t + 1]):
            length = ptr[v + 1] - ptr[v]
            ahead = floor_cost[t + length] - floor_cost[t] + 2.0 * price
            ahead += hope_of_more(t + length, with_another, span, t_end, floor_cost, hope)
            if rough_cost[g] + ahead > threshold:
                togo[lead + g] = min(togo[lead + g], ahead)
                continue
            at = slot_of(t % 2, m + 1, length, views.family[v], 0, k, span, families, slots)
            s, fresh = put_pending(
                at,
                slots,
                q,
                rough_cost[g] + price,
                node,
                cost_of,
                near_of,
                p_of,
                togo,
                counter,
                mat,
                vec,
            )
            for x in range(length):
                e = ptr[v] + x
                merge_block(blocks_of[s, x], blocks[e, 0], blocks[e, 1], blocks[e, 2], fresh)
            second_of[s] = 0
            record(sources, targets, moves, costs, counter, lead + g, node[s], v, price)


@njit(cache=True)
def hope_of_more(later, m, span, t_end, floor_cost, hope):  # type: ignore[no-untyped-def]
    """Return the least cost from `later` on where a cluster lasts to some sample after it."""
    least = np.inf
    for u in range(min(span, t_end - later + 1)):
        least = min(least, floor_cost[later + u] - floor_cost[later] + hope[later + u, m])
    return least


@njit(cache=True)
def continue_clusters(t, m, k, road, views, rules, hope, table, storage, mat, vec):  # type: ignore[no-untyped-def]
    """Give every cluster of m cameras at t one camera more, and take it to the next sample."""
    # named tuples are taken apart outside the loops: each look inside counts references
    pending, arcs, pool, counter = storage.pending, storage.arcs, storage.pool, storage.counter
    node, cost_of, near_of, p_of = pending.node, pending.cost, pending.near, pending.p
    blocks_of, second_of, togo = pending.blocks, pending.second, storage.nodes.togo
    sources, targets, moves, costs = arcs.source, arcs.target, arcs.move, arcs.cost
    head, following, parents, waiting = pool.head, pool.next, pool.parent, pool.move
    values = pool.value
    lo, hi, table_p, table_togo = table.lo, table.hi, table.p, table.togo
    ptr, blocks, family_of = views.ptr, views.blocks, views.family
    rest, unbounded = views.rest, views.rest_length[t] if m + 1 == k else 0
    begin, end = views.at[t], views.at[t + 1] if m < k else views.at[t]
    families, span, slots, threshold = views.families, views.span, rules.slots, rules.threshold
    floor_cost, t_end = road.floor_cost, road.steps.shape[0]
    base, steps, w_tt, w_nn = road.base, road.steps, road.w_tt, road.w_nn
    price, probing = rules.price, rules.probing
    # counts of labels: at cuts now and with one camera more; inside, at the next sample
    now, more, inside = (0, 0, 1) if price > 0.0 else (m, m + 1, m)
    for length in range(1, span + 1):
        for key in range(families * CLASSES):
            family, kind = key // CLASSES, key % CLASSES
            here = slot_of(t % 2, m, length, family, kind, k, span, families, slots)
            for s in range(here, here + slots):
                parent = node[s]
                if parent < 0:
                    continue
                node[s] = -1
                p = row(p_of, s)
                cost = 0.0 if probing else cost_of[s]
                for v in range(begin, end):
                    own = ptr[v + 1] - ptr[v]
                    total = max(own, length, unbounded)
                    ahead = floor_cost[t + total] - floor_cost[t] + price + hope[t + total, more]
                    if cost + ahead > threshold:
                        togo[parent] = min(togo[parent], ahead)
                        continue
                    second = max(min(own, length), second_of[s], unbounded)
                    after = second_class(second, span)
                    longest = family_of[v] if own >= length else family
                    at = slot_of(t % 2, m + 1, total, longest, after, k, span, families, slots)
                    r, fresh = put_pending(
                        at,
                        slots,
                        p,
                        cost + price,
                        node,
                        cost_of,
                        near_of,
                        p_of,
                        togo,
                        counter,
                        mat,
                        vec,
                    )
                    for x in range(total):
                        j0, j1, j2 = 0.0, 0.0, 0.0
                        if x < length:
                            j0, j1, j2 = blocks_of[s, x, 0], blocks_of[s, x, 1], blocks_of[s, x, 2]
                        if x < own:
                            e = ptr[v] + x
                            j0, j1, j2 = j0 + blocks[e, 0], j1 + blocks[e, 1], j2 + blocks[e, 2]
                        if x < unbounded:
                            j0, j1, j2 = j0 + rest[t, x, 0], j1 + rest[t, x, 1], j2 + rest[t, x, 2]
                        merge_block(blocks_of[r, x], j0, j1, j2, fresh)
                    second_of[r] = second if fresh else max(second, second_of[r])
                    record(sources, targets, moves, costs, counter, parent, node[r], v, price)
                if kind == 0 and (length == 1 or m == k):
                    continue  # a cluster of one: its own path has it
                j = blocks_of[s, 0]
                u0, u1, u2, u3, u4, u5, _ = update(
                    p, base[t, 0] + j[0], base[t, 1] + j[1], base[t, 2] + j[2]
                )
                paid = w_tt * u0 + w_nn * u3
                q = (u0, u1, u2, u3, u4, u5)
                if t + 1 < t_end:
                    q = predict(q, steps[t + 1])
                if length == 1 or t + 1 == t_end:
                    deposit(
                        parent,
                        cost,
                        paid,
                        q,
                        t + 1,
                        now,
                        -1,
                        threshold,
                        lo,
                        hi,
                        table_p,
                        table_togo,
                        head,
                        following,
                        parents,
                        waiting,
                        values,
                        togo,
                        counter,
                    )
                    if counter[FULL]:
                        return
                    continue
                later = t + length
                ahead = floor_cost[later] - floor_cost[t + 1]
                if kind > 0:
                    ahead += hope[later, now]
                else:
                    ahead += price + hope_of_more(later, more, span, t_end, floor_cost, hope)
                if cost + paid + ahead > threshold:
                    togo[parent] = min(togo[parent], paid + ahead)
                    continue
                second = max(0, second_of[s] - 1)
                after = second_class(second, span) if kind > 0 else 0
                at = slot_of(1 - t % 2, inside, length - 1, family, after, k, span, families, slots)
                r, fresh = put_pending(
                    at,
                    slots,
                    q,
                    cost + paid,
                    node,
                    cost_of,
                    near_of,
                    p_of,
                    togo,
                    counter,
                    mat,
                    vec,
                )
                for x in range(length - 1):
                    b = blocks_of[s, x + 1]
                    merge_block(blocks_of[r, x], b[0], b[1], b[2], fresh)
                second_of[r] = second if fresh else max(second, second_of[r])
                record(sources, targets, moves, costs, counter, parent, node[r], -1, paid)
