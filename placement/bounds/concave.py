"""The best fractional choice of a concave score, by Newton steps on the poses that matter.

    max f(x)  over  0 ≤ x ≤ 1, Σ x ≤ k, at most one of each group, required candidates at 1

Few poses carry weight at the optimum (some 130 of 10,440), so the problem is solved over a growing
handful. There each Newton step maximises the quadratic model over the polytope by exchanges: a
matroid's polytope has edges e_i − e_j and e_i only, so exchanging weight between two poses
reaches its optimum (Edmonds 1970). A line search on f itself follows. Where a Hessian by
differences would take too long, the objective is asked for one that is nearly right; failing that,
it is learnt on the way.

No step is believed. Every x carries its own certificate, over all candidates and exactly,

    f(S) ≤ f(x) + Σ_{j ∈ S} ∂_j f(x) − ∂f(x)·x   for every placement S,

and the same tangent says how much less a placement is worth that *holds* candidate j: whoever
cannot beat the incumbent is left out (reduced-cost fixing). On `winding` with `entropy` the bound
is optimal to 1e-5 within 0.3 s, where two hundred conditional-gradient steps (Frank & Wolfe 1956)
are 1–2 % off.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from models.geometry import FloatArray, IntArray
from placement.bounds.matroid import Choice, best_choice, restricted_choice, without
from placement.bounds.restrict import narrowed
from placement.bounds.tangent import GAIN_ERROR, sum_up
from placement.objectives.base import Curved, Relaxable
from placement.problem import Run

NEWTON_STEPS = 25
SECANT_STEPS = 30
STIFFER = 3  # times that a step which came to nothing is tried with ten times the curvature
FAINT = 1e-3  # of a camera: less is left out where looks are dear
DEAR_S = 5.0  # a Hessian by differences that would take longer is not computed
EXCHANGES = 20_000
ROUNDS = 40
SLACK = 1e-9  # who is left out must miss the incumbent times 1 + this
_DIFFERENCE = 1e-6  # step of the finite differences that give the Hessian
_WHOLE = 1e-12


@dataclass(frozen=True, slots=True)
class Fraction:
    """A fractional choice x (c,), its score, a bound on every placement, and who is still in."""

    x: FloatArray
    score: float
    bound: float
    choice: Choice


def best_fraction(
    objective: Relaxable,
    choice: Choice,
    run: Run,
    *,
    beat: float = -np.inf,
    start: IntArray | FloatArray | None = None,
    tolerance: float = 1e-6,
    report: Callable[[float], None] = lambda _bound: None,
) -> Fraction:
    """Maximise the concave extension over the placements of `choice`, to `tolerance` relative.

    `start` is a placement to begin from, or a fractional choice (c,) of floats. Candidates that no
    placement scoring more than `beat` can hold are struck from the `choice` returned; the bound
    holds for all placements of the choice given. `report` is told each better bound. Stops early
    when `run` is out of time, with whatever it has: any x is certified.
    """
    c = len(choice.group)
    if start is not None and start.dtype.kind == "f":
        x = np.array(start, dtype=np.float64)
    else:
        x = np.zeros(c)
        x[best_choice(choice, np.zeros(c))[0] if start is None else start] = 1.0
    best_x, best_score, best, floor = x, -np.inf, np.inf, -np.inf
    for _ in range(ROUNDS):
        score, slope = objective.relaxed(x)
        chosen, loss = best_choice(choice, slope)
        bound = sum_up(np.concatenate([[score], -slope * x, slope[chosen]]), GAIN_ERROR)
        bound = max(bound, floor)
        if bound < best:
            best_x, best_score, best = x, score, bound
            report(best)
        if np.isfinite(beat):
            # who is struck may hold placements of up to `beat`, so no later bound is below that
            floor = beat + SLACK * abs(beat)
            choice = without(choice, choice.allowed & (loss > bound - floor))
            if not choice.feasible:
                return Fraction(best_x, best_score, min(best, floor), choice)
            x = _over_allowed(x, choice, slope)
        if bound - score <= tolerance * abs(score) or run.out_of_time():
            break
        near = np.flatnonzero(choice.allowed & (loss <= 0.3 * (bound - score)))
        near = near[np.argsort(loss[near], kind="stable")][: max(100, 2 * choice.budget)]
        keep = np.unique(np.concatenate([np.flatnonzero(x > 0.0), chosen, near]))
        small, small_choice = narrowed(objective, keep, c), restricted_choice(choice, keep)
        wanted = max(0.05 * (bound - score) / max(abs(score), 1e-300), 0.3 * tolerance)
        found = _newton(small, small_choice, x[keep], wanted, run)
        if found is None:
            break
        x = np.zeros(c)
        x[keep] = found
    return Fraction(best_x, best_score, best, choice)


def _over_allowed(x: FloatArray, choice: Choice, slope: FloatArray) -> FloatArray:
    """Return `x` without those struck out; groups that must be full give theirs to their best."""
    if np.all(choice.allowed | (x == 0.0)):
        return x
    x = np.where(choice.allowed, x, 0.0)
    held = np.bincount(choice.group, x, len(choice.used))
    for group in np.flatnonzero(choice.used & (held < 1.0)):
        members = np.flatnonzero((choice.group == group) & choice.allowed)
        x[members[np.argmax(slope[members])]] += 1.0 - held[group]
    return x


def _newton(
    objective: Relaxable, choice: Choice, x: FloatArray, tolerance: float, run: Run
) -> FloatArray | None:
    """Climb from `x` over few candidates until the tangent bound is within `tolerance`."""
    started = time.monotonic()
    score, slope = objective.relaxed(x)
    # where gradients are dear (persistent offsets: half a second), ask the objective how they
    # change, or learn it on the way
    dear = (time.monotonic() - started) * x.size > DEAR_S
    everyone = np.arange(x.size)
    told = objective.curvature(x, everyone) if dear and isinstance(objective, Curved) else None
    secant = dear and told is None
    # along one axis log det(I + x M) has slope tr M and curvature −tr M², at most the square
    curvature: FloatArray | None = -0.5 * np.diag(slope**2)
    moved, stiffer = False, 0
    for _ in range(SECANT_STEPS if secant else NEWTON_STEPS):
        gap = float(slope[best_choice(choice, slope)[0]].sum() - slope @ x)
        if gap <= tolerance * abs(score) or run.out_of_time():
            break
        if told is not None and isinstance(objective, Curved):
            curvature = objective.curvature(x, everyone) if moved else told
        elif not secant:
            curvature = _hessian(objective, x, slope, run)
        if curvature is None:
            break
        y = x.copy()
        held = np.bincount(choice.group, x, len(choice.used)).astype(np.float64)
        mandatory = choice.used[choice.group]
        settle = 1e-3 * gap / max(choice.budget, 1)
        budget = float(choice.budget)
        exchange(
            y, slope.copy(), curvature, choice.group, mandatory, held, budget, settle, EXCHANGES
        )
        if secant:
            y[y < FAINT] = 0.0  # each camera in view adds its offsets to the filter's state
        y, new_score, new_slope = _search_line(objective, x, y, score, slope, run)
        if not new_score > score:
            # a curvature that was only guessed, or learnt far away, may be too slight
            if not secant or stiffer == STIFFER:
                break
            curvature, stiffer = 10.0 * curvature, stiffer + 1
            continue
        if secant:
            curvature = _learnt(curvature, y - x, new_slope - slope)
        x, score, slope, moved = y, new_score, new_slope, True
    return x if moved else None


def _learnt(curvature: FloatArray, step: FloatArray, change: FloatArray) -> FloatArray:
    """Return the curvature after one step's change of slope (BFGS: Nocedal & Wright 2006, 6.19)."""
    along = float(step @ change)
    bent = curvature @ step
    known = float(step @ bent)
    if not (along < 0.0 and known < 0.0):
        return curvature
    learnt: FloatArray = curvature - np.outer(bent, bent) / known + np.outer(change, change) / along
    return learnt


