"""Write what SUMO draws beside its network: points and polygons of an additional file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

from models.geometry import FloatArray


@dataclass(frozen=True, slots=True)
class Shape:
    """One thing to draw, in the network's coordinates: a point (1, 2) or an outline (m, 2)."""

    name: str
    kind: str
    points_m: FloatArray
    colour: str
    layer: float = 10.0
    parameters: tuple[tuple[str, str], ...] = ()


def additional_file(shapes: Iterable[Shape], comment: str) -> str:
    """Return the text of an additional file: `<poi>` and `<poly>`, each with its parameters.

    Format: SUMO's documentation, "Shapes"; coordinates to the millimetre, as x,y pairs.
    """
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f"<!-- {escape(comment.replace('--', '- -'))} -->",
        "<additional>",
    ]
    for shape in shapes:
        name, kind, colour = (quoteattr(text) for text in (shape.name, shape.kind, shape.colour))
        common = f'id={name} type={kind} color={colour} layer="{shape.layer:g}"'
        if len(shape.points_m) == 1:
            x, y = shape.points_m[0].tolist()
            head, tag = f'<poi {common} x="{x:.3f}" y="{y:.3f}"', "poi"
        else:
            pairs = " ".join(f"{x:.3f},{y:.3f}" for x, y in shape.points_m.tolist())
            head, tag = f'<poly {common} fill="1" shape="{pairs}"', "poly"
        if not shape.parameters:
            lines.append(f"    {head}/>")
            continue
        lines.append(f"    {head}>")
        lines += [
            f"        <param key={quoteattr(key)} value={quoteattr(value)}/>"
            for key, value in shape.parameters
        ]
        lines.append(f"    </{tag}>")
    return "\n".join([*lines, "</additional>", ""])
