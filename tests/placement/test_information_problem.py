"""Bare problems: what is read, what is refused, and that nothing is unpickled or inflated."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from placement.information_problem import (
    InformationProblem,
    information_problem,
    read_information_problem,
    read_problem,
    write_information_problem,
)
from placement.solve import solve

C, N = 6, 3
GOOD: dict[str, Any] = {
    "prior": np.eye(N),
    "factors": np.random.default_rng(0).normal(size=(C, N, 2)),
    "budget": 2,
}


class Bomb:
    """Tell whether it was unpickled."""

    gone_off = False

    def __reduce__(self) -> tuple[Any, ...]:
        return (setattr, (Bomb, "gone_off", True))


def test_a_problem_written_is_the_problem_read(tmp_path: Path) -> None:
    path = tmp_path / "design.npz"
    group = np.array([0, 0, 1, 1, -1, -1])
    cost = np.arange(1.0, 7.0)
    write_information_problem(path, GOOD["prior"], GOOD["factors"], 5.5, cost, group)
    problem = read_information_problem(path)
    assert problem.constraints.group.tolist() == group.tolist()
    assert problem.constraints.money == 5.5
    direct = information_problem(GOOD["prior"], GOOD["factors"], 5.5, cost, group)
    first, second = solve(problem, "exchange"), solve(direct, "exchange")
    assert first.selected == second.selected
    assert first.value == second.value > 0.0


def test_the_objective_is_kept_and_the_hash_sees_only_the_numbers(tmp_path: Path) -> None:
    path = tmp_path / "design.npz"
    first = InformationProblem(GOOD["prior"], GOOD["factors"], 2, objective="trace_inverse")
    first.write(path)
    second = read_problem(path)
    assert second.problem().objective.name == "trace_inverse"
    assert second.sha256() == first.sha256()
    assert second.changed(budget=3).sha256() != first.sha256()
    assert second.changed(objective="log_det").sha256() != first.sha256()


def test_without_costs_the_budget_counts(tmp_path: Path) -> None:
    path = tmp_path / "design.npz"
    np.savez(path, **GOOD)
    problem = read_information_problem(path)
    assert problem.constraints.budget == 2
    assert len(solve(problem, "greedy").selected) == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"budget": 7}, "budget must be a whole number of 0…6, got 7"),
        ({"budget": -1}, "budget must be a whole number of 0…6, got -1"),
        ({"budget": 1.5}, "budget must be a whole number of 0…6, got 1.5"),
        ({"budget": np.nan}, "budget must be a whole number of 0…6, got nan"),
        ({"budget": np.ones(2)}, r"budget must be one number, got shape \(2,\)"),
        ({"prior": None}, "lacks the array 'prior'"),
        ({"prior": np.diag([1.0, 1.0, -1.0])}, "prior must be positive definite"),
        ({"prior": np.eye(4)}, r"factors must have shape \(c, 4, r\)"),
        ({"prior": np.full((3, 3), np.nan)}, r"prior\[0, 0\] must be finite"),
        ({"group": np.arange(5)}, "group must hold 6 whole numbers"),
        ({"group": np.full(6, 6)}, r"group\[0\] must lie in -1…5, got 6"),
        ({"group": np.full(6, 0.5)}, "group must hold 6 whole numbers"),
        ({"cost": np.full(6, -1.0)}, r"cost\[0\] must be finite and at least 0"),
        ({"cost": np.full(5, 1.0)}, r"cost must have shape \(6,\)"),
        ({"cost": np.ones(6), "budget": -1}, "budget must be finite and at least 0, got -1"),
        ({"mystery": np.ones(2)}, "holds 'mystery.npy', wanted arrays named prior"),
        ({"objective": np.array("beauty")}, "objective must be log_det or trace_inverse"),
        ({"objective": np.array(["log_det"] * 2)}, "objective must be one word"),
        ({"objective": np.array([Bomb()], dtype=object)}, "objective must hold real numbers, got"),
        ({"prior": np.eye(3) + np.eye(3, k=1)}, "prior must be symmetric"),
        ({"factors": np.ones((6, 3))}, r"factors must have shape \(c, 3, r\)"),
        ({"factors": np.full((6, 3, 1), np.inf)}, r"factors\[0, 0, 0\] must be finite"),
        ({"cost": np.array(["dear"] * 6)}, "cost must hold real numbers"),
        ({"prior": np.eye(3) * 1j}, "prior must hold real numbers"),
    ],
)
def test_what_is_no_problem_is_refused_in_one_line(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    path = tmp_path / "bad.npz"
    arrays = {k: v for k, v in {**GOOD, **change}.items() if v is not None}
    np.savez(path, allow_pickle=True, **arrays)
    with pytest.raises(ValueError, match=message) as caught:
        read_information_problem(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert not Bomb.gone_off


def test_an_object_array_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "bomb.npz"
    np.savez(path, **{**GOOD, "cost": np.array([Bomb()] * C, dtype=object)}, allow_pickle=True)
    with pytest.raises(ValueError, match="cost must hold real numbers, got object"):
        read_information_problem(path)
    assert not Bomb.gone_off


def test_ten_gigabytes_of_zeros_are_refused_by_their_header(tmp_path: Path) -> None:
    path = tmp_path / "zeros.npz"
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (1_250_000, 1000, 1)}
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("factors.npy", header.getvalue() + bytes(1000))
    with pytest.raises(ValueError, match="at most 4,000,000,000 bytes, got 10,000,000,000"):
        read_information_problem(path)


@pytest.mark.parametrize("content", [b"", b"no archive at all", b"PK\x03\x04 and no more"])
def test_a_file_that_is_no_archive_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.npz"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"is no whole \.npz file"):
        read_information_problem(path)
    with pytest.raises(ValueError, match="No such file"):
        read_information_problem(tmp_path / "absent.npz")
