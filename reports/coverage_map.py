"""The coverage map: every sample of every drive by how well a car there is placed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from placement.output import cameras_seeing
from placement.prediction import predict
from reports.streets import buildings_near
from reports.style import BLACK, GREY, VERMILION, saved, style

if TYPE_CHECKING:
    from placement.atomic import Content
    from placement.commands import Result

_MOST_DRIVES = 60  # drawn; the others lie on the same streets
_LEAST_SIGMA_M = 1e-4
_MARGIN_M = 30.0
_MANY = 300  # cameras: the picture is then of a city


def draw(result: Result) -> dict[str, Content]:
    """Draw predicted error and unseen road: `coverage.png` and `coverage.svg`."""
    with style():
        figure = Figure(figsize=(9.0, 8.0))
        axes = figure.subplots()
        scene, selected = result.scene, result.solution.selected
        xy, sigma, seen = [], [], []
        for n, journey in enumerate(scene.journeys[:_MOST_DRIVES]):
            along = result.prediction if n == 0 else predict(scene, selected, n)
            xy.append(journey.points.xy)
            sigma.append(np.maximum(along.position_sigma_m, _LEAST_SIGMA_M))
            seen.append(cameras_seeing(journey.information, selected) > 0)
        places, errors, covered = np.vstack(xy), np.concatenate(sigma), np.concatenate(seen)
        low, high = places.min(axis=0) - _MARGIN_M, places.max(axis=0) + _MARGIN_M
        axes.add_collection(
            PolyCollection(
                buildings_near(result, _MARGIN_M), facecolors=GREY, alpha=0.35, linewidths=0,
                rasterized=True,
            )
        )  # fmt: skip
        # From afar what is not seen must not hide the little that is.
        far = len(selected) > _MANY
        last = covered if far else np.ones(len(places), dtype=np.bool_)
        least, most = float(errors[last].min()), float(errors[last].max())
        norm = LogNorm(least, max(most, 1.01 * least))
        dots: dict[str, Any] = {"color": BLACK, "markersize": 1.2, "zorder": 2.5}
        if far:
            dots = {"color": GREY, "markersize": 1.0, "zorder": 1.5, "markeredgewidth": 0.0}
        axes.plot(*places[~covered].T, ".", rasterized=True, label="seen by no camera", **dots)
        drawn = axes.scatter(
            places[last, 0], places[last, 1], c=errors[last], norm=norm, s=3.0, cmap="viridis",
            rasterized=True, linewidths=0, zorder=2.0,
        )  # fmt: skip
        figure.colorbar(drawn, ax=axes, label="predicted rms position error (m)", shrink=0.7)
        chosen = np.array(sorted(selected), dtype=np.int64)
        cameras = scene.candidates.cameras.subset(chosen)
        size = 1.2 if far else 4
        axes.plot(cameras.x_m, cameras.y_m, "^", color=VERMILION, markersize=size, label="camera")
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_aspect("equal", adjustable="box")
        axes.set_xlabel("east x (m)")
        axes.set_ylabel("north y (m)")
        axes.legend(loc="best", markerscale=4.0 if far else 1.0)
        axes.set_title(
            f"{100.0 * float(np.mean(covered)):.1f} % of the samples are seen by a camera"
            + ("" if len(scene.journeys) <= _MOST_DRIVES else f" (first {_MOST_DRIVES} drives)")
        )
        return {"coverage.png": saved(figure, "png"), "coverage.svg": saved(figure, "svg")}
