"""A bound of the referee's own: tangents of the concave relaxation, and diminishing returns.

For the objectives whose cameras err afresh in every frame, the score extends concavely to
fractional choices x, and a tangent at any x whatever lies above every placement:

    f(T) ≤ f(x) + Σ_{j ∈ T} slope_j − Σ_j x_j slope_j ≤ f(x) − slope·x + (best sum of slopes)

x is improved by plain Frank–Wolfe steps. For `localisation` there is also f(T) ≤ f(R) + the best
sum of gains over R, for R from nothing to the whole selection. Both ignore what the best sum cannot
express, which keeps them valid.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.geometry import BoolArray, FloatArray, IntArray
from placement.assemble import build_errors
from placement.candidates import Candidates
from placement.referee.drive import steps
from placement.referee.values import Scene
from placement.referee.views import Views

ROUNDS = 60
SLACK = 1e-9  # relative, for rounding in sums of this length


@dataclass(frozen=True, slots=True)
class Knapsack:
    """What the best sum knows of the rules: a count, one of each group, and money."""

    allowed: BoolArray
    group: IntArray
    budget: int
    cost: FloatArray | None = None
    money: float = math.inf

    def best(self, worth: FloatArray) -> IntArray:
        """Return the candidates of the greatest sum, money aside."""
        order = np.argsort(-np.where(self.allowed, worth, -np.inf), kind="stable")
        order = order[(worth[order] > 0.0) & self.allowed[order]]
        key = np.where(self.group < 0, -1 - np.arange(len(worth)), self.group)[order]
        first = np.sort(np.unique(key, return_index=True)[1])
        return order[first][: self.budget]

    def most(self, worth: FloatArray) -> float:
        """Return an upper bound on the sum of any placement, each camera priced at λ a unit."""
        if self.cost is None or math.isinf(self.money):
            return math.fsum(worth[self.best(worth)])
        cost = self.cost

        def priced(price: float) -> tuple[float, float]:
            chosen = self.best(worth - price * cost)
            total = math.fsum(worth[chosen] - price * cost[chosen]) + price * self.money
            return total, math.fsum(cost[chosen])

        positive = self.allowed & (worth > 0.0) & (cost > 0.0)
        low, high = 0.0, float(np.max(worth[positive] / cost[positive], initial=0.0))
        bound = priced(0.0)[0]
        for _ in range(60):
            middle = 0.5 * (low + high)
            total, spent = priced(middle)
            bound = min(bound, total)
            low, high = (middle, high) if spent > self.money else (low, middle)
        return bound


def score_bound(
    scene: Scene,
    candidates: Candidates,
    knapsack: Knapsack,
    selected: Sequence[int],
    seconds: float = 20.0,
) -> float | None:
    """Return an upper bound on the score of every placement; None where none is cheap.

    The score is the value, or minus the value where that is minimised. Stops after `seconds`.
    """
    instance = scene.instance
    errors = build_errors(instance)
    kind = instance.objective.kind
    if errors.splits and kind != "localisation":
        return None
    until = time.monotonic() + seconds
    views = Views(scene, candidates)
    score = _Localisation(scene) if kind == "localisation" else _Chain(scene)
    bound = math.inf
    if isinstance(score, _Localisation):
        bound = _by_diminishing_returns(score, views, knapsack, list(selected), until)
    x = np.zeros(len(candidates))
    for n in range(ROUNDS):
        value, slopes = score.at(views.total(x))
        slope = views.against(slopes)
        tangent = value - math.fsum(slope * x) + knapsack.most(slope)
        bound = min(bound, tangent + SLACK * (abs(value) + math.fsum(np.abs(slope * x))))
        if time.monotonic() > until:
            break
        corner = np.zeros(len(x))
        corner[knapsack.best(slope)] = 1.0
        x += 2.0 / (n + 2.0) * (corner - x)
    return bound + SLACK * abs(bound)


def _by_diminishing_returns(
    score: _Localisation, views: Views, knapsack: Knapsack, selected: list[int], until: float
) -> float:
    """Return the least of f(R) + best sum of gains over R, R growing through the selection.

    Any R bounds every placement, so it may stop `until` all are looked at.
    """
    chosen = np.zeros(len(knapsack.allowed))
    bound = math.inf
    while True:
        total = views.total(chosen)
        gains = np.where(chosen > 0.0, 0.0, score.gains(views, total))
        bound = min(bound, score.at(total)[0] + knapsack.most(gains))
        left = [i for i in selected if not chosen[i]]
        if not left or time.monotonic() > until:
            return bound
        chosen[left[int(np.argmax(gains[left]))]] = 1.0


class _Localisation:
    def __init__(self, scene: Scene) -> None:
        section = scene.instance.objective
        self.prior = np.eye(2) / section.prior_sigma_m**2
        self.log_prior = -4.0 * math.log(section.prior_sigma_m)
        t = len(scene.xy)
        self.weights = np.ones(t) if section.weights is None else np.array(section.weights)

    def at(self, total: FloatArray) -> tuple[float, FloatArray]:
        """Return the score at information `total` (t, 2, 2), and its derivative by it."""
        known = self.prior + total
        score = math.fsum(self.weights * (np.linalg.slogdet(known)[1] - self.log_prior))
        return score, self.weights[:, None, None] * np.linalg.inv(known)

    def gains(self, views: Views, total: FloatArray) -> FloatArray:
        """Return every candidate's gain (c,) over information `total`."""
        inverse = np.linalg.inv(self.prior + total)
        tt, tn, nn = (part.tocoo() for part in views.parts)
        i, t = tt.coords
        a, b = tt.data, nn.data
        off = np.zeros(len(a)) if not tn.nnz else np.asarray(views.parts[1][i, t]).ravel()
        p, q, r = inverse[t, 0, 0], inverse[t, 0, 1], inverse[t, 1, 1]
        # det(I + J Σ) of 2×2 matrices
        trace = a * p + 2.0 * off * q + b * r
        determinant = (a * b - off * off) * (p * r - q * q)
        logs = self.weights[t] * np.log1p(trace + np.maximum(determinant, 0.0))
        return np.bincount(i, logs, len(views.parts[0].indptr) - 1).astype(np.float64)


