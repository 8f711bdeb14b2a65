"""Instances from TOML files, from dictionaries, and by the names of those that are shipped."""

from __future__ import annotations

import difflib
import hashlib
import json
import re
import tomllib
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from importlib import resources
from importlib.metadata import entry_points
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from placement.instance.messages import InstanceError, describe
from placement.instance.road_schema import RoadSection
from placement.instance.schema import (
    BudgetSection,
    CameraSection,
    Document,
    ErrorsSection,
    MountsSection,
    ObjectiveSection,
    ObstaclesSection,
    VehicleSection,
)

ENTRY_POINT_GROUP = "placement.instances"
MOST_BYTES = 100_000_000  # of an instance file
BUILDINGS = "road.buildings"  # of `Instance.files`: polygons beside a SUMO network
FILE_KEYS = (
    ("road", "file"),
    ("mounts", "file"),
    ("camera", "catalogue"),
    ("obstacles", "file"),
    ("traffic", "demand"),
)


@dataclass(frozen=True, slots=True)
class Instance:
    """A checked instance: its tables as attributes, and where its relative files lie.

    `files` maps each key that names a file (`road.file`) to the file's absolute path.
    """

    name: str
    folder: Path
    document: Document
    files: Mapping[str, Path]

    @property
    def road(self) -> RoadSection:
        """The `[road]` table."""
        return self.document.road

    @property
    def mounts(self) -> MountsSection:
        """The `[mounts]` table."""
        return self.document.mounts

    @property
    def camera(self) -> CameraSection:
        """The `[camera]` table."""
        return self.document.camera

    @property
    def errors(self) -> ErrorsSection:
        """The `[errors]` table."""
        return self.document.errors

    @property
    def obstacles(self) -> ObstaclesSection:
        """The `[obstacles]` table."""
        return self.document.obstacles

    @property
    def vehicle(self) -> VehicleSection:
        """The `[vehicle]` table."""
        return self.document.vehicle

    @property
    def objective(self) -> ObjectiveSection:
        """The `[objective]` table."""
        return self.document.objective

    @property
    def budget(self) -> BudgetSection:
        """The `[budget]` table."""
        return self.document.budget

    def as_dict(self) -> dict[str, Any]:
        """Return what the file said, defaults left out, for `instance_from_dict` to read back."""
        return self.document.model_dump(mode="json", by_alias=True, exclude_unset=True)

    def changed(self, changes: Mapping[str, Any]) -> Instance:
        """Return this instance with dotted keys replaced: `changed({"budget.cameras": 5})`.

        Raises:
            InstanceError: if the changed instance is not a valid one.
        """
        data = self.as_dict()
        for key, value in changes.items():
            *tables, last = key.split(".")
            table = data
            for name in tables:
                table = table.setdefault(name, {})
            table[last] = value
        return instance_from_dict(data, folder=self.folder, name=self.name)

    def sha256(self) -> str:
        """Hash what the instance means: every key that is not at its default, its files' bytes.

        A key that a later version adds therefore changes no hash.
        Neither the layout of the TOML file nor the place where a referenced file lies matters.
        """
        content = self.document.model_dump(mode="json", by_alias=True, exclude_defaults=True)
        for section, key in FILE_KEYS:
            path = self.files.get(f"{section}.{key}")
            if path is not None:
                digest = hashlib.sha256(path.read_bytes()).hexdigest()
                content[section][key] = {"suffix": path.suffix, "sha256": digest}
        if BUILDINGS in self.files:
            content[BUILDINGS] = hashlib.sha256(self.files[BUILDINGS].read_bytes()).hexdigest()
        text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()


