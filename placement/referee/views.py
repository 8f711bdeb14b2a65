"""What every candidate tells of every sample, from the NumPy twin, place by place.

Poses that stand at one place look at the samples within reach, past the buildings there, and at no
others: along a road that changes nothing, and over a network it is what makes it possible.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from models.geometry import FloatArray, IntArray
from placement.assemble import build_errors
from placement.candidates import Candidates
from placement.information.reference import dense_chunks
from placement.referee.nearby import Nearby
from placement.referee.shadows import unhidden
from placement.referee.values import Scene, eyes_of


class Views:
    """Every candidate's information [tt, tn, nn] (c, t) in road axes, as sparse matrices."""

    def __init__(self, scene: Scene, candidates: Candidates) -> None:
        """Look from every place."""
        instance, nearby = scene.instance, Nearby(scene)
        errors = build_errors(instance)
        width, t = 1 if errors.isotropic else 3, len(scene.xy)
        rows: list[list[sparse.csr_array]] = [[], [], []]
        for here in standing_together(candidates):
            x, y = (float(a[here[0]]) for a in (candidates.cameras.x_m, candidates.cameras.y_m))
            near = nearby.samples(x, y)
            free = unhidden(
                eyes_of(candidates, here[:1].tolist())[0], scene.xy[near], nearby.buildings(x, y)
            )
            near = near[free]
            found = np.zeros((len(here), len(near), width))
            if len(near):
                points = scene.road.evaluate(scene.track.s_m[near])
                cameras = candidates.cameras.subset(here)
                for part, blocks in dense_chunks(
                    cameras, points, errors, instance.camera.max_range_m
                ):
                    found[part] = blocks
            i, j = np.nonzero(found[:, :, 0])
            for k in range(3):
                off = k == 1 and width == 1  # a number times the identity
                some = slice(0, 0) if off else slice(None)
                value = found[i, j, min(k, width - 1)]
                at = (value[some], (i[some], near[j[some]]))
                rows[k].append(sparse.coo_array(at, shape=(len(here), t)).tocsr())
        self.parts = [sparse.csr_array(sparse.vstack(blocks)) for blocks in rows]

    def total(self, x: FloatArray) -> FloatArray:
        """Return Σ x_i J_i, (t, 2, 2)."""
        tt, tn, nn = (part.T @ x for part in self.parts)
        total: FloatArray = np.stack([np.stack([tt, tn], -1), np.stack([tn, nn], -1)], -2)
        return total

    def against(self, slopes: FloatArray) -> FloatArray:
        """Return Σ_t ⟨J_it, slope_t⟩ of every candidate, (c,)."""
        tt, tn, nn = self.parts
        products: FloatArray = (
            tt @ slopes[:, 0, 0] + 2.0 * (tn @ slopes[:, 0, 1]) + nn @ slopes[:, 1, 1]
        )
        return products


def pairs_within_reach(scene: Scene, candidates: Candidates) -> int:
    """Return how many pairs of pose and sample there are to look at."""
    cameras = candidates.cameras
    return Nearby(scene).count(np.column_stack([cameras.x_m, cameras.y_m]))


def standing_together(candidates: Candidates) -> list[IntArray]:
    """Return the candidates in a row that stand at one place, one array each."""
    c = candidates.cameras
    moved = (np.diff(c.x_m) != 0.0) | (np.diff(c.y_m) != 0.0) | (np.diff(c.height_m) != 0.0)
    return np.split(np.arange(len(candidates)), np.flatnonzero(moved) + 1)
