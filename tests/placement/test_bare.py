"""Bare problems on the command line: the folder, the referee, and one line for what is wrong."""

from __future__ import annotations

import io
import json
import shutil
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from placement.cli import main
from placement.commands import solve_into
from placement.information_problem import InformationProblem

RNG = np.random.default_rng(0)
FACTORS = RNG.normal(size=(20, 3, 2))
DEAR = InformationProblem(
    1e-6 * np.eye(3), FACTORS, 1.0, RNG.uniform(0.1, 0.5, 20).round(2), np.arange(20) // 2
)
KEYS = {
    "objective", "method", "status", "value", "gap", "seconds", "selected", "cameras", "stats",
    "seed", "versions", "instance_sha256", "budget", "candidates",
}  # fmt: skip
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run the command line in this process: (exit code, stdout, stderr)."""

    def call(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["placement", *map(str, words)])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = capsys.readouterr()
        return int(stop.value.code or 0), out, err

    return call


@pytest.fixture(scope="module")
def solved_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Solve the problem with costs and groups; return the folder it lies in."""
    folder = tmp_path_factory.mktemp("solved")
    DEAR.write(folder / "dear.npz")
    solve_into(folder / "out", str(folder / "dear.npz"), quiet=True)
    return folder


@pytest.fixture
def solved(solved_once: Path, tmp_path: Path) -> Path:
    """Return a copy of the solved folder, the problem beside it."""
    shutil.copytree(solved_once, tmp_path, dirs_exist_ok=True)
    return tmp_path / "out"


@pytest.mark.parametrize(
    ("objective", "side"), [("log_det", "upper_bound"), ("trace_inverse", "lower_bound")]
)
def test_a_folder_keeps_the_contract_and_the_referee_agrees(
    run: Run, tmp_path: Path, objective: str, side: str
) -> None:
    DEAR.write(tmp_path / "dear.npz")
    out = tmp_path / "out"
    words = ("solve", tmp_path / "dear.npz", "--out", out, "--objective", objective)
    code, said, _ = run(*words)
    assert code == 0
    assert said.startswith("auto: optimal, ")
    record = json.loads((out / "solution.json").read_text())
    assert record.keys() >= KEYS | {side, "cost", "money"}
    assert record["status"] == "optimal"
    assert record["cameras"] == []
    assert record["instance"] == "dear"
    table = pd.read_csv(out / "placements.csv")
    assert list(table) == ["candidate", "cost", "group"]
    assert table["candidate"].tolist() == record["selected"]
    assert table["cost"].sum() <= 1.0 + 1e-9
    assert {p.name for p in out.iterdir()} == {"problem.npz", "solution.json", "placements.csv"}
    assert run("verify", out)[0] == 0
    assert json.loads((out / "verification.json").read_text())["passed"]


def test_a_table_of_experiments_needs_only_a_budget(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "experiments.csv"
    np.savetxt(path, FACTORS[:, :, 0], delimiter=",")
    assert run("solve", path, "--out", tmp_path / "out", "--budget", 5, "-q")[0] == 0
    assert len(json.loads((tmp_path / "out/solution.json").read_text())["selected"]) == 5
    assert run("verify", tmp_path / "out", "-q")[0] == 0
    code, _, err = run("solve", path, "--out", tmp_path / "out")
    assert code == 2
    assert "--budget must be given" in err


@pytest.mark.parametrize(
    ("change", "check"),
    [
        ({"value": 1.0}, "value"),
        ({"selected": [0, 1]}, "selected|rules|cost|value"),
        ({"upper_bound": 0.0}, "bound.holds"),
        ({"status": "feasible"}, "status"),
        ({"instance_sha256": "0"}, "instance_sha256"),
        ({"cost": 0.0}, "cost"),
        ({"selected": [0, True]}, "selected"),
        ({"selected": None}, "selected"),
        ({"budget": 3}, "budget"),
    ],
)
def test_the_referee_sees_what_somebody_changed(
    run: Run, solved: Path, change: dict[str, Any], check: str
) -> None:
    record = json.loads((solved / "solution.json").read_text())
    (solved / "solution.json").write_text(json.dumps(record | change))
    code, said, _ = run("verify", solved)
    assert code == 3
    assert said.startswith("NOT verified")
    found = json.loads((solved / "verification.json").read_text())["checks"]
    assert {c["name"] for c in found if not c["passed"]} & set(check.split("|"))


def test_a_road_solved_into_the_folder_takes_its_place(
    run: Run, solved: Path, tmp_path: Path
) -> None:
    road = tmp_path / "road.toml"
    road.write_text(
        "[road]\npieces = [{length=40}]\n[camera]\nyaw_deg = [0]\npitch_deg = [35]\n"
        '[errors]\nmodel = "radius"\n[objective]\nkind = "localisation"\n[budget]\ncameras = 1\n'
    )
    assert run("solve", road, "--out", solved, "--method", "greedy", "-q")[0] == 0
    assert not (solved / "problem.npz").exists()
    assert run("verify", solved, "-q")[0] == 0
    assert run("solve", tmp_path / "dear.npz", "--out", solved, "-q")[0] == 0
    assert not (solved / "instance.json").exists()
    assert not (solved / "map.png").exists()
    assert run("verify", solved, "-q")[0] == 0


def bomb(path: Path) -> None:
    header = io.BytesIO()
    shape = (1_250_000, 1000, 1)
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": shape}
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("factors.npy", header.getvalue() + bytes(1000))


def test_bad_files_are_one_line_and_exit_2(run: Run, tmp_path: Path) -> None:
    good: dict[str, Any] = {"prior": np.eye(3), "factors": FACTORS, "budget": 3}
    bad: list[tuple[dict[str, Any], str]] = [
        ({"prior": np.full((3, 3), np.nan)}, "prior[0, 0] must be finite"),
        ({"prior": np.diag([1.0, 1.0, -1.0])}, "prior must be positive definite"),
        ({"prior": np.eye(3) + np.eye(3, k=1)}, "prior must be symmetric"),
        ({"prior": np.eye(4)}, "factors must have shape (c, 4, r)"),
        ({"budget": 21}, "budget must be a whole number of 0…20, got 21"),
        ({"group": np.full(20, 20)}, "group[0] must lie in -1…19"),
        ({"cost": np.array([object()] * 20)}, "cost must hold real numbers, got object"),
    ]
    path = tmp_path / "bad.npz"
    for change, message in bad:
        np.savez(path, allow_pickle=True, **(good | change))
        code, _, err = run("solve", path, "--out", tmp_path / "out")
        assert code == 2
        assert len(err.strip().splitlines()) == 1
        assert message in err
    bomb(path)
    code, _, err = run("solve", path, "--out", tmp_path / "out")
    assert code == 2
    assert "at most 4,000,000,000 bytes" in err
    np.savez(path, **good)
    for words, message in (
        (("--budget", "1:3"), "--budget must be one number"),
        (("--budget", "99"), "budget must be a whole number of 0…20"),
        (("--objective", "trace"), "objective must be log_det or trace_inverse"),
        (("--method", "chain"), "chain"),
    ):
        code, _, err = run("solve", path, "--out", tmp_path / "out", *words)
        assert code == 2, words
        assert len(err.strip().splitlines()) == 1
        assert message in err
    assert not (tmp_path / "out" / "solution.json").exists()


def test_nobody_drives_along_a_bare_problem(run: Run, solved: Path) -> None:
    code, _, err = run("validate", solved)
    assert code == 2
    assert len(err.strip().splitlines()) == 1
