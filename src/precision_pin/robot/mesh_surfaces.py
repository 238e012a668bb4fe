"""Mesh files as coloured triangles: checked first, read in Python only, and thinned out to fit a page."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.arrays import Array
from precision_pin.base.errors import shown
from precision_pin.render.scene import Colour
from precision_pin.robot.urdf import Mesh, locate_mesh
from precision_pin.robot.urdf.meshes import BrokenMeshError, MeshFile, MeshFiles, check_numbers, read_mesh
from precision_pin.robot.urdf.xmltree import Findings

MOST_FACES: Final = 120_000
"""Most triangles of a page, about 2.5 MB."""

# corners closer than this share of the arm's length are one; the share grows until all surfaces fit
_FINEST: Final = 1e-5
_GROWTH: Final = 2.0  # factor of the share until the surfaces fit
_MOST_TRIALS: Final = 6  # of the share; then faces are left out
_ENOUGH: Final = 0.3  # of the allowed faces: with as many the search ends
_KEY_BITS: Final = 21  # of a coordinate: three of them fit into a corner's key of 64 bits


class UnreadableMeshError(Exception):
    """Carries why a mesh cannot be drawn."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of one colour (None if the file has none): corners ``(V, 3)``, m, and their indices ``(F, 3)``."""

    vertices: Array
    faces: NDArray[np.int64]
    colour: Colour | None


class MeshReader:
    """Reads a robot's meshes, each file once; searches next to the URDF and in ``package_dirs``."""

    def __init__(self, file: str, package_dirs: Sequence[Path]) -> None:
        self._file = file
        self._package_dirs = list(package_dirs)
        self._known: dict[str, tuple[Surface, ...] | str] = {}

    def surfaces(self, mesh: Mesh, owner: str) -> tuple[Surface, ...]:
        """Return a mesh's triangles, scaled as in the URDF, one surface for each colour."""
        if mesh.filename not in self._known:
            try:
                self._known[mesh.filename] = self._read(mesh.filename, owner)
            except UnreadableMeshError as problem:
                self._known[mesh.filename] = str(problem)
        cached = self._known[mesh.filename]
        if isinstance(cached, str):
            raise UnreadableMeshError(cached)
        return tuple(replace(surface, vertices=surface.vertices * mesh.scale) for surface in cached)

    def _read(self, filename: str, owner: str) -> tuple[Surface, ...]:
        folder = Path(self._file).resolve().parent
        findings = Findings(self._file)
        MeshFiles(findings, folder, self._package_dirs, look_inside=False).check(filename, owner, 0)
        for finding in findings.result():
            raise UnreadableMeshError(finding.message)
        path = locate_mesh(filename, folder, self._package_dirs)
        if path is None:
            raise UnreadableMeshError(f"{owner}: mesh {shown(filename)} is not found")
        try:
            surfaces = _load(read_mesh(path.resolve()))
        except BrokenMeshError as problem:
            raise UnreadableMeshError(f"{owner}: mesh {shown(filename)}: {problem}") from None
        except Exception as problem:  # noqa: BLE001 - a broken file makes readers raise anything; the page goes on
            reason = " ".join(str(problem).split()) or type(problem).__name__
            raise UnreadableMeshError(f"{owner}: mesh {shown(filename)} cannot be read: {shown(reason)}") from None
        if not surfaces:
            raise UnreadableMeshError(f"{owner}: mesh {shown(filename)} holds no triangles")
        return surfaces


def thinned(surfaces: Sequence[Surface], length: float, most_faces: int = MOST_FACES) -> tuple[Surface, ...]:
    """Return the surfaces with near corners joined, coarser until all have ``most_faces`` triangles or fewer.

    Corners in one cell of a grid, at least a hundred-thousandth of the arm's length (m), become their mean, and
    triangles that shrink to a line are dropped. If much less than the allowed number is left, as with disconnected
    triangles, triangles are taken at regular intervals instead.
    """
    finest = _FINEST * length
    all_surfaces = result = tuple(_merge_corners(surface, finest) for surface in surfaces)
    if _count(all_surfaces) <= most_faces:
        return all_surfaces
    # a surface of area A in cells of size c has about 2 A / c² triangles
    fine, cell = finest, max(_GROWTH * finest, math.sqrt(sum(map(_area, result)) / most_faces))
    coarse: float | None = None
    for _ in range(_MOST_TRIALS):
        trial = tuple(_merge_corners(surface, cell) for surface in all_surfaces)
        if _count(trial) > most_faces:
            fine, result = cell, trial
        elif _count(trial) >= _ENOUGH * most_faces:
            return trial
        else:
            coarse = cell
        cell = _GROWTH * fine if coarse is None else math.sqrt(fine * coarse)
    step = math.ceil(_count(result) / most_faces)
    return tuple(_with_faces(surface, surface.faces[::step]) for surface in result)


