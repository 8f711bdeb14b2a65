"""A camera's second copy tells what those of other mounts do that it stands for, and no more."""

import numpy as np
import pytest

from models.geometry import FloatArray, IntArray
from placement.fewest.seconds import seconds_of

# Camera 0 sees samples 2…5 and is kept; 1 to 3 see parts of that, and less of it.
VIEWS = [[2, 3, 4, 5], [2, 3], [3, 4], [4, 5]]
STRENGTH = [4.0, 3.0, 2.0, 4.0]


def seconds(group: list[int], strength: list[float]) -> tuple[FloatArray, IntArray, FloatArray]:
    sizes = [len(v) for v in VIEWS]
    told = np.repeat(np.array(strength), sizes)
    blocks = np.column_stack([told, np.zeros(told.size), told])
    kept = blocks[:4].copy()
    out, most = seconds_of(
        np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        np.concatenate([np.array(v, dtype=np.int32) for v in VIEWS]),
        blocks, np.array([1, 2, 3]), np.array(group), np.ones(4, dtype=np.int64),
        (np.array([0, 4]), kept, np.array([2]), np.array([0]),
         np.array([0, 0, 0, 1, 1, 1, 1, 1])),
    )  # fmt: skip
    return out, most, kept


@pytest.mark.parametrize(
    ("group", "expected", "most"),
    [
        ([0, 1, 2, 3], [3.0, 3.0, 4.0, 4.0], 3),
        ([0, 0, 1, 1], [0.0, 2.0, 4.0, 4.0], 3),  # camera 1 is of its mount
        ([0, 0, 1, 0], [0.0, 2.0, 2.0, 0.0], 2),
        ([0, 0, 0, 0], [0.0, 0.0, 0.0, 0.0], 0),  # in no placement twice
        ([-1, -1, -1, -1], [3.0, 3.0, 4.0, 4.0], 3),  # nobody excludes anybody
    ],
)
def test_a_second_joins_those_left_out_of_other_mounts(
    group: list[int], expected: list[float], most: int
) -> None:
    out, stand_in, _ = seconds(group, STRENGTH)
    np.testing.assert_allclose(out[:, 0], expected, rtol=1e-11)
    np.testing.assert_allclose(out[:, 2], expected, rtol=1e-11)
    assert stand_in.tolist() == [most]


def test_where_nobody_stands_for_one_left_out_every_camera_is_its_own_second() -> None:
    out, stand_in, kept = seconds([0, 1, 2, 3], [4.0, 3.0, 5.0, 1.0])
    assert out is kept
    assert stand_in.tolist() == [0]
