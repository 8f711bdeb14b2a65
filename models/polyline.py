"""Polylines made drivable: every corner rounded by an arc, so that the heading never jumps."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from models.curves import ClothoidChain
from models.geometry import FloatArray, Pose
from models.roads import Road

LEAST_STEP_M = 0.1  # corners nearer together are one: files give a centimetre or two
CUT_M = 0.1  # how far an arc may stay off a corner ...
RADIUS_M = 8.0  # ... unless the car could not follow it
_BACK_RAD = math.radians(170.0)  # who turns by more turns round
_PIECE_M = 1e-9
_EASE_M = 1.0
_MOST_MEETING_M = 8.0  # of a corner from the segment it replaces
_SPIKE_RAD, _SPIKE_M = math.radians(100.0), 2.0


def rounded_road(
    points_m: ArrayLike, left_m: float = 1.5, right_m: float = 1.5, *, radius_m: float = RADIUS_M
) -> Road:
    """Follow points (n, 2) by straights and arcs; ends and end headings are the polyline's.

    Where the line turns back on itself its point is blunted to 5 cm.

    A corner that turns by θ is cut off by an arc of radius r which starts r·tan(θ/2) before it and
    stays r·(1/cos(θ/2) − 1) off it: `CUT_M`, or more where the radius would be below `radius_m`,
    and less where the way to the next corner is too short for both. The road is therefore
    shorter than the polyline by r·(2 tan(θ/2) − θ) a corner.

    Raises:
        ValueError: for points that are not finite, or fewer than two apart.
    """
    points = _blunted(distinct_points(points_m))
    lengths, curvatures = _pieces(points, radius_m)
    step = points[1] - points[0]
    frame = Pose(float(points[0, 0]), float(points[0, 1]), math.atan2(step[1], step[0]))
    chain = ClothoidChain(lengths, curvatures, curvatures)
    return Road(chain, False, frame, np.zeros(1), np.array([left_m]), np.array([right_m]))


def distinct_points(points_m: ArrayLike, least_m: float = LEAST_STEP_M) -> FloatArray:
    """Drop points nearer than `least_m` to the last one kept; both ends stay.

    Raises:
        ValueError: for points that are not finite (n, 2), or all in one place.
    """
    points = np.array(points_m, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
        raise ValueError(f"a line must be at least 2 points (n, 2), got {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError("a line's points must be finite")
    steps = np.hypot(*np.diff(points, axis=0).T)
    if np.all(steps > least_m):
        return points
    keep = [0]
    for i in range(1, len(points)):
        if math.dist(points[i], points[keep[-1]]) > least_m:
            keep.append(i)
    if keep[-1] != len(points) - 1:
        if len(keep) > 1:
            keep.pop()
        keep.append(len(points) - 1)
    kept: FloatArray = points[keep]
    if len(kept) == 2 and math.dist(kept[0], kept[1]) <= 1e-6:
        raise ValueError(f"a line must have a length, got one at ({points[0, 0]:g}, "
                         f"{points[0, 1]:g})")  # fmt: skip
    return kept


def offset_polyline(points_m: FloatArray, left_m: float) -> FloatArray:
    """Shift a polyline (n, 2) to the left: corners move along bisectors, at most twice as far."""
    steps = np.diff(points_m, axis=0)
    unit = steps / np.hypot(*steps.T)[:, None]
    normal = np.column_stack((-unit[:, 1], unit[:, 0]))
    before, after = np.vstack((normal[:1], normal)), np.vstack((normal, normal[-1:]))
    middle = before + after
    stretch = 2.0 / np.maximum(np.sum(middle * middle, axis=1), 1.0)
    shifted: FloatArray = points_m + left_m * stretch[:, None] * middle
    return shifted


def cut_polyline(points_m: FloatArray, start_m: float, end_m: float) -> FloatArray:
    """Return the part of a polyline (n, 2) between two arc lengths, start < end."""
    s = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points_m, axis=0).T))))
    inner = points_m[(s > start_m) & (s < end_m)]
    ends = [
        [np.interp(at, s, points_m[:, 0]), np.interp(at, s, points_m[:, 1])]
        for at in (start_m, end_m)
    ]
    return np.vstack((ends[:1], inner, ends[1:]))


def eased(points_m: FloatArray, start_rad: float, end_rad: float) -> FloatArray:
    """Let a polyline (n, 2) leave and arrive in given headings, so that it joins on smoothly.

    A corner is added a little way out from each end, in the direction asked for: a metre, or a
    third of the first segment where that is shorter.
    """
    points = distinct_points(points_m)
    ends = []
    for p, q, angle, way in (
        (points[0], points[1], start_rad, 1.0),
        (points[-1], points[-2], end_rad, -1.0),
    ):
        step = way * min(_EASE_M, math.dist(p, q) / 3.0)
        ends.append(p + step * np.array([math.cos(angle), math.sin(angle)]))
    return np.vstack((points[:1], ends[:1], points[1:-1], ends[1:], points[-1:]))


def without_spikes(points_m: FloatArray) -> FloatArray:
    """Drop corners (n, 2) at which a line turns back within 2 m: overlaps of what was joined."""
    points = distinct_points(points_m)
    while len(points) > 2:
        _, segment, turn = _measure(points)
        sharp = (np.abs(turn) > _SPIKE_RAD) & (np.minimum(segment[:-1], segment[1:]) < _SPIKE_M)
        if not sharp.any():
            break
        keep = np.ones(len(points), dtype=np.bool_)
        # one at a time from each run, for the next corner looks different then
        first = np.flatnonzero(sharp)
        keep[first[np.concatenate(([True], np.diff(first) > 1))] + 1] = False
        points = distinct_points(points[keep])
    return points


def drivable(points_m: FloatArray, radius_m: float) -> FloatArray:
    """Straighten a polyline (n, 2) until every corner has room for an arc of `radius_m`.

    The shorter segment beside the tightest corner is given up for the point where its neighbours
    meet, or its middle where they do not, again and again. So a turn drawn as a few short pieces
    becomes one corner, which a car cuts as it can. First and last segments stay; what is still
    too tight between them stays as it is.
    """
    points = distinct_points(points_m)
    while len(points) > 3:
        _, segment, turn = _measure(points)
        tangent = np.tan(0.5 * np.minimum(np.abs(turn), _BACK_RAD))
        reach = _shared_out(radius_m * tangent, segment)
        tight = np.where(tangent > 1e-6, reach / np.maximum(tangent, 1e-6), np.inf)
        # The first and the last segment are no choice: a corner between them alone is let be.
        inner = np.where(np.arange(len(segment)) % (len(segment) - 1) == 0, np.inf, segment)
        choice = np.where(inner[:-1] <= inner[1:], np.arange(len(turn)), np.arange(len(turn)) + 1)
        tight = np.where(np.isfinite(inner[choice]), tight, np.inf)
        corner = int(np.argmin(tight))
        if tight[corner] >= radius_m * (1.0 - 1e-9):
            break
        points = _collapsed(points, int(choice[corner]))
    return points


def _collapsed(points: FloatArray, i: int) -> FloatArray:
    """Replace the segment from corner i to i + 1 by one corner."""
    a, b, c, d = points[i - 1 : i + 3]
    u, v, gap = b - a, c - d, c - b
    cross = float(u[0] * v[1] - u[1] * v[0])
    meeting = 0.5 * (b + c)
    if cross != 0.0:
        along = (gap[0] * v[1] - gap[1] * v[0]) / cross
        back = (gap[0] * u[1] - gap[1] * u[0]) / cross
        point = b + along * u
        if along >= 0.0 and back >= 0.0 and math.dist(point, meeting) < _MOST_MEETING_M:
            meeting = point
    return np.vstack((points[:i], meeting[None], points[i + 2 :]))


def end_headings(points_m: FloatArray) -> tuple[float, float]:
    """Return the headings of the first and last segment of what `rounded_road` makes of points."""
    points = distinct_points(points_m)
    first, last = points[1] - points[0], points[-1] - points[-2]
    return math.atan2(first[1], first[0]), math.atan2(last[1], last[0])


def polyline_length(points_m: FloatArray) -> float:
    """Return the length of a polyline (n, 2)."""
    return float(np.sum(np.hypot(*np.diff(points_m, axis=0).T)))


def _pieces(points: FloatArray, radius_m: float) -> tuple[FloatArray, FloatArray]:
    """Return lengths and curvatures (pieces,) of straights and arcs in turn."""
    _, segment, turn = _measure(points)
    if not len(turn):
        return segment, np.zeros(1)
    half = 0.5 * np.abs(turn)
    tangent = np.tan(half)
    bent = half > 1e-6
    by_cut = CUT_M / (1.0 / np.cos(np.where(bent, half, 1.0)) - 1.0)
    least = np.where(bent, radius_m * tangent, 0.0)
    reach = _shared_out(least, segment)
    # Only what no corner needs goes to the gentle ones, whose arcs could take all there is.
    rest = segment - np.append(reach, 0.0) - np.insert(reach, 0, 0.0)
    more = np.where(bent, np.maximum(by_cut * tangent - reach, 0.0), 0.0)
    reach = reach + _shared_out(more, np.maximum(rest, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = np.where(reach > 0.0, np.sign(turn) * tangent / reach, 0.0)
        arc = np.where(reach > 0.0, reach * np.abs(turn) / tangent, 0.0)
    straight = segment - np.append(reach, 0.0) - np.insert(reach, 0, 0.0)
    lengths = np.empty(2 * len(segment) - 1)
    curvatures = np.zeros_like(lengths)
    lengths[0::2], lengths[1::2], curvatures[1::2] = straight, arc, curvature
    keep = lengths > _PIECE_M
    return lengths[keep], curvatures[keep]


def _shared_out(wanted: FloatArray, segment: FloatArray) -> FloatArray:
    """Give each corner (n − 2,) the reach it wants, or its share of a segment that is too short."""
    at_ends = np.concatenate(([0.0], wanted, [0.0]))
    total = at_ends[:-1] + at_ends[1:]
    share = np.minimum(1.0, segment / np.maximum(total, 1e-300))
    reach: FloatArray = wanted * np.minimum(share[:-1], share[1:])
    return reach


def _measure(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return steps (n − 1, 2), their lengths (n − 1,) and the turns between them (n − 2,)."""
    steps = np.diff(points, axis=0)
    before, after = steps[:-1], steps[1:]
    turn = np.arctan2(
        before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], np.sum(before * after, axis=1)
    )
    return steps, np.hypot(*steps.T), turn


def _blunted(points: FloatArray) -> FloatArray:
    """Blunt spikes: two corners of about a right angle in place of one where a line turns back."""
    while True:
        steps, segment, turn = _measure(points)
        if not len(turn) or float(np.max(np.abs(turn))) <= _BACK_RAD:
            return points
        i = int(np.argmax(np.abs(turn))) + 1
        unit = steps[i - 1] / segment[i - 1]
        aside = 0.25 * LEAST_STEP_M * np.array([unit[1], -unit[0]])
        points = np.vstack((points[:i], points[i] + aside, points[i] - aside, points[i + 1 :]))
