"""The error of one reported position: a circle, an ellipse, or a calibrated covariance.

For a camera at height h, a car at ground distance d (R² = d² + h²) and the pixel that sees it, at
two standard deviations (DESIGN section 3 has the derivation):

    position      e_pos                       algorithm + pixel   Δ_alg · sqrt(2 A)
    height        e_pos d/h                   A: the pixel's area on the ground
    orientation   h tan(atan(d/h) + e_ori) − d  =  tan(e_ori) R² / (h − d tan(e_ori))

`radius`      r = their sum; R = (r/2)² I. Of the last term, `pixel` is one pixel's diagonal (no
              more than Δ_alg of them) and `algorithm` the rest.
`ellipse`     the same area, stretched along the line of sight by the ratio s ≥ 1 of the pixel's
              ground extents along and across it: R = (r/2)² diag(s, 1/s) in those directions.
`covariance`  first-order propagation of the installation's six offsets (see `installation`) and of
              the pixel noise: (Δ_alg/2)² per axis for the algorithm, 1/12 for rounding to a pixel.

Whatever is constant for a camera is *persistent*; the rest is *white*, fresh in every frame. Only
`covariance` knows the two apart. `radius` and `ellipse` are bounds that take everything for white,
and `persistent = False` makes `covariance` do the same.

The first-order model holds while d·σ_ori/h is small; docs/error-model.md says where it breaks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from models.cameras import (
    HEIGHT,
    Cameras,
    X,
    Y,
    ground_jacobian,
    pixel_area,
    pixel_from_offset,
)
from models.geometry import FloatArray, IntArray
from models.installation import N_OFFSETS, Installation, offset_jacobian

RADIUS, ELLIPSE, COVARIANCE = 0, 1, 2
FORMS = ("radius", "ellipse", "covariance")
COMPONENTS = ("position", "height", "orientation", "algorithm", "pixel")

# Entries of `ErrorModel.parameters()`.
FORM, POSITION_95, TAN_ORIENTATION, ALGORITHM_95 = 0, 1, 2, 3
POSITION_VARIANCE, ORIENTATION_VARIANCE, PIXEL_VARIANCE = 4, 5, 6
ALGORITHM_VARIANCE, REPORT_LIMIT = 7, 8
N_PARAMETERS = 9

ROUNDING_VARIANCE_PX2 = 1.0 / 12.0
CHI2_95 = -2.0 * math.log(0.05)
"""The squared Mahalanobis distance that holds 95 % of a plane normal distribution, 5.99146."""


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """Choose a form of the error and the installation behind it.

    `report_limit_m`: a camera reports no position whose 95 % radius exceeds this; the radius is the
    longest semi-axis of the model's 95 % region (`error_radius`). Raises ValueError for an unknown
    form or a limit that is not positive.
    """

    kind: str = "covariance"
    installation: Installation = field(default_factory=Installation)
    persistent: bool = True
    report_limit_m: float = 2.0

    def __post_init__(self) -> None:
        """Refuse what no form can be made of."""
        if self.kind not in FORMS:
            raise ValueError(f"errors.model must be one of {', '.join(FORMS)}, got {self.kind!r}")
        if not self.report_limit_m > 0.0:
            raise ValueError(f"errors.report_limit_m must be positive, got {self.report_limit_m}")
        i = self.installation
        if self.kind != "covariance" and not (
            i.position_95_m or i.orientation_95_deg or i.algorithm_95_px
        ):
            raise ValueError(
                f"errors.position_95_m must be positive where everything else is 0 ({self.kind}): "
                "a camera without error has infinite information"
            )

    @property
    def splits(self) -> bool:
        """Whether the error has a persistent part that frames of one camera share."""
        return self.kind == "covariance" and self.persistent

    @property
    def isotropic(self) -> bool:
        """Whether every covariance is a number times the identity."""
        return self.kind == "radius"

    def parameters(self) -> FloatArray:
        """Return what kernels need of the model (N_PARAMETERS,), entries as named above."""
        installation = self.installation
        values = np.empty(N_PARAMETERS)
        values[FORM] = FORMS.index(self.kind)
        values[POSITION_95] = installation.position_95_m
        values[TAN_ORIENTATION] = math.tan(math.radians(installation.orientation_95_deg))
        values[ALGORITHM_95] = installation.algorithm_95_px
        values[POSITION_VARIANCE] = installation.position_sigma_m**2
        values[ORIENTATION_VARIANCE] = installation.orientation_sigma_rad**2
        values[ALGORITHM_VARIANCE] = installation.algorithm_sigma_px**2
        values[PIXEL_VARIANCE] = values[ALGORITHM_VARIANCE] + ROUNDING_VARIANCE_PX2
        values[REPORT_LIMIT] = self.report_limit_m
        return values


def error_radius(cameras: Cameras, xy_m: FloatArray, model: ErrorModel) -> FloatArray:
    """Return the 95 % radius [m] of every camera about every ground point: (c, t), points (t, 2).

    `radius`: r. `ellipse`: r √s, and `covariance`: √5.99 σ of the worst direction, both the longest
    semi-axis of the 95 % region. Infinite where the camera does not see the point; the report limit
    is not applied.
    """
    return _error_radii(cameras.table(), np.ascontiguousarray(xy_m), model.parameters())


def error_covariance(
    cameras: Cameras, camera: IntArray, xy_m: FloatArray, model: ErrorModel
) -> FloatArray:
    """Return [R_xx, R_xy, R_yy] [m²] of what camera[n] reports of a car at xy_m[n]: (n, 3).

    World axes, white and persistent together, whether or not the point lies inside the image.
    """
    return _covariances(
        cameras.table(), np.asarray(camera, np.int64), np.asarray(xy_m), model.parameters()
    )


def split_covariance(
    cameras: Cameras, camera: IntArray, xy_m: FloatArray, model: ErrorModel
) -> tuple[FloatArray, FloatArray]:
    """Return the white [W_xx, W_xy, W_yy] (n, 3) and the persistent offset Jacobian (n, 2, 6).

    The Jacobian is per offset of unit variance, in metres and world axes, so the error's covariance
    is W + B Bᵀ; a filter that carries the six offsets of each camera as states uses W and B. Where
    the model takes everything for white, W is the whole and B is zero.
    """
    table, index, xy = cameras.table(), np.asarray(camera, np.int64), np.asarray(xy_m)
    whole = _covariances(table, index, xy, model.parameters())
    offsets = np.zeros((len(xy), 2, N_OFFSETS))
    if not model.splits:
        return whole, offsets
    white = _whites(table, index, xy, model.parameters()[PIXEL_VARIANCE])
    return white, _offset_jacobians(table, index, xy, model.installation.sigmas())


def error_components(
    cameras: Cameras, camera: IntArray, xy_m: FloatArray, model: ErrorModel
) -> FloatArray:
    """Return each component's own 95 % radius [m], (n, 5), in the order of `COMPONENTS`.

    For `radius` they add up to r, for `ellipse` to r √s. For `covariance` each is the longest
    semi-axis of the region that component alone would give; there the *covariances* add up
    (`covariance_components`).
    """
    index, xy = np.asarray(camera, np.int64), np.asarray(xy_m)
    if model.kind == "covariance":
        parts = covariance_components(cameras, index, xy, model.installation)
        return np.sqrt(CHI2_95 * _largest_eigenvalue(parts))
    return _radius_parts(cameras.table(), index, xy, model.parameters())


def covariance_components(
    cameras: Cameras, camera: IntArray, xy_m: FloatArray, installation: Installation
) -> FloatArray:
    """Return the covariance [xx, xy, yy] of each component alone, (n, 5, 3); they add up to R.

    The first three are persistent, the last two white.
    """
    table, index, xy = cameras.table(), np.asarray(camera, np.int64), np.asarray(xy_m)
    white = _whites(table, index, xy, 1.0)
    b = _offset_jacobians(table, index, xy, installation.sigmas())
    parts = np.empty((len(xy), 5, 3))
    for n, columns in enumerate((slice(0, 2), slice(2, 3), slice(3, 6))):
        part = b[:, :, columns] @ b[:, :, columns].transpose(0, 2, 1)
        parts[:, n] = np.stack([part[:, 0, 0], part[:, 0, 1], part[:, 1, 1]], axis=1)
    parts[:, 3] = white * installation.algorithm_sigma_px**2
    parts[:, 4] = white * ROUNDING_VARIANCE_PX2
    return parts


def _largest_eigenvalue(blocks: FloatArray) -> FloatArray:
    a, b, c = blocks[..., 0], blocks[..., 1], blocks[..., 2]
    largest: FloatArray = 0.5 * (a + c + np.hypot(a - c, 2.0 * b))
    return largest


@njit(cache=True)
def radius_from_area(
    distance: float, h: float, area: float, e_pos: float, tan_ori: float, algorithm: float
) -> float:
    """Return r [m] from the ground distance, the height and the pixel's ground area.

    Branch-free but for one select, and needs no lens: dense kernels call it with their own area.
    """
    slack = h - distance * tan_ori
    orientation = tan_ori * (h * h + distance * distance) / slack if slack > 0.0 else math.inf
    return e_pos * (1.0 + distance / h) + orientation + algorithm * math.sqrt(2.0 * area)


@njit(cache=True)
def persistent_variances(
    h: float, square: float, position_variance: float, orientation_variance: float
) -> tuple[float, float]:
    """Return the installation's variances [m²] along and across the line of sight.

    `square` is the squared ground distance d². The two directions are uncorrelated.
    """
    reach = square + h * h
    stretch = reach / (h * h)
    return (
        (position_variance + orientation_variance * reach) * stretch,
        position_variance + orientation_variance * reach,
    )


@njit(cache=True)
def pixel_covariance(row: FloatArray, dx: float, dy: float) -> tuple[float, float, float]:
    """Return [xx, xy, yy] [m²] on the ground of unit-variance noise in u and v."""
    xu, xv, yu, yv = ground_jacobian(row, dx, dy)
    return xu * xu + xv * xv, xu * yu + xv * yv, yu * yu + yv * yv


@njit(cache=True)
def white_and_whole(
    row: FloatArray, dx: float, dy: float, p: FloatArray
) -> tuple[float, float, float, float, float, float]:
    """Return the `covariance` model's white [xx, xy, yy], then white and persistent together."""
    xx, xy, yy = pixel_covariance(row, dx, dy)
    noise = p[PIXEL_VARIANCE]
    xx, xy, yy = noise * xx, noise * xy, noise * yy
    square = dx * dx + dy * dy
    h = row[HEIGHT]
    _, across = persistent_variances(h, square, p[POSITION_VARIANCE], p[ORIENTATION_VARIANCE])
    # Along exceeds across by the factor 1 + d²/h², so the sum needs no direction (d = 0 is fine).
    excess = across / (h * h)
    return (
        xx,
        xy,
        yy,
        xx + across + excess * dx * dx,
        xy + excess * dx * dy,
        yy + across + excess * dy * dy,
    )


