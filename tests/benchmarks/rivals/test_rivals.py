"""Every rival that is installed answers small problems rightly, or says that it cannot say them."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest

from benchmarks.rivals.registry import RIVALS
from benchmarks.runner.subjects import Case, load_subject
from benchmarks.runner.worker import perform

# each rival is loaded in a process of its own, some compile there
pytestmark = pytest.mark.slow

SMALL = {
    "road.pieces": [{"length": 60.0}],
    "road.sample_spacing_m": 3.0,
    "mounts.spacing_m": 30.0,
    "camera.yaw_deg": [0.0, 180.0],
    "camera.pitch_deg": [28.0],
    "camera.fov_deg": [[60.0, 60.0]],
    "budget.cameras": 3,
}
FREE = {**SMALL, "budget.one_per_mount": False}


def _road(name: str, changes: dict[str, object], **more: object) -> Case:
    kind = "coverage" if "times" in more else "road"
    return Case(name, kind, {"instance": "straight-80", "changes": changes, **more})


CASES = {
    case.name: case
    for case in (
        Case(
            "design",
            "design",
            {
                "generator": "benchmarks.instances.generators:gaussian",
                "arguments": {"n": 4, "c": 12, "budget": 3, "prior": 1.0, "seed": 2},
            },
        ),
        _road("localisation", FREE),
        _road("grouped", SMALL),
        _road("blocks", {**SMALL, "errors.model": "ellipse", "errors.persistent": False}),
        _road("once", SMALL, times=1),
        _road("twice", SMALL, times=2),
        _road("trace", {**SMALL, "objective.kind": "trace"}),
    )
}
# What each can say; the rest must be refused by name.
SAYS = {
    "cvxpy-clarabel": {"design", "localisation", "grouped", "blocks", "once", "twice"},
    "cvxpy-scs": {"design", "localisation", "grouped", "blocks", "once", "twice"},
    "scip": {"localisation", "grouped", "blocks", "once", "twice"},
    "scip-cuts": {"design", "localisation", "grouped", "blocks", "once", "twice"},
    "highs": {"once", "twice"},
    "apricot": {"design", "localisation"},
    "submodlib": {"design", "localisation"},
    "chama": {"once", "twice"},
    "pysensors": {"design"},
}
EXACT = {"scip-cuts", "highs", "chama"}


@cache
def best(name: str) -> float:
    """Return the optimum by enumeration."""
    problem = load_subject(CASES[name]).problem
    k, n = problem.constraints.budget, problem.constraints.n
    return max(
        problem.objective.value(np.array(chosen, dtype=np.int64))
        for size in range(k + 1)
        for chosen in itertools.combinations(range(n), size)
        if not problem.constraints.violations(chosen)
    )


@pytest.mark.parametrize("case", list(CASES))
@pytest.mark.parametrize(
    "rival",
    list(RIVALS),
)
def test_a_rival_answers_or_says_that_it_cannot(rival: str, case: str) -> None:
    lacking = RIVALS[rival].missing()
    if lacking is not None:
        pytest.skip(f"{lacking} is not installed")
    words = {"case": CASES[case].record(), "solver": rival, "seed": 0, "time_limit_s": 20.0}
    row = perform(words)
    if case not in SAYS[rival]:
        assert row["status"] == "cannot_say", row
        assert row["note"]
        return
    assert row["status"] in {"optimal", "feasible"}, row
    assert row["verified"], row
    assert row["value"] <= best(case) * (1.0 + 1e-9)
    if row["bound"] is not None:
        assert row["bound"] >= best(case) * (1.0 - 1e-5)
    if rival in EXACT:
        assert row["value"] == pytest.approx(best(case), rel=1e-6)
        assert row["gap"] <= 1e-5


def test_every_rival_has_its_row_in_the_table_of_words() -> None:
    assert SAYS.keys() == RIVALS.keys()
