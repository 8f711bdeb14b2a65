"""The page of a placement over all streets of a network: a map that is quick for a whole city.

Bokeh draws every line anew for every pan, which takes half a second for a city; here `city.js`
moves what is drawn. The rest is as on the page of one road.
"""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

import numpy as np

from models.geometry import FloatArray
from placement.output import cameras_table
from reports.page.document import asset, certificate, document, embedded, table
from reports.page.packed import UNIT_M, packed
from reports.streets import COLOURS, Stretches, buildings_near, stretches_of, visible_ground
from reports.style import SKY, VERMILION

if TYPE_CHECKING:
    import pandas as pd

    from placement.commands import Result

_BUILDINGS = "#d9d4cc"
_LEAST_PX = (1.0, 2.2)  # of a street that no camera sees, and of one that is seen
_MARGIN_M = 100.0
_MOST_ROWS = 20_000  # of the table of cameras


def city_page(result: Result) -> str:
    """Return the page: certificate, map with scale and legend, share of streets seen, cameras."""
    stretches = stretches_of(result)
    frame = cameras_table(result.scene, result.solution)
    frame.insert(0, "camera", np.arange(1, len(frame) + 1))
    count = len(frame)
    title = f"{result.scene.instance.name}: {count} camera{'' if count == 1 else 's'}"
    reach = result.scene.instance.camera.max_range_m
    rows = [f'tabindex="0" data-camera="{n}"' for n in range(min(count, _MOST_ROWS))]
    sections = [
        f"<h1>{html.escape(title)}</h1>",
        f"<p>{certificate(result.solution)}</p>",
        _map(stretches),
        "<p>Drag to pan, wheel to zoom, or use the arrow keys, + and −. Point at a camera for the "
        f"ground it sees past buildings, within {reach:g} m; a row below brings the map to its "
        "camera.</p>",
        table(_shares(stretches), caption="All streets, one lane of each carriageway"),
        "<h2>Cameras</h2>",
        table(frame.head(_MOST_ROWS), rows=rows),
        embedded("city", _city(result, stretches, frame)),
    ]
    return document(f"{title} – placement", sections, scripts=[asset("city.js")])


def _map(stretches: Stretches) -> str:
    items = [(colour, label) for colour, label in zip(COLOURS, stretches.labels, strict=True)]
    legend = "".join(
        f'<li><i style="background:{colour}"></i>{html.escape(label)}</li>'
        for colour, label in (
            (VERMILION, "camera"),
            (f"{SKY}66", "ground that a camera sees"),
            (_BUILDINGS, "building"),
            *items,
        )
    )
    buttons = "".join(
        f'<button type="button" data-does="{does}" aria-label="{label}">{sign}</button>'
        for does, label, sign in (
            ("in", "zoom in", "+"),
            ("out", "zoom out", "−"),
            ("all", "the whole city", "⌂"),
        )
    )
    return (
        '<figure><div id="map" class="map" tabindex="0" role="application" '
        'aria-label="Map of the streets and their cameras"><canvas></canvas><canvas></canvas>'
        '<canvas class="marks"></canvas>'
        f'<div class="tools">{buttons}</div><div class="north" aria-hidden="true">N ↑</div>'
        '<div class="bar"></div><output class="note" aria-live="polite"></output></div>'
        f'<ul class="legend">{legend}</ul></figure>'
    )


def _shares(stretches: Stretches) -> pd.DataFrame:
    """Return how much of the streets is of each class, in km and per cent."""
    import pandas as pd

    lengths = np.array([_length(line) for line in stretches.lines])
    by_kind = np.bincount(stretches.kind, lengths, len(stretches.labels))
    return pd.DataFrame(
        {
            "streets": stretches.labels,
            "km": by_kind / 1000.0,
            "%": 100.0 * by_kind / max(float(by_kind.sum()), 1e-9),
        }
    )


def _length(line: FloatArray) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _city(result: Result, stretches: Stretches, frame: pd.DataFrame) -> dict[str, Any]:
    """Lay out what `city.js` draws, from the bottom up, in metres from the box's corner."""
    xy = result.scene.points.xy
    low, high = xy.min(axis=0) - _MARGIN_M, xy.max(axis=0) + _MARGIN_M
    grounds = visible_ground(result)
    # Pieces with holes are filled by their outlines: a courtyard's shadow is seldom worth a byte.
    pieces = [(n, _anticlockwise(p.outline)) for n, found in enumerate(grounds) for p in found]
    buildings = [_anticlockwise(ring) for ring in buildings_near(result, _MARGIN_M)]
    layers: list[dict[str, Any]] = [
        {"fill": _BUILDINGS, "alpha": 1.0, "lines": packed(buildings, low)},
    ]
    for kind, colour in enumerate(COLOURS):
        lines = [stretches.lines[i] for i in np.flatnonzero(stretches.kind == kind)]
        least = _LEAST_PX[min(kind, 1)]
        layers.append(
            {"stroke": colour, "width": stretches.width_m, "least": least,
             "lines": packed(lines, low)}
        )  # fmt: skip
    layers.insert(
        2,
        {"fill": SKY, "alpha": 0.4, "owner": [n for n, _ in pieces],
         "lines": packed([outline for _, outline in pieces], low)},
    )  # fmt: skip
    places = frame[["x_m", "y_m"]].to_numpy(dtype=np.float64) - low
    yaw = np.radians(frame["yaw_deg"].to_numpy(dtype=np.float64))
    return {
        "unit": UNIT_M,
        "box": [0.0, 0.0, *np.round(high - low, 1).tolist()],
        "camera": VERMILION,
        "layers": layers,
        "cameras": np.round(np.column_stack([places, yaw]), 3).tolist(),
        "texts": [_text(row) for row in frame.to_dict("records")],
    }


def _anticlockwise(ring: FloatArray) -> FloatArray:
    """Return the ring the one way round: filled together, two that turn against each other cancel.

    Where they overlap, that is, by the rule of the winding number that `city.js` fills by.
    """
    x, y = (ring - ring[0]).T
    twice_area = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    return ring if twice_area >= 0.0 else ring[::-1]


def _text(row: dict[Any, Any]) -> str:
    kind = f", {row['type']}" if "type" in row else ""
    return (
        f"camera {row['camera']}, mount {row['mount']}, {row['height_m']:g} m up{kind}: yaw "
        f"{row['yaw_deg']:.1f}°, pitch {row['pitch_deg']:.1f}°, field of view "
        f"{row['hfov_deg']:.0f}° × {row['vfov_deg']:.0f}°"
    )