def _hessian(objective: Relaxable, x: FloatArray, slope: FloatArray, run: Run) -> FloatArray | None:
    """Return the Hessian (n, n) by differences of the gradient; None if time runs out."""
    n = x.size
    found = np.empty((n, n))
    for i in range(n):
        if run.out_of_time():
            return None
        y = x.copy()
        y[i] += _DIFFERENCE
        found[:, i] = (objective.relaxed(y)[1] - slope) / _DIFFERENCE
    return 0.5 * (found + found.T)


def _search_line(
    objective: Relaxable,
    x: FloatArray,
    y: FloatArray,
    score: float,
    slope: FloatArray,
    run: Run,
) -> tuple[FloatArray, float, FloatArray]:
    """Return the point between x and y where the score stops rising, its score and gradient."""
    direction = y - x
    low, high = 0.0, 1.0
    at_low = at_start = float(slope @ direction)
    at_y, slope_y = objective.relaxed(y)
    at_high = float(slope_y @ direction)
    if at_high >= 0.0 or not at_low > 0.0:
        return y, at_y, slope_y
    best = (x, score, slope)
    for _ in range(8):  # regula falsi, kept off the ends
        step = low + (high - low) * at_low / (at_low - at_high)
        step = min(max(step, low + 0.05 * (high - low)), high - 0.05 * (high - low))
        z = np.maximum(x + step * direction, 0.0)
        at_z, slope_z = objective.relaxed(z)
        if at_z > best[1]:
            best = (z, at_z, slope_z)
        rise = float(slope_z @ direction)
        if abs(rise) <= 0.1 * at_start or run.out_of_time():
            break
        if rise > 0.0:
            low, at_low = step, rise
        else:
            high, at_high = step, rise
    return best


