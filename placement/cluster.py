"""Where work runs: here, in processes of this machine, or on a Dask cluster that exists.

Work is a function of a module and a list of tasks, each a picklable value that needs nothing else;
its results do not depend on where, in which order, or how many at a time they are computed. Serial
is the default and needs neither processes nor Dask.

A process that dies takes its task back to the queue. Who was in flight with it may have killed it,
so each of those runs alone until it is done or has killed three processes: then it is named.
"""

from __future__ import annotations

import importlib
import multiprocessing
import os
import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import Any, Protocol, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

ATTEMPTS = 3
_PATIENCE_S = 10.0  # for a scheduler to answer
_SCHEMES = ("tcp", "tls", "ucx", "ws", "wss", "inproc")  # of the addresses that Dask knows


class Work(Protocol):
    """A place that runs tasks."""

    def run(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], name: str
    ) -> Iterator[tuple[int, Result]]:
        """Yield (i, function(tasks[i])) as they come, each i once; `name` is for messages.

        Raises:
            ValueError: naming a task that killed three workers in a row.
        """

    def close(self) -> None:
        """Let processes and connections go."""


class Serial:
    """Run tasks here, one after the other."""

    def run(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], name: str
    ) -> Iterator[tuple[int, Result]]:
        """See `Work`."""
        del name  # nothing can die here but the program
        for i in range(len(tasks)):
            yield i, function(tasks[i])

    def close(self) -> None:
        """See `Work`."""


class Threads:
    """Run tasks in `workers` threads of this process: for kernels that hold no lock."""

    def __init__(self, workers: int) -> None:
        """Start nothing yet."""
        self.workers = workers

    def run(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], name: str
    ) -> Iterator[tuple[int, Result]]:
        """See `Work`; tasks are fetched as there is room for them."""
        del name  # nothing can die here but the program
        following = iter(range(len(tasks)))
        running: dict[Future[Result], int] = {}
        with ThreadPoolExecutor(self.workers) as pool:
            for i in islice(following, self.workers):
                running[pool.submit(function, tasks[i])] = i
            while running:
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    i = running.pop(future)
                    for other in islice(following, 1):
                        running[pool.submit(function, tasks[other])] = other
                    yield i, future.result()

    def close(self) -> None:
        """See `Work`."""


