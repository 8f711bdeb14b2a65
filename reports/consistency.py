"""The picture of honesty: NEES over the drive with its χ² band, for both filters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from placement.validation import Profile
from reports.style import GREY, ORANGE, VERMILION, saved, style

if TYPE_CHECKING:
    from placement.atomic import Content
    from placement.commands import Result

COLOURS = {"ekf": ORANGE, "schmidt": VERMILION}
LABELS = {"ekf": "EKF, offsets taken for white noise", "schmidt": "Schmidt–Kalman"}


def draw(result: Result) -> dict[str, Content]:
    """Draw `consistency.png` and `.svg` of a validated solution; nothing before it is driven."""
    if result.validation is None:
        return {}
    with style():
        figure = Figure(figsize=(8.0, 3.6))
        axes = figure.subplots()
        draw_nees(axes, result.validation.profile)
        runs = result.validation.summary["runs"]
        axes.set_title(f"{result.scene.instance.name}: mean over {runs} runs", fontsize=9)
    return {"consistency.png": saved(figure, "png"), "consistency.svg": saved(figure, "svg")}


def draw_nees(axes: Axes, profile: Profile) -> None:
    """Draw the mean over runs of each filter's NEES of (x, y, heading), expected to be 3."""
    axes.fill_between(
        profile.time_s,
        profile.nees_low,
        profile.nees_high,
        color=GREY,
        alpha=0.4,
        linewidth=0,
        label="95 % of right filters",
    )
    for name, nees in profile.nees.items():
        axes.plot(profile.time_s, nees, color=COLOURS[name], linewidth=0.9, label=LABELS[name])
    axes.set_xlabel("time t (s)")
    axes.set_ylabel("NEES of x, y, heading (–)")
    axes.set_xlim(0.0, float(profile.time_s[-1]))
    highest = max(float(nees.max()) for nees in profile.nees.values())
    axes.set_ylim(0.0, 1.35 * max(highest, float(profile.nees_high.max())))  # room for the legend
    axes.legend(loc="upper right", ncols=3, fontsize=8)
