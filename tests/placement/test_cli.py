from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from placement.cli import main

PIECES = "[road]\npieces = [{length=60}]\n"
SMALL = (
    PIECES
    + '[camera]\nyaw_deg = [0, 180]\npitch_deg = [35]\n[errors]\nmodel = "radius"\n'
    + '[objective]\nkind = "localisation"\n[budget]\ncameras = 3\n'
)
SOLUTION_KEYS = {
    "objective", "method", "status", "value", "upper_bound", "gap", "seconds", "selected",
    "cameras", "stats", "seed", "versions", "instance_sha256",
}  # fmt: skip
CAMERA_KEYS = {
    "mount", "x_m", "y_m", "height_m", "yaw_deg", "pitch_deg", "hfov_deg", "vfov_deg", "projection",
}  # fmt: skip


class Outcome:
    """An exit code and what was printed."""

    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err


@pytest.fixture
def run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Outcome]:
    """Run the command line in this process."""

    def call(*words: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["placement", *map(str, words)])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = capsys.readouterr()
        return Outcome(int(stop.value.code or 0), out, err)

    return call


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    return path


def test_solve_writes_the_files_of_the_contract(
    run: Callable[..., Outcome], small: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert run("solve", small, "--out", out, "--method", "greedy").code == 0
    record = json.loads((out / "solution.json").read_text())
    assert record.keys() >= SOLUTION_KEYS
    assert record["selected"] == sorted(record["selected"])
    assert len(record["cameras"]) == len(record["selected"]) == 3
    assert record["cameras"][0].keys() == CAMERA_KEYS
    assert record["value"] <= record["upper_bound"]
    path = pd.read_csv(out / "along_path.csv")
    assert list(path) == [
        "s_m", "x_m", "y_m", "curvature", "position_sigma_m", "lateral_2sigma_m", "cameras_seeing",
    ]  # fmt: skip
    assert len(path) == 61
    assert (path["position_sigma_m"] > 0).all()
    placements = pd.read_csv(out / "placements.csv")
    assert set(placements) == CAMERA_KEYS
    assert (out / "map.png").read_bytes().startswith(b"\x89PNG")

    assert not [p for p in out.iterdir() if p.name.startswith(".")]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("method", ["auto", "exchange", "relaxation", "mip", "uniform", "random"])
def test_every_method_answers_the_command_line(
    run: Callable[..., Outcome], small: Path, tmp_path: Path, method: str
) -> None:
    outcome = run("solve", small, "--out", tmp_path / method, "--method", method, "--budget", 2)
    assert outcome.code == 0
    record = json.loads((tmp_path / method / "solution.json").read_text())
    assert len(record["selected"]) == 2


def test_validate_adds_its_files_and_solving_again_removes_them(
    run: Callable[..., Outcome], small: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    run("solve", small, "--out", out)
    assert run("validate", out, "--runs", 3).code == 0
    rows = pd.read_csv(out / "validation.csv")
    assert {"run", "seed", "filter", "nees_mean"} <= set(rows)
    summary = json.loads((out / "validation_summary.json").read_text())
    assert summary["runs"] == 3
    assert summary["filters"]["ekf"].keys() >= {
        "predicted_rms_m", "simulated_rms_m", "nees_mean", "nees_low_95", "nees_high_95",
        "nees_steps_in_band", "cross_track_rms_m", "lateral_within_tolerance",
    }  # fmt: skip
    assert not rows.isna().any().any()
    run("solve", small, "--out", out, "--budget", 1)
    assert not (out / "validation.csv").exists()


@pytest.mark.usefixtures("undrawn")
def test_validate_says_of_which_drive_it_speaks(
    run: Callable[..., Outcome], small: Path, tmp_path: Path
) -> None:
    two = '[objective]\ndrives = ["forward", "backward"]\n'
    small.write_text(SMALL.replace("[objective]\n", two))
    run("solve", small, "--out", tmp_path / "out", "--method", "greedy")
    outcome = run("validate", tmp_path / "out", "--runs", 2)
    assert outcome.code == 0
    first = outcome.out.splitlines()[0]
    assert first.startswith("2 closed-loop runs of each of 2 drives in ")
    assert first.endswith("; of the first, forward:")


BAD_INSTANCES = {
    "a piece of length 0": (SMALL.replace("length=60", "length=0"), "length"),
    "a budget of 0": (SMALL.replace("cameras = 3", "cameras = 0"), "budget.cameras"),
    "a budget of -1": (SMALL.replace("cameras = 3", "cameras = -1"), "budget.cameras"),
    "a budget of 1e9": (SMALL.replace("cameras = 3", "cameras = 1000000000"), "budget.cameras"),
    "pitch 0": (SMALL.replace("[35]", "[35, 0]"), "camera.pitch_deg[1]"),
    "pitch 135": (SMALL.replace("[35]", "[135]"), "camera.pitch_deg[0]"),
    "a flat pinhole": (
        SMALL.replace("pitch_deg", "fov_deg = [[180, 60]]\npitch_deg"),
        "camera.fov_deg[0]",
    ),
    "an unknown key": (SMALL.replace("pitch_deg", "pich_deg"), "camera.pich_deg"),
    "required and forbidden": (
        SMALL + "required = [1]\nforbidden = [1]\n",
        "candidate 1 is both required and forbidden",
    ),
    "NaN": (SMALL.replace("[35]", "[nan]"), "camera.pitch_deg[0]"),
    "a word for a number": (SMALL.replace("length=60", 'length="long"'), "length"),
    "not TOML": ("[road", "TOML"),
    "no road": ("[budget]\ncameras = 3\n", "road"),
    "a missing road file": ('[road]\nfile = "nowhere.csv"\n', "nowhere.csv"),
    "too many candidates": (
        SMALL.replace("[camera]", "[mounts]\nspacing_m = 1e-5\n[camera]"),
        "mounts.spacing_m",
    ),
    "too many samples": (
        SMALL.replace("length=60}]", "length=60}]\nsample_spacing_m = 1e-6"),
        "road.sample_spacing_m",
    ),
}


@pytest.mark.parametrize("name", BAD_INSTANCES)
def test_a_bad_instance_is_one_line_and_exit_2(
    run: Callable[..., Outcome], tmp_path: Path, name: str
) -> None:
    text, named = BAD_INSTANCES[name]
    (tmp_path / "bad.toml").write_text(text)
    outcome = run("solve", tmp_path / "bad.toml", "--out", tmp_path / "out")
    assert outcome.code == 2
    assert len(outcome.err.strip().splitlines()) == 1
    assert named in outcome.err
    assert "Traceback" not in outcome.err
    assert not (tmp_path / "out").exists()


BAD_ROADS = {
    "a NaN": ("0,0\n10,nan\n20,0\n30,0\n", "line 3"),
    "two equal points": ("0,0\n10,0\n10,0\n30,0\n", "line 4"),
    "one row": ("0,0\n", "row"),
    "text in a number": ("0,0\n10,abc\n20,0\n", "abc"),
}


@pytest.mark.parametrize("name", BAD_ROADS)
def test_a_bad_centre_line_is_one_line_and_exit_2(
    run: Callable[..., Outcome], tmp_path: Path, name: str
) -> None:
    rows, named = BAD_ROADS[name]
    (tmp_path / "road.csv").write_text("# x_m,y_m\n" + rows)
    (tmp_path / "bad.toml").write_text(SMALL.replace("pieces = [{length=60}]", 'file = "road.csv"'))
    outcome = run("solve", tmp_path / "bad.toml", "--out", tmp_path / "out")
    assert outcome.code == 2
    assert len(outcome.err.strip().splitlines()) == 1
    assert "road.csv" in outcome.err
    assert named in outcome.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["solve", "no-such-name", "--out", "OUT"], "no-such-name"),
        (["solve", "no/such/file.toml", "--out", "OUT"], "no/such/file.toml"),
        (["solve", "SMALL", "--out", "FILE/out"], "--out"),
        (["solve", "SMALL", "--out", "OUT", "--method", "magic"], "magic"),
        (["solve", "SMALL", "--out", "OUT", "--budget", "many"], "--budget"),
        (["solve", "SMALL", "--out", "OUT", "--time-limit", "-1"], "time_limit"),
        (["solve", "SMALL", "--out", "OUT", "--objective", "beauty"], "objective.kind"),
        (["solve", "SMALL", "--out", "OUT", "--time-limit", "soon"], "--time-limit"),
        (["solve", "SMALL", "--out"], "--out"),
        (["solve", "SMALL", "--out", ""], "--out"),
        (["sovle", "SMALL"], "sovle"),
        (["validate", "OUT"], "solution.json"),
    ],
)
def test_bad_words_are_one_line_and_exit_2(
    run: Callable[..., Outcome], small: Path, tmp_path: Path, words: list[str], named: str
) -> None:
    (tmp_path / "file").write_text("")
    places = {"SMALL": small, "OUT": tmp_path / "out", "FILE/out": tmp_path / "file" / "out"}
    outcome = run(*[places.get(word, word) for word in words])
    assert outcome.code == 2
    assert len(outcome.err.strip().splitlines()) == 1
    assert named in outcome.err
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("undrawn")
def test_files_of_strangers_are_left_where_they_are(
    run: Callable[..., Outcome], small: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "budget_curve.csv").write_text("mine")
    assert run("solve", small, "--out", out, "--method", "greedy").code == 0
    assert (out / "budget_curve.csv").read_text() == "mine"
    assert run("solve", small, "--out", out, "--method", "greedy").code == 0
    assert not (out / "budget_curve.csv").exists()


