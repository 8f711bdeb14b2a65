"""The sweep along the road: labels extended, merged downward, and bounded from behind.

A *label* at (t, m) stands for every partial placement of m cameras whose clusters end before
sample t: `cost`, at most the sum of tr(W P) so far, and P, below their covariance at t before its
measurements. It is extended by waiting, and by every camera that starts at t, alone or with
others.

A placement, its cameras in the order of their first samples, falls apart into *clusters*: a
camera that starts at or before the last sample that the cluster sees joins it, the next one
starts a new cluster. Between clusters nothing is pending. Inside, a label also carries the
information still pending, sample by sample, and is kept by its count, by the camera whose
view lasts longest, and by the class of the one before; merged labels take the Loewner join of what
they have pending. Overlaps may be of any depth. Clusters start from labels merged further, since
cameras that see the same stretch are rarely any good.

Labels that meet are
thinned: one that another dominates (cost and P no greater) is dropped, and near ones are merged
into the lesser cost and a Loewner lower bound of both P. The Riccati map is monotone in P and in
the information, so the least cost at the end is below every placement's, whatever is merged.

Backward, each label learns `togo`, a lower bound on the cost from its P to the end: the least,
over its arcs, of the arc's cost and the target's togo. Any label with m cameras at t whose P is
above λ ≤ 1 times another's has at least λ times its togo, as the map is concave in P with
nonnegative value at 0. So the labels of one sweep are the pruning table of the next.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.diagram.order import below, block_join, meet
from placement.objectives.windows.filter import predict, update

# Counters of a sweep, in an int64 array.
NODES, ARCS, POOL, FREE, FULL, MERGES, PRUNED = range(7)
N_COUNTERS = 7
# Labels inside a cluster are kept apart by the camera whose view lasts longest (its last sample,
# and its family among those of the same) and by how long the second lasts: its class, by share
# of the span; class 0 is a cluster of one so far.
CLASSES = 6
NEAR = 0.003  # the relative difference in cost at which labels inside clusters are kept apart
HOPELESS = 1e3  # an ε beyond which no two labels are near
SHRINKS = (1.0, 0.97, 0.9, 0.75, 0.5)  # the λ that are tried


@njit(cache=True)
def least_togo(p, lo, hi, table_p, table_togo):  # type: ignore[no-untyped-def]
    """Return a lower bound on the cost from `p` to the end, from rows lo…hi − 1 of a table.

    Rows are sorted by falling togo.
    """
    best = 0.0
    for n in range(lo, hi):
        togo = table_togo[n]
        if togo <= best:
            break
        q = (
            table_p[n, 0],
            table_p[n, 1],
            table_p[n, 2],
            table_p[n, 3],
            table_p[n, 4],
            table_p[n, 5],
        )
        for shrink in SHRINKS:
            if shrink * togo <= best:
                break
            if below(q, p, shrink):
                best = shrink * togo
                break
    return best


@njit(cache=True)
def thin(  # type: ignore[no-untyped-def]
    n,
    cost,
    p,
    rank,
    near,
    width,
    epsilon,
    slack,
    probing,
    assigned,
    kept_cost,
    kept_p,
    own_cost,
    own_p,
    own_near,
    own_rank,
    scratch_m,
    scratch_v,
):
    """Merge `n` labels into at most `width`; return (kept, the ε it took, merges).

    Labels are taken in the order of `rank`. A label is dropped if a kept one dominates it, and
    merged into a kept one whose own P is at most 1 + ε times its, and whose own cost is at most
    ε · near above. `assigned` (n,) tells which kept label stands for each.
    """
    order = np.argsort(rank[:n])
    least = rank[order[0]]
    while True:
        kept, merges = 0, 0
        fits = True
        for a0 in range(n):
            a = order[a0]
            q = (p[a, 0], p[a, 1], p[a, 2], p[a, 3], p[a, 4], p[a, 5])
            c = cost[a]
            found = -1
            for b in range(0 if probing else kept):
                if kept_cost[b] <= c:
                    s = (
                        kept_p[b, 0],
                        kept_p[b, 1],
                        kept_p[b, 2],
                        kept_p[b, 3],
                        kept_p[b, 4],
                        kept_p[b, 5],
                    )
                    if below(s, q, 1.0):
                        found = b
                        break
            if found >= 0:
                assigned[a] = found
                continue
            grow = epsilon * (1.0 + slack * (rank[a] - least))
            shrink = 1.0 / (1.0 + grow)
            for b in range(kept):
                if c >= own_cost[b] - grow * own_near[b]:
                    s = (
                        own_p[b, 0],
                        own_p[b, 1],
                        own_p[b, 2],
                        own_p[b, 3],
                        own_p[b, 4],
                        own_p[b, 5],
                    )
                    if below(s, q, shrink):
                        found = b
                        break
            if found < 0 and kept == width and epsilon > HOPELESS:
                found = 0  # singular covariances are below nothing: merge them all the same
            if found >= 0:
                b = found
                f = shrink * (1.0 - 1e-12)
                s = (
                    kept_p[b, 0],
                    kept_p[b, 1],
                    kept_p[b, 2],
                    kept_p[b, 3],
                    kept_p[b, 4],
                    kept_p[b, 5],
                )
                low = (f * s[0], f * s[1], f * s[2], f * s[3], f * s[4], f * s[5])
                if not below(low, q, 1.0):
                    # earlier merges moved the kept label: only its own P is known to be below q
                    low = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
                r = meet(s, q, low, scratch_m, scratch_v)
                for x in range(6):
                    kept_p[b, x] = r[x]
                if c < kept_cost[b]:
                    kept_cost[b] = c
                assigned[a] = b
                merges += 1
                continue
            if kept == width:
                fits = False
                break
            kept_cost[kept] = c
            own_cost[kept] = c
            own_near[kept] = near[a]
            own_rank[kept] = rank[a]
            for x in range(6):
                kept_p[kept, x] = q[x]
                own_p[kept, x] = q[x]
            assigned[a] = kept
            kept += 1
        if fits:
            return kept, epsilon, merges
        epsilon *= 1.5


@njit(cache=True)
def hopes(floor_p, floor_cost, span, table_lo, table_hi, table_p, table_togo, out):  # type: ignore[no-untyped-def]
    """Fill `out` (t + 1, k + 2): least cost from a cluster that ends before t, or goes on.

    The cost to go from the floor, by the table; or, with one camera more, from a later end.
    """
    t_end, k = out.shape[0] - 1, out.shape[1] - 2
    for m in range(k + 2):
        out[t_end, m] = 0.0
    for t in range(t_end - 1, -1, -1):
        q = row(floor_p, t)
        out[t, k + 1] = np.inf
        for m in range(k, -1, -1):
            best = least_togo(q, table_lo[t, m], table_hi[t, m], table_p, table_togo)
            for u in range(min(span, t_end - t + 1)):
                best = min(best, floor_cost[t + u] - floor_cost[t] + out[t + u, m + 1])
            out[t, m] = best


@njit(cache=True, inline="always")
def row(p, n):  # type: ignore[no-untyped-def]
    """Return row n of (·, 6) as a tuple."""
    return (p[n, 0], p[n, 1], p[n, 2], p[n, 3], p[n, 4], p[n, 5])


@njit(cache=True, inline="always")
def product(form, p):  # type: ignore[no-untyped-def]
    """Return the inner product of two symmetric (6,)."""
    return (
        form[0] * p[0]
        + form[3] * p[3]
        + form[5] * p[5]
        + 2.0 * (form[1] * p[1] + form[2] * p[2] + form[4] * p[4])
    )


@njit(cache=True, inline="always")
def second_class(second, span):  # type: ignore[no-untyped-def]
    """Return the class 1…CLASSES − 1 of a second view that lasts `second` samples more."""
    if second <= 0:
        return 1
    return min(CLASSES - 1, 2 + (second - 1) * (CLASSES - 2) // span)


@njit(cache=True)
def put_pending(  # type: ignore[no-untyped-def]
    lead,
    slots,
    q,
    cost,
    near,
    pend_node,
    pend_cost,
    pend_near,
    pend_p,
    counter,
    node_togo,
    scratch_m,
    scratch_v,
):
    """Merge a label into one of the `slots` from `lead` on; return (slot, whether it was empty).

    The slot of nearest `near` is taken, or an empty one if none is within NEAR of it. Callers give
    the cost so far for `near`: labels of unlike cost are unlike in what they know of the heading
    (by nearness of P, 34 % of a gap was left where this leaves 3 %). Information still pending is
    the caller's to merge.
    """
    best, gap, empty = -1, np.inf, -1
    for s in range(lead, lead + slots):
        if pend_node[s] < 0:
            if empty < 0:
                empty = s
            continue
        d = abs(near - pend_near[s]) / pend_near[s] if pend_near[s] > 0.0 else 0.0
        if d < gap:
            best, gap = s, d
    if best < 0 or (gap > NEAR and empty >= 0):
        s = empty
        pend_node[s] = counter[NODES]
        node_togo[counter[NODES]] = np.inf
        counter[NODES] += 1
        pend_cost[s] = cost
        pend_near[s] = near
        for x in range(6):
            pend_p[s, x] = q[x]
        return s, True
    s = best
    p = row(pend_p, s)
    if not below(p, q, 1.0):
        low = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        for shrink in (0.99, 0.9, 0.7, 0.5, 0.25, 0.1, 0.01):
            if below(p, q, shrink):
                low = (
                    shrink * p[0],
                    shrink * p[1],
                    shrink * p[2],
                    shrink * p[3],
                    shrink * p[4],
                    shrink * p[5],
                )
                break
        r = meet(p, q, low, scratch_m, scratch_v)
        for x in range(6):
            pend_p[s, x] = r[x]
    pend_cost[s] = min(pend_cost[s], cost)
    return s, False


@njit(cache=True)
def forward(  # type: ignore[no-untyped-def]
    begin,
    end,
    k,
    w_tt,
    w_nn,
    limit,
    steps,
    base,
    move_ptr,
    move_blocks,
    move_at,
    move_family,
    families,
    span,
    threshold,
    width,
    epsilon,
    slack,
    coarse,
    coarse_width,
    slots,
    probing,
    near_form,
    floor_p,
    floor_cost,
    hope,
    table_lo,
    table_hi,
    table_p,
    table_togo,
    head,
    pool_next,
    pool_parent,
    pool_move,
    pool_float,
    pend_node,
    pend_cost,
    pend_near,
    pend_p,
    pend_second,
    pend_blocks,
    node_lo,
    node_hi,
    node_p,
    node_cost,
    node_togo,
    arc_from,
    arc_to,
    arc_move,
    arc_cost,
    bin_epsilon,
    reached,
    counter,
):
    """Sweep samples begin…end − 1; stop early with counter[FULL] set if storage runs out.

    pool_float (·, 9) holds cost, arc cost, rank, P of labels waiting for their sample; they hang
    in lists from head (t + 1, k + 1). pend_* hold the labels inside clusters, of this sample and
    of the next: slot
    ((((parity (k + 1) + m) (span + 1) + pending) families + family) CLASSES + class) slots + i.
    A label whose lateral variance exceeds `limit` after some sample's measurements is dropped;
    reached (k + 1,) tells with how many cameras the end was reached.
    """
    t_end = steps.shape[0]
    scratch_m, scratch_v = np.empty((3, 3)), np.empty((3, 3))
    most = width + 1
    kept_cost, kept_p = np.empty(most), np.empty((most, 6))
    own_cost, own_p, own_near, own_rank = (
        np.empty(most),
        np.empty((most, 6)),
        np.empty(most),
        np.empty(most),
    )
    rough_cost, rough_p = np.empty(most), np.empty((most, 6))
    rough_own_cost, rough_own_p = np.empty(most), np.empty((most, 6))
    rough_near, rough_rank = np.empty(most), np.empty(most)
    rough_of = np.empty(most, dtype=np.int64)
    n_most = 1024
    cost, rank, near = np.empty(n_most), np.empty(n_most), np.empty(n_most)
    p_in = np.empty((n_most, 6))
    assigned = np.empty(n_most, dtype=np.int64)
    for t in range(begin, end):
        parity = t % 2
        for m in range(k + 1):
            node_lo[t, m] = counter[NODES]
            node_hi[t, m] = counter[NODES]
            n = 1 if probing else 0
            e = head[t, m]
            while e >= 0:
                n += 1
                e = pool_next[e]
            pending_most = (
                families * CLASSES * (span + 1) * slots * (2 + move_at[t + 1] - move_at[t])
            )
            if counter[ARCS] + n + 2 * width + pending_most >= arc_from.size or (
                counter[NODES] + 2 * width + pending_most >= node_cost.size
            ):
                counter[FULL] = 1
                return
            if n > n_most:
                n_most = 2 * n
                cost, rank, near = np.empty(n_most), np.empty(n_most), np.empty(n_most)
                p_in = np.empty((n_most, 6))
                assigned = np.empty(n_most, dtype=np.int64)
            e = head[t, m]
            n = 0
            while e >= 0:
                cost[n] = pool_float[e, 0]
                rank[n] = pool_float[e, 2]
                for x in range(6):
                    p_in[n, x] = pool_float[e, 3 + x]
                e = pool_next[e]
                n += 1
            arrived = n
            if probing:
                cost[n], rank[n] = 0.0, 0.0
                for x in range(6):
                    p_in[n, x] = floor_p[t, x]
                n += 1
            kept, rough = 0, 0
            first, lead = counter[NODES], counter[NODES]
            if n > 0:
                for a in range(n):
                    near[a] = product(near_form[t], p_in[a])
                    if table_p.shape[0] == 0:
                        rank[a] = cost[a] + near[a]
                kept, used, merges = thin(
                    n,
                    cost,
                    p_in,
                    rank,
                    near,
                    width,
                    max(epsilon, bin_epsilon[m] / 2.25),
                    slack,
                    probing,
                    assigned,
                    kept_cost,
                    kept_p,
                    own_cost,
                    own_p,
                    own_near,
                    own_rank,
                    scratch_m,
                    scratch_v,
                )
                bin_epsilon[m] = used
                counter[MERGES] += merges
                for b in range(kept):
                    node_cost[first + b] = kept_cost[b]
                    node_togo[first + b] = np.inf
                    for x in range(6):
                        node_p[first + b, x] = kept_p[b, x]
                node_hi[t, m] = first + kept
                counter[NODES] += kept
                # what led here, and give the pool back
                e = head[t, m]
                for a in range(arrived):
                    c = counter[ARCS]
                    arc_from[c] = pool_parent[e]
                    arc_to[c] = first + assigned[a]
                    arc_move[c] = pool_move[e]
                    arc_cost[c] = pool_float[e, 1]
                    counter[ARCS] += 1
                    following = pool_next[e]
                    pool_next[e] = counter[FREE]
                    counter[FREE] = e
                    e = following
                head[t, m] = -1
                # clusters start from labels merged once more: they are rarely any good
                if k - m > 1 and move_at[t + 1] > move_at[t]:
                    rough, _, merges = thin(
                        kept,
                        kept_cost,
                        kept_p,
                        own_rank,
                        own_near,
                        min(width, coarse_width),
                        coarse,
                        0.0,
                        probing,
                        rough_of,
                        rough_cost,
                        rough_p,
                        rough_own_cost,
                        rough_own_p,
                        rough_near,
                        rough_rank,
                        scratch_m,
                        scratch_v,
                    )
                    lead = counter[NODES]
                    for b in range(rough):
                        node_togo[lead + b] = np.inf
                    counter[NODES] += rough
                    for b in range(kept):
                        c = counter[ARCS]
                        arc_from[c], arc_to[c], arc_move[c], arc_cost[c] = (
                            first + b,
                            lead + rough_of[b],
                            -1,
                            0.0,
                        )
                        counter[ARCS] += 1
            # alone: wait, or one camera from its first sample to its last
            for g in range(kept):
                parent = first + g
                stop_move = move_at[t + 1] if m < k else move_at[t]
                for v in range(move_at[t] - 1, stop_move):
                    waiting = v < move_at[t]
                    q = row(node_p, parent)
                    paid = 0.0
                    stop = t + 1 if waiting else t + move_ptr[v + 1] - move_ptr[v]
                    e = -1 if waiting else move_ptr[v]
                    for s in range(t, stop):
                        j0, j1, j2 = base[s, 0], base[s, 1], base[s, 2]
                        if not waiting:
                            j0 += move_blocks[e, 0]
                            j1 += move_blocks[e, 1]
                            j2 += move_blocks[e, 2]
                            e += 1
                        u0, u1, u2, u3, u4, u5, _ = update(q, j0, j1, j2)
                        paid += w_tt * u0 + w_nn * u3
                        if u3 > limit:
                            paid = np.inf
                            break
                        q = (u0, u1, u2, u3, u4, u5)
                        if s + 1 < t_end:
                            q = predict(q, steps[s + 1])
                    if paid == np.inf:
                        continue
                    deposit(
                        parent,
                        0.0 if probing else node_cost[parent],
                        paid,
                        q,
                        stop,
                        m if waiting else m + 1,
                        -1 if waiting else v,
                        threshold,
                        table_lo,
                        table_hi,
                        table_p,
                        table_togo,
                        head,
                        pool_next,
                        pool_parent,
                        pool_move,
                        pool_float,
                        node_togo,
                        reached,
                        counter,
                    )
            if counter[FULL]:
                return
            # clusters: begin one
            for g in range(rough):
                q = row(rough_p, g)
                for v in range(move_at[t], move_at[t + 1]):
                    length = move_ptr[v + 1] - move_ptr[v]
                    ahead = floor_cost[t + length] - floor_cost[t]
                    least = np.inf
                    for u in range(min(span, t_end - t - length + 1)):
                        here = (
                            floor_cost[t + length + u]
                            - floor_cost[t + length]
                            + hope[t + length + u, m + 2]
                        )
                        least = min(least, here)
                    if rough_cost[g] + ahead + least > threshold:
                        node_togo[lead + g] = min(node_togo[lead + g], ahead + least)
                        continue
                    s0 = (
                        (((parity * (k + 1) + m + 1) * (span + 1) + length) * families)
                        + move_family[v]
                    ) * (CLASSES * slots)
                    s, fresh = put_pending(
                        s0,
                        slots,
                        q,
                        rough_cost[g],
                        rough_cost[g],
                        pend_node,
                        pend_cost,
                        pend_near,
                        pend_p,
                        counter,
                        node_togo,
                        scratch_m,
                        scratch_v,
                    )
                    for x in range(length):
                        e = move_ptr[v] + x
                        merge_block(
                            pend_blocks[s, x],
                            move_blocks[e, 0],
                            move_blocks[e, 1],
                            move_blocks[e, 2],
                            fresh,
                        )
                    pend_second[s] = 0
                    c = counter[ARCS]
                    arc_from[c], arc_to[c], arc_move[c], arc_cost[c] = (
                        lead + g,
                        pend_node[s],
                        v,
                        0.0,
                    )
                    counter[ARCS] += 1
            # clusters: one camera more, or on to the next sample
            if m == 0:
                continue
            for length in range(1, span + 1):
                for key in range(families * CLASSES):
                    family, several = key // CLASSES, key % CLASSES
                    s0 = (
                        (((parity * (k + 1) + m) * (span + 1) + length) * families + family)
                        * CLASSES
                        + several
                    ) * slots
                    for s in range(s0, s0 + slots):
                        parent = pend_node[s]
                        if parent < 0:
                            continue
                        pend_node[s] = -1
                        p = row(pend_p, s)
                        c_here = 0.0 if probing else pend_cost[s]
                        for v in range(move_at[t], move_at[t + 1] if m < k else move_at[t]):
                            own = move_ptr[v + 1] - move_ptr[v]
                            total = max(own, length)
                            ahead = floor_cost[t + total] - floor_cost[t] + hope[t + total, m + 1]
                            if c_here + ahead > threshold:
                                node_togo[parent] = min(node_togo[parent], ahead)
                                continue
                            second = max(min(own, length), pend_second[s])
                            kind = second_class(second, span)
                            longest = move_family[v] if own >= length else family
                            r0 = (
                                (((parity * (k + 1) + m + 1) * (span + 1) + total) * families)
                                * CLASSES
                                + longest * CLASSES
                                + kind
                            ) * slots
                            r, fresh = put_pending(
                                r0,
                                slots,
                                p,
                                c_here,
                                c_here,
                                pend_node,
                                pend_cost,
                                pend_near,
                                pend_p,
                                counter,
                                node_togo,
                                scratch_m,
                                scratch_v,
                            )
                            for x in range(total):
                                j0, j1, j2 = 0.0, 0.0, 0.0
                                if x < length:
                                    j0, j1, j2 = (
                                        pend_blocks[s, x, 0],
                                        pend_blocks[s, x, 1],
                                        pend_blocks[s, x, 2],
                                    )
                                if x < own:
                                    e = move_ptr[v] + x
                                    j0, j1, j2 = (
                                        j0 + move_blocks[e, 0],
                                        j1 + move_blocks[e, 1],
                                        j2 + move_blocks[e, 2],
                                    )
                                merge_block(pend_blocks[r, x], j0, j1, j2, fresh)
                            pend_second[r] = second if fresh else max(second, pend_second[r])
                            c = counter[ARCS]
                            arc_from[c], arc_to[c], arc_move[c], arc_cost[c] = (
                                parent,
                                pend_node[r],
                                v,
                                0.0,
                            )
                            counter[ARCS] += 1
                        if several == 0 and (length == 1 or m == k):
                            continue  # a cluster of one: its own path has it
                        j = pend_blocks[s, 0]
                        u0, u1, u2, u3, u4, u5, _ = update(
                            p, base[t, 0] + j[0], base[t, 1] + j[1], base[t, 2] + j[2]
                        )
                        paid = w_tt * u0 + w_nn * u3
                        if u3 > limit:
                            continue
                        q = (u0, u1, u2, u3, u4, u5)
                        if t + 1 < t_end:
                            q = predict(q, steps[t + 1])
                        if length == 1 or t + 1 == t_end:
                            deposit(
                                parent,
                                c_here,
                                paid,
                                q,
                                t + 1,
                                m,
                                -1,
                                threshold,
                                table_lo,
                                table_hi,
                                table_p,
                                table_togo,
                                head,
                                pool_next,
                                pool_parent,
                                pool_move,
                                pool_float,
                                node_togo,
                                reached,
                                counter,
                            )
                            if counter[FULL]:
                                return
                            continue
                        later = t + length
                        ahead = floor_cost[later] - floor_cost[t + 1]
                        if several:
                            ahead += hope[later, m]
                        else:
                            least = np.inf
                            for u in range(min(span, t_end - later + 1)):
                                least = min(
                                    least,
                                    floor_cost[later + u]
                                    - floor_cost[later]
                                    + hope[later + u, m + 1],
                                )
                            ahead += least
                        if c_here + paid + ahead > threshold:
                            node_togo[parent] = min(node_togo[parent], paid + ahead)
                            continue
                        second = max(0, pend_second[s] - 1)
                        kind = second_class(second, span) if several else 0
                        r0 = (
                            ((((1 - parity) * (k + 1) + m) * (span + 1) + length - 1) * families)
                            * CLASSES
                            + family * CLASSES
                            + kind
                        ) * slots
                        r, fresh = put_pending(
                            r0,
                            slots,
                            q,
                            c_here + paid,
                            c_here + paid,
                            pend_node,
                            pend_cost,
                            pend_near,
                            pend_p,
                            counter,
                            node_togo,
                            scratch_m,
                            scratch_v,
                        )
                        for x in range(length - 1):
                            merge_block(
                                pend_blocks[r, x],
                                pend_blocks[s, x + 1, 0],
                                pend_blocks[s, x + 1, 1],
                                pend_blocks[s, x + 1, 2],
                                fresh,
                            )
                        pend_second[r] = second if fresh else max(second, pend_second[r])
                        c = counter[ARCS]
                        arc_from[c], arc_to[c], arc_move[c], arc_cost[c] = (
                            parent,
                            pend_node[r],
                            -1,
                            paid,
                        )
                        counter[ARCS] += 1


@njit(cache=True, inline="always")
def merge_block(block, j0, j1, j2, fresh):  # type: ignore[no-untyped-def]
    """Set `block` (3,) to J, or to the Loewner join with it unless `fresh`."""
    if fresh:
        block[0], block[1], block[2] = j0, j1, j2
    else:
        block[0], block[1], block[2] = block_join(block[0], block[1], block[2], j0, j1, j2)


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
    pool_next,
    pool_parent,
    pool_move,
    pool_float,
    node_togo,
    reached,
    counter,
):
    """Leave a label with nothing pending for sample `at`, unless the table says it is no good."""
    if at == table_lo.shape[0] - 1:
        node_togo[parent] = min(node_togo[parent], paid)
        reached[m] = True
        return
    togo = least_togo(q, table_lo[at, m], table_hi[at, m], table_p, table_togo)
    if cost + paid + togo > threshold:
        counter[PRUNED] += 1
        node_togo[parent] = min(node_togo[parent], paid + togo)
        return
    x = counter[FREE]
    if x >= 0:
        counter[FREE] = pool_next[x]
    else:
        x = counter[POOL]
        if x >= pool_next.size:
            counter[FULL] = 2
            return
        counter[POOL] += 1
    pool_parent[x] = parent
    pool_move[x] = move
    pool_float[x, 0] = cost + paid
    pool_float[x, 1] = paid
    pool_float[x, 2] = cost + paid + togo
    for z in range(6):
        pool_float[x, 3 + z] = q[z]
    pool_next[x] = head[at, m]
    head[at, m] = x


@njit(cache=True)
def backward(arcs, arc_from, arc_to, arc_cost, node_togo, best_arc):  # type: ignore[no-untyped-def]
    """Complete `node_togo`; best_arc is the arc that gives it, −1 for the end or the table.

    Arcs into a label were recorded before those that leave it.
    """
    for a in range(arcs - 1, -1, -1):
        c = arc_cost[a] + node_togo[arc_to[a]]
        if arc_from[a] >= 0 and c < node_togo[arc_from[a]]:
            node_togo[arc_from[a]] = c
            best_arc[arc_from[a]] = a
