"""The best poses by a grid and shrinking steps, and by branch-and-bound how good any could be."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from models.geometry import FloatArray
from models.installation import Installation
from reports.single_camera import kernel
from reports.single_camera.setting import (
    HEIGHT_M,
    HIGH_DEG,
    INITIAL_SIGMA,
    LOW_DEG,
    PRIOR_SIGMA_M,
    SIZE_PX,
    Setting,
    error_model,
)

GRID = (36, 9, 6, 6)  # yaw, pitch, hfov, vfov
STARTS = 24
HALVINGS = 13  # the last steps are of a thousandth of a degree
COARSE, FOLLOWED = 3, 8  # halvings of all starts; how many distinct poses the rest is for
APART = 0.1  # of the box's width in some angle: optima nearer than that are one
SHOWN = 3
EQUAL = 1e-3


@dataclass(frozen=True, slots=True)
class Optimum:
    """A pose (yaw, pitch, hfov, vfov in degrees) and the value of its objective."""

    pose_deg: FloatArray
    value: float


@dataclass(frozen=True, slots=True)
class Found:
    """The best distinct optima, the bound on every pose in the box, and the boxes it took."""

    optima: tuple[Optimum, ...]
    bound: float
    boxes: int

    @property
    def gap(self) -> float:
        """|bound − value| / |value| of the best."""
        return abs(self.bound - self.optima[0].value) / abs(self.optima[0].value)


class Scorer:
    """The scores of one objective in one setting."""

    def __init__(self, setting: Setting, objective: str) -> None:
        """Lay the setting out for the kernels."""
        self.kind = kernel.OBJECTIVES.index(objective)
        self.sign = 1.0 if kernel.MAXIMISED[self.kind] else -1.0
        self.offsets = np.ascontiguousarray(setting.offsets_m)
        self.steps = np.ascontiguousarray(setting.steps())
        along, across, heading = np.square(INITIAL_SIGMA)
        self.p0 = np.array([along, 0.0, 0.0, across, 0.0, heading])
        self.parameters = parameters(setting)

    def boxes(self, low_deg: FloatArray, high_deg: FloatArray) -> FloatArray:
        """Return what no pose between the corners (n, 4) exceeds, (n,) scores."""
        boxes = kernel.as_boxes(np.radians(low_deg), np.radians(high_deg))
        out = np.empty(len(boxes))
        kernel.scores(self.kind, boxes, self.offsets, self.steps, self.p0, self.parameters, out)
        return out

    def poses(self, poses_deg: FloatArray) -> FloatArray:
        """Return the scores (n,) of poses (n, 4)."""
        return self.boxes(poses_deg, poses_deg)


def parameters(setting: Setting) -> FloatArray:
    """Return the kernel's parameters of a setting."""
    installation, model = Installation(), error_model()
    p = np.empty(9)
    p[kernel.HEIGHT] = HEIGHT_M
    p[kernel.E_POS] = installation.position_95_m
    p[kernel.TAN_ORI] = math.tan(math.radians(installation.orientation_95_deg))
    p[kernel.ALGORITHM] = installation.algorithm_95_px
    p[kernel.LIMIT] = model.report_limit_m
    p[kernel.RANGE] = 150.0
    p[kernel.PIXELS] = SIZE_PX[0] * SIZE_PX[1]
    p[kernel.FRAMES] = setting.frames
    p[kernel.PRIOR] = PRIOR_SIGMA_M
    return p


def find(scorer: Scorer, *, tolerance: float, most_boxes: int) -> Found:
    """Search one setting for one objective, and bound it to `tolerance` (relative) if boxes last.

    The bound holds for every yaw, pitch, hfov and vfov within the box of `setting`, whatever
    `most_boxes` is: it is the largest of what was not refuted.
    """
    poses, values = _climbed(scorer)
    best = int(np.argmax(values))
    ceiling, count, better = _refute(scorer, float(values[best]), tolerance, most_boxes)
    if len(better):
        more, their = refine(scorer, better)
        poses, values = np.vstack((poses, more)), np.append(values, their)
    optima = _distinct(poses, values, scorer.sign)
    bound = max(ceiling, *(scorer.sign * optimum.value for optimum in optima))
    return Found(tuple(optima), scorer.sign * bound, count)


def _starts(scorer: Scorer) -> FloatArray:
    """Return the best poses of the grid that are not near to a better one."""
    axes = []
    for n, low, high in zip(GRID, LOW_DEG, HIGH_DEG, strict=True):
        axes.append(low + (high - low) * (np.arange(n) + 0.5) / n)
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4)
    values = scorer.poses(grid)
    order = np.argsort(-values, kind="stable")
    chosen: list[int] = []
    for i in order[:4000]:
        if len(chosen) == STARTS:
            break
        if all(_apart(grid[i], grid[j]) for j in chosen):
            chosen.append(int(i))
    return grid[chosen]


