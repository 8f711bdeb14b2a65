"""What a vehicle can do, and how well its wheels know it: limits and odometry noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from models.geometry import FloatArray

FILTER_STEP_M = 0.8
"""The distance of one filter step of the dissertation: 20 m/s at 25 Hz."""


@dataclass(frozen=True, slots=True)
class OdometryNoise:
    """Hold the random-walk densities of wheel odometry; over d metres a variance grows by q²·d.

    heading_rad_per_sqrt_m, along_m_per_sqrt_m, across_m_per_sqrt_m: of the heading, and of the
    position along and across the heading; none may be negative. Densities do not depend on how
    often the filter steps.
    """

    heading_rad_per_sqrt_m: float
    along_m_per_sqrt_m: float
    across_m_per_sqrt_m: float

    def __post_init__(self) -> None:
        """Refuse negative and non-finite densities."""
        for name in ("heading_rad_per_sqrt_m", "along_m_per_sqrt_m", "across_m_per_sqrt_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"odometry.{name} must be finite and at least 0, got {value}")

    def covariance(self, distance_m: float) -> FloatArray:
        """Return the (3, 3) covariance of (along, across, heading) after a straight `distance_m`.

        The integral of dP = A P + P Aᵀ + diag(a², c², q²) with the heading error turning into
        position across: c²d + q²d³/3 across, q²d²/2 between across and heading, q²d in heading.
        """
        d = distance_m
        q2 = self.heading_rad_per_sqrt_m**2
        return np.array(
            [
                [self.along_m_per_sqrt_m**2 * d, 0.0, 0.0],
                [0.0, self.across_m_per_sqrt_m**2 * d + q2 * d**3 / 3.0, q2 * d * d / 2.0],
                [0.0, q2 * d * d / 2.0, q2 * d],
            ]
        )

    def as_array(self) -> FloatArray:
        """Return (heading, along, across) as the kernels take it, (3,)."""
        return np.array(
            [self.heading_rad_per_sqrt_m, self.along_m_per_sqrt_m, self.across_m_per_sqrt_m]
        )


def from_alphas(alphas: Sequence[float], step_m: float = FILTER_STEP_M) -> OdometryNoise:
    """Turn rot–trans–rot noise per filter step into densities that do not depend on the step.

    Each step of `step_m` metres turns, goes and turns with standard deviations
    α1|rot| + α2|trans|, α3|trans| + α4|rot1 + rot2| and α1|rot| + α2|trans| (Thrun, Burgard and
    Fox 2005, section 5.4, with standard deviations for variances). The densities reproduce the
    covariance of a straight step exactly: 2(α2 d)² of heading, (α3 d)² along, and the
    (α2 d)² d² across that the first turn causes. α1 and α4 act only in bends, where the rotation
    of a step of 0.8 m is so small (0.04 rad at a radius of 20 m) that they add less than 4 % to
    α2|trans| and α3|trans|; they are checked and otherwise left out.
    Raises ValueError unless there are four finite alphas of at least 0 and step_m > 0.
    """
    values = [float(alpha) for alpha in alphas]
    if len(values) != 4 or not all(math.isfinite(a) and a >= 0.0 for a in values):
        raise ValueError(f"odometry.alphas must be four finite numbers of at least 0, got {alphas}")
    if not (math.isfinite(step_m) and step_m > 0.0):
        raise ValueError(f"odometry.step_m must be finite and above 0, got {step_m}")
    turn, go = values[1], values[2]
    return OdometryNoise(
        heading_rad_per_sqrt_m=turn * math.sqrt(2.0 * step_m),
        along_m_per_sqrt_m=go * math.sqrt(step_m),
        across_m_per_sqrt_m=turn * math.sqrt(step_m**3 / 3.0),
    )


PROFILES: Mapping[str, OdometryNoise] = MappingProxyType(
    {
        "dissertation": from_alphas((1e-4, 1.5e-4, 1.5e-4, 1e-4)),
        "car": OdometryNoise(math.radians(0.0236), 0.01, 0.003),
        "robot": OdometryNoise(math.radians(0.3), 0.02, 0.005),
    }
)
"""Odometry by name: the dissertation's (0.1 % of the distance), a car's (1 %), a slow robot's."""


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Hold the size and the actuator limits of a Prius-sized car, seen at its geometric centre.

    wheelbase_m; centre_to_front_m and centre_to_rear_m from the reference point to the axles (by
    default half the wheelbase); steering_limit_rad and steering_rate_limit_rad_s of the front
    wheels; acceleration_limit_mps2 and braking_limit_mps2, both positive.
    """

    wheelbase_m: float = 2.7
    centre_to_rear_m: float = 1.35
    steering_limit_rad: float = 0.6
    steering_rate_limit_rad_s: float = 0.8
    acceleration_limit_mps2: float = 3.0
    braking_limit_mps2: float = 6.0

    def __post_init__(self) -> None:
        """Refuse what no vehicle is."""
        for name in self.__slots__:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"vehicle.{name} must be finite and above 0, got {value}")
        if self.steering_limit_rad >= math.pi / 2.0:
            raise ValueError(
                f"vehicle.steering_limit_rad must lie in (0, π/2), got {self.steering_limit_rad}"
            )
        if self.centre_to_rear_m >= self.wheelbase_m:
            raise ValueError(
                "vehicle.centre_to_rear_m must be less than wheelbase_m, "
                f"got {self.centre_to_rear_m}"
            )

    @property
    def turning_radius_m(self) -> float:
        """The smallest radius the reference point can drive: √((L/tan δ)² + b²)."""
        rear = self.wheelbase_m / math.tan(self.steering_limit_rad)
        return math.hypot(rear, self.centre_to_rear_m)


def check_turnable(vehicle: Vehicle, s_m: FloatArray, curvature: FloatArray) -> None:
    """Refuse a road tighter than the vehicle can turn, naming the tightest place.

    s_m, curvature (t,): samples along the road. Raises ValueError.
    """
    tightest = int(np.argmax(np.abs(curvature)))
    bend = abs(float(curvature[tightest]))
    if bend * vehicle.turning_radius_m > 1.0:
        raise ValueError(
            f"road: its radius must be at least {vehicle.turning_radius_m:.2f} m, the vehicle's "
            f"turning circle, got {1.0 / bend:.2f} m at s = {float(s_m[tightest]):.1f} m"
        )
