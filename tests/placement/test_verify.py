from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from placement.cli import main
from placement.commands import solve_into, verify_in
from placement.output import read_folder
from placement.referee.claims import certificate_checks
from placement.verify import verify_folder

SMALL = """
[road]
pieces = [{length=60}, {length=40, curvature=0.03}]
[mounts]
spacing_m = 20.0
[camera]
yaw_deg = [0, 180]
pitch_deg = [35]
[errors]
model = "radius"
[objective]
kind = "localisation"
[budget]
cameras = 3
required = [5]
forbidden = [{mount = 3}]
"""


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("solved")
    (folder / "small.toml").write_text(SMALL)
    solve_into(folder / "out", str(folder / "small.toml"), method="exchange", quiet=True)
    return folder / "out"


@pytest.fixture
def folder(solved: Path, tmp_path: Path) -> Path:
    copy = tmp_path / "out"
    shutil.copytree(solved, copy)
    return copy


def edit(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    path = folder / "solution.json"
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))


def failures(folder: Path) -> list[str]:
    return [check.name for check in verify_folder(folder).checks if not check.passed]


def test_an_honest_solution_is_verified(folder: Path) -> None:
    found = verify_folder(folder)
    assert [check.name for check in found.checks if not check.passed] == []
    assert found.passed
    assert "verified" in found.summary()
    value = next(check.expected for check in found.checks if check.name == "value")
    assert found.bound["derived"] >= value


@pytest.mark.parametrize("kind", ["entropy", "trace", "final_entropy", "kalman_gain"])
@pytest.mark.parametrize("model", ["radius", "covariance"])
def test_every_objective_is_verified(
    request: pytest.FixtureRequest, tmp_path: Path, kind: str, model: str
) -> None:
    if model == "radius":  # every objective is drawn with the other
        request.getfixturevalue("undrawn")
    source = tmp_path / "one.toml"
    source.write_text(SMALL.replace("localisation", kind).replace("radius", model))
    solve_into(tmp_path / "out", str(source), method="greedy", quiet=True)
    found = verify_folder(tmp_path / "out")
    assert found.passed, found.summary()
    if model == "covariance" and kind == "entropy":
        assert "persistent" in found.trusted[0]


SPOILED: dict[str, tuple[Callable[[dict[str, Any]], None], str]] = {
    "value": (lambda r: r.update(value=r["value"] * (1 + 1e-5)), "value"),
    "value as text": (lambda r: r.update(value=str(r["value"])), "value"),
    "bound below the value": (
        lambda r: r.update(upper_bound=r["value"] * 0.99, gap=0.01),
        "bound.holds",
    ),
    "bound on the wrong side": (
        lambda r: r.update(lower_bound=r.pop("upper_bound")),
        "bound.side",
    ),
    "bound moved, gap not": (lambda r: r.update(upper_bound=r["upper_bound"] * 1.01), "gap"),
    "gap": (lambda r: r.update(gap=r["gap"] / 2), "gap"),
    "no gap": (lambda r: r.update(gap=None), "gap"),
    "status": (lambda r: r.update(status="optimal"), "status"),
    "a camera turned": (lambda r: r["cameras"][0].update(yaw_deg=12.0), "cameras.fields"),
    "a camera moved": (
        lambda r: r["cameras"][1].update(x_m=r["cameras"][1]["x_m"] + 0.01),
        "cameras.fields",
    ),
    "a camera's lens": (lambda r: r["cameras"][1].update(projection="fisheye"), "cameras.fields"),
    "a camera lost": (lambda r: r["cameras"].pop(), "cameras.count"),
    "a camera twice": (
        lambda r: r.update(selected=[*r["selected"], r["selected"][-1]]),
        "selected.form",
    ),
    "out of order": (lambda r: r["selected"].reverse(), "selected.form"),
    "a stranger": (lambda r: r.update(selected=[*r["selected"], 10**6]), "selected.form"),
    "another pose": (lambda r: r["selected"].__setitem__(-1, r["selected"][-1] - 1), "value"),
    "objective": (lambda r: r.update(objective="entropy"), "objective"),
    "unit": (lambda r: r.update(unit="m^2"), "unit"),
    "budget": (lambda r: r.update(budget=4), "budget"),
    "candidates": (lambda r: r.update(candidates=7), "candidates"),
    "seed": (lambda r: r.update(seed=-1), "seed"),
    "seconds": (lambda r: r.update(seconds=-1.0), "seconds"),
    "the instance's hash": (lambda r: r.update(instance_sha256="0" * 64), "instance_sha256"),
    "the instance's name": (lambda r: r.update(instance="other"), "instance"),
}


