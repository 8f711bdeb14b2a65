"""A study in parts: the same results kept, resumed or spread; Ctrl-C and a killed parent end it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from placement.cluster import Processes
from reports.parts import Parts, folder_for, work_for

ROOT = Path(__file__).resolve().parents[2]


def counted(log: Path, n: int) -> dict[str, object]:
    with log.open("a", encoding="utf-8") as file:
        file.write(f"{n}\n")
    table = pd.DataFrame({"a": [n, 2], "b": [0.1 + 0.2, np.nan], "c": [True, False], "d": "κ"})
    return {"table": table, "value": np.float64(n) / 3.0, "row": np.arange(n), "nothing": None}


def test_what_is_kept_is_what_was_computed_and_is_not_computed_again(tmp_path: Path) -> None:
    log, folder = tmp_path / "log", tmp_path / "parts"
    arguments = {f"κ = {n} per m": (log, n) for n in range(3)}
    told: list[tuple[str, float]] = []
    fresh = Parts().compute(counted, arguments, lambda name, share: told.append((name, share)))
    assert told == [(name, (n + 1) / 3) for n, name in enumerate(arguments)]
    kept = Parts(folder=folder)
    kept.compute(counted, dict(list(arguments.items())[:2]), lambda *_: None)
    resumed = kept.compute(counted, arguments, lambda *_: None)
    assert log.read_text().split() == ["0", "1", "2", "0", "1", "2"]
    for a, b in zip(fresh, resumed, strict=True):
        pd.testing.assert_frame_equal(a.pop("table"), b["table"], check_exact=True)
        del b["table"]
        assert a == b
    table = resumed[2]
    assert table["value"] == 2 / 3
    assert table["row"] == [0, 1]


def test_a_part_that_was_cut_short_on_the_disk_is_computed_again(tmp_path: Path) -> None:
    log, folder = tmp_path / "log", tmp_path / "parts"
    parts = Parts(folder=folder)
    parts.compute(counted, {"one": (log, 1)}, lambda *_: None)
    [path] = folder.glob("*.json")
    path.write_text(path.read_text()[:-5])
    parts.compute(counted, {"one": (log, 1)}, lambda *_: None)
    assert log.read_text().split() == ["1", "1"]


def test_parts_of_another_run_are_thrown_away(tmp_path: Path) -> None:
    folder = folder_for(tmp_path / "parts", {"seed": 0})
    (folder / "one.json").write_text("1")
    assert folder_for(folder, {"seed": 0}) == folder
    assert (folder / "one.json").exists()
    folder_for(folder, {"seed": 1})
    assert not (folder / "one.json").exists()


def test_names_that_differ_in_any_letter_have_files_of_their_own(tmp_path: Path) -> None:
    names = ["a b", "a_b", "a/b", "ab", "κ", "a_20b"]
    log = tmp_path / "log"
    Parts(folder=tmp_path / "parts").compute(
        counted, {name: (log, n) for n, name in enumerate(names)}, lambda *_: None
    )
    assert len(list((tmp_path / "parts").glob("*.json"))) == len(names)


def test_one_worker_is_this_process() -> None:
    assert not isinstance(work_for(1), Processes)
    with pytest.raises(ValueError, match="--workers must be at least 1, got 0"):
        work_for(0)


# --- signals, in a process of their own -----------------------------------------------------

SCRIPT = """
import sys, time
from pathlib import Path
sys.path.insert(0, {tests!r})
from parts_for_signals import part
from reports.parts import Parts, work_for
if __name__ == "__main__":
    folder = Path({folder!r})
    arguments = {{str(n): (str(folder), n) for n in range({parts})}}
    Parts(work_for({workers}), folder / "parts").compute(part, arguments, lambda *_: None)
"""
# Part 0 ends at once; every other says that it began and swallows the first Ctrl-C, as solvers do.
PART = """
import os, time
from pathlib import Path

def part(folder, n):
    if n == 0:
        return n
    (Path(folder) / f"began-{n}-{os.getpid()}").touch()
    try:
        time.sleep(60.0)
    except KeyboardInterrupt:
        pass
    return n
"""


def start(folder: Path, workers: int) -> subprocess.Popen[bytes]:
    (folder / "parts_for_signals.py").write_text(PART)
    script = folder / "script.py"
    script.write_text(
        SCRIPT.format(tests=str(folder), folder=str(folder), parts=workers + 1, workers=workers)
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(folder)])}
    return subprocess.Popen(  # noqa: S603 (our own words)
        [sys.executable, str(script)], env=environment, stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip


def begun(folder: Path, count: int) -> list[int]:
    """Wait until `count` parts began, and return the processes they run in."""
    for _ in range(1200):
        found = [int(path.name.split("-")[2]) for path in folder.glob("began-*")]
        if len(found) >= count:
            return found
        time.sleep(0.1)
    raise AssertionError("the parts did not begin")


def alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0]
    return state != "Z"


def ended(processes: list[int]) -> bool:
    for _ in range(300):
        if not any(map(alive, processes)):
            return True
        time.sleep(0.1)
    return False


def test_ctrl_c_that_a_part_swallows_still_ends_the_study(tmp_path: Path) -> None:
    study = start(tmp_path, workers=1)
    begun(tmp_path, 1)
    study.send_signal(signal.SIGINT)
    _, errors = study.communicate(timeout=60)
    assert study.returncode != 0
    assert b"KeyboardInterrupt" in errors
    assert [path.name for path in (tmp_path / "parts").glob("*.json")] == ["0.json"]


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_no_worker_outlives_the_study(how: signal.Signals, tmp_path: Path) -> None:
    study = start(tmp_path, workers=2)
    workers = begun(tmp_path, 2)
    assert len(set(workers)) == 2
    os.kill(study.pid, how)
    study.communicate(timeout=60)
    assert ended(workers)
    assert [path.name for path in (tmp_path / "parts").glob("*.json")] == ["0.json"]
