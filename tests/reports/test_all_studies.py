"""All studies in a row: what is finished stays, what is asked wrongly is refused, bytes repeat."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from reports import commands
from reports.all_studies import Given, run_all
from reports.commands import STUDIES, Study, report

CALLS: list[str] = []


def tiny(out: Path, *, seed: int, **_: Any) -> None:
    CALLS.append("tiny")
    (out / "rows.csv").write_text(f"seed\n{seed}\n")


def with_roads(out: Path, *, roads: tuple[Path, ...], **_: Any) -> None:
    CALLS.append(f"roads {len(roads)}")
    (out / "rows.csv").write_text(f"roads\n{len(roads)}\n")


STANDINS = {
    "one": Study("tests_standins:tiny", "a question"),
    "two": Study("tests_standins:with_roads", "another", "Without --road, none was driven"),
}


@pytest.fixture
def studies(monkeypatch: pytest.MonkeyPatch) -> dict[str, Study]:
    CALLS.clear()
    monkeypatch.setitem(sys.modules, "tests_standins", sys.modules[__name__])
    monkeypatch.setattr(commands, "STUDIES", STANDINS)
    return STANDINS


def silent(_text: str, _share: float | None) -> None:
    pass


def test_finished_studies_stay_and_others_are_run(
    studies: dict[str, Study], tmp_path: Path
) -> None:
    run_all(studies, tmp_path, Given(), silent)
    assert CALLS == ["tiny", "roads 0"]
    assert "Without --road, none was driven." in (tmp_path / "two" / "index.html").read_text()
    assert (tmp_path / "index.html").read_text().count("<li>") == 2
    run_all(studies, tmp_path, Given(), silent)
    assert CALLS == ["tiny", "roads 0"]
    (tmp_path / "one" / "study.json").unlink()
    road = tmp_path / "road.csv"
    road.write_text("0,0\n1,0\n")
    run_all(studies, tmp_path, Given(roads=(road,)), silent)
    assert CALLS == ["tiny", "roads 0", "tiny", "roads 1"]
    assert "Without --road" not in (tmp_path / "two" / "index.html").read_text()
    mark = json.loads((tmp_path / "two" / "study.json").read_text())
    road.write_text("0,0\n2,0\n")  # the same name, another road
    run_all(studies, tmp_path, Given(roads=(road,)), silent)
    assert CALLS[4:] == ["roads 1"]
    assert json.loads((tmp_path / "two" / "study.json").read_text()) != mark
    run_all(studies, tmp_path, Given(seed=1, roads=(road,)), silent)
    assert CALLS[5:] == ["tiny", "roads 1"]


def test_what_others_left_in_the_folder_is_on_no_page_and_named(
    studies: dict[str, Study], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report("one", tmp_path, quiet=True)
    assert capsys.readouterr().err == ""
    (tmp_path / "customers.csv").write_text("name;town\nno table, of three\n")
    (tmp_path / "logo.svg").write_text("<svg/>")
    report("one", tmp_path, seed=7, quiet=True)
    said = capsys.readouterr().err
    assert said.startswith("placement: not of the study, so not on its page: ")
    assert said.endswith(f"{tmp_path / 'customers.csv'}, {tmp_path / 'logo.svg'}\n")
    page = (tmp_path / "index.html").read_text()
    assert "customers" not in page
    assert "logo" not in page
    assert ">7<" in page  # its own table is


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (lambda out: report("none", out), "study must be one of"),
        (lambda out: report("error-model", out, road=[out / "x.csv"]), "--road is for camera-sets"),
        (lambda out: report("camera-sets", out, road=[out / "x.csv"]), "x.csv .No such file"),
    ],
)
def test_what_cannot_be_is_refused(
    asked: Callable[[Path], None], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message):
        asked(tmp_path)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"a.csv": "0,0\n10,nan\n"}, r"a\.csv: line 2: y_m must be finite, got nan"),
        ({"a.csv": "0,0\n10,0\n", "A.old.csv": "0,0\n9,0\n"}, r"names differ .* got .*A\.old\.csv"),
        ({"hairpin.csv": "0,0\n10,0\n"}, r"hairpin\.csv beside a road of the study"),
    ],
)
def test_a_bad_road_is_refused_before_any_study_begins(
    files: dict[str, str], message: str, tmp_path: Path
) -> None:
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=message):
        report("all", tmp_path / "out", road=[tmp_path / name for name in files])
    assert not (tmp_path / "out").exists()


def placement(out: Path, workers: int) -> subprocess.Popen[bytes]:
    command = "from placement.cli import main; main()"
    options = ["--quick", "--seed", "3", "--workers", str(workers), "--quiet"]
    return subprocess.Popen(  # noqa: S603 (our own words)
        [sys.executable, "-c", command, "report", "all", "--out", str(out), *options],
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def wait_for(path: Path) -> None:
    for _ in range(9000):
        if path.exists():
            return
        time.sleep(0.1)
    raise AssertionError(f"{path} did not appear")


@pytest.mark.slow
def test_interrupted_killed_spread_or_not_the_tables_are_the_same_bytes(tmp_path: Path) -> None:
    straight, broken = tmp_path / "straight", tmp_path / "broken"
    whole = placement(straight, 1)
    for signalled, seen in ((signal.SIGINT, "error-model"), (signal.SIGKILL, "single-camera")):
        run = placement(broken, 2)
        wait_for(broken / seen / "study.json")
        time.sleep(1.0)
        os.kill(run.pid, signalled)
        _, errors = run.communicate(timeout=300)
        if signalled is signal.SIGINT:
            assert b"interrupted; the same command goes on from here" in errors
            assert run.returncode == 3
    last = placement(broken, 2)
    for process in (last, whole):
        process.communicate(timeout=1800)
        assert process.returncode == 0
    names = sorted(path.relative_to(straight) for path in straight.rglob("*.csv"))
    assert len(names) > len(STUDIES)
    assert names == sorted(path.relative_to(broken) for path in broken.rglob("*.csv"))
    for name in names:
        assert (straight / name).read_bytes() == (broken / name).read_bytes(), name
    assert not list(broken.glob("*/parts"))
