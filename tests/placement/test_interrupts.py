"""Ctrl-C during any method: the best placement so far and its bound, written whole."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.synthetic_drives import random_drive
from placement.budget_curve import budget_curve
from placement.constraints import count_only
from placement.information_problem import InformationProblem
from placement.interrupts import asked_to_stop, held_back, interrupts_by_name, stop_on_request
from placement.objectives.entropy import Entropy
from placement.objectives.log_det import LogDet
from placement.objectives.tolerance import Tolerance
from placement.objectives.trace import Trace
from placement.problem import Problem, Run
from placement.solution import Proposal, Status
from placement.solve import METHODS, solve
from placement.verify import verify_folder

OBJECTIVES = {"diagram": "trace", "tempered": "entropy", "tolerance": "tolerance"}

pytestmark = pytest.mark.usefixtures("ctrl_c_is_heard")


def problem_for(method: str, new_problem: Callable[..., Problem]) -> Problem:
    """Return a problem that the method takes, big enough for some progress."""
    rng = np.random.default_rng(3)
    if method == "branch":
        return Problem(LogDet(np.eye(8), rng.normal(size=(60, 8, 1))), count_only(60, 9))
    kind = OBJECTIVES.get(method, "localisation")
    if kind == "localisation":
        return new_problem(rng, n_candidates=60, n_samples=80, budget=6)
    drive = random_drive(rng, n_samples=60, n_candidates=40)
    if kind == "tolerance":
        return Problem(Tolerance([drive], 0.4), count_only(40, 40), np.arange(40.0), 60.0)
    objective = Entropy([drive]) if kind == "entropy" else Trace([drive])
    return Problem(objective, count_only(40, 5), np.arange(40.0), 60.0)


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("method", METHODS)
def test_any_method_returns_a_placement_with_its_bound_once_asked_to_stop(
    method: str, new_problem: Callable[..., Problem]
) -> None:
    problem = problem_for(method, new_problem)
    if method == "tolerance":  # compiling takes longer than what it is granted for a placement
        solve(problem, method, time_limit_s=60.0)
    asked = []

    def once(_text: str, _share: float | None) -> None:
        if not asked:
            asked.append(True)
            interrupt()

    found = solve(problem, method, progress=once)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert not asked_to_stop()
    assert not problem.constraints.violations(found.selected)
    assert found.status in (Status.TIME_LIMIT, Status.OPTIMAL, Status.FEASIBLE), found.stats
    if asked:
        assert found.stats["stopped_by"] == "interrupt"
    else:
        assert method in ("random", "uniform"), "no progress was told"
    if METHODS[method].proves_bound and problem.objective.submodular:
        assert found.bound is not None
        assert found.bound >= found.value


def test_a_second_interrupt_does_not_wait_for_the_method(
    monkeypatch: pytest.MonkeyPatch, new_problem: Callable[..., Problem]
) -> None:
    def deaf(_problem: Problem, run: Run) -> Proposal:
        run.incumbent, run.score_bound = [2], 1e6
        interrupt()
        assert run.out_of_time()
        assert run.remaining() == 0.0
        interrupt()
        raise AssertionError("it waited")

    method = replace(METHODS["greedy"])
    monkeypatch.setattr(type(method), "load", lambda _self: deaf)
    found = solve(new_problem(np.random.default_rng(0)), "greedy")
    assert found.selected == (2,)
    assert found.bound == pytest.approx(1e6)
    assert found.stats["stopped_by"] == "interrupt"


def test_an_interrupt_ends_a_whole_budget_curve(new_problem: Callable[..., Problem]) -> None:
    problem = new_problem(np.random.default_rng(0), n_candidates=40, n_samples=60)
    seen: list[str] = []

    def tell(text: str, _share: float | None) -> None:
        seen.append(text)

    original = Run.out_of_time
    calls = []

    def out_of_time(run: Run) -> bool:
        calls.append(1)
        if len(calls) == 3:
            interrupt()
        return original(run)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Run, "out_of_time", out_of_time)
        curve = budget_curve(problem, 1, 12, "exchange", progress=tell)
    assert len(curve.solutions) == 12
    # the greatest budget is solved first, and is the one that was interrupted
    assert curve.solutions[-1].stats["stopped_by"] == "interrupt"
    assert {s.status for s in curve.solutions[:-1]} <= {Status.TIME_LIMIT, Status.OPTIMAL}


ROAD = """
[road]
pieces = [{length = 300}, {length = 150, curvature = 0.01}, {length = 400}]
[camera]
yaw_deg = [0, 60, 120, 180, 240, 300]
pitch_deg = [20, 35, 50]
[mounts]
spacing_m = 4.0
[objective]
kind = "KIND"
[budget]
cameras = 25
"""


def written_problem(folder: Path, method: str) -> Path:
    """Write a problem that the method takes and that nobody solves at once."""
    if method == "branch":
        rng = np.random.default_rng(3)
        path = folder / "design.npz"
        InformationProblem(np.eye(12), rng.normal(size=(150, 12, 1)), 20.0).write(path)
        return path
    path = folder / "road.toml"
    path.write_text(ROAD.replace("KIND", OBJECTIVES.get(method, "localisation")))
    return path


def interrupted_solve(folder: Path, method: str) -> dict[str, Any]:
    """Start `placement solve`, interrupt it once the solver speaks, return what it wrote."""
    instance = written_problem(folder, method)
    out = folder / "out"
    words = ["solve", str(instance), "--out", str(out), "--method", method]
    slow_watch = "import placement.watch as w; w.PLAIN_EVERY_S = 0.0; import placement.cli as c; "
    code = slow_watch + f"import sys; sys.argv[1:] = {words!r}; c.main()"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen(  # noqa: S603
        [sys.executable, "-c", code],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env=environment,
    )
    assert process.stderr is not None
    lines = []
    for line in process.stderr:
        lines.append(line)
        if "writing" in line or ("computing" not in line and "s]" in line):
            break
    time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, rest = process.communicate(timeout=600)
    assert process.returncode == 0, (lines, rest)
    assert not [p for p in out.iterdir() if p.name.startswith(".")]
    record: dict[str, Any] = json.loads((out / "solution.json").read_text())
    return record


@pytest.mark.slow
@pytest.mark.parametrize(
    "method",
    # the others are done before anybody could interrupt
    [m for m in METHODS if m not in ("random", "uniform", "cascade")],
)
def test_an_interrupted_command_writes_its_solution_whole(tmp_path: Path, method: str) -> None:
    record = interrupted_solve(tmp_path, method)
    if record["stats"].get("stopped_by") == "interrupt":
        assert record["status"] in ("time_limit", "optimal")  # which a bound may have shown by then
    else:  # done before the signal came
        assert record["status"] in ("optimal", "feasible")
    assert record["selected"]
    if METHODS[method].proves_bound and method != "diagram":
        side = "lower_bound" if method == "tolerance" else "upper_bound"
        sign = -1.0 if method == "tolerance" else 1.0
        assert sign * (record[side] - record["value"]) >= -1e-9 * abs(record["value"])
    # whole: the referee finds every file, recomputes the value, and keeps to every constraint
    assert not [check for check in verify_folder(tmp_path / "out").checks if not check.passed]


def test_an_interrupt_that_hit_compiled_code_is_one() -> None:
    inner = SystemError("an inner call returned a result with an exception set")
    inner.__cause__ = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt), interrupts_by_name():
        raise SystemError("a kernel returned a result with an exception set") from inner
    with pytest.raises(SystemError, match="another"), interrupts_by_name():
        raise SystemError("another")


def test_ctrl_c_waits_until_what_must_not_stop_is_over() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), held_back():
        interrupt()
        time.sleep(0.01)
        done.append("all of it")
    assert done
    with stop_on_request():
        with held_back():
            interrupt()
            assert not asked_to_stop()
        assert asked_to_stop()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_solution_found_before_ctrl_c_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C while the prediction is made: an hour's placement was lost."""
    import placement.prediction
    from placement.commands import solve_into

    path = tmp_path / "small.toml"
    path.write_text(
        '[road]\npieces = [{length=60}]\n[objective]\nkind = "localisation"\n'
        "[camera]\nyaw_deg = [0, 180]\npitch_deg = [35]\n[budget]\ncameras = 2\n"
    )
    predict = placement.prediction.predict

    def predicted(*arguments: Any) -> Any:
        interrupt()
        return predict(*arguments)

    monkeypatch.setattr("placement.prediction.predict", predicted)
    monkeypatch.setattr("placement.commands.entry_points", lambda **_group: [])
    solve_into(tmp_path / "out", str(path), method="greedy", quiet=True)
    record = json.loads((tmp_path / "out" / "solution.json").read_text())
    assert len(record["selected"]) == 2


@pytest.mark.parametrize("module", ["typer", "reports.commands", "pydantic", "placement.assemble"])
def test_ctrl_c_in_the_first_moments_is_one_line(tmp_path: Path, module: str) -> None:
    """Ctrl-C while `module` is imported: it was a traceback, silence, or not heard at all."""
    code = (
        "import os, signal, sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == {module!r}:\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Finder())\n"
        "from placement.__main__ import main\n"
        f"sys.argv = ['placement', 'solve', 'winding', '--out', {str(tmp_path / 'out')!r}]\n"
        "main()\n"
    )
    found = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert found.returncode == 3
    assert found.stderr.splitlines() == ["placement: interrupted; nothing was written"]
    assert not (tmp_path / "out").exists()
