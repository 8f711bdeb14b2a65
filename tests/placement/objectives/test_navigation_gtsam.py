"""The trajectory's information and its marginals, by GTSAM's factor graphs."""

from typing import Any

import numpy as np
import pytest

from benchmarks.synthetic_drives import ROBOT, random_drive
from models.vehicle import OdometryNoise
from placement.objectives.entropy import Entropy, WhiteEntropyMessages
from placement.objectives.navigation import WhiteDrive
from placement.objectives.navigation_chain import Drive
from placement.objectives.navigation_offsets import Forward, OffsetDrive
from placement.objectives.windows.filter import smoothed_positions

gtsam: Any = pytest.importorskip("gtsam")

SELECTED = np.array([2, 5, 9, 10, 16])
LOOSE = OdometryNoise(0.01, 0.03, 0.02)


def chain_graph(drive: Drive) -> Any:
    graph = gtsam.GaussianFactorGraph()
    sigma = np.diag(1.0 / drive.initial_sigma)
    graph.add(gtsam.JacobianFactor(0, sigma, np.zeros(3), gtsam.noiseModel.Unit.Create(3)))
    for t, (c, s, y, x, *q) in enumerate(drive.steps()):
        if t == 0:
            continue
        f = np.array([[c, s, y], [-s, c, x], [0.0, 0.0, 1.0]])
        noise = np.array([[q[0], q[1], q[2]], [q[1], q[3], q[4]], [q[2], q[4], q[5]]])
        root = np.linalg.inv(np.linalg.cholesky(noise))
        unit = gtsam.noiseModel.Unit.Create(3)
        graph.add(gtsam.JacobianFactor(t - 1, root @ f, t, -root, np.zeros(3), unit))
    return graph


def add_cameras(graph: Any, drive: Drive) -> None:
    info = drive.information
    unit = gtsam.noiseModel.Unit.Create(2)
    for i in SELECTED:
        offset_key = 10_000 + int(i)
        if info.offsets is not None:
            p = info.offsets.shape[2]
            graph.add(
                gtsam.JacobianFactor(
                    offset_key, np.eye(p), np.zeros(p), gtsam.noiseModel.Unit.Create(p)
                )
            )
        blocks = info.blocks if info.white is None else info.white
        for e in range(info.indptr[i], info.indptr[i + 1]):
            tt, tn, nn = info.frames_per_sample * blocks[e].astype(float)
            values, vectors = np.linalg.eigh([[tt, tn], [tn, nn]])
            root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
            h = np.hstack([root, np.zeros((2, 1))])
            t = int(info.indices[e])
            if info.offsets is None:
                graph.add(gtsam.JacobianFactor(t, h, np.zeros(2), unit))
            else:
                b = root @ info.offsets[e].astype(float)
                graph.add(gtsam.JacobianFactor(t, h, offset_key, b, np.zeros(2), unit))


def log_det(graph: Any) -> float:
    """Return log det of the graph's information matrix."""
    return float(2.0 * graph.eliminateSequential().logDeterminant())


@pytest.mark.parametrize("odometry", [ROBOT, LOOSE])
def test_entropy_and_smoothed_marginals_equal_gtsam(odometry: OdometryNoise) -> None:
    drive = random_drive(
        np.random.default_rng(1), n_samples=80, odometry=odometry, initial_sigma=(0.2, 0.1, 0.05)
    )
    graph = chain_graph(drive)
    before = log_det(graph)
    add_cameras(graph, drive)
    assert Entropy([drive]).value(SELECTED) == pytest.approx(log_det(graph) - before, rel=1e-8)
    messages = WhiteEntropyMessages(WhiteDrive(drive), SELECTED)
    smoothed = np.empty((80, 3))
    smoothed_positions(messages.after, messages.later, smoothed)
    tree = graph.eliminateMultifrontal()
    for t in range(0, 80, 7):
        want = tree.marginalCovariance(t)
        got = smoothed[t]
        np.testing.assert_allclose(got, [want[0, 0], want[0, 1], want[1, 1]], rtol=1e-8, atol=1e-12)


def test_entropy_with_offsets_equals_gtsam_with_the_offsets_as_variables() -> None:
    drive = random_drive(
        np.random.default_rng(2), n_samples=60, offsets=4, initial_sigma=(0.2, 0.1, 0.05)
    )
    graph = chain_graph(drive)
    before = log_det(graph)
    add_cameras(graph, drive)
    # the offsets' own part: what the cameras would tell about them on a known trajectory
    own = float(np.sum(OffsetDrive(drive).shares[SELECTED]))
    want = log_det(graph) - before - own
    assert Entropy([drive]).value(SELECTED) == pytest.approx(want, rel=1e-8)
    until = 59
    marginal = graph.eliminateMultifrontal().marginalCovariance(until)
    got = Forward(OffsetDrive(drive), SELECTED).car()[until]
    np.testing.assert_allclose(got, marginal[np.triu_indices(3)], rtol=1e-7, atol=1e-12)
