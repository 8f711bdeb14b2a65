"""Labels that meet are replaced by Loewner lower bounds: free ones to a width, sets to few each."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.diagram.order import below, meet
from placement.fewest.arrays import (
    DEPTH,
    FINDING,
    KEY_BITS,
    LEAN,
    NO_CAMERA,
    PROBING,
    ZERO,
)
from placement.fewest.crossing import worth
from placement.fewest.graph import record
from placement.objectives.windows.filter import row6

WAITING = 4  # labels that wait, for each that comes from a camera
CLOSER = 0.02  # share of ε within which those that wait are merged


@njit(**LEAN)
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


@njit(**LEAN)
def exceeded(p, past, rank, failures, free_p, free_rank, n):  # type: ignore[no-untyped-def]
    """Return which of n cheaper free labels knows more, −1 for none: what it needs, this needs."""
    for b in range(n):
        if (
            free_rank[b] < rank
            and below(row6(free_p[b], 0), p, 1.0)
            and (failures == 0 or below(row6(free_p[b], 1), past, 1.0))
        ):
            return b
    return -1


@njit(cache=True)
def grown(free_p, free_rank, free_m, free_node, n, more):  # type: ignore[no-untyped-def]
    """Return the n free labels in arrays with room for `more`."""
    size = 2 * n + more
    new_p, new_rank = np.empty((size, 2, 6)), np.empty(size)
    new_m, new_node = np.empty(size, np.int64), np.empty(size, np.int64)
    new_p[:n], new_rank[:n] = free_p[:n], free_rank[:n]
    new_m[:n], new_node[:n] = free_m[:n], free_node[:n]
    return new_p, new_rank, new_m, new_node


@njit(cache=True)
def thin(  # type: ignore[no-untyped-def]
    n, p, rank, waited, width, epsilon, mode, failures, assigned, kept_p, own_p, kept_waited, mm, vv
):
    """Merge n labels (n, 2, 6); return how many are left, and the ε it took.

    At most `width` of those that come from a camera are left, and `WAITING` times as many of those
    that have `waited` (n,): they meet others at every sample, and what is lost adds up, so they
    are merged only where they differ by little. When probing, labels far below others stay apart
    from them; when finding, those that would be merged into others are left out, and assigned −1.
    """
    probing, finding = mode == PROBING, mode == FINDING
    order = np.argsort(rank[:n])
    while True:
        kept, fresh, fits = 0, 0, True
        near, nearer = 1.0 / (1.0 + epsilon), 1.0 / (1.0 + CLOSER * epsilon)
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
                assigned[a] = -1 if finding else found
                continue
            for b in range(kept):
                shrink = nearer if waited[a] or kept_waited[b] else near
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
            full = kept - fresh == WAITING * width if waited[a] else fresh == width
            if found < 0 and full:
                if epsilon < 1e5:
                    fits = False
                    break
                found = 0
            if found < 0:
                for x in range(6):
                    kept_p[kept, 0, x] = own_p[kept, 0, x] = q0[x]
                    kept_p[kept, 1, x] = own_p[kept, 1, x] = q1[x]
                assigned[a] = kept
                kept_waited[kept] = waited[a]
                fresh += not waited[a]
                kept += 1
                continue
            if finding:
                assigned[a] = -1
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


@njit(**LEAN)
def put_set(store, side, slot_of, slots, m, n, ids, flag, node, p, mode, scratch_m, scratch_v):  # type: ignore[no-untyped-def]
    """Put a label of a set on the next sample's list, merged with those of the same set.

    When finding, of two that would be merged the one that looks better stays. Return False where
    there is no room.
    """
    scenarios = p.shape[0]
    key = np.int64(2 if flag else 1)
    for a in range(DEPTH):
        key = (key << KEY_BITS) | (ids[a] + 1 if a < n else 0)
    mask = store.key.size - 1
    h = ((key + m) * np.int64(-7046029254386353131) >> 20) & mask
    while store.key[h] != 0 and (store.key[h] != key or store.key_m[h] != m):
        h = (h + 1) & mask
    fresh = store.key[h] == 0
    if fresh:
        store.key[h] = key
        store.key_m[h] = m
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
        for c in range(scenarios):
            for x in range(6):
                store.set_p[side, s, c, x] = p[c, x]
        store.set_next[s] = store.key_first[h]
        store.set_at[s] = h
        store.key_first[h] = s
        return True
    if mode == FINDING:
        own = store.set_p[side, best]
        if rank < worth(own[0]) + (worth(own[1]) if scenarios > 1 else 0.0):
            store.set_node[side, best], store.set_flag[side, best] = node, flag
            for c in range(scenarios):
                for x in range(6):
                    own[c, x] = p[c, x]
        return True
    for c in range(scenarios):
        if c >= 2 + n:
            break
        r = lower(row6(store.set_p[side, best], c), row6(p, c), scratch_m, scratch_v)
        for x in range(6):
            store.set_p[side, best, c, x] = r[x]
    record(store, node, store.set_node[side, best], ZERO, NO_CAMERA)
    return True


@njit(**LEAN)
def forget_keys(store, n):  # type: ignore[no-untyped-def]
    """Empty the table of n sets: place by place, as the whole of it is two megabytes."""
    if 8 * n > store.key.size:  # all of it, too, where a set found no room
        for h in range(store.key.size):
            store.key[h] = 0
    for s in range(n):
        store.key[store.set_at[s]] = 0
