"""Lenses: how the angle between a ray and the optical axis becomes a radius on the image.

Camera frame: x right, y down, z forward (OpenCV's). Image coordinates (u, v) here are *normalised*:
focal length 1, origin on the optical axis, u right, v down. A ray at angle θ from the axis lands at
radius ρ(θ) in the direction of its (right, down) part:

    pinhole ρ = tan θ_d,  stereographic ρ = 2 tan(θ_d / 2),  equidistant ρ = θ_d,
    θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸).

The distortion is Kannala and Brandt's (2006, eq. 6), applied to the angle *before* the projection;
for the equidistant lens that is exactly OpenCV's fisheye model. (OpenCV's pinhole distortion is a
polynomial in tan θ instead; its coefficients are not these.) All zero, the default: no distortion.

Scalars are compiled and take only numbers, so kernels elsewhere can call them; the functions on
arrays at the top are for everyone else.
"""

from __future__ import annotations

import math
from enum import IntEnum

import numpy as np
from numba import njit

from models.geometry import FloatArray

PINHOLE, STEREOGRAPHIC, EQUIDISTANT = 0, 1, 2


class Projection(IntEnum):
    """Name the lens families; the values are what kernels branch on."""

    PINHOLE = PINHOLE
    STEREOGRAPHIC = STEREOGRAPHIC
    EQUIDISTANT = EQUIDISTANT

    @classmethod
    def parse(cls, name: str) -> Projection:
        """Return the projection called `name`, or raise ValueError listing the names there are."""
        names = [projection.name.lower() for projection in cls]
        if name not in names:
            raise ValueError(f"camera.projection must be one of {', '.join(names)}, got {name!r}")
        return cls(names.index(name))


def project_rays(projection: Projection, rays: FloatArray, distortion: FloatArray) -> FloatArray:
    """Map rays (n, 3) (right, down, forward; any length) to normalised image points (n, 2).

    `distortion` is k1…k4. NaN where the lens sees no such ray. Where the distortion folds the
    image (beyond `angle_limit`) the result is the fold's; cameras cut there.
    """
    return _project_rays(int(projection), np.ascontiguousarray(rays), np.asarray(distortion))


def unproject_points(
    projection: Projection, points: FloatArray, distortion: FloatArray
) -> FloatArray:
    """Map normalised image points (n, 2) to unit rays (n, 3); NaN beyond the lens's last angle."""
    k = np.asarray(distortion, dtype=np.float64)
    limit = angle_limit(projection, k)
    return _unproject_points(int(projection), np.ascontiguousarray(points), k, limit)


def image_radius(projection: Projection, angle_rad: float, distortion: FloatArray) -> float:
    """Return ρ(θ), the normalised image radius of a ray `angle_rad` off the axis."""
    k1, k2, k3, k4 = (float(k) for k in distortion)
    return float(lens_radius(int(projection), angle_rad, k1, k2, k3, k4)[0])


def field_of_view(
    projection: Projection, focal_px: float, size_px: float, distortion: FloatArray
) -> float:
    """Return the full field of view [rad] of `size_px` pixels behind a calibrated focal length.

    Calibrations give focal lengths in pixels; cameras here are given by their field of view.
    Raises ValueError where the lens has no ray for the image's edge.
    """
    k1, k2, k3, k4 = (float(k) for k in distortion)
    limit = angle_limit(projection, distortion)
    half = float(lens_angle(int(projection), 0.5 * size_px / focal_px, k1, k2, k3, k4, limit))
    if math.isnan(half):
        raise ValueError(
            f"camera.focal_px must be large enough for {size_px:g} px to lie inside the lens's "
            f"{math.degrees(limit):.4g} degrees, got {focal_px:g}"
        )
    return 2.0 * half


def angle_limit(projection: Projection, distortion: FloatArray) -> float:
    """Return the angle [rad] up to which the lens maps rays to radii one to one.

    The least of: where θ_d turns (the image folds), where θ_d reaches the projection's own end
    (90° for a pinhole, 180° for the others), and 180°.
    """
    k = np.asarray(distortion, dtype=np.float64)
    fold = fold_angle(k)
    end = 0.5 * math.pi if projection == Projection.PINHOLE else math.pi
    if not k.any():
        return end
    limit = min(math.pi, fold)
    if projection == Projection.EQUIDISTANT:
        return limit
    # θ_d rises on [0, limit]; the projection ends where it passes `end`.
    return _first_angle_reaching(end, limit, k)


