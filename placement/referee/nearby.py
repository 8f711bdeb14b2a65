"""What cameras tell of samples near them, for streets of which each camera sees next to nothing.

The same looks as along one road (`referee.sight`, `referee.shadows`), at the samples within reach
and past the buildings there, so that the work grows with the cameras and not with the city.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from models.geometry import FloatArray, IntArray
from models.obstacles import Obstacles
from placement.referee.sight import TIE, Eye
from placement.referee.values import Scene, localised, look_past

_WIDER = TIE + 1e-6


class Nearby:
    """Say which samples and buildings of a drive are within reach of a camera at (x, y)."""

    def __init__(self, scene: Scene) -> None:
        """Sort the samples, and look once round every building."""
        self.reach_m = scene.instance.camera.max_range_m * _WIDER
        self._obstacles = scene.obstacles
        self._tree = cKDTree(scene.xy)
        rings = scene.obstacles.rings
        self._low = np.array([ring.min(axis=0) for ring in rings]).reshape(-1, 2)
        self._high = np.array([ring.max(axis=0) for ring in rings]).reshape(-1, 2)

    def samples(self, x_m: float, y_m: float) -> IntArray:
        """Return the samples within reach, rising."""
        return np.sort(
            np.array(self._tree.query_ball_point((x_m, y_m), self.reach_m), dtype=np.int64)
        )

    def count(self, places: FloatArray) -> int:
        """Return how many pairs of the places (n, 2) and samples are within reach."""
        return int(self._tree.query_ball_point(places, self.reach_m, return_length=True).sum())

    def buildings(self, x_m: float, y_m: float) -> Obstacles:
        """Return the buildings of which some part may be within reach."""
        at, reach = np.array([x_m, y_m]), self.reach_m
        near = np.flatnonzero(
            np.all((self._low <= at + reach) & (self._high >= at - reach), axis=1)
        )
        rings = tuple(self._obstacles.rings[i] for i in near)
        return Obstacles(rings, self._obstacles.height_m[near])


def information_nearby(scene: Scene, eyes: Sequence[Eye]) -> tuple[FloatArray, IntArray]:
    """Return what the prior and all `eyes` tell of each sample (t, 2, 2), and how many see it."""
    t = len(scene.xy)
    prior = 1.0 / scene.instance.objective.prior_sigma_m**2
    information = np.tile(prior * np.eye(2), (t, 1, 1))
    seeing = np.zeros(t, dtype=np.int64)
    nearby = Nearby(scene)
    for eye in eyes:
        near = nearby.samples(eye.x_m, eye.y_m)
        walls = nearby.buildings(eye.x_m, eye.y_m)
        sight = look_past(walls, eye, scene.xy[near], scene.instance)
        seen = near[sight.seen]
        information[seen] += np.linalg.inv(sight.whole[sight.seen])
        seeing[seen] += 1
    return information, seeing


def localisation_nearby(scene: Scene, eyes: Sequence[Eye]) -> float:
    """Return the value of `localisation` for all drives."""
    return math.fsum(
        drive.weight * localised(drive, information_nearby(drive, eyes)[0])
        for drive in scene.drives()
    )
