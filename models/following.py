"""Where a moving point is along a road it has been followed on: a few nanoseconds a question."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from models.control import SpeedPolicy
from models.geometry import FloatArray
from models.roads import Road

TABLE_STEP_M = 0.5
_TRIES = 8  # a leap of ten metres settles in three
_STRAIGHT = 1e-9


class Course(NamedTuple):
    """List a road for the closed loop: equally spaced rows, (n + 1,), both ends included.

    xy_m are relative to `origin_m`, so that a scene a hundred kilometres off keeps its digits.
    speed_mps is the speed wanted at each row.
    """

    length_m: float
    closed: bool
    step_m: float
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    curvature: FloatArray
    speed_mps: FloatArray
    origin_x_m: float
    origin_y_m: float


def course(road: Road, policy: SpeedPolicy, step_m: float = TABLE_STEP_M) -> Course:
    """Table `road` every `step_m` or a little less, with the speeds that `policy` wants on it."""
    table = road.table(step_m)
    step = road.length_m / (len(table.s_m) - 1)
    origin_x, origin_y = float(table.x_m[0]), float(table.y_m[0])
    return Course(
        float(road.length_m),
        bool(road.closed),
        step,
        np.ascontiguousarray(table.x_m - origin_x),
        np.ascontiguousarray(table.y_m - origin_y),
        np.ascontiguousarray(table.heading_rad),
        np.ascontiguousarray(table.curvature),
        np.ascontiguousarray(policy.along(table.curvature, step, road.closed)),
        origin_x,
        origin_y,
    )


@njit(cache=True)
def follow(course: Course, s_near: float, x: float, y: float) -> tuple[float, float, float, float]:
    """Return (s, lateral, heading, curvature) of the closest point near `s_near`.

    The road about each row is taken for the circle of its curvature, whose closest point is known
    in closed form; the row is changed until the point lies within half a step of it. What is left
    is the change of curvature within half a step: below 1e-4 m for clothoids of 1e-3 /m². s runs on
    over the laps of a closed road (it is not wrapped), and beyond the ends of an open one along
    the circle there. lateral > 0 on the left.
    """
    rows = len(course.x_m) - 1
    row = round(s_near / course.step_m)
    offset = 0.0
    index = 0
    lateral = 0.0
    for attempt in range(_TRIES):
        if course.closed:
            index = row % rows
        else:
            row = min(max(row, 0), rows)
            index = row
        heading = course.heading_rad[index]
        c, d = math.cos(heading), math.sin(heading)
        dx, dy = x - course.x_m[index], y - course.y_m[index]
        along = c * dx + d * dy
        left = c * dy - d * dx
        bend = course.curvature[index]
        if abs(bend) < _STRAIGHT:
            offset, lateral = along, left
        else:
            a, b = bend * along, 1.0 - bend * left
            offset = math.atan2(a, b) / bend
            # (1 − √(a² + b²))/κ, without the cancellation
            lateral = (2.0 * left - bend * (along * along + left * left)) / (
                1.0 + math.sqrt(a * a + b * b)
            )
        hop = round(offset / course.step_m)
        if hop == 0 or attempt == _TRIES - 1:
            break
        if not course.closed and (row + hop < 0 or row + hop > rows) and (row in (0, rows)):
            break
        row += hop
    s = row * course.step_m + offset
    bend = course.curvature[index]
    return s, lateral, course.heading_rad[index] + bend * offset, bend


@njit(cache=True)
def speed_wanted(course: Course, s: float) -> float:
    """Return the speed wanted at `s`, linear between rows; laps wrap, open ends hold."""
    place = s / course.step_m
    rows = len(course.x_m) - 1
    if course.closed:
        place = place % rows
    place = min(max(place, 0.0), float(rows))
    low = min(int(place), rows - 1)
    share = place - low
    speed: float = (1.0 - share) * course.speed_mps[low] + share * course.speed_mps[low + 1]
    return speed