@njit(cache=True)
def pixel_stretch(row: FloatArray, dx: float, dy: float) -> float:
    """Return the ratio s ≥ 1 of the pixel's ground extents along and across the line of sight.

    1 straight below the camera, where there is no such direction.
    """
    square = dx * dx + dy * dy
    if square == 0.0:
        return 1.0
    xx, xy, yy = pixel_covariance(row, dx, dy)
    along = dx * dx * xx + 2.0 * dx * dy * xy + dy * dy * yy
    across = dy * dy * xx - 2.0 * dx * dy * xy + dx * dx * yy
    return max(1.0, math.sqrt(along / across))


@njit(cache=True)
def measurement_covariance(
    row: FloatArray, dx: float, dy: float, p: FloatArray
) -> tuple[float, float, float, float]:
    """Return the whole [R_xx, R_xy, R_yy] [m²] and the 95 % radius [m] of any form.

    (dx, dy) is the car from the mount in world axes; p is `ErrorModel.parameters()`.
    """
    if p[FORM] == COVARIANCE:
        _, _, _, xx, xy, yy = white_and_whole(row, dx, dy, p)
        largest = 0.5 * (xx + yy + math.sqrt((xx - yy) ** 2 + 4.0 * xy * xy))
        return xx, xy, yy, math.sqrt(CHI2_95 * largest)
    square = dx * dx + dy * dy
    area = pixel_area(row, dx, dy)
    r = radius_from_area(
        math.sqrt(square),
        row[HEIGHT],
        area,
        p[POSITION_95],
        p[TAN_ORIENTATION],
        p[ALGORITHM_95],
    )
    variance = 0.25 * r * r
    if p[FORM] == RADIUS:
        return variance, 0.0, variance, r
    s = pixel_stretch(row, dx, dy)
    if square == 0.0:
        return variance, 0.0, variance, r
    across = variance / s
    excess = (variance * s - across) / square
    return (
        across + excess * dx * dx,
        excess * dx * dy,
        across + excess * dy * dy,
        r * math.sqrt(s),
    )


