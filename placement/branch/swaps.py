"""Designs bettered by swaps: every candidate's gain over the rest from one small inverse."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.branch.climb import LOG_DET
from placement.branch.small import eliminate, inverse_factor, log_diagonal, sum_squares

_MARGIN = 1e-11  # a swap must raise the score by this share of it, or two designs take turns


@njit(cache=True)
def score_of(kind, base, V, chosen, count):  # type: ignore[no-untyped-def]
    """Return log det M, or −tr M⁻¹, of M = base + Σ F Fᵀ over the first `count` of `chosen`."""
    M = information_of(base, V, chosen, count)
    W = np.empty_like(M)
    if not inverse_factor(M, W):
        return -np.inf
    if kind == LOG_DET:
        return -2.0 * log_diagonal(W)
    return -sum_squares(W)


@njit(cache=True)
def information_of(base, V, chosen, count):  # type: ignore[no-untyped-def]
    """Return base + Σ F Fᵀ; V (c, r, n) holds the candidates' columns."""
    n = base.shape[0]
    M = base.copy()
    for at in range(count):
        i = chosen[at]
        for k in range(V.shape[1]):
            for a in range(n):
                scaled = V[i, k, a]
                for b in range(n):
                    M[a, b] += scaled * V[i, k, b]
    return M


@njit(cache=True)
def gains_over(kind, W, V, out):  # type: ignore[no-untyped-def]
    """Write every candidate's gain (c,) over the design of which W = chol(M)⁻¹.

    log det(I + FᵀΘF), or tr((I + FᵀΘF)⁻¹ FᵀΘ²F).
    """
    c, r, n = V.shape
    half, pulled = np.empty((r, n)), np.empty((r, n))
    block, right = np.empty((r, r)), np.empty((r, r))
    for i in range(c):
        out[i] = gain_over(kind, W, V, i, half, pulled, block, right)


@njit(cache=True)
def gain_over(kind, W, V, i, half, pulled, block, right):  # type: ignore[no-untyped-def]
    """Return candidate i's gain; leaves W F in `half` (r, n), by rows."""
    r, n = half.shape
    for k in range(r):
        for a in range(n):
            total = 0.0
            for b in range(a + 1):
                total += W[a, b] * V[i, k, b]
            half[k, a] = total
    for k in range(r):
        for l in range(k + 1):  # noqa: E741
            total = 1.0 if k == l else 0.0
            for a in range(n):
                total += half[k, a] * half[l, a]
            block[k, l] = block[l, k] = total
    for k in range(r):
        for l in range(r):  # noqa: E741
            right[k, l] = 0.0
    if kind == LOG_DET:
        return np.log(block[0, 0]) if r == 1 else eliminate(block, right)
    for k in range(r):
        for b in range(n):
            total = 0.0
            for a in range(b, n):
                total += half[k, a] * W[a, b]
            pulled[k, b] = total
    for k in range(r):
        for l in range(r):  # noqa: E741
            for a in range(n):
                right[k, l] += pulled[k, a] * pulled[l, a]
    eliminate(block, right)
    total = 0.0
    for k in range(r):
        total += right[k, k]
    return total


@njit(cache=True)
def better_by_swaps(kind, base, V, group, cost, purse, keep, k, chosen, rounds):  # type: ignore[no-untyped-def]
    """Swap and add in place while that helps; return (count, score).

    `chosen` (≥ k,) begins with the design; `group` is −1 for none; `keep` (c,) marks candidates
    that stay. Each sweep tries every member once and takes the best replacement.
    """
    c, n = V.shape[0], V.shape[2]
    inside = np.zeros(c, np.bool_)
    count = 0
    while count < chosen.size and chosen[count] >= 0:
        inside[chosen[count]] = True
        count += 1
    score = score_of(kind, base, V, chosen, count)
    W, gains = np.empty((n, n)), np.empty(c)
    for _ in range(rounds):
        moved = False
        for at in range(count + 1):
            adding = at == count
            if adding and count >= k:
                break
            leaving = -1 if adding else chosen[at]
            if not adding and keep[leaving]:
                continue
            rest = np.empty(count, np.int64)
            size, spent = 0, 0.0
            for b in range(count):
                if b != at:
                    rest[size] = chosen[b]
                    size += 1
                    spent += cost[chosen[b]]
            if not inverse_factor(information_of(base, V, rest, size), W):
                continue
            gains_over(kind, W, V, gains)
            best = -1
            for i in range(c):
                if inside[i] or spent + cost[i] > purse:
                    continue
                if best >= 0 and gains[i] <= gains[best]:
                    continue
                fits = True
                if group[i] >= 0:
                    for b in range(size):
                        if group[rest[b]] == group[i]:
                            fits = False
                            break
                if fits:
                    best = i
            if best < 0:
                continue
            if not adding and gains[best] <= gains[leaving]:
                continue
            chosen[at] = best
            tried = score_of(kind, base, V, chosen, count + 1 if adding else count)
            if tried > score + _MARGIN * abs(score):
                score = tried
                inside[best] = True
                if adding:
                    count += 1
                else:
                    inside[leaving] = False
                moved = True
            else:
                chosen[at] = leaving
        if not moved:
            break
    return count, score
