from __future__ import annotations

import itertools
import math
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from benchmarks.synthetic_drives import random_drive
from placement.budget_curve import budget_curve, parse_budgets
from placement.commands import solve_into, validate_in
from placement.constraints import count_only
from placement.objectives.trace import Trace
from placement.problem import Problem
from placement.solution import Solution
from placement.solve import solve
from placement.solvers.trace_curve import CurveProof
from placement.verify import verify_folder

NewProblem = Callable[..., Problem]
BruteForce = Callable[[Problem], tuple[float, tuple[int, ...]]]
SMALL = """
[road]
pieces = [{length=60}]
[mounts]
spacing_m = 20.0
[camera]
yaw_deg = [0, 180]
pitch_deg = [35]
[errors]
model = "radius"
[objective]
kind = "localisation"
"""


@pytest.fixture(scope="module")
def best_values() -> dict[tuple[int, bool, int], float]:
    """Keep what enumeration found of a problem, for every method that is held to it."""
    return {}


@pytest.mark.parametrize("method", ["greedy", "exchange", "mip", "uniform", "random"])
@pytest.mark.parametrize("priced", [False, True])
def test_every_budget_is_enclosed_and_the_curve_rises(
    new_problem: NewProblem,
    brute_force: BruteForce,
    best_values: dict[tuple[int, bool, int], float],
    method: str,
    priced: bool,
) -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        problem = new_problem(rng, n_candidates=9, groups=bool(seed % 2), budget=1)
        if priced:
            rules = replace(problem.constraints, cost=rng.integers(0, 4, 9) * 1.0, money=4.0)
            problem = replace(problem, constraints=rules)
        curve = budget_curve(problem, 1, 5, method)
        for n, found in enumerate(curve.solutions):
            each = replace(problem, constraints=replace(problem.constraints, budget=n + 1))
            if (seed, priced, n) not in best_values:
                best_values[seed, priced, n] = brute_force(each)[0]
            best = best_values[seed, priced, n]
            assert each.constraints.violations(found.selected) == []
            assert found.value == pytest.approx(
                problem.objective.value(np.array(found.selected)), rel=1e-12
            )
            assert found.bound is not None  # from the others, whatever the method
            assert found.value <= best * (1.0 + 1e-9)
            assert found.bound >= best * (1.0 - 1e-12)
        values = [s.value for s in curve.solutions]
        bounds = [s.bound for s in curve.solutions]
        assert values == sorted(values)
        assert bounds == sorted(bounds)  # type: ignore[type-var]


def test_a_minimised_curve_falls_and_claims_no_bound_it_has_not(
    new_problem: NewProblem, new_toy: Callable[..., object]
) -> None:
    base = new_problem(np.random.default_rng(1), n_candidates=8)
    problem = replace(base, objective=new_toy(base.objective.information))  # type: ignore[attr-defined]
    curve = budget_curve(problem, 2, 4, "greedy")
    values = [s.value for s in curve.solutions]
    assert values == sorted(values, reverse=True)
    assert [s.bound for s in curve.solutions] == [None] * 3


def test_the_command_writes_table_figure_and_the_last_solution(tmp_path: Path) -> None:
    source, out = tmp_path / "small.toml", tmp_path / "out"
    source.write_text(SMALL)
    solve_into(out, str(source), budget="2:4", method="exchange", quiet=True)
    table = pd.read_csv(out / "budget_curve.csv")
    assert list(table) == [
        "k", "value", "bound", "gap", "status", "method", "seconds", "selected",
    ]  # fmt: skip
    assert table["k"].tolist() == [2, 3, 4]
    assert (out / "budget_curve.png").read_bytes().startswith(b"\x89PNG")
    assert verify_folder(out).passed
    text = (out / "budget_curve.csv").read_text()
    first = str(table["value"][0])
    for spoiled in (
        text.replace(first[:6], str(float(first[:6]) * 1.5)),
        text.replace("\n3,", "\n1,"),
        text.replace(table["selected"][1], "0 1 2"),
        text[: text.index("\n") + 1],
        text[: text.index("\n4,") + 1],
    ):
        assert spoiled != text
        (out / "budget_curve.csv").write_text(spoiled)
        failed = [check.name for check in verify_folder(out).checks if not check.passed]
        assert failed == ["budget_curve.csv"]
    # a curve cut short in its last word ends with another placement than the folder's
    (out / "budget_curve.csv").write_text(text.rstrip()[:-1])
    validate_in(out, runs=1, seed=0, quiet=True)
    solve_into(out, str(source), budget="2", method="greedy", quiet=True)
    assert not (out / "budget_curve.csv").exists()
    assert not (out / "budget_curve.png").exists()


