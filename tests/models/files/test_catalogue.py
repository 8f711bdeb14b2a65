from __future__ import annotations

from pathlib import Path

import pytest

from models.files.catalogue import CameraType, read_catalogue

HEADER = "name,width_px,height_px,hfov_deg,vfov_deg,price\n"


def store(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "types.csv"
    path.write_text(text)
    return path


def test_types_are_read_whatever_the_order_of_columns(tmp_path: Path) -> None:
    path = store(
        tmp_path,
        "price, name, maker, vfov_deg, hfov_deg, height_px, width_px\n"
        "250.5, wide, A, 68, 90, 1500, 2000\n\n0, toy, B, 45, 60, 480, 640\n",
    )
    assert read_catalogue(path) == (
        CameraType("wide", 2000, 1500, 90.0, 68.0, 250.5),
        CameraType("toy", 640, 480, 60.0, 45.0, 0.0),
    )


BAD = {
    "nothing": ("", "line 1: must name the columns"),
    "a column missing": (HEADER.replace(",price", ""), "price is missing"),
    "no type": (HEADER, "must hold 1…1000 camera types, got 0"),
    "a short row": (HEADER + "a,1,1,60,45\n", "line 2: a row must hold 6 fields, got 5"),
    "text in a number": (HEADER + "a,wide,1,60,45,1\n", "line 2: width_px must be a number"),
    "half a pixel": (HEADER + "a,100.5,1,60,45,1\n", "width_px must be a whole number"),
    "no pixel": (HEADER + "a,100,0,60,45,1\n", "height_px must be a whole number"),
    "a field of 400": (HEADER + "a,100,100,400,45,1\n", r"hfov_deg must lie in \(0, 360\]"),
    "a negative price": (HEADER + "a,100,100,60,45,-1\n", "line 2: price must be at least 0"),
    "NaN": (HEADER + "a,100,100,60,45,nan\n", "price must be finite, got nan"),
    "no name": (HEADER + ",100,100,60,45,1\n", "name must not be empty"),
    "a name twice": (HEADER + "a,9,9,60,45,1\na,9,9,60,45,2\n", "line 3: name must differ"),
}


@pytest.mark.parametrize("what", BAD)
def test_what_is_wrong_is_said_with_its_line(tmp_path: Path, what: str) -> None:
    content, words = BAD[what]
    with pytest.raises(ValueError, match=words):
        read_catalogue(store(tmp_path, content))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"nowhere\.csv: no such file"):
        read_catalogue(tmp_path / "nowhere.csv")