def fold_angle(distortion: FloatArray) -> float:
    """Return the least angle [rad] at which dθ_d/dθ = 0, infinite if there is none."""
    k1, k2, k3, k4 = (float(k) for k in distortion)
    # 1 + 3 k1 s + 5 k2 s² + 7 k3 s³ + 9 k4 s⁴ with s = θ²
    roots = np.roots(np.trim_zeros(np.array([9.0 * k4, 7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0]), "f"))
    real = roots.real[np.abs(roots.imag) <= 1e-9 * (1.0 + np.abs(roots.real))]
    positive = real[real > 0.0]
    return float(np.sqrt(positive.min())) if positive.size else math.inf


def _first_angle_reaching(target: float, limit: float, k: FloatArray) -> float:
    low, high = 0.0, limit
    if float(distorted_angle(limit, *k)[0]) < target:
        return limit
    for _ in range(80):
        middle = 0.5 * (low + high)
        if float(distorted_angle(middle, *k)[0]) < target:
            low = middle
        else:
            high = middle
    return low


@njit(cache=True)
def distorted_angle(
    theta: float, k1: float, k2: float, k3: float, k4: float
) -> tuple[float, float]:
    """Return (θ_d, dθ_d/dθ)."""
    s = theta * theta
    value = theta * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))))
    slope = 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * (9.0 * k4))))
    return value, slope


@njit(cache=True)
def lens_radius(
    kind: int, theta: float, k1: float, k2: float, k3: float, k4: float
) -> tuple[float, float]:
    """Return (ρ, dρ/dθ) of a ray θ off the axis."""
    angle, slope = distorted_angle(theta, k1, k2, k3, k4)
    if kind == PINHOLE:
        t = math.tan(angle)
        return t, (1.0 + t * t) * slope
    if kind == STEREOGRAPHIC:
        t = math.tan(0.5 * angle)
        return 2.0 * t, (1.0 + t * t) * slope
    return angle, slope


@njit(cache=True)
def lens_angle(
    kind: int, rho: float, k1: float, k2: float, k3: float, k4: float, limit: float
) -> float:
    """Return θ with ρ(θ) = rho, NaN beyond `limit` (of `angle_limit`).

    Safeguarded Newton: θ_d rises on [0, limit], so a bracket always holds the root.
    """
    if kind == PINHOLE:
        target = math.atan(rho)
    elif kind == STEREOGRAPHIC:
        target = 2.0 * math.atan(0.5 * rho)
    else:
        target = rho
    if k1 == 0.0 and k2 == 0.0 and k3 == 0.0 and k4 == 0.0:
        return target if target <= limit else math.nan
    low, high = 0.0, limit
    if target > distorted_angle(limit, k1, k2, k3, k4)[0]:
        return math.nan
    theta = min(target, limit)
    for _ in range(60):
        value, slope = distorted_angle(theta, k1, k2, k3, k4)
        miss = value - target
        if abs(miss) <= 1e-16 + 2.3e-16 * target:
            break
        if miss > 0.0:
            high = theta
        else:
            low = theta
        step = theta - miss / slope if slope > 0.0 else low
        if not low < step < high:
            step = 0.5 * (low + high)
        if step == theta:
            break
        theta = step
    return theta


@njit(cache=True)
def image_from_ray(
    kind: int, right: float, down: float, forward: float, k1: float, k2: float, k3: float, k4: float
) -> tuple[float, float]:
    """Return the normalised image point (u, v) of a ray of any length, NaN where there is none."""
    distorted = k1 != 0.0 or k2 != 0.0 or k3 != 0.0 or k4 != 0.0
    if kind == PINHOLE and not distorted:
        if forward <= 0.0:
            return math.nan, math.nan
        return right / forward, down / forward
    across = math.sqrt(right * right + down * down)
    if across == 0.0:
        return (0.0, 0.0) if forward > 0.0 else (math.nan, math.nan)
    angle, _ = distorted_angle(math.atan2(across, forward), k1, k2, k3, k4)
    if (kind == PINHOLE and angle >= 0.5 * math.pi) or (kind == STEREOGRAPHIC and angle >= math.pi):
        return math.nan, math.nan
    rho, _ = lens_radius(kind, math.atan2(across, forward), k1, k2, k3, k4)
    return rho * right / across, rho * down / across


