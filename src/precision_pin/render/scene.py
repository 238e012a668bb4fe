"""A scene as a list of MeshCat commands, without a server, or as triangles; layers of the view and chapters of the report.

Paths contain only our own names and numbers, nothing from a URDF or sheet. Identifiers are counted, not random, so that
equal input gives equal bytes.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike

from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.render.html import Html

Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity, from 0 to 1."""

# three.js lays a cylinder along y, URDF along z
_Y_TO_Z: Final = se3.pose(se3.rotation_about((1.0, 0.0, 0.0), np.pi / 2), (0.0, 0.0, 0.0))


def viewer_script() -> str:
    """Return the JavaScript of MeshCat's viewer, three.js included."""
    return (Path(_meshcat("meshcat").__file__).parent / "viewer" / "dist" / "main.min.js").read_text("utf-8")


class Scene:
    """A growing scene; a path is a tuple of names below the root."""

    def __init__(self) -> None:
        self._window = _Window()
        self._geometry = _meshcat("meshcat.geometry")
        self._root = _meshcat("meshcat").Visualizer(window=self._window)
        for name in ("Grid", "Axes"):
            self._root[f"/{name}"].set_property("visible", False)

    @property
    def commands(self) -> tuple[bytes, ...]:
        """The commands so far, packed with MessagePack for MeshCat's viewer."""
        return tuple(self._window.packed)

    def place(self, path: Sequence[str], pose: ArrayLike) -> None:
        """Set the pose ``(4, 4)`` of a node relative to its parent."""
        self._node(path).set_transform(np.asarray(pose, dtype=float))

    def box(self, path: Sequence[str], size: Sequence[float], colour: Colour, pose: ArrayLike) -> None:
        """Add a box with edges ``size`` (m), centred at ``pose``."""
        self._add(path, self._geometry.Box([float(edge) for edge in size]), colour, pose)

    def cylinder(self, path: Sequence[str], radius: float, length: float, colour: Colour, pose: ArrayLike) -> None:
        """Add a cylinder along z (m), centred at ``pose``."""
        shape = self._geometry.Cylinder(height=float(length), radius=float(radius))
        self._add(path, shape, colour, np.asarray(pose, dtype=float) @ _Y_TO_Z)

    def rod(self, path: Sequence[str], start: ArrayLike, end: ArrayLike, radius: float, colour: Colour) -> None:
        """Add a cylinder between two distinct points ``(3,)``."""
        first, last = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        length = float(np.linalg.norm(last - first))
        middle = se3.pose(rotation_to((last - first) / length), (first + last) / 2)
        self.cylinder(path, radius, length, colour, middle)

    def sphere(self, path: Sequence[str], radius: float, colour: Colour, pose: ArrayLike) -> None:
        """Add a sphere (m) centred at ``pose``."""
        self._add(path, self._geometry.Sphere(float(radius)), colour, pose)

    def surface(
        self, path: Sequence[str], vertices: ArrayLike, faces: ArrayLike, colour: Colour, pose: ArrayLike
    ) -> None:
        """Add triangles: corners ``(V, 3)`` in m and their indices ``(F, 3)``."""
        shape = self._geometry.TriangularMeshGeometry(np.asarray(vertices, np.float32), np.asarray(faces, np.uint32))
        self._add(path, shape, colour, pose)

    def segments(self, path: Sequence[str], ends: ArrayLike, colour: Colour) -> None:
        """Add thin lines between consecutive pairs of the points ``(3, 2 S)`` in m."""
        lines = self._geometry.PointsGeometry(np.asarray(ends, np.float32))
        material = self._geometry.LineBasicMaterial(color=_number(colour), opacity=colour[3])
        self._node(path).set_object(self._geometry.LineSegments(lines, material))

    def _add(self, path: Sequence[str], shape: Any, colour: Colour, pose: ArrayLike) -> None:
        # meshes have no normals here: each triangle is lit as a flat face
        material = self._geometry.MeshPhongMaterial(
            color=_number(colour), opacity=float(colour[3]), flatShading=True, shininess=20, reflectivity=0.2
        )
        self._node(path).set_object(shape, material)
        self.place(path, pose)

    def _node(self, path: Sequence[str]) -> Any:
        node = self._root
        for name in path:
            node = node[name]
        return node


