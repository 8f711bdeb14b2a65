"""How labels with nothing pending are extended: by waiting, and by one camera from end to end."""

from __future__ import annotations

from numba import njit

from placement.diagram.arrays import ARCS, FREE, FULL, POOL, PRUNED
from placement.diagram.merging import row
from placement.diagram.togo import least_togo
from placement.objectives.windows.filter import predict, update

POOL_FULL = 2  # the value of counter[FULL]


@njit(cache=True, inline="always")
def record(sources, targets, moves, costs, counter, source, target, move, cost):  # type: ignore[no-untyped-def]
    """Append an arc."""
    c = counter[ARCS]
    sources[c], targets[c], moves[c], costs[c] = source, target, move, cost
    counter[ARCS] = c + 1


@njit(cache=True)
def extend_alone(t, m, first, kept, k, road, views, rules, table, storage):  # type: ignore[no-untyped-def]
    """Extend labels first…first + kept − 1, of m cameras at t, without any overlap."""
    # named tuples are taken apart outside the loops: each look inside counts references
    steps, base, w_tt, w_nn = road.steps, road.base, road.w_tt, road.w_nn
    ptr, blocks = views.ptr, views.blocks
    lo, hi, table_p, table_togo = table.lo, table.hi, table.p, table.togo
    node_p, node_cost, togo = storage.nodes.p, storage.nodes.cost, storage.nodes.togo
    head, following, pool = storage.pool.head, storage.pool.next, storage.pool
    parents, moves, values = pool.parent, pool.move, pool.value
    counter = storage.counter
    price, probing, threshold = rules.price, rules.probing, rules.threshold
    t_end, begin = steps.shape[0], views.at[t]
    end = views.at[t + 1] if m < k else begin
    for parent in range(first, first + kept):
        for v in range(begin - 1, end):
            waiting = v < begin
            q = row(node_p, parent)
            paid = 0.0 if waiting else price
            stop = t + 1 if waiting else t + ptr[v + 1] - ptr[v]
            e = -1 if waiting else ptr[v]
            for s in range(t, stop):
                j0, j1, j2 = base[s, 0], base[s, 1], base[s, 2]
                if not waiting:
                    j0 += blocks[e, 0]
                    j1 += blocks[e, 1]
                    j2 += blocks[e, 2]
                    e += 1
                u0, u1, u2, u3, u4, u5, _ = update(q, j0, j1, j2)
                paid += w_tt * u0 + w_nn * u3
                q = (u0, u1, u2, u3, u4, u5)
                if s + 1 < t_end:
                    q = predict(q, steps[s + 1])
            deposit(
                parent,
                0.0 if probing else node_cost[parent],
                paid,
                q,
                stop,
                m if waiting or price > 0.0 else m + 1,
                -1 if waiting else v,
                threshold,
                lo,
                hi,
                table_p,
                table_togo,
                head,
                following,
                parents,
                moves,
                values,
                togo,
                counter,
            )
            if counter[FULL]:
                return


@njit(cache=True)
def deposit(  # type: ignore[no-untyped-def]
    parent,
    cost,
    paid,
    q,
    at,
    m,
    move,
    threshold,
    table_lo,
    table_hi,
    table_p,
    table_togo,
    head,
    following,
    parents,
    moves,
    values,
    togo_of,
    counter,
):
    """Leave a label with nothing pending for sample `at`, unless the table says it is no good."""
    if at == table_lo.shape[0] - 1:
        togo_of[parent] = min(togo_of[parent], paid)
        return
    togo = least_togo(q, table_lo[at, m], table_hi[at, m], table_p, table_togo)
    if cost + paid + togo > threshold:
        counter[PRUNED] += 1
        togo_of[parent] = min(togo_of[parent], paid + togo)
        return
    x = counter[FREE]
    if x >= 0:
        counter[FREE] = following[x]
    else:
        x = counter[POOL]
        if x >= following.size:
            counter[FULL] = POOL_FULL
            return
        counter[POOL] += 1
    parents[x] = parent
    moves[x] = move
    values[x, 0] = cost + paid
    values[x, 1] = paid
    values[x, 2] = cost + paid + togo
    for z in range(6):
        values[x, 3 + z] = q[z]
    following[x] = head[at, m]
    head[at, m] = x
