"""Run the jobs of a suite, each in a process of its own, and remember them.

Jobs go A B A B: all solvers on one instance and seed, then the next, and the whole round again for
each repeat, so that whatever slows the machine meets everybody. Interrupted or killed, the same
command goes on where it stopped. One after another, unless workers or a cluster are asked for.
"""

from __future__ import annotations

import json
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.runner.journal import Journal
from benchmarks.runner.subjects import Case
from benchmarks.runner.suites import Suite
from placement.cluster import Work
from placement.output import versions
from placement.watch import Report

PACKAGES = (
    "roadside-placement",
    "numpy",
    "scipy",
    "numba",
    "highspy",
    "cvxpy-base",
    "clarabel",
    "scs",
    "pyscipopt",
    "apricot-select",
    "submodlib-py",
    "chama",
    "python-sensors",
)
# One thread each: the ratio between two methods must not depend on how many cores were free.
THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "RAYON_NUM_THREADS",
)


@dataclass(frozen=True, slots=True)
class Job:
    """One solver on one instance with one seed, once."""

    case: Case
    solver: str
    seed: int
    repeat: int

    @property
    def key(self) -> str:
        """What the journal knows the job by."""
        return f"{self.case.name} {self.solver} {self.seed} {self.repeat}"


def jobs_of(suite: Suite) -> Iterator[Job]:
    """List the jobs of a suite in the order A B A B."""
    for repeat in range(suite.repeats):
        for case in suite.cases:
            for seed in suite.seeds:
                for solver in suite.solvers_of(case):
                    yield Job(case, solver, seed, repeat)


@dataclass(frozen=True, slots=True)
class JobTask:
    """One job with what a worker must know of its suite."""

    job: Job
    time_limit_s: float
    hard_limit_s: float


def run_suite(
    suite: Suite, out: Path, report: Report, work: Work | None = None
) -> list[dict[str, Any]]:
    """Do every job of `suite` that the journal in `out` lacks; return all rows in order.

    `work` says where, if not here one after the other; rows are remembered as they come. Seconds
    are those of the machine that did the job, beside whatever else it did.

    Raises:
        ValueError: if the journal is another run's, or in use.
    """
    journal = Journal(out / "journal.jsonl", suite.heading())
    try:
        jobs = list(jobs_of(suite))
        left = [job for job in jobs if job.key not in journal.rows]
        tasks = [JobTask(job, suite.time_limit_s, suite.hard_limit_s) for job in left]
        for at, task in enumerate(tasks if work is None else ()):
            done = len(jobs) - len(left) + at
            report(f"{task.job.key} ({done + 1} of {len(jobs)})", done / len(jobs))
            journal.add(job_row(task))
        if work is not None:
            for _, row in work.run(job_row, tasks, "benchmark"):
                journal.add(row)
                done = len(journal.rows)
                report(f"{row['job']} ({done} of {len(jobs)})", done / len(jobs))
        return [journal.rows[job.key] for job in jobs]
    finally:
        journal.close()


def job_row(task: JobTask) -> dict[str, Any]:
    """Do a job and say of what, with what and where it was."""
    job = task.job
    found = run_job(job, task.time_limit_s, task.hard_limit_s)
    return {
        "job": job.key,
        "instance": job.case.name,
        "kind": job.case.kind,
        "solver": job.solver,
        "seed": job.seed,
        "repeat": job.repeat,
        "time_limit_s": task.time_limit_s,
        "versions": {"python": platform.python_version(), **versions(PACKAGES)},
        "machine": machine(),
        **found,
    }


def run_job(job: Job, time_limit_s: float, hard_limit_s: float) -> dict[str, Any]:
    """Do one job in a process of its own; end it at `hard_limit_s`; its death is a result."""
    with tempfile.TemporaryDirectory(prefix="placement-job-") as folder:
        request, answer = Path(folder, "job.json"), Path(folder, "result.json")
        words = {
            "case": job.case.record(),
            "solver": job.solver,
            "seed": job.seed,
            "time_limit_s": time_limit_s,
        }
        request.write_text(json.dumps(words), encoding="utf-8")
        log = Path(folder, "stderr.txt")
        with log.open("wb") as stderr:
            process = subprocess.Popen(  # noqa: S603 - our own module, by our own interpreter
                [sys.executable, "-m", "benchmarks.runner.worker", str(request), str(answer)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=stderr,
                env=os.environ | dict.fromkeys(THREADS, "1"),
                start_new_session=True,
            )
        try:
            code, memory_mb = _wait(process, time.monotonic() + hard_limit_s)
        except BaseException:
            _end(process)
            raise
        if answer.is_file():
            result: dict[str, Any] = json.loads(answer.read_text(encoding="utf-8"))
            return result
        if code is None:
            note = f"ended at the hard limit of {hard_limit_s:g} s"
            return {"status": "killed", "note": note, "peak_memory_mb": memory_mb}
        said = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        note = f"{how}: {said[-1] if said else 'no last words'}"[:300]
        return {"status": "crashed", "note": note, "peak_memory_mb": memory_mb}


def _wait(process: subprocess.Popen[bytes], deadline: float) -> tuple[int | None, float]:
    """Wait for a process, until the deadline; return its exit code (None: ended) and memory."""
    pause = 0.002
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return process.returncode, usage.ru_maxrss / 1024.0
        if time.monotonic() >= deadline:
            os.killpg(process.pid, signal.SIGKILL)
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            return None, usage.ru_maxrss / 1024.0
        time.sleep(pause)
        pause = min(0.05, 1.5 * pause)


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def machine() -> dict[str, str]:
    """Say what kind of machine this is: no names."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        lines = cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines()
        names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
        model = names[0] if names else model
    return {
        "processor": model,
        "cores": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}",
    }
