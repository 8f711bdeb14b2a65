"""The pages: self-contained, and in a real browser they step, sort, point and print."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from placement.assemble import assemble
from placement.commands import Result, solve_into
from placement.instance import instance_from_dict
from placement.prediction import predict
from placement.solve import solve
from placement.validation import validate
from reports.page.document import document, embedded, table
from reports.page.placement_page import write
from reports.page.study_page import study_page
from reports.page.view import view_of

MOST_BYTES = 3_000_000
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FLAGS = [
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
]  # fmt: skip


@pytest.fixture(scope="module")
def result() -> Result:
    instance = instance_from_dict(
        {
            "road": {"pieces": [{"length": 60}, {"length": 30, "curvature": 0.02}]},
            "camera": {"yaw_deg": [0, 180], "pitch_deg": [35]},
            "errors": {"model": "radius"},
            "objective": {"kind": "localisation"},
            "obstacles": {"polygons": [[[30, 20], [40, 20], [40, 30]]]},
            "budget": {"cameras": 3},
        },
        name='a "name" for $5 & <tags>',
    )
    scene = assemble(instance)
    solution = solve(scene.problem, "greedy")
    validation = validate(scene, solution.selected, runs=3, seed=0)
    return Result(scene, solution, predict(scene, solution.selected), validation)


@pytest.fixture(scope="module")
def page(result: Result) -> str:
    return str(write(result)["index.html"])


def test_the_page_needs_no_network_and_is_small(page: str) -> None:
    assert len(page.encode()) < MOST_BYTES
    assert not re.search(r"<(?:script|link|img)[^>]*(?:src|href)=[\"'](?!data:)", page)


def test_names_are_escaped(page: str) -> None:
    assert "<tags>" not in page
    assert "&lt;tags&gt;" in page


def test_each_step_adds_the_camera_that_helps_most(result: Result) -> None:
    view = view_of(result)
    assert view.nested
    assert [step.k for step in view.steps] == [0, 1, 2, 3]
    for before, after in zip(view.steps, view.steps[1:], strict=False):
        assert set(before.members) < set(after.members)
        assert np.mean(after.position_sigma_m) < np.mean(before.position_sigma_m)
    first = view.candidates[view.steps[1].members[0]]
    values = {i: result.scene.problem.objective.value(np.array([i])) for i in view.candidates}
    assert max(values, key=lambda i: values[i]) == first


def test_a_budget_curve_gives_the_steps(result: Result) -> None:
    a, b, c = result.solution.selected
    curve = Result(
        result.scene, result.solution, result.prediction, None, {1: (c,), 2: (a, b), 3: (a, b, c)}
    )
    view = view_of(curve)
    assert not view.nested
    chosen = [tuple(view.candidates[n] for n in step.members) for step in view.steps]
    assert chosen == [(c,), (a, b), (a, b, c)]


def test_text_inside_json_cannot_end_the_script() -> None:
    text = embedded("x", {"name": "</script><b>"})
    assert text.count("</script>") == 1
    inner = re.search(r">(.*)</script>", text)
    assert inner is not None
    assert json.loads(inner[1]) == {"name": "</script><b>"}


def test_a_study_s_page_holds_its_figures_and_tables(tmp_path: Path) -> None:
    (tmp_path / "figure.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    pd.DataFrame({"k": range(600), "what": ["<b>"] * 600}).to_csv(
        tmp_path / "rows.csv", index=False
    )
    (tmp_path / "foreign.csv").write_text("not its own\n")
    text = study_page("a study", "what it asks", tmp_path, {"figure.svg", "rows.csv"})
    assert "data:image/svg+xml;base64," in text
    assert "The first 500 of 600 rows" in text
    assert text.count("<tr") == 501
    assert "foreign" not in text
    assert "<b>" not in text


# --- in a browser ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("no Chromium on this machine: on Debian, apt install chromium")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=found, args=FLAGS)
        yield opened
        opened.close()


@contextmanager
def opened(browser: Any, path: Path, ready: str) -> Iterator[Any]:
    """Open a page until `ready` is there; at the end, nothing was complained of or asked for."""
    tab = browser.new_page(viewport={"width": 1200, "height": 900})
    faults: list[str] = []
    tab.on("pageerror", lambda error: faults.append(str(error)))
    tab.on("console", lambda m: faults.append(m.text) if m.type in ("error", "warning") else None)
    tab.on("request", lambda r: r.url.startswith(("file:", "data:")) or faults.append(r.url))
    tab.goto(path.as_uri())
    tab.wait_for_selector(ready)
    yield tab
    tab.close()
    assert faults == []


@pytest.fixture
def tab(browser: Any, page: str, tmp_path: Path) -> Iterator[Any]:
    path = tmp_path / "index.html"
    path.write_text(page, encoding="utf-8")
    with opened(browser, path, "body[data-ready=yes]") as tab:
        yield tab


def columns(tab: Any, name: str) -> dict[str, list[float]]:
    script = (
        "name => { const data = Bokeh.documents.map(d => d.get_model_by_name(name)).find(m => m)"
        ".data; return Object.fromEntries(Object.entries(data).map(([k, v]) =>"
        " [k, Array.from(v)])); }"
    )
    found: dict[str, list[float]] = tab.evaluate(script, name)
    return found


def test_the_slider_steps_through_k_by_keyboard(tab: Any, result: Result) -> None:
    full = columns(tab, "along")["error"]
    assert sum(columns(tab, "cameras")["alpha"]) == 3
    tab.focus("#step")
    tab.keyboard.press("Home")
    assert "k = 0" in tab.text_content("#step-text")
    assert sum(columns(tab, "cameras")["alpha"]) == 0
    assert sum(columns(tab, "along")["error"]) > sum(full)
    tab.keyboard.press("End")
    assert columns(tab, "along")["error"] == full
    np.testing.assert_allclose(full, result.prediction.position_sigma_m, rtol=1e-3)


def test_a_camera_s_row_shows_its_ground_when_focused(tab: Any) -> None:
    row = tab.locator("tr[data-camera]").first
    row.focus()
    shades = columns(tab, "ground")["alpha"]
    assert sorted(shades) == [0.1, 0.1, 0.45]
    assert shades[int(row.get_attribute("data-camera"))] == 0.45
    tab.focus("#step")
    assert set(columns(tab, "ground")["alpha"]) == {0.1}


def test_pointing_along_the_curve_marks_the_map(tab: Any) -> None:
    box = tab.locator("figure").nth(1).bounding_box()
    tab.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 0.6 * box["height"])
    tab.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.6 * box["height"], steps=5)
    tab.wait_for_function(
        "Bokeh.documents.map(d => d.get_model_by_name('here')).find(m => m).data.x.length === 1"
    )
    here, along = columns(tab, "here"), columns(tab, "along")
    at = along["x"].index(here["x"][0])
    assert here["y"][0] == along["y"][at]
    assert 0.2 < along["s"][at] / along["s"][-1] < 0.8


def test_wheel_and_drag_zoom_and_pan_the_map(tab: Any) -> None:
    reach = (
        "() => { const p = Bokeh.documents.map(d => d.get_model_by_name('map')).find(m => m);"
        " return [p.x_range.start, p.x_range.end]; }"
    )
    before = tab.evaluate(reach)
    box = tab.locator("figure").first.bounding_box()
    tab.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 200)
    tab.mouse.wheel(0, -300)
    tab.wait_for_timeout(300)
    zoomed = tab.evaluate(reach)
    assert zoomed[1] - zoomed[0] < before[1] - before[0]
    tab.mouse.down()
    tab.mouse.move(box["x"] + 0.5 * box["width"] - 100, box["y"] + 200, steps=5)
    tab.mouse.up()
    tab.wait_for_timeout(300)
    panned = tab.evaluate(reach)
    assert panned[0] > zoomed[0]


def test_headers_sort_their_table_and_say_so(tab: Any) -> None:
    header = tab.locator("th", has_text="x_m").first
    cells = "tr[data-camera] td:nth-child(3)"
    for direction in ("ascending", "descending"):
        header.locator("button").focus()
        tab.keyboard.press("Enter")
        assert header.get_attribute("aria-sort") == direction
        shown = [float(text) for text in tab.locator(cells).all_text_contents()]
        assert shown == sorted(shown, reverse=direction == "descending")


def test_words_and_numbers_sort_apart(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "table.html"
    frame = pd.DataFrame({"mixed": ["10", "b", "9", "a"], "n": [1, 2, 3, 4]})
    path.write_text(document("t", [table(frame)]), encoding="utf-8")
    tab = browser.new_page()
    tab.goto(path.as_uri())
    tab.click("th button")
    assert tab.locator("td:first-child").all_text_contents() == ["9", "10", "a", "b"]
    tab.close()


def test_it_prints_on_paper(tab: Any, tmp_path: Path) -> None:
    tab.emulate_media(media="print")
    assert not tab.is_visible("#step")
    tab.pdf(path=tmp_path / "page.pdf", format="A4")
    assert (tmp_path / "page.pdf").stat().st_size > 10_000


SITE = """
[road.construct]
start = [0, 0, 0]
goal = [120, 0, 0]
obstacles = [ [[45, -12], [80, -15], [60, 20]] ]
min_radius_m = 15
bends = "arcs"
radius_factors = [1]
[mounts]
spacing_m = 20
[camera]
yaw_deg = [0, 180]
pitch_deg = [35]
[budget]
cameras = 3
"""


def test_the_page_of_a_road_that_was_built_shows_it_and_steps(browser: Any, tmp_path: Path) -> None:
    source, out = tmp_path / "site.toml", tmp_path / "out"
    source.write_text(SITE)
    solve_into(out, str(source), method="greedy", quiet=True)
    page = out / "index.html"
    assert page.stat().st_size < MOST_BYTES
    path = pd.read_csv(out / "along_path.csv")
    with opened(browser, page, "body[data-ready=yes]") as tab:
        along = columns(tab, "along")
        np.testing.assert_allclose(along["x"], path["x_m"], atol=1e-6)
        np.testing.assert_allclose(along["y"], path["y_m"], atol=1e-6)
        assert np.ptp(along["y"]) > 10.0  # it goes round the obstacle
        tab.focus("#step")
        tab.keyboard.press("Home")
        assert "k = 0" in tab.text_content("#step-text")
        assert sum(columns(tab, "along")["error"]) > sum(along["error"])
        assert tab.locator("tr[data-camera]").count() == 3


def test_a_study_s_page_sorts_and_shows_its_figures(browser: Any, tmp_path: Path) -> None:
    square = "<svg xmlns='http://www.w3.org/2000/svg' width='9' height='9'/>"
    (tmp_path / "figure.svg").write_text(square)
    pd.DataFrame({"k": [3, 1, 2]}).to_csv(tmp_path / "rows.csv", index=False)
    page = tmp_path / "index.html"
    own = {"figure.svg", "rows.csv"}
    text = study_page("a study", "what it asks", tmp_path, own, "what was left out")
    page.write_text(text, encoding="utf-8")
    with opened(browser, page, "table") as tab:
        assert tab.evaluate("document.querySelector('img').naturalWidth") == 9
        tab.click("th button")
        assert tab.locator("tbody td").all_text_contents() == ["1", "2", "3"]
        assert tab.is_visible("text=what was left out.")
