"""Centre lines from CSV: real circuits, small files, and files that must be refused."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from models.files.centreline import read_centreline

TRACKS = ("Budapest", "IMS", "Monza", "Norisring", "Spa", "Spielberg", "Zandvoort")


@pytest.mark.parametrize("name", TRACKS)
def test_real_circuits_turn_once_and_keep_their_length(
    name: str, shared_data: Callable[[str], Path]
) -> None:
    path = shared_data(f"tracks/{name}.csv")
    data = np.loadtxt(path, delimiter=",")
    road = read_centreline(path)
    assert road.closed
    assert abs(road.total_turning_rad) == pytest.approx(2.0 * math.pi, abs=1e-9)
    polyline = np.hypot(*(np.roll(data, -1, axis=0) - data)[:, :2].T).sum()
    assert road.length_m == pytest.approx(polyline, rel=1e-3)
    s, lateral = road.project(data[:, 0], data[:, 1])
    assert np.all(np.diff(s) > 0.0)
    assert np.allclose(lateral, 0.0, atol=1e-9)
    left, right = road.half_widths(s)
    assert np.allclose(right, data[:, 2], atol=1e-9)
    assert np.allclose(left, data[:, 3], atol=1e-9)


def write(folder: Path, text: str) -> Path:
    path = folder / "road.csv"
    path.write_text(text, encoding="utf-8")
    return path


OPEN = "0,0\n10,0\n20,1\n30,3\n40,6\n"


def test_a_file_without_header_or_widths_is_an_open_road(tmp_path: Path) -> None:
    road = read_centreline(write(tmp_path, OPEN), half_width_m=2.0)
    assert not road.closed
    assert np.allclose(road.evaluate([0.0, road.length_m]).xy, [[0, 0], [40, 6]])
    assert np.allclose(road.half_widths([5.0]), 2.0)


def test_a_header_sets_the_order_of_columns(tmp_path: Path) -> None:
    text = "# drawn by hand\nw_tr_left_m, y_m, x_m, w_tr_right_m\n1,0,0,2\n1,5,10,2\n\n"
    road = read_centreline(write(tmp_path, text))
    assert np.allclose(road.evaluate([0.0, road.length_m]).xy, [[0, 0], [10, 5]])
    left, right = road.half_widths([1.0])
    assert (left[0], right[0]) == (1.0, 2.0)


def ring_text(n: int, share: float = 1.0) -> str:
    angles = [2.0 * math.pi * share * i / n for i in range(n)]
    return "".join(f"{50 * math.cos(a)!r},{50 * math.sin(a)!r}\n" for a in angles)


def test_closed_or_open_is_seen_from_the_gap_and_may_be_said(tmp_path: Path) -> None:
    assert read_centreline(write(tmp_path, ring_text(40))).closed
    assert not read_centreline(write(tmp_path, ring_text(40)), closed=False).closed
    assert not read_centreline(write(tmp_path, ring_text(40, share=0.9))).closed
    assert read_centreline(write(tmp_path, ring_text(40, share=0.9)), closed=True).closed
    assert not read_centreline(write(tmp_path, "0,0\n100,0\n100,100\n")).closed


def test_a_repeated_first_point_closes_the_road(tmp_path: Path) -> None:
    text = "0,0\n100,0\n100,100\n0,100\n"
    road = read_centreline(write(tmp_path, text + "0,0\n"))
    assert road.closed
    assert road.length_m == read_centreline(write(tmp_path, text), closed=True).length_m


BAD = {
    "nan": (OPEN + "50,nan\n", "line 6: y_m must be finite, got nan"),
    "infinity": ("inf,0\n" + OPEN, "line 1: x_m must be finite, got inf"),
    "text": (OPEN + "abc,7\n", "line 6: x_m must be a number, got 'abc'"),
    "empty field": ("0,\n" + OPEN, "line 1: y_m must be a number, got ''"),
    "equal points": (
        "# x_m,y_m\n" + OPEN + "40,6\n",
        "line 7: neighbouring points must differ, got (40, 6) twice (before in line 6)",
    ),
    "one row": ("1,2\n", "a road needs at least 2 rows of coordinates, got 1"),
    "no row": ("# x_m,y_m\n", "a road needs at least 2 rows of coordinates, got 0"),
    "nothing": ("", "a road needs at least 2 rows of coordinates, got 0"),
    "ragged": (OPEN + "50,9,1\n", "line 6: a row must hold 2 fields, got 3"),
    "three columns": (
        "0,0,1\n1,0,1\n",
        "line 1: a row must hold x_m, y_m or x_m, y_m, w_tr_right_m, w_tr_left_m, got 3 fields",
    ),
    "negative width": ("0,0,1,1\n1,0,1,-2\n", "line 2: w_tr_left_m must be 0 or more, got -2"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files_are_refused_in_one_line_that_says_where(case: str, tmp_path: Path) -> None:
    text, message = BAD[case]
    path = write(tmp_path, text)
    with pytest.raises(ValueError, match="^" + re.escape(f"{path}: {message}") + "$"):
        read_centreline(path)


def test_a_closed_road_of_two_rows_is_refused(tmp_path: Path) -> None:
    for text in ("0,0\n1,0\n", "0,0\n1,0\n0,0\n"):
        with pytest.raises(ValueError, match=r"a closed road needs at least 3 rows .*, got 2$"):
            read_centreline(write(tmp_path, text), closed=True)


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    missing = tmp_path / "missing.csv"
    with pytest.raises(ValueError, match="^" + re.escape(f"{missing}: no such file") + "$"):
        read_centreline(missing)
    with pytest.raises(ValueError, match=r": cannot be read: Is a directory$"):
        read_centreline(tmp_path)
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(ValueError, match=r": cannot be read: not a text file$"):
        read_centreline(binary)


def test_a_road_that_folds_back_on_itself_is_refused_with_the_place(tmp_path: Path) -> None:
    path = tmp_path / "line.csv"
    path.write_text("0,0\n10,0\n20,0\n30,0\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"radius of at least 0\.1 m, got a fold near \("):
        read_centreline(path, closed=True)
    path.write_text("0,0\n10,0\n0,0\n10,0\n0,0\n", encoding="utf-8")  # no number is left of it
    with pytest.raises(ValueError, match=r"got a fold near \(10, 0\)|got a fold near \(0, 0\)"):
        read_centreline(path)
