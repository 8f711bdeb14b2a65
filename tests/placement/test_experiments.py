"""Tables of experiments: what is read, in which separators, and what is refused by line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from placement.experiments import Experiments, read_experiments, read_table, write_table
from placement.solve import solve


def test_experiments_are_read_a_row_each(tmp_path: Path) -> None:
    path = tmp_path / "experiments.csv"
    path.write_text("a,b,c\n1,2,3\n\n# middle\n4,5,6.5\n")
    factors = read_experiments(path)
    assert factors.shape == (2, 3, 1)
    assert factors[1, :, 0].tolist() == [4.0, 5.0, 6.5]


@pytest.mark.parametrize("text", ["1;2\n3;4\n", "1\t2\n3\t4\n", "1 2\n3   4\n", "\ufeff1,2\n3,4"])
def test_other_separators_do(tmp_path: Path, text: str) -> None:
    path = tmp_path / "experiments.txt"
    path.write_text(text)
    assert read_experiments(path)[:, :, 0].tolist() == [[1.0, 2.0], [3.0, 4.0]]


def test_what_is_written_reads_back_exactly_with_costs_and_groups(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    written = Experiments(
        rng.normal(size=(9, 4, 1)), rng.uniform(size=9), rng.integers(-1, 3, size=9)
    )
    path = tmp_path / "experiments.csv"
    write_table(path, written)
    read = read_table(path)
    assert read.cost is not None
    assert read.group is not None
    np.testing.assert_array_equal(read.factors, written.factors)
    np.testing.assert_array_equal(read.cost, written.cost)
    np.testing.assert_array_equal(read.group, written.group)
    problem = read.problem(1.5).problem()
    assert problem.constraints.money == 1.5
    assert solve(problem, "greedy").value > 0.0
    with pytest.raises(ValueError, match="must have rank 1"):
        write_table(path, Experiments(np.ones((3, 2, 2))))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2\n3\n", ":2: wanted 2 numbers, got 1"),
        ("a,b\n3\n", ":2: wanted 2 numbers, got 1"),
        ("1,2\n3,x\n", ":2: wanted numbers, got '3,x'"),
        ("a,b\nc,d\n", ":2: wanted numbers, got 'c,d'"),
        ("1,2\n3,nan\n", ":2: wanted finite numbers"),
        ("a,b\n", "holds no experiments"),
        ("", "holds no experiments"),
        ("cost,group\n1,2\n", "holds costs and groups but no experiments"),
        ("a,group\n1,0.5\n", "group must hold whole numbers"),
    ],
)
def test_experiments_that_are_none_are_refused_by_line(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "experiments.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_experiments(path)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "experiments.csv"
    path.write_bytes(b"1,2\n\xff\xfe\n")
    with pytest.raises(ValueError, match="must be UTF-8 text"):
        read_experiments(path)
