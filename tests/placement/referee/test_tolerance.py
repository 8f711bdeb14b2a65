"""The referee on tolerance, and what the command line says of it: folders solved, then altered."""

import json
import sys
from pathlib import Path

import pytest

from placement.cli import main
from placement.verify import verify_folder

ROAD = """
[road]
pieces = [{{length = 160}}, {{length = 60, curvature = 0.02}}, {{length = 80}}]
[mounts]
spacing_m = 20.0
[camera]
yaw_deg = [0, 180]
pitch_deg = [20]
fov_deg = [[60, 45]]
{camera}
[errors]
model = "radius"
persistent = {persistent}
[objective]
kind = "{kind}"
tolerance_m = {tau}
{drives}
[budget]
cameras = {cameras}
failures = {failures}
"""


def instance(
    folder: Path, *, kind: str = "tolerance", tau: float = 0.4, cameras: int = 20,
    failures: int = 0, camera: str = "", persistent: str = "false", drives: str = "",
) -> Path:  # fmt: skip
    path = folder / "road.toml"
    path.write_text(
        ROAD.format(
            kind=kind, tau=tau, cameras=cameras, failures=failures, camera=camera,
            persistent=persistent, drives=drives,
        )
    )  # fmt: skip
    return path


def cli(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit) as stopped:
        patch.setattr(sys, "argv", ["placement", *map(str, arguments)])
        main()
    said = capsys.readouterr()
    return int(stopped.value.code or 0), said.out + said.err


@pytest.mark.parametrize(
    "tables",
    [
        {},
        {"failures": 1},
        {"camera": "price = 900.0"},
        {"persistent": "true"},
        {"drives": 'drives = ["forward", "backward"]'},
    ],
)
def test_what_is_solved_is_verified(
    tmp_path: Path, tables: dict[str, object], request: pytest.FixtureRequest
) -> None:
    from placement.commands import solve_into

    if "failures" in tables or "persistent" in tables:  # drawn as the first is
        request.getfixturevalue("undrawn")
    out = tmp_path / "out"
    solution = solve_into(out, str(instance(tmp_path, **tables)), time_limit_s=30.0, quiet=True)  # type: ignore[arg-type]
    assert solution.status.has_placement
    verified = verify_folder(out)
    assert verified.passed, verified.summary()
    record = json.loads((out / "solution.json").read_text())
    price = 900.0 if "camera" in tables else 1.0
    assert record["value"] == price * len(record["selected"])
    assert record["lower_bound"] <= record["value"]
    names = [check.name for check in verified.checks]
    assert any(name.startswith("tolerance") for name in names)
    assert any(name.endswith("one_dark") for name in names) == (tables.get("failures") == 1)


@pytest.mark.usefixtures("undrawn")
def test_a_camera_taken_away_is_out_of_tolerance(tmp_path: Path) -> None:
    from placement.commands import solve_into

    out = tmp_path / "out"
    solve_into(out, str(instance(tmp_path, failures=1)), time_limit_s=30.0, quiet=True)
    record = json.loads((out / "solution.json").read_text())
    record["selected"] = record["selected"][1:]
    (out / "solution.json").write_text(json.dumps(record))
    failed = {check.name for check in verify_folder(out).checks if not check.passed}
    assert {"tolerance.one_dark", "value"} <= failed


def test_the_command_line_says_what_cannot_be_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    code, said = cli(capsys, "solve", instance(tmp_path, tau=0.01), "--out", out)
    assert code == 2
    assert "objective.tolerance_m must be at least" in said
    assert "where they do worst" in said
    code, said = cli(capsys, "solve", instance(tmp_path, cameras=1), "--out", out, "--quiet")
    assert code == 3
    reason = json.loads((out / "solution.json").read_text())["stats"]["reason"]
    assert "at most budget.cameras = 1" in reason
    assert "are known to do" in reason
    code, said = cli(capsys, "solve", instance(tmp_path, kind="trace", failures=1), "--out", out)
    assert code == 2
    assert "budget.failures must be 0 unless objective.kind = tolerance, got 1 with trace" in said
    code, said = cli(capsys, "solve", instance(tmp_path), "--out", out, "--budget", "1:3")
    assert code == 2
    assert "--budget A:B must be one number for objective.kind = tolerance" in said


def test_uniform_needs_at_least_as_many(tmp_path: Path) -> None:
    from placement.assemble import load
    from placement.solve import solve

    scene = load(instance(tmp_path))
    best, plain = solve(scene.problem, time_limit_s=30.0), solve(scene.problem, "uniform")
    assert not plain.status.has_placement or plain.value >= best.value
