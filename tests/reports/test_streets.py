"""A placement over all streets: stretches, what the page packs, and the map in a browser."""

from __future__ import annotations

import base64
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from matplotlib.figure import Figure

from models.geometry import FloatArray
from placement.assemble import assemble
from placement.atomic import write_files
from placement.commands import Result
from placement.instance import instance_from_dict
from placement.output import cameras_seeing
from placement.prediction import predict
from placement.solve import solve
from reports.coverage_map import draw as draw_coverage
from reports.page.packed import UNIT_M, packed
from reports.page.placement_page import write
from reports.solution_map import draw
from reports.streets import UNSEEN, error_limits, stretches_of, visible_ground
from reports.streets_map import draw_network

CRS = {"type": "name", "properties": {"name": "local"}}
LINES = {"a": [[0, 0], [100, 0]], "b": [[100, 0], [220, 0]], "c": [[100, 0], [100, 90], [180, 120]]}
HOUSE = [[110, 8], [150, 8], [150, 40], [110, 40], [110, 8]]


def line_feature(name: str, points: list[list[int]]) -> dict[str, Any]:
    geometry = {"type": "LineString", "coordinates": points}
    return {"type": "Feature", "properties": {"id": name, "width_m": 6.0}, "geometry": geometry}


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    folder = tmp_path_factory.mktemp("streets")
    house = {"type": "Polygon", "coordinates": [HOUSE]}
    features = [line_feature(name, points) for name, points in LINES.items()]
    features.append({"type": "Feature", "properties": {"height": 12}, "geometry": house})
    town = {"type": "FeatureCollection", "crs": CRS, "features": features}
    (folder / "town.geojson").write_text(json.dumps(town))
    instance = instance_from_dict(
        {
            "road": {"file": "town.geojson"},
            "mounts": {"spacing_m": 30.0},
            "camera": {"yaw_deg": [0, 90, 270], "pitch_deg": [30], "fov_deg": [[60, 45]]},
            "objective": {"kind": "localisation"},
            "budget": {"cameras": 4},
        },
        folder=folder,
        name="a <town>",
    )
    scene = assemble(instance)
    solution = solve(scene.problem, "greedy")
    return Result(scene, solution, predict(scene, solution.selected))


def test_stretches_cover_every_street_once_and_tell_what_is_seen(result: Result) -> None:
    found = stretches_of(result)
    lengths = np.array([shapely.LineString(line).length for line in found.lines])
    assert lengths.sum() == pytest.approx(result.scene.road.length_m, rel=1e-2)  # ends
    points = result.scene.points
    seen = cameras_seeing(result.scene.information, result.solution.selected) > 0
    assert 0.05 < seen.mean() < 0.95
    share = lengths[found.kind != UNSEEN].sum() / lengths.sum()
    assert share == pytest.approx(seen.mean(), abs=0.02)
    assert found.width_m == pytest.approx(3.0)  # a lane of two-way streets 6 m wide
    # Each sample lies on a stretch of its own class.
    sigma, limits = result.prediction.position_sigma_m, error_limits(result)
    kinds = np.where(seen, 1 + np.searchsorted(limits, sigma), UNSEEN)
    for kind in np.unique(kinds):
        own = shapely.MultiLineString([found.lines[i] for i in np.flatnonzero(found.kind == kind)])
        assert own.distance(shapely.points(points.xy[kinds == kind])).max() < 0.25


def unpacked(lines: dict[str, Any]) -> list[FloatArray]:
    """Do what `city.js` does."""
    counts = np.frombuffer(base64.b64decode(lines["counts"]), "<u4")
    steps = np.frombuffer(base64.b64decode(lines["steps"]), "<i2").reshape(-1, 2).astype(int)
    places, here = [], np.zeros(2, int)
    far = {i: np.array([x, y]) for i, x, y in lines["far"]}
    for i, step in enumerate(steps):
        here = far.get(i, here + step)
        places.append(here)
    return np.split(np.array(places) * UNIT_M, np.cumsum(counts)[:-1])


def test_what_is_packed_is_unpacked_to_half_a_decimetre() -> None:
    rng = np.random.default_rng(0)
    lines = [rng.uniform(-9000.0, 9000.0, (n, 2)) for n in (2, 5, 1)]
    lines.append(lines[1][:1] + rng.normal(0.0, 30.0, (40, 2)).cumsum(axis=0))
    origin = np.array([123.0, -45.0])
    text = packed(lines, origin)
    assert text["far"]  # some steps are kilometres long
    for line, again in zip(lines, unpacked(text), strict=True):
        np.testing.assert_allclose(again, line - origin, atol=0.5001 * UNIT_M)
    assert packed([], origin) == {"counts": "", "steps": "", "far": []}


def test_all_that_is_filled_turns_the_same_way(result: Result) -> None:
    """Else the ground of two cameras would cancel where they both look."""
    page = str(write(result)["index.html"])
    found = re.search(r'id="city">(.*?)</script>', page)
    assert found is not None
    filled = [layer for layer in json.loads(found[1])["layers"] if "fill" in layer]
    assert len(filled) == 2
    for layer in filled:
        for ring in unpacked(layer["lines"]):
            assert shapely.LinearRing(ring).is_ccw
    assert len(filled[1]["owner"]) == len(unpacked(filled[1]["lines"])) >= 4


def test_ground_is_what_buildings_leave(result: Result) -> None:
    house = shapely.Polygon(HOUSE)
    for pieces in visible_ground(result):
        for piece in pieces:
            ground = shapely.Polygon(piece.outline, piece.holes)
            assert ground.intersection(house).area < 1e-6


