"""What many trajectories learn: gains by window, messages mended only as far as it counts.

    f(S) = Σ_d w_d log det(Λ_d + Σ_{i ∈ S} Λ_di) − log det Λ_d

is `placement.objectives.entropy` over the drives of a city: monotone and submodular. With P_t the
filter's covariance before sample t, Γ_t what later samples tell about state t and P_t⁺ the
covariance after it, a candidate's gain on one drive is, over any window of samples a … b that holds
all of its own,

    Σ_{a ≤ t ≤ b} [log det(I + P'_t J'_t) − log det(I + P_t J_t)]
        + log det(I + P'_b⁺ Γ_b) − log det(I + P_b⁺ Γ_b),

primes with the candidate, P'_a = P_a. Nothing there is a sum from a drive's start, so a camera that
is added changes what is stored only as far as the filter remembers it: forwards until covariances,
and backwards until informations, are what they were, to `SETTLED`.

A *pair* is a candidate and a drive that it sees: `pairs` are indptr (c + 1,), each pair's drive
(pairs,) and its first entry (pairs + 1,).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.objectives.block_kernels import block_of
from placement.objectives.windows.filter import (
    RESCALE,
    log_det_plus,
    parallel,
    predict,
    pull_back,
    put6,
    row6,
    update,
)

SETTLED = 1e-11  # of a variance or an information: a change this small is none


class Sightings(NamedTuple):
    """What is seen where, as long as no camera is chosen: CSR rows of candidates over all drives.

    indptr (c + 1,), indices (nnz,) and blocks (nnz, 1 | 3) are the candidates' own; frames (t,),
    owner (t,), start (d + 1,) and steps (t, N_STEP) those of `placement.city.drives.CityDrives`.
    """

    indptr: IntArray
    indices: NDArray[np.int32]
    blocks: NDArray[np.float32]
    frames: FloatArray
    owner: NDArray[np.int32]
    start: IntArray
    steps: FloatArray


class Messages(NamedTuple):
    """What the chosen cameras tell, (t, 3), and what follows from it, a row a sample.

    before (t, 6) P, later (t, 6) Γ, own (t,) log det(I + P J), rest (t,) log det(I + P⁺ Γ).
    """

    total: FloatArray
    before: FloatArray
    later: FloatArray
    own: FloatArray
    rest: FloatArray


def no_messages(t: int) -> Messages:
    """Return room for the messages of t samples, with no camera."""
    return Messages(np.zeros((t, 3)), np.empty((t, 6)), np.empty((t, 6)), np.empty(t), np.empty(t))


@njit(cache=True, error_model="numpy", nogil=True)
def renew_drive(
    begin: int, end: int, steps: FloatArray, p0: FloatArray, messages: Messages
) -> float:
    """Compute the messages of samples begin … end − 1, one drive, from their `total`.

    Returns the drive's log det, Σ own.
    """
    total, before, later, own, rest = messages
    p = (p0[0], p0[1], p0[2], p0[3], p0[4], p0[5])
    g = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    put6(later, end - 1, g)
    for t in range(end - 1, begin, -1):
        g = _earlier(g, total, steps, t)
        put6(later, t - 1, g)
    log_sum = 0.0
    for t in range(begin, end):
        if t > begin:
            p = predict(p, steps[t])
        put6(before, t, p)
        q0, q1, q2, q3, q4, q5, det = update(p, total[t, 0], total[t, 1], total[t, 2])
        p = (q0, q1, q2, q3, q4, q5)
        own[t] = math.log(det)
        rest[t] = log_det_plus(p, row6(later, t))
        log_sum += own[t]
    return log_sum


@njit(cache=True, error_model="numpy", nogil=True)
def gain_on_drive(e: int, stop: int, seen: Sightings, messages: Messages) -> float:
    """Return what entries e … of one candidate gain on the drive of the first.

    They end at the first entry of another drive, or at `stop`.
    """
    total, before, later, own, rest = messages
    t = np.int64(seen.indices[e])
    drive = seen.owner[t]
    p = row6(before, t)
    log_sum, product = 0.0, 1.0
    more = True
    while True:
        ja, jc, jb = total[t, 0], total[t, 1], total[t, 2]
        if seen.indices[e] == t:
            a, c, b = block_of(seen.blocks, e)
            f = seen.frames[t]
            ja, jc, jb = ja + f * a, jc + f * c, jb + f * b
            e += 1
            more = e < stop and seen.owner[seen.indices[e]] == drive
        q0, q1, q2, q3, q4, q5, det = update(p, ja, jc, jb)
        p = (q0, q1, q2, q3, q4, q5)
        log_sum -= own[t]
        product *= det
        if product > RESCALE:
            log_sum += math.log(product)
            product = 1.0
        if not more:
            log_sum += math.log(product)
            gain: float = log_sum + log_det_plus(p, row6(later, t)) - rest[t]
            return gain
        t += 1
        p = predict(p, seen.steps[t])


@njit(cache=True, error_model="numpy", nogil=True)
def pair_gains(
    begin: int,
    end: int,
    first: IntArray,
    seen: Sightings,
    messages: Messages,
    out: FloatArray,
) -> None:
    """Write the gains of pairs begin … end − 1, unweighted, into `out` (pairs,).

    `first` (pairs + 1,) are the pairs' first entries.
    """
    for q in range(begin, end):
        out[q] = max(gain_on_drive(first[q], first[q + 1], seen, messages), 0.0)


@njit(cache=True, error_model="numpy", nogil=True)
def gain_anew(
    i: int,
    pairs: tuple[IntArray, NDArray[np.int32], IntArray],
    seen: Sightings,
    weights: FloatArray,
    messages: Messages,
    changed: NDArray[np.int32],
    known: FloatArray,
    when: NDArray[np.int32],
    now: int,
) -> float:
    """Return the gain of candidate i over all drives, in nats, from the gains `known` (pairs,).

    Computed anew are those of which a sample was `changed` (t,) since `when` (pairs,).
    """
    indptr, drive, first = pairs
    found = 0.0
    for q in range(indptr[i], indptr[i + 1]):
        for e in range(first[q], first[q + 1]):
            if changed[seen.indices[e]] > when[q]:
                pair_gains(q, q + 1, first, seen, messages, known)
                when[q] = now
                break
        found += weights[drive[q]] * known[q]
    return found


@njit(cache=True, error_model="numpy", nogil=True)
def absorb(
    i: int, seen: Sightings, messages: Messages, changed: NDArray[np.int32], now: int
) -> int:
    """Add candidate i to `total` and mend the messages; return how many samples were renewed.

    Those are marked `now` in `changed` (t,).
    """
    total, before, later, own, rest = messages
    indices, owner, start, steps = seen.indices, seen.owner, seen.start, seen.steps
    renewed = 0
    e, stop = seen.indptr[i], seen.indptr[i + 1]
    while e < stop:
        first = last = int(indices[e])
        drive = owner[first]
        while e < stop and owner[indices[e]] == drive:
            last = int(indices[e])
            ja, jc, jb = block_of(seen.blocks, e)
            f = seen.frames[last]
            total[last, 0] += f * ja
            total[last, 1] += f * jc
            total[last, 2] += f * jb
            e += 1
        low = high = first
        g = row6(later, last)
        for t in range(last, int(start[drive]), -1):
            g = _earlier(g, total, steps, t)
            if t <= first and _same(g, later, t - 1):
                break
            put6(later, t - 1, g)
            low = t - 1
        p = row6(before, first)
        t = first
        while True:
            q0, q1, q2, q3, q4, q5, det = update(p, total[t, 0], total[t, 1], total[t, 2])
            own[t] = math.log(det)
            p = (q0, q1, q2, q3, q4, q5)
            t += 1
            if t == start[drive + 1]:
                break
            p = predict(p, steps[t])
            if t > last and _same(p, before, t):
                break
            put6(before, t, p)
        high = t
        for t in range(low, high):
            q0, q1, q2, q3, q4, q5, _ = update(
                row6(before, t), total[t, 0], total[t, 1], total[t, 2]
            )
            rest[t] = log_det_plus((q0, q1, q2, q3, q4, q5), row6(later, t))
            changed[t] = now
        renewed += high - low
    return renewed


@njit(cache=True, inline="always")
def _earlier(g, total, steps, t):  # type: ignore[no-untyped-def]
    """Return Γ of sample t − 1 from that of sample t."""
    g = (g[0] + total[t, 0], g[1] + total[t, 1], g[2], g[3] + total[t, 2], g[4], g[5])
    q = (steps[t, 4], steps[t, 5], steps[t, 6], steps[t, 7], steps[t, 8], steps[t, 9])
    return pull_back(parallel(g, q), steps[t])


@njit(cache=True, inline="always")
def _same(new, old, t):  # type: ignore[no-untyped-def]
    """Return whether the diagonal is what it was; a definite change is bounded by its own."""
    return (
        abs(new[0] - old[t, 0]) <= SETTLED * old[t, 0]
        and abs(new[3] - old[t, 3]) <= SETTLED * old[t, 3]
        and abs(new[5] - old[t, 5]) <= SETTLED * old[t, 5]
    )
