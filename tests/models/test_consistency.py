"""Bands for NEES and whiteness, against simulated filters that are right and wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from models.consistency import StepTally, bootstrap_band, chi2_band, whiteness_band
from models.simulation import Drives


def drives(nees: np.ndarray, steps: np.ndarray) -> Drives:
    """Drives with only the NEES filled in."""
    m, zero = len(steps), np.zeros_like(nees)
    on = np.arange(nees.shape[1])[None, :] < steps[:, None]
    whole = np.zeros(m, dtype=np.int64)
    return Drives(
        filter="ekf",
        seed=0,
        runs=np.arange(m),
        arrived=np.ones(m, dtype=np.bool_),
        steps=steps,
        s_m=zero,
        lateral_m=zero,
        error_m=zero,
        claimed_m2=zero,
        claimed_lateral_m2=zero,
        nees=nees * on,
        updates=whole,
        rejected=whole,
        nis=np.zeros(m),
        autocorrelation=np.zeros(m),
        pairs=whole,
        end_error_m=np.zeros((m, 2)),
        ticks=whole,
    )


def test_the_band_of_a_single_run_is_that_of_chi_square() -> None:
    low, high = chi2_band(np.array([1.0]), 3)
    assert (low[0], high[0]) == pytest.approx((stats.chi2.ppf(0.025, 3), stats.chi2.ppf(0.975, 3)))


def test_a_right_filter_lies_in_its_band_and_a_wrong_one_does_not() -> None:
    rng = np.random.default_rng(0)
    nees = rng.chisquare(3, size=(300, 500))
    steps = rng.integers(400, 501, size=300)
    right, wrong = StepTally(), StepTally()
    for part in (slice(0, 100), slice(100, 300)):
        right.add(drives(nees[part], steps[part]))
        wrong.add(drives(1.3 * nees[part], steps[part]))
    # steps are independent here: 95 % ± 1 %
    assert right.share_in_band() == pytest.approx(0.95, abs=0.04)
    assert wrong.share_in_band() < 0.15


def test_batches_add_up_whatever_their_lengths() -> None:
    rng = np.random.default_rng(1)
    nees = rng.chisquare(3, size=(10, 50))
    steps = np.array([50, 40, 45, 50, 50, 30, 50, 50, 20, 50])
    whole, parts = StepTally(), StepTally()
    whole.add(drives(nees, steps))
    parts.add(drives(nees[5:6, :30], steps[5:6]))
    parts.add(drives(nees[:5], steps[:5]))
    parts.add(drives(nees[6:], steps[6:]))
    for ours, theirs in zip(whole.judged(), parts.judged(), strict=True):
        np.testing.assert_allclose(ours, theirs)


def test_steps_that_few_runs_reach_are_not_judged() -> None:
    tally = StepTally()
    tally.add(drives(np.ones((4, 10)), np.array([5, 5, 5, 10])))
    assert len(tally.judged()[0]) == 5


def test_the_bootstrap_band_covers_runs_not_steps() -> None:
    rng = np.random.default_rng(2)
    # one number a run, repeated over its hundred steps: the band is that of 400 numbers
    values = 3.0 + rng.normal(size=400)
    counts = np.full(400, 100.0)
    low, high = bootstrap_band(values * counts, counts, np.random.default_rng(3))
    half = 1.96 * values.std() / math.sqrt(400)
    assert low == pytest.approx(values.mean() - half, abs=0.2 * half)
    assert high == pytest.approx(values.mean() + half, abs=0.2 * half)


def test_the_whiteness_band_holds_white_sequences() -> None:
    rng = np.random.default_rng(4)
    white = rng.normal(size=(2000, 101, 2))
    found = (white[:, 1:] * white[:, :-1]).sum(axis=(1, 2)) / 200.0
    assert np.mean(np.abs(found) < whiteness_band(100)) == pytest.approx(0.95, abs=0.02)
    assert whiteness_band(0) == math.inf
