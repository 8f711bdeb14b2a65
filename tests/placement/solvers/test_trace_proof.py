"""What `auto` proves of `trace` where offsets persist, against every placement of tiny roads."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from placement.bounds.concave import best_fraction
from placement.bounds.matroid import root_choice
from placement.bounds.tangent import tangent_bound
from placement.constraints import count_only
from placement.objectives.trace import Trace
from placement.problem import Problem, Run
from placement.solvers.trace_proof import (
    DEAR_TOLERANCE,
    RELAXATION,
    TOLERANCE,
    solve_trace_proof,
)
from tests.placement.solvers.test_diagram import best_value, tiny

LIMITED = 60.0


def new_run(seconds: float = np.inf) -> Run:
    return Run(np.random.default_rng(0), deadline=time.monotonic() + seconds)


def persistent(seed: int) -> Problem:
    """Draw a tiny road; the offsets of every other one are slight."""
    objective, budget = tiny(5000 + seed, offsets=2)
    drive = objective.drives[0]
    info = drive.information
    assert info.offsets is not None
    offsets = info.offsets * np.float32(0.02 if seed % 2 else 1.0)
    slight = replace(drive, information=replace(info, offsets=offsets))
    return Problem(objective.over([slight]), count_only(7, budget))


@pytest.mark.parametrize("seconds", [np.inf, LIMITED])
def test_bounds_hold_with_the_diagram_and_without(seconds: float) -> None:
    left_out = 0
    for seed in range(30):
        problem, run = persistent(seed), new_run(seconds)
        best = best_value(problem.objective, problem.constraints.budget)
        found = solve_trace_proof(problem, run)
        value = problem.objective.value(np.array(found.selected, dtype=np.int64))
        assert run.score_bound is not None
        assert -run.score_bound <= best * (1.0 + 1e-9), seed
        assert value == pytest.approx(best, rel=0.05)
        for bound in found.stats["bounds"].values():
            assert bound <= best * (1.0 + 1e-9), seed
        left_out += "diagram" in found.stats
    assert 0 < left_out < 30


def test_the_relaxation_goes_on_from_where_offsets_were_known() -> None:
    better = 0
    for seed in range(0, 40, 2):
        problem = persistent(seed)
        objective, choice = problem.objective, root_choice(problem.constraints)
        assert isinstance(objective, Trace)
        found = solve_trace_proof(problem, new_run()).stats["bounds"][RELAXATION]
        whole = -best_fraction(objective, choice, new_run()).bound
        assert (1.0 - 1.5 * DEAR_TOLERANCE) * whole <= found <= whole * (1.0 + 1e-6)
        x = best_fraction(objective.offsets_known(), choice, new_run(), tolerance=TOLERANCE).x
        better += found > -1.01 * tangent_bound(objective, problem.constraints, x)
    assert better >= 4


def test_a_diagram_is_left_out_only_where_nothing_is_left_to_prove() -> None:
    for seed in range(30):
        problem = persistent(seed)
        found = solve_trace_proof(problem, new_run())
        bounds = dict(found.stats["bounds"])
        best = best_value(problem.objective, problem.constraints.budget)
        assert max(bounds.values()) <= best * (1.0 + 1e-9)
        if "diagram" in found.stats:
            assert max(bounds.values()) >= best * (1.0 - 2e-6)
        else:
            assert found.stats["bound_from"] in bounds
            assert len(bounds) == 3
