"""The change of a drive's filter covariances on adding a candidate, followed until it is known.

Let φ be the map of the covariance P at sample t to a later one under the placement so far. With δ
the reduction of P by the candidate, Λ the derivative of Σ_{τ > t} tr(W P_τ) by P (the adjoint)
and Γ the information that later samples hold about state t,

    tr(Λ δ)  ≤  Σ_{τ > t} tr(W [φ_τ(P) − φ_τ(P − δ)])  ≤  tr(Λ δ) / (1 − ρ),   ρ = tr(δ G),

with G = Γ (I + P Γ)⁻¹, if ρ < 1. Proof: φ_τ(P) = A (P⁻¹ + Γ_τ)⁻¹ Aᵀ + C with Γ_τ ≤ Γ, and with
L = (I + P Γ_τ)⁻¹ the difference is A L δ^½ (I − δ^½ Γ_τ L δ^½)⁻¹ δ^½ Lᵀ Aᵀ; the middle lies
between I and I / (1 − λ), λ ≤ tr(δ Γ_τ L) ≤ tr(δ G), because Γ (I + P Γ)⁻¹ = (Γ⁻¹ + P)⁻¹ grows
with Γ. So the walk ends as soon as ρ tr(Λ δ) is negligible: at once where nothing is seen later
(Γ = 0), else soon after the next camera has made the filter forget.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.objectives.windows.filter import (
    parallel,
    predict,
    pull_back,
    put6,
    row6,
    update,
)

TAIL_TOLERANCE = 1e-10  # of a gain: what the bound above may leave open at the end of the walk
FORGOTTEN = 1e-13  # of P: a change this small is none, so a second window starts afresh
LOOK_EVERY = 8  # samples between looks whether the change has died out within a gap


@njit(cache=True)
def filter_adjoint(steps, total, before, seed, w_tt, w_nn, future):  # type: ignore[no-untyped-def]
    """Fill `future` (t, 6): the derivative of what comes after sample t by P_t⁺.

    What comes after is Σ_{τ > t} (w_tt P_tt + w_nn P_nn)_τ, and tr(`seed` P_T) at the last sample.
    """
    n = steps.shape[0]
    g = (seed[0], seed[1], seed[2], seed[3], seed[4], seed[5])
    put6(future, n - 1, g)
    for t in range(n - 1, 0, -1):
        g = (g[0] + w_tt, g[1], g[2], g[3] + w_nn, g[4], g[5])
        g = pull_back(
            through_update(g, row6(before, t), total[t, 0], total[t, 1], total[t, 2]), steps[t]
        )
        put6(future, t - 1, g)


@njit(cache=True, inline="always")
def through_update(g, p, jtt, jtn, jnn):  # type: ignore[no-untyped-def]
    """Return Lᵀ G L (6,) with L = I − P HᵀA H, the derivative of the update by P."""
    g0, g1, g2, g3, g4, g5 = g
    det_j = jtt * jnn - jtn * jtn
    det = 1.0 + p[0] * jtt + 2.0 * p[1] * jtn + p[3] * jnn + (p[0] * p[3] - p[1] * p[1]) * det_j
    inv = 1.0 / det
    att = (jtt + det_j * p[3]) * inv
    atn = (jtn - det_j * p[1]) * inv
    ann = (jnn + det_j * p[0]) * inv
    # L = [[L_p, 0], [l, 1]]; L_p = (I + P_p J)⁻¹ as adjugate over determinant
    l00 = (1.0 + p[1] * jtn + p[3] * jnn) * inv
    l01 = -(p[0] * jtn + p[1] * jnn) * inv
    l10 = -(p[1] * jtt + p[3] * jtn) * inv
    l11 = (1.0 + p[0] * jtt + p[1] * jtn) * inv
    l20 = -(p[2] * att + p[4] * atn)
    l21 = -(p[2] * atn + p[4] * ann)
    a0, a1, a2 = (
        g0 * l00 + g1 * l10 + g2 * l20,
        g1 * l00 + g3 * l10 + g4 * l20,
        g2 * l00 + g4 * l10 + g5 * l20,
    )
    b0, b1, b2 = (
        g0 * l01 + g1 * l11 + g2 * l21,
        g1 * l01 + g3 * l11 + g4 * l21,
        g2 * l01 + g4 * l11 + g5 * l21,
    )
    return (
        l00 * a0 + l10 * a1 + l20 * a2,
        l01 * a0 + l11 * a1 + l21 * a2,
        a2,
        l01 * b0 + l11 * b1 + l21 * b2,
        b2,
        g5,
    )


@njit(cache=True)
def forgetting(after, later, out):  # type: ignore[no-untyped-def]
    """Fill `out` (t, 6) with G = Γ (I + P⁺ Γ)⁻¹."""
    for t in range(after.shape[0]):
        put6(out, t, parallel(row6(later, t), row6(after, t)))


@njit(cache=True)
def leaps(steps, total, w_tt, w_nn, target, leap, passed):  # type: ignore[no-untyped-def]
    """Compose the steps from each sample to the next that the placement sees, or to the last.

    Fills `target` (t,), the sample reached; `leap` (t, N_STEP), the way there as one step; and
    `passed` (t, 6), the derivative of Σ (w_tt P_tt + w_nn P_nn) over the samples leapt by P_t⁺.
    """
    n = steps.shape[0]
    target[n - 1] = n - 1
    leap[n - 1] = 0.0
    passed[n - 1] = 0.0
    for t in range(n - 2, -1, -1):
        one = steps[t + 1]
        seen = total[t + 1, 0] != 0.0 or total[t + 1, 2] != 0.0
        if seen or t == n - 2:
            target[t] = t + 1
            leap[t] = one
            passed[t] = 0.0
            continue
        rest = leap[t + 1]
        target[t] = target[t + 1]
        leap[t, 0] = rest[0] * one[0] - rest[1] * one[1]
        leap[t, 1] = rest[0] * one[1] + rest[1] * one[0]
        leap[t, 2] = rest[0] * one[2] + rest[1] * one[3] + rest[2]
        leap[t, 3] = rest[0] * one[3] - rest[1] * one[2] + rest[3]
        noise = predict((one[4], one[5], one[6], one[7], one[8], one[9]), rest)
        put6(leap[:, 4:], t, noise)
        g0, g1, g2, g3, g4, g5 = row6(passed, t + 1)
        put6(passed, t, pull_back((g0 + w_tt, g1, g2, g3 + w_nn, g4, g5), one))


@njit(cache=True)
def position_slopes(after, future, w_tt, w_nn, out):  # type: ignore[no-untyped-def]
    """Fill `out` (t, 3) with the position block of P⁺ (future + W) P⁺.

    It is minus the derivative of the objective by the information of sample t.
    """
    for t in range(after.shape[0]):
        p0, p1, p2, p3, p4, _ = row6(after, t)
        g0, g1, g2, g3, g4, g5 = row6(future, t)
        g0 += w_tt
        g3 += w_nn
        a0, a1, a2 = (
            g0 * p0 + g1 * p1 + g2 * p2,
            g1 * p0 + g3 * p1 + g4 * p2,
            g2 * p0 + g4 * p1 + g5 * p2,
        )
        b0, b1, b2 = (
            g0 * p1 + g1 * p3 + g2 * p4,
            g1 * p1 + g3 * p3 + g4 * p4,
            g2 * p1 + g4 * p3 + g5 * p4,
        )
        out[t, 0] = p0 * a0 + p1 * a1 + p2 * a2
        out[t, 1] = p0 * b0 + p1 * b1 + p2 * b2
        out[t, 2] = p1 * b0 + p3 * b1 + p4 * b2


@njit(cache=True, inline="always")
def inner(a, b):  # type: ignore[no-untyped-def]
    """Return tr(A B) of two symmetric (6,)."""
    return a[0] * b[0] + a[3] * b[3] + a[5] * b[5] + 2.0 * (a[1] * b[1] + a[2] * b[2] + a[4] * b[4])


@njit(cache=True, inline="always")
def minus(a, b):  # type: ignore[no-untyped-def]
    """Return A − B (6,)."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5])


