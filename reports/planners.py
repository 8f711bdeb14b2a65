"""What planners open next: cameras as GeoJSON and in SUMO, a bill of materials, a coverage map."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from models.files.geojson_out import area_feature, collection, feature
from models.files.sumo_out import Shape, additional_file
from models.shadows import Piece
from placement.output import cameras_table, to_csv
from placement.roadway import file_network, georeference_of
from reports.coverage_map import draw
from reports.streets import visible_ground

if TYPE_CHECKING:
    from placement.atomic import Content
    from placement.commands import Result

FIRST = 1  # camera, as on the page: whoever looks a number up there must find the same pole
_CAMERA, _SEEN = "213,94,0", "86,180,233,90"  # vermilion; sky blue, a third opaque


def write(result: Result) -> dict[str, Content]:
    """Return `cameras.geojson`, `bill_of_materials.csv`, `coverage.png` and `.svg`.

    With a road from SUMO also `cameras.add.xml`, which its own programs load beside the network.
    """
    table = cameras_table(result.scene, result.solution)
    grounds = visible_ground(result)
    files: dict[str, Content] = {
        "cameras.geojson": json.dumps(_as_geojson(result, table, grounds)) + "\n",
        "bill_of_materials.csv": to_csv(bill_of_materials(result)),
    }
    network = file_network(result.scene.instance)
    if network is not None and network.source == "SUMO":
        files["cameras.add.xml"] = additional_file(
            _shapes(table, grounds),
            f"cameras placed on {result.scene.instance.files['road.file'].name}",
        )
    return files | draw(result)


def bill_of_materials(result: Result) -> pd.DataFrame:
    """Return one row an item: poles, each type of camera, and what single poses cost beyond.

    Columns `item, type, quantity, unit_cost, cost`; costs are 0 where nothing has a price. The
    last row is the total, which is the solution's.
    """
    scene = result.scene
    candidates, chosen = scene.candidates, np.array(sorted(result.solution.selected), np.int64)
    rows: list[dict[str, Any]] = []
    kinds = candidates.kind[chosen]
    prices = np.array([candidates.kinds[kind].price for kind in kinds], dtype=np.float64)
    mounts = candidates.cost[chosen] - prices
    for cost in sorted(set(np.round(mounts, 9).tolist())):
        count = int(np.sum(np.round(mounts, 9) == cost))
        rows.append(_item("mounting of a camera", "", count, cost))
    for kind in sorted(set(kinds.tolist())):
        each = candidates.kinds[kind]
        name = each.name or f"{each.hfov_deg:g}° × {each.vfov_deg:g}°"
        label = f"{name}, {each.width_px} × {each.height_px} px"
        rows.append(_item("camera", label, int(np.sum(kinds == kind)), each.price))
    constraints = scene.problem.constraints
    total = float(candidates.cost[chosen].sum())
    if constraints.cost is not None:
        whole = constraints.total_cost(chosen)
        if abs(whole - total) > 1e-9 * max(1.0, whole):
            rows.append(_item("costs of single poses (budget.costs)", "", 1, whole - total))
        total = whole
    poles = len(set(candidates.mount[chosen].tolist()))
    rows.insert(0, _item("pole in use", "", poles, 0.0))
    rows.append(_item("total", "", len(chosen), total / max(len(chosen), 1)))
    return pd.DataFrame(rows)


def _item(item: str, kind: str, quantity: int, unit: float) -> dict[str, Any]:
    return {
        "item": item,
        "type": kind,
        "quantity": quantity,
        "unit_cost": unit,
        "cost": quantity * unit,
    }


def _as_geojson(result: Result, table: pd.DataFrame, grounds: list[list[Piece]]) -> dict[str, Any]:
    """Return a point a camera, and the ground it sees as areas, in the road file's coordinates."""
    where = georeference_of(result.scene.instance)
    features = []
    places = table[["x_m", "y_m"]].to_numpy(dtype=np.float64)
    numbered = enumerate(zip(table.to_dict("records"), grounds, strict=True), FIRST)
    for n, (row, pieces) in numbered:
        about = {"camera": n, **{str(key): value for key, value in row.items()}}
        point = where.to_file(places[n - FIRST : n - FIRST + 1])
        features.append(feature("Point", point, where, {**about, "what": "camera"}))
        if pieces:
            features.append(area_feature(pieces, where, {"camera": n, "what": "footprint"}))
    return collection(features, where)


def _shapes(table: pd.DataFrame, grounds: list[list[Piece]]) -> list[Shape]:
    """Return points and footprints in the network's own metres."""
    shapes = []
    numbered = enumerate(zip(table.to_dict("records"), grounds, strict=True), FIRST)
    for n, (row, pieces) in numbered:
        about = tuple(
            (str(key), f"{value:.10g}" if isinstance(value, float) else str(value))
            for key, value in row.items()
        )
        place = np.array([[row["x_m"], row["y_m"]]])
        shapes.append(Shape(f"camera_{n}", "camera", place, _CAMERA, 11.0, about))
        # SUMO's shapes know no holes: what lies in one is painted too.
        for m, piece in enumerate(pieces):
            name = f"footprint_{n}" + (f"_{m}" if m else "")
            shapes.append(Shape(name, "camera.footprint", piece.outline, _SEEN, 9.0))
    return shapes
