"""Reader of a file of poses: a grid over joint values or over points of a box or plane, or a random design."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, Final, cast

import numpy as np

from precision_pin.base import units
from precision_pin.base.arrays import Array
from precision_pin.base.errors import InputError, nearest, shown
from precision_pin.base.files import UnreadableFileError, read_text_file
from precision_pin.robot.chain import Chain
from precision_pin.robot.inverse_kinematics import Branches
from precision_pin.robot.pose_grids import (
    MOST_ANGLES,
    MOST_POSES,
    Orientation,
    box_places,
    count_wanted,
    joint_grid,
    place_grid,
    plane_places,
    random_poses,
)
from precision_pin.robot.pose_set import SINGULAR_BELOW, PoseSet
from precision_pin.sheet.chain_entry import parse_pose
from precision_pin.sheet.text import Path, Text, read_text

_LONGEST: Final = 40
"""Characters of a value that a message shows, next to the file's name and line."""


@dataclass(frozen=True, eq=False)
class GridEntry:
    """Value at a path of a file.

    Attributes:
        data: The value: text, a list, or keys with values.
    """

    text: Text
    file: str
    path: Path
    data: Any

    def wrong(self, message: str) -> InputError:
        """Return the error for this value."""
        return InputError.of("E_GRID", message, self.file, self.text.line(self.path))

    @contextmanager
    def naming(self) -> Iterator[None]:
        """Add the place of this value to errors of the body that have none."""
        try:
            yield
        except InputError as error:
            first = error.findings[0]
            if first.code == "E_GRID":
                raise
            raise self.wrong(first.message) from None

    def keys(self, allowed: Sequence[str], expected: str, *, all_needed: bool = False) -> dict[str, GridEntry]:
        """Return the values by key."""
        if not isinstance(self.data, dict) or not self.data:
            raise self.wrong(f"{self._prefix}{expected}; got {self._value_text}")
        for key in self.data:
            if key not in allowed:
                entry = self._child(key)
                raise entry.wrong(f"unknown key {shown(key, _LONGEST)}: {nearest(key, allowed)}")
        missing = [key for key in allowed if key not in self.data]
        if all_needed and missing:
            raise self.wrong(f"{self._prefix}{expected}; {', '.join(missing)} missing")
        return {key: self._child(key) for key in self.data}

    def items(self) -> list[GridEntry]:
        """Return the items of a list, or the value itself if it is not one."""
        return [self._child(k) for k in range(len(self.data))] if isinstance(self.data, list) else [self]

    def word(self, allowed: tuple[str, ...]) -> str:
        """Return the value if it is an allowed word."""
        if self.data not in allowed:
            raise self.wrong(f"{self._prefix}expected {' or '.join(allowed)}, got {self._value_text}")
        return str(self.data)

    def integer(self, low: int, high: int = MOST_POSES) -> int:
        """Return a whole number."""
        digits = self.data if isinstance(self.data, str) else ""
        if not (digits.isascii() and digits.isdigit() and len(digits) < 10 and low <= int(digits) <= high):
            raise self.wrong(f"{self._prefix}expected a whole number from {low} to {high:,}, got {self._value_text}")
        return int(digits)

    def numbers(self, quantity: units.Quantity, count: int, example: str) -> list[float]:
        """Return ``count`` numbers with a common unit, in SI."""
        if not isinstance(self.data, str):
            raise self.wrong(f"{self._prefix}expected {count} numbers, such as {example!r}, got {self._value_text}")
        return self._parsed(self, quantity, count)

    def values(self, quantity: units.Quantity, example: str) -> Array:
        """Return the values of a coordinate: one or several with a common unit, a list, or a range with a count."""
        if isinstance(self.data, dict):
            unit = example.split()[-1]
            bounds = self.keys(
                ("from", "to", "count"),
                f"a range is {{from: {example}, to: 90 {unit}, count: 7}}",
                all_needed=True,
            )
            first, last = (self._parsed(bounds[key], quantity, 1)[0] for key in ("from", "to"))
            return np.linspace(first, last, bounds["count"].integer(2))
        items = self.items()
        if not items:
            raise self.wrong(f"{self._prefix}no values; give at least one, such as {example!r}")
        return np.array([value for item in items for value in self._parsed(item, quantity, None)])

    def _parsed(self, entry: GridEntry, quantity: units.Quantity, count: int | None) -> list[float]:
        with entry.naming():
            try:
                return units.parse_vector(entry.data, quantity, count=count)
            except InputError as error:
                raise InputError(f"{entry._prefix}{error.findings[0].message}") from None

    def _child(self, key: str | int) -> GridEntry:
        return GridEntry(self.text, self.file, (*self.path, key), self.data[key])

    @property
    def _prefix(self) -> str:
        return "".join(f"{key}: " for key in self.path[-1:] if isinstance(key, str))

    @property
    def _value_text(self) -> str:
        if self.data in ("", None):
            return "nothing"
        if isinstance(self.data, str):
            return shown(self.data, _LONGEST)
        return "keys with values" if isinstance(self.data, dict) else "a list"