class Processes:
    """Run tasks in `workers` processes of this machine."""

    def __init__(self, workers: int) -> None:
        """Start nothing yet."""
        if workers < 1:
            raise ValueError(f"--workers must be at least 1, got {workers}")
        self.workers = workers
        self._pool: ProcessPoolExecutor | None = None

    def run(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], name: str
    ) -> Iterator[tuple[int, Result]]:
        """See `Work`; tasks are fetched as there is room for them, so a lazy sequence stays so."""
        attempts = [0] * len(tasks)
        waiting = list(range(len(tasks) - 1, -1, -1))  # taken from the end
        suspects: list[int] = []
        running: dict[Future[Any], int] = {}
        try:
            while waiting or suspects or running:
                if suspects and not running:
                    self._submit(running, function, tasks, suspects.pop())
                while not suspects and waiting and len(running) < self.workers:
                    if any(attempts[i] for i in running.values()):
                        break  # a suspect is running, alone
                    self._submit(running, function, tasks, waiting.pop())
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                broken = [future for future in done if _died(future)]
                for future in done:
                    if future not in broken:
                        yield running.pop(future), future.result()
                if broken:
                    self._restart()
                    for i in sorted(running.values(), reverse=True):
                        attempts[i] += 1
                        if attempts[i] >= ATTEMPTS:
                            raise ValueError(
                                f"{name}: task {i} killed a worker {ATTEMPTS} times: out of "
                                "memory? Nothing else was running in the last two"
                            )
                        suspects.append(i)
                    running.clear()
        finally:
            for future in running:
                future.cancel()

    def close(self) -> None:
        """See `Work`."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
            self._pool = None

    def _submit(
        self,
        running: dict[Future[Any], int],
        function: Callable[[Any], Any],
        tasks: Sequence[Any],
        i: int,
    ) -> None:
        task = tasks[i]
        for _ in range(2):  # a pool may have broken while nobody looked
            if self._pool is None:
                # Spawned: forking a process that has threads of compiled code is not safe.
                context = multiprocessing.get_context("spawn")
                self._pool = ProcessPoolExecutor(self.workers, mp_context=context)
            try:
                running[self._pool.submit(function, task)] = i
            except BrokenProcessPool:
                self._restart()
            else:
                return

    def _restart(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = None


class DaskCluster:
    """Run tasks on the Dask cluster whose scheduler is at `address`."""

    def __init__(self, address: str) -> None:
        """Connect.

        Raises:
            ValueError: if Dask is not installed, or nobody answers at the address.
        """
        if "://" in address and address.partition("://")[0] not in _SCHEMES:
            # Dask would say so in pages, twenty seconds later
            raise ValueError(f"--cluster must begin with tcp:// or tls://, got {address}")
        if not re.search(r":\d+/?$", address) and not address.startswith("inproc"):
            raise ValueError(
                f"--cluster must be the address of a Dask scheduler, with its port, got {address}"
            )
        try:
            distributed = _distributed()
        except ImportError:
            raise ValueError(
                "--cluster needs Dask: install the extra `cluster` (dask and distributed)"
            ) from None
        security = _security(address)
        try:
            self._client = distributed.Client(
                address, timeout=_PATIENCE_S, set_as_default=False, security=security
            )
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            reason = " ".join(str(error).split())[:120] or type(error).__name__
            raise ValueError(
                f"--cluster must be the address of a Dask scheduler that answers, got {address} "
                f"({reason})"
            ) from None

    def run(
        self, function: Callable[[Task], Result], tasks: Sequence[Task], name: str
    ) -> Iterator[tuple[int, Result]]:
        """See `Work`; the scheduler brings a dead worker's tasks to another."""
        distributed = _distributed()
        ahead = 2 * max(1, len(self._client.scheduler_info(n_workers=-1)["workers"])) + 2
        following = iter(range(len(tasks)))
        running: dict[Any, int] = {}
        queue = distributed.as_completed(loop=self._client.loop)

        def submit() -> None:
            for i in following:
                future = self._client.submit(
                    function, tasks[i], pure=False, key=f"{name}-{i}-{id(queue):x}"
                )
                running[future] = i
                queue.add(future)
                return

        for _ in range(ahead):
            submit()
        while running:
            future = next(queue)
            i = running.pop(future)
            try:
                result = future.result()
            except distributed.KilledWorker as error:
                raise ValueError(
                    f"{name}: task {i} killed every worker it was given to: out of memory? "
                    f"({' '.join(str(error).split())[:200]})"
                ) from None
            yield i, result
            future.release()
            submit()

    def close(self) -> None:
        """See `Work`: the cluster itself stays."""
        self._client.close()


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def work_at(workers: int | None = None, cluster: str | None = None) -> Work:
    """Return where work runs: here, in `workers` processes, or at the address `cluster`.

    Raises:
        ValueError: if both are given, or as the place's own constructor does.
    """
    if cluster is not None:
        if workers is not None:
            raise ValueError("--workers and --cluster must not both be given")
        return DaskCluster(cluster)
    return Serial() if workers is None else Processes(workers)


@contextmanager
def working(workers: int | None = None, cluster: str | None = None) -> Iterator[Work | None]:
    """Give `work_at`'s place for the block that follows; None where neither is asked for."""
    if workers is None and cluster is None:
        yield None
        return
    work = work_at(workers, cluster)
    try:
        yield work
    finally:
        work.close()


def _died(future: Future[Any]) -> bool:
    return isinstance(future.exception(), BrokenProcessPool)


def _security(address: str) -> Any:
    """Return the certificates that Dask's own configuration names, for tls:// addresses."""
    if not address.startswith("tls://"):
        return None
    security = _distributed().Security()
    if security.get_connection_args("client").get("ssl_context") is None:
        raise ValueError(
            "--cluster tls://… needs certificates: set distributed.comm.tls.ca-file and "
            f"distributed.comm.tls.client.cert in Dask's configuration, got none for {address}"
        )
    return security


def _distributed() -> Any:
    """Import Dask's scheduler client, which has no types, only when a cluster is asked for."""
    return importlib.import_module("distributed")
