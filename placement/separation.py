"""Cameras at different places stand apart: who is too near whom, and which stand in one clique."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from scipy.spatial import KDTree

from models.geometry import BoolArray, FloatArray, IntArray

TIE = 1e-9  # relative: mounts exactly the separation apart are far enough, wherever the scene lies
SAME_PLACE_M = 1e-6  # nearer than this is the same mount


def too_near(place_m: FloatArray, at_m: FloatArray, separation_m: float) -> BoolArray:
    """Mark the places (m, 2) that are not `at_m` (2,) and nearer to it than `separation_m`."""
    distance = np.hypot(place_m[:, 0] - at_m[0], place_m[:, 1] - at_m[1])
    near: BoolArray = (distance > SAME_PLACE_M) & (distance < separation_m * (1.0 - TIE))
    return near


def cliques(place_m: FloatArray, group: IntArray, separation_m: float) -> Any:
    """Return cliques of conflicting places as 0/1 rows over candidates, CSR (m, c).

    Every pair of places that are too near each other and hold one camera at most (all their
    candidates are of one group) is in some clique; each clique is grown greedily, nearest first.
    """
    keys = np.round((place_m - place_m.mean(axis=0)) / SAME_PLACE_M).astype(np.int64)
    _, first, place = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    place = place.reshape(-1)
    sites = place_m[first]
    limited = _hold_one(place, group, len(sites))
    reach = separation_m * (1.0 - TIE)
    pairs = KDTree(sites).query_pairs(reach, output_type="ndarray")
    pairs = pairs[np.all(limited[pairs], axis=1)]
    distance = np.hypot(*(sites[pairs[:, 0]] - sites[pairs[:, 1]]).T)
    pairs = pairs[(distance < reach) & (distance > SAME_PLACE_M)]
    near: list[set[int]] = [set() for _ in sites]
    for a, b in pairs.tolist():
        near[a].add(b)
        near[b].add(a)
    left = {(a, b) for a, b in pairs.tolist()}
    found: list[list[int]] = []
    for a, b in pairs.tolist():
        if (a, b) not in left:
            continue
        clique, common = [a, b], near[a] & near[b]
        while common:
            new = min(common, key=lambda q: (float(np.hypot(*(sites[q] - sites[a]))), q))
            clique.append(new)
            common &= near[new]
        left -= {(min(p, q), max(p, q)) for p in clique for q in clique}
        found.append(sorted(clique))
    rows = np.concatenate([np.full(len(q), n) for n, q in enumerate(found)] or [np.empty(0, int)])
    columns = np.concatenate([np.array(q) for q in found] or [np.empty(0, int)]).astype(np.int64)
    of_sites = sparse.csr_array(
        (np.ones(len(rows)), (rows, columns)), shape=(len(found), len(sites))
    )
    site_of = sparse.csr_array(
        (np.ones(len(place)), (place, np.arange(len(place)))), shape=(len(sites), len(place))
    )
    return sparse.csr_array(of_sites @ site_of)


def _hold_one(place: IntArray, group: IntArray, n_places: int) -> BoolArray:
    """Mark the places (m,) of which no placement holds two candidates."""
    least, most = np.full(n_places, np.iinfo(np.int64).max), np.full(n_places, -2)
    np.minimum.at(least, place, group)
    np.maximum.at(most, place, group)
    alone = np.bincount(place, minlength=n_places) == 1
    one: BoolArray = alone | ((least == most) & (least >= 0))
    return one
