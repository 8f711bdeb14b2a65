"""A sweep's jobs on several workers: the same placements, and a worker that dies is survived."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks.runner.runner import JobTask, job_row, jobs_of, run_suite
from benchmarks.runner.suites import Suite
from placement.cluster import Processes
from tests.benchmarks.runner.test_runner import DESIGN

TOY = Suite("toy", "a toy", (DESIGN,), {"design": ("greedy", "exchange")}, (0,), 1, 10.0)


class Backwards:
    """Do the tasks here, the last one first."""

    def run(self, function: Any, tasks: Any, name: str) -> Iterator[tuple[int, Any]]:
        assert function is job_row
        assert name == "benchmark"
        for i in reversed(range(len(tasks))):
            yield i, row_of(tasks[i])

    def close(self) -> None:
        """Hold nothing."""


def row_of(task: JobTask) -> dict[str, Any]:
    return {"job": task.job.key, "value": task.time_limit_s}


def silent(_text: str, _fraction: float | None) -> None:
    pass


def test_rows_come_in_the_suites_order_whoever_is_done_first(tmp_path: Path) -> None:
    rows = run_suite(TOY, tmp_path, silent, Backwards())
    assert [row["job"] for row in rows] == [job.key for job in jobs_of(TOY)]
    nobody: Any = None
    assert run_suite(TOY, tmp_path, silent, nobody) == rows  # all of them are in the journal


@pytest.mark.slow
def test_a_worker_killed_in_a_sweep_changes_no_placement(tmp_path: Path) -> None:
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
    here = run_suite(TOY, tmp_path / "here", silent)
    place = Processes(2)

    def strike() -> None:
        while place._pool is None or not place._pool._processes:
            time.sleep(0.05)
        time.sleep(1.0)
        os.kill(next(iter(place._pool._processes)), signal.SIGKILL)

    striker = threading.Thread(target=strike)
    striker.start()
    try:
        there = run_suite(TOY, tmp_path / "there", silent, place)
    finally:
        striker.join()
        place.close()
    for one, other in zip(here, there, strict=True):
        for key in ("job", "value", "selected", "bound", "status", "verified"):
            assert one[key] == other[key]
