"""Turn any fractional choice into a bound that no design beats, whatever the climb got wrong.

Three bounds, of S = T ∪ R with T fixed and R of the free candidates, B = K Kᵀ the information of
the prior and T, and *any* lower triangular W, used as W = chol(M)⁻¹ with M the information at x:

natural     log det(B + Σ_R F Fᵀ) ≤ −2 Σ log W_aa + n log((‖W K‖² + Σ_R ‖W F‖²) / n)
projected   where R completes T to exactly n columns: with U the complement of T's span, G = Uᵀ F,
            h_i what F_i tells about T's own span, τ ≥ λ_max(WᵀW), whitened so that Λ = I,
            log det(I_q + F_Rᵀ B⁻¹ F_R) ≤ −2 Σ log W_aa + Σ_R log det(‖W G‖² + τ (1 + h) I_r)
trace       tr M_S⁻¹ ≥ (tr Y)² / (‖Y K‖² + Σ_R ‖Y F‖²),  Y symmetric, used as WᵀW

The first is the inequality of arithmetic and geometric means, the second Poincaré's separation
theorem and Fischer's inequality (the Γ-bound of Nikolov 2015, and Ponte, Fampa & Lee 2025, with
their logarithms kept), the third Cauchy and Schwarz. All fall as one sum over R falls, so the best
sum over the placements of a node bounds the node, and what a sum loses by holding or leaving a
candidate fixes variables (convex duality). As W is what was computed, only ‖W F‖² is rounded.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.branch.climb import LOG_DET
from placement.branch.small import descending, eliminate, sum_squares, times

EPS = 2.220446049250313e-16


@njit(cache=True)
def squares(W, G, r, out):  # type: ignore[no-untyped-def]
    """Write ‖W F_i‖² of every candidate, and what rounding may have taken from it.

    |fl(W f) − W f| ≤ γ |W||f| (Higham 2002, 3.12), γ = (d + 2) ε; the square is off by twice that.
    """
    d, columns = G.shape
    norm = np.sqrt(sum_squares(W))
    product = times(W, G)
    slack = 3.0 * (d + 3) * EPS
    for i in range(out.size):
        out[i] = 0.0
    for k in range(columns):
        mine, length = 0.0, 0.0
        for a in range(d):
            mine += product[a, k] * product[a, k]
            length += G[a, k] * G[a, k]
        out[k // r] += mine + slack * (mine + np.sqrt(mine * length) * norm)


@njit(cache=True)
def total_square(W, G):  # type: ignore[no-untyped-def]
    """Return ‖W G‖², rounding allowed for as in `squares`."""
    each = np.empty(G.shape[1])
    squares(W, G, 1, each)
    total = 0.0
    for k in range(each.size):
        total += each[k]
    return total


@njit(cache=True)
def log_blocks(W, G, r, ridge, out):  # type: ignore[no-untyped-def]
    """Write log det(G_iᵀ WᵀW G_i + ridge_i I_r) of every candidate, rounding allowed for."""
    d = W.shape[0]
    product = times(W, G)
    norm = np.sqrt(sum_squares(W))
    slack = 3.0 * (d + 3) * EPS
    block, nothing = np.zeros((r, r)), np.zeros((r, 0))
    for i in range(out.size):
        length, mine = 0.0, 0.0
        for a in range(d):
            for k in range(i * r, (i + 1) * r):
                length += G[a, k] * G[a, k]
                mine += product[a, k] * product[a, k]
        more = ridge[i] + slack * (mine + np.sqrt(mine * length) * norm)
        for k in range(r):
            for l in range(r):  # noqa: E741
                total = more if k == l else 0.0
                for a in range(d):
                    total += product[a, i * r + k] * product[a, i * r + l]
                block[k, l] = total
        if r == 1:
            out[i] = np.log(block[0, 0])
        else:
            out[i] = eliminate(block, nothing)


@njit(cache=True)
def best_sum(worth, group, distinct, m, whole, leave, hold, taken):  # type: ignore[no-untyped-def]
    """Return the greatest Σ worth over at most m candidates, one of each group at most.

    `whole`: exactly m, else only what is worth more than nothing. Writes `taken` (p,); `hold` (p,),
    what the best sum loses if it must hold a candidate; `leave` (p,), if it must do without it.
    −∞ where `whole` cannot be had.
    """
    p = worth.size
    order = descending(worth)
    for i in range(p):
        taken[i] = False
    winner = np.full(p, -1, np.int64)  # of each group, its best
    second = np.full(p, -np.inf)  # of each group, the worth of its second
    used = np.zeros(p, np.bool_)
    total, count, follows = 0.0, 0, -np.inf  # follows: worth of the best group that is not taken
    for at in range(p):
        i = order[at]
        g = i if distinct else group[i]
        if winner[g] < 0:
            winner[g] = i
            if count < m and (whole or worth[i] > 0.0):
                taken[i], used[g] = True, True
                total += worth[i]
                count += 1
            elif follows == -np.inf:
                follows = worth[i]
        elif second[g] == -np.inf:
            second[g] = worth[i]
    if whole and count < m:
        return -np.inf
    least = 0.0
    if count == m:
        least = np.inf
        for i in range(p):
            if taken[i]:
                least = min(least, worth[i])
        if count == 0:
            least = 0.0
    for i in range(p):
        g = i if distinct else group[i]
        if taken[i]:
            hold[i] = 0.0
            instead = max(follows, second[g])
            if not whole:
                instead = max(instead, 0.0)
            leave[i] = worth[i] - instead
        else:
            leave[i] = 0.0
            gone = worth[winner[g]] if used[g] else least
            hold[i] = gone - worth[i]
    return total


@njit(cache=True)
def upper(kind, projected, priced, n, constant, fixed, total):  # type: ignore[no-untyped-def]
    """Return the bound on the score that a best sum of `total` proves.

    `constant` is −2 Σ log W_aa (projected: and T's own log det; trace: tr Y), `fixed` the sum of
    squares of B. Under prices the concave functions give way to their tangents.
    """
    if total == -np.inf:
        return -np.inf
    if projected:
        return constant + total
    if kind == LOG_DET:
        if priced:
            return constant + fixed + total - n
        if fixed + total <= 0.0:
            return -np.inf
        return constant + n * np.log((fixed + total) / n)
    if priced:
        return -2.0 * constant + fixed + total
    return -constant * constant / (fixed + total)