@njit(cache=True)
def _error_radii(table: FloatArray, xy: FloatArray, p: FloatArray) -> FloatArray:
    radii = np.empty((len(table), len(xy)))
    for i in range(len(table)):
        row = table[i]
        for t in range(len(xy)):
            dx, dy = xy[t, 0] - row[X], xy[t, 1] - row[Y]
            _, _, inside = pixel_from_offset(row, dx, dy)
            radii[i, t] = measurement_covariance(row, dx, dy, p)[3] if inside else math.inf
    return radii


@njit(cache=True)
def _covariances(table: FloatArray, camera: IntArray, xy: FloatArray, p: FloatArray) -> FloatArray:
    blocks = np.empty((len(xy), 3))
    for n in range(len(xy)):
        row = table[camera[n]]
        dx, dy = xy[n, 0] - row[X], xy[n, 1] - row[Y]
        blocks[n, 0], blocks[n, 1], blocks[n, 2], _ = measurement_covariance(row, dx, dy, p)
    return blocks


@njit(cache=True)
def _whites(table: FloatArray, camera: IntArray, xy: FloatArray, variance: float) -> FloatArray:
    blocks = np.empty((len(xy), 3))
    for n in range(len(xy)):
        row = table[camera[n]]
        xx, xy_, yy = pixel_covariance(row, xy[n, 0] - row[X], xy[n, 1] - row[Y])
        blocks[n, 0], blocks[n, 1], blocks[n, 2] = variance * xx, variance * xy_, variance * yy
    return blocks


