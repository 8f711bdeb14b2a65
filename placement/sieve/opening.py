"""The arcs of a long line that first-order paths at a price leave, without a table of all pairs.

Most pairs of ten thousand cameras and more are hopeless, and known to be without their gain: no
camera gains more than it does alone. So the best path into each camera asks for the gain of an arc
only where that might be a better way in, the arcs themselves only where the best path through them
might be worth it. Paths through every sixteenth camera come first, to have something to compare
with. Gains of cameras whose windows meet take a hundred times as long as others: they are kept.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from models.geometry import FloatArray, IntArray
from placement.tempered import paths
from placement.tempered.bound import Tempered
from placement.tempered.gains import gains_given, rounded_up
from placement.tempered.line import ArcsOut, may_follow
from placement.tempered.process import Cameras

BATCH = 32  # cameras whose arcs are looked at together
ROWS = 1024  # of known arcs, between two looks at the clock
THIN = 16
MOST_MEETINGS = 100_000_000  # gains of cameras whose windows meet: 400 MB
MORE = 1.0 + 1e-8  # no gain is more than this times that alone, before it is rounded up


class View(NamedTuple):
    """What is asked about the cameras of a line; `placement.tempered.gains` has the first four."""

    rows: FloatArray
    alone: FloatArray
    extra: FloatArray
    weight: float
    most: FloatArray  # (n,) what each gains at most, with its weight
    group: IntArray  # (n,) and past which position nobody may follow
    stop: IntArray
    met_at: IntArray  # (n + 1,) gains given each camera, of the next one, the one after it, …
    met: NDArray[np.float32]  # NaN where nobody has asked


def gains_along(first: Tempered, arcs: ArcsOut) -> NDArray[np.float32]:
    """Return the first-order gain of each arc (m,)."""
    (d,) = first.drives
    found = np.zeros(len(arcs.target), dtype=np.float32)
    n = len(arcs.out_of) - 1
    for begin in range(0, n, ROWS):
        paths.stop_in_time(first.run)
        _fill_gains(
            d.process, d.narrow, d.rows, d.piece, d.extra, d.weight, arcs, begin,
            min(begin + ROWS, n), found,
        )  # fmt: skip
    return found


class Opening:
    """Paths through all cameras of a line that nobody has looked at; on a single drive."""

    def __init__(self, first: Tempered) -> None:
        """Make room for the gains of cameras that meet."""
        (d,) = first.drives
        line = first.line
        met_at = _places_of_meetings(d.narrow)
        met = np.full(int(met_at[-1]), np.nan, dtype=np.float32)
        most = d.weight * (d.piece + d.extra) * MORE + 1e-8
        view = View(d.rows, d.piece, d.extra, d.weight, most, line.group, line.stop, met_at, met)
        self._first = first
        self._seen = d.process, d.narrow, view
        self._buffer = np.empty((BATCH, line.candidate.size), dtype=np.float32)

    def into_each(self, price: float) -> tuple[FloatArray, IntArray]:
        """Return the best first-order path into each camera (n,) at a price, and its cameras."""
        first, n = self._first, self._first.line.candidate.size
        into = first.alone - price
        before = np.full(n, -1)
        for thin in (THIN, 1):
            for begin in range(0, n, BATCH * thin):
                paths.stop_in_time(first.run)
                first.run.progress(f"paths into camera {begin} of {n}", None)
                end = min(begin + BATCH * thin, n)
                _go_on(*self._seen, price, begin, end, thin, into, before, self._buffer)
        return into, _count(before)

    def arcs_worth(
        self, into: FloatArray, price: float, need: float, most: int
    ) -> tuple[ArcsOut, NDArray[np.float32]] | None:
        """Return the arcs on paths that come to `need` at a price, and their gains (m,).

        `into` (n,) are the best paths into each camera at that price; None if over `most` are left.
        """
        first, n = self._first, self._first.line.candidate.size
        beyond = first.ends.copy()
        counts = np.zeros(n, dtype=np.int64)
        targets: list[NDArray[np.int32]] = []
        gains: list[NDArray[np.float32]] = []
        for begin in range((n - 1) // BATCH * BATCH, -1, -BATCH):
            paths.stop_in_time(first.run)
            first.run.progress(f"arcs worth it, before camera {begin} of {n}", None)
            end = min(begin + BATCH, n)
            _look_back(*self._seen, price, need, begin, end, into, beyond, self._buffer)
            row, column = np.nonzero(self._buffer[: end - begin] > -np.inf)
            most -= len(row)
            if most < 0:
                return None
            counts[begin:end] = np.bincount(row, minlength=end - begin)
            targets.append(column.astype(np.int32))
            gains.append(self._buffer[row, column])
        out_of = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        return ArcsOut(out_of, np.concatenate(targets[::-1])), np.concatenate(gains[::-1])


def _places_of_meetings(cameras: Cameras) -> IntArray:
    """Return where gains given each camera lie (n + 1,), of all up to the last one it meets."""
    n = cameras.first.size
    # the last position that begins by each sample
    by_sample = np.full(int(cameras.first.max(initial=0)) + 1, -1)
    np.maximum.at(by_sample, cameras.first, np.arange(n))
    latest = np.maximum.accumulate(by_sample)
    seen = np.where(cameras.last >= 0, np.minimum(cameras.last, latest.size - 1), 0)
    many = np.where(cameras.last >= 0, np.maximum(latest[seen] - np.arange(n), 0), 0)
    if many.sum() > MOST_MEETINGS:
        many[:] = 0
    return np.concatenate([[0], np.cumsum(many)]).astype(np.int64)


@njit(cache=True, parallel=True)
def _fill_gains(process, cameras, rows, alone, extra, weight, arcs, begin, end, found):  # type: ignore[no-untyped-def]
    for a in prange(begin, end):
        _fill_row(a, process, cameras, rows, alone, extra, weight, arcs, found)


@njit(cache=True)
def _fill_row(a, process, cameras, rows, alone, extra, weight, arcs, found):  # type: ignore[no-untyped-def]
    begin, end = arcs.out_of[a], arcs.out_of[a + 1]
    if begin == end:
        return
    stop = np.int64(arcs.target[end - 1]) + 1
    wanted, gains = np.zeros(stop, np.bool_), np.empty(stop)
    for e in range(begin, end):
        wanted[arcs.target[e]] = True
    gains_given(a, process, cameras, rows, alone, extra, wanted, stop, gains)
    for e in range(begin, end):
        found[e] = _stored(cameras, weight, gains, arcs.target[e])


@njit(cache=True, inline="always")
def _stored(cameras, weight, gains, b):  # type: ignore[no-untyped-def]
    """Return b's gain as it is kept; the blind gain nothing, not even by rounding."""
    return rounded_up(weight * gains[b]) if cameras.last[b] >= 0 else np.float32(0.0)


