"""Information in chunks on disk: computed once, checked when read, resumed after a stop.

A chunk is what a run of candidates tells about the samples. It lies in one `.npz` file, written
whole or not at all, beside a line of JSON with its checksum and the key of what it was made from:
a file of another key, or one whose bytes have changed, is computed anew, all others never again.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.geometry import IntArray
from placement.atomic import write_files

VERSION = 1


@dataclass(frozen=True, slots=True)
class Chunk:
    """Hold the CSR rows of `candidates` (n,), those kept of a run: `indptr` (n + 1,) and so on."""

    candidates: IntArray
    indptr: IntArray
    indices: NDArray[np.int32]
    blocks: NDArray[np.float32]

    def as_bytes(self) -> bytes:
        """Return the chunk as an `.npz` file; the same chunk always gives the same bytes."""
        stream = io.BytesIO()
        np.savez(
            stream,
            candidates=self.candidates,
            indptr=self.indptr,
            indices=self.indices,
            blocks=self.blocks,
        )
        return stream.getvalue()


def chunk_from_bytes(content: bytes) -> Chunk:
    """Read what `Chunk.as_bytes` made."""
    with np.load(io.BytesIO(content), allow_pickle=False) as stored:
        return Chunk(*(stored[name] for name in ("candidates", "indptr", "indices", "blocks")))


class ChunkStore:
    """Keep chunks 0 … n − 1 of one computation in a folder.

    `key` says what they are made from, whatever JSON can hold: chunks of another key do not count.
    """

    def __init__(self, folder: Path, key: Mapping[str, Any]) -> None:
        """Make the folder if it is not there; nothing is read yet."""
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        text = json.dumps({"version": VERSION, **key}, sort_keys=True, allow_nan=False)
        self.key = hashlib.sha256(text.encode()).hexdigest()

    def missing(self, n: int) -> list[int]:
        """List the chunks that have yet to be computed: not there, of another key, or damaged."""
        return [i for i in range(n) if self._content(i) is None]

    def write(self, number: int, content: bytes) -> None:
        """Store a chunk's bytes; the record that makes them count is moved into place last."""
        record = {"key": self.key, "sha256": hashlib.sha256(content).hexdigest()}
        write_files(
            self.folder,
            {_data(number): content, _record(number): json.dumps(record) + "\n"},
        )

    def read(self, number: int) -> Chunk:
        """Read a chunk.

        Raises:
            ValueError: naming the file, if it is not there, of another key or damaged.
        """
        content = self._content(number)
        if content is None:
            raise ValueError(f"{self.folder / _data(number)}: no chunk of this computation is here")
        return chunk_from_bytes(content)

    def chunks(self, n: int) -> Iterator[Chunk]:
        """Read chunks 0 … n − 1, one after the other."""
        for number in range(n):
            yield self.read(number)

    def _content(self, number: int) -> bytes | None:
        try:
            record = json.loads((self.folder / _record(number)).read_text(encoding="utf-8"))
            if record["key"] != self.key:
                return None
            content = (self.folder / _data(number)).read_bytes()
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return content if hashlib.sha256(content).hexdigest() == record["sha256"] else None


def fill(
    store: ChunkStore,
    n: int,
    compute: Callable[[list[int]], Iterator[tuple[int, bytes]]],
    progress: Callable[[str, float | None], None],
) -> int:
    """Have `compute` make the chunks that are missing, store each as it comes; return how many."""
    missing = store.missing(n)
    for done, (number, content) in enumerate(compute(missing), start=1):
        store.write(number, content)
        progress(f"information: chunk {done} of {len(missing)}", done / len(missing))
    return len(missing)


def gather(store: ChunkStore, n: int) -> Chunk:
    """Join all chunks into one, reading them twice rather than holding them twice."""
    sizes = [(len(chunk.candidates), chunk.blocks.shape) for chunk in store.chunks(n)]
    rows, entries = sum(size for size, _ in sizes), sum(shape[0] for _, shape in sizes)
    width = sizes[0][1][1] if sizes else 1
    whole = Chunk(
        np.empty(rows, np.int64),
        np.zeros(rows + 1, np.int64),
        np.empty(entries, np.int32),
        np.empty((entries, width), np.float32),
    )
    row = entry = 0
    for chunk in store.chunks(n):
        more, many = len(chunk.candidates), len(chunk.indices)
        whole.candidates[row : row + more] = chunk.candidates
        whole.indptr[row + 1 : row + more + 1] = chunk.indptr[1:] + entry
        whole.indices[entry : entry + many] = chunk.indices
        whole.blocks[entry : entry + many] = chunk.blocks
        row, entry = row + more, entry + many
    return whole


def _data(number: int) -> str:
    return f"chunk-{number:05d}.npz"


def _record(number: int) -> str:
    return f"chunk-{number:05d}.json"