@njit(cache=True)
def exchange(x, slope, curvature, group, mandatory, held, budget, tolerance, most):  # type: ignore[no-untyped-def]
    """Maximise slope·d + ½ dᵀ curvature d over the polytope by exchanges, in place on `x` (n,).

    `held` (g,) are the groups' sums, `mandatory` (n,) marks members of groups that must stay full.
    Stops when no exchange gains more than `tolerance` per unit of weight.
    """
    n, groups = x.size, held.size
    up, down = np.empty(groups, np.int64), np.empty(groups, np.int64)
    total = x.sum()
    for _ in range(most):
        up[:], down[:] = -1, -1
        into, out = -1, -1  # the best to gain weight from, and to lose weight to, another group
        for a in range(n):
            g = group[a]
            if up[g] < 0 or slope[a] > slope[up[g]]:
                up[g] = a
            if held[g] < 1.0 - _WHOLE and (into < 0 or slope[a] > slope[into]):
                into = a
            if x[a] > 0.0:
                if down[g] < 0 or slope[a] < slope[down[g]]:
                    down[g] = a
                if not mandatory[a] and (out < 0 or slope[a] < slope[out]):
                    out = a
        if total < budget - _WHOLE and into >= 0 and slope[into] > tolerance:
            step = min(budget - total, 1.0 - held[group[into]])
            if curvature[into, into] < 0.0:
                step = min(step, -slope[into] / curvature[into, into])
            x[into] += step
            held[group[into]] += step
            total += step
            for a in range(n):
                slope[a] += step * curvature[a, into]
            continue
        best = slope[into] - slope[out] if into >= 0 and out >= 0 else -np.inf
        i, j = into, out
        for g in range(groups):
            if up[g] >= 0 and down[g] >= 0 and slope[up[g]] - slope[down[g]] > best:
                best = slope[up[g]] - slope[down[g]]
                i, j = up[g], down[g]
        if not best > tolerance:
            return
        step = x[j]
        if group[i] != group[j]:
            step = min(step, 1.0 - held[group[i]])
        bend = curvature[i, i] - 2.0 * curvature[i, j] + curvature[j, j]
        if bend < 0.0:
            step = min(step, -best / bend)
        x[i] += step
        x[j] = x[j] - step if step < x[j] else 0.0
        held[group[i]] += step
        held[group[j]] -= step
        for a in range(n):
            slope[a] += step * (curvature[a, i] - curvature[a, j])
