"""The table by which sets of the same cameras find each other is empty again after each sample."""

import numpy as np
import pytest

from placement.fewest.arrays import DEPTH, PROVING, new_store
from placement.fewest.merging import forget_keys, put_set


@pytest.mark.parametrize("most", [40, 40_000])  # place by place, and all of it
def test_sets_are_found_by_their_cameras_and_forgotten(most: int) -> None:
    rng = np.random.default_rng(most)
    store = new_store(0)
    slot_of, work = np.zeros(2, dtype=np.int64), np.full((1, 6), 0.5)
    ids, m, v = np.empty(DEPTH, dtype=np.int64), np.empty((3, 3)), np.empty((3, 3))
    sets = {tuple(sorted(rng.integers(0, 2**17, DEPTH))) for _ in range(most)}
    for cameras in sets:
        ids[:] = cameras
        for _ in range(2):  # the second is merged into the first
            assert put_set(store, 1, slot_of, 1, 5, DEPTH, ids, True, 7, work, PROVING, m, v)
    assert slot_of.tolist() == [0, len(sets)]
    assert np.count_nonzero(store.key) == len(sets)
    forget_keys(store, int(slot_of[1]))
    assert not store.key.any()
