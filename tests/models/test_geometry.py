"""Poses obey the axioms of the group of plane motions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.geometry import Pose, frozen, wrap_angle

POSES = st.builds(Pose, st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-10.0, 10.0))
POINTS = np.array([[0.0, 0.0], [3.0, -4.0], [100.0, 7.0]])


def same(a: Pose, b: Pose) -> bool:
    turn = wrap_angle(a.heading_rad - b.heading_rad)
    return math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)) < 1e-9 and abs(turn) < 1e-12


@given(POSES, POSES, POSES)
def test_composition_is_associative(a: Pose, b: Pose, c: Pose) -> None:
    assert same((a @ b) @ c, a @ (b @ c))


@given(POSES)
def test_the_inverse_undoes_a_pose_from_either_side(a: Pose) -> None:
    assert same(a @ a.inverse(), Pose())
    assert same(a.inverse() @ a, Pose())


@given(POSES, POSES)
def test_composing_is_applying_one_after_the_other(a: Pose, b: Pose) -> None:
    assert np.allclose((a @ b).apply(POINTS), a.apply(b.apply(POINTS)), atol=1e-9)


def test_headings_turn_counter_clockwise() -> None:
    assert np.allclose(Pose(1.0, 2.0, math.pi / 2).apply(np.array([3.0, 0.0])), [1.0, 5.0])


@given(st.floats(-100.0, 100.0))
def test_wrapping_keeps_the_direction_and_lies_within_half_a_turn(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-12)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-12)
    assert wrap_angle(np.array([angle]))[0] == wrapped


def test_frozen_arrays_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        frozen(np.zeros(2))[0] = 1.0
