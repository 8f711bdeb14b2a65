"""Certificates: upper bounds on the score of every placement, from whatever a solver hands us.

No solver is believed. A conic solver gives a fractional x, a linear-programming solver gives
multipliers; both are only *starting points* here. From them a linear function is made that lies
above the score at every placement, and that function is maximised exactly (`bounds.linear`).
Sums are rounded outwards, so the bound holds for the stored information, not just nearly.
"""

from __future__ import annotations

import math

import numpy as np

from models.geometry import FloatArray
from placement.bounds.cuts import CutMaker, Cuts
from placement.bounds.linear import best_sum, most_sum
from placement.bounds.matroid import Choice, best_choice, root_choice
from placement.constraints import Constraints
from placement.objectives.base import Relaxable
from placement.objectives.localisation import Localisation

# Relative error of one gain or slope, 2×2 and ill-conditioned: `solve` allows for as much again.
GAIN_ERROR = 1e-12
_EPS = float(np.finfo(np.float64).eps)


def tangent_bound(objective: Relaxable, constraints: Constraints, x: FloatArray) -> float:
    """Bound every placement by the tangent of the concave extension at `x` (c,).

        f(S) ≤ f(x) + Σ_j ∂_j f(x) (1_S − x)_j ≤ f(x) − ∂f(x)·x + max_S Σ_{j ∈ S} ∂_j f(x)

    Valid for any x ≥ 0 whatever, tight where x is optimal (Boyd & Vandenberghe 2004, 3.1.3).
    """
    if isinstance(objective, Localisation) and not constraints.limits_money:
        # It knows the rounding error of each of its slopes.
        tangents = CutMaker(objective).tangent(x)
        samples = objective.information.n_samples
        return cut_bound(tangents, np.ones(len(tangents)), root_choice(constraints), samples)[0]
    score, slope = objective.relaxed(x)
    if constraints.limits_money:
        most = most_sum(constraints, slope)
        return sum_up(np.concatenate([[score], -slope * x, [most]]), (2 + len(x)) * GAIN_ERROR)
    chosen, _ = best_sum(constraints, slope)
    return sum_up(np.concatenate([[score], -slope * x, slope[chosen]]), GAIN_ERROR)


def cut_bound(
    cuts: Cuts,
    multiplier: FloatArray,
    choice: Choice,
    n_samples: int,
    price: FloatArray | None = None,
) -> tuple[float, FloatArray]:
    """Bound every placement of `choice` by a mixture of cuts.

    For each sample t the multipliers (m,) of its cuts are made non-negative with sum 1; then

        f(S) = Σ_t f_t(S) ≤ Σ_r λ_r constant_r + Σ_{j ∈ S} worth_j,  worth = Σ_r λ_r coefficient_r,

    and the right side is maximised exactly over placements. So any multipliers whatever give a
    valid bound; a linear program's dual values give the best. Samples without cuts count as 0:
    only samples that no candidate sees may lack one.

    `price` (r,) ≥ 0 prices the side rows A x ≤ b of `choice`, which every placement keeps: then
    worth − Aᵀ price takes the place of worth, and price·b is added. No price ignores them.

    Return the bound, and how much lower it is for placements that hold each candidate (c,): a
    candidate whose loss exceeds bound − incumbent can be left out (reduced-cost fixing).
    """
    share = normalised(cuts.sample, multiplier, n_samples)
    row = np.repeat(share, np.diff(cuts.indptr))
    n = len(choice.group)
    worth = np.bincount(cuts.candidate, row * cuts.coefficient, n).astype(np.float64)
    # A sum of n non-negative products: relative error at most n ulp.
    entries = np.bincount(cuts.candidate, minlength=n).astype(np.float64)
    worth = worth * (1.0 + _EPS * (2.0 + entries))
    constant = sum_up(share * cuts.constant, 4 * _EPS)
    if price is None or not len(choice.side_limits) or not np.any(price > 0.0):
        chosen, loss = best_choice(choice, worth)
        return sum_up(np.append(worth[chosen], constant), _EPS), loss
    fair = np.maximum(np.where(np.isfinite(price), price, 0.0), 0.0)
    charge = choice.side_matrix.T @ fair
    chosen, loss = best_choice(choice, worth - charge)
    paid = fair * choice.side_limits
    terms = np.concatenate([worth[chosen], -charge[chosen], [constant, math.fsum(paid)]])
    # Sums of non-negative products again, of as many terms as there are rows.
    return sum_up(terms, _EPS * (4 + len(paid))), loss


def normalised(sample: np.ndarray, multiplier: FloatArray, n_samples: int) -> FloatArray:
    """Make the multipliers (m,) of each sample's cuts non-negative with sum at least 1, barely."""
    share = np.maximum(np.where(np.isfinite(multiplier), multiplier, 0.0), 0.0)
    total = np.bincount(sample, share, n_samples)
    first = np.zeros(len(sample), dtype=np.bool_)
    first[np.unique(sample, return_index=True)[1]] = True
    # No multiplier at all: the sample's first cut stands alone.
    share = np.where((total[sample] > 0.0) | ~first, share, 1.0)
    total = np.where(total > 0.0, total, 1.0)
    counts = np.bincount(sample, minlength=n_samples)
    # Rounded up: terms and coefficients are non-negative, so a sum just above 1 is still valid.
    shares: FloatArray = share / total[sample] * (1.0 + _EPS * (2 + counts[sample]))
    return shares


def sum_up(terms: FloatArray, relative: float) -> float:
    """Return an upper bound on Σ terms when each may be off by `relative` of itself.

    The sum itself is exact (`math.fsum`) and rounded up.
    """
    total = math.fsum(terms)
    slack = relative * math.fsum(np.abs(terms))
    return math.nextafter(total + slack, math.inf) if slack else total
