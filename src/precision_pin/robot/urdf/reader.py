"""Reader of a URDF's text into a `Robot`, with all findings at once."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import cast, final

import numpy as np

from precision_pin.base.errors import Finding, UrdfError
from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.checks import (
    check_angles,
    check_inertias,
    check_names,
    check_size,
    check_tree,
    without_twins,
)
from precision_pin.robot.urdf.findings import Findings, hint, read_regular_file
from precision_pin.robot.urdf.grammar import (
    BEYOND_USE,
    LONGEST_REACH,
    ZERO3,
    BadNumbers,
    check_angle,
    check_attributes,
    check_children,
    check_length,
    is_misread,
    parse_numbers,
    read_name,
    read_numbers,
    read_vector,
)
from precision_pin.robot.urdf.meshes import MeshFiles
from precision_pin.robot.urdf.robot import (
    Box,
    Cylinder,
    Geometry,
    Inertial,
    Joint,
    JointKind,
    Limit,
    Limits,
    Link,
    Mesh,
    Mimic,
    Robot,
    Shape,
    Sphere,
    Vector,
)
from precision_pin.robot.urdf.xmltree import Node, parse_xml

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


TINY_MASS = 1e-6
LARGE_MASS = 500.0
PARTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def read_link(node: Node, findings: Findings, looks: Looks, colours: dict[str, Colour]) -> Link | None:
    """Return the link, None if it has no name.

    Errors go to ``findings``; a link returned with an error only serves to find further errors.
    """
    check_attributes(node, "link", findings)
    name = read_name(node, findings)
    owner = f"link {shown(name or '?')}"
    check_children(node, owner, findings)
    element = node.first("inertial")
    inertial = None if element is None else _inertial(element, owner, findings)
    visuals = looks.read(node, owner, colours)
    return None if name is None else Link(name, inertial, visuals, node.line)


def _inertial(node: Node, owner: str, findings: Findings) -> Inertial | None:
    check_children(node, owner, findings)
    before = findings.errors
    origin = node.first("origin")
    com = read_vector(origin, "xyz", owner, findings)
    rpy = read_vector(origin, "rpy", owner, findings)
    mass = _mass(node, owner, findings)
    inertia = _inertia(node, owner, findings)
    if origin is not None:
        check_length(com, f"{owner}: centre of mass", origin.line, findings)
        check_angle(rpy, f"{owner}: inertial rpy", origin.line, findings)
    if mass is None or inertia is None or findings.errors > before:
        return None
    ixx, ixy, ixz, iyy, iyz, izz = inertia
    if mass > 0 and math.sqrt(max(ixx + iyy + izz, 0.0) / 2 / mass) > LONGEST_REACH:
        message = (
            f"{owner}: inertia up to {max(inertia):g} kg·m² at {mass:g} kg would reach over {LONGEST_REACH:g} m; "
            "are these kg·mm²?"
        )
        findings.warning("W_UNITS", message, node.line)
    return Inertial(mass, com, rpy, (ixx, ixy, ixz, iyy, iyz, izz))


def _mass(node: Node, owner: str, findings: Findings) -> float | None:
    element = node.first("mass")
    if element is None:
        findings.error("E_INERTIAL", f'{owner}: <inertial> has no <mass value="…"/>', node.line)
        return None
    numbers = read_numbers(element, "value", 1, owner, findings)
    if numbers is None:
        return None
    mass = numbers[0]
    if mass < 0:
        findings.error("E_MASS_NEG", f"{owner}: mass {mass:g} kg is negative; zero or more is needed", element.line)
    elif mass > BEYOND_USE:
        findings.error("E_UNITS", f"{owner}: mass {mass:g} kg is implausibly large; masses are in kg", element.line)
    elif mass > LARGE_MASS:
        message = f"{owner}: mass {mass:g} kg; are these grams? masses are in kg"
        findings.warning("W_MASS_LARGE", message, element.line)
    elif mass == 0:
        findings.grouped_warning("W_MASS_ZERO", "a mass of zero is given; it weighs nothing", owner, element.line)
    elif mass < TINY_MASS:
        message = f"{owner}: mass {mass:g} kg is under a milligram"
        findings.warning("W_MASS_TINY", message, element.line)
    return mass


def _inertia(node: Node, owner: str, findings: Findings) -> tuple[float, ...] | None:
    element = node.first("inertia")
    if element is None:
        message = f"{owner}: <inertial> has no <inertia>; {', '.join(PARTS)} are needed"
        findings.error("E_INERTIAL", message, node.line)
        return None
    missing = [part for part in PARTS if element.get(part) is None]
    if missing:
        message = f"{owner}: <inertia> has no {', '.join(missing)}; all of {', '.join(PARTS)} are needed"
        findings.error("E_INERTIAL", message, element.line)
        return None
    values = [read_numbers(element, part, 1, owner, findings) for part in PARTS]
    numbers = tuple(value[0] for value in values if value is not None)
    if len(numbers) < len(PARTS):
        return None
    if np.abs(numbers).max() > BEYOND_USE * LONGEST_REACH**2:
        message = f"{owner}: an inertia of {max(numbers, key=abs):g} kg·m² is implausibly large"
        findings.error("E_UNITS", message, element.line)
        return None
    return numbers


HALF_TURN = 3.14
"""rad, as it is often written."""
KINDS = ("revolute", "continuous", "prismatic", "fixed")
UNSUPPORTED = ("floating", "planar")
UNIT_TOLERANCE = 1e-6
SHORTEST_AXIS = 1e-6
LONGEST_AXIS = 1e6
WIDEST_ANGLE = 4 * math.pi
WIDEST_SHIFT = 20.0
DEFAULT_AXIS = (1.0, 0.0, 0.0)


def read_joint(node: Node, findings: Findings) -> Joint | None:
    """Return the joint, None if its name or one of its links is missing.

    Errors go to ``findings``; a joint returned with an error only serves to find further errors.
    """
    check_attributes(node, "joint", findings)
    name = read_name(node, findings)
    owner = f"joint {shown(name or '?')}"
    check_children(node, owner, findings)
    kind = _kind(node, owner, findings)
    parent = _end(node, "parent", owner, findings)
    child = _end(node, "child", owner, findings)
    origin = node.first("origin")
    xyz = read_vector(origin, "xyz", owner, findings)
    rpy = read_vector(origin, "rpy", owner, findings)
    if origin is not None:
        check_length(xyz, f"{owner}: origin xyz", origin.line, findings)
        check_angle(rpy, f"{owner}: origin rpy", origin.line, findings)
    moves = kind in ("revolute", "continuous", "prismatic")
    axis = _axis(node, owner, findings) if moves else DEFAULT_AXIS
    limit = _limit(node, kind, owner, findings) if moves else None
    if kind == "fixed":
        _check_unused_limit(node, owner, findings)
    mimic = _mimic(node, kind, name, owner, findings)
    _dynamics(node, owner, findings)
    for tag in ("safety_controller", "calibration"):
        ignored = node.first(tag)
        if ignored is not None:
            findings.grouped_warning("W_IGNORED", f"<{tag}> is ignored", owner, ignored.line)
    if name is None or parent is None or child is None:
        return None
    known = cast("JointKind", kind or "fixed")
    return Joint(name, known, parent, child, xyz, rpy, axis, limit, mimic, node.line)


def _kind(node: Node, owner: str, findings: Findings) -> str | None:
    kind = node.get("type")
    if kind in KINDS:
        return kind
    if kind in UNSUPPORTED:
        message = f"{owner}: type {kind} is not supported; allowed: {', '.join(KINDS)}"
        findings.error("E_JOINT_UNSUPPORTED", message, node.line)
    elif kind is None:
        findings.error("E_JOINT_TYPE", f"{owner} has no type; allowed: {', '.join(KINDS)}", node.line)
    else:
        message = f"{owner}: type {shown(kind)} does not exist; allowed: {', '.join(KINDS)}"
        findings.error("E_JOINT_TYPE", message, node.line)
    return None


def _end(node: Node, tag: str, owner: str, findings: Findings) -> str | None:
    element = node.first(tag)
    link = None if element is None else element.get("link")
    if link:
        return link
    code = "E_NO_PARENT" if tag == "parent" else "E_NO_CHILD"
    line = node.line if element is None else element.line
    findings.error(code, f'{owner} has no {tag} link; <{tag} link="…"/> is needed', line)
    return None


def _axis(node: Node, owner: str, findings: Findings) -> Vector:
    element = node.first("axis")
    if element is None:
        findings.warning("W_AXIS_DEFAULT", f"{owner} has no axis; the default 1 0 0 is used", node.line)
        return DEFAULT_AXIS
    if element.get("xyz") is None:
        message = f'{owner}: <axis> has no xyz, which other readers read as zero; <axis xyz="…"/> is needed'
        findings.error("E_AXIS_ZERO", message, element.line)
        return DEFAULT_AXIS
    values = read_numbers(element, "xyz", 3, owner, findings)
    if values is None:
        return DEFAULT_AXIS
    written = shown(element.get("xyz") or "")
    length = math.hypot(*values)
    if length < SHORTEST_AXIS:
        message = f"{owner}: axis {written} is almost zero; a vector of length one is needed"
        findings.error("E_AXIS_ZERO", message, element.line)
        return DEFAULT_AXIS
    if length > LONGEST_AXIS:
        message = f"{owner}: axis {written} has length {length:.3g}; a vector of length one is needed"
        findings.error("E_AXIS_NORM", message, element.line)
        return DEFAULT_AXIS
    if abs(length - 1) > UNIT_TOLERANCE:
        message = f"{owner}: axis {written} has length {length:.7g}, not one; its direction is used"
        findings.warning("W_AXIS_NORM", message, element.line)
    return (values[0] / length, values[1] / length, values[2] / length)


def _limit(node: Node, kind: str | None, owner: str, findings: Findings) -> Limit | None:
    element = node.first("limit")
    if element is None:
        if kind != "continuous":
            message = f"{owner} is {kind} and has no limit; lower, upper, effort and velocity are needed"
            findings.error("E_LIMITS", message, node.line)
        return None
    before = findings.errors
    values: dict[str, float | None] = {}
    for name in ("lower", "upper", "effort", "velocity"):
        numbers = None
        if element.get(name) is not None:
            numbers = read_numbers(element, name, 1, owner, findings, infinite=True)
        values[name] = None if numbers is None else numbers[0]
    if findings.errors > before:
        return None
    effort, velocity = values["effort"], values["velocity"]
    _open_limits(element, values, kind, owner, findings)
    for name, value in (("effort", effort), ("velocity", velocity)):
        if value is not None and value < 0:
            message = f"{owner}: limit {name} {value:g} is negative; zero or more is allowed"
            findings.error("E_LIMITS", message, element.line)
    if kind == "continuous":
        lower, upper = -math.inf, math.inf
    else:
        lower, upper = values["lower"] or 0.0, values["upper"] or 0.0
        if values["lower"] is not None or values["upper"] is not None:
            _check_range(lower, upper, kind, owner, element.line, findings)
    return Limit(lower, upper, math.inf if effort is None else effort, math.inf if velocity is None else velocity)


def _check_unused_limit(node: Node, owner: str, findings: Findings) -> None:
    """Warn of a fixed joint's limit, which is not used, if other readers refuse the file for it."""
    element = node.first("limit")
    if element is None:
        return
    wrong = [name for name in ("effort", "velocity") if element.get(name) is None]
    for name in ("lower", "upper", "effort", "velocity"):
        text = element.get(name)
        if text is not None and (isinstance(parse_numbers(text, 1), BadNumbers) or is_misread(text, 1)):
            wrong.append(name)
    if wrong:
        message = (
            f"{owner} is fixed; its <limit> is ignored, but urdfdom (ROS, Gazebo, Pinocchio) refuses the file for it: "
            f"{' and '.join(wrong)} missing or not a plain number"
        )
        findings.warning("W_LIMITS", message, element.line)


