"""Reader of visuals and materials. A robot is refused here only for text that is dangerous to other parsers."""

from __future__ import annotations

import re
from typing import final

from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.data import Box, Cylinder, Geometry, Mesh, Shape, Sphere, Vector
from precision_pin.robot.urdf.findings import Findings
from precision_pin.robot.urdf.meshes import MeshFiles
from precision_pin.robot.urdf.numbers import ZERO3, BadNumbers, parse_numbers
from precision_pin.robot.urdf.xmltree import Node

Colour = tuple[float, float, float, float]

# C's printf directives: parsers are known to log bad text as a format string. The two character classes share no
# character, so that matching never takes quadratic time
DIRECTIVE = re.compile(r"%[-+ #0-9.*hlqjztL]*[diouxXeEfFgGaAcspn]")
SHAPES = ("box", "cylinder", "sphere", "mesh")


class _Bad(Exception):
    """A visual or material that cannot be used; carries the reason."""


@final
class Looks:
    """Reader of materials and visuals, which also checks collision shapes (these are not kept).

    Parameters
    ----------
    findings
        Receives ``W_MATERIAL``, ``W_GEOMETRY``, ``W_MESH_…``, ``E_MATERIAL``, ``E_GEOMETRY``.
    meshes
        Checker of mesh files; None if there is no folder to search.
    """

    def __init__(self, findings: Findings, meshes: MeshFiles | None) -> None:
        self._findings = findings
        self._meshes = meshes
        self._defined: set[str] = set()

    def materials(self, robot: Node) -> dict[str, Colour]:
        """Return the colours of the materials defined in ``<robot>`` or in any visual, by name."""
        colours: dict[str, Colour] = {}
        for node in robot.named("material"):
            self._material(node, "robot", colours, top=True)
        for link in robot.named("link"):
            for visual in link.named("visual"):
                for node in visual.named("material"):
                    if node.get("name") and (node.first("color") is not None or node.first("texture") is not None):
                        self._material(node, f"link {shown(link.get('name') or '?')}", colours, top=False)
        return colours

    def read(self, link: Node, owner: str, colours: dict[str, Colour]) -> tuple[Shape, ...]:
        """Return the usable visuals of a link."""
        shapes = []
        for node in link.children:
            if node.tag in ("visual", "collision"):
                shape = self._shape(node, owner, colours)
                if shape is not None and node.tag == "visual":
                    shapes.append(shape)
        return tuple(shapes)

    def _material(self, node: Node, owner: str, colours: dict[str, Colour], *, top: bool) -> None:
        name = node.get("name")
        color = node.first("color")
        problem = None
        if not name:
            problem = "has no name"
        elif top and name in self._defined:
            problem = "is defined twice; the first is used"
        elif color is not None:
            try:
                colours.setdefault(name, _colour(color))
            except _Bad as bad:
                problem = str(bad)
        elif node.first("texture") is None:
            problem = "has neither color nor texture"
        self._defined.add(name or "")
        if problem is not None:
            self._report_material(node, owner, problem)

    def _report_material(self, node: Node, owner: str, problem: str) -> None:
        name = node.get("name") or ""
        message = f"{owner}: material {shown(name)} {problem}"
        if _misleads(node):
            message += "; text with printf directives is refused"
            self._findings.error("E_MATERIAL", message, node.line)
        else:
            self._findings.warning("W_MATERIAL", message, node.line)

    def _shape(self, node: Node, owner: str, colours: dict[str, Colour]) -> Shape | None:
        try:
            origin = node.first("origin")
            xyz = _vector(origin, "xyz")
            rpy = _vector(origin, "rpy")
            geometry = self._geometry(node, owner)
        except _Bad as bad:
            message = f"{owner}: this {node.tag} is left out: {bad}"
            if _misleads(node):
                message += "; text with printf directives is refused"
                self._findings.error("E_GEOMETRY", message, node.line)
            else:
                self._findings.warning("W_GEOMETRY", message, node.line)
            return None
        if geometry is None:
            return None
        colour = self._visual_colour(node, owner, colours) if node.tag == "visual" else None
        return Shape(geometry, xyz, rpy, colour, node.line)

    def _visual_colour(self, node: Node, owner: str, colours: dict[str, Colour]) -> Colour | None:
        material = node.first("material")
        if material is None:
            return None
        name, color = material.get("name") or "", material.first("color")
        if not name:
            message = "a material without a name, for which other readers leave the visual out"
            self._findings.grouped_warning("W_MATERIAL", message, owner, material.line)
        elif color is None and name not in self._defined:
            message = f"material {shown(name)} is not defined; its visuals are drawn grey"
            self._findings.grouped_warning("W_MATERIAL", message, owner, material.line)
        if color is None:
            return colours.get(name)
        try:
            return _colour(color)
        except _Bad as bad:
            if not name:
                self._report_material(material, owner, str(bad))
            return None

    def _geometry(self, node: Node, owner: str) -> Geometry | None:
        element = node.first("geometry")
        if element is None:
            raise _Bad("it has no <geometry>")
        shapes = [child for child in element.children if child.tag in SHAPES]
        if not shapes:
            found = f"<{element.children[0].tag[:40]}>" if element.children else "nothing"
            raise _Bad(f"<geometry> holds {found}; one of {', '.join(SHAPES)} is needed")
        if len(shapes) > 1:
            raise _Bad(f"<geometry> holds {len(shapes)} shapes; one is needed")
        shape = shapes[0]
        if shape.tag == "mesh":
            return self._mesh(shape, owner)
        if shape.tag == "box":
            x, y, z = _sizes(shape, "size", 3)
            return Box((x, y, z))
        if shape.tag == "cylinder":
            return Cylinder(_sizes(shape, "radius", 1)[0], _sizes(shape, "length", 1)[0])
        return Sphere(_sizes(shape, "radius", 1)[0])

    def _mesh(self, node: Node, owner: str) -> Mesh | None:
        filename = (node.get("filename") or "").strip()
        if not filename:
            self._findings.warning("W_MESH_MISSING", f"{owner}: a mesh without filename is left out", node.line)
            return None
        if self._meshes is not None:
            self._meshes.check(filename, owner, node.line)
        scale: Vector = (1.0, 1.0, 1.0)
        if node.get("scale") is not None:
            numbers = parse_numbers(node.get("scale") or "", 3)
            if isinstance(numbers, BadNumbers):
                message = f"{owner}: mesh scale {shown(node.get('scale') or '')} {numbers.reason}; 1 1 1 is used"
                self._findings.warning("W_MESH_SCALE", message, node.line)
            else:
                scale = (numbers[0], numbers[1], numbers[2])
                if min(scale) <= 0:
                    what = "flattens" if 0 in scale else "mirrors"
                    message = f"mesh scale {shown(node.get('scale') or '')} {what} the mesh; positive is usual"
                    self._findings.grouped_warning("W_MESH_SCALE", message, owner, node.line)
        return Mesh(filename, scale)


