"""Ctrl-C asks a running solve to end; it then returns its best placement with its bound.

An exception in the middle of things would not do: numba, HiGHS and imports swallow or break on it.
So the first signal only sets a flag, which `Run.out_of_time` and `Run.remaining` read as the end
of time; a second one interrupts at once.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_ASKED = threading.Event()


def asked_to_stop() -> bool:
    """Return whether Ctrl-C has asked the running solve to end."""
    return _ASKED.is_set()


@contextmanager
def stop_on_request() -> Iterator[None]:
    """Let Ctrl-C end time inside this block instead of raising.

    Only in the main thread, where signals arrive, and only where nobody else handles them.
    """
    mine = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if not mine:
        yield
        return
    _ASKED.clear()
    signal.signal(signal.SIGINT, _ask)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        _ASKED.clear()


@contextmanager
def held_back() -> Iterator[None]:
    """Let Ctrl-C wait until the block is over, and reach whoever handles it then.

    For what must not stop in the middle: files moved into place, and imports, which swallow it or
    break on it. Only in the main thread, where signals arrive.
    """
    handler = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield
        return
    asked = threading.Event()
    signal.signal(signal.SIGINT, lambda _number, _frame: asked.set())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if asked.is_set():
            signal.raise_signal(signal.SIGINT)


@contextmanager
def interrupts_by_name() -> Iterator[None]:
    """Raise KeyboardInterrupt, where Ctrl-C hit compiled code, as what it is.

    Numba returns from such a kernel with the exception set, and Python makes a SystemError of that,
    once for each call it came through.
    """
    try:
        yield
    except SystemError as error:
        cause: BaseException | None = error
        while isinstance(cause, SystemError):
            cause = cause.__cause__
        if isinstance(cause, KeyboardInterrupt):
            raise KeyboardInterrupt from None
        raise


def _ask(number: int, frame: FrameType | None) -> None:
    if _ASKED.is_set():
        signal.default_int_handler(number, frame)
    _ASKED.set()
