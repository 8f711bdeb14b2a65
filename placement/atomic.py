"""Write files whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from placement.interrupts import held_back

Content = str | bytes | Callable[[Path], object]


def prepare_folder(folder: Path) -> None:
    """Make `folder` and prove that it can be written, before any long work starts.

    Raises:
        ValueError: naming the folder and the reason, if it cannot.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        reason = error.strerror or str(error)
        raise ValueError(
            f"--out must be a folder that can be written, got {folder} ({reason})"
        ) from None


@contextmanager
def prepared_folder(folder: Path) -> Iterator[None]:
    """Prepare `folder` for the block; one that fails leaves no empty folder that was not there.

    Raises:
        ValueError: as `prepare_folder` does.
    """
    missing = [each for each in (folder, *folder.parents) if not os.path.lexists(each)]
    try:
        prepare_folder(folder)
        yield
    except BaseException:
        new = folder in missing and os.path.isdir(folder)  # noqa: PTH112 - no error for any name
        inside = list(folder.iterdir()) if new else []
        for each in (*inside, *missing):
            with suppress(OSError):  # it holds something, is a file, or was never made
                each.rmdir()
        raise


def write_files(
    folder: Path, contents: Mapping[str, Content], *, remove: Iterable[str] = ()
) -> None:
    """Write every file of `contents` (name → text, bytes, or a function that writes a path).

    All of them are staged beside their destination first, so an error or an interrupt while
    they are made leaves `folder` as it was; only then is each moved into place, atomically.
    Files named in `remove` go just before, if they are there.
    """
    prepare_folder(folder)
    stage = Path(tempfile.mkdtemp(prefix=".staging-", dir=folder))
    try:
        for name, content in contents.items():
            path = stage / name
            if callable(content):
                content(path)
            elif isinstance(content, bytes):
                path.write_bytes(content)
            else:
                path.write_text(content, encoding="utf-8")
        with held_back():
            for name in remove:
                (folder / name).unlink(missing_ok=True)
            for name in contents:
                (stage / name).replace(folder / name)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
