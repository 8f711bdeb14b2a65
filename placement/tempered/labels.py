"""Gains given a camera and all that came before it, which labels stand for.

A label of camera j is a covariance U at j's first sample that is above, in the Loewner order, what
any path that it stands for leaves there. So the gain of k given j and the whole of such a path is
at most its gain given j for a car that comes with U: measurements of the path after that sample
are left out of the condition, and conditioning on less, or on a car that knows less, only raises a
gain. Labels are passed on from camera to camera in the order of the line, and where the labels of
several paths meet they are replaced by one above them all. Paths that cannot lead to
anything worth having are not passed on, so that labels stand for the others only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from models.geometry import FloatArray
from placement.diagram.order import above, below
from placement.objectives.windows.filter import put6, row6
from placement.tempered.crossings import ROW, cross, run_through, work_space, worth
from placement.tempered.gains import ahead_of, rounded_up, set_covariance
from placement.tempered.process import carry, predict_ahead, prior_at

EMPTY = -1.0  # in place of a variance: nothing has been passed on to the label


class Labels(NamedTuple):
    """All labels of all cameras: covariances (s, 6) as of `pass_labels`, and best paths (s,)."""

    entry: FloatArray
    early: FloatArray
    so_far: FloatArray


class Hope(NamedTuple):
    """What each camera costs, what may come beyond it (n,), and what all must be worth.

    Paths are told apart by `grades` of the `span` by which they may exceed that. `spare`: see
    `pass_on`.
    """

    price: float
    beyond: FloatArray
    need: float
    span: float
    grades: int
    spare: float


@njit(cache=True)
def pass_on(labels, at, p, spare, m, v):  # type: ignore[no-untyped-def]
    """Let label `at` of `labels` (s, 6) stand for covariance `p` (6,), too.

    What changes is made larger by a share `spare`, so that what comes next and is much the same is
    below it at once.
    """
    if labels[at, 0] == EMPTY:
        put6(labels, at, p)
        return
    kept = row6(labels, at)
    if below(p, kept, 1.0):
        return
    u = p if below(kept, p, 1.0) else above(kept, p, m, v)
    f = 1.0 + spare
    put6(labels, at, (f * u[0], f * u[1], f * u[2], f * u[3], f * u[4], f * u[5]))


@njit(cache=True)
def car_at(process, t, by, first, last, early, entry, early_at):  # type: ignore[no-untyped-def]
    """Return the covariance (6,) at sample t, before its measurements, of a car with camera j.

    `by` (samples, 6) holds it after each sample from `first` on, `entry` before j's first, `early`
    at sample `early_at` before that; still earlier nobody is known to have looked.
    """
    if t > last:
        return row6(by, t)
    if t > first:
        return ahead_of(process, row6(by, t - 1), t)
    if t == first:
        return entry
    if t < early_at:
        return prior_at(process, t)
    return carry(process, early, early_at, t)


@njit(cache=True)
def pass_labels(  # type: ignore[no-untyped-def]
    process,
    cameras,
    rows,
    alone,
    extra,
    weight,
    single,
    fresh,
    pairs,
    layout,
    early_at,
    hope,
    nodes,
    labels,
    gains,
):
    """Add `weight` times the gains of each camera's followers to `gains`, for j in `nodes`.

    The labels of j are the rows `layout.state_of[j]` … of `labels.entry` and `labels.early` (s, 6),
    at j's first sample and at `early_at[j]`, the first of any that may follow; the first of them
    stands for the path that begins with j. Gains are no more than `pairs` (n, n). `rows`, `alone`,
    `extra`: as for pairs. `layout.leads` is filled on the first drive (`fresh`).

    `labels.so_far` (s,) is the best of any path into a label, each camera at a price: an arc on
    from it is left out, at −∞, where even with the best `hope.beyond` it falls short of
    `hope.need`. Where there is a `single` drive the gains themselves count, else `pairs`.
    """
    out_of, target = layout.out_of, layout.target
    state_of, gain_at = layout.state_of, layout.gain_at
    first, last = cameras.first, cameras.last
    samples = process.prior.shape[0]
    most = 1
    for j in nodes:
        most = max(most, state_of[j + 1] - state_of[j])
    by = np.empty((most, samples, 6))
    scratch = np.empty(ROW), np.empty((3, 3)), np.empty((3, 3))
    for j in nodes:
        begin, end = out_of[j], out_of[j + 1]
        low, n_labels = state_of[j], state_of[j + 1] - state_of[j]
        if begin == end or np.max(labels.so_far[low : low + n_labels]) == -np.inf:
            for m in range(begin, end):
                gains[gain_at[m] : gain_at[m + 1]] = -np.inf
            continue
        if last[j] >= 0:
            put6(labels.entry, low, prior_at(process, first[j]))
            put6(labels.early, low, prior_at(process, early_at[j]))
            farthest = last[j]
            for m in range(begin, end):
                farthest = max(farthest, first[target[m]])
            _run_labels(j, process, cameras, labels, low, n_labels, farthest, by)
        for m in range(begin, end):
            _gains_of_arc(
                j, m, process, cameras, rows, alone, extra, weight, single, fresh, pairs, layout,
                early_at, hope, labels, by, scratch, gains,
            )  # fmt: skip


@njit(cache=True)
def _run_labels(j, process, cameras, labels, low, n_labels, farthest, by):  # type: ignore[no-untyped-def]
    p = cameras.offsets.shape[2]
    space, none = work_space(1, p), np.empty((3 + p, 0))
    one = np.array([j])
    first, last = cameras.first[j], cameras.last[j]
    for c in range(n_labels):
        if labels.so_far[low + c] == -np.inf:
            continue
        set_covariance(space[0], row6(labels.entry, low + c))
        run_through(process, cameras, one, first, last, space, none, by[c])
        predict_ahead(process, row6(by[c], last), last, farthest, by[c])


@njit(cache=True)
def _gains_of_arc(  # type: ignore[no-untyped-def]
    j, e, process, cameras, rows, alone, extra, weight, single, fresh, pairs, layout,
    early_at, hope, labels, by, scratch, gains,
):  # fmt: skip
    k = layout.target[e]
    low = layout.state_of[j]
    first_j, last_j, first_k, last_k = (
        cameras.first[j], cameras.last[j], cameras.first[k], cameras.last[k],
    )  # fmt: skip
    meets = last_j >= 0 and last_k >= 0 and first_k <= last_j
    s = min(first_j, first_k)
    row, mm, vv = scratch
    crossed = False
    # what a path into j must be worth for the arc to k to be any use
    least = hope.need - hope.beyond[k] + hope.price
    for c in range(layout.state_of[j + 1] - low):
        at, so_far = layout.gain_at[e] + c, labels.so_far[low + c]
        if gains[at] == -np.inf:
            continue
        if so_far + pairs[j, k] < least or so_far == -np.inf:
            gains[at] = -np.inf
            continue
        gain = alone[k]
        at_k = at_0 = prior_at(process, first_k)
        if last_j < 0:
            at_0 = prior_at(process, early_at[k])
        elif last_k >= 0:
            e_j = e_0 = row6(labels.entry, low + c)
            if early_at[j] < first_j:
                e_0 = row6(labels.early, low + c)
            at_k = at_0 = car_at(process, first_k, by[c], first_j, last_j, e_0, e_j, early_at[j])
            if early_at[k] < first_k:
                at_0 = car_at(process, early_at[k], by[c], first_j, last_j, e_0, e_j, early_at[j])
            if meets:
                if not crossed:
                    two = np.array([j, k])
                    space = work_space(2, cameras.offsets.shape[2])
                    cross(process, cameras, two, s, max(last_j, last_k), space, row)
                    crossed = True
                p_j = e_j if s == first_j else at_k
                gain = worth(p_j, row) - worth(carry(process, p_j, s, first_j), rows[j])
            else:
                gain = worth(at_k, rows[k])
            if not gain <= alone[k]:  # nor where it is no number
                gain = alone[k]
        gain = max(gain, 0.0) + extra[k] if last_k >= 0 else 0.0
        total = min(rounded_up(np.float64(gains[at]) + weight * gain), pairs[j, k])
        so_far += np.float64(total) if single else np.float64(pairs[j, k])
        if so_far < least:
            gains[at] = -np.inf
            continue
        gains[at] = total
        if fresh:
            # how much of what may be wasted has not been
            grade = 0
            if hope.grades > 1:
                grade = min(int(hope.grades * (so_far - least) / hope.span), hope.grades - 1)
            layout.leads[at] = layout.base[e] + grade
        into = layout.state_of[k] + layout.leads[at]
        labels.so_far[into] = max(labels.so_far[into], so_far - hope.price)
        pass_on(labels.entry, into, at_k, hope.spare, mm, vv)
        if early_at[k] < first_k:
            pass_on(labels.early, into, at_0, hope.spare, mm, vv)
