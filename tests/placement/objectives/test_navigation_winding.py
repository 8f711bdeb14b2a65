"""Gains and gradients at full size, where dead reckoning makes covariances differ by 1e8."""

from functools import cache

import numpy as np
import pytest

from models.vehicle import PROFILES
from placement.assemble import assemble
from placement.instance import load_instance
from placement.objectives.entropy import Entropy
from placement.objectives.navigation import NavigationObjective
from placement.objectives.navigation_chain import Drive
from placement.objectives.trace import Trace

SELECTED = np.array([1373, 2813, 4586, 6233, 7367, 8483, 9563])  # greedy's, robot, persistent


@cache
def winding(errors: str, profile: str) -> Drive:
    changes = {
        "errors.model": "covariance" if errors == "persistent" else "radius",
        "errors.persistent": errors == "persistent",
    }
    scene = assemble(load_instance("winding").changed(changes))
    return Drive(scene.points, scene.information, PROFILES[profile], np.array([0.1, 0.1, 0.01]))


@pytest.mark.parametrize("objective_class", [Entropy, Trace])
@pytest.mark.parametrize("profile", ["dissertation", "robot"])
@pytest.mark.parametrize("errors", ["white", "persistent"])
def test_gains_equal_differences_of_values(
    errors: str, profile: str, objective_class: type[NavigationObjective]
) -> None:
    objective = objective_class([winding(errors, profile)])
    sign = 1.0 if objective.maximise else -1.0
    gains = objective.state(SELECTED).gains()
    base = sign * objective.value(SELECTED)
    for i in np.argsort(-gains)[[0, 1, 10, 100, 1000, 3000]]:
        again = sign * objective.value(np.append(SELECTED, i)) - base
        assert gains[i] == pytest.approx(again, rel=1e-8, abs=1e-11 * abs(base))


@pytest.mark.parametrize("objective_class", [Entropy, Trace])
@pytest.mark.parametrize("errors", ["white", "persistent"])
def test_gradients_equal_differences_of_relaxed_scores(
    errors: str, objective_class: type[NavigationObjective]
) -> None:
    objective = objective_class([winding(errors, "robot")])
    x = np.zeros(objective.n_candidates)
    x[SELECTED] = 0.5
    score, gradient = objective.relaxed(x)
    h = 1e-5
    for i in SELECTED[::3]:
        e = np.zeros_like(x)
        e[i] = h
        slope = (objective.relaxed(x + e)[0] - objective.relaxed(x - e)[0]) / (2.0 * h)
        assert gradient[i] == pytest.approx(slope, rel=1e-6)
    for i in np.argsort(-gradient)[[0, 50, 500]]:  # one-sided: shares cannot be negative
        e = np.zeros_like(x)
        e[i] = 1e-7
        rise = objective.relaxed(x + e)[0] - score
        assert rise <= 1e-7 * gradient[i] * (1.0 + 1e-6)
        assert rise == pytest.approx(1e-7 * gradient[i], rel=1e-2)
