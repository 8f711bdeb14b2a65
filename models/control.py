"""What the driver does: Stanley steering, the speed wanted along the road, a PID on the pedal."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from models.geometry import FloatArray


@dataclass(frozen=True, slots=True)
class Control:
    """Hold the gains: Stanley's k, and the pedal's proportional, integral and derivative ones.

    stanley_per_s: k in δ = heading error − atan(k e / v); 0.95 as in the dissertation.
    softening_mps: added to v, so that a creeping car does not jerk its wheels.
    proportional_per_s, integral_per_s2, derivative: of the speed error.
    """

    stanley_per_s: float = 0.95
    softening_mps: float = 0.5
    proportional_per_s: float = 1.5
    integral_per_s2: float = 0.1
    derivative: float = 0.05

    def as_array(self) -> FloatArray:
        """Return the gains as the kernels take them, (5,)."""
        return np.array(
            [
                self.stanley_per_s,
                self.softening_mps,
                self.proportional_per_s,
                self.integral_per_s2,
                self.derivative,
            ]
        )


@dataclass(frozen=True, slots=True)
class SpeedPolicy:
    """Say how fast to go: `speed_mps` on straights, `bend_rate_hz`/|κ| in bends.

    bend_rate_hz: 0.5, so 10 m/s at a radius of 20 m. look_ahead_m: the wish is averaged over so
    much road ahead, and never above the wish here, so the car brakes before a bend and
    accelerates after it. lateral_limit_mps2: v²|κ| stays below it; infinite for the bicycle, which
    cannot skid.
    """

    speed_mps: float = 20.0
    bend_rate_hz: float = 0.5
    look_ahead_m: float = 40.0
    lateral_limit_mps2: float = math.inf

    def __post_init__(self) -> None:
        """Refuse what makes no speed."""
        for name in ("speed_mps", "bend_rate_hz", "look_ahead_m", "lateral_limit_mps2"):
            value = getattr(self, name)
            if not value > 0.0 or (math.isinf(value) and name != "lateral_limit_mps2"):
                raise ValueError(f"speed.{name} must be finite and above 0, got {value}")

    def along(self, curvature: FloatArray, step_m: float, closed: bool) -> FloatArray:
        """Return the speed wanted, (n,), on a road given by its curvature every `step_m`.

        A closed road's last sample repeats its first. An open road ends in a straight.
        """
        bend = np.maximum(np.abs(curvature), 1e-12)
        wish = np.minimum(self.speed_mps, self.bend_rate_hz / bend)
        wish = np.minimum(wish, np.sqrt(self.lateral_limit_mps2 / bend))
        ahead = max(1, round(self.look_ahead_m / step_m))
        n = len(wish)
        tail = np.resize(wish[1:], ahead) if closed else np.full(ahead, wish[-1])
        total = np.concatenate(([0.0], np.cumsum(np.concatenate((wish, tail)))))
        mean = (total[ahead : ahead + n] - total[:n]) / ahead
        speed: FloatArray = np.minimum(wish, mean)
        return speed


@njit(cache=True)
def stanley(heading_error: float, cross_track: float, speed: float, gains: FloatArray) -> float:
    """Return the steering angle: heading_error − atan(k·cross_track/(speed + softening)).

    heading_error: the road's heading less the car's, wrapped; cross_track: of the *front axle*,
    > 0 on the left of the road (Hoffmann et al. 2007, eq. 5).
    """
    return heading_error - math.atan(gains[0] * cross_track / (speed + gains[1]))


@njit(cache=True)
def pedal(
    speed: float, wanted: float, integral: float, last_error: float, dt: float, gains: FloatArray
) -> tuple[float, float, float]:
    """Return (acceleration, integral, error) of a PID on the speed; the integral is kept in ±2 m.

    The bound keeps a long stretch of full brake or throttle from winding the integral up.
    """
    error = wanted - speed
    integral = min(max(integral + error * dt, -2.0), 2.0)
    slope = (error - last_error) / dt
    return gains[2] * error + gains[3] * integral + gains[4] * slope, integral, error
