"""Gains given all that came before, against dense matrices; covariances above two others."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest

from benchmarks.synthetic_drives import random_drive
from models.geometry import FloatArray
from placement.constraints import Constraints
from placement.objectives.entropy import Entropy
from placement.tempered import labels, paths
from placement.tempered.background import background_of, stand_in
from placement.tempered.bound import SecondOrder, Tempered
from placement.tempered.crossings import run_through, work_space
from placement.tempered.diagram import Diagram, lay_out
from placement.tempered.line import Line, make_line
from placement.tempered.process import cameras_of, prior_at, take_in
from tests.placement.tempered.test_bound import new_run
from tests.placement.tempered.test_persistent import Dense

NONE = np.empty(0, dtype=np.int64)


def random_covariance(rng: np.random.Generator) -> FloatArray:
    a = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-3, 2, 3)
    return a @ a.T + 1e-9 * np.diag(10.0 ** rng.uniform(-3, 2, 3))


def packed(matrix: FloatArray) -> tuple[float, ...]:
    return tuple(float(matrix[i, j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))


def unpacked(p: tuple[float, ...]) -> FloatArray:
    return np.array([[p[0], p[1], p[2]], [p[1], p[3], p[4]], [p[2], p[4], p[5]]])


def is_above(u: FloatArray, a: FloatArray) -> bool:
    """Say whether U ⪰ A, up to the rounding of A's own square root."""
    scale = np.diag(1.0 / np.sqrt(np.diag(u)))
    least = np.linalg.eigvalsh(scale @ (u - a) @ scale)[0]
    return bool(least >= -1e-12)


def test_above_is_above_both_and_no_more_than_their_sum() -> None:
    rng = np.random.default_rng(1)
    m, v = np.empty((3, 3)), np.empty((3, 3))
    for _ in range(300):
        a, b = random_covariance(rng), random_covariance(rng)
        u = unpacked(labels.above(packed(a), packed(b), m, v))
        assert is_above(u, a)
        assert is_above(u, b)
        assert is_above((a + b) * (1.0 + 1e-4), u)
        # minimal: U touches A and B, so that no direction is above both by more than rounding
        gap = min(np.linalg.det(u - a) / np.linalg.det(u), np.linalg.det(u - b) / np.linalg.det(u))
        assert gap < 1e-6


@pytest.mark.parametrize("singular", [np.zeros((3, 3)), np.diag([1.0, 0.0, 0.0])])
def test_above_of_a_singular_covariance_is_the_sum(singular: FloatArray) -> None:
    b = random_covariance(np.random.default_rng(2))
    u = labels.above(packed(singular), packed(b), np.empty((3, 3)), np.empty((3, 3)))
    assert unpacked(u) == pytest.approx(singular + b)


def test_predecessors_share_places_in_their_order() -> None:
    line = Line(np.arange(4), np.full(4, -1), np.zeros(4, dtype=np.bool_))
    layout = lay_out(paths.lay_out(line), 2, 3)
    assert list(np.diff(layout.state_of)) == [1, 4, 7, 7]
    # arcs sorted by source: 0→1, 0→2, 0→3, 1→2, 1→3, 2→3
    assert list(layout.base) == [1, 1, 1, 4, 1, 4]
    assert list(np.diff(layout.gain_at)) == [1, 1, 1, 4, 4, 7]
    assert list(layout.target[layout.place]) == [1, 2, 2, 3, 3, 3]


