"""Draw small problems that are as unpleasant as problems get: oracles enumerate their placements.

Every seed is another problem: a kind (`localisation`, `entropy`, `trace`, the bare `log_det`), and
any mixture of blocks from 1e-18 to 1e18, duplicate and blind candidates, information in one
direction only, windows three and four deep or across the seam, budgets of nothing and of
everything, groups of one, of all and of some, required and forbidden poses, prices of 0 and 1e9
with more or less money, and separations. Some contradict themselves, and say so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.synthetic_drives import CAR, ROBOT, random_drive
from models.geometry import FloatArray, IntArray
from placement.bounds.restrict import restricted_information
from placement.constraints import Constraints
from placement.information import Information
from placement.objectives.base import Objective
from placement.objectives.entropy import Entropy
from placement.objectives.localisation import Localisation
from placement.objectives.log_det import LogDet
from placement.objectives.trace import Trace
from placement.problem import Problem

KINDS = ("localisation", "entropy", "trace", "log_det")
PRICES = (0.0, 0.1, 1.0, 2.0, 3.0, 1e9)
MOST_CANDIDATES = 8


@dataclass(frozen=True, slots=True)
class Rules:
    """What `placement.constraints.Constraints` is made of, whether or not it makes sense."""

    n: int
    budget: int
    group: IntArray
    required: IntArray
    forbidden: IntArray
    cost: FloatArray | None
    money: float
    place_m: FloatArray | None
    separation_m: float

    def constraints(self) -> Constraints:
        """Check and make them; raises `Infeasible` where they contradict each other."""
        fields: dict[str, Any] = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return Constraints(**fields)

    def contradictory(self) -> bool:
        """Say so by the definition: leaving cameras out never hurts, so look at the required."""
        chosen = sorted({int(i) for i in self.required})
        if len(chosen) > self.budget or set(chosen) & {int(i) for i in self.forbidden}:
            return True
        if self.cost is not None and sum(self.cost[i] for i in chosen) > self.money * (1 + 1e-9):
            return True
        for at, i in enumerate(chosen):
            for j in chosen[:at]:
                if self.group[i] == self.group[j] >= 0:
                    return True
                if self.place_m is not None and self.separation_m > 0.0:
                    apart = math.dist(self.place_m[i], self.place_m[j])
                    if 1e-6 < apart < self.separation_m * (1.0 - 1e-9):
                        return True
        return False


def hostile_problem(seed: int, kind: str | None = None) -> tuple[Objective, Rules]:
    """Draw the objective and the rules of one problem; `kind` instead of the seed's own."""
    rng = np.random.default_rng([seed, 2718])
    kind = kind or KINDS[seed % len(KINDS)]
    n = int(rng.integers(1, MOST_CANDIDATES + 1))
    return hostile_objective(rng, kind, n), hostile_rules(rng, n)


