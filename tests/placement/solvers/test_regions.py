"""Regions: the same wherever parts of it run, and a placement with its bound when stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import pytest

from placement.city import solve as city_solve
from placement.cluster import Processes, Serial
from placement.constraints import Constraints
from placement.objectives.localisation import Localisation
from placement.problem import Problem
from placement.solution import Status
from placement.solve import solve
from tests.placement.conftest import make_information

NONE = np.empty(0, dtype=np.int64)


class Counted(Serial):
    """Count the tasks that are run."""

    def __init__(self) -> None:
        self.tasks = 0

    def run(
        self, function: Callable[[Any], Any], tasks: Sequence[Any], name: str
    ) -> Iterator[tuple[int, Any]]:
        self.tasks += len(tasks)
        return super().run(function, tasks, name)


@pytest.fixture
def problem(monkeypatch: pytest.MonkeyPatch) -> Problem:
    """Make a problem of several regions."""
    monkeypatch.setattr("placement.city.regions.REGION_ENTRIES", 20)
    info = make_information(np.random.default_rng(5), 60, 120)
    return Problem(Localisation(info, 0.5), Constraints(60, 12, np.arange(60) // 3, NONE, NONE))


def test_swaps_and_the_certificate_run_where_work_runs_and_nothing_changes(
    problem: Problem,
) -> None:
    here = solve(problem, "regions")
    counted = Counted()
    assert solve(problem, "regions", work=counted).selected == here.selected
    assert counted.tasks > 1
    work = Processes(2)
    try:
        there = solve(problem, "regions", work=work)
    finally:
        work.close()
    assert (there.selected, there.value, there.bound) == (here.selected, here.value, here.bound)


def test_greedy_in_turns_is_greedy_and_may_be_stopped_between_them(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = solve(problem, "regions")
    monkeypatch.setattr(city_solve, "TURN", 5)
    assert solve(problem, "regions").selected == whole.selected

    def stop(text: str, share: float | None) -> None:
        if text == "greedy" and share:
            raise KeyboardInterrupt

    stopped = solve(problem, "regions", progress=stop)
    assert stopped.status is Status.TIME_LIMIT


def test_time_that_is_up_after_a_turn_leaves_a_placement_and_a_bound(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(city_solve, "TURN", 5)
    turns = iter([False, True, True, True, True, True, True, True])
    monkeypatch.setattr("placement.problem.Run.out_of_time", lambda _run: next(turns))
    stopped = solve(problem, "regions")
    monkeypatch.undo()
    assert stopped.status is Status.TIME_LIMIT
    assert len(stopped.selected) == 5
    best = solve(problem, "mip")  # in 0.1 s, where `chain` ends after 20 s with a gap
    assert best.status is Status.OPTIMAL
    assert stopped.bound is not None
    assert stopped.bound >= best.value
