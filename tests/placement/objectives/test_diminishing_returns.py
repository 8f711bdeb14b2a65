"""Entropy has diminishing returns, trace has not; settled without noise (DESIGN section 8)."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from benchmarks.objectives_document import (
    SUBSETS,
    heading_example,
    oblique_example,
    two_cameras,
    violations_table,
)
from benchmarks.synthetic_drives import CAR, random_drive
from models.vehicle import PROFILES
from placement.assemble import assemble
from placement.instance import load_instance
from placement.objectives.entropy import Entropy
from placement.objectives.navigation_chain import Drive
from placement.objectives.trace import Trace

DOCUMENT = Path(__file__).resolve().parents[3] / "docs" / "objectives.md"


@pytest.mark.parametrize("case", [{}, {"isotropic": True}, {"odometry": CAR}, {"offsets": 3}])
def test_entropy_never_violates_diminishing_returns(case: dict[str, object]) -> None:
    """2,500 triples S ⊂ T ∌ i for each of four kinds of drive: 10,000 in all."""
    rng = np.random.default_rng(0)
    triples = 0
    while triples < 2500:
        drive = random_drive(rng, n_samples=50, n_candidates=40, longest_window=15, **case)  # type: ignore[arg-type]
        objective = Entropy([drive])
        for _ in range(5):
            order = rng.permutation(40)
            large = order[: rng.integers(1, 20)]
            small = large[: rng.integers(0, large.size)]
            rest = order[20:]
            more = objective.state(small).gains(rest)
            less = objective.state(large).gains(rest)
            scale = objective.value(large)
            assert np.all(less <= more + 1e-11 * scale)
            assert np.all(less >= -1e-11 * scale)
            triples += rest.size


@pytest.mark.parametrize("example", [heading_example, oblique_example])
def test_trace_violates_diminishing_returns(example: Callable[[], Drive]) -> None:
    objective = Trace([example()])
    none, one = objective.state(), objective.state(np.array([0]))
    alone, after = none.gains(np.array([1]))[0], one.gains(np.array([1]))[0]
    assert after > 1.005 * alone


def test_the_documented_violations_are_what_is_computed() -> None:
    assert violations_table() in DOCUMENT.read_text(encoding="utf-8")


def test_no_violation_is_found_on_fewer_samples_where_cameras_are_isotropic() -> None:
    """Says why the documented example has three samples: 3,000 random smaller ones have none."""
    rng = np.random.default_rng(0)
    for _ in range(3000):
        t = int(rng.integers(1, 3))
        rows = [sorted(set(rng.integers(0, t, 2).tolist())) for _ in range(2)]
        blocks = (10.0 ** rng.uniform(-2, 5, (sum(map(len, rows)), 1))).tolist()
        s_m = [0.0, float(10.0 ** rng.uniform(-1, 2.5))][:t]
        sigma = (10.0 ** rng.uniform(-3, 1, 3)).tolist()
        objective = Trace([two_cameras(s_m, rows, blocks, sigma)])
        none, a, b, both = (objective.value(np.array(s, dtype=np.int64)) for s in SUBSETS)
        assert a - both <= none - b + 1e-12 * none


@pytest.mark.parametrize("profile", ["dissertation", "car", "robot"])
def test_greedy_on_winding_raises_what_some_camera_gains(profile: str) -> None:
    scene = assemble(load_instance("winding"))
    drive = Drive(scene.points, scene.information, PROFILES[profile], np.array([0.1, 0.1, 0.01]))
    state = Trace([drive]).state()
    rise = 0.0
    for _ in range(5):
        alone = state.gains()
        state.add(int(np.argmax(alone)))
        worth = alone > 1e-9 * -state.score
        rise = max(rise, float(np.max(state.gains()[worth] / alone[worth])))
    assert rise > 1.01