def as_problem(objective: Objective, rules: Rules) -> Problem:
    """Put both together; raises `Infeasible` where the rules contradict each other."""
    place: FloatArray = 3.0 * (np.arange(rules.n) // 2).astype(np.float64)
    return Problem(objective, rules.constraints(), place, max(3.0 * rules.n, 1.0))


def hostile_objective(rng: np.random.Generator, kind: str, n: int) -> Objective:
    """Draw an objective of `kind` over n candidates."""
    if kind == "log_det":
        return _log_det(rng, n)
    # a filter's covariances span fewer decades than the logarithm of one sum
    decades = 18.0 if kind == "localisation" else 7.0
    extreme = rng.uniform() < 0.15
    strength = 10.0 ** (rng.uniform(-decades, decades) if extreme else rng.uniform(-1.0, 4.0))
    drives = []
    for number in range(2 if kind != "localisation" and rng.uniform() < 0.15 else 1):
        drive = random_drive(
            rng,
            n_samples=int(rng.integers(3, 24)),
            n_candidates=n,
            isotropic=bool(rng.integers(2)),
            offsets=2 if kind != "localisation" and rng.uniform() < 0.15 else 0,
            longest_window=int(rng.integers(1, 14)),
            wrap=bool(rng.integers(2)),
            odometry=(CAR, ROBOT)[int(rng.integers(2))],
            initial_sigma=(0.1, 0.1, float(rng.choice([0.0, 0.02]))),
            strength=strength,
        )
        drives.append(
            replace(drive, information=_spoilt(rng, drive.information), weight=1 + number)
        )
    if kind == "localisation":
        weights = rng.choice([0.0, 0.5, 1.0, 7.0], drives[0].information.n_samples)
        plain = replace(
            drives[0].information, frames_per_sample=float(rng.choice([0.1, 1.0, 30.0]))
        )
        return Localisation(plain, 0.5, weights if rng.uniform() < 0.3 else None)
    if kind == "entropy":
        return Entropy(drives)
    return Trace(drives, ("position", "lateral")[int(rng.integers(2))])


def hostile_rules(rng: np.random.Generator, n: int) -> Rules:
    """Draw the rules; about one in eight contradicts itself."""
    none = np.empty(0, dtype=np.int64)
    group = (
        np.full(n, -1),
        np.arange(n) // 2,
        np.arange(n),
        np.zeros(n, dtype=np.int64),
        rng.integers(-1, 3, n),
    )[int(rng.integers(5))]
    budget = int(rng.choice([0, 1, 2, 3, 4, n, 10**6], p=[0.05, 0.1, 0.25, 0.25, 0.15, 0.15, 0.05]))
    required = rng.permutation(n)[: rng.integers(0, 3)] if rng.uniform() < 0.3 else none
    forbidden = rng.permutation(n)[: rng.integers(0, n + 1)] if rng.uniform() < 0.25 else none
    cost, money = None, math.inf
    if rng.uniform() < 0.35:
        cost = rng.choice(PRICES, n, p=[0.15, 0.15, 0.25, 0.2, 0.15, 0.1])
        money = float(rng.choice([0.0, 0.3, 1.0, 2.0, 4.0, 1e9, 2.0000001e9, math.inf]))
    place_m, separation_m = None, 0.0
    if rng.uniform() < 0.3:
        # places of one or two candidates, some of them nearly on top of each other
        spots = np.column_stack([2.0 * np.arange(n), rng.choice([0.0, 1e-7, 3.0], n)])
        place_m = spots[np.arange(n) // int(rng.integers(1, 3))]
        separation_m = float(rng.choice([1e-3, 2.0, 5.0, 1e6]))
    return Rules(
        n,
        budget,
        group.astype(np.int64),
        np.sort(required).astype(np.int64),
        np.sort(forbidden).astype(np.int64),
        cost,
        money,
        place_m,
        separation_m,
    )


def _log_det(rng: np.random.Generator, n: int) -> LogDet:
    states, rank = int(rng.integers(1, 6)), int(rng.integers(1, 4))
    decades = 5.0 if rng.uniform() < 0.2 else 1.0
    factors = rng.normal(size=(n, states, rank)) * 10.0 ** rng.uniform(-decades, decades, (n, 1, 1))
    factors[rng.uniform(size=n) < 0.15] = 0.0
    factors = factors[rng.integers(0, n, n)] if rng.uniform() < 0.3 else factors
    if rng.uniform() < 0.2:
        factors[:, -1, :] = 0.0  # a direction that nobody sees
    return LogDet(10.0 ** rng.uniform(-6.0, 2.0) * np.eye(states), factors)


def _spoilt(rng: np.random.Generator, information: Information) -> Information:
    """Make some candidates copies of others, and some blind or worth nothing."""
    n = information.n_candidates
    if rng.uniform() < 0.3:
        information = restricted_information(information, rng.integers(0, n, n))
    if rng.uniform() < 0.3:
        blocks = information.blocks.copy()
        dark = np.repeat(rng.uniform(size=n) < 0.3, np.diff(information.indptr))
        blocks[dark] = 0.0
        white = None if information.white is None else blocks
        information = replace(information, blocks=blocks, white=white)
    if rng.uniform() < 0.2:
        blind = rng.uniform(size=n) < 0.3
        lengths = np.where(blind, 0, np.diff(information.indptr))
        kept = ~np.repeat(blind, np.diff(information.indptr))
        offsets, white = information.offsets, information.white
        information = replace(
            information,
            indptr=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
            indices=information.indices[kept],
            blocks=information.blocks[kept],
            white=None if white is None else white[kept],
            offsets=None if offsets is None else offsets[kept],
        )
    return information
