"""A certificate for thousands of cameras: cuts mixed sample by sample, one price a camera.

For every sample t and sets R_0 = ∅ ⊂ R_1 ⊂ … of cameras, diminishing returns give, whatever S is,

    f_t(S) ≤ f_t(R_l) + Σ_{j ∈ S} g_t(j | R_l),    g_t(j | R) = f_t(R ∪ j) − f_t(R)

(Nemhauser & Wolsey 1981). Mixed with any μ_tl ≥ 0, Σ_l μ_tl = 1, and summed over the samples,

    f(S) ≤ Σ_{t,l} μ_tl f_t(R_l) + Σ_{j ∈ S} c_j,    c_j = Σ_{t,l} μ_tl g_t(j | R_l),

and a sum of worths c_j over at most k cameras, one a mount, is largest at the k best mounts: for
every price λ it is at most λk + Σ_mounts max(0, max_j c_j − λ). So any μ is a certificate. The R_l
are the cameras that a good placement has in view of t, and μ is improved by mirror descent on the
bound smoothed at a temperature τ that sinks: with the mounts' shares p_j at price λ,

    z_tl = f_t(R_l) + Σ_j p_j g_t(j | R_l),    μ_tl ∝ μ_tl exp(−η z_tl).

Regions. Each candidate belongs to one region r and f_t(S) ≤ Σ_r f_t(S ∩ r), so every region may
have μ of its own, their constants add up, and the k best mounts are taken of all. What is lost is
what two regions see at once. A region is a task of its own: `price_region`.

Only candidates that gain more than `floor` alone need to be looked at: c_j ≤ f(j), and a mount
whose candidates all gain less counts as `floor`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.city.mixing import shares, slopes, worths
from placement.objectives.block_kernels import block_of, log_det_ratio

LEVELS = 4  # sets R_l a sample at most, the empty one included


@dataclass(frozen=True, slots=True)
class RegionTask:
    """Hold the candidates of one region that gain more than `floor` alone, by mount.

    start (m + 1,): candidates start[i] … start[i + 1] − 1 are mount i's. indptr, indices, blocks:
    their CSR rows, samples numbered within the region. chosen: which of them the placement holds.
    weights (t,), scale: as the objective has them. price: of a camera, about the last one's gain.
    """

    start: IntArray
    indptr: IntArray
    indices: NDArray[np.int32]
    blocks: NDArray[np.float32]
    weights: FloatArray
    scale: float
    chosen: IntArray
    price: float
    steps: int


@dataclass(frozen=True, slots=True)
class RegionPrice:
    """Hold Σ μ f_t(R_l) and every mount's best worth (m,): f(S) ≤ constant + Σ worths of S."""

    constant: float
    worth: FloatArray


def price_region(task: RegionTask) -> RegionPrice:
    """Find μ for one region; the best of all steps at the task's price is returned."""
    t = len(task.weights)
    sums = np.zeros((t, LEVELS, 3))
    sets = np.zeros(t, dtype=np.int64)
    value = np.zeros((t, LEVELS))
    who = np.full((t, LEVELS), -1, dtype=np.int64)
    rows = (task.indptr, task.indices, task.blocks)
    _stack(task.chosen, *rows, task.weights, task.scale, sums, sets, value, who)
    gains = np.zeros((len(task.indices), LEVELS))
    _entry_gains(*rows, task.weights, task.scale, sums, sets, who, gains)
    exists = np.arange(LEVELS) <= sets[:, None]
    mixture = np.where(exists, 1.0 / (sets[:, None] + 1.0), 0.0)
    worth, share = np.zeros(len(task.indptr) - 1), np.zeros(len(task.indptr) - 1)
    slope = np.empty_like(value)
    best = RegionPrice(np.inf, np.zeros(len(task.start) - 1))
    least = np.inf
    for step in range(task.steps):
        worths(task.indptr, task.indices, gains, mixture, sets, worth)
        constant = float(np.sum(mixture * value))
        most = np.maximum(np.maximum.reduceat(worth, task.start[:-1]), 0.0)
        bound = constant + float(np.sum(np.maximum(most - task.price, 0.0)))
        if bound < least:
            least, best = bound, RegionPrice(constant, most)
        temperature = task.price * _TEMPERATURE / (1.0 + step / _COOLING)
        shares(worth, task.start, task.price, temperature, share)
        slope[:] = value
        slopes(task.indptr, task.indices, gains, share, sets, slope)
        with np.errstate(divide="ignore"):
            logits = np.log(mixture) - _RATE / (1.0 + step / (2.0 * _COOLING)) * slope
        logits[~exists] = -np.inf
        logits -= logits.max(axis=1, keepdims=True)
        mixture = np.exp(np.maximum(logits, _LEAST_LOG))
        mixture[~exists] = 0.0
        mixture /= mixture.sum(axis=1, keepdims=True)
    return best