def load_instance(path_or_name: str | Path) -> Instance:
    """Read a TOML file, or the shipped instance of that name.

    A word without a dot or a slash is a name, unless such a file exists.

    Raises:
        InstanceError: one line a problem, each naming the file, the field, what was wanted and
            what came.
    """
    path = Path(path_or_name)
    text = str(path_or_name)
    if not path.is_file() and re.fullmatch(r"[\w-]+", text):
        shipped = shipped_instances()
        if text not in shipped:
            raise InstanceError([f"no instance is named {text} ({_instead(text, shipped)})"])
        with resources.as_file(shipped[text]) as file:
            return _read(file.read_bytes(), text, file.parent, text)
    try:
        with path.open("rb") as file:  # of bounded size: it may be a device
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise InstanceError([f"{path}: cannot be read ({error.strerror or error})"]) from None
    if len(content) > MOST_BYTES:
        raise InstanceError([f"{path}: must be at most {MOST_BYTES // 1_000_000} MB"])
    return _read(content, str(path), path.resolve().parent, path.stem)


def instance_from_dict(
    data: Mapping[str, Any], *, folder: str | Path = ".", name: str = "instance"
) -> Instance:
    """Check `data`, laid out as an instance file is; relative files lie in `folder`.

    Raises:
        InstanceError: one line a problem.
    """
    try:
        document = Document.model_validate(deepcopy(dict(data)))
    except ValidationError as error:
        raise InstanceError(describe(error, Document)) from None
    files = _files(document, Path(folder).resolve())
    problems = [
        f'{key} must name a readable file, got "{path}"'
        for key, path in files.items()
        if not path.is_file()
    ]
    if problems:
        raise InstanceError(problems)
    return Instance(name, Path(folder).resolve(), document, files)


@cache
def shipped_instances() -> dict[str, Traversable]:
    """Find the TOML files of every package that offers instances, by name.

    A package offers them through the entry point group `placement.instances`, so that this
    package need not import those that stand on it.
    """
    found: dict[str, Traversable] = {}
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        for file in resources.files(entry.value).iterdir():
            if file.name.endswith(".toml"):
                found[file.name.removesuffix(".toml")] = file
    return found


def _read(content: bytes, source: str, folder: Path, name: str) -> Instance:
    try:
        data = tomllib.loads(content.decode("utf-8-sig"))  # editors of Windows begin with a mark
    except UnicodeDecodeError as error:
        raise InstanceError([f"must be UTF-8 text, got byte {error.start}"], source) from None
    except tomllib.TOMLDecodeError as error:
        raise InstanceError([f"not TOML: {_one_line(error)}"], source) from None
    except RecursionError:
        raise InstanceError(["not TOML: nested too deeply"], source) from None
    except ValueError:  # Python reads no number of more digits, and says how to make it
        raise InstanceError(["numbers must have at most 4,300 digits"], source) from None
    try:
        return instance_from_dict(data, folder=folder, name=name)
    except InstanceError as error:
        raise InstanceError(error.problems, source) from None
    except RecursionError:
        raise InstanceError(["tables must not be nested so deeply"], source) from None


def _instead(text: str, shipped: Mapping[str, Any]) -> str:
    near = difflib.get_close_matches(text, shipped, n=1)
    if near:
        return f"did you mean {near[0]}?"
    return f"shipped: {', '.join(sorted(shipped)) or 'none'}; a file's name ends in .toml"


def _one_line(error: Exception) -> str:
    text = " ".join(str(error).split())
    return text[:1].lower() + text[1:]


def _files(document: Document, folder: Path) -> dict[str, Path]:
    named = {f"{s}.{k}": getattr(getattr(document, s), k) for s, k in FILE_KEYS}
    files = {key: folder / value for key, value in named.items() if value is not None}
    road = files.get("road.file")
    if road is not None and road.name.endswith((".net.xml", ".net.xml.gz")):
        # What lies beside a SUMO network belongs to it, unless the instance names other buildings.
        stem = road.name.removesuffix(".gz").removesuffix(".net.xml")
        beside = [road.parent / f"{stem}.poly.xml{more}" for more in ("", ".gz")]
        if "obstacles.file" not in files:
            found = [path for path in beside if path.is_file()]
            files |= {BUILDINGS: found[0]} if found else {}
    return files