def _open_limits(
    element: Node, values: dict[str, float | None], kind: str | None, owner: str, findings: Findings
) -> None:
    missing = [name for name, value in values.items() if value is None]
    remarks = []
    if kind == "continuous":
        missing = [name for name in missing if name in ("effort", "velocity")]
        # limits of a whole turn or more say the same as none
        written = [name for name in ("lower", "upper") if 0 < abs(values[name] or 0.0) < HALF_TURN]
        if written:
            remarks.append(f"a continuous joint turns without end, so {' and '.join(written)} are ignored")
    zero = [name for name in missing if name in ("lower", "upper")]
    unlimited = [name for name in missing if name in ("effort", "velocity")]
    if zero:
        remarks.append(f"{' and '.join(zero)} not given, 0 is used")
    if unlimited:
        remarks.append(f"{' and '.join(unlimited)} not given, no limit is used")
    limiting = values if kind != "continuous" else ("effort", "velocity")
    infinite = [name for name in limiting if math.isinf(values[name] or 0.0)]
    if infinite:
        remarks.append(f"{' and '.join(infinite)} infinite")
    if remarks:
        findings.warning("W_LIMITS", f"{owner}: limit: {'; '.join(remarks)}", element.line)


def _check_range(lower: float, upper: float, kind: str | None, owner: str, line: int, findings: Findings) -> None:
    if lower > upper or lower == math.inf or upper == -math.inf:
        message = f"{owner}: lower limit {lower:g} is above upper limit {upper:g}; lower ≤ upper is needed"
        findings.error("E_LIMITS", message, line)
        return
    if lower == upper:
        message = f"{owner}: lower and upper limit are both {lower:g}; the joint cannot move within its limits"
        findings.warning("W_LIMITS", message, line)
    widest, unit, meant = (
        (WIDEST_SHIFT, "m", "millimetres") if kind == "prismatic" else (WIDEST_ANGLE, "rad", "degrees")
    )
    large = [value for value in (lower, upper) if math.isfinite(value) and abs(value) > widest]
    if large:
        message = f"{owner}: limit {large[0]:g} {unit} is beyond ±{widest:.4g} {unit}; are these {meant}?"
        findings.warning("W_UNITS", message, line)
    if not lower <= 0 <= upper:
        message = f"{owner}: zero is outside the limits {lower:g} … {upper:g}"
        findings.warning("W_NEUTRAL", message, line)


