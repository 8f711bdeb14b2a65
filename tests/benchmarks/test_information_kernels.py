"""The benchmark of the kernels, and the speed it must show."""

from __future__ import annotations

import pytest

from benchmarks.information_kernels import (
    as_markdown,
    assembly_table,
    dense_table,
    exponent,
    growth_table,
    long_road,
)


def test_the_exponent_is_the_slope_in_logarithms() -> None:
    rows = [{"km": k, "work": 3.0 * k**1.5} for k in (1, 4, 16)]
    assert exponent(rows, "work") == pytest.approx(1.5)


def test_a_long_road_is_as_long_as_asked() -> None:
    assert long_road(4).length_m == pytest.approx(4000.0)


def test_a_table_is_markdown() -> None:
    assert as_markdown([{"a": 1, "b": "x"}]) == "| a | b |\n| --- | --- |\n| 1 | x |"


@pytest.mark.slow
def test_the_kernel_is_twenty_times_its_twin() -> None:
    assert min(row["ratio"] for row in dense_table(3)) >= 20.0


@pytest.mark.slow
def test_winding_is_assembled_in_a_tenth_of_a_second() -> None:
    rows = {row["model"]: row["1 thread, ms"] for row in assembly_table(5)}
    assert max(rows.values()) < 100.0


@pytest.mark.slow
def test_work_grows_with_the_visible_pairs() -> None:
    rows = growth_table(3)
    assert rows[-1]["visible pairs"] <= 1.1
    assert rows[-1]["CPU ms"] <= 1.1
