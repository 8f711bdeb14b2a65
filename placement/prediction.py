"""How well a car is predicted to know where it is, sample by sample, with a given placement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.assemble import Scene, build_odometry
from placement.objectives.navigation import WhiteDrive
from placement.objectives.navigation_chain import Drive
from placement.objectives.navigation_offsets import Forward, OffsetDrive
from placement.objectives.windows.filter import empty_messages, filter_forward


@dataclass(frozen=True, slots=True)
class Prediction:
    """One sigma of the filter's error at each path sample, by the covariance recursion.

    `position_sigma_m` (t,) is the root of the trace of the position block, so it compares with
    an rms distance; `lateral_sigma_m` (t,) is across the road.
    """

    position_sigma_m: FloatArray
    lateral_sigma_m: FloatArray


def predict(scene: Scene, selected: Sequence[int], journey: int = 0) -> Prediction:
    """Filter a nominal drive with the selected cameras; no randomness, no simulation."""
    vehicle = scene.instance.vehicle
    drive = scene.journeys[journey].drive(build_odometry(vehicle), vehicle.initial_sigma)
    after = covariances(drive, np.array(sorted(selected), dtype=np.int64))
    return Prediction(
        position_sigma_m=np.sqrt(after[:, 0] + after[:, 3]),
        lateral_sigma_m=np.sqrt(after[:, 3]),
    )


def covariances(drive: Drive, selected: IntArray) -> FloatArray:
    """Return the filter's covariance after each sample (t, 6): tt, tn, tθ, nn, nθ, θθ.

    Persistent offsets of the cameras in view are estimated beside the car, as the best filter
    would; where the error is white there are none.
    """
    if drive.persistent:
        return Forward(OffsetDrive(drive), selected).car()
    white = WhiteDrive(drive)
    before, after, logs = empty_messages(white.n_samples)
    filter_forward(white.steps, white.p0, white.total(selected), before, after, logs)
    return after
