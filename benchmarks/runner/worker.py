"""One job in one process: build, warm up, solve, let the referee judge, write what happened.

`python -m benchmarks.runner.worker JOB.json RESULT.json`. Nothing a solver does can harm the run:
if this process dies, that is the row.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import resource
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.rivals.registry import RIVALS, Answer, CannotSayError, Limits
from benchmarks.runner.subjects import (
    Case,
    MissingDataError,
    Subject,
    load_subject,
    tiny_subject,
)
from placement.solution import OPTIMAL_GAP
from placement.solve import METHODS, solve

# A value and the referee's may differ by the float32 of the stored information and by the
# referee's derivatives, which are differences.
VALUE_TOLERANCE = 1e-6
# A rival's bound this far (relative) below its own value is wrong; nearer, it is its tolerance.
BOUND_TOLERANCE = 1e-6
NOTE_LENGTH = 300


def main() -> None:
    """Read a job, do it, and leave the result whole or not at all."""
    job_file, result_file = map(Path, sys.argv[1:3])
    _die_with(os.getppid())
    job = json.loads(job_file.read_text(encoding="utf-8"))
    with Path(os.devnull).open("w") as nowhere, contextlib.redirect_stdout(nowhere):
        result = perform(job)
    staged = result_file.with_suffix(".part")
    staged.write_text(json.dumps(result, allow_nan=False), encoding="utf-8")
    staged.replace(result_file)


def perform(job: Mapping[str, Any]) -> dict[str, Any]:
    """Do the job and return its row: never an exception, for a failure is a result, too."""
    case = Case(**job["case"])
    solver, limits = job["solver"], Limits(job["time_limit_s"], job["seed"])
    row: dict[str, Any] = {}
    try:
        started = time.monotonic()
        subject = load_subject(case)
        row |= _describe(subject) | {"build_s": time.monotonic() - started}
        if solver in RIVALS:
            lacking = RIVALS[solver].missing()
            if lacking is not None:
                return row | _said("not_installed", f"{lacking} is not installed")
        _warm_up(case, solver)
        answer, claimed, seconds, cpu = _timed(subject, solver, limits)
    except CannotSayError as error:
        return row | _said("cannot_say", str(error))
    except MissingDataError as error:
        return row | _said("no_data", str(error))
    except (Exception, SystemExit) as error:  # whatever a rival throws is its row
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(where.filename).name}:{where.lineno}"
        return row | _said("failed", f"{type(error).__name__} at {place}: {error}")
    row |= {"seconds": seconds, "cpu_seconds": cpu, "peak_memory_mb": peak_memory_mb()}
    return row | _judged(subject, answer, claimed)


def peak_memory_mb() -> float:
    """Return the most memory that this process has held, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _timed(
    subject: Subject, solver: str, limits: Limits
) -> tuple[Answer, str | None, float, float]:
    """Run a solver; return its answer, the status it claims, wall and processor seconds."""
    rival = RIVALS[solver].load() if solver in RIVALS else None
    started, cpu = time.monotonic(), time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if rival is not None:
            answer, claimed = rival(subject, limits), None
        else:
            answer, claimed = _ours(subject, solver, limits)
    return answer, claimed, time.monotonic() - started, time.process_time() - cpu


def _ours(subject: Subject, solver: str, limits: Limits) -> tuple[Answer, str]:
    if solver not in METHODS:
        raise ValueError(f"solver must be a method or a rival, got {solver!r}")
    try:
        solution = solve(
            subject.problem, solver, time_limit_s=limits.time_limit_s, seed=limits.seed
        )
    except ValueError as error:  # a method says by this what it cannot keep or does not take
        raise CannotSayError(str(error)) from None
    if not solution.status.has_placement:
        reason = solution.stats.get("error") or solution.stats.get("reason") or ""
        raise RuntimeError(f"{solution.status}: {reason}")
    evaluations, nodes = solution.stats.get("gains_computed"), solution.stats.get("nodes")
    note = str(solution.stats.get("chosen", ""))
    answer = Answer(list(solution.selected), solution.bound, evaluations, nodes, note)
    return answer, str(solution.status)


def _warm_up(case: Case, solver: str) -> None:
    """Load and compile what the solver needs on a tiny problem; what goes wrong comes again."""
    with contextlib.suppress(Exception, SystemExit), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        _timed(tiny_subject(case), solver, Limits(10.0, 0))


def _judged(subject: Subject, answer: Answer, claimed: str | None) -> dict[str, Any]:
    """Recompute the value twice, by the objective and by the referee, and hold the claims to it."""
    import numpy as np

    selected = sorted(int(i) for i in answer.selected)
    row = {
        "selected": selected,
        "evaluations": answer.evaluations,
        "nodes": answer.nodes,
        "note": answer.note[:NOTE_LENGTH],
    }
    verdict = subject.referee(selected)
    if verdict.faults:
        return row | {
            "status": "broken_rules",
            "verified": False,
            "note": "; ".join(verdict.faults)[:NOTE_LENGTH],
        }
    objective = subject.problem.objective
    value = objective.value(np.array(selected, dtype=np.int64))
    slack = VALUE_TOLERANCE * max(abs(value), abs(verdict.value), 1e-9)
    verified = abs(verdict.value - value) <= slack
    bound, gap, status = answer.bound, None, claimed or "feasible"
    if bound is not None and math.isfinite(bound):
        sign = 1.0 if objective.maximise else -1.0
        short = sign * (value - bound)
        if short > BOUND_TOLERANCE * max(abs(value), 1e-9):
            status = "wrong_bound"
            row["note"] = f"its bound {bound!r} is beaten by its own value"
        gap = max(0.0, -short) / abs(value) if value else None
        if claimed is None and status == "feasible" and gap is not None and gap <= OPTIMAL_GAP:
            status = "optimal"
    else:
        bound = None
    if not verified:
        row["note"] = f"the referee finds {verdict.value!r}"
    return row | {
        "status": status,
        "value": value,
        "referee_value": verdict.value,
        "bound": bound,
        "gap": gap,
        "verified": bool(verified),
    }


def _describe(subject: Subject) -> dict[str, Any]:
    objective, constraints = subject.problem.objective, subject.problem.constraints
    return {
        "objective": objective.name,
        "sense": "max" if objective.maximise else "min",
        "candidates": constraints.n,
        "budget": constraints.budget,
        "sha256": subject.sha256,
    }


def _said(status: str, note: str) -> dict[str, Any]:
    line = " ".join(note.split())
    return {"status": status, "note": line[:NOTE_LENGTH], "peak_memory_mb": peak_memory_mb()}


def _die_with(parent: int) -> None:
    """End this process soon after its parent, so that a killed run leaves nobody behind."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


if __name__ == "__main__":
    main()
