"""The innermost loops: what one pose learns of a run of samples.

A pose's scalars are read once, outside the loop; for pinholes the loop over samples has neither
branch nor call, so it becomes vector instructions. Other lenses need arctangents, and go pair by
pair through the scalars of `models`. Blocks are in the road frame of the sample, 1/m².

`radius`: with q = h − d·T, T = tan(e_ori), the 95 % radius is

    r = e_pos (1 + d/h) + T (h² + d²)/q + Δ_alg √(2A),

whose information 4/r² = (2q/(q·r))² costs one division. `covariance`: with u = σ_pos² + σ_ori² R²
the installation's covariance is u (I + (dx, dy)(dx, dy)ᵀ/h²), which needs no angle at all.
"""

from __future__ import annotations

import math

from numba import njit

from models.camera_checks import BORDER
from models.cameras import (
    DOWN,
    FOCAL_U,
    FOCAL_V,
    FORWARD,
    HALF_U,
    HALF_V,
    HEIGHT,
    K1,
    K2,
    K3,
    K4,
    KIND,
    RIGHT,
    X,
    Y,
    pixel_from_offset,
)
from models.errors import (
    ALGORITHM_95,
    CHI2_95,
    ELLIPSE,
    FORM,
    ORIENTATION_VARIANCE,
    PIXEL_VARIANCE,
    POSITION_95,
    POSITION_VARIANCE,
    RADIUS,
    REPORT_LIMIT,
    TAN_ORIENTATION,
    measurement_covariance,
)
from models.geometry import FloatArray
from models.projections import PINHOLE

# No rule about NaN is relaxed: padding is NaN and must stay unseen.
FAST = {"contract", "reassoc", "arcp", "nsz"}


@njit(cache=True, error_model="numpy", nogil=True)
def inform(
    row: FloatArray,
    parameters: FloatArray,
    max_range_m: float,
    samples: FloatArray,
    start: int,
    stop: int,
    out: FloatArray,
) -> None:
    """Write the information of samples start … stop − 1 into out (1 | 3, ≥ stop − start).

    Zero where the pose sees or reports nothing; where it does, out[0] is positive. `samples`
    (4, t) are x, y, cos and sin of the heading; `parameters` are those of an `ErrorModel`.
    """
    if not is_plain_pinhole(row):
        _inform_any(row, parameters, max_range_m, samples, start, stop, out)
    elif parameters[FORM] == RADIUS:
        _inform_radius(row, parameters, max_range_m, samples, start, stop, out[0])
    elif parameters[FORM] == ELLIPSE:
        _inform_ellipse(row, parameters, max_range_m, samples, start, stop, out[0], out[1], out[2])
    else:
        _inform_covariance(
            row, parameters, max_range_m, samples, start, stop, out[0], out[1], out[2]
        )


@njit(cache=True)
def is_plain_pinhole(row: FloatArray) -> bool:
    """Return whether a camera is a pinhole without distortion."""
    distorted = row[K1] != 0.0 or row[K2] != 0.0 or row[K3] != 0.0 or row[K4] != 0.0
    return row[KIND] == PINHOLE and not distorted


@njit(cache=True, error_model="numpy", nogil=True)
def road_block(
    xx: float, xy: float, yy: float, cos: float, sin: float
) -> tuple[float, float, float]:
    """Return [J_tt, J_tn, J_nn], the inverse of a covariance in world axes, in the road frame."""
    tt = cos * cos * xx + 2.0 * cos * sin * xy + sin * sin * yy
    nn = sin * sin * xx - 2.0 * cos * sin * xy + cos * cos * yy
    tn = cos * sin * (yy - xx) + (cos * cos - sin * sin) * xy
    scale = 1.0 / (xx * yy - xy * xy)
    return nn * scale, -tn * scale, tt * scale


@njit(cache=True, error_model="numpy", nogil=True)
def _inform_any(
    row: FloatArray,
    parameters: FloatArray,
    max_range_m: float,
    samples: FloatArray,
    start: int,
    stop: int,
    out: FloatArray,
) -> None:
    far_squared = (max_range_m * BORDER) ** 2
    limit = parameters[REPORT_LIMIT] * BORDER
    for j in range(stop - start):
        out[0, j] = 0.0
        dx = samples[0, start + j] - row[X]
        dy = samples[1, start + j] - row[Y]
        if not dx * dx + dy * dy <= far_squared:
            continue
        _, _, inside = pixel_from_offset(row, dx, dy)
        if not inside:
            continue
        xx, xy, yy, radius = measurement_covariance(row, dx, dy, parameters)
        if not radius <= limit:
            continue
        if out.shape[0] == 1:
            out[0, j] = 1.0 / xx
        else:
            cos, sin = samples[2, start + j], samples[3, start + j]
            out[0, j], out[1, j], out[2, j] = road_block(xx, xy, yy, cos, sin)


