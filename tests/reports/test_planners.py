"""What planners open: `placement roads`, cameras in a file's own coordinates, SUMO's shapes."""

from __future__ import annotations

import json
import shutil
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyproj
import pytest
import shapely
from typer.testing import CliRunner

from models.files.roadfile import read_road_file
from placement.cli import app
from placement.commands import solve_into
from reports.roads import register

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import sumolib

NET = (
    '<net><location netOffset="-294000,-5497000" convBoundary="0,0,1,1" origBoundary="0,0,1,1" '
    'projParameter="EPSG:32632"/>'
    '<edge id="a" from="A" to="B"><lane id="a_0" index="0" speed="9" length="120" '
    'shape="0,-1.6 120,-1.6"/></edge>'
    '<edge id="-a" from="B" to="A"><lane id="-a_0" index="0" speed="9" length="120" '
    'shape="120,1.6 0,1.6"/></edge></net>'
)
SETTINGS = """
[mounts]
spacing_m = 30
cost = 400.0
[camera]
yaw_deg = [0, 90]
pitch_deg = [30]
fov_deg = [[60, 45]]
price = 250.0
[errors]
model = "radius"
persistent = false
[objective]
kind = "localisation"
[budget]
cameras = 3
"""


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("planners")
    (folder / "s.net.xml").write_text(NET)
    path = folder / "s.toml"
    path.write_text('[road]\nfile = "s.net.xml"\n' + SETTINGS)
    solve_into(folder / "out", str(path), method="greedy", quiet=True)
    return folder / "out"


def test_sumo_s_own_library_opens_the_cameras(solved: Path) -> None:
    placements = pd.read_csv(solved / "placements.csv")
    shapes = sumolib.xml.parse(str(solved / "cameras.add.xml"), ["poly", "poi"])
    points, outlines = [], []
    for each in shapes:
        (points if each.name == "poi" else outlines).append(each)
    found = np.array([[float(each.x), float(each.y)] for each in points])
    np.testing.assert_allclose(found, placements[["x_m", "y_m"]].to_numpy(), atol=1e-3)
    polygons = sumolib.shapes.polygon.read(str(solved / "cameras.add.xml"))
    assert len(polygons) == len(outlines) == len(points) == 3
    assert all(shapely.Polygon(each.shape).area > 1.0 for each in polygons)


def test_cameras_lie_where_the_network_s_projection_says(solved: Path) -> None:
    content = json.loads((solved / "cameras.geojson").read_text())
    assert content["crs"]["properties"]["name"] == "EPSG:32632"
    placements = pd.read_csv(solved / "placements.csv")
    points = [f for f in content["features"] if f["geometry"]["type"] == "Point"]
    found = np.array([f["geometry"]["coordinates"] for f in points])
    wanted = placements[["x_m", "y_m"]].to_numpy() + np.array([294_000.0, 5_497_000.0])
    np.testing.assert_allclose(found, wanted, atol=1e-3)
    assert [f["properties"]["camera"] for f in points] == [1, 2, 3]  # as the page numbers them
    assert [f["properties"]["pitch_deg"] for f in points] == placements["pitch_deg"].tolist()
    assert sum(f["properties"]["what"] == "footprint" for f in content["features"]) == 3
    to = pyproj.Transformer.from_crs("EPSG:32632", "EPSG:4326", always_xy=True)
    longitude, latitude = to.transform(*found[0])
    assert (longitude, latitude) == pytest.approx((6.16, 49.59), abs=0.05)  # Luxembourg


def test_the_bill_adds_up_to_what_the_solution_costs(solved: Path) -> None:
    bill = pd.read_csv(solved / "bill_of_materials.csv").fillna("")
    record = json.loads((solved / "solution.json").read_text())
    assert record["cost"] == pytest.approx(3 * 650.0)
    total = bill[bill["item"] == "total"]["cost"].iloc[0]
    assert total == pytest.approx(record["cost"])
    assert bill[bill["item"] != "total"]["cost"].sum() == pytest.approx(total)
    assert bill[bill["item"] == "camera"]["quantity"].sum() == 3
    assert (solved / "coverage.png").read_bytes()[:4] == b"\x89PNG"


def test_a_new_solution_leaves_no_old_sumo_file(solved: Path, tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    path.write_text("[road]\npieces = [{length = 80}]\n" + SETTINGS)
    out = tmp_path / "again"
    shutil.copytree(solved, out)
    solve_into(out, str(path), method="greedy", quiet=True)
    assert not (out / "cameras.add.xml").exists()
    content = json.loads((out / "cameras.geojson").read_text())
    assert content["crs"]["properties"]["name"] == "local"


@pytest.fixture(scope="module", autouse=True)
def command() -> None:
    if "roads" not in [info.name or info.callback.__name__ for info in app.registered_commands]:
        register(app)


def test_roads_tells_and_draws(tmp_path: Path) -> None:
    net = tmp_path / "s.net.xml"
    net.write_text(NET)
    for name, start in (("a.png", b"\x89PNG"), ("a.svg", b"<?xml"), ("a.geojson", b"{")):
        out = tmp_path / name
        result = CliRunner().invoke(app, ["roads", str(net), "--out", str(out)])
        assert result.exit_code == 0, result.output
        assert out.read_bytes().startswith(start)
    text = result.output
    assert "SUMO, 2 carriageways between 2 nodes" in text
    assert "0.240 km" in text
    assert "all straight" in text
    assert "coordinates: EPSG:32632" in text
    again = read_road_file(tmp_path / "a.geojson")
    assert again.length_m == pytest.approx(240.0, abs=0.1)


def test_roads_refuses_what_it_cannot_write(tmp_path: Path) -> None:
    net = tmp_path / "s.net.xml"
    net.write_text(NET)
    result = CliRunner().invoke(app, ["roads", str(net), "--out", str(tmp_path / "a.pdf")])
    assert isinstance(result.exception, ValueError)
    assert "must end in .png, .svg or .geojson" in str(result.exception)


@pytest.mark.parametrize("name", ["xodr/fabriksgatan.xodr", "osm/town_10.068_48.135.osm"])
def test_roads_reads_the_shared_files(name: str, shared_data: Callable[[str], Path]) -> None:
    result = CliRunner().invoke(app, ["roads", str(shared_data(name))])
    assert result.exit_code == 0
    assert "left out or mended" in result.output


def test_the_page_draws_every_street_on_its_own(tmp_path: Path) -> None:
    from placement.assemble import load
    from reports.page.charts import _between
    from reports.page.view import _edges

    (tmp_path / "s.net.xml").write_text(NET)
    (tmp_path / "s.toml").write_text('[road]\nfile = "s.net.xml"\n' + SETTINGS)
    left, right = _edges(load(tmp_path / "s.toml"))
    assert np.isnan(left[:, 0]).sum() == np.isnan(right[:, 0]).sum() == 1
    ground = _between(left, right)
    (cut,) = np.flatnonzero(np.isnan(ground[:, 0]))
    areas = [shapely.Polygon(part).area for part in (ground[:cut], ground[cut + 1 :])]
    assert areas == pytest.approx([120 * 3.2] * 2)
