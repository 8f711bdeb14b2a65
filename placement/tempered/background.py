"""White backgrounds for the tempered chain, also where cameras' errors persist.

Any positive semidefinite information is a valid background (`placement.tempered.bound`), but only
a white one leaves the trajectory a Markov chain. Cameras with persistent offsets are therefore
stood in for by white ones, each weakened until it tells as much alone as the camera itself does.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.geometry import FloatArray
from placement.objectives.entropy import Entropy
from placement.objectives.navigation import WhiteDrive
from placement.objectives.navigation_chain import Drive
from placement.objectives.windows.filter import empty_messages, filter_forward
from placement.tempered.crossings import ROW, alone, cross_each
from placement.tempered.process import cameras_of, take_in

HALVINGS = 12  # of the interval that holds the share's logarithm: to a half per cent
LEAST_SHARE = 1e-6


def stand_in(objective: Entropy) -> Entropy:
    """Return the same objective with white cameras throughout; `objective` if they are."""
    if not any(drive.persistent for drive in objective.drives):
        return objective
    return Entropy([_whitened(drive) if drive.persistent else drive for drive in objective.drives])


def background_of(white: Entropy, y: FloatArray) -> list[FloatArray]:
    """Return the information (t, 3) of the fractional choice `y` (c,) on each drive."""
    support = np.flatnonzero(y)
    return [WhiteDrive(drive).total(support, y[support]) for drive in white.drives]


def score_of(objective: Entropy, background: list[FloatArray], share: float) -> float:
    """Return f at `share` of a background, in nats."""
    found = 0.0
    for drive, base in zip(objective.drives, background, strict=True):
        messages = empty_messages(len(base))
        found += drive.weight * float(
            filter_forward(drive.steps(), drive.initial_covariance(), share * base, *messages)
        )
    return found


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
