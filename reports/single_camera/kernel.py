"""Scores of poses, and bounds on the scores of all poses in a box, by the same formulas.

A box is an interval of yaw, pitch, hfov and vfov. No pose in it differs from the middle one by a
rotation of more than ε = (Δyaw + Δpitch)/2, the sum of the two turns. So of any pose in the box

- a sample is seen only if it lies at most ε outside each side plane of the middle pose with the
  widest fields of view: n·v ≥ −sin ε for the unit normals n and the sample's direction v;
- its depth is at least D cos(min(α + ε, α_corner)), α the angle from the middle's axis and
  α_corner that of the widest image's corner;
- with the narrowest fields of view (the densest pixels) that gives the least pixel area, hence the
  least error radius, hence the most information.

All objectives grow with the information of every sample, so the score of that information bounds
the box. A box without extent is a pose, and its bound is its score.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from models.errors import radius_from_area
from models.geometry import FloatArray
from placement.objectives.windows.filter import predict, update

KALMAN_GAIN, LOCALISATION, ENTROPY, TRACE, LATERAL = range(5)
OBJECTIVES = ("kalman_gain", "localisation", "entropy", "trace", "lateral")
MAXIMISED = (True, True, True, False, False)
# Parameters of the scores, as one array.
HEIGHT, E_POS, TAN_ORI, ALGORITHM, LIMIT, RANGE, PIXELS, FRAMES, PRIOR = range(9)
SEEN = 1e-9  # what lies on the border of the image is seen, up to this


@njit(cache=True)
def look(box, dx, dy, p):  # type: ignore[no-untyped-def]
    """Return the most information (1/m²) and the least pixel area (m²) of a sample; 0 if unseen."""
    h = p[HEIGHT]
    ground = math.sqrt(dx * dx + dy * dy)
    if ground > p[RANGE]:
        return 0.0, math.inf
    yaw, pitch = 0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3])
    turn = 0.5 * (box[1] - box[0] + box[3] - box[2])
    distance = math.sqrt(ground * ground + h * h)
    cy, sy, cp, sp = math.cos(yaw), math.sin(yaw), math.cos(pitch), math.sin(pitch)
    along, aside = cy * dx + sy * dy, sy * dx - cy * dy
    right = aside / distance
    down = (h * cp - along * sp) / distance
    forward = (along * cp + h * sp) / distance
    slack = math.sin(min(turn, 0.5 * math.pi)) + SEEN
    half_h, half_v = 0.5 * box[5], 0.5 * box[7]
    if math.sin(half_h) * forward - math.cos(half_h) * abs(right) < -slack:
        return 0.0, math.inf
    if math.sin(half_v) * forward - math.cos(half_v) * abs(down) < -slack:
        return 0.0, math.inf
    corner = math.atan(math.hypot(math.tan(half_h), math.tan(half_v)))
    angle = math.acos(min(1.0, max(-1.0, forward)))
    if angle - turn > corner + SEEN:
        return 0.0, math.inf
    depth = distance * math.cos(min(angle + turn, corner))
    per_pixel = 4.0 * math.tan(0.5 * box[4]) * math.tan(0.5 * box[6]) / p[PIXELS]
    area = depth * depth * depth / h * per_pixel
    r = radius_from_area(ground, h, area, p[E_POS], p[TAN_ORI], p[ALGORITHM])
    if not r <= p[LIMIT]:
        return 0.0, math.inf
    return 4.0 / (r * r), area


@njit(cache=True)
def score(kind, box, offsets, steps, p0, p):  # type: ignore[no-untyped-def]
    """Return the score of one box: larger is better, minus the value where that is minimised."""
    t = len(offsets)
    total = 0.0
    if kind == KALMAN_GAIN:
        for n in range(t):
            info, area = look(box, offsets[n, 0], offsets[n, 1], p)
            if info > 0.0:
                total += info / (info + 4.0 / 9.0) / area  # 1/(1 + (r/3)²) with r² = 4/info
        return total / t
    if kind == LOCALISATION:
        for n in range(t):
            info, _ = look(box, offsets[n, 0], offsets[n, 1], p)
            total += 2.0 * math.log1p(p[PRIOR] * p[PRIOR] * info)
        return total
    state = (p0[0], p0[1], p0[2], p0[3], p0[4], p0[5])
    for n in range(t):
        if n:
            state = predict(state, steps[n])
        info, _ = look(box, offsets[n, 0], offsets[n, 1], p)
        if info > 0.0:
            j = p[FRAMES] * info
            a, b, c, d, e, f, det = update(state, j, 0.0, j)
            state = (a, b, c, d, e, f)
            if kind == ENTROPY:
                total += math.log(det)
        if kind == TRACE:
            total -= state[0] + state[3]
        elif kind == LATERAL:
            total -= state[3]
    return total if kind == ENTROPY else total / t


@njit(cache=True, parallel=True)
def scores(kind, boxes, offsets, steps, p0, p, out):  # type: ignore[no-untyped-def]
    """Write the score of each box (n, 8) into `out` (n,)."""
    for i in prange(len(boxes)):
        out[i] = score(kind, boxes[i], offsets, steps, p0, p)


def as_boxes(low_rad: FloatArray, high_rad: FloatArray) -> FloatArray:
    """Interleave corners (n, 4) and (n, 4) into boxes (n, 8)."""
    return np.ascontiguousarray(np.stack((low_rad, high_rad), axis=2).reshape(len(low_rad), 8))