LARGEST_FILE: Final = 2**20
"""Bytes of a file; a grid needs some lines, and the longest lists of coordinates that give a million poses fit."""
MOST_VISITS: Final = 1_000
"""Most poses of a datum: each is evaluated for every robot."""
_KINDS: Final = ("joints", "box", "plane", "random")
_OF_PLACES: Final = ("orientations", "branches", "reference")
"""Keys of the kinds of poses, of which a file has one, and further keys of the kinds over points."""
# allowed forms, for messages
_ORIENTATIONS: Final = (
    "an orientation is any, {rpy: 180 0 0 deg}, {axis: 0 0 -1}, {axis: 0 0 -1, angles: 12} or {pose: NAME}"
)

Progress = Callable[[int], None] | bool | None


@dataclass(frozen=True)
class PoseGrid:
    """The poses of a file.

    Attributes:
        count: Number of poses to solve or draw, for progress; zero for a grid over joint values.
        solve: Returns the poses; its argument is ``progress`` of
            :func:`precision_pin.robot.inverse_kinematics.inverse_kinematics`.
        singular_below: Threshold of the smallest singular value below which a pose counts as singular.
    """

    count: int
    solve: Callable[[Progress], PoseSet]
    singular_below: float = SINGULAR_BELOW


def read_pose_grid(path: str | os.PathLike[str], chain: Chain, poses: Mapping[str, Array] | None = None) -> PoseGrid:
    """Read a YAML file of poses; ``poses`` are named joint values for references, such as a sheet's."""
    file = os.fspath(path)
    try:
        text = read_text(read_text_file(file, LARGEST_FILE), file)
    except UnreadableFileError as problem:
        raise InputError.of("E_GRID", f"the file {problem.reason}", file) from None
    if text.findings:
        raise InputError(text.findings[:1])
    top = GridEntry(text, file, (), text.data)
    expected = f"a grid has one of {', '.join(_KINDS)}"
    keys = top.keys((*_KINDS, *_OF_PLACES, "singular_below"), expected)
    kinds = [kind for kind in _KINDS if kind in keys]
    if len(kinds) != 1:
        raise top.wrong(f"{expected}; this has {' and '.join(kinds) or 'none'}")
    kind, poses = kinds[0], poses or {}
    if kind in ("box", "plane"):
        grid = _over_places(top, keys, chain, poses)
    else:
        for key in _OF_PLACES[1:] if kind == "random" else _OF_PLACES:
            if key in keys:
                raise keys[key].wrong(f"{key} goes with box or plane, not with {kind}")
        grid = _over_joints(keys["joints"], chain) if kind == "joints" else _at_random(keys, chain, poses)
    if "singular_below" not in keys:
        return grid
    (threshold,) = keys["singular_below"].numbers(units.RATIO, 1, "0.02")
    if threshold < 0:
        raise keys["singular_below"].wrong("singular_below: expected zero or more")
    return PoseGrid(grid.count, lambda step: grid.solve(step).with_singular_below(chain, threshold), threshold)


def read_visits(folder: FilePath, name: str, chain: Chain, poses: Mapping[str, Array] | None = None) -> list[Array]:
    """Return the joint values ``(n,)`` of each pose of a file in a folder; every pose must be reached."""
    grid = read_pose_grid(folder / name, chain, poses)
    count = grid.count or len(grid.solve(None))  # a grid over joint values is not counted, nor solved
    if count > MOST_VISITS:
        raise InputError(f"{name} has {count:,} poses; at most {MOST_VISITS:,} find a datum")
    pose_set = grid.solve(None)
    if not pose_set.known.all():
        raise InputError(f"{name}: {pose_set.counts}; a datum needs each of its poses, leave the others out")
    return list(pose_set.q.T)


def _over_joints(entry: GridEntry, chain: Chain) -> PoseGrid:
    joints = entry.keys(chain.joint_names, "expected a key for each joint, with its values")
    is_prismatic = dict(zip(chain.joint_names, chain.prismatic, strict=True))
    values = {
        name: axis.values(units.LENGTH, "300 mm") if is_prismatic[name] else axis.values(units.ANGLE, "30 deg")
        for name, axis in joints.items()
    }
    with entry.naming():
        poses = joint_grid(chain, values)
    return PoseGrid(0, lambda _: poses)


