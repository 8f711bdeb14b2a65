"""Footprints: the border of a camera's image on the ground, and the ground under one pixel.

The part of an image above the horizon sees nothing, and far ground is cut at a range. What is left
is the intersection of the image with a disc about the mount. Its border follows the image's border
where that lies in the disc and the circle elsewhere. The image is mapped to the ground one to one,
so walking the image border with the image on the left keeps the footprint on the left, and every
arc of the circle runs counter-clockwise. There are no holes: what a camera does not see is
connected, through the sky, to the outside.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from models.cameras import (
    HEIGHT_PX,
    WIDTH,
    Cameras,
    X,
    Y,
    offset_from_pixel,
    pixel_area,
    pixel_from_offset,
)
from models.geometry import FloatArray, IntArray

POINTS_PER_EDGE = 64
ARC_STEP_RAD = math.radians(2.0)


def footprint_polygon(cameras: Cameras, i: int, max_range_m: float) -> FloatArray:
    """Return the border (m, 2) [m] of what camera i sees of the ground within `max_range_m`.

    Counter-clockwise, not closed, world axes; (0, 2) where it sees none. Vertices lie on the true
    border (image edges of a pinhole are straight on the ground, others are curves of 64 points an
    edge). A wide lens can see two separate pieces: the larger one.
    """
    pieces = footprint_pieces(cameras, i, max_range_m)
    if not pieces:
        return np.empty((0, 2))
    return max(pieces, key=_signed_area)


def footprint_pieces(cameras: Cameras, i: int, max_range_m: float) -> list[FloatArray]:
    """Return every piece of the footprint of camera i, each as `footprint_polygon` does."""
    if not max_range_m > 0.0:
        raise ValueError(f"camera.max_range_m must be positive, got {max_range_m}")
    row = cameras.subset([i]).table()[0]
    mount = np.array([row[X], row[Y]])
    chains = _border_chains(row, max_range_m)
    if chains is None:  # the whole border lies within range
        return [mount + _walk(row, max_range_m)]
    if not chains:  # no part of the border does: all of the disc, or nothing
        if not pixel_from_offset(row, 0.0, 0.0)[2]:
            return []
        return [mount + _arc(0.0, 2.0 * math.pi, max_range_m)[:-1]]
    return [mount + piece for piece in _join_chains(chains, max_range_m)]


def pixel_areas(cameras: Cameras, camera: IntArray, xy_m: FloatArray) -> FloatArray:
    """Return the ground area [m²] of the pixel of camera[n] that sees the point xy_m[n]: (n,)."""
    return _pixel_areas(cameras.table(), np.asarray(camera, np.int64), np.asarray(xy_m))


@njit(cache=True)
def _pixel_areas(table: FloatArray, camera: IntArray, xy: FloatArray) -> FloatArray:
    areas = np.empty(len(xy))
    for n in range(len(xy)):
        row = table[camera[n]]
        areas[n] = pixel_area(row, xy[n, 0] - row[X], xy[n, 1] - row[Y])
    return areas


def _border_pixel(row: FloatArray, t: float) -> tuple[float, float]:
    """Return the border pixel at t in [0, 4): from the bottom right, up, left, down, right."""
    w, h = row[WIDTH], row[HEIGHT_PX]
    edge, s = int(t) % 4, t - math.floor(t)
    # Counter-clockwise on the image as displayed, which is counter-clockwise on the ground.
    return ((w, h * (1 - s)), (w * (1 - s), 0.0), (0.0, h * s), (w * s, h))[edge]


def _ground(row: FloatArray, t: float, max_range_m: float) -> tuple[float, float, bool]:
    dx, dy, hits = offset_from_pixel(row, *_border_pixel(row, t))
    return dx, dy, hits and math.hypot(dx, dy) <= max_range_m


def _walk(row: FloatArray, max_range_m: float) -> FloatArray:
    times = np.arange(4 * POINTS_PER_EDGE) / POINTS_PER_EDGE
    return np.array([_ground(row, t, max_range_m)[:2] for t in times])


def _border_chains(row: FloatArray, max_range_m: float) -> list[FloatArray] | None:
    """Return the runs of the image border within range, None if that is all of it.

    Each run's ends are the crossings with the circle, found by bisection to rounding.
    """
    n = 4 * POINTS_PER_EDGE
    points = [_ground(row, j / POINTS_PER_EDGE, max_range_m) for j in range(n)]
    within = [point[2] for point in points]
    if all(within):
        return None
    chains = []
    for start in (j for j in range(n) if within[j] and not within[j - 1]):
        chain = [_crossing(row, start, start - 1, max_range_m)]
        j = start
        while within[j % n]:
            chain.append(points[j % n][:2])
            j += 1
        chain.append(_crossing(row, j - 1, j, max_range_m))
        chains.append(np.array(chain))
    return chains


def _crossing(row: FloatArray, inside: int, outside: int, reach: float) -> tuple[float, float]:
    near, far = inside / POINTS_PER_EDGE, outside / POINTS_PER_EDGE
    for _ in range(60):
        middle = 0.5 * (near + far)
        if _ground(row, middle % 4.0, reach)[2]:
            near = middle
        else:
            far = middle
    dx, dy, _ = _ground(row, near % 4.0, reach)
    return dx, dy


def _join_chains(chains: list[FloatArray], max_range_m: float) -> list[FloatArray]:
    """Close chains along the circle: each end runs counter-clockwise to the nearest start."""
    starts = [math.atan2(chain[0, 1], chain[0, 0]) for chain in chains]
    left = set(range(len(chains)))
    pieces = []
    while left:
        first = current = min(left)
        parts = []
        while True:
            left.discard(current)
            parts.append(chains[current])
            azimuth = math.atan2(chains[current][-1, 1], chains[current][-1, 0])
            turns = [(start - azimuth) % (2.0 * math.pi) for start in starts]
            current = int(np.argmin(turns))
            parts.append(_arc(azimuth, turns[current], max_range_m)[1:-1])
            if current == first or current not in left:
                break
        pieces.append(np.concatenate(parts))
    return pieces


def _arc(start: float, turn: float, radius: float) -> FloatArray:
    angles = start + np.linspace(0.0, turn, max(2, 1 + math.ceil(turn / ARC_STEP_RAD)))
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def _signed_area(polygon: FloatArray) -> float:
    x, y = polygon[:, 0], polygon[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
