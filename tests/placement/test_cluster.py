"""Work in processes and on Dask: the same results, deaths survived, killers named."""

from __future__ import annotations

import os
import signal
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from placement.assemble import assemble
from placement.cluster import Processes, Serial, Work, work_at
from placement.commands import solve_into, validate_in
from placement.instance import instance_from_dict

CLOSED_PORT = "tcp://127.0.0.1:9"  # the discard port: nobody listens


def square(task: int) -> int:
    return task * task


def die_once(task: tuple[int, str]) -> int:
    """Square the number; the first to get 3 kills its own process, as the kernel would."""
    number, folder = task
    if number == 3:
        try:
            (Path(folder) / "died").touch(exist_ok=False)
        except FileExistsError:
            return number * number
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def die(task: int) -> int:
    """Square the number unless it is 2, which kills whoever computes it."""
    if task == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return task * task


def refuse(task: int) -> int:
    raise ValueError(f"task.number must be even, got {task}")


def results(work: Work, function: object, tasks: list[object]) -> list[object]:
    found = dict(work.run(function, tasks, "square"))  # type: ignore[arg-type]
    assert sorted(found) == list(range(len(tasks)))
    return [found[i] for i in range(len(tasks))]


@pytest.fixture(scope="module")
def processes() -> Iterator[Processes]:
    work = Processes(2)
    yield work
    work.close()


def test_serial_needs_nothing_and_keeps_the_order() -> None:
    assert list(Serial().run(square, [3, 1, 2], "square")) == [(0, 9), (1, 1), (2, 4)]


def test_processes_return_what_serial_does(processes: Processes) -> None:
    numbers: list[object] = list(range(11))
    assert results(processes, square, numbers) == results(Serial(), square, numbers)
    assert results(processes, square, []) == []


def test_a_worker_that_dies_is_survived(processes: Processes, tmp_path: Path) -> None:
    tasks: list[object] = [(n, str(tmp_path)) for n in range(8)]
    assert results(processes, die_once, tasks) == [n * n for n in range(8)]
    assert (tmp_path / "died").exists()


def test_a_task_that_kills_workers_is_named_after_three(processes: Processes) -> None:
    with pytest.raises(ValueError, match=r"square: task 2 killed a worker 3 times"):
        results(processes, die, list(range(4)))
    assert results(processes, square, [5]) == [25]  # and the pool goes on


def test_bad_input_in_a_worker_is_bad_input_here(processes: Processes) -> None:
    with pytest.raises(ValueError, match=r"task\.number must be even, got 3"):
        results(processes, refuse, [3])


def test_places_are_refused_by_name() -> None:
    assert isinstance(work_at(), Serial)
    with pytest.raises(ValueError, match=r"--workers must be at least 1, got 0"):
        work_at(0)
    with pytest.raises(ValueError, match=r"--workers and --cluster must not both be given"):
        work_at(2, CLOSED_PORT)


def test_a_cluster_that_does_not_answer_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("placement.cluster._PATIENCE_S", 0.5)
    with pytest.raises(
        ValueError, match=r"--cluster must be the address .* got tcp://127"
    ) as error:
        work_at(cluster=CLOSED_PORT)
    assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match=r"--cluster tls://… needs certificates"):
        work_at(cluster=CLOSED_PORT.replace("tcp", "tls"))
    with pytest.raises(ValueError, match=r"--cluster must be the address .* port, got nonsense"):
        work_at(cluster="nonsense")
    with pytest.raises(ValueError, match=r"--cluster must begin with tcp:// .* got http://x"):
        work_at(cluster="http://x")


STREET = """
[road]
pieces = [{length = 60.0}]
[mounts]
spacing_m = 20.0
[obstacles]
polygons = [[[20, 3], [30, 3], [30, 8], [20, 8]]]
[budget]
cameras = 2
[objective]
kind = "localisation"
"""


@pytest.mark.usefixtures("undrawn")  # figures are drawn of the same files, by one process
def test_commands_write_the_same_bytes_with_workers(tmp_path: Path) -> None:
    (tmp_path / "street.toml").write_text(STREET)
    folders = [tmp_path / "here", tmp_path / "there"]
    for folder, workers in zip(folders, (None, 2), strict=True):
        solve_into(folder, str(tmp_path / "street.toml"), workers=workers, quiet=True)
        validate_in(folder, runs=120, seed=1, workers=workers, quiet=True)
    for name in ("placements.csv", "along_path.csv", "validation.csv", "validation_summary.json"):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes()


def test_information_is_the_same_to_the_byte_wherever_its_parts_are_computed(
    processes: Processes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("placement.information.spread.PART", 60)
    scene = assemble(instance_from_dict(tomllib.loads(STREET)))
    spread = assemble(scene.instance, processes).information
    for name in ("indptr", "indices", "blocks", "white", "offsets"):
        assert getattr(spread, name).tobytes() == getattr(scene.information, name).tobytes()


def test_a_cluster_that_does_not_answer_leaves_nothing_behind(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("placement.cluster._PATIENCE_S", 0.5)
    (tmp_path / "street.toml").write_text(STREET)
    with pytest.raises(ValueError, match="--cluster must be"):
        solve_into(tmp_path / "out", str(tmp_path / "street.toml"), cluster=CLOSED_PORT, quiet=True)
    assert not (tmp_path / "out").exists()