def _at_random(keys: dict[str, GridEntry], chain: Chain, poses: Mapping[str, Array]) -> PoseGrid:
    entry = keys["random"]
    entries = entry.keys(("count", "seed", "box"), "expected count, and seed and box if wanted")
    if "count" not in entries:
        raise entry.wrong("random: the key 'count' is missing, the number of poses")
    count = entries["count"].integer(1)
    seed = entries["seed"].integer(0, 999_999_999) if "seed" in entries else 0
    kinds = _orientations(keys, chain, poses) if "orientations" in keys else None
    box = None
    if "box" in entries:
        expected = "expected x, y and z, each with its lowest and highest"
        sides = entries["box"].keys(("x", "y", "z"), expected, all_needed=True)
        box = [sides[name].numbers(units.LENGTH, 2, "-500 500 mm") for name in ("x", "y", "z")]

    def solve(progress: Progress) -> PoseSet:
        with entry.naming():
            return random_poses(chain, count, seed=seed, box=box, orientations=kinds, progress=progress)

    return PoseGrid(count, solve)


def _orientations(keys: dict[str, GridEntry], chain: Chain, poses: Mapping[str, Array]) -> list[Orientation]:
    kinds = [_orientation(entry, chain, poses) for entry in keys["orientations"].items()]
    if not kinds:
        raise keys["orientations"].wrong(f"no orientations; {_ORIENTATIONS}")
    return kinds


def _over_places(top: GridEntry, keys: dict[str, GridEntry], chain: Chain, poses: Mapping[str, Array]) -> PoseGrid:
    if "orientations" not in keys:
        raise top.wrong(f"the key 'orientations' is missing; {_ORIENTATIONS}")
    kinds = _orientations(keys, chain, poses)
    branches = cast(Branches, keys["branches"].word(("nearest", "best", "all")) if "branches" in keys else "nearest")
    reference = _configuration(keys["reference"], chain, poses) if "reference" in keys else None
    if "box" in keys:
        sides = keys["box"].keys(("x", "y", "z"), "expected x, y and z, each with its values", all_needed=True)
        rows = [sides[name].values(units.LENGTH, "300 mm") for name in ("x", "y", "z")]
        with keys["box"].naming():
            places = box_places(*rows)
    else:
        places = _plane(keys["plane"])
    with top.naming():
        count = count_wanted(places.shape[1], kinds)

    def solve(progress: Progress) -> PoseSet:
        return place_grid(chain, places, kinds, branches=branches, reference=reference, progress=progress)

    return PoseGrid(count, solve)


def _plane(entry: GridEntry) -> Array:
    keys = entry.keys(("origin", "u", "v"), "expected origin, u and v", all_needed=True)
    directions, rows = [], []
    for name in ("u", "v"):
        entries = keys[name].keys(("direction", "values"), "expected direction and values", all_needed=True)
        directions.append(entries["direction"].numbers(units.RATIO, 3, "0 1 0"))
        rows.append(entries["values"].values(units.LENGTH, "300 mm"))
    origin = keys["origin"].numbers(units.LENGTH, 3, "400 0 300 mm")
    with entry.naming():
        return plane_places(origin, *directions, *rows)


def _orientation(entry: GridEntry, chain: Chain, poses: Mapping[str, Array]) -> Orientation:
    if entry.data == "any":
        return Orientation.free()
    keys = entry.keys(("rpy", "axis", "angles", "tool_axis", "pose"), _ORIENTATIONS)
    kinds = [key for key in ("rpy", "axis", "pose") if key in keys]
    if len(kinds) != 1:
        raise entry.wrong(f"{_ORIENTATIONS}; this has {' and '.join(kinds) or 'none of rpy, axis and pose'}")
    for key in ("angles", "tool_axis"):
        if key in keys and kinds[0] != "axis":
            raise keys[key].wrong(f"{key} goes with axis, not with {kinds[0]}")
    with entry.naming():
        if kinds[0] == "rpy":
            return Orientation.given(keys["rpy"].numbers(units.ANGLE, 3, "180 0 0 deg"))
        if kinds[0] == "pose":
            values = _configuration(keys["pose"], chain, poses)
            return Orientation.given(chain.at(values).pose[:3, :3], f"pose {keys['pose'].data}")
        tool_axis = keys["tool_axis"].numbers(units.RATIO, 3, "1 0 0") if "tool_axis" in keys else (0.0, 0.0, 1.0)
        angles = keys["angles"].integer(1, MOST_ANGLES) if "angles" in keys else None
        return Orientation.along(keys["axis"].numbers(units.RATIO, 3, "0 0 -1"), angles, tool_axis)


def _configuration(entry: GridEntry, chain: Chain, poses: Mapping[str, Array]) -> Array:
    """Return the joint values of a named pose, or joint values in the form of a sheet."""
    if isinstance(entry.data, str):
        if entry.data in poses:
            return poses[entry.data]
        if not re.match(r"[+-]?[.\d]", entry.data):
            raise entry.wrong(f"no pose named {shown(entry.data, _LONGEST)}; {nearest(entry.data, poses)}")
    with entry.naming():
        return parse_pose(entry.data, chain)
