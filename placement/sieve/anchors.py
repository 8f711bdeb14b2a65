"""Few classes for many: members pay for what their class knows more than they do.

A car that comes with information T about the state (what it brings and what the camera in between
tells) lets whoever follows gain log det(I + T⁻¹ Δ), Δ ⪰ 0 what they tell. Between two of them

    log det(I + T_i⁻¹ Δ) − log det(I + T_c⁻¹ Δ) ≤ δ = Σ log max(1, λ),   λ of T_i⁻¹ T_c,

so i may pass for the class of an *anchor* c if δ is added to its value. It looks better by at most
Σ |log λ| for that. Anchors are chosen one after another where that makes a member look best; who
looks worse than the best there is by more than can be wasted is told apart no further.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from placement.diagram.order import by_root, jacobi
from placement.objectives.windows.filter import row6

LARGEST = 1e8  # of eigenvalues that are worth having
QUICK = 100.0  # up to this the quick eigenvalues are off by no more than a hair
HAIR = 1e-5  # added to what a member pays, for rounding to float32


@njit(cache=True)
def choose_anchors(information, value, weight, spare, most, chosen, group, extra):  # type: ignore[no-untyped-def]
    """Choose at most `most` anchors; return how many, their members in `chosen`.

    `information` (q, 6) and `value` (q,) are the members'; gains count `weight` times. Fills
    `group` (q,) with the number of each one's anchor, −1 where it can pass for none, and `extra`
    (q,) with what it pays. Who looks worse than the best by `spare` is told apart no further.
    """
    q = value.size
    group[:] = -1
    extra[:] = 0.0
    if q == 0:
        return 0
    looks, apart_from = np.full(q, np.inf), np.full(q, np.inf)
    m, v = np.empty((3, 3)), np.empty((3, 3))
    best = np.max(value)
    found = 0
    for c in range(most):
        a = int(np.argmax(value))
        if c > 0:
            a, worst = -1, best - spare
            for i in range(q):
                if apart_from[i] > 0.0 and looks[i] > worst:
                    a, worst = i, looks[i]
            if a < 0:
                break
        chosen[c] = a
        found = c + 1
        anchor = row6(information, a)
        for i in range(q):
            if looks[i] <= best - spare:
                continue
            if i == a:
                pays, apart = 0.0, 0.0
            else:
                useful, _ = by_root(row6(information, i), anchor, LARGEST, m)
                if not useful:
                    continue
                pays, apart = 0.1 * HAIR, 0.0
                if m[0, 0] + m[1, 1] + m[2, 2] > QUICK:
                    jacobi(m, v)
                    found_three = m[0, 0], m[1, 1], m[2, 2]
                else:
                    found_three = eigenvalues(m)
                for eigenvalue in found_three:
                    distance = math.log(max(eigenvalue, 1.0 / LARGEST))
                    pays += weight * max(distance, 0.0) * (1.0 + HAIR)
                    apart += weight * abs(distance)
            if value[i] + apart < looks[i]:
                looks[i], group[i], extra[i] = value[i] + apart, c, pays
                apart_from[i] = apart
        if looks[a] == np.inf:
            # an anchor stands for itself, whatever its covariance
            looks[a], group[a], extra[a], apart_from[a] = value[a], c, 0.0, 0.0
    return found


@njit(cache=True)
def eigenvalues(m):  # type: ignore[no-untyped-def]
    """Return the eigenvalues of a symmetric 3×3 matrix, to 1e-8 of the largest (Smith 1961)."""
    q = (m[0, 0] + m[1, 1] + m[2, 2]) / 3.0
    a, b, c = m[0, 0] - q, m[1, 1] - q, m[2, 2] - q
    d, e, f = m[0, 1], m[0, 2], m[1, 2]
    p = math.sqrt((a * a + b * b + c * c + 2.0 * (d * d + e * e + f * f)) / 6.0)
    if p <= 1e-15 * abs(q):
        return q, q, q
    det = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    angle = math.acos(min(max(0.5 * det / (p * p * p), -1.0), 1.0)) / 3.0
    most = q + 2.0 * p * math.cos(angle)
    least = q + 2.0 * p * math.cos(angle + 2.0 * math.pi / 3.0)
    return most, 3.0 * q - most - least, least