def refine(
    scorer: Scorer, poses_deg: FloatArray, halvings: range = range(HALVINGS)
) -> tuple[FloatArray, FloatArray]:
    """Move every pose (n, 4) to the best of its 81 neighbours, with steps that halve."""
    poses = poses_deg.copy()
    values = scorer.poses(poses)
    moves = np.stack(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 4, indexing="ij"), axis=-1).reshape(-1, 4)
    for halving in halvings:
        step = 0.5 ** (halving + 1) * (HIGH_DEG - LOW_DEG) / np.array(GRID)
        for _ in range(4):
            around = np.clip(poses[:, None] + moves * step, LOW_DEG, HIGH_DEG)
            scores = scorer.poses(around.reshape(-1, 4)).reshape(len(poses), -1)
            at = scores.argmax(axis=1)
            gain = scores[np.arange(len(poses)), at] > values
            if not gain.any():
                break
            poses[gain] = around[gain, at[gain]]
            values[gain] = scores[gain, at[gain]]
    return poses, values


def _climbed(scorer: Scorer) -> tuple[FloatArray, FloatArray]:
    """Refine the grid's best poses coarsely, and the best distinct ones of what that gives finely.

    Most starts climb the same few hills: they need not all be followed to the top.
    """
    poses, values = refine(scorer, _starts(scorer), range(COARSE))
    chosen = _far_apart(poses, values, FOLLOWED)
    return refine(scorer, poses[chosen], range(COARSE, HALVINGS))


def _refute(
    scorer: Scorer, best: float, tolerance: float, most_boxes: int
) -> tuple[float, int, FloatArray]:
    """Split boxes until none may hold a score above best·(1 ± tolerance), or boxes run out.

    Returns the bound, how many boxes were looked at, and middles that beat `best`.
    """
    first = (36, 8, 7, 7)
    width = (HIGH_DEG - LOW_DEG) / np.array(first)
    corner = np.stack(np.meshgrid(*[np.arange(n) for n in first], indexing="ij"), axis=-1).reshape(
        -1, 4
    )
    low = LOW_DEG + corner * width
    high = low + width
    count, threshold = 0, best + tolerance * abs(best)
    finished = -math.inf
    better: list[FloatArray] = []
    while len(low) and count + len(low) <= most_boxes:
        ceiling = scorer.boxes(low, high)
        count += len(low)
        open_ = ceiling > threshold
        middles = 0.5 * (low + high)[open_]  # of a closed box none can beat the threshold
        values = scorer.poses(middles)
        if len(values) and values.max() > best:
            best = float(values.max())
            better.append(middles[int(np.argmax(values))])
            threshold = best + tolerance * abs(best)
            open_ = ceiling > threshold
        finished = max(finished, float(np.max(ceiling[~open_], initial=-math.inf)))
        low, high, ceiling = low[open_], high[open_], ceiling[open_]
        last = float(np.max(ceiling, initial=-math.inf))
        low, high = _halved(low, high)
    else:
        last = last if len(low) else -math.inf
    return max(finished, last), count, np.array(better).reshape(-1, 4)


def _halved(low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cut each box in two, across its longest side; turning counts twice a field of view."""
    size = (high - low) * np.array([2.0, 2.0, 1.0, 1.0])
    axis = size.argmax(axis=1)
    rows = np.arange(len(low))
    middle = 0.5 * (low[rows, axis] + high[rows, axis])
    left, right = high.copy(), low.copy()
    left[rows, axis] = middle
    right[rows, axis] = middle
    return np.vstack((low, right)), np.vstack((left, high))


def _distinct(poses: FloatArray, values: FloatArray, sign: float) -> list[Optimum]:
    chosen = _far_apart(poses, values, SHOWN)
    return ranked([Optimum(poses[i], sign * float(values[i])) for i in chosen])


def ranked(optima: list[Optimum]) -> list[Optimum]:
    """Put first, of the optima as good as the best but for `EQUAL`, the one most towards traffic.

    Scores without odometry do not tell one end of a road from the other, and see mirrored poses as
    equal: which of them a search finds to be better by rounding means nothing.
    """
    best = optima[0].value
    equal = [o for o in optima if abs(o.value - best) <= EQUAL * abs(best)]
    first = max(equal, key=lambda o: abs((o.pose_deg[0] + 180.0) % 360.0 - 180.0))
    return [first, *(o for o in optima if o is not first)]


def _far_apart(poses: FloatArray, values: FloatArray, most: int) -> list[int]:
    """Return the rows of the best poses of which no two are near each other."""
    chosen: list[int] = []
    for i in np.argsort(-values, kind="stable"):
        if len(chosen) < most and all(_apart(poses[i], poses[j]) for j in chosen):
            chosen.append(int(i))
    return chosen


def _apart(a: FloatArray, b: FloatArray) -> bool:
    difference = np.abs(a - b)
    difference[0] = min(difference[0], 360.0 - difference[0])
    return bool(np.any(difference > APART * (HIGH_DEG - LOW_DEG)))