def rotation_to(axis: ArrayLike) -> Array:
    """Return the smallest rotation ``(3, 3)`` from z to a unit vector ``(3,)``."""
    unit = np.asarray(axis, dtype=float)
    normal = np.cross((0.0, 0.0, 1.0), unit)
    sine = float(np.linalg.norm(normal))
    if sine < 1e-12:
        return np.eye(3) if unit[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return se3.rotation_about(normal / sine, np.arctan2(sine, unit[2]))


class _Window:
    """Replaces MeshCat's connection to a server: keeps the packed commands."""

    def __init__(self) -> None:
        self.packed: list[bytes] = []
        self._identifiers: dict[str, str] = {}
        self._pack = importlib.import_module("umsgpack").packb

    def send(self, command: Any) -> None:
        self.packed.append(self._pack(self._counted(command.lower())))

    def _counted(self, value: Any) -> Any:
        """Return a command with random identifiers replaced by numbers in order of appearance."""
        match value:
            case dict():
                if "uuid" in value:
                    self._identifiers.setdefault(value["uuid"], f"{len(self._identifiers):032x}")
                return {key: self._counted(entry) for key, entry in value.items()}
            case list():
                return [self._counted(entry) for entry in value]
            case str():
                return self._identifiers.get(value, value)
            case float():
                return float(value)
            case _:
                return value


def _meshcat(name: str) -> Any:
    # imported late: it takes 0.3 s; warnings off: it uses a deprecated part of pyzmq
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        return importlib.import_module(name)


def _number(colour: Colour) -> int:
    return int.from_bytes(bytes(round(255 * part) for part in colour[:3]))


class Layer(Protocol):
    """Extra shapes in the scene, switched on and off by a box of the legend."""

    @property
    def name(self) -> str:
        """Name of the scene node, and of the box, ``show-name``."""

    def draw(self, scene: Scene, length: float) -> None:
        """Add the shapes below the layer's node; ``length`` is that of the arm, m."""

    def legend(self) -> str:
        """Return the HTML of the layer's section of the legend, with its box."""

    def settings(self, length: float) -> dict[str, Any]:
        """Return the numbers for the page's scripts, for JSON."""

    @property
    def script(self) -> str:
        """JavaScript that draws what depends on the magnification; it knows ``layer``, the settings, and ``group``.

        By default the file ``layer.js`` next to the class's module, if there is one.
        """
        file = resources.files(type(self).__module__.rpartition(".")[0]).joinpath("layer.js")
        return file.read_text("utf-8") if file.is_file() else ""


@dataclass(frozen=True)
class Chapter:
    """A section of its own.

    Attributes:
        name, title: Identifier, and title in the table of contents.
        answers: Lines for the head of the page.
    """

    name: str
    title: str
    section: Html
    answers: tuple[str, ...] = ()


_SIDES: Final = 20
_RINGS: Final = 10
# corners and triangles of a box with edges 1
_CORNERS: Final = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_FACES: Final = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7],
     [1, 7, 3]]
)  # fmt: skip


class Triangles:
    """Collects the triangles of all shapes in the root's axes, as :class:`precision_pin.render.scene.Scene` does."""

    def __init__(self) -> None:
        self._poses: dict[tuple[str, ...], Array] = {}
        self._corners: list[Array] = []
        self._colours: list[Array] = []

    @property
    def corners(self) -> Array:
        """Corners of the triangles, ``(F, 3, 3)``: triangle, corner, coordinate (m)."""
        return np.concatenate([np.zeros((0, 3, 3)), *self._corners])

    @property
    def colours(self) -> Array:
        """Red, green, blue of each triangle, ``(F, 3)``."""
        return np.concatenate([np.zeros((0, 3)), *self._colours])

    def place(self, path: Sequence[str], pose: ArrayLike) -> None:
        """Place a node at a pose ``(4, 4)`` relative to its parent."""
        self._poses[tuple(path)] = np.asarray(pose, dtype=float)

    def box(self, path: Sequence[str], size: Sequence[float], colour: Colour, pose: ArrayLike) -> None:
        """Add a box with edges ``size`` (m), centred at ``pose``."""
        self.surface(path, _CORNERS * np.asarray(size, dtype=float), _FACES, colour, pose)

    def cylinder(self, path: Sequence[str], radius: float, length: float, colour: Colour, pose: ArrayLike) -> None:
        """Add a cylinder along z (m), centred at ``pose``."""
        profile = np.array([[0.0, -0.5], [1.0, -0.5], [1.0, 0.5], [0.0, 0.5]]) * (radius, length)
        self.surface(path, *_turned(profile), colour, pose)

    def rod(self, path: Sequence[str], start: ArrayLike, end: ArrayLike, radius: float, colour: Colour) -> None:
        """Add a cylinder between two points ``(3,)`` that do not coincide."""
        first, last = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        length = float(np.linalg.norm(last - first))
        axis = (last - first) / length
        across = np.eye(3)[int(np.argmin(np.abs(axis)))]
        across = across - axis * float(axis @ across)
        across /= np.linalg.norm(across)
        rotation = np.stack([across, np.cross(axis, across), axis], axis=1)
        self.cylinder(path, radius, length, colour, se3.pose(rotation, (first + last) / 2))

    def sphere(self, path: Sequence[str], radius: float, colour: Colour, pose: ArrayLike) -> None:
        """Add a sphere (m) centred at ``pose``."""
        angles = np.linspace(-np.pi / 2, np.pi / 2, _RINGS + 1)
        self.surface(path, *_turned(radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)), colour, pose)

    def surface(
        self, path: Sequence[str], vertices: ArrayLike, faces: ArrayLike, colour: Colour, pose: ArrayLike
    ) -> None:
        """Add triangles: corners ``(V, 3)`` in m and their indices ``(F, 3)``."""
        whole = np.asarray(pose, dtype=float)
        for end in range(len(path) - 1, 0, -1):
            whole = self._poses.get(tuple(path[:end]), np.eye(4)) @ whole
        moved = np.asarray(vertices, dtype=float) @ whole[:3, :3].T + whole[:3, 3]
        corners = moved[np.asarray(faces, dtype=np.int64)]
        self._corners.append(corners)
        self._colours.append(np.broadcast_to(np.asarray(colour[:3], dtype=float), (len(corners), 3)))


def _turned(profile: Array) -> tuple[Array, Array]:
    """Return corners and triangles of a profile ``(R, 2)`` of radius and height, revolved about z."""
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    rings = [np.stack([r * np.cos(angles), r * np.sin(angles), np.full(_SIDES, z)], axis=1) for r, z in profile]
    here = np.arange(_SIDES)
    after = (here + 1) % _SIDES
    faces = []
    for ring in range(len(profile) - 1):
        low, high = ring * _SIDES, (ring + 1) * _SIDES
        faces += [np.stack([low + here, low + after, high + after], axis=1)]
        faces += [np.stack([low + here, high + after, high + here], axis=1)]
    return np.concatenate(rings), np.concatenate(faces)


def rounded(values: Array) -> list[float]:
    """Return seven digits of each number, enough for the page."""
    return [float(f"{value:.7g}") for value in values]
