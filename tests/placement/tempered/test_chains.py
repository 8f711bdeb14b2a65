"""Chains that stand for fractional choices of cameras, against dense matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.synthetic_drives import Samples, random_drive
from models.geometry import FloatArray
from models.vehicle import OdometryNoise
from placement.constraints import Constraints
from placement.objectives.entropy import Entropy
from placement.objectives.navigation_chain import Drive
from placement.objectives.windows.dense import DenseDrive
from placement.problem import Problem
from placement.solve import solve
from placement.tempered.background import chains_of, constant_of
from placement.tempered.bound import Tempered
from placement.tempered.chains import Chain, chain_of, mixed
from placement.tempered.chains import constant_of as constant_of_drive
from placement.tempered.line import make_line
from placement.tempered.pieces import pieces_of
from tests.placement.tempered.test_bound import best_placement, new_run, small_problem
from tests.placement.tempered.test_persistent import Dense

CERTAIN = (0.1, 0.1, 0.0)  # of a start whose heading is known
OPEN = (0.1, 0.1, 0.05)


def precision_of(chain: Chain, drive: Drive) -> FloatArray:
    """Return the information of a chain, for all of a trajectory."""
    t = len(chain.f)
    found = np.zeros((3 * t, 3 * t))
    found[:3, :3] = np.linalg.inv(np.diag(drive.initial_sigma**2)) + chain.start
    for s in range(1, t):
        both, step = slice(3 * s - 3, 3 * s + 3), np.hstack([-chain.f[s], np.eye(3)])
        found[both, both] += step.T @ chain.information[s] @ step
    return found


def small_drive(seed: int, sigma: tuple[float, float, float] = OPEN, **how: object) -> Drive:
    how = {"n_samples": 40, "n_candidates": 7, "offsets": 2, "initial_sigma": sigma} | how
    return random_drive(np.random.default_rng([91, seed]), **how)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("wrap", "samples", "isotropic"),
    [
        (False, 40, False),
        (True, 40, False),
        (True, 210, False),
        (False, 75, False),
        (False, 40, True),
    ],
)
def test_neighbours_have_the_covariance_that_they_have_in_truth(
    wrap: bool, samples: int, isotropic: bool
) -> None:
    drive = small_drive(1, wrap=wrap, n_samples=samples, isotropic=isotropic)
    x = np.random.default_rng(5).uniform(0.0, 0.8, 7)
    chain = chain_of(drive, x)
    assert chain is not None
    narrow, whole = pieces_of(drive)
    assert whole.all() == (not wrap or samples < 200)
    dense = DenseDrive(narrow)
    n = len(dense.prior)
    want = np.linalg.solve(np.eye(n) + dense.prior @ dense.information(x), dense.prior)
    got = np.linalg.inv(precision_of(chain, drive))
    scale = np.sqrt(np.diag(want))
    for t in range(samples - 1):
        pair = slice(3 * t, 3 * t + 6)
        error = (got - want)[pair, pair] / np.outer(scale[pair], scale[pair])
        assert np.abs(error).max() < 1e-5
    # it knows no more than that: of all with these covariances it has the greatest entropy
    excess = np.linalg.slogdet(got)[1] - np.linalg.slogdet(want)[1]
    assert excess > -1e-4


@pytest.mark.parametrize("theta", [1.0, 0.9, 0.4, 0.02])
def test_a_mix_is_the_sum_of_both_informations(theta: float) -> None:
    drive = small_drive(2)
    chain = chain_of(drive, np.random.default_rng(7).uniform(0.0, 0.8, 7))
    assert chain is not None
    prior = DenseDrive(drive).prior
    bare = np.linalg.inv(prior)
    both = (1.0 - theta) * precision_of(chain, drive) + theta * bare
    want = np.linalg.inv(both)
    process = mixed(drive, chain, theta)
    got = np.zeros_like(want)
    cov = process.prior[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    for t in range(len(cov)):
        now = slice(3 * t, 3 * t + 3)
        got[now, now] = cov[t]
        for s in range(t - 1, -1, -1):
            # Cov(x_t, x_s) = F_t … F_{s + 1} P_s
            move = np.eye(3)
            for u in range(t, s, -1):
                move = move @ process.f[u].reshape(3, 3)
            past = slice(3 * s, 3 * s + 3)
            got[now, past] = move @ cov[s]
            got[past, now] = got[now, past].T
    scale = np.sqrt(np.diag(want))
    assert np.abs((got - want) / np.outer(scale, scale)).max() < 1e-6
    log_det = [np.linalg.slogdet(m)[1] for m in (both, precision_of(chain, drive), bare)]
    constant = log_det[0] - (1.0 - theta) * log_det[1] - theta * log_det[2]
    found, magnitude = constant_of_drive(drive, chain, theta)
    assert found == pytest.approx(constant, abs=1e-6)
    assert magnitude >= abs(log_det[0])
    rounded_up = constant_of(Entropy([drive]), [chain], theta)
    assert found + 5e-12 * magnitude <= rounded_up <= found + 1e-7


def test_a_chain_is_a_sharper_background_than_none() -> None:
    """At a share near 0 the bound becomes the tangent at the background."""
    drive = small_drive(3)
    x = np.full(7, 0.4)
    chain = chain_of(drive, x)
    assert chain is not None
    theta = 1e-3
    dense = Dense(drive, chain, theta)
    everyone = constant_of(Entropy([drive]), [chain], theta) + dense.gain(list(range(7)))
    whole = Dense(drive, np.zeros((40, 3)), 1.0).gain(list(range(7)))
    loose = Dense(drive, np.zeros((40, 3)), theta).gain(list(range(7))) / theta
    assert whole <= everyone / theta <= 0.5 * loose


def test_a_start_that_is_known_for_certain_is_no_hindrance() -> None:
    drive = small_drive(4, sigma=CERTAIN)
    chain = chain_of(drive, np.full(7, 0.3))
    assert chain is not None
    process = mixed(drive, chain, 0.7)
    assert process.prior[0, 5] == 0.0
    nearly = small_drive(4, sigma=(0.1, 0.1, 1e-9))
    near_chain = chain_of(nearly, np.full(7, 0.3))
    assert near_chain is not None
    again = mixed(nearly, near_chain, 0.7)
    assert process.prior[1:] == pytest.approx(again.prior[1:], rel=1e-6, abs=1e-12)
    assert constant_of_drive(drive, chain, 0.7)[0] == pytest.approx(
        constant_of_drive(nearly, near_chain, 0.7)[0], abs=1e-6
    )


def test_odometry_without_noise_leaves_no_chain_but_problems_are_solved() -> None:
    still = OdometryNoise(
        heading_rad_per_sqrt_m=0.0, along_m_per_sqrt_m=0.02, across_m_per_sqrt_m=0.01
    )
    drive = small_drive(5, odometry=still)
    assert chain_of(drive, np.full(7, 0.3)) is None
    objective, constraints = Entropy([drive]), small_problem(0)[1]
    assert chains_of(objective, np.full(7, 0.3)) is None
    none = np.empty(0, dtype=np.int64)
    constraints = type(constraints)(7, 3, np.full(7, -1), none, none)
    found = solve(Problem(objective, constraints), "tempered")
    assert found.bound is not None
    assert found.bound >= found.value - 1e-9


def test_constants_count_as_often_as_their_drives() -> None:
    drives = [replace(small_drive(s), weight=w) for s, w in ((6, 3.0), (7, 0.25))]
    white = replace(drives[1].information, white=None, offsets=None)
    objective = Entropy([*drives, replace(drives[1], information=white, weight=2.0)])
    backgrounds = chains_of(objective, np.full(7, 0.3))
    assert backgrounds is not None
    assert np.any(backgrounds[2] != 0.0)
    parts = [
        constant_of(Entropy([replace(drive, weight=1.0)]), [base], 0.7)
        for drive, base in zip(objective.drives, backgrounds, strict=True)
    ]
    want = sum(d.weight * part for d, part in zip(objective.drives, parts, strict=True))
    assert constant_of(objective, backgrounds, 0.7) == pytest.approx(want, rel=1e-12)


@pytest.mark.parametrize(("strength", "spacing"), [(60.0, 1.5), (1e8, 10.0), (1e9, 50.0)])
def test_steps_that_cameras_tell_of_a_billion_times_as_well_keep_bounds_above(
    strength: float, spacing: float
) -> None:
    """The chain of the best placement itself, of errors next to white: the bound is that score."""
    none = np.empty(0, dtype=np.int64)
    for seed in range(25):
        drive = random_drive(
            np.random.default_rng(seed), n_samples=20, n_candidates=6, offsets=1,
            strength=strength, initial_sigma=OPEN,
        )  # fmt: skip
        info = drive.information
        assert info.offsets is not None
        info = replace(info, offsets=info.offsets * np.float32(1e-6 if seed % 2 else 1e-4))
        points = Samples(spacing * np.arange(20.0), drive.points.heading_rad)
        objective = Entropy([replace(drive, information=info, points=points)])
        constraints = Constraints(6, 2, np.full(6, -1), none, none)
        best, placement = best_placement(objective, constraints)
        background = chains_of(objective, np.isin(np.arange(6), placement).astype(np.float64))
        if background is None:
            continue
        line = make_line(objective, constraints, np.arange(6))
        for share in (0.9, 0.5):
            bound = Tempered(objective, line, 2, share, background, new_run()).bound()
            assert best <= bound
