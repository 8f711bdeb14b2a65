"""The search for a share on functions whose least value is known."""

from __future__ import annotations

import pytest

from placement.tempered.shares import LEAST_DISTANCE, LOWEST, better_share


@pytest.mark.parametrize("least_at", [0.15, 0.4, 0.77, 0.9, 0.973, 0.995])
@pytest.mark.parametrize("start", [0.2, 0.5, 0.8, 0.95, 1.0])
def test_comes_within_half_a_step_of_the_least(least_at: float, start: float) -> None:
    tried: dict[float, float] = {}

    def bound(share: float) -> float:
        tried[share] = found = abs(share - least_at) / (1.0 - least_at)
        return found

    begin = bound(start)
    found = better_share(start, begin, bound, lambda: True)
    assert tried[found] == min(tried.values())
    ratio = max(1.0 - found, LEAST_DISTANCE) / (1.0 - least_at)
    assert 0.7 <= ratio <= 1.42 or found < LOWEST * 2.0


def test_stays_where_it_is_the_best() -> None:
    tried: list[float] = []

    def worse(share: float) -> float:
        tried.append(share)
        return 2.0

    assert better_share(0.9, 1.0, worse, lambda: True) == 0.9
    assert tried == pytest.approx([0.8, 0.95, 1 - 0.1 * 2**0.5, 1 - 0.1 / 2**0.5])


def test_asks_for_nothing_once_time_is_up() -> None:
    calls: list[float] = []

    def better_each_time(share: float) -> float:
        calls.append(share)
        return -float(len(calls))

    found = better_share(0.99, 0.0, better_each_time, lambda: len(calls) < 2)
    assert len(calls) == 2
    assert found == calls[-1]
