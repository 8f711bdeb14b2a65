"""The sampling benchmark runs and reports every lens."""

from __future__ import annotations

from benchmarks.sampling import sampling_table


def test_every_lens_has_a_positive_speed() -> None:
    rows = sampling_table(samples=1000, repeats=1)
    assert [lens for lens, _ in rows] == ["pinhole", "stereographic", "equidistant"]
    assert all(speed > 0.0 for _, speed in rows)
