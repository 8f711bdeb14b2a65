"""Ctrl-C while a road is chosen: nothing before there are cameras, then the best so far."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from placement import construction
from placement.commands import solve_into, verify_in
from placement.construction import Judged, choose_road
from placement.instance import load_instance
from tests.placement.test_construction import TOML

pytestmark = pytest.mark.usefixtures("ctrl_c_is_heard")


@pytest.fixture
def site(tmp_path: Path) -> Path:
    path = tmp_path / "site.toml"
    path.write_text(TOML)
    return path


def interrupt_after_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    judge = construction.judge

    def judged(*given: Any, **options: Any) -> Judged:
        one = judge(*given, **options)
        os.kill(os.getpid(), signal.SIGINT)
        return one

    monkeypatch.setattr(construction, "judge", judged)


def test_roads_not_judged_yet_are_left_out(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = choose_road(load_instance(site), "greedy")
    assert not whole.interrupted
    assert whole.so_far() is None
    interrupt_after_the_first(monkeypatch)
    choice = choose_road(load_instance(site), "greedy")
    assert choice.interrupted
    assert len(choice.judged) == 1 < len(whole.judged)
    assert choice.judged[0].error_m2 == whole.judged[0].error_m2
    with pytest.raises(KeyboardInterrupt):  # it is ours no longer
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1.0)


def test_what_is_written_is_the_best_so_far(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupt_after_the_first(monkeypatch)
    out = tmp_path / "out"
    solution = solve_into(out, str(site), method="auto", quiet=True)
    assert solution.status == "time_limit"
    record = json.loads((out / "solution.json").read_text())
    assert record["stats"]["stopped_by"] == "interrupt"
    assert len(pd.read_csv(out / "pareto.csv")) == 1
    assert verify_in(out, quiet=True)


def test_ctrl_c_while_roads_are_sought_ends_at_once_and_writes_nothing(tmp_path: Path) -> None:
    blocks = [
        [[x, y], [x + 9, y + 1], [x + 8, y + 9], [x - 1, y + 8]]
        for x in range(20, 460, 20)
        for y in range(-220, 240, 20)
    ]
    source, out = tmp_path / "site.toml", tmp_path / "out"
    source.write_text(
        f"[road.construct]\nstart = [0, 0, 0]\ngoal = [480, 3, 0]\nobstacles = {blocks}\n"
        "min_radius_m = 4\nclearance_m = 0.5\n"
    )
    command = "from placement.cli import main; main()"
    process = subprocess.Popen(  # noqa: S603 (our own program)
        [sys.executable, "-c", command, "solve", str(source), "--out", str(out)],
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert process.stderr is not None
    line = process.stderr.readline()  # the first line of progress: it is at work
    time.sleep(1.0)
    assert process.poll() is None, line
    process.send_signal(signal.SIGINT)
    asked = time.monotonic()
    _, errors = process.communicate(timeout=120)
    assert time.monotonic() - asked < 60.0
    assert process.returncode == 3
    assert b"interrupted; nothing was written" in errors
    assert b"Traceback" not in errors
    assert not list(out.glob("*"))