@pytest.mark.usefixtures("undrawn")
def test_a_damaged_solution_folder_is_refused(
    run: Callable[..., Outcome], small: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    run("solve", small, "--out", out)
    record = json.loads((out / "solution.json").read_text())
    for spoilt in (
        "{",
        json.dumps({**record, "instance_sha256": "0"}),
        json.dumps({**record, "selected": [0, 10**6]}),
        json.dumps({**record, "status": "infeasible"}),
        json.dumps({k: v for k, v in record.items() if k != "selected"}),
    ):
        (out / "solution.json").write_text(spoilt)
        outcome = run("validate", out)
        assert outcome.code == 2
        assert len(outcome.err.strip().splitlines()) == 1


def test_a_name_made_to_write_over_the_terminal_is_shown_as_what_it_is(
    run: Callable[..., Outcome], tmp_path: Path
) -> None:
    (tmp_path / "bad.toml").write_text('[road]\nfile = "\\u001b[2Jroad\\u0000.csv"\n')
    outcome = run("solve", tmp_path / "bad.toml", "--out", tmp_path / "out")
    assert outcome.code == 2
    assert r"\x1b[2Jroad\x00.csv" in outcome.err


@pytest.mark.usefixtures("undrawn")
def test_a_solve_that_ends_before_its_first_camera_fails_and_says_so(
    run: Callable[..., Outcome], small: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    outcome = run("solve", small, "--out", out, "--method", "greedy", "--time-limit", 0, "-q")
    assert outcome.code == 3
    assert outcome.err == (
        "placement: stopped before the first camera was placed; nothing is placed\n"
    )
    record = json.loads((out / "solution.json").read_text())
    assert (record["status"], record["selected"]) == ("time_limit", [])
    # one camera in no time is an answer
    outcome = run("solve", small, "--out", out, "--method", "search", "--time-limit", 0, "-q")
    assert (outcome.code, outcome.err) == (0, "")
    assert json.loads((out / "solution.json").read_text())["selected"]


def test_an_interrupt_leaves_no_half_file(small: Path, tmp_path: Path) -> None:
    """Interrupt at three moments: each time there is a whole solution or none at all."""
    small.write_text(SMALL.replace("length=60", "length=2000").replace("= 3", "= 60"))
    out = tmp_path / "out"
    for delay in (0.3, 1.0, 2.0):
        process = subprocess.Popen(  # noqa: S603 - our own program
            [sys.executable, "-c", "from placement.cli import main; main()", "solve", small,
             "--out", out, "--method", "mip"],
            stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, env=os.environ,
        )  # fmt: skip
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
        names = {p.name for p in out.iterdir()} if out.exists() else set()
        assert not [n for n in names if n.startswith(".")]
        if "solution.json" in names:
            assert json.loads((out / "solution.json").read_text())["selected"]


def test_help_is_quick_because_nothing_heavy_is_imported() -> None:
    heavy = ("numpy", "scipy", "numba", "cvxpy", "pandas", "matplotlib", "networkx", "pydantic")
    code = (
        "import sys\nsys.argv = ['placement', '--help']\nfrom placement.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"print([m for m in {heavy!r} if m in sys.modules])"
    )
    found = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert found.stdout.strip().endswith("[]")
