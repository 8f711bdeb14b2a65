"""What cameras before another tell of the car's state, and what those after it could tell.

Given z_j, let x be the state at some sample, R Rᵀ its covariance, x̂ = R⁻¹ x. A camera before leaves
x̂ with I − E, one after it would leave it with I − K. Where x parts them, the second loses to the
first

    I(z_i; z_k | z_j) = −log det(I − E K),

as log det(I + S Δ) is what the second tells if it finds x̂ with covariance S, with K = Δ (I + Δ)⁻¹.
So six numbers of each camera, before or after j, say what all pairs of them share; one at a time
by `placement.sieve.shared`. At `early`, E is of cameras that end before, exactly; at `beyond`, of
near ones' features.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import FloatArray
from placement.objectives.windows.filter import put6, row6
from placement.sieve.features import RANK, carry_columns, factor, prior_matrix, solve_row
from placement.sieve.given import invert
from placement.tempered.crossings import after
from placement.tempered.process import predict_ahead, prior_at

LEAST_LEFT = 1e-10  # of a variance, or its difference is rounding
HAIR = 1e-9  # of what is known of a state, in case of rounding


class Told(NamedTuple):
    """What is told of the states around each of n cameras, along m arcs; nothing to begin with."""

    # (m, 6) E by target: of far cameras at `early`, from where passes move it, else at `beyond`
    before: NDArray[np.float32]
    after: NDArray[np.float32]  # (m, 6) K by source: at `early` of cameras ahead, else at `beyond`
    link: FloatArray  # (n, 3, 3) Â: E at `early` is Â E Âᵀ at `beyond`


def nothing_told(n: int, m: int) -> Told:
    """Return that nobody tells anything."""
    return Told(
        np.zeros((m, 6), dtype=np.float32),
        np.zeros((m, 6), dtype=np.float32),
        np.zeros((n, 3, 3)),
    )


@njit(cache=True)
def lower_factor(m, most):  # type: ignore[no-untyped-def]
    """Replace `m` (3, 3) by its Cholesky factor; return whether it is positive enough for one.

    `most` (3,) are the variances that it is a difference of.
    """
    for a in range(3):
        for b in range(a + 1):
            s = m[a, b]
            for q in range(b):
                s -= m[a, q] * m[b, q]
            if a == b:
                if not s > LEAST_LEFT * most[a]:
                    return False
                m[a, a] = s**0.5
            else:
                m[a, b] = s / m[b, b]
        for b in range(a + 1, 3):
            m[a, b] = 0.0
    return True


@njit(cache=True)
def solve_columns(root, m):  # type: ignore[no-untyped-def]
    """Replace `m` (3, c) by R⁻¹ m, R a Cholesky factor."""
    for c in range(m.shape[1]):
        for x in range(3):
            s = m[x, c]
            for q in range(x):
                s -= root[x, q] * m[q, c]
            m[x, c] = s / root[x, x]


@njit(cache=True)
def roots_of(process, early, beyond, start, stop, at_early, at_beyond, link):  # type: ignore[no-untyped-def]
    """Fill R at `early` and at `beyond`, and Â between them; return whether there are any.

    `start` and `stop` (3, 2 m) are Cov(x, z_j) L⁻ᵀ there.
    """
    prior_matrix(process, early, at_early)
    prior_matrix(process, beyond, at_beyond)
    move = at_early.copy()
    first = at_early[0, 0], at_early[1, 1], at_early[2, 2]
    last = at_beyond[0, 0], at_beyond[1, 1], at_beyond[2, 2]
    for t in range(early + 1, beyond + 1):
        carry_columns(process.f[t], move)  # Cov(x_beyond, x_early)
    for x in range(3):
        for y in range(3):
            for z in range(start.shape[1]):
                at_early[x, y] -= start[x, z] * start[y, z]
                at_beyond[x, y] -= stop[x, z] * stop[y, z]
                move[x, y] -= stop[x, z] * start[y, z]
    if not (lower_factor(at_early, first) and lower_factor(at_beyond, last)):
        return False
    for x in range(3):
        solve_row(at_early, 3, move[x])
    link[:] = move
    solve_columns(at_beyond, link)
    return True


@njit(cache=True)
def tell_from_afar(j, process, cameras, rows, near, root, told):  # type: ignore[no-untyped-def]
    """Fill E of the far cameras before j; `root` is R at `early`, `near` the neighbours.

    Camera i leaves a car that nobody has looked at with P − Φ D Φᵀ. With P = L Lᵀ and U whatever
    L⁻¹ (P − Φ D Φᵀ) L⁻ᵀ is, it tells L⁻ᵀ (U⁻¹ − I) L⁻¹ of the state.
    """
    early = near.early[j]
    from_sample = early
    for a in range(near.into[j], near.into[j + 1]):
        i = near.source[a]
        if not near.near[a] and cameras.last[i] >= 0:
            from_sample = min(from_sample, cameras.last[i])
    # L⁻¹ Φ for each sample on the way
    whitened = np.empty((early - from_sample + 1, 3, 3))
    low, g = np.empty((3, 3)), np.empty((3, 3))
    prior_matrix(process, early, low)
    if not lower_factor(low, (low[0, 0], low[1, 1], low[2, 2])):
        return
    now = whitened[early - from_sample]
    now[:] = np.eye(3)
    g[:] = root
    solve_columns(low, now)
    solve_columns(low, g)
    for t in range(early, from_sample, -1):
        f, now, back = process.f[t], whitened[t - from_sample], whitened[t - 1 - from_sample]
        for x in range(3):
            for y in range(3):
                back[x, y] = now[x, 0] * f[y] + now[x, 1] * f[3 + y] + now[x, 2] * f[6 + y]
    u, more, known = np.empty((3, 3)), np.empty((3, 3)), np.zeros((3, 3))
    for a in range(near.into[j], near.into[j + 1]):
        i = near.source[a]
        if near.near[a] or cameras.last[i] < 0:
            continue
        behind = after(prior_at(process, cameras.first[i]), rows[i])
        d = prior_at(process, cameras.last[i])
        congruent(
            whitened[cameras.last[i] - from_sample],
            (
                d[0] - behind[0], d[1] - behind[1], d[2] - behind[2],
                d[3] - behind[3], d[4] - behind[4], d[5] - behind[5],
            ),
            u,
        )  # fmt: skip
        for x in range(3):
            for y in range(3):
                u[x, y] = -(1.0 - HAIR) * u[x, y]
            u[x, x] += 1.0 + HAIR
        if not invert(u, more):
            continue
        for x in range(3):
            more[x, x] -= 1.0
        congruent(g.T, (more[0, 0], more[0, 1], more[0, 2], more[1, 1], more[1, 2], more[2, 2]), u)
        for x in range(3):
            u[x, x] += 1.0
        if not invert(u, known):  # I − E
            continue
        put6(
            told.before, a,
            (
                1.0 - known[0, 0], -known[0, 1], -known[0, 2],
                1.0 - known[1, 1], -known[1, 2], 1.0 - known[2, 2],
            ),
        )  # fmt: skip


@njit(cache=True)
def congruent(a, d, out):  # type: ignore[no-untyped-def]
    """Fill `out` (3, 3) with A D Aᵀ, D symmetric (6,)."""
    for x in range(3):
        u = a[x, 0] * d[0] + a[x, 1] * d[1] + a[x, 2] * d[2]
        v = a[x, 0] * d[1] + a[x, 1] * d[3] + a[x, 2] * d[4]
        w = a[x, 0] * d[2] + a[x, 1] * d[4] + a[x, 2] * d[5]
        for y in range(x + 1):
            out[x, y] = out[y, x] = u * a[y, 0] + v * a[y, 1] + w * a[y, 2]


@njit(cache=True)
def tell_from_near(j, features, near, root, stop, before, used, told):  # type: ignore[no-untyped-def]
    """Fill E of j's near cameras at `beyond`, by their features; `root` is R there.

    `before` is B (q, r, 2 m) and the inverse of a factor (q, r, r) of each near one, given z_j.
    """
    beyond, (b_before, inverse) = near.beyond[j], before
    d = np.empty((3, RANK))
    for a in range(near.into[j], near.into[j + 1]):
        if not near.near[a]:
            continue
        i, c = near.source[a], near.rank[a]
        at = beyond - features.low[i]
        if used[c] <= 0 or not 0 <= at < features.at[i + 1] - features.at[i]:
            continue
        d[:] = features.field[features.at[i] + at]
        for x in range(3):
            for r in range(RANK):
                for z in range(stop.shape[1]):
                    d[x, r] -= stop[x, z] * b_before[c, r, z]
            # times the inverse factor, from the last on: it is lower triangular
            for r in range(RANK - 1, -1, -1):
                s = 0.0
                for q in range(r + 1):
                    s += inverse[c, r, q] * d[x, q]
                d[x, r] = s
        put_told(root, d, told.before, a)


@njit(cache=True)
def put_told(root, d, out, at):  # type: ignore[no-untyped-def]
    """Write R⁻¹ D Dᵀ R⁻ᵀ to a row of `out` (m, 6); replaces `d` (3, r)."""
    solve_columns(root, d)
    put_square(d, out, at)


@njit(cache=True)
def put_square(d, out, at):  # type: ignore[no-untyped-def]
    """Write D Dᵀ to a row of `out` (m, 6), D (3, r)."""
    a = b = c = e = f = g = 0.0
    for r in range(d.shape[1]):
        x, y, z = d[0, r], d[1, r], d[2, r]
        a, b, c, e, f, g = a + x * x, b + x * y, c + x * z, e + y * y, f + y * z, g + z * z
    put6(out, at, (a, b, c, e, f, g))


@njit(cache=True)
def tell_ahead(j, e, k, features, near, root, start, b, given, told):  # type: ignore[no-untyped-def]
    """Fill K of camera k ahead at `early`, by its features; `root` is R there.

    `b` (r, 2 m) is Cov(y_k, z_j) L⁻ᵀ and `given` (r, r) a Cholesky factor of Cov(y_k | z_j).
    """
    place = near.early[j] - features.low[k]
    if not 0 <= place < features.at[k + 1] - features.at[k]:
        return
    d = features.field[features.at[k] + place].copy()
    for x in range(3):
        for r in range(RANK):
            for z in range(start.shape[1]):
                d[x, r] -= start[x, z] * b[r, z]
        solve_row(given, RANK, d[x])
    put_told(root, d, told.after, e)


@njit(cache=True)
def tell_beyond(j, process, cameras, rows, near, root, told):  # type: ignore[no-untyped-def]
    """Fill K of the cameras beyond all that j and its near ones see; `root` is R at `beyond`.

    With M = N Nᵀ what k tells of the state at its first sample, Φ that sample's transition and P
    its covariance given z_j, K = Yᵀ (I + Nᵀ P N)⁻¹ Y, Y = Nᵀ Φ R.
    """
    beyond = near.beyond[j]
    farthest = beyond
    for e in range(near.out_of[j], near.out_of[j + 1]):
        k = near.target[e]
        if not near.ahead[e] and cameras.last[k] >= 0:
            farthest = max(farthest, cameras.first[k])
    moved, p = np.empty((farthest - beyond + 1, 3, 3)), np.empty((farthest + 1, 6))
    n, y, m, d = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    congruent(root, (1.0, 0.0, 0.0, 1.0, 0.0, 1.0), m)
    put6(p, beyond, (m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2]))
    predict_ahead(process, row6(p, beyond), beyond, farthest, p)
    moved[0] = root
    for t in range(beyond + 1, farthest + 1):
        moved[t - beyond] = moved[t - 1 - beyond]
        carry_columns(process.f[t], moved[t - beyond])
    for e in range(near.out_of[j], near.out_of[j + 1]):
        k = near.target[e]
        if near.ahead[e] or cameras.last[k] < 0:
            continue
        root_of_psd(rows[k], n)
        t = cameras.first[k]
        b = moved[t - beyond]
        congruent(n.T, row6(p, t), m)
        for x in range(3):
            m[x, x] += 1.0
            for r in range(3):
                y[x, r] = n[0, x] * b[0, r] + n[1, x] * b[1, r] + n[2, x] * b[2, r]
        factor(m, 3)
        # K = (L⁻¹ Y)ᵀ (L⁻¹ Y), L of I + Nᵀ P N
        for x in range(3):
            d[x] = y[:, x]
            solve_row(m, 3, d[x])
        put_square(d, told.after, e)


@njit(cache=True)
def root_of_psd(row, n):  # type: ignore[no-untyped-def]
    """Fill `n` (3, 3), lower triangular, with N Nᵀ ⪯ M, the information of a stretch's row."""
    n[:] = 0.0
    if not row[9] > 0.0:
        return
    n[0, 0] = row[9] ** 0.5
    n[1, 0], n[2, 0] = row[10] / n[0, 0], row[11] / n[0, 0]
    rest = row[12] - n[1, 0] * n[1, 0]
    if not rest > 1e-12 * row[12]:
        return
    n[1, 1] = rest**0.5
    n[2, 1] = (row[13] - n[2, 0] * n[1, 0]) / n[1, 1]
    n[2, 2] = max(row[14] - n[2, 0] * n[2, 0] - n[2, 1] * n[2, 1], 0.0) ** 0.5