def test_the_summary_names_the_seconds_of_all_budgets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def slow(*arguments: Any, **options: Any) -> Solution:
        time.sleep(0.2)
        return solve(*arguments, **options)

    monkeypatch.setattr("placement.budget_curve.solve", slow)
    monkeypatch.setattr("placement.commands.entry_points", lambda **_group: [])
    (tmp_path / "small.toml").write_text(SMALL)
    solve_into(tmp_path / "out", str(tmp_path / "small.toml"), budget="1:4", method="greedy")
    found = re.search(r" in (\d+\.\d) s for the budgets 1 to 4\n", capsys.readouterr().out)
    assert found is not None
    assert float(found[1]) >= 0.8


@pytest.mark.parametrize("text", ["3:2", "0:2", "a:2", "1:", "1:2:3", "1:100000", "-1:2"])
def test_bad_ranges_are_refused_in_one_line(text: str) -> None:
    with pytest.raises(ValueError, match="--budget must be A:B"):
        parse_budgets(text)


def test_one_diagram_bounds_every_budget_of_trace() -> None:
    for seed in range(12):
        rng = np.random.default_rng(seed)
        offsets = 2 * int(rng.integers(2))
        drives = [
            random_drive(rng, 16, 8, isotropic=True, longest_window=6, offsets=offsets)
            for _ in range(1 + seed % 2)
        ]
        objective = Trace(drives)
        rules = replace(
            count_only(8, 5), required=np.array([2] if seed % 3 == 0 else [], dtype=np.int64)
        )
        curve = budget_curve(Problem(objective, rules), 2, 5)
        for n, found in enumerate(curve.solutions):
            values = [
                objective.value(np.array(s, dtype=np.int64))
                for s in itertools.combinations(range(8), n + 2)
                if set(rules.required.tolist()) <= set(s)
            ]
            assert found.bound is not None
            assert found.bound <= min(values) * (1.0 + 1e-9)
            assert found.value >= min(values) * (1.0 - 1e-9)
            assert len(found.selected) <= n + 2
            if not offsets:
                assert found.bound >= 0.5 * min(values)  # and no empty promise
        assert [s.value for s in curve.solutions] == sorted(
            (s.value for s in curve.solutions), reverse=True
        )


def test_relaxations_of_some_budgets_bound_them_all(monkeypatch: pytest.MonkeyPatch) -> None:
    for diagrams in ("_price", "_count"):
        monkeypatch.setattr(CurveProof, diagrams, lambda *_: None)
    monkeypatch.setattr("placement.solvers.trace_curve.RELAXATIONS", 2)
    sources = set()
    for seed in range(12):
        rng = np.random.default_rng([5, seed])
        drives = [random_drive(rng, 16, 8, isotropic=seed % 3 > 0, longest_window=6)]
        objective = Trace(drives)
        curve = budget_curve(Problem(objective, count_only(8, 5)), 2, 5)
        for n, found in enumerate(curve.solutions):
            best = min(
                objective.value(np.array(s, dtype=np.int64))
                for s in itertools.combinations(range(8), n + 2)
            )
            assert found.bound is not None
            assert found.bound <= best * (1.0 + 1e-9)
            assert found.bound >= 0.05 * best  # and no empty promise
            sources.add(found.stats["bound_from"])
    assert "concave relaxation" in sources


def test_auto_takes_for_a_curve_no_more_than_twice_the_time_of_its_last_budget(
    new_problem: NewProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits: list[float] = []

    def watched(problem: Problem, method: str, **options: float) -> Solution:
        limits.append(options["time_limit_s"])
        time.sleep(0.05 if len(limits) == 1 else 0.0)
        return solve(problem, "greedy", time_limit_s=math.inf)

    monkeypatch.setattr("placement.budget_curve.solve", watched)
    problem = new_problem(np.random.default_rng(0), n_candidates=9)
    budget_curve(problem, 1, 4, "auto")
    assert limits[0] == math.inf
    assert max(limits[1:]) < 1.0
