"""Read a catalogue of camera types: what each sees, and what it costs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from models.camera_checks import MAX_SIZE_PX
from models.files.text import read_rows

COLUMNS = ("name", "width_px", "height_px", "hfov_deg", "vfov_deg", "price")
MOST_BYTES = 1_000_000
MOST_TYPES = 1_000


@dataclass(frozen=True, slots=True)
class CameraType:
    """One camera one can buy: a name, the image's size, both full fields of view, and the price."""

    name: str
    width_px: int
    height_px: int
    hfov_deg: float
    vfov_deg: float
    price: float


def read_catalogue(path: str | Path) -> tuple[CameraType, ...]:
    """Read a CSV with the columns `name, width_px, height_px, hfov_deg, vfov_deg, price`.

    Columns may come in any order and others are ignored.

    Raises a ValueError of one line that names the file and the line: no such file, a missing
    column, a row too short, a size that is no whole number of 1…100,000 px, a field of view outside
    (0, 360], a price that is negative or no finite number, an empty or repeated name, no type.
    """
    path = Path(path)
    rows = read_rows(path, MOST_BYTES)
    header = [cell.strip() for cell in rows[0]] if rows else []
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise ValueError(
            f"{path}: line 1: must name the columns {', '.join(COLUMNS)}; {missing[0]} is missing"
        )
    found: dict[str, CameraType] = {}
    for line, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        where = f"{path}: line {line}"
        if len(row) != len(header):
            raise ValueError(f"{where}: a row must hold {len(header)} fields, got {len(row)}")
        kind = _type(dict(zip(header, (cell.strip() for cell in row), strict=True)), where)
        if kind.name in found:
            raise ValueError(f"{where}: name must differ from the others, got {kind.name!r} twice")
        found[kind.name] = kind
    if not 1 <= len(found) <= MOST_TYPES:
        raise ValueError(f"{path}: must hold 1…{MOST_TYPES} camera types, got {len(found)}")
    return tuple(found.values())


def _type(cells: dict[str, str], where: str) -> CameraType:
    if not cells["name"]:
        raise ValueError(f"{where}: name must not be empty")
    sizes = [_size(cells[key], f"{where}: {key}") for key in ("width_px", "height_px")]
    fields = [_number(cells[key], f"{where}: {key}") for key in ("hfov_deg", "vfov_deg")]
    for key, value in zip(("hfov_deg", "vfov_deg"), fields, strict=True):
        if not 0.0 < value <= 360.0:
            raise ValueError(f"{where}: {key} must lie in (0, 360], got {value:g}")
    price = _number(cells["price"], f"{where}: price")
    if price < 0.0:
        raise ValueError(f"{where}: price must be at least 0, got {price:g}")
    return CameraType(cells["name"], sizes[0], sizes[1], fields[0], fields[1], price)


def _size(text: str, name: str) -> int:
    value = _number(text, name)
    if value != int(value) or not 1 <= value <= MAX_SIZE_PX:
        raise ValueError(f"{name} must be a whole number of 1…{MAX_SIZE_PX}, got {text}")
    return int(value)


def _number(text: str, name: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f"{name} must be a number, got {text!r}") from None
    if not math.isfinite(value):
        raise ValueError(f"{name} must be finite, got {text}")
    return value
