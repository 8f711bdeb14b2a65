"""A sweep's jobs on several workers: the same placements, and a worker that dies is survived."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import typer
from typer.testing import CliRunner

from benchmarks.runner.commands import register
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


# What a row of `results.csv` says of the machine rather than of the job.
MEASURED = ["seconds", "seconds_median", "cpu_seconds", "peak_memory_mb", "build_s"]
SWEEP = ["benchmark", "smoke", "--instance", "arc-50", "--quiet", "--time-limit", "20"]


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[str]:
    """Start a Dask scheduler and two workers by their own commands; give the address."""
    pytest.importorskip("distributed")
    started: list[subprocess.Popen[bytes]] = []
    found = tmp_path / "scheduler.json"

    def start(kind: str, *words: str) -> None:
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", "--no-dashboard", *words]
        quiet = subprocess.DEVNULL
        started.append(subprocess.Popen(command, stdout=quiet, stderr=quiet))  # noqa: S603

    try:
        start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(found))
        deadline = time.monotonic() + 120.0
        while not found.exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        for _ in range(2):
            start("worker", "--scheduler-file", str(found), "--nthreads", "1", "--no-nanny")
        yield str(json.loads(found.read_text())["address"])
    finally:
        for process in reversed(started):
            process.terminate()
        for process in started:
            process.wait(timeout=60)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore:.*:pytest.PytestUnraisableExceptionWarning")
def test_a_cluster_and_two_workers_give_the_table_of_one_after_another(
    scheduler: str, tmp_path: Path
) -> None:
    """By the command line, on a scheduler as an operator would start it."""
    app = typer.Typer()
    app.callback()(lambda: None)
    register(app)
    tables = []
    for name, words in {
        "here": [],
        "cluster": ["--cluster", scheduler],
        "workers": ["--workers", "2"],
    }.items():
        done = CliRunner().invoke(app, [*SWEEP, "--out", str(tmp_path / name), *words])
        assert done.exit_code == 0, done.output
        table = pd.read_csv(tmp_path / name / "results.csv")
        tables.append(table.drop(columns=MEASURED))
    here, *others = tables
    assert len(here) > 2
    assert here["verified"].eq("yes").all()
    for other in others:
        pd.testing.assert_frame_equal(here, other)
