from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.files import poles
from models.files.poles import read_poles
from models.geometry import Pose
from models.georeference import Georeference


def pole(x: Any, y: Any, **properties: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": [x, y]},
        "properties": properties,
    }


@pytest.fixture
def write(tmp_path: Path) -> Callable[[Any], Path]:
    def store(content: Any) -> Path:
        path = tmp_path / "poles.geojson"
        if isinstance(content, list):
            content = {"type": "FeatureCollection", "features": content}
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        return path

    return store


def test_points_and_what_they_say_are_read_in_order(write: Callable[[Any], Path]) -> None:
    found = read_poles(
        write([pole(3, -4.5, name="lamp", height_m=8, cost=120.5, colour="red"), pole(1e5, 2)])
    )
    assert found.x_m.tolist() == [3.0, 1e5]
    assert found.y_m.tolist() == [-4.5, 2.0]
    assert found.height_m[0] == 8.0
    assert math.isnan(found.height_m[1])
    assert found.cost.tolist() == [120.5, 0.0]
    assert found.name == ("lamp", "")
    assert not found.x_m.flags.writeable


BAD: dict[str, tuple[Any, str]] = {
    "not JSON": ("{", "not JSON"),
    "NaN": ('{"type": NaN}', "NaN is no number"),
    "nested too deeply": ("[" * 200_000, "nested too deeply"),
    "a list": ("[]", "FeatureCollection"),
    "no pole": ([], "at least one pole"),
    "no feature": ([1], r"features\[0\].geometry must be a Point"),
    "a line": (
        [{"geometry": {"type": "LineString", "coordinates": [[0, 0], [1, 1]]}}],
        "must be a Point, got LineString",
    ),
    "one coordinate": (
        [{"geometry": {"type": "Point", "coordinates": [0]}}],
        r"coordinates must be \[x, y\]",
    ),
    "text for a number": ([pole("a", 0)], r"coordinates\[0\] must be a number, got 'a'"),
    "true for a number": ([pole(0, True)], r"coordinates\[1\] must be a number"),
    "far away": ([pole(0, 1e8)], r"coordinates\[1\] must be finite and in"),
    "an endless integer": ([pole(10**400, 0)], r"coordinates\[0\] must be finite"),
    "height 0": ([pole(0, 0, height_m=0)], r"height_m must lie in \(0, 100\], got 0"),
    "height 101": ([pole(0, 0, height_m=101)], r"height_m must be finite and in \[0, 100\]"),
    "a negative cost": ([pole(0, 0, cost=-1)], r"features\[0\].properties.cost .* at least 0"),
    "properties as a list": (
        [{"geometry": {"type": "Point", "coordinates": [0, 0]}, "properties": [1]}],
        "properties must be an object",
    ),
    "two in one place": (
        [pole(5, 5), pole(1, 1), pole(5, 5)],
        r"features\[0\] and features\[2\] stand in one place",
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_what_is_wrong_is_said_in_one_line(write: Callable[[Any], Path], what: str) -> None:
    content, words = BAD[what]
    with pytest.raises(ValueError, match=words) as error:
        read_poles(write(content))
    assert "\n" not in str(error.value)
    assert "poles.geojson" in str(error.value)


def test_too_much_is_refused_before_it_is_parsed(
    write: Callable[[Any], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write([pole(0, 0), pole(1, 1)])
    monkeypatch.setattr(poles, "MOST_POLES", 1)
    with pytest.raises(ValueError, match="at most 1 poles, got 2"):
        read_poles(path)
    monkeypatch.setattr(poles, "MOST_BYTES", 20)
    with pytest.raises(ValueError, match="must be at most"):
        read_poles(path)


def test_a_missing_file_and_one_that_is_no_text_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such file"):
        read_poles(tmp_path / "nowhere.geojson")
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match="must be UTF-8"):
        read_poles(tmp_path / "binary")


def test_poles_on_the_earth_land_in_the_road_s_frame(tmp_path: Path) -> None:
    where = Georeference("EPSG:4326", "EPSG:32632", Pose(500_000.0, 5_300_000.0, 0.3))
    places = np.array([[10.0, 20.0], [-30.0, 5.0]])
    systems = {
        None: where.to_file(places),
        "EPSG:32632": where.projected_from_road.apply(places),
        "local": places,
    }
    for crs, coordinates in systems.items():
        features = [
            {"type": "Feature", "geometry": {"type": "Point", "coordinates": xy}}
            for xy in coordinates.tolist()
        ]
        content: dict[str, object] = {"type": "FeatureCollection", "features": features}
        if crs is not None:
            content["crs"] = {"type": "name", "properties": {"name": crs}}
        path = tmp_path / "earth.geojson"
        path.write_text(json.dumps(content))
        found = read_poles(path, where)
        np.testing.assert_allclose(np.column_stack((found.x_m, found.y_m)), places, atol=1e-6)
    content["crs"] = {"type": "name", "properties": {"name": "EPSG:999999"}}
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match="PROJ knows"):
        read_poles(path, where)
    del content["crs"]
    content["features"] = [
        {"type": "Feature", "geometry": {"type": "Point", "coordinates": [500, 600]}}
    ]
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match="must be longitude and latitude, or the file name"):
        read_poles(path, where)
