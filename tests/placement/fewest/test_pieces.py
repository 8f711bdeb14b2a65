"""Cameras that see the road twice become pieces: nothing is lost, nothing counted twice."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from models.geometry import FloatArray
from placement.fewest.pieces import PARTS, Pieces, in_pieces, shares
from placement.objectives.navigation import WhiteDrive


def drive_of(views: list[list[int]], n_samples: int, strength: list[float]) -> WhiteDrive:
    """Return what `in_pieces` reads of a drive: each camera sees its samples equally well."""
    sizes = [len(v) for v in views]
    blocks = np.repeat(np.array(strength), sizes)[:, None].astype(np.float32)
    made: Any = SimpleNamespace(
        indptr=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        indices=np.concatenate([np.array(v, dtype=np.int32) for v in views]),
        blocks=blocks,
        frames=1.0,
        n_samples=n_samples,
    )
    return cast("WhiteDrive", made)


def told(pieces: Pieces, among: np.ndarray) -> FloatArray:
    """Return the sum of blocks (t,) of some pieces."""
    out = np.zeros(pieces.drive.n_samples)
    for p in np.flatnonzero(among):
        rows = slice(pieces.drive.indptr[p], pieces.drive.indptr[p + 1])
        np.add.at(out, pieces.drive.indices[rows], pieces.drive.blocks[rows, 0])
    return out


TWICE = [[2, 3, 4], [5, 6, 7, 20, 21], [8, 9], [24, 25, 26], [0, 1, 38, 39]]


def pieces_of(units: list[int], usable: list[bool] | None = None) -> Pieces:
    drive = drive_of(TWICE, 40, [1.0, 2.0, 3.0, 4.0, 5.0])
    mask = np.ones(5, dtype=np.bool_) if usable is None else np.array(usable)
    return in_pieces(drive, mask, np.array(units, dtype=np.int64), 1.0)


def test_pieces_share_their_cameras_price_and_keep_all_it_tells() -> None:
    pieces = pieces_of([1, 1, 1, 1, 1])
    assert pieces.owner.tolist() == [0, 1, 1, 2, 3, 4, 4]
    assert pieces.per_unit == PARTS
    for i in range(5):
        assert pieces.units[pieces.owner == i].sum() == PARTS
    assert pieces.single.tolist() == [True, False, False, True, True, False, False]
    whole = np.zeros(40)
    for i, view in enumerate(TWICE):
        whole[view] += i + 1.0
    given = pieces.given[:, 0]
    np.testing.assert_allclose(told(pieces, pieces.usable) + given, whole)
    # the seam's lesser view is given away, here the later of two alike or the earlier
    assert given.sum() == pytest.approx(10.0)
    assert set(np.flatnonzero(given)) in ({0, 1}, {38, 39})


def test_prices_are_settled_where_no_camera_has_pieces_on_both_sides() -> None:
    settled = pieces_of([1, 1, 1, 1, 1]).settled()
    opened = np.flatnonzero(~settled)
    assert opened.tolist() == list(range(6, 21))  # from after its first piece began to its second


def test_nothing_is_cut_where_nobody_usable_sees_the_road_twice() -> None:
    pieces = pieces_of([3, 1, 1, 1, 1], [True, False, True, True, False])
    assert pieces.per_unit == 1
    assert pieces.settled().all()
    assert not pieces.given.any()
    assert pieces.units[pieces.usable].tolist() == [3, 1, 1]


def test_shares_are_whole_and_sum_to_the_price() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        owner = np.sort(rng.integers(0, 6, 12))
        units = rng.integers(0, 7, 6)
        lap = rng.random(6) < 0.2
        share = shares(rng.uniform(0.0, 3.0, 12), owner, units, lap)
        assert np.all(share >= 0)
        for i in np.unique(owner):
            mine = share[owner == i]
            assert mine.sum() == units[i]
            assert mine.min() > 0 or np.count_nonzero(mine) <= 1
            if lap[i] and units[i]:
                assert np.count_nonzero(mine) == 1


def test_dear_cameras_are_not_cut_finer() -> None:
    pieces = pieces_of([150, 150, 150, 150, 150])
    assert pieces.per_unit == 1
    assert pieces.units[pieces.owner == 1].sum() == 150
