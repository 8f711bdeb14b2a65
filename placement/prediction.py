"""How well a car is predicted to know where it is, sample by sample, with a given placement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.geometry import FloatArray
from placement.assemble import Scene, build_odometry
from placement.objectives.navigation import WhiteDrive
from placement.objectives.navigation_chain import Drive
from placement.objectives.window_filter import empty_messages, filter_forward


@dataclass(frozen=True, slots=True)
class Prediction:
    """One sigma of the filter's error at each path sample, by the covariance recursion.

    `position_sigma_m` (t,) is the root of the trace of the position block, so it compares with
    an rms distance; `lateral_sigma_m` (t,) is across the road.
    """

    position_sigma_m: FloatArray
    lateral_sigma_m: FloatArray


def predict(scene: Scene, selected: Sequence[int]) -> Prediction:
    """Filter the nominal drive with the selected cameras; no randomness, no simulation."""
    drive = WhiteDrive(
        Drive(
            scene.points,
            scene.information,
            build_odometry(scene.instance.vehicle),
            np.array(scene.instance.vehicle.initial_sigma),
        )
    )
    before, after, logs = empty_messages(drive.n_samples)
    total = drive.total(np.array(sorted(selected), dtype=np.int64))
    filter_forward(drive.steps, drive.p0, total, before, after, logs)
    return Prediction(
        position_sigma_m=np.sqrt(after[:, 0] + after[:, 3]),
        lateral_sigma_m=np.sqrt(after[:, 3]),
    )
