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


def information_nearby(scene: Scene, eyes: Sequence[Eye]) -> tuple[FloatArray, IntArray]:
    """Return what the prior and all `eyes` tell of each sample (t, 2, 2), and how many see it."""
    t, reach = len(scene.xy), scene.instance.camera.max_range_m * _WIDER
    prior = 1.0 / scene.instance.objective.prior_sigma_m**2
    information = np.tile(prior * np.eye(2), (t, 1, 1))
    seeing = np.zeros(t, dtype=np.int64)
    tree = cKDTree(scene.xy)
    rings = scene.obstacles.rings
    low = np.array([ring.min(axis=0) for ring in rings]).reshape(-1, 2)
    high = np.array([ring.max(axis=0) for ring in rings]).reshape(-1, 2)
    for eye in eyes:
        at = np.array([eye.x_m, eye.y_m])
        near = np.sort(np.array(tree.query_ball_point(at, reach), dtype=np.int64))
        close = np.flatnonzero(np.all((low <= at + reach) & (high >= at - reach), axis=1))
        walls = Obstacles(tuple(rings[i] for i in close), scene.obstacles.height_m[close])
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
