"""Fixtures every test may use."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

# Read when NumPy and Numba are first imported, which is after this file. The tests' matrices are
# small, and `make test` has a worker a core: threads of a matrix product would wait for each other
# by spinning, which took ten times the processor time of the work. Passive ones sleep.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

TESTS = Path(__file__).resolve().parent
SHARED_DATA = TESTS.parent.parent / "shared" / "data"
# Where workers begin: with the files that compile most, each other kernels, so that no kernel is
# compiled by two workers at once; and with what takes long, so that none waits for another's last.
FIRST = (
    "placement/fewest",
    "placement/test_instance_constraints.py",
    "placement/objectives/test_navigation.py",
    "placement/solvers/test_contract.py",
    "placement/branch",
    "placement/test_cli.py",
    "placement/bounds",
    "benchmarks/test_library.py",
    "placement/referee/test_tolerance.py",
    "placement/tempered",
    "placement/test_cluster.py",
    "placement/solvers",
    "reports",
    "placement",
    "benchmarks",
)
# Files of a folder that need the same kernels: one worker compiles them, not both at once.
TOGETHER = ("placement/fewest/", "placement/branch/", "placement/bounds/")


def pytest_configure(config: pytest.Config) -> None:
    """Let files keep our order where xdist would begin with those of most tests."""
    config.option.loadscopereorder = False


def pytest_collection_finish() -> None:
    """Collect garbage seldom, and never look through thousands of tests and a compiler for it.

    Compiling makes objects by the million, and keeps them: looking for garbage among them took a
    twelfth of the time.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Hand out tests by files, as `--dist loadfile` does, but by folders where `TOGETHER` says."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class ByFile(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            scope: str = super()._split_scope(nodeid)
            return next((folder for folder in TOGETHER if folder in scope), scope)

    return ByFile(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put what `FIRST` names first."""
    assert all((TESTS / name).exists() for name in (*FIRST, *TOGETHER))

    def rank(item: pytest.Item) -> int:
        path = item.path.relative_to(TESTS).as_posix()
        return next((n for n, name in enumerate(FIRST) if path.startswith(name)), len(FIRST))

    items.sort(key=rank)


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
