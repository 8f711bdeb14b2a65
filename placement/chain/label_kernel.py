"""The loop of `placement.chain.labels`, in Numba: nodes in order, labels in one flat array."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from models.geometry import BoolArray, FloatArray, IntArray
from placement.chain.first_order import NONE
from placement.chain.pairs import TINY, det

COMPARED = 24  # labels at a node, best first, that each further one is compared with
MOST_GROUPS = 64  # groups a label may bar; one with more dominates nothing


@numba.njit(cache=True)
def least_from(values: IntArray) -> IntArray:
    """Return the minimum of `values[i:]` for i = 0 … n, (n + 1,); 2⁶² of nothing."""
    n = len(values)
    least = np.empty(n + 1, np.int64)
    least[n] = 1 << 62
    for i in range(n - 1, -1, -1):
        least[i] = min(values[i], least[i + 1])
    return least


@numba.njit(cache=True, inline="always")
def excess(a: float, c: float, b: float, u: float, v: float, w: float) -> float:
    """Return log det(I + A + D) − log det(I + B), D the positive part of B − A; ≥ 0.

    A = [[a, c], [c, b]] and B = [[u, v], [v, w]]: how much more any further information can
    gain over B than over A.
    """
    p, q, r = u - a, v - c, w - b
    if p == r and q == 0.0:  # isotropic
        return float(np.log(det(a, c, b) / det(u, v, w))) if p < 0.0 else 0.0
    mean, half = 0.5 * (p + r), 0.5 * (p - r)
    radius = np.sqrt(half * half + q * q)
    high, low = mean + radius, mean - radius
    if low >= 0.0:
        return 0.0
    if high <= 0.0:
        return float(max(np.log(det(a, c, b) / det(u, v, w)), 0.0))
    # D = high · e eᵀ with e the eigenvector of `high`: (D_tt, D_tn, D_nn) by the projector.
    scale = high / (2.0 * radius)
    d_a, d_c, d_b = scale * (radius + half), scale * q, scale * (radius - half)
    return float(max(np.log(det(a + d_a, c + d_c, b + d_b) / det(u, v, w)), 0.0))


@numba.njit(cache=True)
def run_labels(
    indptr: IntArray,
    position: IntArray,
    block: FloatArray,
    weight: FloatArray,
    first: IntArray,
    last: IntArray,
    group: IntArray,
    mandatory: BoolArray,
    alone: FloatArray,
    out_of: IntArray,
    by_source: IntArray,
    target: NDArray[np.int32],
    gain: FloatArray,
    price: FloatArray,
    after_start: FloatArray,
    after_arc: FloatArray,
    B: FloatArray,
    beat: float,
    margin: float,
    improve: bool,
    width: int,
    node: NDArray[np.int32],
    parent: NDArray[np.int32],
    score: FloatArray,
) -> tuple[int, int, float]:
    """Fill the labels' node, parent and score; return (made, best, given_up).

    `improve` says that scores are exact, so that what is found must in turn be beaten.
    """
    n, budget, n_positions, n_prices = len(alone), B.shape[1] - 1, len(weight), len(price)
    room = len(node)
    count, following = np.empty(room, np.int32), np.empty(room, np.int32)
    bound = np.empty(room)
    made, best, best_score, given_up = 0, -1, NONE, NONE
    waiting = np.full(n, -1, np.int32)  # the labels at each node, as a linked list

    # How far back a label's cameras can matter: by what they see, or by the group they bar.
    n_groups = group.max() + 1 if n else 0
    group_last = np.full(n_groups, -1, np.int64)
    for j in range(n):
        group_last[group[j]] = j
    least_first = least_from(first)
    reach, bars = np.empty(n, np.int64), np.empty(n, np.int64)
    furthest, longest = -1, -1
    for j in range(n):
        furthest, longest = max(furthest, last[j]), max(longest, group_last[group[j]])
        reach[j], bars[j] = furthest, longest
    last_mandatory, low = -1, -1
    for j in range(n):
        if mandatory[j]:
            last_mandatory = j
    span = 1
    for j in range(n):
        span = max(span, reach[j] + 1 - least_first[j + 1])

    # clear_*[p, c]: the best label of c cameras of which nothing reaches position p or beyond, and
    # none bars a group that any node from here on belongs to. Labels wait for the latter.
    clear_score = np.full((n_positions + 2, budget + 1), NONE)
    clear_label = np.full((n_positions + 2, budget + 1), -1, np.int32)
    clear_score[:, 0] = 0.0
    released, release_next = np.full(n + 1, -1, np.int32), np.empty(room, np.int32)
    touched = np.empty(room, np.int32)

    dense = np.zeros((n_positions, 3))
    dense_det = np.ones(n_positions)
    kept_profile = np.empty((COMPARED, span, 3))
    kept_groups = np.empty((COMPARED, MOST_GROUPS), np.int64)
    kept_sizes, kept_labels = np.empty(COMPARED, np.int64), np.empty(COMPARED, np.int64)
    barred = np.full(n_groups, -1, np.int64)
    own_groups = np.empty(MOST_GROUPS, np.int64)
    arc_to = np.full(n, -1, np.int64)

    for j in range(n):
        label = released[j]
        while label >= 0:
            if node[label] >= low:  # else something required was passed since
                p, c = touched[label] + 1, count[label]
                while p < n_positions + 2 and clear_score[p, c] < score[label]:
                    clear_score[p, c] = score[label]
                    clear_label[p, c] = label
                    p += 1
            label = release_next[label]
        for c in range(budget):
            if clear_score[least_first[j], c] <= NONE / 2:
                continue
            value = clear_score[least_first[j], c] + alone[j]
            left = budget - c - 1
            more = B[j, left]
            for s in range(n_prices):
                more = min(more, after_start[j, s] + price[s] * left)
            if value + more <= beat:
                continue
            if made == room:
                return made, best, np.inf
            node[made], parent[made], count[made] = j, clear_label[least_first[j], c], c + 1
            score[made], bound[made], following[made] = value, value + more, waiting[j]
            waiting[j] = made
            made += 1
        if mandatory[j]:
            clear_score[:] = NONE
            low = j
        here = 0
        label = waiting[j]
        while label >= 0:
            here += 1
            label = following[label]
        if here == 0:
            continue
        queue = np.empty(here, np.int64)
        label = waiting[j]
        for k in range(here):
            queue[k] = label
            label = following[label]
        queue = queue[np.argsort(-bound[queue])]
        for k in range(out_of[j], out_of[j + 1]):
            arc_to[target[by_source[k]]] = by_source[k]
        # Cameras from `back` on can reach what lies ahead, or bar a group of it.
        ahead = least_first[j + 1]
        back = min(np.searchsorted(reach, ahead), np.searchsorted(bars, j, side="right"))
        kept, compared = 0, 0
        for k in range(here):
            label = queue[k]
            if bound[label] <= beat:
                break
            if kept == width:
                given_up = max(given_up, bound[label])
                break
            # What this label's cameras leave on the samples ahead.
            pending, barring, sizes = last[j], j, 0
            at = label
            while at >= 0 and node[at] >= back:
                i = node[at]
                barred[group[i]] = label
                barring = max(barring, group_last[group[i]])
                if group_last[group[i]] > j:
                    if sizes < MOST_GROUPS:
                        own_groups[sizes] = group[i]
                    sizes += 1
                pending = max(pending, last[i])
                for e in range(indptr[i + 1] - 1, indptr[i] - 1, -1):
                    p = position[e]
                    if p < ahead:
                        break
                    dense[p] += block[e]
                at = parent[at]
            dominated = False
            for other in range(compared):
                rival = kept_labels[other]
                room_left = score[rival] - score[label]
                if room_left < 0.0 or count[rival] > count[label]:
                    continue
                if kept_sizes[other] > MOST_GROUPS:
                    continue
                bars_more = False
                for s in range(kept_sizes[other]):
                    if barred[kept_groups[other, s]] != label:
                        bars_more = True
                        break
                if bars_more:
                    continue
                for p in range(ahead, reach[j] + 1):
                    a = kept_profile[other, p - ahead, 0]
                    c_ = kept_profile[other, p - ahead, 1]
                    b = kept_profile[other, p - ahead, 2]
                    room_left -= weight[p] * excess(a, c_, b, dense[p, 0], dense[p, 1], dense[p, 2])
                    if room_left < 0.0:
                        break
                if room_left >= 0.0:
                    dominated = True
                    break
            if not dominated:
                kept += 1
                if compared < COMPARED:
                    kept_labels[compared], kept_sizes[compared] = label, sizes
                    kept_groups[compared, : min(sizes, MOST_GROUPS)] = own_groups[
                        : min(sizes, MOST_GROUPS)
                    ]
                    for p in range(ahead, reach[j] + 1):
                        kept_profile[compared, p - ahead] = dense[p]
                    compared += 1
                if (
                    j >= last_mandatory
                    and score[label] > best_score
                    and score[label] > beat - margin
                ):
                    best, best_score = label, score[label]
                    if improve:
                        beat = max(beat, best_score + margin)
                c = count[label]
                left = budget - c - 1
                if left >= 0:
                    touched[label], release_next[label] = pending, released[barring + 1]
                    released[barring + 1] = label
                    for p in range(ahead, pending + 1):
                        dense_det[p] = det(dense[p, 0], dense[p, 1], dense[p, 2])
                    for then in range(j + 1, n):
                        if least_first[then] > pending and then > barring:
                            break  # from here on the label is clear: see above
                        arc = arc_to[then]
                        meets = first[then] <= last[j]
                        if barred[group[then]] != label and (arc >= 0 or not meets):
                            most = gain[arc] if arc >= 0 else alone[then]
                            more = B[then, left]
                            for s in range(n_prices):
                                rest = after_arc[arc, s] if arc >= 0 else after_start[then, s]
                                more = min(more, rest + price[s] * left)
                            if score[label] + most + more > beat:
                                value = score[label] + alone[then]
                                product, power = 1.0, 1.0
                                for e in range(indptr[then], indptr[then + 1]):
                                    p = position[e]
                                    if p > pending:
                                        break
                                    if dense_det[p] == 1.0:
                                        continue
                                    if weight[p] != power or product < TINY:
                                        value += power * np.log(product)
                                        product, power = 1.0, weight[p]
                                    product *= det(
                                        dense[p, 0] + block[e, 0],
                                        dense[p, 1] + block[e, 1],
                                        dense[p, 2] + block[e, 2],
                                    ) / (dense_det[p] * det(block[e, 0], block[e, 1], block[e, 2]))
                                value += power * np.log(product)
                                if value + more > beat:
                                    if made == room:
                                        return made, best, np.inf
                                    node[made], parent[made], count[made] = then, label, c + 1
                                    score[made], bound[made] = value, value + more
                                    following[made] = waiting[then]
                                    waiting[then] = made
                                    made += 1
                        if mandatory[then]:
                            break
                    dense_det[ahead : pending + 1] = 1.0
            dense[ahead : reach[j] + 1] = 0.0
        for k in range(out_of[j], out_of[j + 1]):
            arc_to[target[by_source[k]]] = -1
    return made, best, given_up