@njit(cache=True)
def _go_on(process, cameras, view, price, begin, end, step, into, before, buffer):  # type: ignore[no-untyped-def]
    """Better `into` (n,) by paths on from every `step`-th camera of begin … end − 1.

    `before` (n,) is the camera that the best path comes from, −1 for none.
    """
    n = into.size
    wanted, gains = np.zeros(end, np.bool_), np.empty(end)
    row = np.empty(end, np.float32)
    bar = -into
    for a in range(begin, end, step):
        if into[a] > -np.inf:
            now = into[a] - price
            _ask(a, a + 1, end, process, cameras, view, now, bar, 0.0, wanted, gains, row)
            for b in range(a + 1, end):
                if now + row[b] > into[b]:
                    into[b], before[b] = now + row[b], a
    _ask_all(begin, end, step, process, cameras, view, price, into, -into, 0.0, buffer)
    for a in range(begin, end, step):
        row = buffer[(a - begin) // step]
        for b in range(end, n):
            if into[a] - price + row[b] > into[b]:
                into[b], before[b] = into[a] - price + row[b], a


@njit(cache=True)
def _count(before):  # type: ignore[no-untyped-def]
    cameras = np.ones(before.size, np.int64)
    for b in range(before.size):
        if before[b] >= 0:
            cameras[b] = cameras[before[b]] + 1
    return cameras


@njit(cache=True)
def _look_back(process, cameras, view, price, need, begin, end, into, beyond, buffer):  # type: ignore[no-untyped-def]
    """Fill `buffer` (·, n) with the gains of arcs worth it out of begin … end − 1, else −∞.

    Those are on paths that come to `need`; betters `beyond` (n,) by them.
    """
    n = into.size
    _ask_all(begin, end, 1, process, cameras, view, price, into, beyond, need, buffer)
    wanted, gains = np.zeros(end, np.bool_), np.empty(end)
    for a in range(end - 1, begin - 1, -1):
        row = buffer[a - begin]
        row[: a + 1] = -np.inf
        now = into[a] - price
        _ask(a, a + 1, end, process, cameras, view, now, beyond, need, wanted, gains, row)
        for b in range(a + 1, n):
            if now + row[b] + beyond[b] >= need:
                beyond[a] = max(beyond[a], row[b] - price + beyond[b])
            else:
                row[b] = -np.inf


@njit(cache=True, parallel=True)
def _ask_all(begin, end, step, process, cameras, view, price, into, more, need, buffer):  # type: ignore[no-untyped-def]
    """Ask given every `step`-th camera of begin … end − 1 about those from `end` on, a row each."""
    for number in prange((end - begin + step - 1) // step):
        a = begin + number * step
        n = into.size
        _ask(
            a, end, n, process, cameras, view, into[a] - price, more, need,
            np.zeros(n, np.bool_), np.empty(n), buffer[number],
        )  # fmt: skip


@njit(cache=True)
def _ask(a, low, high, process, cameras, view, now, more, need, wanted, gains, row):  # type: ignore[no-untyped-def]
    """Fill `row` with the gains given a of those b in low … high − 1 that may be worth it, else −∞.

    Of those may be who lift `now`, together with `more` (n,), to `need`; `wanted` and `gains`
    (high,) are room to work in, the first false everywhere.
    """
    some = False
    meeting = view.met[view.met_at[a] : view.met_at[a + 1]]  # of a + 1 and those behind it
    for b in range(low, high):
        row[b] = -np.inf
        enough = now + view.most[b] + more[b] >= need
        if enough and may_follow(view.group, view.stop, a, b):
            place = b - a - 1
            if place < meeting.size and meeting[place] == meeting[place]:
                row[b] = meeting[place]
            else:
                wanted[b] = some = True
    if not some:
        return
    gains_given(a, process, cameras, view.rows, view.alone, view.extra, wanted, high, gains)
    for b in range(low, high):
        if wanted[b]:
            row[b] = _stored(cameras, view.weight, gains, b)
            wanted[b] = False
            if b - a - 1 < meeting.size:
                meeting[b - a - 1] = row[b]
