"""How well a car is predicted to know where it is, sample by sample, with a given placement."""

from __future__ import annotations

from dataclasses import dataclass

from models.geometry import FloatArray


@dataclass(frozen=True, slots=True)
class Prediction:
    """One sigma of the filter's error at each path sample, by the covariance recursion.

    `position_sigma_m` (t,) is the root of the trace of the position block, so it compares with
    an rms distance; `lateral_sigma_m` (t,) is across the road.
    """

    position_sigma_m: FloatArray
    lateral_sigma_m: FloatArray
