"""Read a road from a CSV of its centre line, as in the TUMFTM racetrack database."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from models.files.text import read_text
from models.geometry import FloatArray
from models.roads import MIN_STEP_M, Road, road_from_points

LEAST_RADIUS_M = 0.1  # less is a fold in the data, not a bend
COLUMNS = ("x_m", "y_m", "w_tr_right_m", "w_tr_left_m")
# Beyond any map's coordinates and any road's width: whatever is larger is not in metres.
MOST_M = {"x_m": 1e9, "y_m": 1e9, "w_tr_right_m": 1e3, "w_tr_left_m": 1e3}


def read_centreline(
    path: str | Path, *, closed: bool | None = None, half_width_m: float = 1.5
) -> Road:
    """Read a centre line: rows `x_m, y_m[, w_tr_right_m, w_tr_left_m]`, separated by commas.

    Lines that start with # are comments; one that lists these column names, with or without #, is
    a header and sets their order. Both edges lie at `half_width_m` where the file gives no widths.
    A last row that repeats the first closes the road. Otherwise `closed=None` means: closed if
    the way from the last point to the first is at most 1.5 times the largest step between
    neighbours and at most a quarter of the polyline's length.

    Raises a ValueError of one line that names the file and the line: no such file, a field that is
    not a finite number, rows of different lengths, a negative width, two equal neighbouring
    points, fewer than two rows (three if closed), a fold.
    """
    path = Path(path)
    values, lines = _read_table(path)
    points = values[:, :2]
    if len(points) > 2 and closed is not False and math.dist(points[0], points[-1]) <= MIN_STEP_M:
        values, points, lines, closed = values[:-1], points[:-1], lines[:-1], True
    least = 3 if closed else 2
    if len(points) < least:
        kind = "a closed" if closed else "a"
        raise ValueError(
            f"{path}: {kind} road needs at least {least} rows of coordinates, got {len(points)}"
        )
    steps = np.hypot(*np.diff(points, axis=0).T)
    for i in np.flatnonzero(steps <= MIN_STEP_M):
        raise ValueError(
            f"{path}: line {lines[i + 1]}: neighbouring points must differ, "
            f"got ({points[i, 0]:g}, {points[i, 1]:g}) twice (before in line {lines[i]})"
        )
    if closed is None:
        closed = _looks_closed(points, steps)
    left, right = (half_width_m,) * 2 if values.shape[1] == 2 else (values[:, 3], values[:, 2])
    with np.errstate(all="ignore"):  # of a fold, refused below
        road = road_from_points(points, closed=closed, left_m=left, right_m=right)
        table = road.table(max(0.05, road.length_m / 1e6))
    turn = np.maximum(
        np.abs(np.diff(table.heading_rad)) / 1.5,  # a cusp turns by π from one point to the next
        np.abs(table.curvature[1:]) * LEAST_RADIUS_M,
    )
    if not turn.max() <= 1.0:  # on the way back along itself the curvature is no number
        sharp = int(np.argmax(turn))
        x, y = float(table.x_m[sharp]), float(table.y_m[sharp])
        if not math.isfinite(x + y):
            x, y = _sharpest_corner(points)
        raise ValueError(
            f"{path}: the curve through the points must turn on a radius of at least "
            f"{LEAST_RADIUS_M:g} m, got a fold near ({x:.6g}, {y:.6g})"
        )
    return road


def _sharpest_corner(points: FloatArray) -> tuple[float, float]:
    """Return the point (x, y) at which the polyline through `points` (n, 2) turns most."""
    step = np.diff(np.vstack([points[-1:], points, points[:1]]), axis=0)
    step /= np.maximum(np.hypot(*step.T), MIN_STEP_M)[:, None]
    x, y = points[int(np.argmin(np.sum(step[1:] * step[:-1], axis=1)))]
    return float(x), float(y)


def _looks_closed(points: FloatArray, steps: FloatArray) -> bool:
    gap = math.dist(points[0], points[-1])
    return len(points) >= 3 and gap <= min(1.5 * float(steps.max()), 0.25 * float(steps.sum()))


def _read_table(path: Path) -> tuple[FloatArray, list[int]]:
    """Return the values, columns in the order of COLUMNS, and each row's line number."""
    text = read_text(path)
    order: tuple[str, ...] | None = None
    rows: list[list[float]] = []
    lines: list[int] = []
    for number, line in enumerate(text.splitlines(), start=1):
        cells = [cell.strip() for cell in line.strip().lstrip("#").split(",")]
        if not rows and _is_header(cells):
            order = tuple(cells)
        elif line.strip() and not line.lstrip().startswith("#"):
            order = order or COLUMNS[: len(cells)]
            rows.append(_parse_row(cells, order, f"{path}: line {number}"))
            lines.append(number)
    order = order or COLUMNS[:2]
    columns = [order.index(name) for name in COLUMNS if name in order]
    values = np.array(rows, dtype=np.float64).reshape(len(rows), len(order))[:, columns]
    return values, lines


def _is_header(cells: list[str]) -> bool:
    return sorted(cells) in (sorted(COLUMNS), sorted(COLUMNS[:2]))


def _parse_row(cells: list[str], order: tuple[str, ...], where: str) -> list[float]:
    if len(order) not in (2, 4):
        raise ValueError(
            f"{where}: a row must hold x_m, y_m or {', '.join(COLUMNS)}, got {len(cells)} fields"
        )
    if len(cells) != len(order):
        raise ValueError(f"{where}: a row must hold {len(order)} fields, got {len(cells)}")
    row = []
    for name, cell in zip(order, cells, strict=True):
        try:
            value = float(cell)
        except ValueError:
            raise ValueError(f"{where}: {name} must be a number, got {cell!r}") from None
        if not math.isfinite(value):
            raise ValueError(f"{where}: {name} must be finite, got {cell}")
        if value < 0.0 and name.startswith("w_"):
            raise ValueError(f"{where}: {name} must be 0 or more, got {cell}")
        if abs(value) > MOST_M[name]:
            raise ValueError(f"{where}: {name} must be at most {MOST_M[name]:g}, got {cell}")
        row.append(value)
    return row
