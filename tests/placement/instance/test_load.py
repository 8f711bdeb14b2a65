"""Instances from files: syntax, relative files, names, changes and the hash."""

from __future__ import annotations

from pathlib import Path

import pytest

from placement.instance import InstanceError, instance_from_dict, load_instance, shipped_instances

TEXT = "[road]\npieces = [ {length=200}, {length=60, curvature=[0.0, 0.02]} ]\n"


def write(folder: Path, text: str, name: str = "road.toml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_a_file_is_read_and_named_after_itself(tmp_path: Path) -> None:
    instance = load_instance(write(tmp_path, TEXT))
    assert instance.name == "road"
    assert instance.folder == tmp_path
    assert instance.road.pieces is not None
    assert len(instance.road.pieces) == 2


def test_a_syntax_error_is_shown_with_its_line(tmp_path: Path) -> None:
    path = write(tmp_path, TEXT + "[budget\n")
    with pytest.raises(InstanceError, match=rf"^{path}: not TOML: .*line 3"):
        load_instance(path)


def test_text_that_is_not_utf8_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "latin.toml"
    path.write_bytes(b"# Stra\xdfe\n")
    with pytest.raises(InstanceError, match="must be UTF-8 text, got byte 6"):
        load_instance(path)


def test_each_line_names_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, TEXT + "[camera]\npitch_deg = [0, 135]\n")
    with pytest.raises(InstanceError) as caught:
        load_instance(path)
    assert [p.startswith(f"{path}: camera.pitch_deg[") for p in caught.value.problems] == [True] * 2


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "none.toml"
    with pytest.raises(InstanceError, match=rf"^{path}: cannot be read \(No such file"):
        load_instance(path)


def test_an_unknown_name_lists_those_that_are_shipped_or_the_one_that_is_near() -> None:
    with pytest.raises(InstanceError, match=r"no instance is named qqq \(shipped: .*winding"):
        load_instance("qqq")
    with pytest.raises(InstanceError, match=r"named windig \(did you mean winding\?\)$"):
        load_instance("windig")


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path: Path) -> None:
    instance = load_instance(write(tmp_path, "\ufeff" + TEXT))
    assert len(instance.road.pieces or ()) == 2


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("x = " + "[" * 100_000, "not TOML: nested too deeply"),
        ("[a" + ".a" * 5_000 + "]\n", "nested"),
        ("[budget]\ncameras = " + "9" * 5_000, "numbers must have at most 4,300 digits"),
    ],
)
def test_a_file_made_to_break_the_parser_is_one_line_that_names_it(
    tmp_path: Path, text: str, line: str
) -> None:
    with pytest.raises(InstanceError) as error:
        load_instance(write(tmp_path, text))
    (problem,) = error.value.problems
    assert problem.startswith(f"{tmp_path / 'road.toml'}: ")
    assert line in problem


def test_a_file_without_end_is_refused() -> None:
    with pytest.raises(InstanceError, match=r"^/dev/zero: must be at most 100 MB$"):
        load_instance("/dev/zero")


def test_relative_files_lie_beside_the_instance(tmp_path: Path) -> None:
    write(tmp_path, "0,0\n1,0\n", "line.csv")
    instance = load_instance(write(tmp_path, '[road]\nfile = "line.csv"\n'))
    assert instance.files["road.file"] == tmp_path / "line.csv"


def test_a_relative_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InstanceError, match=r'road.file must name a readable file, got ".*a\.csv"'):
        load_instance(write(tmp_path, '[road]\nfile = "a.csv"\n'))


def test_a_change_is_checked_like_a_file() -> None:
    instance = instance_from_dict({"road": {"pieces": [{"length": 100}]}})
    assert instance.changed({"budget.cameras": 5}).budget.cameras == 5
    assert instance.budget.cameras == 20
    with pytest.raises(InstanceError, match=r"^budget\.cameras must be at least 1"):
        instance.changed({"budget.cameras": 0})


def test_the_hash_depends_on_meaning_alone(tmp_path: Path) -> None:
    spelled = load_instance(write(tmp_path, TEXT + "[budget]\ncameras = 20\n", "b.toml"))
    assert load_instance(write(tmp_path, "# a remark\n" + TEXT)).sha256() == spelled.sha256()
    assert spelled.changed({"budget.cameras": 21}).sha256() != spelled.sha256()


def test_the_hash_follows_the_bytes_of_the_road_file_but_not_its_place(tmp_path: Path) -> None:
    write(tmp_path, "0,0\n1,0\n", "one.csv")
    write(tmp_path, "0,0\n1,0\n", "two.csv")
    one, two = (
        instance_from_dict({"road": {"file": f"{n}.csv"}}, folder=tmp_path) for n in ("one", "two")
    )
    assert one.sha256() == two.sha256()
    write(tmp_path, "0,0\n2,0\n", "two.csv")
    assert one.sha256() != two.sha256()


@pytest.mark.parametrize("name", sorted(shipped_instances()))
def test_every_shipped_instance_loads(name: str) -> None:
    assert load_instance(name).name == name