@njit(cache=True, error_model="numpy", nogil=True, fastmath=FAST)
def _inform_radius(
    row: FloatArray,
    parameters: FloatArray,
    max_range_m: float,
    samples: FloatArray,
    start: int,
    stop: int,
    out: FloatArray,
) -> None:
    x, y, h = row[X], row[Y], row[HEIGHT]
    rx, ry, r0 = row[RIGHT], row[RIGHT + 1], -row[RIGHT + 2] * h
    ux, uy, u0 = row[DOWN], row[DOWN + 1], -row[DOWN + 2] * h
    fx, fy, f0 = row[FORWARD], row[FORWARD + 1], -row[FORWARD + 2] * h
    half_u, half_v = row[HALF_U] * BORDER, row[HALF_V] * BORDER
    far_squared = (max_range_m * BORDER) ** 2
    limit = parameters[REPORT_LIMIT] * BORDER
    position, tangent = parameters[POSITION_95], parameters[TAN_ORIENTATION]
    position_per_m = position / h
    h_squared = h * h
    # Δ √(2A) = Δ √(2 / (h f_u f_v)) · z √z
    pixel = parameters[ALGORITHM_95] * math.sqrt(2.0 / (h * row[FOCAL_U] * row[FOCAL_V]))
    xs, ys = samples[0], samples[1]
    for j in range(stop - start):
        dx = xs[start + j] - x
        dy = ys[start + j] - y
        right = rx * dx + ry * dy + r0
        down = ux * dx + uy * dy + u0
        z = fx * dx + fy * dy + f0
        squared = dx * dx + dy * dy
        d = math.sqrt(squared)
        q = h - d * tangent
        known = position + position_per_m * d + pixel * (z * math.sqrt(z))
        radius_q = known * q + tangent * (h_squared + squared)
        seen = (
            (z > 0.0)
            & (abs(right) <= half_u * z)
            & (abs(down) <= half_v * z)
            & (squared <= far_squared)
            & (q > 0.0)
            & (radius_q <= limit * q)
        )
        root = 2.0 * q / radius_q
        out[j] = root * root if seen else 0.0


@njit(cache=True, error_model="numpy", nogil=True, fastmath=FAST)
def _inform_ellipse(
    row: FloatArray,
    parameters: FloatArray,
    max_range_m: float,
    samples: FloatArray,
    start: int,
    stop: int,
    out_tt: FloatArray,
    out_tn: FloatArray,
    out_nn: FloatArray,
) -> None:
    x, y, h = row[X], row[Y], row[HEIGHT]
    rx, ry, r0 = row[RIGHT], row[RIGHT + 1], -row[RIGHT + 2] * h
    ux, uy, u0 = row[DOWN], row[DOWN + 1], -row[DOWN + 2] * h
    fx, fy, f0 = row[FORWARD], row[FORWARD + 1], -row[FORWARD + 2] * h
    half_u, half_v = row[HALF_U] * BORDER, row[HALF_V] * BORDER
    pull_u, pull_v = row[RIGHT + 2] / h, row[DOWN + 2] / h
    per_u, per_v = 1.0 / row[FOCAL_U], 1.0 / row[FOCAL_V]
    far_squared = (max_range_m * BORDER) ** 2
    limit = parameters[REPORT_LIMIT] * BORDER
    position, tangent = parameters[POSITION_95], parameters[TAN_ORIENTATION]
    position_per_m = position / h
    h_squared = h * h
    pixel = parameters[ALGORITHM_95] * math.sqrt(2.0 / (h * row[FOCAL_U] * row[FOCAL_V]))
    xs, ys, coss, sins = samples[0], samples[1], samples[2], samples[3]
    for j in range(stop - start):
        dx = xs[start + j] - x
        dy = ys[start + j] - y
        right = rx * dx + ry * dy + r0
        down = ux * dx + uy * dy + u0
        z = fx * dx + fy * dy + f0
        squared = dx * dx + dy * dy
        d = math.sqrt(squared)
        q = h - d * tangent
        known = position + position_per_m * d + pixel * (z * math.sqrt(z))
        radius_q = known * q + tangent * (h_squared + squared)
        # The pixel's sides on the ground, but for the factor z.
        ax, ay = per_u * (rx + dx * pull_u), per_u * (ry + dy * pull_u)
        bx, by = per_v * (ux + dx * pull_v), per_v * (uy + dy * pull_v)
        along = (dx * ax + dy * ay) ** 2 + (dx * bx + dy * by) ** 2
        across = (dx * ay - dy * ax) ** 2 + (dx * by - dy * bx) ** 2
        stretch = max(1.0, math.sqrt(along / across)) if squared > 0.0 else 1.0
        seen = (
            (z > 0.0)
            & (abs(right) <= half_u * z)
            & (abs(down) <= half_v * z)
            & (squared <= far_squared)
            & (q > 0.0)
            & (radius_q * math.sqrt(stretch) <= limit * q)
        )
        root = 2.0 * q / radius_q
        known_across = root * root * stretch
        # Information along the sight is less than across it by this, per m² of (dx, dy).
        less = (known_across - root * root / stretch) / squared if squared > 0.0 else 0.0
        t = coss[start + j] * dx + sins[start + j] * dy
        n = coss[start + j] * dy - sins[start + j] * dx
        out_tt[j] = known_across - less * t * t if seen else 0.0
        out_tn[j] = -less * t * n if seen else 0.0
        out_nn[j] = known_across - less * n * n if seen else 0.0


