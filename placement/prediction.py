"""How well a car is predicted to know where it is, sample by sample, with a given placement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.geometry import FloatArray, IntArray
from placement.assemble import Scene, build_odometry
from placement.information import Information
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
    """Filter a nominal drive with the selected cameras; no randomness, no simulation.

    Over all streets of a network nobody drives: there it is what a car knows which trusts its
    prior of `objective.prior_sigma_m` and the cameras that see it.
    """
    if not scene.journeys[journey].drivable:
        return _where_it_stands(scene, scene.journeys[journey].information, selected)
    vehicle = scene.instance.vehicle
    drive = scene.journeys[journey].drive(build_odometry(vehicle), vehicle.initial_sigma)
    after = covariances(drive, np.array(sorted(selected), dtype=np.int64))
    return Prediction(
        position_sigma_m=np.sqrt(after[:, 0] + after[:, 3]),
        lateral_sigma_m=np.sqrt(after[:, 3]),
    )


def _where_it_stands(scene: Scene, information: Information, selected: Sequence[int]) -> Prediction:
    """Return the sigmas of (I/σ² + Σ J)⁻¹ at every sample."""
    total = np.zeros((information.n_samples, 3))
    total[:, [0, 2]] = 1.0 / scene.instance.objective.prior_sigma_m**2
    for i in selected:
        rows = slice(information.indptr[i], information.indptr[i + 1])
        blocks = information.blocks[rows].astype(np.float64)
        if information.isotropic:
            blocks = blocks * np.array([1.0, 0.0, 1.0])
        total[information.indices[rows]] += blocks
    tt, tn, nn = total.T
    determinant = tt * nn - tn * tn
    return Prediction(
        position_sigma_m=np.sqrt((tt + nn) / determinant),
        lateral_sigma_m=np.sqrt(tt / determinant),
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
