"""The curvature of `entropy` with persistent offsets, against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.synthetic_drives import random_drive
from placement.objectives.windows.dense import DenseDrive
from placement.objectives.windows.offset_curvature import OffsetCurvature


@pytest.mark.parametrize("wrap", [False, True])
def test_with_a_node_at_every_sample_it_is_exact(wrap: bool) -> None:
    rng = np.random.default_rng(5)
    for _ in range(3):
        drive = random_drive(rng, n_samples=24, n_candidates=7, wrap=wrap, offsets=3)
        dense = DenseDrive(drive)
        x = rng.uniform(0.0, 1.0, 7) * (rng.uniform(size=7) < 0.7)
        posterior = dense.prior @ np.linalg.inv(
            np.eye(len(dense.prior)) + dense.information(x) @ dense.prior
        )
        through = [dense.camera(i) @ posterior for i in range(7)]
        want = [[-float(np.sum(a * b.T)) for b in through] for a in through]
        found = OffsetCurvature(drive)
        assert found.every == 1
        exact = pytest.approx(np.array(want), rel=1e-5, abs=1e-7)
        assert found.at(x, np.arange(7)) == exact
        some = np.array([5, 1, 2])
        assert found.at(x, some) == pytest.approx(np.array(want)[np.ix_(some, some)], rel=1e-5)


def test_few_nodes_come_near_where_windows_are_long() -> None:
    rng = np.random.default_rng(2)
    drive = random_drive(rng, n_samples=60, n_candidates=6, offsets=3)
    x = np.full(6, 0.4)
    exact = OffsetCurvature(drive).at(x, np.arange(6))
    coarse = OffsetCurvature(drive, most_nodes=30)
    assert coarse.every == 2
    assert coarse.at(x, np.arange(6)) == pytest.approx(
        exact, abs=0.1 * float(np.max(np.abs(exact)))
    )
