"""Random maps: poses and polygons of a seed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

from models.geometry import FloatArray, Pose


@dataclass(frozen=True)
class Map:
    """Hold what `road.construct` asks for."""

    start: Pose
    goal: Pose
    obstacles: list[FloatArray]
    radius_m: float
    clearance_m: float
    width_m: float


def random_map(seed: int) -> Map:
    """Draw one to six triangles, rectangles and stars about the way between two poses."""
    rng = np.random.default_rng(seed)
    length = float(rng.uniform(80.0, 250.0))
    polygons: list[FloatArray] = []
    for _ in range(int(rng.integers(1, 7))):
        size = float(rng.uniform(5.0, 30.0))
        centre = np.array([rng.uniform(0.1, 0.9) * length, rng.uniform(-0.25, 0.25) * length])
        kind = rng.integers(3)
        if kind == 0:
            angles = np.sort(rng.uniform(0.0, math.tau, 3))
            ring = size * np.column_stack((np.cos(angles), np.sin(angles)))
        elif kind == 1:
            a, b = size, size * rng.uniform(0.2, 1.0)
            ring = np.array([[-a, -b], [a, -b], [a, b], [-a, b]])
        else:
            n = int(rng.integers(5, 9))
            angles = (np.arange(n) + rng.uniform(0.0, 0.8, n)) * math.tau / n
            ring = (size * rng.uniform(0.35, 1.0, n))[:, None] * np.column_stack(
                (np.cos(angles), np.sin(angles))
            )
        turn = rng.uniform(0.0, math.tau)
        spin = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
        ring = ring @ spin + centre
        if shapely.Polygon(ring).is_valid and shapely.Polygon(ring).area > 1.0:
            polygons.append(ring)
    return Map(
        start=Pose(0.0, 0.0, float(rng.uniform(-1.5, 1.5))),
        goal=Pose(length, float(rng.uniform(-20.0, 20.0)), float(rng.uniform(-1.5, 1.5))),
        obstacles=polygons,
        radius_m=float(rng.uniform(5.0, 35.0)),
        clearance_m=float(rng.uniform(0.0, 5.0)),
        width_m=float(rng.uniform(2.5, 8.0)),
    )
