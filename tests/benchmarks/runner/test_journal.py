"""A journal loses no row and doubles none, wherever a crash cuts it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.runner.journal import Journal

HEADING = {"suite": "toy", "seeds": [0]}


def test_rows_come_back_in_order(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "j", HEADING)
    for k in range(5):
        journal.add({"job": str(k), "value": 0.1 * k})
    journal.close()
    again = Journal(tmp_path / "j", HEADING)
    assert list(again.rows) == ["0", "1", "2", "3", "4"]
    assert again.rows["3"]["value"] == 0.1 * 3
    again.close()


def test_a_journal_cut_at_any_byte_goes_on_without_loss_or_doubles(tmp_path: Path) -> None:
    path = tmp_path / "j"
    journal = Journal(path, HEADING)
    for k in range(3):
        journal.add({"job": str(k)})
    journal.close()
    whole = path.read_bytes()
    for cut in range(len(whole) + 1):
        path.write_bytes(whole[:cut])
        journal = Journal(path, HEADING)
        for k in range(3):
            if str(k) not in journal.rows:
                journal.add({"job": str(k)})
        journal.close()
        lines = [json.loads(line) for line in path.read_text().splitlines()]
        assert [line.get("job") for line in lines] == [None, "0", "1", "2"]


def test_another_runs_journal_is_refused_by_what_differs(tmp_path: Path) -> None:
    Journal(tmp_path / "j", HEADING).close()
    with pytest.raises(ValueError, match=r"belongs to a run with seeds = \[0\], got \[1\]"):
        Journal(tmp_path / "j", HEADING | {"seeds": [1]})


def test_two_runs_cannot_share_a_journal(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "j", HEADING)
    with pytest.raises(ValueError, match="in use by another run"):
        Journal(tmp_path / "j", HEADING)
    journal.close()


def test_damage_in_the_middle_is_said_not_mended(tmp_path: Path) -> None:
    path = tmp_path / "j"
    path.write_text('{"suite": "toy", "seeds": [0]}\nnonsense\n')
    with pytest.raises(ValueError, match="is damaged"):
        Journal(path, HEADING)


def test_a_writer_killed_at_random_moments_leaves_each_row_once(tmp_path: Path) -> None:
    path = tmp_path / "j"
    script = (
        "import sys; from pathlib import Path; from benchmarks.runner.journal import Journal\n"
        "j = Journal(Path(sys.argv[1]), {'suite': 'toy', 'seeds': [0]})\n"
        "for k in range(400):\n"
        "    if str(k) not in j.rows: j.add({'job': str(k), 'fill': 'x' * 3000})\n"
    )
    for attempt in range(60):
        process = subprocess.Popen([sys.executable, "-c", script, str(path)])  # noqa: S603
        if attempt < 8:
            time.sleep(0.15 + 0.013 * attempt)
            os.kill(process.pid, signal.SIGKILL)
        if process.wait() == 0:
            break
    journal = Journal(path, HEADING)
    assert list(journal.rows) == [str(k) for k in range(400)]
    journal.close()
    assert len(path.read_bytes().splitlines()) == 401