@pytest.mark.parametrize("offsets", [0, 2])
@pytest.mark.parametrize(("width", "second"), [(1, False), (3, False), (9, False), (9, True)])
def test_gains_are_above_those_given_the_whole_of_any_path(
    offsets: int, width: int, second: bool
) -> None:
    rng = np.random.default_rng([7, offsets])
    drive = random_drive(rng, n_samples=30, n_candidates=8, longest_window=9, offsets=offsets)
    objective = Entropy([drive])
    line = make_line(objective, Constraints(8, 5, np.full(8, -1), NONE, NONE), np.arange(8))
    background = background_of(stand_in(objective), rng.uniform(0.0, 0.3, 8))
    share = 0.8
    dense = Dense(drive, background[0], share)
    first = Tempered(objective, line, 5, share, background, new_run())
    chain = SecondOrder(first, -np.inf) if second else None
    diagram = Diagram(first, width, -np.inf, chain)
    layout = diagram.layout

    def arc(h: int, i: int) -> int:
        out = np.arange(layout.out_of[h], layout.out_of[h + 1])
        return int(out[layout.target[out] == i][0])

    @functools.cache
    def score(*positions: int) -> float:
        return dense.gain([int(line.candidate[i]) for i in positions])

    slack = []
    for r in range(1, 5):
        for path in itertools.combinations(range(8), r + 1):
            *before, j, k = path
            label = 0
            for h, i in itertools.pairwise((*before, j)):
                label = int(layout.leads[layout.gain_at[arc(h, i)] + label])
            gain = float(diagram.gains[layout.gain_at[arc(j, k)] + label])
            want = score(*path) - score(*before, j)
            assert gain >= want - 1e-10
            slack.append(gain - want)
            if not before:
                assert gain == pytest.approx(want, rel=1e-6, abs=1e-8)
    # and they do condition on more than the one before
    assert np.sum(slack) < np.sum(
        [
            max(float(first.pairs[p[-2], p[-1]]) - (score(*p) - score(*p[:-1])), 0.0)
            for r in range(1, 5)
            for p in itertools.combinations(range(8), r + 1)
        ]
    )


def test_wider_is_tighter_and_the_second_order_tightens_it_further() -> None:
    rng = np.random.default_rng(11)
    bounds = []
    for width, capped in ((1, False), (3, False), (12, False), (12, True)):
        total = 0.0
        for seed in range(5):
            drive = random_drive(
                np.random.default_rng([11, seed]), n_samples=60, n_candidates=20, longest_window=8
            )
            objective = Entropy([drive])
            constraints = Constraints(20, 8, np.full(20, -1), NONE, NONE)
            line = make_line(objective, constraints, np.arange(20))
            background = background_of(objective, rng.uniform(0.0, 0.2, 20) * 0.0)
            first = Tempered(objective, line, 8, 1.0, background, new_run())
            second = SecondOrder(first, -np.inf) if capped else None
            total += Diagram(first, width, -np.inf, second).bound()
        bounds.append(total)
    assert bounds == sorted(bounds, reverse=True)
    assert bounds[-1] < bounds[0]


@pytest.mark.parametrize("offsets", [0, 2])
def test_a_car_knows_what_its_camera_told_before_a_sample_and_no_more(offsets: int) -> None:
    rng = np.random.default_rng([19, offsets])
    drive = random_drive(rng, n_samples=24, n_candidates=4, longest_window=10, offsets=offsets)
    base = rng.uniform(0.0, 30.0, (24, 1)) * np.array([1.0, 0.2, 1.0])
    process = take_in(drive.steps(), drive.initial_covariance(), base)
    cameras, dense = cameras_of(drive, 1.0), Dense(drive, base, 1.0)
    for j in range(4):
        first, last = int(cameras.first[j]), int(cameras.last[j])
        early_at = max(first - 2, 0)
        entry, early = prior_at(process, first), prior_at(process, early_at)
        by = np.full((24, 6), np.nan)
        space = work_space(1, cameras.offsets.shape[2])
        labels.set_covariance(space[0], entry)
        none = np.empty((len(space[0]), 0))
        run_through(process, cameras, np.array([j]), first, last, space, none, by)
        labels.predict_ahead(process, tuple(by[last]), last, 23, by)
        for t in range(24):
            # the background is known at every sample, the camera's word before this one alone
            told = dense.y + dense.dense.camera(j, until=t - 1)
            prior = dense.dense.prior
            known = np.linalg.solve(np.eye(72) + prior @ told, prior)
            got = labels.car_at(process, t, by, first, last, early, entry, early_at)
            want = known[3 * t : 3 * t + 3, 3 * t : 3 * t + 3]
            assert unpacked(got) == pytest.approx(want, rel=1e-6, abs=1e-12)
