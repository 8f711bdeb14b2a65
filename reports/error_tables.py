"""The tables of the error-model study: how good a camera is, and whether the models tell.

Where nothing else is said: a pinhole of 2000 × 2000 px and 60° × 60°, 6 m high, installed to 0.03 m
and 0.5°, with an image algorithm of 4 px. A *bound* is a model's 95 % radius; a report is *inside*
when the true position lies in the model's 95 % region about the reported one. Cars are uniform over
the image (protocol `image`) unless a table says otherwise.
"""

from __future__ import annotations

import math
import warnings
from itertools import pairwise

import numpy as np
import pandas as pd

from models.cameras import Cameras, make_camera
from models.errors import (
    CHI2_95,
    COMPONENTS,
    FORMS,
    ErrorModel,
    covariance_components,
    error_components,
    error_covariance,
    error_radius,
)
from models.geometry import FloatArray
from models.installation import Installation
from models.sampling import Samples, sample_image

LENSES = ("pinhole", "stereographic", "equidistant")
CALIBRATION_PITCHES = (90.0, 70.0, 50.0, 40.0, 30.0)
PITCHES = (90.0, 80.0, 70.0, 60.0, 50.0, 40.0, 30.0)
GOOD, POOR = Installation(0.03, 0.5, 4.0), Installation(0.10, 1.2, 4.0)
ROAD_DISTANCE_M = 3.0
ROAD_RANGE_M = 150.0
TARGET_M = 0.25

# J. G. Send, M.Phil. dissertation, Cambridge 2018, chapter 5: what ours is set beside.
DISSERTATION_BOUNDS = pd.DataFrame(
    {
        "protocol": "dissertation",
        "pitch_deg": [90.0, 70.0, 50.0, 40.0],
        "mean_m": [0.1035, 0.1163, 0.1824, 0.3167],
        "median_m": [0.1035, 0.1075, 0.1454, 0.1884],
        "p25_m": math.nan,
        "p95_m": [0.1172, 0.1658, 0.3866, 1.022],
    }
)
DISSERTATION_MEDIANS_M = {4.0: 0.157, 12.0: 0.219, 28.0: 0.313}


def bound_coverage(samples: int, rng: np.random.Generator) -> pd.DataFrame:
    """Return `model, samples, inside, percent`: reports at the five pitches, equally many each."""
    each = samples // len(CALIBRATION_PITCHES)
    inside = dict.fromkeys(FORMS, 0)
    for pitch in CALIBRATION_PITCHES:
        camera = make_camera(pitch_deg=pitch)
        drawn = _draw(camera, 2 * each, GOOD, rng)  # at 30° a quarter has nothing to report
        for kind in FORMS:
            squared, radius = _region(camera, drawn, ErrorModel(kind))
            reported = np.flatnonzero(radius <= ErrorModel().report_limit_m)[:each]
            inside[kind] += int(np.sum(squared[reported] <= 1.0))
    total = each * len(CALIBRATION_PITCHES)
    return pd.DataFrame(
        {"model": kind, "samples": total, "inside": n, "percent": 100.0 * n / total}
        for kind, n in inside.items()
    )


def coverage_by_pitch(samples: int, rng: np.random.Generator) -> pd.DataFrame:
    """Return the coverage of every model for each lens, pitch and installation.

    `reported_percent` is the share of cars the report limit lets through.
    """
    rows = []
    for installation in (GOOD, POOR):
        for lens in LENSES:
            for pitch in CALIBRATION_PITCHES:
                camera = make_camera(pitch_deg=pitch, projection=lens)
                drawn = _draw(camera, samples, installation, rng)
                for kind in FORMS:
                    model = ErrorModel(kind, installation)
                    squared, radius = _region(camera, drawn, model)
                    use = radius <= model.report_limit_m
                    rows.append(
                        {
                            "orientation_95_deg": installation.orientation_95_deg,
                            "position_95_m": installation.position_95_m,
                            "projection": lens,
                            "pitch_deg": pitch,
                            "model": kind,
                            "reported_percent": 100.0 * use.mean(),
                            "samples": int(use.sum()),
                            "inside": int(np.sum(squared[use] <= 1.0)),
                            "percent": 100.0 * float(np.mean(squared[use] <= 1.0)),
                        }
                    )
    return pd.DataFrame(rows)