def test_the_map_shows_every_camera_a_scale_and_a_legend(result: Result) -> None:
    axes = Figure().add_subplot()
    draw_network(axes, result)
    assert any(len(line.get_xdata()) == len(result.solution.selected) for line in axes.lines)
    assert {text.get_text() for text in axes.texts} == {"50 m"}
    legend = axes.get_legend()
    assert legend is not None
    words = {text.get_text() for text in legend.get_texts()}
    assert {"camera", "building", "seen by no camera", "error below 0.1 m"} <= words


def test_figures_are_written_and_twice_the_same(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in ("one", "two"):
        write_files(tmp_path / folder, draw(result))
    monkeypatch.setattr("reports.coverage_map._MANY", 1)  # as from afar
    write_files(tmp_path / "one", draw_coverage(result))
    for name in ("map.png", "map.svg"):
        content = (tmp_path / "one" / name).read_bytes()
        assert content == (tmp_path / "two" / name).read_bytes()
    assert (tmp_path / "one" / "coverage.svg").stat().st_size > 1000


# --- in a browser ---------------------------------------------------------------------------

FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"]
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="module")
def tab(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("no Chromium on this machine: on Debian, apt install chromium")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = tmp_path_factory.mktemp("page") / "index.html"
    path.write_text(str(write(result)["index.html"]), encoding="utf-8")
    assert path.stat().st_size < 100_000  # no library for figures
    faults: list[str] = []
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=FLAGS)
        tab = browser.new_page(viewport={"width": 1200, "height": 900})
        tab.on("pageerror", lambda error: faults.append(str(error)))
        tab.on("request", lambda r: r.url.startswith(("file:", "data:")) or faults.append(r.url))
        tab.goto(path.as_uri())
        tab.wait_for_selector("body[data-ready=yes]")
        yield tab
        browser.close()
    assert faults == []


def view(tab: Any) -> dict[str, float]:
    found: dict[str, float] = tab.evaluate("document.getElementById('map').mapView()")
    return found


def drawn(tab: Any) -> int:
    return int(tab.evaluate("document.getElementById('map').dataset.drawn"))


def middle(tab: Any) -> tuple[float, float]:
    box = tab.locator("#map").bounding_box()
    return box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]


@pytest.fixture
def fresh(tab: Any) -> Any:
    tab.keyboard.press("Control+Home")
    tab.focus("#map")
    tab.keyboard.press("Home")
    tab.wait_for_timeout(200)
    return tab


def test_a_drag_moves_the_map_without_drawing_it_anew(fresh: Any) -> None:
    x, y = middle(fresh)
    before, drawings = view(fresh), drawn(fresh)
    fresh.mouse.move(x, y)
    fresh.mouse.down()
    for n in range(1, 6):
        fresh.mouse.move(x + 10 * n, y - 6 * n)
        assert drawn(fresh) == drawings
    after = view(fresh)
    fresh.mouse.up()
    assert after["x"] == pytest.approx(before["x"] - 50 / before["scale"])
    assert after["y"] == pytest.approx(before["y"] - 30 / before["scale"])
    fresh.wait_for_function(f"document.getElementById('map').dataset.drawn === '{drawings + 1}'")


def test_the_wheel_zooms_about_the_pointer(fresh: Any) -> None:
    x, y = middle(fresh)
    before = view(fresh)
    fresh.mouse.move(x + 100, y + 50)
    fresh.mouse.wheel(0, -300)
    fresh.wait_for_function(
        f"document.getElementById('map').mapView().scale > {1.2 * before['scale']}"
    )
    after = view(fresh)
    for axis, offset in (("x", 100), ("y", -50)):
        held = before[axis] + offset / before["scale"]
        assert after[axis] + offset / after["scale"] == pytest.approx(
            held, abs=1.0 / before["scale"]
        )


def test_keys_pan_and_zoom(fresh: Any) -> None:
    before = view(fresh)
    fresh.keyboard.press("ArrowRight")
    assert view(fresh)["x"] > before["x"]
    fresh.keyboard.press("+")
    assert view(fresh)["scale"] == pytest.approx(1.5 * before["scale"])
    fresh.keyboard.press("Home")
    assert view(fresh) == before


def test_a_row_brings_its_camera_which_tells_of_itself(fresh: Any, result: Result) -> None:
    fresh.locator("tr[data-camera='2']").click()
    now = view(fresh)
    candidate = sorted(result.solution.selected)[2]
    cameras, low = result.scene.candidates.cameras, result.scene.points.xy.min(axis=0) - 100.0
    assert now["pointed"] == 2
    assert now["x"] == pytest.approx(cameras.x_m[candidate] - low[0], abs=0.01)
    assert now["y"] == pytest.approx(cameras.y_m[candidate] - low[1], abs=0.01)
    mount = result.scene.candidates.mount[candidate]
    assert f"camera 3, mount {mount}" in fresh.text_content(".note")


def test_streets_cameras_and_ground_are_drawn_in_their_colours(fresh: Any) -> None:
    script = (
        "() => { const c = [...document.querySelectorAll('#map canvas')].find(one =>"
        " one.style.visibility === 'visible'); const d ="
        " c.getContext('2d').getImageData(0, 0, c.width, c.height).data; const found = new Set();"
        " for (let i = 0; i < d.length; i += 4) found.add([d[i], d[i+1], d[i+2]].join());"
        " return [...found]; }"
    )
    colours = set(fresh.evaluate(script))
    assert "213,94,0" in colours  # a camera
    assert "217,212,204" in colours  # a building
    assert "169,169,169" in colours  # a street that no camera sees
    assert "0,114,178" in colours  # one that is seen well
    assert fresh.text_content(".bar").endswith(" m")
    assert fresh.locator(".legend li").count() == 7