@njit(cache=True)
def ray_from_image(
    kind: int, u: float, v: float, k1: float, k2: float, k3: float, k4: float, limit: float
) -> tuple[float, float, float]:
    """Return the unit ray (right, down, forward) of an image point, NaN beyond `limit`."""
    rho = math.sqrt(u * u + v * v)
    if rho == 0.0:
        return 0.0, 0.0, 1.0
    theta = lens_angle(kind, rho, k1, k2, k3, k4, limit)
    sine = math.sin(theta) / rho
    return sine * u, sine * v, math.cos(theta)


@njit(cache=True)
def lens_frame(
    kind: int, right: float, down: float, forward: float, k1: float, k2: float, k3: float, k4: float
) -> tuple[float, float, float, float, float, float]:
    """Return (cos α, sin α, sin θ, cos θ, ρ'(θ), ρ/sin θ) of a ray of any length.

    α is the direction of the ray on the image. In the frame of the unit vectors "away from the
    axis" e_θ = (cos θ cos α, cos θ sin α, −sin θ) and "around it" e_τ = (−sin α, cos α, 0), a lens
    is diagonal: a unit ray moved by dψ_θ and dψ_τ moves on the image by ρ'·dψ_θ outward and
    (ρ/sin θ)·dψ_τ around. Both factors tend to 1 on the axis, so nothing is singular there.
    """
    across = math.sqrt(right * right + down * down)
    length = math.sqrt(across * across + forward * forward)
    if across == 0.0:
        return 1.0, 0.0, 0.0, 1.0, 1.0, 1.0
    sine = across / length
    rho, slope = lens_radius(kind, math.atan2(across, forward), k1, k2, k3, k4)
    return right / across, down / across, sine, forward / length, slope, rho / sine


@njit(cache=True)
def image_jacobian(
    kind: int, right: float, down: float, forward: float, k1: float, k2: float, k3: float, k4: float
) -> tuple[float, float, float, float, float, float]:
    """Return ∂(u, v)/∂(right, down, forward) row by row (6 numbers), for a ray of any length."""
    ca, sa, st, ct, radial, around = lens_frame(kind, right, down, forward, k1, k2, k3, k4)
    length = math.sqrt(right * right + down * down + forward * forward)
    radial /= length
    around /= length
    return (
        radial * ca * ct * ca + around * sa * sa,
        radial * ca * ct * sa - around * sa * ca,
        -radial * ca * st,
        radial * sa * ct * ca - around * ca * sa,
        radial * sa * ct * sa + around * ca * ca,
        -radial * sa * st,
    )


@njit(cache=True)
def ray_jacobian(
    kind: int, right: float, down: float, forward: float, k1: float, k2: float, k3: float, k4: float
) -> tuple[float, float, float, float, float, float]:
    """Return ∂(unit ray)/∂(u, v) row by row (3 × 2 numbers), at the image point of that ray."""
    ca, sa, st, ct, radial, around = lens_frame(kind, right, down, forward, k1, k2, k3, k4)
    radial = 1.0 / radial
    around = 1.0 / around
    return (
        radial * ct * ca * ca + around * sa * sa,
        radial * ct * ca * sa - around * sa * ca,
        radial * ct * sa * ca - around * ca * sa,
        radial * ct * sa * sa + around * ca * ca,
        -radial * st * ca,
        -radial * st * sa,
    )


@njit(cache=True)
def _project_rays(kind: int, rays: FloatArray, k: FloatArray) -> FloatArray:
    points = np.empty((rays.shape[0], 2))
    for i in range(rays.shape[0]):
        points[i, 0], points[i, 1] = image_from_ray(
            kind, rays[i, 0], rays[i, 1], rays[i, 2], k[0], k[1], k[2], k[3]
        )
    return points


@njit(cache=True)
def _unproject_points(kind: int, points: FloatArray, k: FloatArray, limit: float) -> FloatArray:
    rays = np.empty((points.shape[0], 3))
    for i in range(points.shape[0]):
        rays[i, 0], rays[i, 1], rays[i, 2] = ray_from_image(
            kind, points[i, 0], points[i, 1], k[0], k[1], k[2], k[3], limit
        )
    return rays