@pytest.mark.parametrize("what", SPOILED)
def test_each_spoiled_claim_is_caught(folder: Path, what: str) -> None:
    change, name = SPOILED[what]
    edit(folder, change)
    assert name in failures(folder)


def test_broken_rules_are_caught(folder: Path) -> None:
    edit(folder, lambda r: r.update(selected=[0, 1, 20, 25]))
    caught = failures(folder)
    for name in ("budget.cameras", "budget.required", "budget.forbidden", "budget.one_per_mount"):
        assert name in caught


def test_a_changed_instance_is_caught(folder: Path) -> None:
    path = folder / "instance.json"
    path.write_text(path.read_text().replace('"cameras": 3', '"cameras": 4'))
    assert {"instance_sha256", "budget"} <= set(failures(folder))


@pytest.mark.parametrize(
    "column",
    ["s_m", "x_m", "y_m", "curvature", "position_sigma_m", "lateral_2sigma_m", "cameras_seeing"],
)
def test_each_spoiled_column_of_the_path_is_caught(folder: Path, column: str) -> None:
    path = folder / "along_path.csv"
    header, *rows = path.read_text().splitlines()
    at = header.split(",").index(column)
    cells = rows[40].split(",")
    cells[at] = str(float(cells[at]) * 1.001 + 1.0)
    rows[40] = ",".join(cells)
    path.write_text("\n".join([header, *rows]) + "\n")
    assert failures(folder) == [f"along_path.csv.{column}"]


def test_lost_rows_and_spoiled_placements_are_caught(folder: Path) -> None:
    path = folder / "along_path.csv"
    path.write_text("\n".join(path.read_text().splitlines()[:-1]) + "\n")
    path = folder / "placements.csv"
    path.write_text(path.read_text().replace("pinhole", "stereographic", 1))
    assert failures(folder) == ["placements.csv.fields", "along_path.csv.rows"]


def test_a_whole_number_that_no_float_holds_is_a_wrong_value(folder: Path) -> None:
    edit(folder, lambda record: record.update(value=10**400))
    assert "value" in failures(folder)


def test_a_row_of_too_many_fields_is_damage(folder: Path) -> None:
    with (folder / "placements.csv").open("a") as file:
        file.write(",".join(["1"] * 30) + "\n")
    with pytest.raises(ValueError, match=r"placements\.csv: row 3 must have as many fields"):
        verify_folder(folder)


def test_a_camera_and_a_half_is_not_driven(folder: Path) -> None:
    edit(folder, lambda record: record.update(selected=[5.5, 9, 20]))
    with pytest.raises(ValueError, match=r"whole numbers, got 5\.5"):
        read_folder(folder)


def test_an_open_gap_must_not_be_called_optimal_nor_a_closed_one_feasible() -> None:
    def failed(**record: Any) -> list[str]:
        checks = certificate_checks(record, 10.0, maximise=True)
        return [check.name for check in checks if not check.passed]

    closed = {"value": 10.0, "upper_bound": 10.0, "gap": 0.0}
    assert failed(**closed, status="optimal") == []
    assert failed(**closed, status="feasible") == ["status"]
    assert failed(value=10.0, upper_bound=None, gap=None, status="optimal") == ["status"]
    assert failed(value=10.0, upper_bound=None, gap=None, status="feasible") == []
    assert failed(value=10.0, upper_bound=11.0, gap=0.1, status="feasible") == []
    assert failed(value=10.0, upper_bound=11.0, gap=0.1, status="wonderful") == ["status.word"]


def run(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    monkeypatch.setattr(sys, "argv", ["placement", *map(str, words)])
    with pytest.raises(SystemExit) as stop:
        main()
    return int(stop.value.code or 0)


def test_the_command_writes_its_findings_and_says_them_by_its_exit_code(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(monkeypatch, "verify", folder) == 0
    record = json.loads((folder / "verification.json").read_text())
    assert record["passed"]
    assert {"name", "passed", "expected", "got", "tolerance"} == record["checks"][0].keys()
    assert len(capsys.readouterr().out.splitlines()) == 1
    edit(folder, lambda r: r.update(value=1.0))
    assert run(monkeypatch, "verify", folder) == 3
    assert "NOT verified: value" in capsys.readouterr().out
    assert not json.loads((folder / "verification.json").read_text())["passed"]
    assert run(monkeypatch, "verify", tmp_path / "nowhere") == 2
    edit(folder, lambda r: r.update(selected=None))
    assert run(monkeypatch, "verify", folder) == 2


@pytest.mark.usefixtures("undrawn")
def test_solving_again_removes_the_old_verdict(folder: Path, solved: Path) -> None:
    assert verify_in(folder, quiet=True)
    solve_into(folder, str(solved.parent / "small.toml"), method="greedy", quiet=True)
    assert not (folder / "verification.json").exists()
