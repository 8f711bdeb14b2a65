"""The journal of a run: one line a finished job, whole or absent, whatever kills the process.

The first line says what the run is; a resumed run must be the same. A line is one `write` and is
forced to the disk before the next job starts. What a crash leaves behind of a line has no line
end, and is cut off when the journal is opened again.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any


class Journal:
    """Open `path` for appending, made with `heading` if it is new; only one process may.

    Raises:
        ValueError: if another process holds it, or it belongs to another run.
    """

    def __init__(self, path: Path, heading: Mapping[str, Any]) -> None:
        """Lock the file, mend its end, and read what is in it."""
        self.path = path
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._file)
            raise ValueError(f"{path} is in use by another run") from None
        try:
            self.rows = self._read(heading)
        except ValueError:
            self.close()
            raise

    def _read(self, heading: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
        content = self.path.read_bytes()
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            os.ftruncate(self._file, len(whole))
        lines = whole.splitlines()
        if not lines:
            self._append(heading)
            return {}
        try:
            first, *rest = (json.loads(line) for line in lines)
            rows = {str(row["job"]): row for row in rest}
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{self.path} is damaged ({error})") from None
        for key, value in json.loads(json.dumps(heading)).items():
            if first.get(key) != value:
                raise ValueError(
                    f"{self.path} belongs to a run with {key} = {first.get(key)!r}, got {value!r}: "
                    "give another --out, or the same arguments"
                )
        return rows

    def add(self, row: Mapping[str, Any]) -> None:
        """Append the row of one finished job."""
        self._append(row)
        self.rows[str(row["job"])] = dict(row)

    def close(self) -> None:
        """Give the file back."""
        os.close(self._file)

    def _append(self, record: Mapping[str, Any]) -> None:
        line = json.dumps(record, allow_nan=False, separators=(",", ":")).encode() + b"\n"
        written = os.write(self._file, line)
        if written != len(line):
            raise OSError(f"{self.path}: the disk took {written} of {len(line)} bytes")
        os.fsync(self._file)
