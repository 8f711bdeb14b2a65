from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from placement.budget_curve import budget_curve, parse_budgets
from placement.commands import solve_into
from placement.problem import Problem
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


@pytest.mark.parametrize("method", ["greedy", "exchange", "mip", "uniform", "random"])
@pytest.mark.parametrize("priced", [False, True])
def test_every_budget_is_enclosed_and_the_curve_rises(
    new_problem: NewProblem, brute_force: BruteForce, method: str, priced: bool
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
            best, _ = brute_force(each)
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
    ):
        assert spoiled != text
        (out / "budget_curve.csv").write_text(spoiled)
        failed = [check.name for check in verify_folder(out).checks if not check.passed]
        assert failed == ["budget_curve.csv"]
    solve_into(out, str(source), budget="2", method="greedy", quiet=True)
    assert not (out / "budget_curve.csv").exists()
    assert not (out / "budget_curve.png").exists()


@pytest.mark.parametrize("text", ["3:2", "0:2", "a:2", "1:", "1:2:3", "1:100000", "-1:2"])
def test_bad_ranges_are_refused_in_one_line(text: str) -> None:
    with pytest.raises(ValueError, match="--budget must be A:B"):
        parse_budgets(text)