@njit(cache=True, error_model="numpy", nogil=True, fastmath=FAST)
def _inform_covariance(
    row: FloatArray,
    parameters: FloatArray,
    max_range_m: float,
    samples: FloatArray,
    start: int,
    stop: int,
    out_tt: FloatArray,
    out_tn: FloatArray,
    out_nn: FloatArray,
) -> None:
    x, y, h = row[X], row[Y], row[HEIGHT]
    rx, ry, r0 = row[RIGHT], row[RIGHT + 1], -row[RIGHT + 2] * h
    ux, uy, u0 = row[DOWN], row[DOWN + 1], -row[DOWN + 2] * h
    fx, fy, f0 = row[FORWARD], row[FORWARD + 1], -row[FORWARD + 2] * h
    half_u, half_v = row[HALF_U] * BORDER, row[HALF_V] * BORDER
    pull_u, pull_v = row[RIGHT + 2] / h, row[DOWN + 2] / h
    noise = math.sqrt(parameters[PIXEL_VARIANCE])
    per_u, per_v = noise / row[FOCAL_U], noise / row[FOCAL_V]
    far_squared = (max_range_m * BORDER) ** 2
    largest = (parameters[REPORT_LIMIT] * BORDER) ** 2 / CHI2_95
    position, orientation = parameters[POSITION_VARIANCE], parameters[ORIENTATION_VARIANCE]
    per_h = 1.0 / h
    h_squared = h * h
    xs, ys, coss, sins = samples[0], samples[1], samples[2], samples[3]
    for j in range(stop - start):
        dx = xs[start + j] - x
        dy = ys[start + j] - y
        right = rx * dx + ry * dy + r0
        down = ux * dx + uy * dy + u0
        z = fx * dx + fy * dy + f0
        squared = dx * dx + dy * dy
        # The pixel's sides, one noise long, and the installation's root u (dx, dy)/h.
        ax, ay = per_u * z * (rx + dx * pull_u), per_u * z * (ry + dy * pull_u)
        bx, by = per_v * z * (ux + dx * pull_v), per_v * z * (uy + dy * pull_v)
        across = position + orientation * (h_squared + squared)
        root = math.sqrt(across)
        ix, iy = root * per_h * dx, root * per_h * dy
        c, s = coss[start + j], sins[start + j]
        at, an = c * ax + s * ay, c * ay - s * ax
        bt, bn = c * bx + s * by, c * by - s * bx
        it, in_ = c * ix + s * iy, c * iy - s * ix
        tt = across + at * at + bt * bt + it * it
        nn = across + an * an + bn * bn + in_ * in_
        tn = at * an + bt * bn + it * in_
        spread = 0.5 * (tt + nn + math.sqrt((tt - nn) ** 2 + 4.0 * tn * tn))
        seen = (
            (z > 0.0)
            & (abs(right) <= half_u * z)
            & (abs(down) <= half_v * z)
            & (squared <= far_squared)
            & (spread <= largest)
        )
        scale = 1.0 / (tt * nn - tn * tn)
        out_tt[j] = nn * scale if seen else 0.0
        out_tn[j] = -tn * scale if seen else 0.0
        out_nn[j] = tt * scale if seen else 0.0
