"""The arm at a posture: its URDF shapes, or plain cylinders where it has none."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from precision_pin.base import se3
from precision_pin.base.arrays import Array
from precision_pin.model.pose_model import Part
from precision_pin.pages.view.scales import arm_length
from precision_pin.render.scene import Colour, Scene, Triangles, rotation_to
from precision_pin.robot.chain import Posture
from precision_pin.robot.mesh_surfaces import MeshReader, Surface, UnreadableMeshError, thinned
from precision_pin.robot.urdf import Box, Cylinder, Link, Mesh, Shape, Sphere

GREY: Final[Colour] = (0.62, 0.65, 0.69, 1.0)
PLAIN: Final[Colour] = (0.45, 0.55, 0.66, 1.0)
JOINT: Final[Colour] = (0.87, 0.55, 0.20, 1.0)
# of plain cylinders, as a fraction of the arm's length
_ROD_RADIUS: Final = 0.012


def draw_arm(
    scene: Scene | Triangles, posture: Posture, package_dirs: Sequence[Path] = ()
) -> tuple[tuple[Part, ...], tuple[str, ...]]:
    """Add every link of the robot to the scene below ``arm``; return the parts, and notes on parts drawn differently.

    A link whose mesh is missing or unreadable, and a rigid piece of the chain without any shape, is drawn as plain
    cylinders along it. ``package_dirs`` are further folders for ``package://`` mesh names.
    """
    drawing = _Drawing(scene, posture, package_dirs)
    return tuple(drawing.parts), tuple(dict.fromkeys(drawing.notes))


class _Drawing:
    """A drawing that is made with the instance."""

    def __init__(self, scene: Scene | Triangles, posture: Posture, package_dirs: Sequence[Path]) -> None:
        self._scene = scene
        self._posture = posture
        self._chain = posture.chain
        self._length = arm_length(posture)
        self._reader = MeshReader(self._chain.robot.file, package_dirs)
        self._parents = {joint.child: joint.parent for joint in self._chain.robot.joints}
        self.parts: list[Part] = []
        self.notes: list[str] = []
        self._surfaces: list[tuple[tuple[str, ...], Surface, Colour, Array, str]] = []
        links_with_shapes: set[int] = set()
        for number, link in enumerate(self._chain.robot.links):
            where = self._chain.link_frames[link.name]
            path = self._part(f"link{number}", where.link, where.frame, self._rank(link.name))
            self._draw_link(path, link)
            if link.visuals:
                links_with_shapes.add(where.link)
        self._draw_surfaces()
        self._draw_bare_links(links_with_shapes)

    def _part(self, name: str, link: int, frame: Array, rank: int | None) -> tuple[str, ...]:
        self.parts.append(Part(name, link, frame, rank))
        self._scene.place(("arm", name), self._posture.link_poses[link] @ frame)
        return ("arm", name)

    def _rank(self, name: str) -> int | None:
        """Return the rank of the path link that carries a link; None from the tip on."""
        while self._chain.link_frames[name].path_rank is None:
            name = self._parents[name]
        return None if name == self._chain.tip else self._chain.link_frames[name].path_rank

    def _draw_link(self, path: tuple[str, ...], link: Link) -> None:
        is_unreadable = False
        for number, shape in enumerate(link.visuals):
            try:
                self._draw_shape((*path, f"shape{number}"), shape, f"link {link.name!r}")
            except UnreadableMeshError as problem:
                self.notes.append(f"{problem}; drawn as a plain cylinder")
                is_unreadable = True
        if is_unreadable:
            # from the link's frame to the joints that it carries, and a ball at its frame
            self._scene.sphere((*path, "ball"), 1.5 * _ROD_RADIUS * self._length, PLAIN, np.eye(4))
            for number, joint in enumerate(self._chain.robot.child_joints(link.name)):
                self._draw_rod((*path, f"rod{number}"), joint.origin[:3, 3])

    def _draw_shape(self, path: tuple[str, ...], shape: Shape, owner: str) -> None:
        colour = shape.colour or GREY
        match shape.geometry:
            case Box(size):
                self._scene.box(path, size, colour, shape.origin)
            case Cylinder(radius, length):
                self._scene.cylinder(path, radius, length, colour, shape.origin)
            case Sphere(radius):
                self._scene.sphere(path, radius, colour, shape.origin)
            case Mesh() as mesh:
                for number, surface in enumerate(self._reader.surfaces(mesh, owner)):
                    part = (*path, f"part{number}")
                    self._surfaces.append((part, surface, surface.colour or colour, shape.origin, owner))

    def _draw_surfaces(self) -> None:
        """Draw the meshes of all links, which share the page's size limit."""
        if not self._surfaces:
            return
        paths, surfaces, colours, origins, owners = zip(*self._surfaces, strict=True)
        before = sum(len(surface.faces) for surface in surfaces)
        reduced = thinned(surfaces, self._length)
        after = sum(len(surface.faces) for surface in reduced)
        if 0 < after < before / 2:
            self.notes.append(f"meshes thinned out from {before:,} to {after:,} triangles")
        for path, surface, colour, origin, owner in zip(paths, reduced, colours, origins, owners, strict=True):
            if len(surface.faces):
                self._scene.surface(path, surface.vertices, surface.faces, colour, origin)
            else:
                self.notes.append(f"{owner}: a mesh, or a part of one, is too small to be seen; it is not drawn")

    def _draw_bare_links(self, links_with_shapes: set[int]) -> None:
        """Draw the parts without shapes: rigid pieces of the chain as rods, their joints as drums."""
        bare = set(range(len(self._posture.link_poses))) - links_with_shapes
        for link in sorted(bare):
            path = self._part(f"chain{link}", link, np.eye(4), 0)
            self._draw_rod((*path, "rod"), self._chain.placements[link][:3, 3])
        for joint, axis in enumerate(self._chain.axes):
            if not bare & {joint, joint + 1}:
                continue
            path = self._part(f"joint{joint}", joint + 1, np.eye(4), 0)
            pose = se3.pose(rotation_to(axis), (0.0, 0.0, 0.0))
            width, height = 0.022 * self._length, 0.05 * self._length
            if self._chain.prismatic[joint]:
                self._scene.box((*path, "slide"), (1.6 * width, 1.6 * width, height), JOINT, pose)
            else:
                self._scene.cylinder((*path, "drum"), width, height, JOINT, pose)

    def _draw_rod(self, path: tuple[str, ...], end: Array) -> None:
        if np.linalg.norm(end) > 1e-3 * self._length:
            self._scene.rod(path, np.zeros(3), end, _ROD_RADIUS * self._length, PLAIN)
