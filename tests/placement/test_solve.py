"""The verb believes nothing: methods that lie, fail or are stopped."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from placement import solve as verb
from placement.constraints import Infeasible
from placement.problem import Problem, Run
from placement.solution import Proposal, Status
from placement.solve import METHODS, outwards, solve


@dataclass
class Fake:
    """A method whose proposal the test writes."""

    function: Callable[[Problem, Run], Proposal]
    summary: str = "fake"
    proves_bound: bool = True

    def load(self) -> Callable[[Problem, Run], Proposal]:
        return self.function


Play = Callable[[Callable[[Problem, Run], Proposal]], Any]


@pytest.fixture
def problem(new_problem: Callable[..., Problem]) -> Problem:
    return new_problem(np.random.default_rng(0), n_candidates=8, budget=2, required=(5,))


@pytest.fixture
def play(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> Play:
    """Solve `problem` by a method made of one function."""

    def run(function: Callable[[Problem, Run], Proposal]) -> Any:
        monkeypatch.setitem(METHODS, "fake", Fake(function))  # type: ignore[arg-type]
        return solve(problem, "fake")

    return run


def value_of(problem: Problem, *selected: int) -> float:
    return problem.objective.value(np.array(selected))


def test_a_bound_that_its_own_placement_beats_is_an_error(play: Play, problem: Problem) -> None:
    low = 0.999 * value_of(problem, 1, 5)
    solution = play(lambda _p, _r: Proposal([1, 5], low, Status.OPTIMAL))
    assert solution.status is Status.NUMERICAL_ERROR
    assert solution.bound is None
    assert "beats the bound" in solution.stats["error"]


def test_a_bound_below_the_value_by_rounding_alone_is_the_value(
    play: Play, problem: Problem
) -> None:
    value = value_of(problem, 1, 5)
    solution = play(lambda _p, _r: Proposal([5, 1], value * (1.0 - 1e-11)))
    assert solution.status is Status.OPTIMAL
    assert solution.bound == solution.value == value
    assert solution.gap == 0.0
    assert solution.selected == (1, 5)


def test_optimal_without_proof_is_feasible(play: Play, problem: Problem) -> None:
    assert play(lambda _p, _r: Proposal([5], None, Status.OPTIMAL)).status is Status.FEASIBLE
    high = 1.01 * value_of(problem, 5)
    assert play(lambda _p, _r: Proposal([5], high, Status.OPTIMAL)).status is Status.FEASIBLE


@pytest.mark.parametrize("bound", [float("nan"), float("inf")])
def test_a_bound_that_is_no_number_is_none(play: Play, bound: float) -> None:
    solution = play(lambda _p, _r: Proposal([5], bound))
    assert solution.bound is None
    assert solution.gap is None


def test_the_tighter_of_the_proposed_and_the_running_bound_counts(
    play: Play, problem: Problem
) -> None:
    def method(_problem: Problem, run: Run) -> Proposal:
        run.score_bound = 2.0 * value_of(problem, 5)
        return Proposal([5], 3.0 * value_of(problem, 5))

    assert play(method).gap == pytest.approx(1.0)


def test_bounds_are_rounded_outwards() -> None:
    for bound in (1.0, -1.0, 1e300, 1e-300):
        assert outwards(bound) > bound
    assert outwards(0.0) == 0.0
    assert outwards(None) is None


@pytest.mark.parametrize(
    ("selected", "words"),
    [
        ([1], "required candidate 5 is missing"),
        ([5, 1, 2], "exceed the budget"),
        ([5, 99], "outside"),
    ],
)
def test_a_placement_that_breaks_a_constraint_gives_way_to_the_incumbent(
    play: Play, selected: list[int], words: str
) -> None:
    def method(_problem: Problem, run: Run) -> Proposal:
        run.incumbent = [5, 7]
        return Proposal(selected, 1e9)

    solution = play(method)
    assert solution.status is Status.NUMERICAL_ERROR
    assert solution.selected == (5, 7)
    assert words in solution.stats["error"]


def test_an_interrupt_returns_the_incumbent_and_its_bound(play: Play, problem: Problem) -> None:
    def method(_problem: Problem, run: Run) -> Proposal:
        run.incumbent = [7, 5]
        run.score_bound = 1e3
        raise KeyboardInterrupt

    solution = play(method)
    assert solution.status is Status.TIME_LIMIT
    assert solution.selected == (5, 7)
    assert solution.value == value_of(problem, 5, 7)
    assert solution.bound == pytest.approx(1e3)
    assert solution.stats["stopped_by"] == "interrupt"


def test_an_interrupt_before_any_incumbent_returns_the_required_cameras(play: Play) -> None:
    def method(_problem: Problem, _run: Run) -> Proposal:
        raise KeyboardInterrupt

    assert play(method).selected == (5,)


@pytest.mark.parametrize("error", [ZeroDivisionError("by zero"), np.linalg.LinAlgError("singular")])
def test_arithmetic_that_fails_is_a_status_with_its_words(play: Play, error: Exception) -> None:
    def method(_problem: Problem, _run: Run) -> Proposal:
        raise error

    solution = play(method)
    assert solution.status is Status.NUMERICAL_ERROR
    assert str(error) in solution.stats["error"]


@pytest.mark.parametrize("error", [MemoryError, ValueError, TypeError])
def test_other_errors_are_not_swallowed(play: Play, error: type[Exception]) -> None:
    def method(_problem: Problem, _run: Run) -> Proposal:
        raise error

    with pytest.raises(error):
        play(method)


def test_contradictions_found_on_the_way_are_infeasible(play: Play) -> None:
    def method(_problem: Problem, _run: Run) -> Proposal:
        raise Infeasible("nothing reaches 0.1 m at 812 m")

    solution = play(method)
    assert solution.status is Status.INFEASIBLE
    assert solution.selected == ()
    assert np.isnan(solution.value)
    assert solution.stats["reason"] == "nothing reaches 0.1 m at 812 m"


def test_bad_arguments_are_refused_by_name(problem: Problem) -> None:
    with pytest.raises(ValueError, match=r"method must be one of auto, .* got .gredy."):
        solve(problem, "gredy")
    with pytest.raises(ValueError, match="time_limit_s must be at least 0, got nan"):
        solve(problem, time_limit_s=float("nan"))
    with pytest.raises(ValueError, match="time_limit_s must be at least 0, got -1"):
        solve(problem, time_limit_s=-1.0)
    with pytest.raises(ValueError, match="seed must be at least 0, got -1"):
        solve(problem, seed=-1)


def test_progress_is_told(problem: Problem) -> None:
    lines: list[str] = []
    solve(problem, "greedy", progress=lambda text, _share: lines.append(text))
    assert lines == ["greedy: 2 of 2"]


def test_the_verb_imports_no_method_before_it_is_asked() -> None:
    code = (
        "import sys, placement.solve; "
        "sys.exit(any(m.startswith(('cvxpy', 'highspy', 'placement.solvers.')) "
        "for m in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0  # noqa: S603


def test_every_registered_method_has_a_summary_of_one_line() -> None:
    for name, method in verb.METHODS.items():
        assert method.summary, name
        assert "\n" not in method.summary


def test_the_verb_of_the_package_can_be_called_again_and_again(problem: Problem) -> None:
    """Its module has the same name and takes its place in the package once it is imported."""
    import placement

    first = placement.solve(problem, "greedy")
    assert placement.solve(problem, "greedy", seed=0).selected == first.selected
    assert placement.solve.METHODS is METHODS  # type: ignore[attr-defined]
