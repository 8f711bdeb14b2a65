"""The odometry chain of a nominal drive: how position and heading errors grow between samples.

The state of sample t is the error (e_t, e_n, e_θ) in the sample's road frame: along the heading
and to the left in metres, heading in radians. Along an arc of length ds that turns by Δ = κ ds,

    F = [[cos Δ, sin Δ, Y], [−sin Δ, cos Δ, X], [0, 0, 1]],  X = sin Δ / κ,  Y = (1 − cos Δ) / κ,

and the noise is the integral of F(u) diag(along², across², heading²) F(u)ᵀ over the distance u
left to go, so heading noise reaches the lateral error and the sample spacing does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from models.geometry import FloatArray, frozen, wrap_angle
from placement.information import Information

N_STEP = 10  # columns of a step: cos Δ, sin Δ, Y, X, then Q_tt Q_tn Q_tθ Q_nn Q_nθ Q_θθ
QUADRATURE_NODES = 10  # exact to rounding for steps that turn by less than a right angle


class OdometryDensities(Protocol):
    """Odometry noise as random-walk densities: `models.vehicle.OdometryNoise` is one."""

    @property
    def heading_rad_per_sqrt_m(self) -> float:
        """Heading noise, rad/√m."""

    @property
    def along_m_per_sqrt_m(self) -> float:
        """Noise along the heading, m/√m."""

    @property
    def across_m_per_sqrt_m(self) -> float:
        """Noise across the heading, m/√m."""


class PathSamples(Protocol):
    """What the chain needs of a path: `models.roads.RoadPoints` is one."""

    @property
    def s_m(self) -> FloatArray:
        """Arc length of each sample (t,), increasing."""

    @property
    def heading_rad(self) -> FloatArray:
        """Heading of each sample (t,)."""


@dataclass(frozen=True, slots=True)
class Drive:
    """Drive once along `points`, seen by the cameras of `information`.

    A closed circuit is driven for one lap, from its first sample to its last; a car in the other
    direction or lane is another Drive with points of its own. `initial_sigma` (3,) are the
    standard deviations (m along, m across, rad) before the first sample's measurements; zeros
    are allowed. `weight` multiplies the drive's share of an objective.
    """

    points: PathSamples
    information: Information
    odometry: OdometryDensities
    initial_sigma: FloatArray
    weight: float = 1.0

    def __post_init__(self) -> None:
        """Check lengths and ranges."""
        sigma = np.asarray(self.initial_sigma, dtype=np.float64)
        if sigma.shape != (3,) or not np.all(np.isfinite(sigma)) or np.any(sigma < 0.0):
            raise ValueError(
                "vehicle.initial_sigma must be three finite numbers of at least 0, "
                f"got {self.initial_sigma}"
            )
        object.__setattr__(self, "initial_sigma", frozen(sigma.copy()))
        if not (np.isfinite(self.weight) and self.weight >= 0.0):
            raise ValueError(f"drive.weight must be finite and at least 0, got {self.weight}")
        samples = len(self.points.s_m)
        if samples != self.information.n_samples:
            raise ValueError(
                f"information covers {self.information.n_samples} samples, the drive {samples}"
            )
        if self.information.offsets is not None and self.information.white is None:
            raise ValueError("information.offsets needs information.white beside it, got None")
        for name, value in densities(self.odometry).items():
            if not (np.isfinite(value) and value >= 0.0):
                raise ValueError(f"vehicle.{name} must be finite and at least 0, got {value}")

    @property
    def persistent(self) -> bool:
        """Whether the cameras have offsets that all their frames share."""
        return self.information.offsets is not None and self.information.offsets.shape[2] > 0

    def initial_covariance(self) -> FloatArray:
        """Return the covariance (6,) before the first measurement: tt, tn, tθ, nn, nθ, θθ."""
        variance = self.initial_sigma**2
        return np.array([variance[0], 0.0, 0.0, variance[1], 0.0, variance[2]])

    def steps(self) -> FloatArray:
        """Return the chain's steps (t, N_STEP); row t leads from sample t − 1 to sample t."""
        return chain_steps(self.points, self.odometry)


def densities(odometry: OdometryDensities) -> dict[str, float]:
    """Return the three densities by field name."""
    return {
        "heading_rad_per_sqrt_m": odometry.heading_rad_per_sqrt_m,
        "along_m_per_sqrt_m": odometry.along_m_per_sqrt_m,
        "across_m_per_sqrt_m": odometry.across_m_per_sqrt_m,
    }


def checked_drives(drives: Sequence[Drive]) -> tuple[Drive, ...]:
    """Return `drives`, or say why they cannot share one objective."""
    if not drives:
        raise ValueError("drives must hold at least one drive, got none")
    counts = sorted({d.information.n_candidates for d in drives})
    if len(counts) > 1:
        raise ValueError(f"drives must see the same candidates, got counts {counts}")
    return tuple(drives)


def chain_steps(points: PathSamples, odometry: OdometryDensities) -> FloatArray:
    """Integrate the error and its noise over each interval, as arcs; (t, N_STEP).

    Exact where the curvature is constant within the interval, second order in the spacing
    elsewhere. Row 0 is the identity without noise.
    """
    length = np.diff(points.s_m)
    if np.any(length <= 0.0):
        t = int(np.argmax(length <= 0.0)) + 1
        raise ValueError(f"points.s_m must increase, got {points.s_m[t]} after {points.s_m[t - 1]}")
    turn = wrap_angle(np.diff(points.heading_rad))
    steps = np.zeros((len(points.s_m), N_STEP))
    steps[0, 0] = 1.0
    steps[1:, :4] = _arc(length, turn)
    nodes, weights = np.polynomial.legendre.leggauss(QUADRATURE_NODES)
    q = {name: value**2 for name, value in densities(odometry).items()}
    along, across = q["along_m_per_sqrt_m"], q["across_m_per_sqrt_m"]
    heading = q["heading_rad_per_sqrt_m"]
    for node, weight in zip(nodes, weights, strict=True):
        share = 0.5 * (1.0 + node)
        c, s, y, x = _arc(share * length, share * turn).T
        du = 0.5 * weight * length
        steps[1:, 4] += du * (along * c * c + across * s * s + heading * y * y)
        steps[1:, 5] += du * ((across - along) * c * s + heading * x * y)
        steps[1:, 6] += du * heading * y
        steps[1:, 7] += du * (along * s * s + across * c * c + heading * x * x)
        steps[1:, 8] += du * heading * x
        steps[1:, 9] += du * heading
    return steps


def _arc(length: FloatArray, turn: FloatArray) -> FloatArray:
    """Return cos Δ, sin Δ, Y, X (t, 4) of arcs; sinc keeps straight lines exact."""
    half = 0.5 * turn
    chord = length * np.sinc(half / np.pi)
    return np.stack(
        [np.cos(turn), np.sin(turn), chord * np.sin(half), chord * np.cos(half)], axis=1
    )
