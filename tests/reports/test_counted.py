"""Work bounded by a count: stopped at the same place whatever the machine does meanwhile."""

from __future__ import annotations

import math

import numpy as np

from placement.assemble import assemble
from reports.camera_count import Case
from reports.counted import CountedRun, solve_counted


def test_time_is_up_after_so_many_looks() -> None:
    run = CountedRun(np.random.default_rng(0), looks=3)
    assert [run.remaining(), run.out_of_time(), run.remaining()] == [math.inf, False, math.inf]
    assert run.out_of_time()
    assert run.remaining() == 0.0


def test_more_looks_never_prove_less_and_the_same_looks_find_the_same() -> None:
    problem = assemble(Case("tolerance", "bends of 50 m", tolerance_m=0.29).instance()).problem
    few, again, more = (solve_counted(problem, "tolerance", n) for n in (40, 40, 10_000))
    assert (few.selected, few.bound, few.status) == (again.selected, again.bound, again.status)
    assert few.bound is not None
    assert more.bound is not None
    assert few.bound <= more.bound + 1e-9
    assert more.value <= few.value