def first_order_limit(samples: int, rng: np.random.Generator) -> pd.DataFrame:
    """Return `covariance`'s coverage, no report limit, against ε = σ_ori · d/h.

    ε is the ratio of the second to the first order of the back-projection; it alone says whether
    the first order holds, whatever the installation. `distance_m` is d at the bin's upper end.
    """
    edges = np.array([0.0, 0.02, 0.04, 0.06, 0.08, 0.09, 0.1, 0.12, 0.15, 0.2, 0.3])
    rows = []
    for orientation in (0.5, 1.2, 3.0):
        installation = Installation(0.03, orientation, 4.0)
        camera = make_camera(pitch_deg=30.0)
        drawn = _draw(camera, samples, installation, rng)
        squared, _ = _region(camera, drawn, ErrorModel("covariance", installation))
        sigma = installation.orientation_sigma_rad
        epsilon = sigma * np.hypot(drawn.reported_m[:, 0], drawn.reported_m[:, 1]) / 6.0
        for low, high in pairwise(edges):
            use = drawn.seen & (epsilon >= low) & (epsilon < high)
            if use.sum() >= samples // 2000:
                rows.append(
                    {
                        "orientation_95_deg": orientation,
                        "epsilon_low": low,
                        "epsilon_high": high,
                        "distance_m": 6.0 * high / sigma,
                        "samples": int(use.sum()),
                        "percent": 100.0 * float(np.mean(squared[use] <= 1.0)),
                    }
                )
    return pd.DataFrame(rows)


def residuals(samples: int, rng: np.random.Generator) -> pd.DataFrame:
    """Return histograms of bound minus error in the error's direction, absolute and over bound.

    Columns `model, kind, bin_low, bin_high, count`; 50° pitch. The outermost bins hold the rest.
    """
    camera = make_camera(pitch_deg=50.0)
    drawn = _draw(camera, samples, GOOD, rng)
    length = np.linalg.norm(drawn.errors_m(), axis=1)
    rows = []
    for kind in FORMS:
        squared, radius = _region(camera, drawn, ErrorModel(kind))
        use = radius <= ErrorModel().report_limit_m
        bound = length[use] / np.sqrt(squared[use])
        for name, values, edges in (
            ("absolute_m", bound - length[use], np.linspace(-0.3, 0.7, 51)),
            ("relative", 1.0 - np.sqrt(squared[use]), np.linspace(-1.0, 1.0, 51)),
        ):
            counts, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
            rows += [
                {"model": kind, "kind": name, "bin_low": a, "bin_high": b, "count": int(n)}
                for (a, b), n in zip(pairwise(edges), counts, strict=True)
            ]
    return pd.DataFrame(rows)


def components_by_pitch(side: int) -> pd.DataFrame:
    """Return each component's mean and median 95 % radius by pitch, where a camera reports.

    `total` is the bound. `radius` and `ellipse` add radii, `covariance` adds covariances.
    `persistent` and `white` (covariance only) are the two parts' own radii.
    """
    rows = []
    for kind in FORMS:
        model = ErrorModel(kind)
        for pitch in PITCHES:
            camera = make_camera(pitch_deg=pitch)
            points = image_points(camera, side)
            total = error_radius(camera, points, model)[0]
            use = total <= model.report_limit_m
            index = np.zeros(int(use.sum()), dtype=np.int64)
            parts = error_components(camera, index, points[use], model)
            named = dict(zip(COMPONENTS, parts.T, strict=True))
            if kind == "covariance":
                blocks = covariance_components(camera, index, points[use], GOOD)
                named["persistent"] = _semi_axis(blocks[:, :3].sum(axis=1))
                named["white"] = _semi_axis(blocks[:, 3:].sum(axis=1))
            named["total"] = total[use]
            rows += [
                {
                    "model": kind,
                    "pitch_deg": pitch,
                    "component": name,
                    "mean_m": float(values.mean()),
                    "median_m": float(np.median(values)),
                }
                for name, values in named.items()
            ]
    return pd.DataFrame(rows)


