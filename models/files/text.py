"""Read what a stranger wrote, of bounded size, as text, CSV or JSON: or say in one line why not."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any, NoReturn


def read_text(path: Path, most_bytes: int | None = None) -> str:
    """Return a file's text; raises ValueError of one line that names the file."""
    try:
        if most_bytes is not None and path.stat().st_size > most_bytes:
            raise ValueError(f"{path}: must be at most {most_bytes // 1_000_000} MB")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise ValueError(f"{path}: cannot be read: {reason}") from None


def read_rows(path: Path, most_bytes: int) -> list[list[str]]:
    """Return the cells of a CSV file, row by row; raises as `read_text` does."""
    text = read_text(path, most_bytes)
    try:
        return list(csv.reader(text.splitlines(), skipinitialspace=True))
    except csv.Error as error:
        raise ValueError(f"{path}: not CSV: {error}") from None


def read_bytes(path: Path, most_bytes: int, most: str) -> bytes:
    """Return a file's content; `most` says in words what the limit is.

    Raises:
        ValueError: one line that names the file: not there, not readable, too large.
    """
    try:
        with path.open("rb") as file:
            content = file.read(most_bytes + 1)
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror or error}") from None
    if len(content) > most_bytes:
        raise ValueError(f"{path}: must be at most {most}")
    return content


def parse_json(path: Path, content: bytes) -> Any:
    """Parse strict JSON, no NaN; raises ValueError of one line that names the file."""

    def refuse(word: str) -> NoReturn:
        raise ValueError(f"{word} is no number of JSON")

    try:
        return json.loads(content.decode("utf-8-sig"), parse_constant=refuse)
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: must be UTF-8 text, got byte {error.start}") from None
    except (ValueError, RecursionError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise ValueError(f"{path}: not JSON: {reason}") from None
