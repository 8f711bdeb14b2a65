"""Hundreds of drives over a city laid end to end: one chain of samples, cut where a drive ends.

Every street that many drives share is sampled by each of them, in its own lane. A candidate's row
holds the samples of all drives in a row, so that nothing is stored for a candidate and a drive that
do not meet, and the kernels of `placement.city.trajectories` walk from drive to drive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from models.roads import Road, RoadPoints
from models.vehicle import OdometryNoise
from placement.objectives.navigation_chain import chain_steps


@dataclass(frozen=True, slots=True)
class CityDrives:
    """Hold d drives with t samples in all.

    start (d + 1,): drive n has samples start[n] … start[n + 1] − 1 of `points`. weights (d,).
    owner (t,): each sample's drive. frames (t,): frames that a camera takes while the car passes
    a sample. steps (t, N_STEP): the odometry chain, which begins anew with each drive at the
    covariance p0 (6,).
    """

    roads: tuple[Road, ...]
    weights: FloatArray
    points: RoadPoints
    start: IntArray
    owner: NDArray[np.int32]
    frames: FloatArray
    steps: FloatArray
    p0: FloatArray

    def __len__(self) -> int:
        """Return the number of drives, d."""
        return len(self.weights)


def city_drives(
    roads: Sequence[tuple[Road, float]],
    odometry: OdometryNoise,
    *,
    spacing_m: float = 1.0,
    rate_hz: float = 10.0,
    speed_mps: float = 20.0,
    initial_sigma: Sequence[float] = (0.1, 0.1, 0.01),
) -> CityDrives:
    """Sample weighted drives every `spacing_m`, frames at `rate_hz` from a car of `speed_mps`.

    Raises:
        ValueError: if there is no drive.
    """
    if not roads:
        raise ValueError("drives must hold at least one drive, got none")
    parts = [road.sample(spacing_m) for road, _ in roads]
    counts = np.array([len(part) for part in parts])
    lengths = np.array([road.length_m for road, _ in roads])
    gaps = np.array([1 if road.closed else 0 for road, _ in roads]) + counts - 1
    columns = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("s_m", "x_m", "y_m", "heading_rad", "curvature")
    )
    variance = np.square(np.asarray(initial_sigma, dtype=np.float64))
    return CityDrives(
        roads=tuple(road for road, _ in roads),
        weights=np.array([weight for _, weight in roads], dtype=np.float64),
        points=RoadPoints(*columns),
        start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        owner=np.repeat(np.arange(len(roads), dtype=np.int32), counts),
        frames=np.repeat(rate_hz * lengths / np.maximum(gaps, 1) / speed_mps, counts),
        steps=np.concatenate([chain_steps(part, odometry) for part in parts]),
        p0=np.array([variance[0], 0.0, 0.0, variance[1], 0.0, variance[2]]),
    )