@njit(cache=True)
def _offset_jacobians(
    table: FloatArray, camera: IntArray, xy: FloatArray, sigmas: FloatArray
) -> FloatArray:
    jacobians = np.empty((len(xy), 2, N_OFFSETS))
    for n in range(len(xy)):
        row = table[camera[n]]
        offset_jacobian(row, xy[n, 0] - row[X], xy[n, 1] - row[Y], jacobians[n])
        for j in range(N_OFFSETS):
            jacobians[n, 0, j] *= sigmas[j]
            jacobians[n, 1, j] *= sigmas[j]
    return jacobians


@njit(cache=True)
def _radius_parts(table: FloatArray, camera: IntArray, xy: FloatArray, p: FloatArray) -> FloatArray:
    parts = np.empty((len(xy), 5))
    for n in range(len(xy)):
        row = table[camera[n]]
        dx, dy = xy[n, 0] - row[X], xy[n, 1] - row[Y]
        h, distance = row[HEIGHT], math.sqrt(dx * dx + dy * dy)
        diagonal = math.sqrt(2.0 * pixel_area(row, dx, dy))
        pixels = min(1.0, p[ALGORITHM_95])
        parts[n, 0] = p[POSITION_95]
        parts[n, 1] = p[POSITION_95] * distance / h
        parts[n, 2] = radius_from_area(distance, h, 0.0, 0.0, p[TAN_ORIENTATION], 0.0)
        parts[n, 3] = (p[ALGORITHM_95] - pixels) * diagonal
        parts[n, 4] = pixels * diagonal
        if p[FORM] == ELLIPSE:
            longer = math.sqrt(pixel_stretch(row, dx, dy))
            for j in range(5):
                parts[n, j] *= longer
    return parts
