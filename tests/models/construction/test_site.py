"""Bad sites are refused in one line that names the field."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.construction.site import make_site
from models.geometry import Pose

BOX = [[40.0, -10.0], [60.0, -10.0], [60.0, 10.0], [40.0, 10.0]]
BOW_TIE = [[40.0, -10.0], [60.0, 10.0], [60.0, -10.0], [40.0, 10.0]]


@pytest.mark.parametrize(
    ("start", "goal", "obstacles", "message"),
    [
        (Pose(0, 0), Pose(0, 0), [], r"goal must differ from start, both are \[0, 0, 0\]"),
        (Pose(50, 0), Pose(100, 0), [BOX], r"start must lie outside .*inside road.construct.obst"),
        (Pose(0, 0), Pose(61, 0), [BOX], r"goal must keep 2.5 m .*obstacles\[0\], got 1 m"),
        (Pose(0, 0), Pose(100, 0), [BOW_TIE], r"obstacles\[0\] must be a simple polygon.*Self-int"),
        (Pose(0, 0), Pose(100, 0), [BOX, [[0, 5], [9, 5]]], r"obstacles\[1\] must have at least 3"),
        (Pose(0, 0), Pose(100, 0), [[[1, 5], [5, 5], [9, 5]]], r"obstacles\[0\] must "),
        (Pose(0, math.nan), Pose(100, 0), [], r"start must be finite"),
    ],
)
def test_a_bad_site_is_refused(
    start: Pose, goal: Pose, obstacles: list[object], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        make_site(start, goal, obstacles, clearance_m=1.0, width_m=3.0)  # type: ignore[arg-type]


def test_equal_places_with_different_headings_are_a_site() -> None:
    site = make_site(Pose(0, 0, 0), Pose(0, 0, 1), [], clearance_m=1.0, width_m=3.0)
    assert site.keep_m == 2.5


def test_only_convex_corners_count_and_joined_obstacles_have_one_mark() -> None:
    notched = [[0, 0], [10, 0], [10, 10], [5, 5], [0, 10]]
    near = (np.array(BOX) - [46.0, 0.0]).tolist()  # 2 m beyond: no road between
    site = make_site(
        Pose(-30, 0), Pose(90, 0), [np.add(notched, [16, 0]), near], clearance_m=1.0, width_m=3.0
    )
    assert len(site.corner_m) == 4 + 4
    assert len(site.marks_m) == 1