def algorithm_error(samples: int, rng: np.random.Generator) -> pd.DataFrame:
    """Return the bound and its coverage against the image algorithm's error, at 45°."""
    camera = make_camera(pitch_deg=45.0)
    rows = []
    for algorithm in (0.0, 1.0, 2.0, 4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 28.0):
        installation = Installation(0.03, 0.5, algorithm)
        drawn = _draw(camera, samples, installation, rng)
        for kind in FORMS:
            model = ErrorModel(kind, installation)
            squared, radius = _region(camera, drawn, model)
            use = radius <= model.report_limit_m
            theirs = DISSERTATION_MEDIANS_M.get(algorithm, math.nan)
            rows.append(
                {
                    "model": kind,
                    "algorithm_95_px": algorithm,
                    "mean_m": float(radius[use].mean()),
                    "median_m": float(np.median(radius[use])),
                    "percent": 100.0 * float(np.mean(squared[use] <= 1.0)),
                    "dissertation_median_m": theirs if kind == "radius" else math.nan,
                }
            )
    return pd.DataFrame(rows)


def resolution(side: int) -> pd.DataFrame:
    """Return the bound against the resolution (pixels a side) at four pitches.

    Over the same cars at every resolution, all that hit the ground: with a report limit the coarse
    images would drop their worst cars and look better than they are.
    """
    rows = []
    for pitch in (90.0, 70.0, 50.0, 40.0):
        for size in (250, 500, 750, 1000, 1500, 2000, 3000, 4000, 6000, 8000):
            camera = make_camera(pitch_deg=pitch, size_px=(size, size))
            points = image_points(camera, side)
            for kind in FORMS:
                radius = error_radius(camera, points, ErrorModel(kind))[0]
                rows.append(
                    {
                        "model": kind,
                        "pitch_deg": pitch,
                        "resolution_px": size,
                        "mean_m": float(radius.mean()),
                        "median_m": float(np.median(radius)),
                    }
                )
    return pd.DataFrame(rows)


def bounds_by_pitch(side: int) -> pd.DataFrame:
    """Return `protocol, pitch_deg, mean_m, median_m, p25_m, p95_m` of the circle's radius.

    `image`: pixels uniform over the image, all that hit the ground. `road`: a car passing on a
    straight road 3 m to the left of a camera that looks along it, wherever it is seen up to 150 m.
    `dissertation`: its table. No report limit, since the table had none.
    """
    rows = []
    for pitch in PITCHES[:-1]:
        camera = make_camera(pitch_deg=pitch)
        for protocol, points in (("image", image_points(camera, side)), ("road", road_points())):
            radius = error_radius(camera, points, ErrorModel("radius"))[0]
            seen = radius[np.isfinite(radius)]
            low, median, high = np.percentile(seen, [25.0, 50.0, 95.0])
            rows.append(
                {
                    "protocol": protocol,
                    "pitch_deg": pitch,
                    "mean_m": float(seen.mean()),
                    "median_m": float(median),
                    "p25_m": float(low),
                    "p95_m": float(high),
                }
            )
    ours = pd.DataFrame(rows).sort_values(["protocol", "pitch_deg"], ascending=[True, False])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # an all-NaN column, p25_m, is meant
        return pd.concat([ours, DISSERTATION_BOUNDS], ignore_index=True)


