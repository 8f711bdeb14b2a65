"""Fixtures every test may use."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

# Read when NumPy and Numba are first imported, which is after this file. The tests' matrices are
# small, and `make test` has a worker a core: threads of a matrix product would wait for each other
# by spinning, which took ten times the processor time of the work. Passive ones sleep.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

SHARED_DATA = Path(__file__).resolve().parent.parent.parent / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """Give the path of a file of the shared data set, or skip where it is not laid out."""

    def find(name: str) -> Path:
        path = SHARED_DATA / name
        if not path.exists():
            pytest.skip(f"needs {name} of the shared data set, which is not beside the project")
        return path

    return find


@pytest.fixture
def ctrl_c_is_heard() -> Iterator[None]:
    """Hear SIGINT even where whoever started the tests ignores it, as a shell does behind `&`."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
