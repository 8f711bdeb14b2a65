"""Cuts on a score as a whole, for objectives that are no sum over samples: `entropy`.

The same two inequalities as in `placement.bounds.cuts`, with f itself in place of a sample's term:

    f(S) ≤ f(R) + Σ_{j ∈ S∖R} gain(j | R)                the *submodular* cut at a set R,
    f(S) ≤ f(x°) + Σ_j ∂_j f(x°) (1_S − x°)_j            the *tangent* cut at any x° ≥ 0.

They are far weaker than one cut a sample: where windows are short a sum of logarithms is not the
logarithm of a sum. Where odometry couples the whole road there are no samples to speak of.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.bounds.cuts import Cuts, joined
from placement.objectives.base import Objective, Relaxable

# Relative error of a score and of its gains and slopes: sums of some thousand logarithms.
ERROR = 1e-11
WHOLE = 1e-9  # an x within this of 0 or 1 is taken for it


@runtime_checkable
class Whole(Objective, Relaxable, Protocol):
    """A submodular score with a concave extension."""


class WholeCutMaker:
    """Make cuts of one objective, all of "sample" 0."""

    def __init__(self, objective: Whole) -> None:
        """Keep the objective; raises ValueError where it is not submodular."""
        if not objective.submodular:
            raise ValueError(f"cuts need a submodular objective, got {objective.name}")
        self.objective = objective

    def submodular(self, selected: IntArray) -> Cuts:
        """Return the cut at R = `selected`, tight there."""
        state = self.objective.state(np.sort(selected))
        gains = np.maximum(state.gains(), 0.0)
        gains[selected] = 0.0
        return self._cut(state.score, 0.0, gains)

    def tangent(self, x: FloatArray) -> Cuts:
        """Return the tangent at `x` (c,), tight there."""
        score, slope = self.objective.relaxed(x)
        return self._cut(score, float(slope @ x), np.maximum(slope, 0.0))

    def separate(self, x: FloatArray, level: FloatArray, by: float) -> Cuts:
        """Return the cuts at and near `x` (c,) that `level` (1,) exceeds there by more than `by`.

        They are the tangent at x and the submodular cut at its heaviest candidates.
        """
        x = np.where(x < WHOLE, 0.0, np.where(x > 1.0 - WHOLE, 1.0, x))
        count = max(round(float(x.sum())), 0)
        heaviest = np.argsort(-x, kind="stable")[:count]
        found = joined([self.tangent(x), self.submodular(heaviest[x[heaviest] > 0.0])])
        return found.subset(level[found.sample] > found.at(x) + by)

    def _cut(self, score: float, inner: float, coefficient: FloatArray) -> Cuts:
        """Return constant = score − inner and the coefficients, all rounded up."""
        seen = np.flatnonzero(coefficient)
        # a concave score that is 0 at x = 0 has tangents that are at least 0 there
        constant = max(score - inner + ERROR * (abs(score) + abs(inner)), 0.0)
        return Cuts(
            np.zeros(1, dtype=np.int64),
            np.array([constant]),
            np.array([0, seen.size], dtype=np.int64),
            seen.astype(np.int32),
            coefficient[seen] * (1.0 + ERROR) + ERROR * abs(score) / max(len(coefficient), 1),
        )
