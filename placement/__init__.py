"""Where roadside cameras go: candidates, information, objectives, solvers, certificates.

`load` an instance, `solve` it, `validate` the placement; what the command line does is one
import away. Names are imported when first used, so `import placement` costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from placement.assemble import Scene as Scene
    from placement.assemble import assemble as assemble
    from placement.assemble import load as load
    from placement.problem import Problem as Problem
    from placement.solution import Solution as Solution
    from placement.solution import Status as Status
    from placement.solve import solve as solve
    from placement.validation import Validation as Validation
    from placement.validation import validate as validate

_HOMES = {
    "Scene": "placement.assemble",
    "assemble": "placement.assemble",
    "load": "placement.assemble",
    "Problem": "placement.problem",
    "Solution": "placement.solution",
    "Status": "placement.solution",
    "solve": "placement.solve",
    "Validation": "placement.validation",
    "validate": "placement.validation",
}
__all__ = [
    "Problem",
    "Scene",
    "Solution",
    "Status",
    "Validation",
    "assemble",
    "load",
    "solve",
    "validate",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'placement' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_HOMES[name]), name)
