"""Backgrounds for the tempered chain, also where cameras' errors persist.

Any positive semidefinite information is a valid background (`placement.tempered.bound`), but it
must leave the trajectory a Markov chain: a white one does, and so does one that is a chain itself
(`placement.tempered.chains`), which stands for cameras with persistent offsets. Where odometry
knows a direction for certain there is none; then white cameras stand in for them, each weakened
until it tells as much alone as the camera itself does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from models.geometry import FloatArray
from placement.objectives.entropy import Entropy
from placement.objectives.navigation import WhiteDrive
from placement.objectives.navigation_chain import Drive
from placement.objectives.windows.filter import empty_messages, filter_forward
from placement.tempered import chains
from placement.tempered.chains import Chain
from placement.tempered.crossings import ROW, alone, cross_each
from placement.tempered.process import Process, cameras_of, take_in

HALVINGS = 12  # of the interval that holds the share's logarithm: to a half per cent
LEAST_SHARE = 1e-6
ROUNDING = 1e-11  # relative error allowed for in f at fractional points

Background = FloatArray | Chain  # information (t, 3) of each sample, or a chain


def stand_in(objective: Entropy) -> Entropy:
    """Return the same objective with white cameras throughout; `objective` if they are."""
    if not any(drive.persistent for drive in objective.drives):
        return objective
    return Entropy([_whitened(drive) if drive.persistent else drive for drive in objective.drives])


def background_of(white: Entropy, y: FloatArray) -> list[FloatArray]:
    """Return the information (t, 3) of the fractional choice `y` (c,) on each drive."""
    support = np.flatnonzero(y)
    return [WhiteDrive(drive).total(support, y[support]) for drive in white.drives]


def chains_of(objective: Entropy, x: FloatArray) -> list[Background] | None:
    """Return backgrounds for the fractional choice `x` (c,): chains where errors persist.

    None where odometry has a direction without noise, which leaves no chain to stand for them.
    """
    found: list[Background] = []
    for drive in objective.drives:
        if not drive.persistent:
            found += background_of(Entropy([drive]), x)
            continue
        chain = chains.chain_of(drive, x)
        if chain is None:
            return None
        found.append(chain)
    return found


def score_of(objective: Entropy, background: list[FloatArray], share: float) -> float:
    """Return f at `share` of a background, in nats."""
    found = 0.0
    for drive, base in zip(objective.drives, background, strict=True):
        messages = empty_messages(len(base))
        found += drive.weight * float(
            filter_forward(drive.steps(), drive.initial_covariance(), share * base, *messages)
        )
    return found


def constant_of(objective: Entropy, backgrounds: Sequence[Background], theta: float) -> float:
    """Return f at a share 1 − θ of the background less (1 − θ) f at the whole, rounded up."""
    found = 0.0
    for drive, base in zip(objective.drives, backgrounds, strict=True):
        if isinstance(base, Chain):
            part, magnitude = chains.constant_of(drive, base, theta)
        else:
            one = replace(drive, weight=1.0)
            at_y, at_rest = (score_of(Entropy([one]), [base], s) for s in (1.0, 1.0 - theta))
            part, magnitude = at_rest - (1.0 - theta) * at_y, at_rest + at_y
        found += drive.weight * (part + ROUNDING * magnitude)
    return found


def process_of(drive: Drive, base: Background, theta: float) -> Process:
    """Return odometry with a share 1 − `theta` of the background taken in, as a chain."""
    if isinstance(base, Chain):
        return chains.mixed(drive, base, theta)
    return take_in(drive.steps(), drive.initial_covariance(), (1.0 - theta) * base)


def _whitened(drive: Drive) -> Drive:
    info = drive.information
    white = info.white
    if white is None:
        raise ValueError("information.white is needed beside information.offsets, got None")
    chain = take_in(drive.steps(), drive.initial_covariance(), np.zeros((info.n_samples, 3)))
    lengths = np.diff(info.indptr)

    def tells(at: Drive) -> FloatArray:
        cameras = cameras_of(at, 1.0)
        rows, found = np.empty((info.n_candidates, ROW)), np.zeros(info.n_candidates)
        cross_each(chain, cameras, rows)
        alone(chain, cameras, rows, found)
        return found

    def scaled(share: FloatArray) -> Drive:
        blocks = (white * np.repeat(share, lengths)[:, None]).astype(np.float32)
        return replace(drive, information=replace(info, blocks=blocks, white=None, offsets=None))

    want = tells(drive)
    low, high = np.full(info.n_candidates, np.log(LEAST_SHARE)), np.zeros(info.n_candidates)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        enough = tells(scaled(np.exp(middle))) >= want
        high, low = np.where(enough, middle, high), np.where(enough, low, middle)
    return scaled(np.exp(high))
