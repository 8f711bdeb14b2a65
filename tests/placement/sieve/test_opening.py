"""Arcs found without a table of all pairs, against those of a table."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.synthetic_drives import random_drive
from models.geometry import BoolArray, FloatArray
from placement.constraints import Constraints
from placement.objectives.entropy import Entropy
from placement.problem import Problem
from placement.sieve import first as first_module
from placement.sieve import opening, passes
from placement.sieve.first import FirstOrder, into_each
from placement.sieve.opening import Opening, gains_along
from placement.sieve.sieve import Sieve
from placement.solve import solve
from placement.tempered import bound, pieces
from placement.tempered.background import background_of, chains_of
from placement.tempered.bound import Tempered
from placement.tempered.line import ArcsOut, Line, make_line
from placement.tempered.paths import OutOfTimeError
from tests.placement.sieve.test_sieve import hold_sieves_against_brute_force
from tests.placement.tempered.test_bound import new_run

N = 75


def tempered_over(seed: int, share: float = 0.9) -> Tempered:
    """Return the first order over a road of mounts whose cameras' windows often meet."""
    rng = np.random.default_rng([83, seed])
    drive = random_drive(
        rng, n_samples=120, n_candidates=N, longest_window=9, offsets=seed % 3, wrap=seed % 4 == 3
    )
    if seed % 2:
        drive = replace(drive, weight=0.3)
    objective = Entropy([drive])
    y = rng.uniform(0.0, 0.1, N)
    group = np.arange(N) // 3 if seed % 2 else np.full(N, -1)
    required = np.array([N // 3, N // 2]) if seed % 5 == 4 else np.empty(0, dtype=np.int64)
    constraints = Constraints(N, 7, group, required, np.empty(0, dtype=np.int64))
    line = make_line(objective, constraints, np.arange(N))
    background = (drive.persistent and chains_of(objective, y)) or background_of(objective, y)
    return Tempered(objective, line, 7, share, background, new_run())


def by_table(
    first: Tempered, price: float, need: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return paths into and beyond each camera, and the arcs on paths worth `need`."""
    into, beyond = first.alone - price, first.ends.copy()
    for a in range(N):
        for b in range(a + 1, N):
            into[b] = max(into[b], into[a] + first.pairs[a, b] - price)
    for a in range(N - 1, -1, -1):
        for b in range(a + 1, N):
            beyond[a] = max(beyond[a], first.pairs[a, b] - price + beyond[b])
    return into, beyond, into[:, None] + first.pairs - price + beyond[None, :] >= need


def opened(
    first: Tempered, into: FloatArray, price: float, need: float
) -> tuple[ArcsOut, NDArray[np.float32]]:
    found = Opening(first).arcs_worth(into, price, need, N * N)
    assert found is not None
    return found


@pytest.mark.parametrize(("room", "longest"), [(True, 200), (False, 200), (True, 4)])
@pytest.mark.parametrize("seed", range(10))
def test_arcs_worth_it_are_those_of_a_table_of_all_pairs(
    seed: int, room: bool, longest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not room:
        monkeypatch.setattr(opening, "MOST_MEETINGS", 0)
    monkeypatch.setattr(pieces, "LONGEST", longest)
    first = tempered_over(seed)
    assert first.drives[0].extra.any() == (longest < 200)
    rough = FirstOrder(first, -np.inf)
    best = rough.least - first.budget * rough.price
    all_gains = gains_along(first, first.line.laid_out)
    for price, short in ((rough.price, 0.2), (0.7 * rough.price, 1.0), (rough.price, np.inf)):
        into, _, _ = by_table(first, price, 0.0)
        need = max(float(np.max(into + first.ends)), best) - short
        into, _, worth = by_table(first, price, need)
        worth &= first.line.alive
        found, cameras = Opening(first).into_each(price)
        assert found == pytest.approx(into, abs=1e-12)
        arcs, gain = opened(first, found, price, need)
        got = np.zeros_like(worth)
        got[arcs.source, arcs.target] = True
        assert np.array_equal(got, worth)
        assert 0 < worth.sum() <= first.line.n_arcs
        assert np.array_equal(gain, first.pairs[arcs.source, arcs.target])
        assert np.array_equal(gains_along(first, arcs), gain)
        assert np.array_equal(
            cameras, into_each(first.line.laid_out, all_gains, first.alone, price)[1]
        )


def test_too_many_arcs_are_none_and_leave_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    first = tempered_over(1)
    lane = Opening(first)
    assert lane.arcs_worth(lane.into_each(0.1)[0], 0.1, -np.inf, 10) is None
    monkeypatch.setattr(first_module, "MANY", 10)
    monkeypatch.setattr(first_module, "THINNED", 20)
    found = FirstOrder(first, -np.inf, most=10)
    assert found.too_many
    assert found.arcs > 10
    assert first.bound() - 1e-9 <= found.bound() <= 1.5 * first.bound()
    # all that may be is still there
    assert found.left().n_arcs == first.line.n_arcs
    monkeypatch.undo()
    again = FirstOrder(replace(first, line=found.left()), -np.inf)
    assert again.bound() >= first.bound() - 1e-9


@pytest.mark.parametrize("seed", range(6))
def test_a_long_lines_first_order_leaves_what_that_of_a_short_one_does(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = tempered_over(seed)
    beat = 0.99 * first.bound()
    short = FirstOrder(first, beat)
    monkeypatch.setattr(first_module, "MANY", 10)
    monkeypatch.setattr(first_module, "THINNED", 20)
    long = FirstOrder(first, beat)
    # placements above the score to beat are in both; the price may differ a little
    assert long.bound() == pytest.approx(short.bound(), rel=1e-3)
    assert first.bound() <= long.bound() + 1e-9
    left = first.survivors(beat)
    kept = set(
        zip(
            first.line.candidate[np.repeat(np.arange(N), np.diff(long.near.out_of))],
            first.line.candidate[long.near.target],
            strict=True,
        )
    )
    for a, b in np.argwhere(left.alive):
        assert (left.candidate[a], left.candidate[b]) in kept


def test_no_sieve_of_a_long_line_is_below_the_best_placement(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(first_module, "MANY", 2)
    monkeypatch.setattr(first_module, "THINNED", 3)
    monkeypatch.setattr(opening, "BATCH", 2)
    monkeypatch.setattr(opening, "THIN", 2)
    for seed in range(40):
        hold_sieves_against_brute_force(seed, seed % 4)


@pytest.mark.parametrize("offsets", [0, 2])
def test_a_line_too_long_for_a_table_is_proven_by_sieves(
    offsets: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng([89, offsets])
    drive = random_drive(rng, n_samples=300, n_candidates=240, longest_window=6, offsets=offsets)
    none = np.empty(0, dtype=np.int64)
    problem = Problem(Entropy([drive]), Constraints(240, 6, np.arange(240) // 2, none, none))
    whole = solve(problem, "tempered")
    monkeypatch.setattr(first_module, "MANY", 50)
    monkeypatch.setattr(first_module, "THINNED", 40)
    monkeypatch.setattr(bound, "MOST_PAIRS", 4.0 * 100**2)
    long = solve(problem, "tempered", time_limit_s=60.0)
    assert whole.bound is not None
    assert long.bound is not None
    assert long.value == pytest.approx(whole.value, rel=1e-6)
    assert max(long.bound, whole.bound) <= 1.01 * whole.value
    assert any("sieved" in stage for stage in long.stats["bounds"])


def test_what_is_too_much_at_one_share_is_tried_at_a_smaller(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(first_module, "MANY", 10)
    monkeypatch.setattr(first_module, "THINNED", 20)
    first = tempered_over(2)
    best = max(first.bound() * 0.9, 0.0)

    def tempered_at(line: Line, share: float) -> Tempered:
        return replace(first, line=line, theta=share)

    def arcs_at(share: float) -> int:
        return FirstOrder(tempered_at(first.line, share), best).arcs

    low, high = 0.9, 1.0
    assert arcs_at(low) < arcs_at(high)
    most = arcs_at(high) - 1
    monkeypatch.setattr(passes, "most_arcs", lambda: most)
    room_for = passes.room_for
    monkeypatch.setattr(
        passes, "room_for", lambda arcs, *more: arcs <= most and room_for(arcs, *more)
    )
    seen: list[tuple[str, float]] = []

    def report(found: FirstOrder | Sieve, share: float) -> bool:
        seen.append((type(found).__name__, share))
        return isinstance(found, Sieve)

    def never(_line: Line) -> bool:
        return False

    given = first.line, high, low, tempered_at, lambda: best, report, never
    line, share, sieves = passes.sift(*given, first.run)
    assert seen == [("FirstOrder", high), ("FirstOrder", low), ("Sieve", low)]
    assert (share, sieves) == (low, 1)
    assert line.arcs is not None


def test_memory_is_a_part_of_the_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sysconf", lambda name: {"SC_PHYS_PAGES": 1000}.get(name, 4096))
    assert passes.most_bytes() == pytest.approx(0.3 * 4096e3)
    assert passes.most_arcs() == int(0.3 * 4096e3 / passes.ARC_BYTES)

    def unknown(name: str) -> int:
        raise ValueError(name)

    monkeypatch.setattr(os, "sysconf", unknown)
    assert passes.most_bytes() == passes.MOST_BYTES


def test_an_opening_out_of_time_stops() -> None:
    first = tempered_over(0)
    first.run.deadline = 0.0
    with pytest.raises(OutOfTimeError):
        Opening(first).into_each(0.1)
    with pytest.raises(OutOfTimeError):
        Opening(first).arcs_worth(first.alone, 0.1, 0.0, N * N)


def test_a_bound_that_is_no_number_bounds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    first = tempered_over(0)
    monkeypatch.setattr(first_module, "into_each", lambda *_: (np.full(N, np.nan), np.ones(N)))
    monkeypatch.setattr(first_module, "PRICES", 2)
    found = FirstOrder(first, 0.0)
    assert found.least == np.inf
