"""Reader of a URDF's text into a `Robot`, with all findings at once."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, cast

from precision_pin.base import files
from precision_pin.base.errors import Finding, UrdfError, shown
from precision_pin.robot.urdf import checks
from precision_pin.robot.urdf import robot as tree
from precision_pin.robot.urdf import xmltree as xml
from precision_pin.robot.urdf.editing import UrdfText
from precision_pin.robot.urdf.meshes import MeshFiles
from precision_pin.robot.urdf.xmltree import Findings, Node, Owner

Paths = Sequence[str | os.PathLike[str]]
DEFAULT_LIMITS = tree.Limits()
OTHER_ROOTS = {
    "sdf": "this is SDF, not URDF",
    "mujoco": "this is MuJoCo's MJCF, not URDF",
    "html": "this is an HTML page (a failed download?), not URDF",
}
Colour = tuple[float, float, float, float]
SHAPES: Final = ("box", "cylinder", "sphere", "mesh")
# C's printf directives: parsers are known to log bad text as a format string. The two character classes share no
# character, so that matching never takes quadratic time
DIRECTIVE: Final = re.compile(r"%[-+ #0-9.*hlqjztL]*[diouxXeEfFgGaAcspn]")
KINDS: Final = ("revolute", "continuous", "prismatic", "fixed")
DEFAULT_AXIS: Final = (1.0, 0.0, 0.0)


def read(path: str | os.PathLike[str], *, limits: tree.Limits = DEFAULT_LIMITS, package_dirs: Paths = ()) -> tree.Robot:
    """Read a URDF 1.0 file strictly (http://wiki.ros.org/urdf/XML); the robot's ``findings`` are the warnings.

    ``package_dirs`` are the folders of packages in ``package://`` mesh names, besides those found near the file. Mesh
    files are looked up, not opened. Raises `UrdfError` with all findings if the file cannot be used.
    """
    return _robot_or_raise(*_from_file(path, limits, package_dirs, look_inside=False))


def check(
    path: str | os.PathLike[str], *, limits: tree.Limits = DEFAULT_LIMITS, package_dirs: Paths = ()
) -> tuple[Finding, ...]:
    """Return all findings about a URDF file, as `read` but with mesh files opened; never raises for bad input."""
    return _from_file(path, limits, package_dirs, look_inside=True)[1]


def parse(data: bytes, file: str, *, limits: tree.Limits = DEFAULT_LIMITS) -> tree.Robot:
    """Read a URDF from memory, as `read` does; ``file`` is its name in findings. Mesh files are not looked up."""
    findings = Findings(file)
    return _robot_or_raise(_read_text(data, file, findings, limits, None), findings.result())


def mended(path: str | os.PathLike[str], *, limits: tree.Limits = DEFAULT_LIMITS) -> tuple[bytes, tuple[str, ...]]:
    """Return the text of a URDF file with physical inertias, and the names of the links that were changed.

    Mass and centre of mass, all that gravity needs, stay. Raises `UrdfError` for other errors.
    """
    robot = _robot_or_raise(*_from_file(path, limits, (), look_inside=False), checks.INERTIAS)
    data = files.read_regular_file(path, limits.file_bytes)
    inertias = checks.mended_inertias(robot.links)
    text = UrdfText.scan(data).edited({}, inertias=inertias) if inertias else data
    parse(text, robot.file, limits=limits)
    return text, tuple(inertias)


def _robot_or_raise(
    robot: tree.Robot | None, findings: tuple[Finding, ...], let_pass: frozenset[str] = frozenset()
) -> tree.Robot:
    if robot is None or any(finding.severity == "error" and finding.code not in let_pass for finding in findings):
        raise UrdfError(findings)
    return replace(robot, findings=findings)


def _from_file(
    path: str | os.PathLike[str], limits: tree.Limits, package_dirs: Paths, *, look_inside: bool
) -> tuple[tree.Robot | None, tuple[Finding, ...]]:
    name = os.fspath(path)
    findings = Findings(name)
    data = xml.read_regular_file(path, findings, most_bytes=limits.file_bytes)
    robot = None
    if data is not None:
        meshes = MeshFiles(findings, Path(name).parent, [*map(Path, package_dirs)], look_inside=look_inside)
        robot = _read_text(data, name, findings, limits, meshes)
    return robot, findings.result()


def _read_text(
    data: bytes, file: str, findings: Findings, limits: tree.Limits, meshes: MeshFiles | None
) -> tree.Robot | None:
    """Return the robot if links and joints make a tree, with or without errors."""
    node = xml.parse_xml(data, findings, limits)
    if node is None:
        return None
    if node.tag != "robot" or "xmlns" in node.attributes:
        why = OTHER_ROOTS.get(node.tag.lower(), f"the root element is <{node.tag[:40]}>")
        if node.tag == "robot":
            why = f"the root element is in the namespace {shown(node.attributes['xmlns'])}; delete xmlns"
        findings.add("E_NO_ROBOT", f"{why}; a URDF's root is <robot>", node.line)
        return None
    looks = Looks(findings, meshes)
    colours = looks.materials(node)
    owner = Owner("robot", findings)
    owner.check_attributes(node)
    owner.check_children(node)
    version = node.get("version")
    if version not in (None, "1.0", "1.1", "1.2"):
        findings.add("E_VERSION", f"URDF version {shown(version or '')} is not read; allowed: 1.0, 1.1, 1.2", node.line)
    name = xml.read_name(node, findings)
    read_links = [read_link(link, findings, looks, colours) for link in node.named("link")]
    read_joints = [read_joint(joint, findings) for joint in node.named("joint")]
    if not read_links:
        findings.add("E_NO_LINKS", "the robot has no links; an arm needs two and a joint", node.line)
        return None
    links = checks.without_twins(read_links, "link", "E_DUP_LINK", findings)
    joints = checks.without_twins(read_joints, "joint", "E_DUP_JOINT", findings)
    checks.check_names(links, joints, findings)
    checks.check_joints(joints, findings)
    # a joint without name or end, or a duplicate, would make half the tree look disconnected: check complete trees only
    complete = None not in read_links and len(joints) == len(read_joints)
    sound = complete and checks.check_tree(links, joints, findings)
    robot = tree.Robot(name or "", file, links, joints) if sound else None
    checks.check_inertias(links, robot, findings)
    if robot is not None:
        checks.check_size(robot, node.line, limits, findings)
    return robot


def read_link(node: Node, findings: Findings, looks: Looks, colours: dict[str, Colour]) -> tree.Link | None:
    """Return the link, None without a name; with an error it only serves to find further errors."""
    name, owner = _open(node, findings)
    element = node.first("inertial")
    inertial = None if element is None else _inertial(element, owner)
    visuals, collisions = looks.read(node, owner.name, colours)
    return None if name is None else tree.Link(name, inertial, visuals, collisions, node.line)


def _open(node: Node, findings: Findings) -> tuple[str | None, Owner]:
    Owner(node.tag, findings).check_attributes(node)
    name = xml.read_name(node, findings)
    owner = Owner(f"{node.tag} {shown(name or '?')}", findings)
    owner.check_children(node)
    return name, owner


def _inertial(node: Node, owner: Owner) -> tree.Inertial | None:
    owner.check_children(node)
    before = owner.findings.errors
    com, rpy = owner.placement(node)
    mass = _mass(node, owner)
    inertia = _inertia(node, owner)
    owner.check_placement(node, com, rpy, ": centre of mass", ": inertial rpy")
    if mass is None or inertia is None or owner.findings.errors > before:
        return None
    ixx, ixy, ixz, iyy, iyz, izz = inertia
    if mass > 0 and math.sqrt(max(ixx + iyy + izz, 0.0) / 2 / mass) > xml.LONGEST_REACH:
        text = (
            f": inertia up to {max(inertia):g} kg·m² at {mass:g} kg would reach over {xml.LONGEST_REACH:g} m; "
            "are these kg·mm²?"
        )
        owner.say("W_UNITS", text, node.line)
    return tree.Inertial(mass, com, rpy, (ixx, ixy, ixz, iyy, iyz, izz))


def _mass(node: Node, owner: Owner) -> float | None:
    element = owner.child(node, "mass")
    if element is None or (numbers := owner.read(element, "value")) is None:
        return None
    mass = numbers[0]
    rules = (
        (mass < 0, "E_MASS_NEG", " is negative; zero or more is needed"),
        (mass > xml.BEYOND_USE, "E_UNITS", " is implausibly large; masses are in kg"),
        (mass > 500, "W_MASS_LARGE", "; are these grams? masses are in kg"),
        (0 < mass < 1e-6, "W_MASS_TINY", " is under a milligram"),
    )
    if mass == 0:
        owner.findings.group("W_MASS_ZERO", "a mass of zero is given; it weighs nothing", owner.name, element.line)
    for code, text in [(code, text) for holds, code, text in rules if holds][:1]:
        owner.say(code, f": mass {mass:g} kg{text}", element.line)
    return mass


def _inertia(node: Node, owner: Owner) -> tuple[float, ...] | None:
    element = owner.child(node, "inertia")
    if element is None:
        return None
    missing = [part for part in tree.PARTS if element.get(part) is None]
    if missing:
        text = f": <inertia> has no {', '.join(missing)}; all of {', '.join(tree.PARTS)} are needed"
        owner.say("E_INERTIAL", text, element.line)
        return None
    numbers = tuple(value[0] for value in owner.numbers(element).values() if value is not None)
    if len(numbers) < len(tree.PARTS):
        return None
    if max(map(abs, numbers)) > xml.BEYOND_USE * xml.LONGEST_REACH**2:
        text = f": an inertia of {max(numbers, key=abs):g} kg·m² is implausibly large"
        owner.say("E_UNITS", text, element.line)
        return None
    return numbers


def read_joint(node: Node, findings: Findings) -> tree.Joint | None:
    """Return the joint, None without a name or link; with an error it only serves to find further errors."""
    name, owner = _open(node, findings)
    kind = _kind(node, owner)
    parent, child = _end(node, "parent", owner), _end(node, "child", owner)
    xyz, rpy = owner.placement(node)
    owner.check_placement(node, xyz, rpy, ": origin xyz", ": origin rpy")
    axis: tree.Vector = DEFAULT_AXIS
    limit: tree.Limit | None = None
    if kind == "fixed":
        _check_unused_limit(node, owner)
    elif kind is not None:
        axis, limit = _axis(node, owner), _limit(node, kind, owner)
    mimic = _mimic(node, kind, name, owner)
    _check_dynamics(node, owner)
    for tag in ("safety_controller", "calibration"):
        if (ignored := node.first(tag)) is not None:
            findings.group("W_IGNORED", f"<{tag}> is ignored", owner.name, ignored.line)
    if name is None or parent is None or child is None:
        return None
    return tree.Joint(name, kind or "fixed", parent, child, xyz, rpy, axis, limit, mimic, node.line)


def _kind(node: Node, owner: Owner) -> tree.JointKind | None:
    kind, allowed = node.get("type"), f"; allowed: {', '.join(KINDS)}"
    if kind in KINDS:
        return cast("tree.JointKind", kind)
    if kind in ("floating", "planar"):
        owner.say("E_JOINT_UNSUPPORTED", f": type {kind} is not supported{allowed}", node.line)
    else:
        what = " has no type" if kind is None else f": type {shown(kind)} does not exist"
        owner.say("E_JOINT_TYPE", what + allowed, node.line)
    return None


def _end(node: Node, tag: str, owner: Owner) -> str | None:
    element = node.first(tag)
    link = None if element is None else element.get("link")
    if not link:
        owner.say(*xml.GRAMMAR[tag].missing, (element or node).line)
    return link or None


def _axis(node: Node, owner: Owner) -> tree.Vector:
    element = owner.child(node, "axis")
    if element is None:
        return DEFAULT_AXIS
    if element.get("xyz") is None:
        text = ': <axis> has no xyz, which other readers read as zero; <axis xyz="…"/> is needed'
        owner.say("E_AXIS_ZERO", text, element.line)
    axis = xml.as_vector(owner.read(element, "xyz"))
    if axis is None:
        return DEFAULT_AXIS
    length, needed = math.hypot(*axis), "; a vector of length one is needed"
    code, what = "", ""
    if length < 1e-6:
        code, what = "E_AXIS_ZERO", f"is almost zero{needed}"
    elif length > 1e6:
        code, what = "E_AXIS_NORM", f"has length {length:.3g}{needed}"
    elif abs(length - 1) > 1e-6:
        code, what = "W_AXIS_NORM", f"has length {length:.7g}, not one; its direction is used"
    if code:
        owner.say(code, f": axis {shown(element.get('xyz') or '')} {what}", element.line)
    return DEFAULT_AXIS if code.startswith("E") else (axis[0] / length, axis[1] / length, axis[2] / length)


def _limit(node: Node, kind: str | None, owner: Owner) -> tree.Limit | None:
    element = node.first("limit")
    if element is None:
        if kind != "continuous":
            code, text = xml.GRAMMAR["limit"].missing
            owner.say(code, f" is {kind}{text}", node.line)
        return None
    before = owner.findings.errors
    values = {name: None if value is None else value[0] for name, value in owner.numbers(element).items()}
    if owner.findings.errors > before:
        return None
    _note_open_limits(element, values, kind, owner)
    for name in ("effort", "velocity"):
        value = values[name]
        if value is not None and value < 0:
            owner.say("E_LIMITS", f": limit {name} {value:g} is negative; zero or more is allowed", element.line)
    if kind == "continuous":
        lower, upper = -math.inf, math.inf
    else:
        lower, upper = values["lower"] or 0.0, values["upper"] or 0.0
        if values["lower"] is not None or values["upper"] is not None:
            _check_range(lower, upper, kind, element.line, owner)
    effort, velocity = (math.inf if value is None else value for value in (values["effort"], values["velocity"]))
    return tree.Limit(lower, upper, effort, velocity)


def _check_unused_limit(node: Node, owner: Owner) -> None:
    """Warn of a fixed joint's unused limit if other readers refuse the file for it."""
    element = node.first("limit")
    if element is None:
        return
    wrong = [name for name in ("effort", "velocity") if element.get(name) is None]
    for name in xml.BOUNDS:
        text = element.get(name)
        if text is not None and (isinstance(xml.parse_numbers(text, 1), xml.BadNumbers) or xml.is_misread(text, 1)):
            wrong.append(name)
    if wrong:
        text = (
            " is fixed; its <limit> is ignored, but urdfdom (ROS, Gazebo, Pinocchio) refuses the file for it: "
            f"{' and '.join(wrong)} missing or not a plain number"
        )
        owner.say("W_LIMITS", text, element.line)


def _note_open_limits(element: Node, values: dict[str, float | None], kind: str | None, owner: Owner) -> None:
    """Warn of limits that are missing, unused or infinite."""
    turns = kind == "continuous"
    # limits of a whole turn or more, half a turn being often written as 3.14, are equivalent to none
    written = [name for name in ("lower", "upper") if turns and 0 < abs(values[name] or 0.0) < 3.14]
    zero = [name for name in ("lower", "upper") if not turns and values[name] is None]
    unlimited = [name for name in ("effort", "velocity") if values[name] is None]
    infinite = [name for name in xml.BOUNDS[2 if turns else 0 :] if math.isinf(values[name] or 0.0)]
    remarks = [
        before + " and ".join(names) + after
        for before, names, after in (
            ("a continuous joint turns without end, so ", written, " are ignored"),
            ("", zero, " not given, 0 is used"),
            ("", unlimited, " not given, no limit is used"),
            ("", infinite, " infinite"),
        )
        if names
    ]
    if remarks:
        owner.say("W_LIMITS", f": limit: {'; '.join(remarks)}", element.line)


def _check_range(lower: float, upper: float, kind: str | None, line: int, owner: Owner) -> None:
    if lower > upper or lower == math.inf or upper == -math.inf:
        text = f": lower limit {lower:g} is above upper limit {upper:g}; lower ≤ upper is needed"
        owner.say("E_LIMITS", text, line)
        return
    if lower == upper:
        text = f": lower and upper limit are both {lower:g}; the joint cannot move within its limits"
        owner.say("W_LIMITS", text, line)
    slides = kind == "prismatic"
    widest, unit, meant = (20.0, "m", "millimetres") if slides else (4 * math.pi, "rad", "degrees")
    large = [value for value in (lower, upper) if math.isfinite(value) and abs(value) > widest]
    if large:
        text = f": limit {large[0]:g} {unit} is beyond ±{widest:.4g} {unit}; are these {meant}?"
        owner.say("W_UNITS", text, line)
    if not lower <= 0 <= upper:
        owner.say("W_NEUTRAL", f": zero is outside the limits {lower:g} … {upper:g}", line)


def _mimic(node: Node, kind: str | None, name: str | None, owner: Owner) -> tree.Mimic | None:
    element = node.first("mimic")
    if element is None:
        return None
    joint = element.get("joint")
    if not joint or joint == name:
        nameless = ': <mimic> names no joint; <mimic joint="…"/> is needed'
        owner.say("E_MIMIC", " mimics itself; another joint is needed" if joint else nameless, element.line)
        return None
    multiplier, offset = (
        default if value is None else value[0]
        for default, value in zip((1.0, 0.0), owner.numbers(element).values(), strict=True)
    )
    if kind == "fixed":
        owner.say("W_MIMIC", " is fixed; its <mimic> is ignored", element.line)
        return None
    text = (
        f" mimics {shown(joint)} ({multiplier:g} × value + {offset:g}); "
        "off the chain it follows that joint, on the chain it must be locked"
    )
    owner.say("W_MIMIC", text, element.line)
    return tree.Mimic(joint, multiplier, offset)


def _check_dynamics(node: Node, owner: Owner) -> None:
    element = node.first("dynamics")
    if element is None:
        return
    if not {"damping", "friction"} & set(element.attributes):
        owner.say("W_DYNAMICS", ": <dynamics> has neither damping nor friction; it is ignored", element.line)
    for name in ("damping", "friction"):
        if (numbers := owner.read(element, name)) is not None and numbers[0] < 0:
            owner.say("W_DYNAMICS", f": {name} {numbers[0]:g} is negative; it is ignored", element.line)


class _Bad(Exception):
    """An unusable visual or material; carries the reason."""


class Looks:
    """Reader of materials, visuals and collision shapes.

    Refuses a robot only for text dangerous to other parsers. ``meshes`` checks mesh files; None without a folder to
    search.
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
        visuals = [(link, visual) for link in robot.named("link") for visual in link.named("visual")]
        for link, node in [(link, node) for link, visual in visuals for node in visual.named("material")]:
            if node.get("name") and (node.first("color") is not None or node.first("texture") is not None):
                self._material(node, f"link {shown(link.get('name') or '?')}", colours, top=False)
        return colours

    def read(
        self, link: Node, owner: str, colours: dict[str, Colour]
    ) -> tuple[tuple[tree.Shape, ...], tuple[tree.Shape, ...]]:
        """Return the usable visuals and collision shapes of a link."""
        shapes: dict[str, list[tree.Shape]] = {"visual": [], "collision": []}
        for node in link.children:
            shape = self._shape(node, owner, colours) if node.tag in shapes else None
            if shape is not None:
                shapes[node.tag].append(shape)
        return tuple(shapes["visual"]), tuple(shapes["collision"])

    def _material(self, node: Node, owner: str, colours: dict[str, Colour], *, top: bool) -> None:
        name, color = node.get("name") or "", node.first("color")
        try:
            if not name:
                raise _Bad("has no name")
            if top and name in self._defined:
                raise _Bad("is defined twice; the first is used")
            if color is not None:
                colours.setdefault(name, _colour(color))
            elif node.first("texture") is None:
                raise _Bad("has neither color nor texture")
        except _Bad as bad:
            self._report_material(node, owner, bad)
        self._defined.add(name)

    def _report_material(self, node: Node, owner: str, problem: _Bad) -> None:
        self._report(node, f"{owner}: material {shown(node.get('name') or '')} {problem}", "W_MATERIAL", "E_MATERIAL")

    def _report(self, node: Node, message: str, usual: str, dangerous: str) -> None:
        code, more = (dangerous, "; text with printf directives is refused") if _misleads(node) else (usual, "")
        self._findings.add(code, message + more, node.line)

    def _shape(self, node: Node, owner: str, colours: dict[str, Colour]) -> tree.Shape | None:
        try:
            origin = node.first("origin")
            xyz, rpy = _vector(origin, "xyz"), _vector(origin, "rpy")
            geometry = self._geometry(node, owner)
        except _Bad as bad:
            self._report(node, f"{owner}: this {node.tag} is left out: {bad}", "W_GEOMETRY", "E_GEOMETRY")
            return None
        if geometry is None:
            return None
        colour = self._visual_colour(node, owner, colours) if node.tag == "visual" else None
        return tree.Shape(geometry, xyz, rpy, colour, node.line)

    def _visual_colour(self, node: Node, owner: str, colours: dict[str, Colour]) -> Colour | None:
        material = node.first("material")
        if material is None:
            return None
        name, color = material.get("name") or "", material.first("color")
        if not name or (color is None and name not in self._defined):
            nameless = "a material without a name, for which other readers leave the visual out"
            message = f"material {shown(name)} is not defined; its visuals are drawn grey" if name else nameless
            self._findings.group("W_MATERIAL", message, owner, material.line)
        if color is None:
            return colours.get(name)
        try:
            return _colour(color)
        except _Bad as bad:
            if not name:
                self._report_material(material, owner, bad)
        return None

    def _geometry(self, node: Node, owner: str) -> tree.Geometry | None:
        element = node.first("geometry")
        if element is None:
            raise _Bad("it has no <geometry>")
        shapes = [child for child in element.children if child.tag in SHAPES]
        if not shapes:
            content = f"<{element.children[0].tag[:40]}>" if element.children else "nothing"
            raise _Bad(f"<geometry> holds {content}; one of {', '.join(SHAPES)} is needed")
        if len(shapes) > 1:
            raise _Bad(f"<geometry> holds {len(shapes)} shapes; one is needed")
        shape = shapes[0]
        if shape.tag == "mesh":
            return self._mesh(shape, owner)
        sizes: list[float] = []
        for name, form in xml.GRAMMAR[shape.tag].attributes.items():
            values = _numbers(shape, name, form.count)
            if min(values) <= 0:
                raise _Bad(f"<{shape.tag}> {name}={shown(shape.get(name) or '')} must be positive")
            sizes += values
        if shape.tag == "box":
            return tree.Box((sizes[0], sizes[1], sizes[2]))
        return tree.Sphere(*sizes) if shape.tag == "sphere" else tree.Cylinder(*sizes)

    def _mesh(self, node: Node, owner: str) -> tree.Mesh | None:
        filename, written = (node.get("filename") or "").strip(), node.get("scale")
        if not filename:
            self._findings.add("W_MESH_MISSING", f"{owner}: a mesh without filename is left out", node.line)
            return None
        if self._meshes is not None:
            self._meshes.check(filename, owner, node.line)
        try:
            scale = tree.Mesh.scale if written is None else _vector(node, "scale")
        except _Bad as bad:
            self._findings.add("W_MESH_SCALE", f"{owner}: {bad}; 1 1 1 is used", node.line)
            scale = tree.Mesh.scale
        if min(scale) <= 0:
            what = "flattens" if 0 in scale else "mirrors"
            message = f"mesh scale {shown(written or '')} {what} the mesh; positive is usual"
            self._findings.group("W_MESH_SCALE", message, owner, node.line)
        return tree.Mesh(filename, scale)


def _misleads(node: Node) -> bool:
    # %20 in a file name is no directive, and file names are never logged by a parser here
    texts = (value for name, value in node.attributes.items() if name != "filename")
    return any(DIRECTIVE.search(text) for text in texts) or any(map(_misleads, node.children))


def _numbers(node: Node, attribute: str, count: int) -> tuple[float, ...]:
    text = node.get(attribute)
    if text is None:
        raise _Bad(f"<{node.tag}> has no {attribute}")
    result = xml.parse_numbers(text, count)
    if isinstance(result, xml.BadNumbers):
        raise _Bad(f"<{node.tag}> {attribute}={shown(text)} {result.reason}")
    if max(map(abs, result)) > xml.BEYOND_USE:
        raise _Bad(f"<{node.tag}> {attribute}={shown(text)} is implausibly large")
    return result


def _vector(node: Node | None, attribute: str) -> tree.Vector:
    if node is None or node.get(attribute) is None:
        return xml.ZERO3
    x, y, z = _numbers(node, attribute, 3)
    return (x, y, z)


def _colour(node: Node) -> Colour:
    red, green, blue, opacity = _numbers(node, "rgba", 4)
    if min(red, green, blue, opacity) < 0 or max(red, green, blue, opacity) > 1:
        raise _Bad(f"rgba={shown(node.get('rgba') or '')} must lie between 0 and 1")
    return (red, green, blue, opacity)
