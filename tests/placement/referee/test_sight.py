from __future__ import annotations

import numpy as np
import pytest

from placement.assemble import assemble
from placement.instance import Instance, instance_from_dict
from placement.referee.drive import filter_drive
from placement.referee.values import eyes_of, filtered, rebuild, sights_of, value_of

ROAD = [
    {"length": 40.0},
    {"length": 30.0, "curvature": [0.0, 0.03]},
    {"length": 50.0, "curvature": 0.03},
]


def make_instance(**changes: object) -> Instance:
    base = instance_from_dict(
        {
            "road": {"pieces": ROAD},
            "mounts": {"spacing_m": 40.0},
            "vehicle": {"profile": "robot"},
            "objective": {"kind": "localisation"},
            "budget": {"cameras": 5},
        }
    )
    return base.changed({key.replace("__", "."): value for key, value in changes.items()})


@pytest.mark.parametrize("kind", ["localisation", "entropy", "trace", "final_entropy"])
@pytest.mark.parametrize("persistent", [False, True])
@pytest.mark.parametrize("model", ["radius", "ellipse", "covariance"])
def test_the_referee_and_the_kernels_agree_on_every_value(
    model: str, persistent: bool, kind: str
) -> None:
    lens = {"radius": "pinhole", "ellipse": "equidistant", "covariance": "stereographic"}[model]
    instance = make_instance(
        errors__model=model,
        errors__persistent=persistent,
        objective__kind=kind,
        camera__projection=lens,
        objective__weight="lateral" if persistent else "position",
    )
    scene = assemble(instance)
    chosen = np.sort(np.random.default_rng(3).choice(len(scene.candidates), 5, replace=False))
    again = rebuild(instance)
    sights = sights_of(again, eyes_of(scene.candidates, chosen.tolist()))
    for sight, i in zip(sights, chosen, strict=True):
        row = slice(scene.information.indptr[i], scene.information.indptr[i + 1])
        np.testing.assert_array_equal(np.flatnonzero(sight.seen), scene.information.indices[row])
    wanted = scene.problem.objective.value(chosen)
    # Stored float32, and fourth-order differences against closed forms.
    assert value_of(again, sights) == pytest.approx(wanted, rel=1e-7)


def test_a_distorted_lens_is_seen_alike() -> None:
    instance = make_instance(
        camera__projection="equidistant", camera__distortion=[0.05, -0.02, 0.0, 0.0]
    )
    scene = assemble(instance)
    again = rebuild(instance)
    chosen = [0, 7, 11]
    sights = sights_of(again, eyes_of(scene.candidates, chosen))
    wanted = scene.problem.objective.value(np.array(chosen))
    assert value_of(again, sights) == pytest.approx(wanted, rel=1e-7)


def test_a_drive_without_cameras_learns_nothing() -> None:
    again = rebuild(make_instance(objective__kind="entropy"))
    assert filter_drive(again.track, []).log_det == 0.0
    assert np.all(np.diff(np.trace(filtered(again, []).covariance, axis1=1, axis2=2)) > 0.0)


def test_what_the_referee_does_not_know_it_refuses() -> None:
    instance = make_instance()
    odd = instance.objective.model_copy(update={"kind": "beauty"})
    document = instance.document.model_copy(update={"objective": odd})
    strange = Instance(instance.name, instance.folder, document, instance.files)
    with pytest.raises(ValueError, match=r"verify does not know objective\.kind = beauty"):
        rebuild(strange)
