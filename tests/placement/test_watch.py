"""Progress says when kernels are compiled: a minute without a word looks like a hang."""

import pytest
from numba import njit

from placement import watch as module
from placement.watch import COMPILING, watch

Said = list[tuple[str, float | None]]


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> Said:
    """Return what is reported, every line of it."""
    lines: Said = []
    monkeypatch.setattr(module, "_plain", lambda: lambda text, share: lines.append((text, share)))
    return lines


def kernel():  # type: ignore[no-untyped-def]
    """Return a kernel that calls another, neither of them compiled yet."""

    @njit
    def inner(x):  # type: ignore[no-untyped-def]
        return x + 1.0

    @njit
    def outer(x):  # type: ignore[no-untyped-def]
        return 2.0 * inner(x)

    return outer


def test_compiling_is_said_with_what_was_going_on_and_only_the_first_time(said: Said) -> None:
    work = kernel()
    with watch() as report:
        report("beam of 1", 0.25)
        assert work(1.0) == 4.0
        assert work(2.0) == 6.0
    before, *compiling, after = said
    assert before == after == ("beam of 1", 0.25)
    assert compiling == [(f"beam of 1 ({COMPILING})", 0.25)] * 2  # the kernel, and what it calls


def test_what_compiles_after_the_block_or_quietly_is_not_said(said: Said) -> None:
    with watch(quiet=True) as report:
        report("quiet", None)
        kernel()(1.0)
    with watch():
        pass
    kernel()(1.0)
    assert said == []
