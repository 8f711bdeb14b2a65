"""The rival loop drives as ours does, and the benchmark's table comes out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.closed_loop import cameras_every, closed_loop_table
from benchmarks.rivals import filterpy_loop
from models.errors import ErrorModel
from models.roads import Piece, road_from_pieces
from models.simulation import closed_loop, simulate
from models.vehicle import PROFILES


@pytest.mark.slow
def test_the_plain_python_loop_errs_as_much_as_ours() -> None:
    """Two programs that share nothing but the model: their rms errors over runs must agree."""
    road = road_from_pieces([Piece(40.0), Piece(30.0, 0.02, 0.02), Piece(40.0)])
    cameras, errors = cameras_every(road, 40.0), ErrorModel()
    ours = simulate(closed_loop(road, cameras, errors), filter="ekf", runs=1000)
    rng = np.random.default_rng(0)
    theirs = [
        filterpy_loop.drive(road, cameras, errors, PROFILES["car"], rng).error_m for _ in range(60)
    ]
    square = np.array([(errors_m**2).mean() for errors_m in theirs])
    expected = (ours.error_m**2).sum(axis=1) / ours.steps
    # a difference of means, in its own standard errors
    sigma = math.sqrt(square.var() / len(square) + expected.var() / len(expected))
    assert abs(square.mean() - expected.mean()) < 3.5 * sigma
    assert len(theirs[0]) == pytest.approx(ours.steps.mean(), abs=5.0)


@pytest.mark.slow
def test_the_closed_loop_is_a_hundred_times_the_rival_and_a_million_steps_a_second() -> None:
    ekf, schmidt, rival = closed_loop_table(turns=3)
    for row in (ekf, schmidt):
        assert row.median > 1e6
        assert row.median > 100.0 * rival.median
