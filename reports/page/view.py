"""What a placement's page shows, as plain arrays: the road, the cameras, the error for each k."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from models.footprints import footprint_polygon
from models.geometry import FloatArray
from placement.assemble import Scene
from placement.commands import Result
from placement.prediction import predict
from placement.roadway import network_of

MOST_POINTS = 800  # of a curve along the road: more cannot be seen, and the page must stay small
MOST_STEPS = 100
DRAWN_RANGE_M = 60.0


@dataclass(frozen=True, slots=True)
class Step:
    """The placement of k cameras: rows of `View.cameras`, and what is predicted along the road."""

    k: int
    members: tuple[int, ...]
    position_sigma_m: FloatArray
    lateral_2sigma_m: FloatArray


@dataclass(frozen=True, slots=True)
class View:
    """A placement laid out for drawing; arrays along the road are (p,), p ≤ 800.

    `candidates` are all cameras of any step, `footprints` their ground within 60 m, (m, 2) each.
    `nested` says that each step adds one camera to the step before.
    """

    s_m: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    edges: tuple[FloatArray, FloatArray]
    candidates: tuple[int, ...]
    footprints: tuple[FloatArray, ...]
    steps: tuple[Step, ...]
    nested: bool


def view_of(result: Result) -> View:
    """Lay out `result`: the placements of its budget curve, or its own cameras one by one."""
    scene = result.scene
    nested = not result.by_budget
    placements = result.by_budget or _one_by_one(scene, result.solution.selected)
    candidates = tuple(sorted({i for chosen in placements.values() for i in chosen}))
    row = {candidate: n for n, candidate in enumerate(candidates)}
    points = scene.points
    at = _thinned(len(points))
    steps = []
    for k, chosen in placements.items():
        along = predict(scene, chosen)
        members = tuple(sorted(row[i] for i in chosen))
        steps.append(Step(k, members, along.position_sigma_m[at], 2.0 * along.lateral_sigma_m[at]))
    cameras = scene.candidates.cameras.subset(np.array(candidates, dtype=np.int64))
    reach = min(scene.instance.camera.max_range_m, DRAWN_RANGE_M)
    return View(
        points.s_m[at],
        points.x_m[at],
        points.y_m[at],
        _edges(scene),
        candidates,
        tuple(footprint_polygon(cameras, i, reach) for i in range(len(candidates))),
        tuple(steps),
        nested,
    )


def _thinned(n: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return np.unique(np.linspace(0, n - 1, min(n, MOST_POINTS)).astype(np.int64))


def _edges(scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Return the road's left and right edges (p, 2); a closed road's first point again at last.

    Of a network, those of every carriageway, with a row of NaN between them.
    """
    road = scene.road
    network = network_of(scene.instance)
    if network is not None:
        step = max(2.0, network.length_m / (20 * MOST_POINTS))
        sampled = network.sample(step)
        normal = np.column_stack(
            (-np.sin(sampled.points.heading_rad), np.cos(sampled.points.heading_rad))
        )
        left = sampled.points.xy + sampled.left_m[:, None] * normal
        right = sampled.points.xy - sampled.right_m[:, None] * normal
        breaks = sampled.first[1:-1]
        return np.insert(left, breaks, np.nan, axis=0), np.insert(right, breaks, np.nan, axis=0)
    s = np.linspace(0.0, road.length_m, min(2 * MOST_POINTS, 2 + int(road.length_m)))
    points = road.evaluate(s)
    left, right = road.half_widths(s)
    normal = np.column_stack((-np.sin(points.heading_rad), np.cos(points.heading_rad)))
    return points.xy + left[:, None] * normal, points.xy - right[:, None] * normal


def _one_by_one(scene: Scene, selected: Sequence[int]) -> Mapping[int, tuple[int, ...]]:
    """Order the cameras by what each adds to those before it, and return every beginning."""
    left, chosen = list(selected), [int(i) for i in selected]
    if len(left) <= MOST_STEPS:
        state = scene.problem.objective.state()
        while left:
            best = left[int(np.argmax(state.gains(np.array(left, dtype=np.int64))))]
            state.add(best)
            left.remove(best)
        chosen = state.selected
    ks = np.unique(np.linspace(0, len(chosen), min(len(chosen), MOST_STEPS) + 1).astype(np.int64))
    return {int(k): tuple(chosen[:k]) for k in ks}
