"""The plants against circles, finite differences and published rates."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.plants import (
    HEADING,
    SLIP,
    SPEED,
    STATE_SIZE,
    STEERING,
    YAW_RATE,
    Plant,
    SingleTrack,
    X,
    Y,
    move,
    plant_from_name,
    plant_parameters,
    single_track_rates,
    small_turn,
    wheel_motion,
)
from models.vehicle import Vehicle

CAR = Vehicle()


def drive(plant: Plant, parameters: np.ndarray, state: np.ndarray, steering: float, ticks: int):
    """Drive and return the states and what the wheels said of each tick."""
    states, wheels = [state.copy()], []
    for _ in range(ticks):
        wheels.append(move(int(plant), state, parameters, steering, 0.0, 0.01))
        states.append(state.copy())
    return np.array(states), np.array(wheels)


def test_the_bicycle_s_centre_drives_its_circle() -> None:
    state = np.zeros(STATE_SIZE)
    state[SPEED], state[STEERING] = 8.0, 0.3
    states, wheels = drive(Plant.KINEMATIC, plant_parameters(CAR), state, 0.3, 500)
    rear = CAR.wheelbase_m / math.tan(0.3)
    centre = np.array([-CAR.centre_to_rear_m, rear])
    radius = np.hypot(states[:, X] - centre[0], states[:, Y] - centre[1])
    # 500 chords of an arc: each is exact to turned⁴/1920
    np.testing.assert_allclose(radius, math.hypot(rear, CAR.centre_to_rear_m), atol=1e-9)
    assert wheels[:, 0].sum() == pytest.approx(8.0 * 5.0)
    assert states[-1, HEADING] == pytest.approx(40.0 / rear)


def test_odometry_of_the_bicycle_s_wheels_is_its_motion() -> None:
    state = np.zeros(STATE_SIZE)
    state[SPEED], state[STEERING], state[HEADING] = 12.0, -0.2, 0.7
    states, wheels = drive(Plant.KINEMATIC, plant_parameters(CAR), state, -0.1, 100)
    for a, b, (rolled, turned) in zip(states, states[1:], wheels, strict=False):
        forward, left = wheel_motion(rolled, turned, CAR.centre_to_rear_m)
        c, s = math.cos(a[HEADING]), math.sin(a[HEADING])
        assert b[X] - a[X] == pytest.approx(c * forward - s * left, abs=1e-12)
        assert b[Y] - a[Y] == pytest.approx(s * forward + c * left, abs=1e-12)
        assert b[HEADING] - a[HEADING] == pytest.approx(turned, abs=1e-15)


def test_small_turns_are_cosine_and_sine() -> None:
    for angle in np.linspace(-0.3, 0.3, 301):
        expected = (math.cos(angle), math.sin(angle))
        assert small_turn(angle) == pytest.approx(expected, rel=3e-14, abs=1e-17)


@pytest.mark.parametrize("plant", list(Plant))
def test_actuators_limit_angle_rate_and_pedal(plant: Plant) -> None:
    single = SingleTrack()
    car = single.vehicle()
    parameters = plant_parameters(car, single)
    state = np.zeros(STATE_SIZE)
    state[SPEED] = 10.0
    move(int(plant), state, parameters, 9.0, 99.0, 0.01)
    assert state[STEERING] == pytest.approx(0.01 * car.steering_rate_limit_rad_s)
    assert state[SPEED] == pytest.approx(10.0 + 0.01 * car.acceleration_limit_mps2)
    move(int(plant), state, parameters, 0.0, -99.0, 0.01)
    assert state[SPEED] == pytest.approx(10.0 + 0.01 * (3.0 - car.braking_limit_mps2))
    state[STEERING], state[SPEED] = car.steering_limit_rad, 2.0
    move(int(plant), state, parameters, 9.0, 0.0, 0.01)
    assert state[STEERING] == pytest.approx(car.steering_limit_rad)


def test_no_plant_drives_backwards() -> None:
    state = np.zeros(STATE_SIZE)
    state[SPEED] = 0.02
    for _ in range(5):
        move(1, state, plant_parameters(CAR, SingleTrack()), 0.1, -9.0, 0.01)
    assert state[SPEED] == 0.0
    assert np.isfinite(state).all()


# d/dt of (x, y, steering, speed, heading, yaw rate, slip) by vehicle_dynamics_st of
# commonroad-vehicle-models 3.0.2 with parameters_vehicle2, for states and inputs in that order.
PUBLISHED = [
    (
        [0.0, 0.0, 0.05, 15.0, 0.3, 0.2, 0.01],
        [0.1, 1.5],
        [
            14.285003548285701,
            4.575879546651652,
            0.1,
            1.5,
            0.2,
            1.1102577988824138,
            0.043928387130316326,
        ],
    ),
    (
        [1.0, 2.0, -0.08, 22.0, 1.3, -0.4, -0.02],
        [-0.9, -3.0],  # the steering rate is cut to −0.4
        [
            6.3077346119030215,
            21.076348926362947,
            -0.4,
            -3.0,
            -0.4,
            -3.281426931105691,
            0.14055469761681966,
        ],
    ),
]
ORDER = [X, Y, STEERING, SPEED, HEADING, YAW_RATE, SLIP]


@pytest.mark.parametrize(("state", "inputs", "rates"), PUBLISHED)
def test_single_track_rates_are_the_published_ones(
    state: list[float], inputs: list[float], rates: list[float]
) -> None:
    single = SingleTrack()
    ours = np.zeros(STATE_SIZE)
    ours[ORDER] = state
    rate = min(max(inputs[0], -single.steering_rate_limit_rad_s), single.steering_rate_limit_rad_s)
    got = single_track_rates(ours, plant_parameters(single.vehicle(), single), rate, inputs[1])
    np.testing.assert_allclose(got[ORDER], rates, rtol=1e-12)


def test_single_track_equals_commonroad_where_that_is_installed() -> None:
    parameters = pytest.importorskip("vehiclemodels.parameters_vehicle2").parameters_vehicle2()
    dynamics = pytest.importorskip("vehiclemodels.vehicle_dynamics_st").vehicle_dynamics_st
    single = SingleTrack()
    ours = plant_parameters(single.vehicle(), single)
    rng = np.random.default_rng(0)
    for _ in range(50):
        state = np.zeros(STATE_SIZE)
        state[ORDER] = rng.normal(size=7) * [9.0, 9.0, 0.2, 0.0, 2.0, 0.3, 0.05]
        state[SPEED] = rng.uniform(1.0, 25.0)
        u = [rng.uniform(-0.4, 0.4), rng.uniform(-4.0, 2.0)]
        theirs = np.array(dynamics(list(state[ORDER]), u, parameters))
        got = single_track_rates(state, ours, u[0], u[1])
        np.testing.assert_allclose(got[ORDER], theirs, rtol=1e-9, atol=1e-12)


def test_single_track_settles_on_the_linear_theory_s_circle() -> None:
    single = SingleTrack()
    parameters = plant_parameters(single.vehicle(), single)
    state = np.zeros(STATE_SIZE)
    speed, steering = 15.0, 0.03
    state[SPEED], state[STEERING] = speed, steering
    states, _ = drive(Plant.SINGLE_TRACK, parameters, state, steering, 800)
    # ψ̇ = v δ/(L + K v²); equal tyres front and rear: K = (l_r − l_f)·… = 0 up to the load share,
    # which cancels when cornering stiffness is proportional to load.
    expected = speed * steering / (single.front_m + single.rear_m)
    assert states[-1, YAW_RATE] == pytest.approx(expected, rel=1e-6)


def test_the_single_track_car_slips_where_the_bicycle_does_not() -> None:
    single = SingleTrack()
    state = np.zeros(STATE_SIZE)
    state[SPEED] = 20.0
    states, wheels = drive(
        Plant.SINGLE_TRACK, plant_parameters(single.vehicle(), single), state, 0.04, 200
    )
    x = y = heading = 0.0
    for rolled, turned in wheels:
        forward, left = wheel_motion(rolled, turned, single.rear_m)
        x += math.cos(heading) * forward - math.sin(heading) * left
        y += math.sin(heading) * forward + math.cos(heading) * left
        heading += turned
    missed = math.hypot(states[-1, X] - x, states[-1, Y] - y)
    assert heading == pytest.approx(states[-1, HEADING])
    assert 0.1 < missed < 4.0


def test_an_unknown_plant_is_refused() -> None:
    assert plant_from_name("single-track") is Plant.SINGLE_TRACK
    with pytest.raises(ValueError, match="plant must be one of kinematic, single-track, got hover"):
        plant_from_name("hover")
