"""A study in parts: spread over processes, and each part kept as soon as it is done.

A part is a function of a module with arguments that can be pickled; what it returns is written as
JSON (tables included), whether it was computed just now or kept by a run that was stopped. So a
study writes the same bytes however often it was interrupted, and by however many processes.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import shutil
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.connection import wait
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pandas as pd

from placement.atomic import write_files
from placement.cluster import Processes, Serial, Work, work_at
from placement.interrupts import interrupts_by_name

Tell = Callable[[str, float], None]
MARK = "run.json"
_WATCH = "parent"


@dataclass(frozen=True, slots=True)
class Parts:
    """Where the parts of one study are computed, and the folder that keeps them (None: nowhere)."""

    work: Work = field(default_factory=Serial)
    folder: Path | None = None

    def compute(
        self, function: Callable[..., Any], arguments: Mapping[str, tuple[Any, ...]], tell: Tell
    ) -> list[Any]:
        """Return `function(*arguments[name])` for each name, in their order; names are unique.

        `tell(name, share)` hears of each part that is done. Raises KeyboardInterrupt at Ctrl-C,
        with the parts that were done kept and those under way given up.
        """
        done = {name: kept for name in arguments if (kept := self._kept(name)) is not None}
        missing = [name for name in arguments if name not in done]
        tasks = [(function, arguments[name]) for name in missing]
        with _interruptible(self.work) as check:
            for i, text in self.work.run(_part, tasks, "a part of the study"):
                check()
                done[missing[i]] = text
                if self.folder is not None:
                    write_files(self.folder, {_file(missing[i]): text})
                tell(missing[i], len(done) / len(arguments))
        return [json.loads(done[name], object_hook=_table) for name in arguments]

    def _kept(self, name: str) -> str | None:
        if self.folder is None:
            return None
        try:
            text = (self.folder / _file(name)).read_text(encoding="utf-8")
            json.loads(text)
        except (OSError, ValueError):
            return None
        return text


def work_for(workers: int) -> Work:
    """Return a place for `workers` parts at a time: this process for one."""
    return work_at(None if workers == 1 else workers)


def folder_for(folder: Path, mark: Mapping[str, Any]) -> Path:
    """Return `folder`, emptied if what it keeps is of another run than `mark` tells of."""
    wanted = json.dumps(mark, indent=2) + "\n"
    try:
        same = (folder / MARK).read_text(encoding="utf-8") == wanted
    except OSError:
        same = False
    if not same:
        shutil.rmtree(folder, ignore_errors=True)
        write_files(folder, {MARK: wanted})
    return folder


def _file(name: str) -> str:
    """Return a file name that no other part has: the name's letters, the others by number."""
    return re.sub(r"[^A-Za-z0-9.+-]", lambda m: f"_{ord(m[0]):x}", name) + ".json"


def _part(task: tuple[Callable[..., Any], tuple[Any, ...]]) -> str:
    """Compute one part on one thread: the other cores have other parts."""
    import numba

    function, arguments = task
    _serve()
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        return json.dumps(function(*arguments), default=_plain)
    finally:
        numba.set_num_threads(threads)


def _serve() -> None:
    """Leave Ctrl-C to the process that hands out the parts, and end when it does."""
    parent = multiprocessing.parent_process()
    if parent is None or any(thread.name == _WATCH for thread in threading.enumerate()):
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, name=_WATCH, daemon=True).start()


def _plain(value: Any) -> Any:
    """Give JSON what NumPy and pandas hold."""
    if isinstance(value, pd.DataFrame):
        content = value.to_dict("split")
        return {"columns": content["columns"], "rows": content["data"]}
    if isinstance(value, (np.integer, np.floating, np.bool_, np.ndarray)):
        return value.tolist()
    raise TypeError(f"a part may return numbers, words, lists and tables, got {type(value)}")


def _table(value: dict[str, Any]) -> Any:
    if value.keys() == {"columns", "rows"}:
        return pd.DataFrame(value["rows"], columns=value["columns"])
    return value


@contextmanager
def _interruptible(work: Work) -> Iterator[Callable[[], None]]:
    """Let Ctrl-C end the study here, not only the solver it happens to hit.

    A solver that is told to stop returns its best so far, which must not pass for a part's result:
    `check` raises what was swallowed.
    """
    asked = threading.Event()

    def ask(number: int, frame: FrameType | None) -> None:
        asked.set()
        signal.default_int_handler(number, frame)

    def check() -> None:
        if asked.is_set():
            raise KeyboardInterrupt

    mine = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if mine:
        signal.signal(signal.SIGINT, ask)
    try:
        with interrupts_by_name():
            yield check
    except KeyboardInterrupt:
        if isinstance(work, Processes):  # closing it waits for the parts under way
            for child in multiprocessing.active_children():
                child.terminate()
        work.close()
        raise
    finally:
        if mine:
            signal.signal(signal.SIGINT, signal.default_int_handler)
