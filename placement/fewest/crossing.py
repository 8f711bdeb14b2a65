"""One camera from its first sample to its last: the covariances after it, or that it is late."""

from __future__ import annotations

import numpy as np
from numba import njit

from placement.fewest.arrays import COUNTED, LEAN
from placement.objectives.windows.filter import predict, update
from placement.objectives.windows.offsets import (
    CAR_STATES,
    condition,
    enter_state,
    innovation,
    predict_state,
    set_initial,
    update_state,
)

AHEAD = 40.0  # metres over which the heading's variance is weighed when labels are ranked


@njit(cache=True, inline="always")
def worth(p):  # type: ignore[no-untyped-def]
    """Return the lateral variance some way ahead: what labels are ranked by."""
    return p[3] + 2.0 * AHEAD * p[4] + AHEAD * AHEAD * p[5]


@njit(**LEAN)
def move(p, step):  # type: ignore[no-untyped-def]
    """Return P one step on; compiled once, where `predict` would be at every use."""
    return predict(p, step)


@njit(**LEAN)
def one_step(p, base, j0, j1, j2):  # type: ignore[no-untyped-def]
    """Return P after one sample's measurements."""
    q0, q1, q2, q3, q4, q5, _ = update(p, base[0] + j0, base[1] + j1, base[2] + j2)
    return (q0, q1, q2, q3, q4, q5)


@njit(**LEAN)
def end_of(course, name):  # type: ignore[no-untyped-def]
    """Return the sample after the last of a camera, or of a second copy of it."""
    v = name % course.units.size
    return course.first[v] + course.ptr[v + 1] - course.ptr[v]


@njit(**LEAN)
def shares_mount(course, name, names, n):  # type: ignore[no-untyped-def]
    """Return whether a camera and one of n others, as they are, exclude each other."""
    for a in range(n):
        other = names[a]
        if course.owner[other] == course.owner[name]:
            return True
        if course.group[name] >= 0 and course.group[other] == course.group[name]:
            return True
    return False


@njit(**LEAN)
def told(course, name, t):  # type: ignore[no-untyped-def]
    """Return what a camera in view at t tells, or a second copy of it."""
    v = name % course.units.size
    e = course.ptr[v] + t - course.first[v]
    if name < course.units.size:
        return course.blocks[e, 0], course.blocks[e, 1], course.blocks[e, 2]
    return course.second[e, 0], course.second[e, 1], course.second[e, 2]


@njit(**LEAN)
def learn(m, n, j0, j1, j2, u, v):  # type: ignore[no-untyped-def]
    """Learn J about the position in a state (n, n) that carries offsets."""
    for i in range(n):
        u[0, i], u[1, i] = m[0, i], m[1, i]
    s00, s01, s11 = u[0, 0], u[0, 1], u[1, 1]
    _, a00, a01, a11 = innovation(s00, s01, s11, j0, j1, j2)
    condition(m, n, a00, a01, a11, u, v)


@njit(**COUNTED)
def alone_unsure(course, v, t, p):  # type: ignore[no-untyped-def]
    """Take camera v, its offsets unknown, from its first sample t to its last: (alive, P)."""
    offsets = course.offsets
    most = 3 + offsets.shape[2]
    m, u, w = np.zeros((most, most)), np.empty((2, most)), np.empty((2, most))
    set_initial(m, p)
    n = enter_state(m, CAR_STATES, offsets.shape[2], 1.0)
    i = course.who[v]
    e, end = course.indptr[i], course.indptr[i + 1]
    for s in range(t, t + course.ptr[v + 1] - course.ptr[v]):
        if s > t:
            predict_state(m, n, course.steps[s])
        b = course.base[s]
        if b[0] + b[2] > 0.0:
            learn(m, n, b[0], b[1], b[2], u, w)
        if e < end and course.indices[e] == s:
            update_state(m, n, CAR_STATES, course.white, offsets, course.frames, e, 1.0, u, w)
            e += 1
        if m[1, 1] > course.limit:
            return False, p
    return True, (m[0, 0], m[0, 1], m[0, 2], m[1, 1], m[1, 2], m[2, 2])


@njit(**LEAN)
def alone(course, v, t, p, past):  # type: ignore[no-untyped-def]
    """Take camera v from its first sample t to its last; return (alive, P, past) after that."""
    t_end, limit = course.steps.shape[0], course.limit
    dark = p
    if course.offsets.shape[2] and course.who[v] >= 0:
        alive, p = alone_unsure(course, v, t, p)
        if alive and course.failures:
            alive, past = alone_unsure(course, v, t, past)
        if not alive:
            return False, p, past
        stop = t + course.ptr[v + 1] - course.ptr[v]
        if course.failures:
            for s in range(t, stop):
                if s > t:
                    dark = move(dark, course.steps[s])
                dark = one_step(dark, course.base[s], 0.0, 0.0, 0.0)
                if dark[3] > limit:
                    return False, p, past
            if worth(dark) > worth(past):
                past = dark
        if stop < t_end:
            p = move(p, course.steps[stop])
            if course.failures:
                past = move(past, course.steps[stop])
        return True, p, past
    stop = t + course.ptr[v + 1] - course.ptr[v]
    e = course.ptr[v]
    for s in range(t, stop):
        j0, j1, j2 = course.blocks[e, 0], course.blocks[e, 1], course.blocks[e, 2]
        e += 1
        p = one_step(p, course.base[s], j0, j1, j2)
        if p[3] > limit:
            return False, p, past
        if course.failures:
            past = one_step(past, course.base[s], j0, j1, j2)
            dark = one_step(dark, course.base[s], 0.0, 0.0, 0.0)
            if past[3] > limit or dark[3] > limit:
                return False, p, past
        if s + 1 < t_end:
            p = move(p, course.steps[s + 1])
            if course.failures:
                past, dark = move(past, course.steps[s + 1]), move(dark, course.steps[s + 1])
    if course.failures and worth(dark) > worth(past):
        past = dark
    return True, p, past
