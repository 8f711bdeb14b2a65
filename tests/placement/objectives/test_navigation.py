"""What every navigation objective must satisfy, against one dense matrix a trajectory."""

import numpy as np
import pytest

from benchmarks.synthetic_drives import CAR, ROBOT, Samples, random_drive
from placement.objectives.base import Objective, Relaxable
from placement.objectives.entropy import Entropy
from placement.objectives.final_entropy import FinalEntropy
from placement.objectives.navigation import NavigationObjective
from placement.objectives.navigation_chain import Drive
from placement.objectives.trace import Trace
from placement.objectives.windows.dense import DenseDrive, choice

KINDS = ["entropy", "position", "lateral", "final_entropy"]
SELECTED = np.array([3, 7, 11, 12])
CASES = [
    pytest.param({"isotropic": True}, id="isotropic"),
    pytest.param({}, id="full blocks"),
    pytest.param({"n_samples": 75, "wrap": True}, id="windows over the lap's end"),
    pytest.param({"n_samples": 40, "odometry": CAR, "initial_sigma": (0.1, 0.1, 0.01)}, id="car"),
    pytest.param({"offsets": 2}, id="two offsets"),
    pytest.param({"offsets": 6, "isotropic": True, "longest_window": 20}, id="six offsets"),
    pytest.param({"n_samples": 70, "wrap": True, "offsets": 3}, id="offsets over the lap's end"),
    pytest.param({"strength": 1e4, "initial_sigma": (30.0, 30.0, 0.3)}, id="strong cameras"),
]


def build(kind: str, drives: list[Drive]) -> NavigationObjective:
    if kind == "entropy":
        return Entropy(drives)
    if kind == "final_entropy":
        return FinalEntropy(drives)
    return Trace(drives, weight=kind)


def dense_score(kind: str, dense: DenseDrive, x: np.ndarray) -> float:
    if kind == "entropy":
        return dense.entropy(x)
    if kind == "final_entropy":
        return -dense.final_entropy(x)
    return -dense.trace(x, kind)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("kind", KINDS)
