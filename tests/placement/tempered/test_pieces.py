"""Windows cut in two: gains are above the true ones, by no more than what is cut off can add."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.synthetic_drives import random_drive
from placement.constraints import Constraints
from placement.objectives.entropy import Entropy
from placement.objectives.navigation_chain import Drive
from placement.tempered import pieces
from placement.tempered.background import background_of, chains_of
from placement.tempered.bound import SecondOrder, Tempered
from placement.tempered.diagram import Diagram
from placement.tempered.line import make_line
from placement.tempered.pieces import pieces_of
from tests.placement.sieve.test_sieve import hold_sieves_against_brute_force, loss_of, sieve_of
from tests.placement.tempered.test_bound import hold_bounds_against_brute_force, new_run
from tests.placement.tempered.test_persistent import Dense

N = 8
NONE = np.empty(0, dtype=np.int64)


def at_the_seam(rng: np.random.Generator, n: int, samples: int, window: int, offsets: int) -> Drive:
    """Return a drive around a lap whose cameras all stand where it begins and ends."""
    drive = random_drive(
        rng, n_samples=samples, n_candidates=n, longest_window=window, offsets=offsets
    )
    info = drive.information
    indices = info.indices.copy()
    for i in range(n):
        row = slice(int(info.indptr[i]), int(info.indptr[i + 1]))
        begin = int(rng.integers(samples - window, samples + window // 2))
        length = row.stop - row.start
        if i % 3 == 0:  # across the seam
            begin = samples - (length + 1) // 2
        indices[row] = np.sort((begin + np.arange(length)) % samples)
    return replace(drive, information=replace(info, indices=indices))


@pytest.mark.parametrize("offsets", [0, 2])
@pytest.mark.parametrize("seed", range(4))
def test_gains_of_cut_windows_are_bounds_and_forget_only_what_is_cut_off(
    seed: int, offsets: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pieces, "LONGEST", 20)
    rng = np.random.default_rng([7, seed, offsets])
    drive = at_the_seam(rng, N, 40, 12, offsets)
    cut, whole = pieces_of(drive)
    assert not whole.all()
    objective = Entropy([drive])
    line = make_line(objective, Constraints(N, 4, np.full(N, -1), NONE, NONE), np.arange(N))
    y = rng.uniform(0.0, 0.2, N)
    background = (drive.persistent and chains_of(objective, y)) or background_of(objective, y)
    for share in (1.0, 0.8):
        first = Tempered(objective, line, 4, share, background, new_run())
        second, sieve = SecondOrder(first, -np.inf), sieve_of(first)
        diagram = Diagram(first, 3, -np.inf)
        dense, pieced = Dense(drive, background[0], share), Dense(cut, background[0], share)

        def g(*positions: int, of: Dense = dense, first: Tempered = first) -> float:
            return of.gain([int(first.line.candidate[p]) for p in positions])

        (d,) = first.drives
        for j in range(N):
            extra = g(j) - g(j, of=pieced)
            assert extra - 1e-7 <= d.extra[j] <= extra + 1e-7 * (2.0 + d.alone[j])
        arcs = second.arcs
        for j, k in itertools.combinations(range(N), 2):
            assert first.pairs[j, k] >= g(j, k) - g(j) - 1e-8
            kept = g(j, k, of=pieced) - g(j, of=pieced)
            assert first.pairs[j, k] == pytest.approx(kept + d.extra[k], rel=1e-5, abs=1e-6)
        for i, j, k in itertools.combinations(range(N), 3):
            true = g(i, j, k) - g(i, j)
            a = arcs.into[j] + i
            gain = second.gains[arcs.triple[a] + k - j - 1]
            assert gain >= true - 1e-8
            assert gain <= first.pairs[j, k] * (1.0 + 1e-6) + 1e-6
            assert first.pairs[j, k] - loss_of(sieve, i, j, k) >= true - 1e-7
        assert diagram.bound() <= first.bound() + 1e-6


def test_many_cameras_at_a_seam_do_not_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pieces, "LONGEST", 100)
    rng = np.random.default_rng(11)
    drive = at_the_seam(rng, 30, 150, 10, 0)
    _, whole = pieces_of(drive)
    seam = np.flatnonzero(~whole)
    assert seam.size >= 3
    objective = Entropy([drive])
    k = int(seam.size)
    line = make_line(objective, Constraints(30, k, np.full(30, -1), NONE, NONE), seam)
    background = background_of(objective, np.zeros(30))
    first = Tempered(objective, line, k, 1.0, background, new_run())
    everyone = objective.value(seam)
    (d,) = first.drives
    assert first.bound() >= everyone
    # without what is cut off they are told apart as others are
    assert first.bound() <= 2.0 * everyone + d.extra.sum()
    assert first.bound() < 0.7 * d.alone.sum()


@pytest.mark.parametrize("offsets", [0, 1, 3])
def test_bounds_over_cut_windows_hold_against_brute_force(
    offsets: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pieces, "LONGEST", 6)
    for seed in range(0, 48, 4):  # every fourth road is closed
        hold_bounds_against_brute_force(seed, offsets)
        hold_sieves_against_brute_force(seed, offsets)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_bounds_over_cut_windows_hold_on_1000_more(
    block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pieces, "LONGEST", 5)
    for seed in range(20_000 + 400 * block, 20_000 + 400 * (block + 1), 4):
        hold_bounds_against_brute_force(seed, seed // 4 % 4)
        hold_sieves_against_brute_force(seed, seed // 4 % 4)
