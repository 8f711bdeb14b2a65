from __future__ import annotations

import itertools

import numpy as np
import pytest

from placement.assemble import assemble
from placement.instance import Instance, instance_from_dict
from placement.referee.bounds import Knapsack, score_bound
from placement.referee.values import rebuild


def tiny(kind: str, model: str) -> Instance:
    return instance_from_dict(
        {
            "road": {"pieces": [{"length": 30.0}, {"length": 30.0, "curvature": 0.02}]},
            "mounts": {"spacing_m": 20.0},
            "camera": {"yaw_deg": [0, 180], "pitch_deg": [35], "fov_deg": [[60, 45]]},
            "errors": {"model": model, "persistent": False},
            "vehicle": {"profile": "robot"},
            "objective": {"kind": kind},
            "budget": {"cameras": 3},
        }
    )


@pytest.mark.parametrize("model", ["radius", "covariance"])
@pytest.mark.parametrize("kind", ["localisation", "entropy", "trace", "final_entropy"])
def test_the_referees_bound_lies_beyond_every_placement(kind: str, model: str) -> None:
    instance = tiny(kind, model)
    scene = assemble(instance)
    f, rules = scene.problem.objective, scene.problem.constraints
    sign = 1.0 if f.maximise else -1.0
    best = max(
        sign * f.value(np.array(chosen))
        for chosen in itertools.combinations(range(f.n_candidates), 3)
        if not rules.violations(chosen)
    )
    knapsack = Knapsack(rules.usable(), rules.group, rules.budget)
    bound = score_bound(rebuild(instance), scene.candidates, knapsack, [0, 5, 9])
    assert bound is not None
    assert best <= bound + 1e-6 * abs(best)
    if kind == "localisation":  # cameras 20 m apart overlap little: the bound must be of use
        assert bound < 1.3 * best


def test_persistent_errors_give_no_cheap_bound() -> None:
    instance = tiny("trace", "covariance").changed({"errors.persistent": True})
    scene = assemble(instance)
    rules = scene.problem.constraints
    knapsack = Knapsack(rules.usable(), rules.group, rules.budget)
    assert score_bound(rebuild(instance), scene.candidates, knapsack, [0]) is None


def test_the_knapsack_never_undervalues_what_money_can_buy() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        n = 8
        worth, cost = rng.normal(1.0, 1.0, n), rng.choice([0.0, 1.0, 2.5, 1e9], n)
        money, budget = float(rng.choice([0.0, 3.0, 1e9])), int(rng.integers(1, 5))
        group = rng.integers(-1, 3, n)
        best = max(
            sum(worth[list(s)])
            for size in range(budget + 1)
            for s in itertools.combinations(range(n), size)
            if sum(cost[list(s)]) <= money
            and all(np.sum(group[list(s)] == g) <= 1 for g in range(3))
        )
        most = Knapsack(np.ones(n, dtype=np.bool_), group, budget, cost, money).most(worth)
        assert most >= best - 1e-9 * (1.0 + abs(best))
