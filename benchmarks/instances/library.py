"""The instance library: every instance by name, how hard it is, and what it is for.

Difficulty is graded by what it takes to prove the optimum: 1 enumeration or any solver in a second,
2 seconds, 3 a minute, 4 an hour or only with the right bound, 5 not proven by anybody yet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.runner.subjects import Case

HERE = Path(__file__).resolve().parent
BEST_KNOWN = HERE / "best_known.csv"
_GENERATORS = "benchmarks.instances.generators"


@dataclass(frozen=True, slots=True)
class Entry:
    """One instance: its kind of file (`road`, `real`, `generated`), difficulty, and purpose."""

    name: str
    source: str
    difficulty: int
    about: str
    generator: str = ""
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def case(self, data: str | None = None, **changes: Any) -> Case:
        """Return the instance as a case of a suite; `changes` are dotted keys, `__` for the dot.

        `data` is the folder with the user's roads, for the instances that are real ones.
        """
        if self.source == "generated":
            arguments = dict(self.arguments) | changes
            generator = f"{_GENERATORS}:{self.generator}"
            return Case(self.name, "design", {"generator": generator, "arguments": arguments})
        spec: dict[str, Any] = {
            "changes": {key.replace("__", "."): value for key, value in changes.items()}
        }
        if self.source == "real":
            spec |= {"real": self.name, "data": data}
        else:
            spec |= {"instance": self.name}
        return Case(self.name, "road", spec)


def _road(name: str, difficulty: int, about: str) -> Entry:
    return Entry(name, "road", difficulty, about)


def _real(name: str, difficulty: int, about: str) -> Entry:
    return Entry(name, "real", difficulty, about)


def _drawn(name: str, difficulty: int, about: str, generator: str, **arguments: Any) -> Entry:
    return Entry(name, "generated", difficulty, about, generator, arguments)


LIBRARY: Mapping[str, Entry] = {
    entry.name: entry
    for entry in (
        _road("straight-80", 1, "the dissertation's straight, one camera"),
        _road("bend-20", 1, "the dissertation's bend, one camera"),
        _road("arc-50", 1, "three cameras along an arc"),
        _road("straight-200", 1, "four cameras along a straight"),
        _road("hairpin", 1, "a hairpin between straights"),
        _road("straight-free", 2, "a count and nothing else"),
        _road("required", 2, "required and forbidden poses"),
        _road("grouped", 2, "groups of poles besides one camera a pole"),
        _road("s-bend", 2, "two bends, eight cameras"),
        _road("s-bend-ellipse", 2, "2×2 blocks"),
        _road("s-bend-covariance", 2, "2×2 blocks of first-order propagation"),
        _road("fisheye", 2, "windows that overlap widely"),
        _road("narrow", 2, "many small windows"),
        _road("two-heights", 2, "the height is chosen as well"),
        _road("mixed-free", 2, "a count and nothing else, larger"),
        _road("dense-mounts", 3, "nearly equal poses"),
        _road("priced", 5, "a money budget"),
        _road("separated", 5, "a minimum separation"),
        _road("winding", 3, "the design's own, 10,440 poses"),
        _road("country-5km", 4, "sixty cameras along five kilometres"),
        _road("entropy-robot", 3, "short memory: the chain's side"),
        _road("entropy-car", 3, "in between"),
        _road("entropy-car-20", 5, "in between, twenty cameras"),
        _road("entropy-dissertation", 4, "long memory: the relaxation's side"),
        _road("trace-robot", 2, "not submodular, short memory"),
        _road("trace-car", 3, "not submodular"),
        _road("trace-lateral", 3, "across the lane alone"),
        _road("trace-persistent", 5, "installation errors that last"),
        _road("final-car", 5, "the dissertation's objective"),
        _road("circuit", 5, "the demo: trace with 24 cameras"),
        _real("norisring", 3, "2.3 km circuit, localisation"),
        _real("ims", 3, "an oval: symmetric, so many ties"),
        _real("budapest", 3, "a winding circuit"),
        _real("spielberg", 3, "forty cameras"),
        _real("zandvoort", 5, "entropy on a real road"),
        _real("monza", 5, "trace on 5.8 km"),
        _drawn("trees-9", 2, "spanning trees of K10: one tree", "spanning_tree", nodes=10, edges=9),
        _drawn("trees-10", 3, "10 edges: 10 trees", "spanning_tree", nodes=10, edges=10),
        _drawn("trees-11", 3, "11 edges: 40 trees", "spanning_tree", nodes=10, edges=11),
        _drawn(
            "legendre-5",
            1,
            "a polynomial of degree 5",
            "polynomial",
            degree=5,
            points=41,
            budget=6,
        ),
        _drawn(
            "gauss-10-50",
            2,
            "Gaussian experiments",
            "gaussian",
            n=10,
            c=50,
            budget=12,
            prior=1e-6,
            seed=0,
        ),
        _drawn(
            "gauss-10-100",
            2,
            "the size others start at",
            "gaussian",
            n=10,
            c=100,
            budget=15,
            prior=1e-6,
            seed=0,
        ),
        _drawn(
            "gauss-10-300",
            2,
            "more candidates than anybody needs",
            "gaussian",
            n=10,
            c=300,
            budget=20,
            prior=1e-6,
            seed=0,
        ),
        _drawn(
            "gauss-grouped",
            2,
            "one of each of twenty groups",
            "gaussian",
            n=8,
            c=80,
            budget=12,
            prior=1e-2,
            seed=3,
            groups=20,
        ),
        _drawn(
            "gauss-rank-3",
            2,
            "three measurements a sensor",
            "gaussian",
            n=12,
            c=60,
            budget=6,
            prior=1.0,
            seed=1,
            rank=3,
        ),
        _drawn("fusion-40", 1, "sensors with prices", "fusion", n=12, c=40, money=15.0, seed=0),
        _drawn("fusion-200", 2, "two hundred of them", "fusion", n=20, c=200, money=40.0, seed=0),
        _drawn(
            "dense-2000",
            5,
            "the throughput of greedy",
            "gaussian",
            n=50,
            c=2000,
            budget=50,
            prior=1.0,
            seed=0,
        ),
    )
}
