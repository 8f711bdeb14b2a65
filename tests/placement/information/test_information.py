"""The kernels against their NumPy twin, the culling against the dense matrix, and invariance."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.cameras import Cameras, make_camera
from models.errors import ErrorModel, error_covariance, error_radius, split_covariance
from models.geometry import FloatArray, IntArray, Pose
from models.installation import Installation
from models.projections import Projection
from models.roads import Piece, Road, RoadPoints, road_from_pieces
from placement.candidates import build_candidates
from placement.information import Information, compute_information
from placement.information import precompute as information_module
from placement.information.kernels import dense_blocks, reach
from placement.information.reference import dense_information
from placement.information.sample_tree import build_tree
from placement.instance import load_instance

# Straight, bends both ways, and a hairpin whose legs see the same cameras.
ROAD = road_from_pieces(
    [
        Piece(60.0),
        Piece(40.0, 0.0, 0.05),
        Piece(50.0, -0.03, -0.03),
        Piece(12.0 * math.pi, 1 / 12, 1 / 12),
        Piece(90.0),
    ]
)
KINDS = ("radius", "ellipse", "covariance")
LENSES: dict[str, Callable[[Cameras], Cameras]] = {
    "pinhole": lambda c: c,
    "rolled": lambda c: dataclasses.replace(c, roll_rad=np.linspace(-0.6, 0.6, len(c))),
    "stereographic": lambda c: dataclasses.replace(c, projection=_all(c, Projection.STEREOGRAPHIC)),
    "equidistant": lambda c: dataclasses.replace(c, projection=_all(c, Projection.EQUIDISTANT)),
    "fisheye": lambda c: dataclasses.replace(
        c,
        projection=_all(c, Projection.EQUIDISTANT),
        hfov_rad=np.full(len(c), 3.5),
        vfov_rad=np.full(len(c), 2.5),
    ),
    "distorted": lambda c: dataclasses.replace(
        c, distortion=np.tile([0.02, -0.01, 0.001, 0.0], (len(c), 1))
    ),
}


def _all(cameras: Cameras, projection: Projection) -> IntArray:
    return np.full(len(cameras), int(projection), dtype=np.int64)


def some_cameras(road: Road = ROAD, every: int = 37) -> Cameras:
    candidates = build_candidates(load_instance("winding"), road)
    return candidates.cameras.subset(np.arange(0, len(candidates), every))


def dense_by_kernel(
    cameras: Cameras, points: RoadPoints, errors: ErrorModel, max_range_m: float
) -> FloatArray:
    tree = build_tree(points.x_m, points.y_m, points.heading_rad)
    out = np.empty((len(cameras), 1 if errors.isotropic else 3, tree.samples.shape[1]))
    dense_blocks(cameras.table(), errors.parameters(), max_range_m, tree.samples, out)
    return out.transpose(0, 2, 1)[:, : len(points)]


def as_dense(information: Information) -> FloatArray:
    dense = np.zeros((information.n_candidates, information.n_samples, information.blocks.shape[1]))
    rows = np.repeat(np.arange(information.n_candidates), np.diff(information.indptr))
    dense[rows, information.indices] = information.blocks
    return dense


def assert_close(found: FloatArray, wanted: FloatArray, tolerance: float) -> None:
    """Compare blocks (…, 1 | 3), each relative to its own largest entry; zeros must be zeros."""
    np.testing.assert_array_equal(found[..., 0] > 0.0, wanted[..., 0] > 0.0)
    seen = wanted[..., 0] > 0.0
    scale = np.abs(wanted[seen]).max(axis=-1, keepdims=True)
    assert (np.abs(found[seen] - wanted[seen]) / scale).max() <= tolerance


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lens", LENSES)
def test_kernel_and_twin_agree_to_1e_12(lens: str, kind: str) -> None:
    cameras, points = LENSES[lens](some_cameras()), ROAD.sample(1.0)
    errors = ErrorModel(kind)
    twin = dense_information(cameras, points, errors, 40.0)
    assert (twin[..., 0] > 0.0).sum() > 500
    assert_close(dense_by_kernel(cameras, points, errors, 40.0), twin, 1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lens", LENSES)
def test_culling_loses_nothing(lens: str, kind: str) -> None:
    cameras, points = LENSES[lens](some_cameras()), ROAD.sample(1.0)
    errors = ErrorModel(kind, report_limit_m=5.0)
    culled = compute_information(cameras, points, errors, 60.0)
    # float32 rounds by half of 2^-23.
    assert_close(as_dense(culled), dense_by_kernel(cameras, points, errors, 60.0), 2.0**-24)


@settings(deadline=None, max_examples=60)
@given(
    height=st.floats(0.5, 100.0),
    pitch=st.floats(0.5, 90.0),
    hfov=st.floats(1.0, 170.0),
    vfov=st.floats(1.0, 170.0),
    yaw=st.floats(-180.0, 180.0),
    at=st.tuples(st.floats(-50.0, 150.0), st.floats(-60.0, 60.0)),
    position=st.floats(0.0, 2.0),
    orientation=st.floats(0.0, 40.0),
    limit=st.floats(0.05, 50.0),
    kind=st.sampled_from(KINDS),
)
@pytest.mark.filterwarnings("ignore:.*pinhole.*:UserWarning")
def test_culling_loses_nothing_for_any_camera(
    height: float,
    pitch: float,
    hfov: float,
    vfov: float,
    yaw: float,
    at: tuple[float, float],
    position: float,
    orientation: float,
    limit: float,
    kind: str,
) -> None:
    camera = make_camera(
        x_m=at[0], y_m=at[1], height_m=height, yaw_deg=yaw, pitch_deg=pitch, fov_deg=(hfov, vfov)
    )
    errors = ErrorModel(kind, Installation(position, orientation), report_limit_m=limit)
    points = ROAD.sample(1.0)
    culled = compute_information(camera, points, errors, 150.0)
    dense = dense_by_kernel(camera, points, errors, 150.0)
    np.testing.assert_array_equal(culled.indices, np.flatnonzero(dense[0, :, 0] > 0.0))


def test_a_block_is_the_inverse_of_the_models_covariance_in_the_road_frame() -> None:
    cameras, points = some_cameras(every=211), ROAD.sample(1.0)
    errors = ErrorModel("covariance")
    information = compute_information(cameras, points, errors, 150.0)
    rows = np.repeat(np.arange(len(cameras)), np.diff(information.indptr))
    at = information.indices
    xx, xy, yy = error_covariance(cameras, rows, points.xy[at], errors).T
    tt, tn, nn = information.blocks.T.astype(np.float64)
    c, s = np.cos(points.heading_rad[at]), np.sin(points.heading_rad[at])
    into_road = np.array([[c, s], [-s, c]]).transpose(2, 0, 1)
    covariance = np.array([[xx, xy], [xy, yy]]).transpose(2, 0, 1)
    block = np.array([[tt, tn], [tn, nn]]).transpose(2, 0, 1)
    product = block @ into_road @ covariance @ into_road.transpose(0, 2, 1)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(2), product.shape), atol=2e-5)


def test_what_is_seen_is_what_the_model_reports_within_its_limit() -> None:
    cameras, points = some_cameras(every=211), ROAD.sample(1.0)
    for kind in KINDS:
        errors = ErrorModel(kind, report_limit_m=1.0)
        seen = as_dense(compute_information(cameras, points, errors, 1e3))[..., 0] > 0.0
        np.testing.assert_array_equal(seen, error_radius(cameras, points.xy, errors) <= 1.0)


def test_white_and_persistent_parts_make_up_the_whole() -> None:
    cameras, points = some_cameras(every=211), ROAD.sample(1.0)
    errors = ErrorModel("covariance")
    information = compute_information(cameras, points, errors, 150.0)
    assert information.white is not None
    assert information.offsets is not None
    rows = np.repeat(np.arange(len(cameras)), np.diff(information.indptr))
    white, jacobian = split_covariance(cameras, rows, points.xy[information.indices], errors)
    heading = points.heading_rad[information.indices]
    c, s = np.cos(heading), np.sin(heading)
    into_road = np.array([[c, s], [-s, c]]).transpose(2, 0, 1)
    np.testing.assert_allclose(information.offsets, into_road @ jacobian, rtol=1e-6, atol=1e-7)
    tt, tn, nn = information.white.T.astype(np.float64)
    block = np.array([[tt, tn], [tn, nn]]).transpose(2, 0, 1)
    xx, xy, yy = white.T
    covariance = np.array([[xx, xy], [xy, yy]]).transpose(2, 0, 1)
    product = block @ into_road @ covariance @ into_road.transpose(0, 2, 1)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(2), product.shape), atol=2e-3)
    whole = np.linalg.inv(
        into_road @ covariance @ into_road.transpose(0, 2, 1)
        + into_road @ jacobian @ (into_road @ jacobian).transpose(0, 2, 1)
    )
    np.testing.assert_allclose(information.blocks[:, 0], whole[:, 0, 0], rtol=1e-6)


def test_an_error_that_is_all_white_has_no_parts() -> None:
    cameras, points = some_cameras(every=500), ROAD.sample(1.0)
    for errors in (ErrorModel("radius"), ErrorModel("covariance", persistent=False)):
        information = compute_information(cameras, points, errors, 150.0)
        assert information.white is None
        assert information.offsets is None


@pytest.mark.parametrize("kind", KINDS)
@settings(deadline=None, max_examples=12)
@given(turn=st.floats(-math.pi, math.pi), far=st.sampled_from([(0.0, 0.0), (1e5, -1e5)]))
def test_a_scene_turned_and_shifted_has_the_same_information(
    kind: str, turn: float, far: tuple[float, float]
) -> None:
    moved_road = ROAD.transformed(Pose(*far, turn))
    errors = ErrorModel(kind)
    here = dense_by_kernel(some_cameras(), ROAD.sample(1.0), errors, 150.0)
    there = dense_by_kernel(some_cameras(moved_road), moved_road.sample(1.0), errors, 150.0)
    assert_close(there, here, 1e-9)
    culled = compute_information(some_cameras(moved_road), moved_road.sample(1.0), errors, 150.0)
    np.testing.assert_array_equal(as_dense(culled)[..., 0] > 0.0, here[..., 0] > 0.0)


def test_threads_and_chunks_change_no_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    cameras, points = some_cameras(every=3), ROAD.sample(1.0)
    errors = ErrorModel("covariance")
    one = compute_information(cameras, points, errors, 150.0, workers=1)
    monkeypatch.setattr(information_module, "CHUNK", 100)
    monkeypatch.setattr(information_module, "SHARE", 7)
    many = compute_information(cameras, points, errors, 150.0, workers=3)
    for field in ("indptr", "indices", "blocks", "white", "offsets"):
        np.testing.assert_array_equal(getattr(one, field), getattr(many, field))


@pytest.mark.filterwarnings("ignore:.*pinhole.*:UserWarning")
@pytest.mark.parametrize("kind", ["radius", "covariance"])
@pytest.mark.parametrize("height", [0.02, 4.0, 50.0])
def test_the_reach_is_where_the_installation_alone_meets_the_limit(
    kind: str, height: float
) -> None:
    # Straight down, with pixels too fine to matter: the report limit is all that ends the view.
    camera = make_camera(
        height_m=height, pitch_deg=90.0, fov_deg=(179.0, 179.0), size_px=(100_000, 100_000)
    )
    errors = ErrorModel(kind, Installation(0.03, 0.5, 0.0), report_limit_m=2.0)
    far = reach(camera.table()[0], errors.parameters(), 1e6)
    inside, outside = (
        error_radius(camera, np.array([[factor * far, 0.0]]), errors)[0, 0]
        for factor in (1.0 - 2e-2, 1.0 + 1e-9)
    )
    assert outside > 2.0
    assert inside <= 2.0 or height == 0.02  # below e_pos there is no bound but the range


def test_a_closed_road_is_seen_across_its_seam() -> None:
    quarter = [Piece(40.0), Piece(5.0 * math.pi, 0.1, 0.1)]
    ring = road_from_pieces(quarter * 4, closed=True)
    points = ring.sample(1.0)
    camera = make_camera(x_m=-10.0, y_m=-3.0, yaw_deg=0.0, pitch_deg=30.0)
    seen = compute_information(camera, points, ErrorModel("radius"), 150.0).indices
    assert 0 in seen
    assert len(points) - 1 in seen
    assert (np.diff(seen) > 0).all()


def test_a_camera_that_sees_nothing_has_an_empty_row() -> None:
    camera = make_camera(x_m=0.0, y_m=5000.0)
    information = compute_information(camera, ROAD.sample(1.0), ErrorModel("radius"), 150.0)
    assert information.indptr.tolist() == [0, 0]
    assert information.indices.shape == (0,)


def test_range_is_a_distance_on_the_ground_and_its_border_belongs() -> None:
    straight = road_from_pieces([Piece(40.0)])
    camera = make_camera(x_m=0.0, y_m=0.0, pitch_deg=45.0, fov_deg=(60.0, 80.0))
    seen = compute_information(camera, straight.sample(1.0), ErrorModel("radius"), 12.0).indices
    assert seen.max() == 12