class _Chain:
    """The navigation objectives where every frame errs afresh, and their derivatives."""

    def __init__(self, scene: Scene) -> None:
        self.kind = scene.instance.objective.kind
        self.frames = scene.track.frames
        moves, noises = steps(scene.track)
        cos, sin = np.cos(scene.track.heading_rad), np.sin(scene.track.heading_rad)
        axes = np.tile(np.eye(3), (len(cos), 1, 1))
        axes[:, 0, 0] = axes[:, 1, 1] = cos
        axes[:, 1, 0], axes[:, 0, 1] = sin, -sin
        turned = np.transpose(axes, (0, 2, 1))
        # In road axes, as the candidates' blocks are.
        before = np.concatenate([axes[:1], axes[:-1]])
        self.moves = turned @ moves @ before
        self.noises = turned @ noises @ axes
        self.initial = np.diag(np.square(scene.track.initial_sigma))
        lateral = scene.instance.objective.weight == "lateral"
        self.weight = np.diag([0.0 if lateral else 1.0, 1.0, 0.0])

    def at(self, total: FloatArray) -> tuple[float, FloatArray]:
        """Return the score at one frame's information `total` (t, 2, 2), and its derivative."""
        J, t = self.frames * total, len(total)
        P, after, kept = self.initial, np.empty((t, 3, 3)), np.empty((t, 3, 3))
        own, told = np.zeros((t, 2, 2)), np.zeros((t, 2, 2))
        logs = np.zeros(t)
        for n in range(t):
            if n:
                P = self.moves[n] @ P @ self.moves[n].T + self.noises[n]
            gained = np.linalg.inv(np.eye(2) + P[:2, :2] @ J[n])
            A = np.eye(3)
            A[:, :2] -= P[:, :2] @ J[n] @ gained
            own[n], told[n] = gained @ P[:2, :2], J[n] @ gained
            logs[n] = -np.linalg.slogdet(gained)[1]
            P = A @ P
            P = 0.5 * (P + P.T)
            after[n], kept[n] = P, A
        score, by_end = self._score(after, logs)
        M, slopes = by_end, np.empty((t, 2, 2))
        entropy = self.kind == "entropy"
        for n in reversed(range(t)):  # M: the score's derivative by the covariance after sample n
            if self.kind == "trace":
                M = M - self.weight / t
            slopes[n] = -(after[n] @ M @ after[n])[:2, :2]
            N = kept[n].T @ M @ kept[n]
            if entropy:
                slopes[n] += own[n]
                N[:2, :2] += told[n]
            M = self.moves[n].T @ N @ self.moves[n]
        return score, self.frames * slopes

    def _score(self, after: FloatArray, logs: FloatArray) -> tuple[float, FloatArray]:
        if self.kind == "entropy":
            return math.fsum(logs), np.zeros((3, 3))
        if self.kind == "trace":
            return -float(np.mean(np.einsum("tij,ji->t", after, self.weight))), np.zeros((3, 3))
        log_det = float(np.linalg.slogdet(after[-1])[1])
        score = -0.5 * (3.0 * math.log(2.0 * math.pi * math.e) + log_det)
        return score, -0.5 * np.linalg.inv(after[-1])