def _misleads(node: Node) -> bool:
    # %20 in a file name is no directive, and file names are never logged by a parser here
    texts = (value for name, value in node.attributes.items() if name != "filename")
    return any(DIRECTIVE.search(text) for text in texts) or any(map(_misleads, node.children))


def _numbers(node: Node, attribute: str, count: int) -> tuple[float, ...]:
    text = node.get(attribute)
    if text is None:
        raise _Bad(f"<{node.tag}> has no {attribute}")
    result = parse_numbers(text, count)
    if isinstance(result, BadNumbers):
        raise _Bad(f"<{node.tag}> {attribute}={shown(text)} {result.reason}")
    return result


def _sizes(node: Node, attribute: str, count: int) -> tuple[float, ...]:
    values = _numbers(node, attribute, count)
    if min(values) <= 0:
        raise _Bad(f"<{node.tag}> {attribute}={shown(node.get(attribute) or '')} must be positive")
    return values


def _vector(node: Node | None, attribute: str) -> Vector:
    if node is None or node.get(attribute) is None:
        return ZERO3
    x, y, z = _numbers(node, attribute, 3)
    return (x, y, z)


def _colour(node: Node) -> Colour:
    red, green, blue, opacity = _numbers(node, "rgba", 4)
    if min(red, green, blue, opacity) < 0 or max(red, green, blue, opacity) > 1:
        raise _Bad(f"rgba={shown(node.get('rgba') or '')} must lie between 0 and 1")
    return (red, green, blue, opacity)
