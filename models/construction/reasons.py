"""Why there is no road: what is shut in, which gap is too narrow, or which radius too large."""

from __future__ import annotations

import shapely

from models.construction.site import Site

_HALVINGS = 12


def why_none(site: Site, min_radius_m: float, width_m: float, late: bool) -> str:
    """Return one line: shut in, corridor too narrow, out of time, or radius too large."""
    polygons = [shapely.Polygon(ring) for ring in site.rings]
    if not _joined(site, polygons, 0.0):
        return f"{_shut_in(site, polygons)}: no road can leave"
    if not _joined(site, polygons, site.keep_m):
        low, high = 0.0, site.keep_m
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _joined(site, polygons, middle) else (low, middle)
        clearance = site.keep_m - 0.5 * width_m
        return (
            f"the corridor is too narrow: a road of road.width_m = {width_m:g} with "
            f"road.construct.clearance_m = {clearance:g} on both sides needs "
            f"{2.0 * site.keep_m:.4g} m, the widest way through has {2.0 * low:.4g} m"
        )
    if late:
        return "the time ran out before a road was found: see road.construct.time_limit_s"
    return (
        f"the radius is too large: there is room for the road's width, but none was found that "
        f"bends no tighter than road.construct.min_radius_m = {min_radius_m:g}"
    )


def _joined(site: Site, polygons: list[shapely.Polygon], keep_m: float) -> bool:
    """Return whether start and goal lie in one part of the plane without the grown obstacles."""
    start = shapely.Point(site.start.x_m, site.start.y_m)
    goal = shapely.Point(site.goal.x_m, site.goal.y_m)
    return _part(start, _grown(polygons, keep_m)) == _part(goal, _grown(polygons, keep_m))


def _grown(polygons: list[shapely.Polygon], keep_m: float) -> shapely.Geometry:
    return shapely.union_all([polygon.buffer(keep_m, quad_segs=32) for polygon in polygons])


def _part(point: shapely.Point, grown: shapely.Geometry) -> tuple[int, int]:
    """Name the hole of the grown obstacles that a point lies in; (−1, −1) outside all."""
    for n, part in enumerate(shapely.get_parts(grown)):
        for m, hole in enumerate(part.interiors):
            if shapely.Polygon(hole).contains(point):
                return n, m
    return -1, -1


def _shut_in(site: Site, polygons: list[shapely.Polygon]) -> str:
    grown = _grown(polygons, 0.0)
    goal = shapely.Point(site.goal.x_m, site.goal.y_m)
    what = "road.construct.goal" if _part(goal, grown) != (-1, -1) else "road.construct.start"
    return f"obstacles shut {what} in"
