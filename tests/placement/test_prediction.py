from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from placement.assemble import Scene, assemble
from placement.instance import instance_from_dict
from placement.prediction import predict
from placement.solve import solve


def scene(**errors: Any) -> Scene:
    return assemble(
        instance_from_dict(
            {
                "road": {"pieces": [{"length": 120}, {"length": 60, "curvature": 0.02}]},
                "camera": {"yaw_deg": [0, 180], "pitch_deg": [35]},
                "errors": errors,
                "objective": {"kind": "trace"},
                "budget": {"cameras": 3},
            }
        )
    )


@pytest.mark.parametrize("errors", [{"model": "radius"}, {"model": "covariance"}])
def test_the_mean_square_of_the_prediction_is_the_trace_objective(errors: dict[str, Any]) -> None:
    built = scene(**errors)
    solution = solve(built.problem, "greedy")
    predicted = predict(built, solution.selected)
    assert np.mean(predicted.position_sigma_m**2) == pytest.approx(solution.value, rel=1e-9)
    assert np.all(predicted.lateral_sigma_m <= predicted.position_sigma_m)


def test_a_thousand_frames_do_not_average_a_persistent_offset_out() -> None:
    """The mount's own offset is 0.015 m along each axis, whatever the number of frames."""
    least = {}
    for persistent in (True, False):
        built = scene(model="covariance", persistent=persistent)
        often = replace(built.information, frames_per_sample=1000.0)
        eager = replace(built, journeys=(replace(built.journeys[0], information=often),))
        least[persistent] = predict(eager, (40, 100, 200)).position_sigma_m.min()
    assert least[False] < 0.005
    assert least[True] > 0.015