def _with_faces(surface: Surface, faces: NDArray[np.int64]) -> Surface:
    vertices, renumbered = np.unique(faces, return_inverse=True)
    return replace(surface, vertices=surface.vertices[vertices], faces=renumbered.reshape(-1, 3))


def _count(surfaces: Sequence[Surface]) -> int:
    return sum(len(surface.faces) for surface in surfaces)


def _area(surface: Surface) -> float:
    first, second, third = (surface.vertices[corner] for corner in surface.faces.T)
    return float(np.linalg.norm(np.cross(second - first, third - first), axis=1).sum()) / 2


def _merge_corners(surface: Surface, cell: float) -> Surface:
    if not len(surface.faces):
        return surface
    lowest = surface.vertices.min(axis=0)
    cell = max(cell, float(np.ptp(surface.vertices, axis=0).max()) / 2 ** (_KEY_BITS - 1))
    grid = np.floor((surface.vertices - lowest) / cell).astype(np.int64)
    keys = grid[:, 0] + (grid[:, 1] << _KEY_BITS) + (grid[:, 2] << 2 * _KEY_BITS)
    _, renumbered, counts = np.unique(keys, return_inverse=True, return_counts=True)
    means = [np.bincount(renumbered, weights=surface.vertices[:, axis]) / counts for axis in range(3)]
    faces = renumbered[surface.faces]
    first, second, third = faces.T
    proper_faces = faces[(first != second) & (second != third) & (third != first)]
    return _with_faces(replace(surface, vertices=np.stack(means, axis=1)), proper_faces)


class _Companions:
    """Gives trimesh the files next to a mesh, and no others: images are not opened."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._files = files

    def get(self, name: str) -> bytes:
        if name not in self._files:
            raise FileNotFoundError(name)
        return self._files[name]

    __getitem__ = get

    def keys(self) -> list[str]:
        return list(self._files)


def _load(file: MeshFile) -> tuple[Surface, ...]:
    import trimesh

    # without our resolver trimesh opens whatever a file names: pipes, devices, addresses
    resolver: Any = _Companions(file.companions)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings about the libraries themselves
        scene = trimesh.load_scene(BytesIO(file.data), file_type=file.kind[1:], resolver=resolver, process=False)
    by_colour: dict[Colour | None, list[tuple[Array, NDArray[np.int64]]]] = {}
    for node in sorted(scene.graph.nodes_geometry):
        transform, name = scene.graph[node]
        geometry = scene.geometry[name]
        if not isinstance(geometry, trimesh.Trimesh) or not len(geometry.faces):
            continue
        vertices = np.asarray(geometry.vertices, dtype=float) @ transform[:3, :3].T + transform[:3, 3]
        check_numbers(vertices)
        by_colour.setdefault(_own_colour(geometry), []).append((vertices, np.asarray(geometry.faces, dtype=np.int64)))
    return tuple(merged(parts, colour) for colour, parts in by_colour.items())


def merged(parts: Sequence[tuple[Array, NDArray[np.int64]]], colour: Colour | None = None) -> Surface:
    """Return vertices with their faces, of one or several parts, as one surface."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [indices + start for (_, indices), start in zip(parts, starts[:-1], strict=True)]
    return Surface(np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces), colour)


def _own_colour(geometry: Any) -> Colour | None:
    visual = geometry.visual
    if not visual.defined:
        return None
    source = visual.material if visual.kind == "texture" else visual
    red, green, blue, opacity = (float(part) / 255 for part in source.main_color)
    # ignore opacity 0, an exporter's mistake (COLLADA has two conventions) that would hide the part
    return (red, green, blue, opacity if opacity > 0 else 1.0)