def distances_by_pitch(side: int) -> pd.DataFrame:
    """Return `protocol, pitch_deg, median_distance_m`: how far the cars of each protocol stood.

    For `dissertation`, which does not say: the distance straight ahead at which the circle has the
    median it reports.
    """
    rows = []
    for pitch in DISSERTATION_BOUNDS["pitch_deg"]:
        camera = make_camera(pitch_deg=float(pitch))
        for protocol, points in (("image", image_points(camera, side)), ("road", road_points())):
            seen = np.isfinite(error_radius(camera, points, ErrorModel("radius"))[0])
            rows.append((protocol, pitch, float(np.median(np.hypot(*points[seen].T)))))
        ahead = np.arange(0.0, 60.0, 0.005)
        line = np.column_stack([ahead, np.zeros(len(ahead))])
        radius = error_radius(camera, line, ErrorModel("radius"))[0]
        theirs = DISSERTATION_BOUNDS.set_index("pitch_deg")["median_m"][pitch]
        rows.append(("dissertation", pitch, float(ahead[np.argmin(np.abs(radius - theirs))])))
    return pd.DataFrame(rows, columns=["protocol", "pitch_deg", "median_distance_m"])


def installation(side: int) -> pd.DataFrame:
    """Return the median bound over position and orientation tolerance, at 45° and 70°."""
    rows = []
    for kind in ("radius", "covariance"):
        for pitch in (45.0, 70.0):
            camera = make_camera(pitch_deg=pitch)
            points = image_points(camera, side)
            for position in (0.0, 0.01, 0.02, 0.03, 0.05, 0.075, 0.1, 0.15):
                for orientation in np.arange(0.0, 1.41, 0.1):
                    tolerance = Installation(position, float(round(orientation, 1)), 4.0)
                    radius = error_radius(camera, points, ErrorModel(kind, tolerance))[0]
                    median = float(np.median(radius))
                    rows.append(
                        {
                            "model": kind,
                            "pitch_deg": pitch,
                            "position_95_m": position,
                            "orientation_95_deg": tolerance.orientation_95_deg,
                            "median_m": median,
                            "achieves_0_25_m": median <= TARGET_M,
                        }
                    )
    return pd.DataFrame(rows)


def image_points(camera: Cameras, side: int) -> FloatArray:
    """Return the ground points of a regular grid of side × side pixels, those that hit."""
    share = (np.arange(side) + 0.5) / side
    u, v = np.meshgrid(share * camera.width_px[0], share * camera.height_px[0])
    index = np.zeros(side * side, dtype=np.int64)
    points, hits = camera.ground_from_pixel(index, np.column_stack([u.ravel(), v.ravel()]))
    return points[hits]


def road_points() -> FloatArray:
    """Return the places of a car every centimetre of a lane that passes 3 m left of the camera."""
    along = np.arange(-20.0, ROAD_RANGE_M, 0.01)
    return np.column_stack([along, np.full(len(along), ROAD_DISTANCE_M)])


def _draw(
    camera: Cameras, samples: int, installation: Installation, rng: np.random.Generator
) -> Samples:
    return sample_image(camera, np.zeros(samples, dtype=np.int64), installation, rng)


def _region(camera: Cameras, drawn: Samples, model: ErrorModel) -> tuple[FloatArray, FloatArray]:
    """Return each error's squared size relative to the 95 % region (1 on its border), and bounds.

    Bounds are infinite where nothing is reported.
    """
    points = np.where(drawn.seen[:, None], drawn.reported_m, math.nan)
    radius = error_radius(camera, points, model)[0]
    blocks = error_covariance(camera, drawn.camera, points, model)
    error = drawn.errors_m()
    xx, xy, yy = blocks.T
    # At the horizon blocks overflow; those reports are beyond every limit.
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        squared = (
            yy * error[:, 0] ** 2 - 2.0 * xy * error[:, 0] * error[:, 1] + xx * error[:, 1] ** 2
        ) / (xx * yy - xy * xy)
    return squared / (CHI2_95 if model.kind == "covariance" else 4.0), radius


def _semi_axis(blocks: FloatArray) -> FloatArray:
    xx, xy, yy = blocks.T
    axis: FloatArray = np.sqrt(CHI2_95 * 0.5 * (xx + yy + np.hypot(xx - yy, 2.0 * xy)))
    return axis
