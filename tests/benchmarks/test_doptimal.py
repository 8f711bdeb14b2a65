"""The instances are the same for everybody, and their tables can be made."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import doptimal
from placement.information_problem import read_problem


def test_generators_give_the_same_instances_every_time(tmp_path: Path) -> None:
    assert doptimal.gaussian(100, 10, 0).sha256() == doptimal.gaussian(100, 10, 0).sha256()
    names = [instance.name + instance.objective for instance in doptimal.instances()]
    assert len(set(names)) == len(names) == 5 * (12 + 7) + 3
    instance = doptimal.fusion(60, 8, 1)
    assert np.linalg.cond(instance.prior) > 1e7
    instance.write(tmp_path / "one.npz")
    assert read_problem(tmp_path / "one.npz").sha256() == instance.sha256()


@pytest.mark.slow
def test_a_family_is_a_row_of_the_table() -> None:
    small = doptimal.Family("small", lambda seed: doptimal.gaussian(20, 12, seed))
    table = doptimal.families_table([small], "what", 60.0, seeds=2).splitlines()
    assert len(table) == 3
    assert table[2].startswith("| small | 2 of 2 |")
    assert {line.count("|") for line in table} == {9}