@njit(cache=True)
def window_reductions(  # type: ignore[no-untyped-def]
    indptr,
    indices,
    blocks,
    frames,
    rows,
    steps,
    total,
    before,
    after,
    future,
    forget,
    target,
    leap,
    passed,
    w_tt,
    w_nn,
    out,
    walked,
):
    """Set out[k] to the fall of Σ_t (w_tt P_tt + w_nn P_nn)_t on adding candidate rows[k].

    `walked[k]` counts the samples visited; those after the window that the placement does not see
    are leapt over. What the walk leaves open at its end is at most TAIL_TOLERANCE of the gain, by
    the bound of this module.
    """
    isotropic = blocks.shape[1] == 1
    last = steps.shape[0] - 1
    for k in range(rows.size):
        first, stop = indptr[rows[k]], indptr[rows[k] + 1]
        out[k], walked[k] = 0.0, 0
        if first == stop:
            continue
        fall, visits = 0.0, 0
        e = first
        t = np.int64(indices[first])
        p = row6(before, t)
        while True:
            jtt, jtn, jnn = total[t, 0], total[t, 1], total[t, 2]
            own = e < stop and indices[e] == t
            if own:
                b = frames * np.float64(blocks[e, 0])
                if isotropic:
                    jtt, jnn = jtt + b, jnn + b
                else:
                    jtt += b
                    jtn += frames * np.float64(blocks[e, 1])
                    jnn += frames * np.float64(blocks[e, 2])
                e += 1
            q0, q1, q2, q3, q4, q5, _ = update(p, jtt, jtn, jnn)
            p = (q0, q1, q2, q3, q4, q5)
            visits += 1
            base = row6(after, t)
            delta = minus(base, p)
            fall += w_tt * delta[0] + w_nn * delta[3]
            if e == stop:
                tail = inner(delta, row6(future, t))
                rho = inner(delta, row6(forget, t))
                if t == last or (rho < 0.5 and rho * tail <= TAIL_TOLERANCE * (fall + tail)):
                    fall += tail
                    break
                fall += inner(delta, row6(passed, t))
                p = predict(p, leap[t])
                t = target[t]
                continue
            if not own and visits % LOOK_EVERY == 0 and indices[e] - t > LOOK_EVERY:
                scale = FORGOTTEN
                if (
                    abs(delta[0]) <= scale * base[0]
                    and abs(delta[3]) <= scale * base[3]
                    and abs(delta[5]) <= scale * base[5]
                ):
                    fall += inner(delta, row6(future, t))
                    t = np.int64(indices[e])
                    p = row6(before, t)
                    continue
            t += 1
            p = predict(p, steps[t])
        out[k] = fall
        walked[k] = visits