def certificate(
    prices: list[RegionPrice], budget: int, floor: float, other_mounts: int
) -> tuple[float, float]:
    """Add the regions up: an upper bound on every placement of at most `budget` cameras, and λ.

    `other_mounts` have no candidate that gains more than `floor` alone. Rounded outwards by the
    rounding of the sums (1e-9 relative is a thousand times that).
    """
    worth = np.concatenate([price.worth for price in prices] or [np.empty(0)])
    worth = np.concatenate([np.maximum(worth, floor), np.full(min(other_mounts, budget), floor)])
    best = np.sort(worth)[::-1][:budget]
    total = sum(price.constant for price in prices) + float(best.sum())
    return total * (1.0 + _ROUNDING), float(best[-1]) if len(best) else 0.0


_TEMPERATURE, _COOLING, _RATE = 0.05, 10.0, 0.5
_LEAST_LOG = -12.0  # a set that falls out of the mixture may come back
_ROUNDING = 1e-9


@njit(cache=True, error_model="numpy", nogil=True)
def _stack(
    chosen: IntArray,
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    weights: FloatArray,
    scale: float,
    sums: FloatArray,
    sets: IntArray,
    value: FloatArray,
    who: IntArray,
) -> None:
    """Stack the sets R_l of every sample: their information, number, value and last camera."""
    for i in chosen:
        for e in range(indptr[i], indptr[i + 1]):
            t = indices[e]
            n = sets[t]
            if n == LEVELS - 1:
                continue
            a, c, b = block_of(blocks, e)
            sums[t, n + 1, 0] = scale * a + sums[t, n, 0]
            sums[t, n + 1, 1] = scale * c + sums[t, n, 1]
            sums[t, n + 1, 2] = scale * b + sums[t, n, 2]
            who[t, n] = i
            a, c, b = sums[t, n + 1, 0], sums[t, n + 1, 1], sums[t, n + 1, 2]
            value[t, n + 1] = weights[t] * np.log1p(a + b + max(a * b - c * c, 0.0))
            sets[t] = n + 1


@njit(cache=True, error_model="numpy", nogil=True)
def _entry_gains(
    indptr: IntArray,
    indices: NDArray[np.int32],
    blocks: NDArray[np.float32],
    weights: FloatArray,
    scale: float,
    sums: FloatArray,
    sets: IntArray,
    who: IntArray,
    gains: FloatArray,
) -> None:
    """Write g_t(j | R_l) of every entry into `gains` (nnz, LEVELS); 0 where j is in R_l."""
    for i in range(len(indptr) - 1):
        for e in range(indptr[i], indptr[i + 1]):
            t = indices[e]
            ja, jc, jb = block_of(blocks, e)
            ja, jc, jb = scale * ja, scale * jc, scale * jb
            for level in range(sets[t] + 1):
                if level > 0 and who[t, level - 1] == i:
                    break
                a, c, b = sums[t, level, 0], sums[t, level, 1], sums[t, level, 2]
                # the sums are scaled already
                gains[e, level] = weights[t] * log_det_ratio(a, c, b, ja, jc, jb, 1.0)
