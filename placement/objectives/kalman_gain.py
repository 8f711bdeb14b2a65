"""The dissertation's cheap score of a single camera, kept for the comparison and the cascade.

    score_i = Σ_pixels p(ground point of the pixel) / (1 + (r/3)²)

p is the density of cars on the ground and r the 95 % radius of the error there, in metres. A pixel
covers the ground area A, so the sum is an integral of p/A over the ground, and with cars spread
evenly along the path and few of them off the centre line it is a mean over path samples:

    score_i = (1/t) Σ_{samples seen} (1/A_it) / (1 + (r_it/3)²)    [pixels per m² of car]

It counts pixels, not knowledge: it prefers narrow fields of view (20° × 20°) that do badly on
every navigation objective, and it knows nothing of the other cameras.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.cameras import Cameras, X, Y, pixel_area
from models.geometry import FloatArray, IntArray
from models.roads import RoadPoints
from placement.information import Information
from placement.objectives.selection import Selection, distinct

RADIUS_SCALE_M = 3.0


def kalman_gain(cameras: Cameras, points: RoadPoints, information: Information) -> FloatArray:
    """Score every camera by itself, (c,), in pixels per m².

    `information` says which of the `points` a camera sees and how well: r is two standard
    deviations of one frame in its worst direction.
    """
    J = information.blocks.astype(np.float64)
    if information.isotropic:
        least = J[:, 0]
    else:
        mean, half = 0.5 * (J[:, 0] + J[:, 2]), 0.5 * (J[:, 0] - J[:, 2])
        least = mean - np.hypot(half, J[:, 1])
    worth = least / (least + 4.0 / RADIUS_SCALE_M**2)  # 1/(1 + (r/3)²) with r² = 4/least
    scores = np.zeros(len(cameras))
    _add_pixels(
        cameras.table(),
        np.ascontiguousarray(points.xy),
        np.ascontiguousarray(information.indptr, dtype=np.int64),
        np.ascontiguousarray(information.indices, dtype=np.int32),
        np.maximum(worth, 0.0),
        scores,
    )
    return scores / information.n_samples


class KalmanGain:
    """The sum of the single scores as an objective: modular, so the best sum is the optimum."""

    name = "kalman_gain"
    unit = "px/m^2"
    maximise = True
    submodular = True

    def __init__(self, scores: FloatArray) -> None:
        """Take the candidates' scores (c,)."""
        self.scores = scores

    @property
    def n_candidates(self) -> int:
        """The number of candidates, c."""
        return int(self.scores.size)

    def value(self, selected: IntArray) -> float:
        """Return the sum of the scores of `selected`."""
        return math.fsum(self.scores[distinct(selected, self.n_candidates)])

    def state(self, selected: IntArray | None = None) -> KalmanGainState:
        """Start a placement, empty unless `selected` is given."""
        return KalmanGainState(self, [] if selected is None else [int(i) for i in selected])


class KalmanGainState(Selection):
    """A placement under construction."""

    def __init__(self, objective: KalmanGain, selected: list[int]) -> None:
        """Start from `selected`."""
        super().__init__(objective.n_candidates, selected)
        self._objective = objective

    @property
    def score(self) -> float:
        """The sum of the scores of `selected`."""
        return self._objective.value(np.array(self._selected, dtype=np.int64))

    def gains(self, candidates: IntArray | None = None) -> FloatArray:
        """Return the score of each of `candidates` (default: all), 0 for those selected, (m,)."""
        scores = self._objective.scores
        rows = np.arange(scores.size) if candidates is None else np.asarray(candidates)
        gains: FloatArray = np.where(np.isin(rows, self._selected), 0.0, scores[rows])
        return gains


@njit(cache=True)
def _add_pixels(
    table: FloatArray,
    xy: FloatArray,
    indptr: IntArray,
    indices: NDArray[np.int32],
    worth: FloatArray,
    scores: FloatArray,
) -> None:
    """Add worth/A of each entry to its camera's score."""
    for i in range(len(scores)):
        row = table[i]
        for e in range(indptr[i], indptr[i + 1]):
            t = indices[e]
            scores[i] += worth[e] / pixel_area(row, xy[t, 0] - row[X], xy[t, 1] - row[Y])
