"""The closed loop: seeds, delays, calibration, dead reckoning, and input it must refuse."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from models.cameras import Cameras
from models.consistency import StepTally
from models.errors import ErrorModel
from models.files.centreline import read_centreline
from models.geometry import Pose
from models.installation import Installation
from models.roads import Piece, Road, road_from_pieces
from models.simulation import (
    FILTERS,
    Drives,
    FilterName,
    Settings,
    closed_loop,
    nominal_drive,
    predict_along,
    simulate,
)
from models.vehicle import PROFILES, OdometryNoise

ROAD = road_from_pieces(
    [
        Piece(60.0),
        Piece(30.0, 0.0, 0.02),
        Piece(40.0, 0.02, 0.02),
        Piece(30.0, 0.02, 0.0),
        Piece(60),
    ]
)
RING = road_from_pieces([Piece(2.0 * math.pi * 30.0, 1 / 30.0, 1 / 30.0)], closed=True)
PERFECTLY_INSTALLED = ErrorModel("covariance", Installation(0.0, 0.0, 4.0))


def cameras_along(road: Road, every_m: float, count: int | None = None) -> Cameras:
    """Cameras 3 m left of the road, 6 m up, looking back along it at 40° below the horizon."""
    s = np.arange(0.5 * every_m, road.length_m, every_m)[:count]
    xy, n = road.offset(s, np.full(len(s), 3.0)), len(s)
    return Cameras(
        x_m=xy[:, 0],
        y_m=xy[:, 1],
        height_m=np.full(n, 6.0),
        yaw_rad=road.evaluate(s).heading_rad + math.pi if n else np.zeros(0),
        pitch_rad=np.full(n, math.radians(40.0)),
        roll_rad=np.zeros(n),
        hfov_rad=np.full(n, math.radians(60.0)),
        vfov_rad=np.full(n, math.radians(60.0)),
        width_px=np.full(n, 900),
        height_px=np.full(n, 900),
        projection=np.zeros(n, dtype=np.int64),
        distortion=np.zeros((n, 4)),
    )


CAMERAS = cameras_along(ROAD, 50.0)
NOBODY = CAMERAS.subset([])


def rms_error(drives: Drives) -> float:
    return math.sqrt((drives.error_m**2).sum() / drives.steps.sum())


def share_in_band(drives: Drives) -> float:
    tally = StepTally()
    tally.add(drives)
    return tally.share_in_band()


@pytest.mark.parametrize("kind", FILTERS)
def test_run_seven_is_run_seven(kind: FilterName) -> None:
    loop = closed_loop(
        ROAD, CAMERAS, ErrorModel(), settings=Settings(latency_s=0.08, missed=0.04, false=0.01)
    )
    alone = simulate(loop, filter=kind, runs=[7], seed=3)
    among = simulate(loop, filter=kind, runs=10, seed=3, workers=2)
    steps = int(alone.steps[0])
    assert among.steps[7] == steps
    for name in ("s_m", "lateral_m", "error_m", "claimed_m2", "nees"):
        np.testing.assert_array_equal(getattr(alone, name)[0], getattr(among, name)[7, :steps])
    assert not np.array_equal(among.error_m[6, :50], among.error_m[7, :50])
    other = simulate(loop, filter=kind, runs=[7], seed=4)
    assert not np.array_equal(alone.error_m[0, :50], other.error_m[0, :50])


def test_every_number_is_finite_and_zero_after_the_end() -> None:
    loop = closed_loop(ROAD, CAMERAS, ErrorModel(), settings=Settings(false=0.05))
    drives = simulate(loop, runs=5)
    for column in fields(drives):
        value = getattr(drives, column.name)
        if isinstance(value, np.ndarray):
            assert np.isfinite(value).all(), column.name
    assert (drives.nees[~drives.active] == 0.0).all()
    assert drives.arrived.all()


def test_the_nominal_drive_errs_nowhere() -> None:
    drives = nominal_drive(closed_loop(ROAD, CAMERAS, ErrorModel()))
    assert drives.error_m.max() < 1e-9
    assert drives.updates[0] > 20
    assert drives.s_m[0, -1] == pytest.approx(ROAD.length_m - 1.35, abs=0.9)


def test_both_filters_are_one_where_no_offset_persists() -> None:
    loop = closed_loop(ROAD, CAMERAS, PERFECTLY_INSTALLED)
    ekf, schmidt = (simulate(loop, filter=kind, runs=3) for kind in FILTERS)
    np.testing.assert_allclose(ekf.error_m, schmidt.error_m, atol=1e-6)


@pytest.mark.parametrize("kind", FILTERS)
def test_a_moved_scene_drives_the_same(kind: FilterName) -> None:
    moved = ROAD.transformed(Pose(1e5, -1e5, 2.3))
    here = simulate(closed_loop(ROAD, CAMERAS, ErrorModel()), filter=kind, runs=3)
    there = simulate(
        closed_loop(moved, cameras_along(moved, 50.0), ErrorModel()), filter=kind, runs=3
    )
    np.testing.assert_allclose(here.error_m, there.error_m, atol=1e-5)
    np.testing.assert_allclose(here.lateral_m, there.lateral_m, atol=1e-5)


@pytest.mark.parametrize("kind", FILTERS)
def test_late_measurements_lose_nothing_once_they_have_arrived(kind: FilterName) -> None:
    """The nominal drive linearises about the truth either way, so the covariances must meet."""
    one = cameras_along(ROAD, 100.0, 1)
    prompt, late = (
        nominal_drive(
            closed_loop(ROAD, one, ErrorModel(), settings=Settings(latency_s=latency)),
            filter=kind,
        )
        for latency in (0.0, 0.37)
    )
    gap = np.abs(late.claimed_m2 / prompt.claimed_m2 - 1.0)[0]
    assert gap.max() > 0.1  # while they were under way
    assert gap[-20:].max() < 1e-9
    assert late.updates[0] == prompt.updates[0]


def test_the_wheels_of_a_slow_and_a_fast_filter_say_the_same() -> None:
    claims, errors = [], []
    for hz in (25.0, 100.0):
        settings = Settings(filter_hz=hz, initial_sigma=(0.0, 0.0, 0.0))
        loop = closed_loop(ROAD, NOBODY, ErrorModel(), settings=settings)
        drives = simulate(loop, runs=400, filter="ekf")
        claims.append(math.sqrt(nominal_drive(loop).claimed_m2[0, -1]))
        errors.append(math.sqrt((drives.end_error_m**2).sum(axis=1).mean()))
    assert claims[0] == pytest.approx(claims[1], rel=0.01)
    assert errors[0] == pytest.approx(claims[0], rel=0.1)
    assert errors[0] == pytest.approx(errors[1], rel=0.02)  # the same wheels, run by run


@pytest.mark.parametrize("profile", PROFILES)
def test_dead_reckoning_grows_as_it_claims(profile: str) -> None:
    road = road_from_pieces([Piece(400.0)])
    noise = PROFILES[profile]
    settings = Settings(initial_sigma=(0.0, 0.0, 0.0))
    drives = simulate(
        closed_loop(road, NOBODY, ErrorModel(), odometry=noise, settings=settings), runs=400
    )
    rms = math.sqrt((drives.end_error_m**2).sum(axis=1).mean())
    # 400 m less the front overhang of 1.35 m, straight
    expected = noise.covariance(398.65)[:2, :2].trace()
    assert rms == pytest.approx(math.sqrt(expected), rel=0.08)
    if profile == "car":
        assert 0.002 < rms / 400.0 < 0.02


def test_schmidt_is_calibrated_and_the_ekf_is_not() -> None:
    loop = closed_loop(ROAD, CAMERAS, ErrorModel())
    ekf, schmidt = (simulate(loop, filter=kind, runs=400) for kind in FILTERS)
    assert share_in_band(schmidt) >= 0.9
    assert share_in_band(ekf) < 0.5
    predicted = math.sqrt(nominal_drive(loop).claimed_m2.mean())
    assert rms_error(schmidt) == pytest.approx(predicted, rel=0.05)
    assert schmidt.nis.mean() == pytest.approx(2.0, abs=0.1)


def test_without_offsets_innovations_are_white() -> None:
    drives = simulate(closed_loop(ROAD, CAMERAS, PERFECTLY_INSTALLED), filter="ekf", runs=200)
    assert share_in_band(drives) >= 0.9
    pairs = drives.pairs.sum()
    lag_one = (drives.autocorrelation * drives.pairs).sum() / pairs
    assert abs(lag_one) < 3.0 / math.sqrt(2.0 * pairs)


def test_the_gate_counts_what_it_rejects() -> None:
    settings = Settings(false=0.2)
    drives = simulate(closed_loop(ROAD, CAMERAS, ErrorModel(), settings=settings), runs=20)
    clean = simulate(closed_loop(ROAD, CAMERAS, ErrorModel()), runs=20)
    assert drives.rejected.sum() > 20 * clean.rejected.sum()
    assert clean.rejected.sum() < 0.002 * clean.updates.sum()
    assert rms_error(drives) < 1.2 * rms_error(clean)


def test_missed_detections_cost_their_share_of_updates() -> None:
    settings = Settings(missed=0.3)
    some = simulate(closed_loop(ROAD, CAMERAS, ErrorModel(), settings=settings), runs=50)
    every = simulate(closed_loop(ROAD, CAMERAS, ErrorModel()), runs=50)
    assert some.updates.sum() / every.updates.sum() == pytest.approx(0.7, abs=0.05)


def test_the_front_axle_follows_a_bend_so_the_centre_cuts_it() -> None:
    drives = nominal_drive(closed_loop(RING, NOBODY, ErrorModel()))
    centre = math.sqrt(30.0**2 - 2.7**2 + 1.35**2)
    np.testing.assert_allclose(drives.lateral_m[0, -50:], 30.0 - centre, atol=0.01)


def test_the_car_steers_by_its_estimate() -> None:
    road = road_from_pieces([Piece(200.0)])
    start = Settings(initial_sigma=(1e-6, 0.5, 1e-6))
    wheels = OdometryNoise(1e-7, 1e-6, 1e-6)
    drives = simulate(
        closed_loop(road, NOBODY, ErrorModel(), odometry=wheels, settings=start), runs=10
    )
    # where it believes to be on the centre line, it is beside it by what it does not know
    last = drives.steps - 1
    rows = np.arange(10)
    lateral, error = drives.lateral_m[rows, last], drives.error_m[rows, last]
    np.testing.assert_allclose(np.abs(lateral), error, atol=2e-3)
    assert error.max() > 0.3


def test_the_single_track_car_arrives_and_its_slip_shows() -> None:
    kinematic, dynamic = (
        simulate(closed_loop(ROAD, CAMERAS, ErrorModel(), plant=plant), runs=100)
        for plant in ("kinematic", "single-track")
    )
    assert dynamic.arrived.all()
    assert np.abs(dynamic.lateral_m).max() < 3.0
    assert rms_error(dynamic) < 1.3 * rms_error(kinematic)


def test_predictions_along_the_road_follow_the_claims() -> None:
    loop = closed_loop(ROAD, CAMERAS, ErrorModel())
    s = np.linspace(0.0, ROAD.length_m, 50)
    position, lateral = predict_along(loop, s)
    assert position.shape == lateral.shape == (50,)
    assert (lateral < position).all()
    assert (lateral > 0.0).all()
    drives = nominal_drive(loop)
    at = int(np.argmin(np.abs(drives.s_m[0] - s[20])))
    assert position[20] == pytest.approx(math.sqrt(drives.claimed_m2[0, at]), rel=0.1)


def test_a_road_too_tight_is_said_before_driving() -> None:
    road = road_from_pieces([Piece(20.0), Piece(5.0, 0.3, 0.3), Piece(20.0)])
    with pytest.raises(ValueError, match=r"road: its radius must be at least .* at s = 2\d\.\d m"):
        closed_loop(road, CAMERAS, ErrorModel())


def test_a_latency_longer_than_the_drive_is_refused() -> None:
    with pytest.raises(ValueError, match=r"latency_s must be shorter than the drive of 1\d\.\d s"):
        closed_loop(ROAD, CAMERAS, ErrorModel(), settings=Settings(latency_s=60.0))


def test_a_filter_that_knows_everything_for_sure_is_said_to_be_broken() -> None:
    loop = closed_loop(
        ROAD,
        NOBODY,
        ErrorModel(),
        odometry=OdometryNoise(0.0, 0.0, 0.0),
        settings=Settings(initial_sigma=(0.0, 0.0, 0.0)),
    )
    with pytest.raises(ValueError, match=r"run 0 \(schmidt\): the filter's covariance is not pos"):
        simulate(loop, runs=2)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"filter_hz": 30.0}, "simulation.filter_hz"),
        ({"filter_hz": 0.0}, "simulation.filter_hz"),
        ({"frame_hz": 500.0}, "camera.rate_hz"),
        ({"latency_s": -0.1}, "simulation.latency_s"),
        ({"latency_s": math.nan}, "simulation.latency_s"),
        ({"gate": 1.0}, "simulation.gate"),
        ({"initial_sigma": (0.1, -0.1, 0.0)}, "vehicle.initial_sigma"),
    ],
)
def test_impossible_settings_are_refused(change: dict[str, float], name: str) -> None:
    with pytest.raises(ValueError, match=name):
        Settings(**change)


def test_bad_runs_and_filters_are_refused() -> None:
    loop = closed_loop(ROAD, CAMERAS, ErrorModel())
    with pytest.raises(ValueError, match="runs must be at least 1, got 0"):
        simulate(loop, runs=0)
    with pytest.raises(ValueError, match="filter must be one of ekf, schmidt, got ukf"):
        simulate(loop, filter="ukf", runs=1)  # type: ignore[arg-type]


def test_a_camera_by_the_start_of_a_lap_is_met_again_at_its_end() -> None:
    by_the_start = cameras_along(RING, 4.0, 1)
    loop = closed_loop(RING, by_the_start, ErrorModel())
    assert loop.sensors.last_s_m[0] == pytest.approx(RING.length_m)
    across = closed_loop(RING, cameras_along(RING, RING.length_m, 1), ErrorModel())
    assert across.sensors.last_s_m[0] < RING.length_m - 10.0


@pytest.mark.slow
@pytest.mark.parametrize("latency_s, missed", [(0.0, 0.0), (0.08, 0.04)])
def test_both_filters_on_norisring(
    shared_data: Callable[[str], Path], latency_s: float, missed: float
) -> None:
    road = read_centreline(shared_data("tracks/Norisring.csv"))
    cameras = cameras_along(road, 150.0)
    settings = Settings(latency_s=latency_s, missed=missed)
    loop = closed_loop(road, cameras, ErrorModel(), settings=settings)
    ekf, schmidt = (simulate(loop, filter=kind, runs=400, workers=2) for kind in FILTERS)
    assert share_in_band(schmidt) >= 0.9
    assert share_in_band(ekf) < 0.5
    predicted = math.sqrt(nominal_drive(loop).claimed_m2.mean())
    assert rms_error(schmidt) == pytest.approx(predicted, rel=0.05)
    perfect = closed_loop(road, cameras, PERFECTLY_INSTALLED, settings=settings)
    for kind in FILTERS:
        assert share_in_band(simulate(perfect, filter=kind, runs=400, workers=2)) >= 0.9
