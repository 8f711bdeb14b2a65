"""Hostile XML is refused in one line; big files are read in little memory."""

from __future__ import annotations

import gzip
import re
import tracemalloc
from pathlib import Path

import pytest

from models.files import xml
from models.files.roadfile import read_road_file
from models.files.xml import stream_elements

BOMB = """<?xml version="1.0"?><!DOCTYPE net [
<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">
<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;">]><{root}>&c;</{root}>"""
OUTSIDE = """<?xml version="1.0"?><!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/hostname">]>
<{root}>&e;</{root}>"""
SUBSET = '<?xml version="1.0"?><!DOCTYPE x SYSTEM "http://127.0.0.1/x.dtd"><{root}/>'
ROOTS = {".net.xml": "net", ".xodr": "OpenDRIVE", ".osm": "osm"}


@pytest.mark.parametrize("suffix", ROOTS)
@pytest.mark.parametrize("text", [BOMB, OUTSIDE, SUBSET], ids=["bomb", "outside", "subset"])
def test_entities_are_refused_in_every_format(tmp_path: Path, suffix: str, text: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_text(text.replace("{root}", ROOTS[suffix]))
    with pytest.raises(ValueError, match=r"must not declare a document type, entities") as caught:
        read_road_file(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("suffix", ROOTS)
def test_absurd_depth_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"deep{suffix}"
    path.write_text(f"<{ROOTS[suffix]}>" + "<a>" * 50_000)
    with pytest.raises(ValueError, match="nested at most 64 deep"):
        read_road_file(path)


@pytest.mark.parametrize("suffix", ROOTS)
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"<other/>", "must hold <"),
        (b"\x00\x01\x02", "not XML"),
        (b"<{root}><a></{root}>", "not XML"),
        (b"<{root}><a x='1'>", "not XML, or it ends early"),
    ],
)
def test_what_is_no_such_file_is_refused_in_one_line(
    tmp_path: Path, suffix: str, content: bytes, message: str
) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content.replace(b"{root}", ROOTS[suffix].encode()))
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        read_road_file(path)
    assert "\n" not in str(caught.value)


def test_a_truncated_gzip_file_is_refused(tmp_path: Path) -> None:
    whole = gzip.compress(b"<net>" + b"<edge id='x'/>" * 5000 + b"</net>")
    path = tmp_path / "a.net.xml.gz"
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="gzip file ends early"):
        read_road_file(path)


def test_a_damaged_gzip_file_is_refused(tmp_path: Path) -> None:
    whole = bytearray(gzip.compress(b"<net>" + bytes(range(32, 60)) * 500 + b"</net>"))
    whole[30:60] = bytes(30)
    path = tmp_path / "a.net.xml.gz"
    path.write_bytes(whole)
    with pytest.raises(ValueError, match=r"damaged gzip|not XML"):
        read_road_file(path)


def test_a_gzip_bomb_is_refused_before_it_has_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(xml, "SURE_BYTES", 1 << 18)
    path = tmp_path / "a.net.xml.gz"
    path.write_bytes(gzip.compress(b"<net>" + b"<edge/>" * 300_000 + b"</net>"))
    with pytest.raises(ValueError, match="looks like a gzip bomb"):
        list(stream_elements(path, "net"))


def test_one_endless_tag_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xml, "MOST_TOKEN_BYTES", 1 << 19)
    path = tmp_path / "a.net.xml"
    path.write_text("<net><edge shape='" + "1,2 " * 400_000 + "'/></net>")
    with pytest.raises(ValueError, match="one tag must have at most"):
        list(stream_elements(path, "net"))


def test_one_child_with_countless_elements_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(xml, "MOST_ELEMENTS", 1000)
    path = tmp_path / "a.net.xml"
    path.write_text("<net><edge>" + "<lane/>" * 5000 + "</edge></net>")
    with pytest.raises(ValueError, match="no element of more than"):
        list(stream_elements(path, "net"))


def test_children_come_whole_and_memory_stays_small(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    n = 20_000
    path.write_text("<net>" + "".join(f"<e id='{i}'><l k='{i}'/></e>" for i in range(n)) + "</net>")
    tracemalloc.start()
    seen = 0
    for element in stream_elements(path, "net"):
        if element.tag == "e":
            assert element.get("id") == str(seen)
            assert [each.get("k") for each in element] == [str(seen)]
            seen += 1
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert seen == n
    assert peak < 6e6  # a tree of all of it takes several times that


def test_a_namespace_does_not_matter(tmp_path: Path) -> None:
    path = tmp_path / "a.xml"
    path.write_text("<net xmlns='http://example.org/net'><e><l/></e></net>")
    tags = [[each.tag for each in element.iter()] for element in stream_elements(path, "net")]
    assert tags[1:] == [["e", "l"]]


def test_a_missing_file_and_a_wrong_suffix_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such file"):
        read_road_file(tmp_path / "none.net.xml")
    with pytest.raises(ValueError, match="no such file"):
        read_road_file(tmp_path / "none.osm.pbf")
    wrong = tmp_path / "road.dxf"
    wrong.write_text("")
    with pytest.raises(ValueError, match=r"must be one of \.csv, \.xodr"):
        read_road_file(wrong)
