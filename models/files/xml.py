"""Read XML that a stranger wrote: element by element, no entities, bounded depth and size."""

from __future__ import annotations

import gzip
import io
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, cast

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

MOST_BYTES = 32 << 30  # of text: a country's network has a tenth of it
MOST_DEPTH = 64
SURE_BYTES = 128 << 20  # up to here any compression will do; beyond ...
MOST_RATIO = 100  # ... networks pack 8 to 20 times, bombs a thousand
MOST_TOKEN_BYTES = 64 << 20  # one tag: the shape of a lane with a million points has 16 MB
MOST_ELEMENTS = 4_000_000  # within one child of the root
_CHUNK = 1 << 16


def stream_elements(path: str | Path, root: str) -> Iterator[Element]:
    """Yield the root element, still empty but for its attributes, then each child when it is whole.

    The file may be gzipped, whatever its name. A child is forgotten once the next one is asked for,
    so a file of any length needs little memory.

    Raises:
        ValueError: one line that names the file: it cannot be read, is empty, is not XML, has
            another root than `root`, declares a document type or entities, nests deeper than 64
            elements, ends early, or unpacks to more than a file of its size would.
    """
    from xml.etree.ElementTree import ParseError, XMLPullParser

    from defusedxml.common import DefusedXmlException
    from defusedxml.ElementTree import XMLParser

    path = Path(path)
    parser = XMLPullParser(
        ("start", "end"),
        _parser=XMLParser(forbid_dtd=True, forbid_entities=True, forbid_external=True),
    )
    depth, within, top = 0, 0, None
    try:
        with _opened(path) as file:
            fed = quiet = 0
            while chunk := file.read(_CHUNK):
                fed += len(chunk)
                if fed > MOST_BYTES:
                    raise ValueError(f"{path}: must be at most {MOST_BYTES >> 30} GB of XML")
                parser.feed(chunk)
                quiet += len(chunk)
                for event, element in cast("Iterator[tuple[str, Element]]", parser.read_events()):
                    quiet = 0
                    if event == "start":
                        depth, within = depth + 1, within + 1
                        if within > MOST_ELEMENTS:
                            raise ValueError(
                                f"{path}: <{top.tag if top is not None else root}> must hold no "
                                f"element of more than {MOST_ELEMENTS:,} elements"
                            )
                        if depth > MOST_DEPTH:
                            raise ValueError(
                                f"{path}: elements must be nested at most {MOST_DEPTH} deep"
                            )
                        if top is None:
                            top = element
                            if _local(element.tag) != root:
                                raise ValueError(
                                    f"{path}: must hold <{root}>, got <{_local(element.tag)[:40]}>"
                                )
                            yield element
                        continue
                    depth -= 1
                    if depth == 1 and top is not None:
                        within = 0
                        if top.tag != root:  # a namespace: the names alone are what counts
                            for each in element.iter():
                                each.tag = _local(each.tag)
                        yield element
                        top.clear()
                if quiet > MOST_TOKEN_BYTES:
                    raise ValueError(f"{path}: one tag must have at most 64 MB")
            if not fed:
                raise ValueError(f"{path}: must hold <{root}>, the file is empty")
            parser.close()
    except DefusedXmlException:
        raise ValueError(
            f"{path}: XML must not declare a document type, entities or outside files"
        ) from None
    except ParseError as error:
        raise ValueError(f"{path}: not XML, or it ends early ({error})") from None
    except RecursionError:
        raise ValueError(f"{path}: elements must be nested at most {MOST_DEPTH} deep") from None
    except EOFError:
        raise ValueError(f"{path}: the gzip file ends early") from None
    except (gzip.BadGzipFile, zlib.error) as error:
        raise ValueError(f"{path}: damaged gzip file ({error})") from None
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror or error}") from None


def _local(tag: str) -> str:
    """Drop a namespace."""
    return tag.rpartition("}")[2]


class _Bounded(io.RawIOBase):
    """Unpack a gzip file, and stop when it grows beyond what networks do."""

    def __init__(self, path: Path) -> None:
        self._file = gzip.open(path, "rb")  # noqa: SIM115 (closed with this object)
        self._packed = max(path.stat().st_size, 1)
        self._path, self._read = path, 0

    def read(self, size: int = -1, /) -> bytes:
        data = self._file.read(size)
        self._read += len(data)
        if self._read > SURE_BYTES and self._read > MOST_RATIO * self._packed:
            raise ValueError(
                f"{self._path}: must unpack to at most {MOST_RATIO} times its {self._packed:,} "
                "bytes: looks like a gzip bomb"
            )
        return data

    def close(self) -> None:
        self._file.close()
        super().close()


def _opened(path: Path) -> BinaryIO:
    """Open a file, unpacking it if it starts as gzip does."""
    file = path.open("rb")
    packed = file.read(2) == b"\x1f\x8b"
    file.seek(0)
    if not packed:
        return file
    file.close()
    return cast("BinaryIO", _Bounded(path))
