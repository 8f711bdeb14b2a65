from __future__ import annotations

from pathlib import Path

import pytest

from placement.atomic import prepare_folder, prepared_folder, write_files


def test_files_arrive_with_their_content(tmp_path: Path) -> None:
    write_files(
        tmp_path / "new",
        {"a.txt": "text", "b.bin": b"\x00\x01", "c.txt": lambda path: path.write_text("made")},
    )
    assert (tmp_path / "new" / "a.txt").read_text() == "text"
    assert (tmp_path / "new" / "b.bin").read_bytes() == b"\x00\x01"
    assert (tmp_path / "new" / "c.txt").read_text() == "made"
    assert len(list((tmp_path / "new").iterdir())) == 3


@pytest.mark.parametrize("stop", [KeyboardInterrupt, RuntimeError])
def test_an_interrupt_leaves_the_folder_as_it_was(
    tmp_path: Path, stop: type[BaseException]
) -> None:
    write_files(tmp_path, {"a.txt": "old"})

    def interrupted(path: Path) -> None:
        path.write_text("half")
        raise stop

    with pytest.raises(stop):
        write_files(tmp_path, {"a.txt": "new", "b.txt": interrupted})
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


def test_a_folder_below_a_file_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(
        ValueError, match=r"^--out must be a folder that can be written, got .*file"
    ):
        prepare_folder(tmp_path / "file" / "out")


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
def test_a_block_that_fails_takes_back_the_empty_folders_made_for_it(
    tmp_path: Path, stop: type[BaseException]
) -> None:
    (tmp_path / "old").mkdir()
    for out in (tmp_path / "new" / "deep", tmp_path / "old"):
        with pytest.raises(stop), prepared_folder(out):
            assert out.is_dir()
            (out / "begun").mkdir(exist_ok=True)
            raise stop
    (tmp_path / "old" / "begun").rmdir()
    assert [p.name for p in tmp_path.iterdir()] == ["old"]
    with pytest.raises(stop), prepared_folder(tmp_path / "new" / "deep"):
        (tmp_path / "new" / "kept").write_text("")
        raise stop
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["kept"]
    with prepared_folder(tmp_path / "done"):
        pass
    assert (tmp_path / "done").is_dir()


def test_a_folder_that_cannot_be_made_leaves_none_of_its_parents(
    tmp_path: Path,
) -> None:
    with (
        pytest.raises(ValueError, match=r"^--out must"),
        prepared_folder(tmp_path / "a" / ("b" * 300)),
    ):
        raise AssertionError
    assert not list(tmp_path.iterdir())