def _mimic(node: Node, kind: str | None, name: str | None, owner: str, findings: Findings) -> Mimic | None:
    element = node.first("mimic")
    if element is None:
        return None
    joint = element.get("joint")
    if not joint:
        message = f'{owner}: <mimic> names no joint; <mimic joint="…"/> is needed'
        findings.error("E_MIMIC", message, element.line)
        return None
    if joint == name:
        findings.error("E_MIMIC", f"{owner} mimics itself; another joint is needed", element.line)
        return None
    factors = [1.0, 0.0]
    for place, attribute in enumerate(("multiplier", "offset")):
        if element.get(attribute) is not None:
            numbers = read_numbers(element, attribute, 1, owner, findings)
            factors[place] = factors[place] if numbers is None else numbers[0]
    if kind == "fixed":
        findings.warning("W_MIMIC", f"{owner} is fixed; its <mimic> is ignored", element.line)
        return None
    message = (
        f"{owner} mimics {shown(joint)} ({factors[0]:g} × value + {factors[1]:g}); "
        "off the chain it follows that joint, on the chain it must be locked"
    )
    findings.warning("W_MIMIC", message, element.line)
    return Mimic(joint, factors[0], factors[1])


def _dynamics(node: Node, owner: str, findings: Findings) -> None:
    element = node.first("dynamics")
    if element is None:
        return
    given = [name for name in ("damping", "friction") if element.get(name) is not None]
    if not given:
        message = f"{owner}: <dynamics> has neither damping nor friction; it is ignored"
        findings.warning("W_DYNAMICS", message, element.line)
    for name in given:
        numbers = read_numbers(element, name, 1, owner, findings)
        if numbers is not None and numbers[0] < 0:
            message = f"{owner}: {name} {numbers[0]:g} is negative; it is ignored"
            findings.warning("W_DYNAMICS", message, element.line)


