"""Instances that are drawn, not stored: bare information problems with fixed seeds.

Each function returns the arrays of `placement.information_problem`: prior, factors, budget, and
where they apply cost and group.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np


def gaussian(
    *, n: int, c: int, budget: int, prior: float, seed: int, rank: int = 1, groups: int = 0
) -> dict[str, Any]:
    """Draw c experiments with standard normal entries (n, rank) behind the prior `prior`·I.

    With `groups`, candidate i is of group i modulo that many, and each may be used once.
    """
    rng = np.random.default_rng([seed, n, c])
    arrays: dict[str, Any] = {
        "prior": prior * np.eye(n),
        "factors": rng.standard_normal((c, n, rank)),
        "budget": budget,
    }
    return arrays | ({"group": np.arange(c) % groups} if groups else {})


def fusion(*, n: int, c: int, money: float, seed: int) -> dict[str, Any]:
    """Draw sensors of differing price and quality for one correlated state (data fusion).

    The prior is ill-conditioned (1e4); a better sensor, of up to three measurements, costs more.
    """
    rng = np.random.default_rng([seed, n, c, 7])
    basis = np.linalg.qr(rng.standard_normal((n, n)))[0]
    prior = basis @ np.diag(np.logspace(-2.0, 2.0, n)) @ basis.T
    quality = rng.uniform(0.5, 3.0, c)
    factors = quality[:, None, None] * rng.standard_normal((c, n, 3))
    factors *= (np.arange(3) < rng.integers(1, 4, c)[:, None])[:, None, :]
    price = np.round(quality * rng.uniform(0.7, 1.3, c), 2)
    return {
        "prior": 0.5 * (prior + prior.T),
        "factors": factors,
        "budget": money,
        "cost": price,
    }


def spanning_tree(*, nodes: int, edges: int, prior: float = 1e-6) -> dict[str, Any]:
    """Choose edges of the complete graph for the greatest number of spanning trees.

    Incidence vectors with the last node grounded, so det(Σ a aᵀ) counts trees (Kirchhoff 1847).
    """
    pairs = list(itertools.combinations(range(nodes), 2))
    factors = np.zeros((len(pairs), nodes - 1, 1))
    for k, (i, j) in enumerate(pairs):
        factors[k, i, 0] = 1.0
        if j < nodes - 1:
            factors[k, j, 0] = -1.0
    return {"prior": prior * np.eye(nodes - 1), "factors": factors, "budget": edges}


def polynomial(*, degree: int, points: int, budget: int, prior: float = 1e-6) -> dict[str, Any]:
    """Choose points of [−1, 1] at which to measure a polynomial: nearly Legendre's extrema."""
    x = np.linspace(-1.0, 1.0, points)
    factors = np.polynomial.legendre.legvander(x, degree)[:, :, None]
    return {"prior": prior * np.eye(degree + 1), "factors": factors, "budget": budget}
