"""Chains over cameras whose offsets persist, against dense matrices and brute force."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest

from benchmarks.synthetic_drives import random_drive
from models.geometry import FloatArray
from placement.constraints import Constraints
from placement.objectives.entropy import Entropy
from placement.objectives.navigation_chain import Drive
from placement.objectives.windows.dense import DenseDrive
from placement.problem import Problem, Run
from placement.solution import Status
from placement.solve import solve
from placement.tempered import bound
from placement.tempered.background import Background, background_of, chains_of, stand_in
from placement.tempered.bound import SecondOrder, Tempered
from placement.tempered.chains import Chain
from placement.tempered.line import make_line
from placement.tempered.pieces import pieces_of
from placement.tempered.search import gains_beyond
from tests.placement.tempered.test_bound import (
    best_placement,
    hold_bounds_against_brute_force,
    small_problem,
    solved,
)

NONE = np.empty(0, dtype=np.int64)


def new_run() -> Run:
    return Run(np.random.default_rng(0))


class Dense:
    """g of the tempered bound by one dense matrix for the trajectory."""

    def __init__(self, drive: Drive, background: Background, share: float) -> None:
        self.dense, self.share = DenseDrive(drive), share
        self.y = np.zeros_like(self.dense.prior)
        if isinstance(background, Chain):
            self.y[:3, :3] = background.start
            for t, step in enumerate(drive.steps()[1:, :4], start=1):
                c, s, y, x = step
                plain = np.array([[c, s, y], [-s, c, x], [0.0, 0.0, 1.0]])
                noise = drive.steps()[t, 4:][[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
                both = slice(3 * t - 3, 3 * t + 3)
                for f, told, sign in (
                    (background.f[t], background.information[t], 1.0),
                    (plain, np.linalg.inv(noise), -1.0),
                ):
                    move = np.hstack([-f, np.eye(3)])
                    self.y[both, both] += sign * (move.T @ told @ move)
            background = np.empty((0, 3))
        for t, (tt, tn, nn) in enumerate(background):
            self.y[3 * t : 3 * t + 2, 3 * t : 3 * t + 2] = [[tt, tn], [tn, nn]]
        self.cameras = [self.dense.camera(i) for i in range(drive.information.n_candidates)]

    def log_det(self, information: FloatArray) -> float:
        n = len(self.y)
        return float(np.linalg.slogdet(np.eye(n) + self.dense.prior @ information)[1])

    def gain(self, chosen: list[int]) -> float:
        rest = (1.0 - self.share) * self.y
        seen = sum((self.cameras[i] for i in chosen), np.zeros_like(rest))
        return self.log_det(rest + self.share * seen) - self.log_det(rest)


@pytest.mark.parametrize(
    ("wrap", "share", "chain"),
    [(False, 1.0, False), (False, 0.7, False), (True, 0.7, False), (False, 0.7, True)],
)
def test_gains_equal_dense_log_dets_and_never_fall_below_them(
    wrap: bool, share: float, chain: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(3)
    drive = random_drive(rng, n_samples=30, n_candidates=9, wrap=wrap, offsets=3)
    objective = Entropy([drive])
    line = make_line(objective, Constraints(9, 4, np.full(9, -1), NONE, NONE), np.arange(9))
    y = rng.uniform(0.0, 0.3, 9)
    background = chains_of(objective, y) if chain else background_of(stand_in(objective), y)
    assert background is not None
    dense = Dense(drive, background[0], share)
    first = Tempered(objective, line, 4, share, background, new_run())
    want = dense.log_det((1.0 - share) * dense.y) - (1.0 - share) * dense.log_det(dense.y)
    assert first.constant == pytest.approx(want, abs=1e-7)

    @functools.cache
    def score(*positions: int) -> float:
        return dense.gain([int(line.candidate[i]) for i in positions])

    for a in range(9):
        assert first.alone[a] == pytest.approx(score(a), rel=1e-8, abs=1e-8)
        for b in range(a + 1, 9):
            gain = score(a, b) - score(a)
            assert first.pairs[a, b] >= gain - 1e-10
            assert first.pairs[a, b] == pytest.approx(gain, rel=1e-6, abs=1e-8)
    second = SecondOrder(first, -np.inf)
    arcs = second.arcs
    assert second.exact
    monkeypatch.setattr(bound, "TRIPLE_S", 1e9)  # too dear
    hasty = SecondOrder(first, -np.inf)
    assert not hasty.exact
    for arc in range(len(arcs.source)):
        h, j = int(arcs.source[arc]), int(arcs.target[arc])
        following = arcs.target[arcs.out[arcs.out_of[j] : arcs.out_of[j + 1]]]
        for m, i in enumerate(following):
            gain, at = score(h, j, int(i)) - score(h, j), arcs.triple[arc] + m
            assert second.gains[at] >= gain - 1e-10
            assert second.gains[at] == pytest.approx(gain, rel=1e-6, abs=1e-7)
            # at least the camera in the middle, at most both
            assert gain - 1e-10 <= hasty.gains[at] <= first.pairs[j, i] * (1.0 + 1e-6) + 1e-7
    with_each = gains_beyond(second, np.array([1, 4, 5]), np.array([8, 6, 7]))
    assert with_each == pytest.approx([score(1, 4, 5, i) for i in (8, 6, 7)], rel=1e-7)


def test_any_positive_semidefinite_background_keeps_the_inequality() -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        drive = random_drive(rng, n_samples=10, n_candidates=5, offsets=2)
        dense = Dense(drive, rng.uniform(0.0, 40.0, (10, 1)) * np.array([1.0, 0.3, 1.0]), 1.0)
        whole = dense.log_det(sum(dense.cameras, np.zeros_like(dense.y)))
        for share in (0.1, 0.6, 0.95):
            mixed = (1.0 - share) * dense.y + share * sum(dense.cameras, np.zeros_like(dense.y))
            most = (dense.log_det(mixed) - (1.0 - share) * dense.log_det(dense.y)) / share
            assert most >= whole - 1e-9


@pytest.mark.parametrize("block", range(2))
def test_no_bound_is_below_the_best_placement_of_24_small_roads(block: int) -> None:
    for seed in range(12 * block, 12 * (block + 1)):
        hold_bounds_against_brute_force(seed, offsets=1 + seed % 3)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_no_bound_is_below_the_best_placement_of_500_more(block: int) -> None:
    for seed in range(3000 + 50 * block, 3000 + 50 * (block + 1)):
        hold_bounds_against_brute_force(seed, offsets=1 + seed % 6)


def test_small_roads_are_solved_to_optimality() -> None:
    for seed in range(12):
        solved(*small_problem(seed, offsets=2))


def test_a_window_over_the_seam_of_a_long_lap_is_cut_and_bounds_hold() -> None:
    rng = np.random.default_rng(6)
    drive = random_drive(rng, n_samples=210, n_candidates=12, wrap=True, offsets=2)
    drive, _ = pieces_of(drive)  # whatever chance has laid over the seam
    info = drive.information
    # camera 0 sees the first and the last metres
    rows = [np.arange(info.indptr[i], info.indptr[i + 1]) for i in range(12)]
    rows[0] = np.concatenate([np.arange(min(3, rows[0].size)), rows[0][:0]]) + info.indptr[0]
    entries = np.concatenate(rows)
    indices = info.indices[entries].copy()
    indices[: rows[0].size] = [0, 1, 209][: rows[0].size]
    assert rows[0].size == 3
    seam = type(info)(
        210,
        np.concatenate([[0], np.cumsum([r.size for r in rows])]).astype(np.int64),
        indices,
        info.blocks[entries],
        white=info.white[entries],
        offsets=info.offsets[entries],
        frames_per_sample=info.frames_per_sample,
    )
    drive = Drive(drive.points, seam, drive.odometry, drive.initial_sigma)
    cut, whole = pieces_of(drive)
    assert list(np.flatnonzero(~whole)) == [0]
    # the car is known where the lap begins: its last metre tells more than the first two
    assert cut.information.indices[: cut.information.indptr[1]].tolist() == [209]
    objective = Entropy([drive])
    constraints = Constraints(12, 3, np.full(12, -1), NONE, NONE)
    best, _ = best_placement(objective, constraints)
    line = make_line(objective, constraints, np.arange(12))
    background = background_of(stand_in(objective), np.full(12, 0.2))
    for share in (1.0, 0.8):
        first = Tempered(objective, line, 3, share, background, new_run())
        assert first.bound() >= best
        assert SecondOrder(first, -np.inf).bound() >= best
    place = int(np.flatnonzero(line.candidate == 0)[0])
    for others in itertools.combinations(np.flatnonzero(line.candidate != 0)[:5], 2):
        held = np.array(others)
        want = Dense(drive, background[0], 0.8).gain(
            [int(line.candidate[i]) for i in (*others, place)]
        )
        got = gains_beyond(SecondOrder(first, -np.inf), held, np.array([place]))[0]
        assert got == pytest.approx(want, rel=1e-7)


def test_time_is_kept_with_offsets() -> None:
    drive = random_drive(np.random.default_rng(14), n_samples=400, n_candidates=600, offsets=3)
    problem = Problem(Entropy([drive]), Constraints(600, 12, np.arange(600) // 5, NONE, NONE))
    solution = solve(problem, "tempered", time_limit_s=3.0)
    assert solution.status in (Status.TIME_LIMIT, Status.OPTIMAL, Status.FEASIBLE)
    assert solution.bound is not None
    assert solution.bound >= solution.value
    assert len(solution.selected) == 12
