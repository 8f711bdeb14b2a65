"""Climb a design's concave relaxation by exchanges of weight, each a rank-one update.

    max f(B + Σ x_i F_i F_iᵀ) − price·x   over  0 ≤ x ≤ 1, Σ x ≤ m, at most one of each group

with f = log det or f = −tr(·⁻¹). The polytope's edges are e_i − e_j, e_i and −e_j, so moving weight
from the candidate worth least to the one worth most ends at the optimum (Böhning 1986 for
D-optimal designs). The matrix Θ = M⁻¹ and every slope follow by Sherman and Morrison's formula, in
O(n c): a step costs about a microsecond for a hundred candidates of ten dimensions. Rounding that
gathers on the way does no harm: `placement.branch.certify` starts anew from x.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.branch.small import times

LOG_DET, TRACE_INVERSE = 0, 1
_EDGE = 1e-12  # weight this near 0 or 1 is there
_SINGULAR = 1e-9  # an update that would leave less than this share of a direction is not made


@njit(cache=True)
def climb(kind, theta, slope, G, r, x, m, group, distinct, price, steps, tolerance):  # type: ignore[no-untyped-def]
    """Make up to `steps` exchanges in place on x (p,), Θ (d, d) and slope (p,).

    G (d, p·r) holds the candidates' columns side by side, `group` (p,) their groups 0…p − 1
    (`distinct`: no two share one). Stops where no exchange gains more than `tolerance` per unit.
    Return the number of exchanges made.
    """
    p = x.size
    held = np.zeros(p)
    up, down = np.empty(p, np.int64), np.empty(p, np.int64)
    total = 0.0
    for a in range(p):
        held[group[a]] += x[a]
        total += x[a]
    for step in range(steps):
        into, out = -1, -1
        best_in, best_out = -np.inf, np.inf
        if distinct:
            for a in range(p):
                worth = slope[a] - price[a]
                if worth > best_in and x[a] < 1.0 - _EDGE:
                    best_in, into = worth, a
                if worth < best_out and x[a] > _EDGE:
                    best_out, out = worth, a
            i, j = into, out
        else:
            i, j, into, out = _grouped_pair(slope, price, x, group, held, up, down)
            best_in = slope[into] - price[into] if into >= 0 else -np.inf
            best_out = slope[out] - price[out] if out >= 0 else np.inf
        gain = -np.inf
        if i >= 0 and j >= 0:
            gain = slope[i] - price[i] - slope[j] + price[j]
        if into >= 0 and total < m - _EDGE and best_in > gain:
            i, j, gain = into, -1, best_in
        if out >= 0 and -best_out > gain:
            i, j, gain = -1, out, -best_out
        if not gain > tolerance:
            return step
        most = 1.0
        if i >= 0:
            room = 1.0 - held[group[i]]
            if j >= 0 and group[i] == group[j]:
                room += x[j]
            most = min(1.0 - x[i], room)
            if j < 0:
                most = min(most, m - total)
        if j >= 0:
            most = min(most, x[j])
        size = _step_size(kind, theta, slope, G, r, i, j, gain, most)
        if not _move(kind, theta, slope, G, r, i, j, size):
            return step
        if kind == TRACE_INVERSE or r > 1:  # the size was a model's: halve it while it overshoots
            for _ in range(6):
                after = 0.0
                if i >= 0:
                    after += slope[i] - price[i]
                if j >= 0:
                    after -= slope[j] - price[j]
                if after >= -0.9 * gain:
                    break
                if not _move(kind, theta, slope, G, r, i, j, -0.5 * size):
                    return step
                size *= 0.5
        if i >= 0:
            x[i] = min(1.0, x[i] + size)
            held[group[i]] += size
            total += size
        if j >= 0:
            x[j] = x[j] - size if x[j] - size > _EDGE else 0.0
            held[group[j]] -= size
            total -= size
    return steps


@njit(cache=True)
def slopes_of(kind, theta, G, r, slope):  # type: ignore[no-untyped-def]
    """Write the derivative of f by each weight: tr FᵀΘF, or tr FᵀΘ²F for −tr M⁻¹."""
    d, columns = G.shape
    for i in range(slope.size):
        slope[i] = 0.0
    product = times(theta, G)
    for a in range(d):
        for k in range(columns):
            if kind == LOG_DET:
                slope[k // r] += product[a, k] * G[a, k]
            else:
                slope[k // r] += product[a, k] * product[a, k]


@njit(cache=True)
def _grouped_pair(slope, price, x, group, held, up, down):  # type: ignore[no-untyped-def]
    """Return the best pair to exchange, the best to gain weight, and the best to lose it."""
    p = x.size
    for g in range(p):
        up[g], down[g] = -1, -1
    into, out = -1, -1
    for a in range(p):
        g, worth = group[a], slope[a] - price[a]
        if x[a] < 1.0 - _EDGE:
            if up[g] < 0 or worth > slope[up[g]] - price[up[g]]:
                up[g] = a
            if held[g] < 1.0 - _EDGE and (into < 0 or worth > slope[into] - price[into]):
                into = a
        if x[a] > _EDGE:
            if down[g] < 0 or worth < slope[down[g]] - price[down[g]]:
                down[g] = a
            if out < 0 or worth < slope[out] - price[out]:
                out = a
    i, j = into, out
    best = -np.inf
    if i >= 0 and j >= 0:
        best = slope[i] - price[i] - slope[j] + price[j]
    for g in range(p):
        if up[g] >= 0 and down[g] >= 0:
            gain = slope[up[g]] - price[up[g]] - slope[down[g]] + price[down[g]]
            if gain > best:
                best, i, j = gain, up[g], down[g]
    return i, j, into, out


@njit(cache=True)
def _step_size(kind, theta, slope, G, r, i, j, gain, most):  # type: ignore[no-untyped-def]
    """Return how much weight to move: exact for log det of rank one, else a damped Newton step."""
    d = theta.shape[0]
    if kind == LOG_DET and r == 1 and i >= 0 and j >= 0 and gain == slope[i] - slope[j]:
        cross = 0.0
        for a in range(d):
            row = 0.0
            for b in range(d):
                row += theta[a, b] * G[b, j]
            cross += row * G[a, i]
        bend = 2.0 * (slope[i] * slope[j] - cross * cross)
        return most if bend * most <= gain else gain / bend
    curvature = 0.0
    if i >= 0:
        curvature += _bend(kind, theta, G, r, i, i)
    if j >= 0:
        curvature += _bend(kind, theta, G, r, j, j)
    if i >= 0 and j >= 0:
        curvature -= 2.0 * _bend(kind, theta, G, r, i, j)
    if not curvature > 0.0:
        return most
    size = gain / curvature
    if kind == LOG_DET:  # self-concordant: this step never overshoots the domain
        size /= 1.0 + gain / np.sqrt(curvature)
    return min(size, most)


@njit(cache=True)
def _bend(kind, theta, G, r, i, j):  # type: ignore[no-untyped-def]
    """Return −∂²f / ∂x_i ∂x_j."""
    d = theta.shape[0]
    pulled, twice = np.zeros((r, d)), np.zeros((r, d))  # Θ F_i, Θ² F_i, by rows
    for k in range(r):
        for a in range(d):
            for b in range(d):
                pulled[k, a] += theta[a, b] * G[b, i * r + k]
    if kind != LOG_DET:
        for k in range(r):
            for a in range(d):
                for b in range(d):
                    twice[k, a] += theta[a, b] * pulled[k, b]
    total = 0.0
    for k in range(r):
        for l in range(j * r, (j + 1) * r):  # noqa: E741
            first, second = 0.0, 0.0
            for a in range(d):
                first += pulled[k, a] * G[a, l]
                second += twice[k, a] * G[a, l]
            total += first * first if kind == LOG_DET else 2.0 * first * second
    return total


@njit(cache=True)
def _move(kind, theta, slope, G, r, i, j, size):  # type: ignore[no-untyped-def]
    """Add `size` to candidate i and take it from candidate j (−1: nobody); False if singular."""
    if i >= 0:
        for k in range(i * r, (i + 1) * r):
            if not _rank_one(kind, theta, slope, G, r, k, size):
                return False
    if j >= 0:
        for k in range(j * r, (j + 1) * r):
            if not _rank_one(kind, theta, slope, G, r, k, -size):
                return False
    return True


@njit(cache=True, fastmath=True)
def _rank_one(kind, theta, slope, G, r, k, size):  # type: ignore[no-untyped-def]
    """Follow M → M + size·g gᵀ, g the k-th column of G, in Θ and the slopes."""
    d, columns = G.shape
    u, v = np.zeros(d), np.zeros(d)
    for a in range(d):
        for b in range(d):
            u[a] += theta[a, b] * G[b, k]
    scale, length = 1.0, 0.0
    for a in range(d):
        scale += size * u[a] * G[a, k]
        length += u[a] * u[a]
    if scale < _SINGULAR:
        return False
    beta = size / scale
    w = np.zeros(columns)
    for a in range(d):
        for l in range(columns):  # noqa: E741
            w[l] += u[a] * G[a, l]
    if kind == LOG_DET:
        if r == 1:
            for l in range(columns):  # noqa: E741
                slope[l] -= beta * w[l] * w[l]
        else:
            for l in range(columns):  # noqa: E741
                slope[l // r] -= beta * w[l] * w[l]
    else:
        z = np.zeros(columns)
        for a in range(d):
            for b in range(d):
                v[a] += theta[a, b] * u[b]
        for a in range(d):
            for l in range(columns):  # noqa: E741
                z[l] += v[a] * G[a, l]
        for l in range(columns):  # noqa: E741
            slope[l // r] += beta * w[l] * (beta * length * w[l] - 2.0 * z[l])
    for a in range(d):
        for b in range(d):
            theta[a, b] -= beta * u[a] * u[b]
    return True