def test_values_and_gains_equal_the_dense_trajectory(kind: str, case: dict[str, object]) -> None:
    drive = random_drive(np.random.default_rng(1), **case)  # type: ignore[arg-type]
    objective, dense = build(kind, [drive]), DenseDrive(drive)
    x = choice(25, SELECTED)
    want = dense_score(kind, dense, x)
    sign = 1.0 if objective.maximise else -1.0
    state = objective.state(SELECTED)
    assert sign * objective.value(SELECTED) == pytest.approx(want, rel=1e-9)
    assert state.score == pytest.approx(want, rel=1e-9)
    gains = state.gains()
    assert np.all(gains[SELECTED] == 0.0)
    for i in range(0, 25, 3 if kind in ("position", "lateral") else 1):
        if i not in SELECTED:
            gain = dense_score(kind, dense, x + choice(25, [i])) - want
            # the dense solve itself loses digits with the condition of the prior
            assert gains[i] == pytest.approx(gain, rel=1e-8, abs=1e-9 * abs(want))


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("kind", KINDS)
def test_the_relaxed_gradient_equals_finite_differences(kind: str, case: dict[str, object]) -> None:
    drive = random_drive(np.random.default_rng(2), **case)  # type: ignore[arg-type]
    objective, dense = build(kind, [drive]), DenseDrive(drive)
    assert isinstance(objective, Relaxable)
    x = np.random.default_rng(3).uniform(0.05, 1.0, 25)
    score, gradient = objective.relaxed(x)
    assert score == pytest.approx(dense_score(kind, dense, x), rel=1e-9)
    h = 1e-4
    for i in range(0, 25, 4):
        e = h * choice(25, [i])
        slope = (objective.relaxed(x + e)[0] - objective.relaxed(x - e)[0]) / (2.0 * h)
        assert gradient[i] == pytest.approx(slope, rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_the_relaxed_score_is_the_score_at_placements_and_concave_between(kind: str) -> None:
    rng = np.random.default_rng(4)
    objective = build(kind, [random_drive(rng, n_samples=60)])
    sign = 1.0 if objective.maximise else -1.0
    assert objective.relaxed(choice(25, SELECTED))[0] == pytest.approx(
        sign * objective.value(SELECTED), rel=1e-12
    )
    for _ in range(200):
        x, y = rng.uniform(0.0, 1.0, (2, 25)) * (rng.random((2, 25)) < 0.4)
        at_x, gradient = objective.relaxed(x)
        at_y = objective.relaxed(y)[0]
        assert at_y <= at_x + gradient @ (y - x) + 1e-10 * abs(at_x)


@pytest.mark.parametrize("kind", KINDS)
def test_adding_and_removing_ends_where_a_fresh_state_begins(kind: str) -> None:
    objective = build(kind, [random_drive(np.random.default_rng(5), n_samples=60)])
    state = objective.state()
    for i in (5, 9, 2, 17):
        state.add(i)
    state.remove(9)
    state.remove(2)
    fresh = objective.state(np.array([17, 5]))
    assert state.selected == [5, 17]
    assert state.score == fresh.score
    np.testing.assert_array_equal(state.gains(), fresh.gains())
    before, gain = state.score, state.gains(np.array([9]))[0]
    state.add(9)
    assert state.score - before == pytest.approx(gain, rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_no_camera_ever_harms_and_a_blind_one_changes_nothing(kind: str) -> None:
    drive = random_drive(np.random.default_rng(6), n_samples=60)
    info = drive.information
    blind = int(np.argmin(np.diff(info.indptr)))
    gains = build(kind, [drive]).state(np.array([1, 4])).gains()
    assert np.all(gains >= -1e-15)
    if info.indptr[blind] == info.indptr[blind + 1]:
        assert gains[blind] == 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_several_drives_add_up_by_weight(kind: str) -> None:
    one = random_drive(np.random.default_rng(7), n_samples=40)
    two = random_drive(np.random.default_rng(8), n_samples=25, odometry=CAR)
    heavy = Drive(two.points, two.information, two.odometry, two.initial_sigma, weight=2.5)
    both, first, second = build(kind, [one, heavy]), build(kind, [one]), build(kind, [two])
    assert both.value(SELECTED) == pytest.approx(
        first.value(SELECTED) + 2.5 * second.value(SELECTED), rel=1e-13
    )
    np.testing.assert_allclose(
        both.state(SELECTED).gains(),
        first.state(SELECTED).gains() + 2.5 * second.state(SELECTED).gains(),
        rtol=1e-12,
    )


@pytest.mark.parametrize("kind", KINDS)
def test_turning_the_scene_changes_nothing(kind: str) -> None:
    drive = random_drive(np.random.default_rng(9), n_samples=60)
    turned = Samples(
        np.asarray(drive.points.s_m), np.asarray((drive.points.heading_rad + 2.0) % (2.0 * np.pi))
    )
    other = Drive(turned, drive.information, drive.odometry, drive.initial_sigma)
    assert build(kind, [other]).value(SELECTED) == pytest.approx(
        build(kind, [drive]).value(SELECTED), rel=1e-11
    )


@pytest.mark.parametrize("offsets", [0, 4])
@pytest.mark.parametrize("kind", KINDS)
def test_a_window_gain_equals_filtering_the_road_again(kind: str, offsets: int) -> None:
    drive = random_drive(
        np.random.default_rng(10),
        n_samples=1500,
        n_candidates=60,
        longest_window=40,
        wrap=True,
        offsets=offsets,
    )
    objective = build(kind, [drive])
    state = objective.state(SELECTED)
    sign = 1.0 if objective.maximise else -1.0
    base = objective.value(SELECTED)
    gains = state.gains()
    for i in set(range(60)) - set(SELECTED.tolist()):
        again = sign * (objective.value(np.append(SELECTED, i)) - base)
        assert gains[i] == pytest.approx(again, rel=1e-9, abs=1e-9 * abs(base))


def test_objectives_meet_the_protocol() -> None:
    objective: Objective = Entropy([random_drive(np.random.default_rng(0))])
    assert objective.n_candidates == 25
    assert (objective.name, objective.unit, objective.submodular) == ("entropy", "nats", True)


@pytest.mark.parametrize("kind", KINDS)
def test_bad_selections_are_refused(kind: str) -> None:
    objective = build(kind, [random_drive(np.random.default_rng(0))])
    with pytest.raises(ValueError, match="must hold candidates 0…24, got 25"):
        objective.value(np.array([1, 25]))
    with pytest.raises(ValueError, match="must hold each candidate once, got 3 twice"):
        objective.value(np.array([3, 3]))
    state = objective.state(np.array([3]))
    with pytest.raises(ValueError, match="candidate 3 is already selected"):
        state.add(3)
    with pytest.raises(ValueError, match="candidate 4 is not selected"):
        state.remove(4)


def test_drives_that_see_other_candidates_are_refused() -> None:
    one = random_drive(np.random.default_rng(0), n_candidates=5)
    two = random_drive(np.random.default_rng(0), n_candidates=6)
    with pytest.raises(ValueError, match=r"the same candidates, got counts \[5, 6\]"):
        Entropy([one, two])
    with pytest.raises(ValueError, match="at least one drive, got none"):
        Entropy([])


def test_an_unknown_weight_is_refused() -> None:
    with pytest.raises(ValueError, match=r"objective\.weight must be one of .* got 'heading'"):
        Trace([random_drive(np.random.default_rng(0))], weight="heading")


def test_a_final_state_without_uncertainty_is_refused() -> None:
    drive = random_drive(np.random.default_rng(0), odometry=type(ROBOT)(0.0, 0.01, 0.01))
    with pytest.raises(ValueError, match="leave the final state exactly known"):
        FinalEntropy([drive])