def check_mimics(joints: tuple[Joint, ...], findings: Findings) -> None:
    """Refuse a mimic of an unknown or a fixed joint, and a circle of mimics (``E_MIMIC``)."""
    by_name = {joint.name: joint for joint in joints}
    for joint in joints:
        if joint.mimic is None:
            continue
        target = joint.mimic.joint
        followed = f"joint {shown(joint.name)} mimics {shown(target)}"
        if target not in by_name:
            findings.error("E_MIMIC", f"{followed}, which does not exist{hint(target, by_name)}", joint.line)
        elif not by_name[target].moves:
            findings.error(
                "E_MIMIC", f"{followed}, which is fixed and has no value; a moving joint is needed", joint.line
            )
    done: set[str] = set()
    for joint in joints:
        way: dict[str, Joint] = {}
        at: Joint | None = joint
        while at is not None and at.name not in done and at.name not in way:
            way[at.name] = at
            at = by_name.get(at.mimic.joint) if at.mimic is not None else None
        if at is not None and at.name in way:
            circle = list(way)[list(way).index(at.name) :]
            names = " → ".join(shown(name) for name in [*circle[:8], at.name])
            findings.error("E_MIMIC", f"joints mimic each other in a circle: {names}", at.line)
        done.update(way)


Paths = Sequence[str | os.PathLike[str]]
DEFAULT_LIMITS = Limits()
VERSIONS = ("1.0", "1.1", "1.2")
OTHER_ROOTS = {
    "sdf": "this is SDF, not URDF",
    "mujoco": "this is MuJoCo's MJCF, not URDF",
    "html": "this is an HTML page (a failed download?), not URDF",
}


def read(path: str | os.PathLike[str], *, limits: Limits = DEFAULT_LIMITS, package_dirs: Paths = ()) -> Robot:
    """Read a URDF file strictly.

    Parameters
    ----------
    path
        A regular file; the URDF 1.0 format of http://wiki.ros.org/urdf/XML.
    limits
        Size limits of the file.
    package_dirs
        Folders of the packages in ``package://`` mesh names, besides those found near the file.

    Returns
    -------
    Robot
        Its ``findings`` are the warnings. Mesh files are looked up, not opened.

    Raises
    ------
    UrdfError
        The file cannot be used; carries all findings, warnings included.
    """
    robot, findings = _from_file(path, limits, package_dirs, look_inside=False)
    return _robot_or_raise(robot, findings)


def check(
    path: str | os.PathLike[str], *, limits: Limits = DEFAULT_LIMITS, package_dirs: Paths = ()
) -> tuple[Finding, ...]:
    """Return all findings about a URDF file; never raises for bad input.

    As `read`, and the mesh files are opened and checked too.
    """
    return _from_file(path, limits, package_dirs, look_inside=True)[1]


def parse(data: bytes, file: str, *, limits: Limits = DEFAULT_LIMITS) -> Robot:
    """Read a URDF from memory; mesh files are not looked up.

    Parameters
    ----------
    data
        The text, UTF-8.
    file
        Name of the file in findings.
    limits
        Size limits of the file.

    Raises
    ------
    UrdfError
        The text cannot be used; carries all findings, warnings included.
    """
    findings = Findings(file)
    robot = _read_text(data, file, findings, limits, None)
    return _robot_or_raise(robot, findings.result())


def _robot_or_raise(robot: Robot | None, findings: tuple[Finding, ...]) -> Robot:
    if robot is None or any(finding.severity == "error" for finding in findings):
        raise UrdfError(findings)
    return Robot(robot.name, robot.file, robot.links, robot.joints, findings)


def _from_file(
    path: str | os.PathLike[str], limits: Limits, package_dirs: Paths, *, look_inside: bool
) -> tuple[Robot | None, tuple[Finding, ...]]:
    name = os.fspath(path)
    findings = Findings(name)
    data = read_regular_file(path, findings, most_bytes=limits.file_bytes)
    if data is None:
        return None, findings.result()
    folders = [Path(folder) for folder in package_dirs]
    meshes = MeshFiles(findings, Path(name).parent, folders, look_inside=look_inside)
    robot = _read_text(data, name, findings, limits, meshes)
    return robot, findings.result()


def _read_text(data: bytes, file: str, findings: Findings, limits: Limits, meshes: MeshFiles | None) -> Robot | None:
    """Return the robot if links and joints make a tree, with or without errors."""
    node = parse_xml(data, findings, limits)
    if node is None or not _is_robot(node, findings):
        return None
    looks = Looks(findings, meshes)
    colours = looks.materials(node)
    name = _read_header(node, findings)
    read_links = [read_link(link, findings, looks, colours) for link in node.named("link")]
    read_joints = [read_joint(joint, findings) for joint in node.named("joint")]
    if not read_links:
        findings.error("E_NO_LINKS", "the robot has no links; an arm needs two and a joint", node.line)
        return None
    links, joints = without_twins(
        [link for link in read_links if link is not None],
        [joint for joint in read_joints if joint is not None],
        findings,
    )
    check_names(links, joints, findings)
    check_mimics(joints, findings)
    for joint in joints:
        check_angles(joint, findings)
    # a joint without name or end, or a duplicate, would make half the tree look disconnected: check complete trees only
    complete = None not in read_links and len(joints) == len(read_joints)
    sound = check_tree(links, joints, findings) if complete else False
    robot = Robot(name or "", file, links, joints) if sound else None
    check_inertias(links, robot, findings)
    if robot is not None:
        check_size(robot, node.line, limits, findings)
    return robot


def _is_robot(node: Node, findings: Findings) -> bool:
    if node.tag == "robot" and "xmlns" not in node.attributes:
        return True
    why = OTHER_ROOTS.get(node.tag.lower())
    if node.tag == "robot":
        why = f"the root element is in the namespace {shown(node.attributes['xmlns'])}; delete xmlns"
    elif why is None:
        why = f"the root element is <{node.tag[:40]}>"
    findings.error("E_NO_ROBOT", f"{why}; a URDF's root is <robot>", node.line)
    return False


def _read_header(node: Node, findings: Findings) -> str | None:
    check_attributes(node, "robot", findings)
    check_children(node, "robot", findings)
    version = node.get("version")
    if version is not None and version not in VERSIONS:
        message = f"URDF version {shown(version)} is not read; allowed: {', '.join(VERSIONS)}"
        findings.error("E_VERSION", message, node.line)
    return read_name(node, findings)
