"""Grammar of URDF: a table of elements and attributes, and the reader of numbers and names that follows it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, final

from precision_pin.base.errors import shown
from precision_pin.robot.urdf.robot import Vector
from precision_pin.robot.urdf.xmltree import Findings, Node

ZERO3: Final = (0.0, 0.0, 0.0)
LONGEST_REACH: Final = 20.0
BEYOND_USE: Final = 1e6
# a full turn written with four digits is still a full turn
WIDEST_ANGLE: Final = 2 * math.pi * (1 + 1e-4)
PLAIN: Final = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
NOT_FINITE: Final = re.compile(r"[+-]?(?:nan(?:\([0-9a-z_]*\))?|inf(?:inity)?|1\.#(?:inf|ind|qnan).*)", re.IGNORECASE)
BLANKS: Final = re.compile(r"[ \t\r\n]+")


@final
@dataclass(frozen=True)
class Form:
    """Form of an attribute: how many numbers, 0 for text; whether it is required, and may be infinite."""

    count: int = 1
    required: bool = False
    infinite: bool = False


@final
@dataclass(frozen=True)
class Element:
    """Possible contents of an element.

    ``is_closed`` elements are those whose numbers or names are used; unknown attributes of others change nothing.
    ``missing`` is the finding for a missing required element, after its owner's name.
    """

    attributes: Mapping[str, Form]
    once: frozenset[str] = frozenset()
    often: frozenset[str] = frozenset()
    is_closed: bool = True
    missing: tuple[str, str] = ("", "")


TEXT: Final = Form(0)
ONE: Final = Form(1)
VECTOR: Final = Form(3)
PARTS: Final = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
BOUNDS: Final = ("lower", "upper", "effort", "velocity")
ONCE_IN_JOINT: Final = (
    "origin", "parent", "child", "axis", "limit", "mimic", "dynamics", "calibration", "safety_controller",
)  # fmt: skip
OFTEN_IN_ROBOT: Final = ("link", "joint", "material", "gazebo", "transmission", "ros2_control", "sensor")
GRAMMAR: Final[Mapping[str, Element]] = {
    "robot": Element({"name": TEXT, "version": TEXT}, often=frozenset(OFTEN_IN_ROBOT)),
    "link": Element({"name": TEXT, "type": TEXT}, frozenset({"inertial"}), frozenset({"visual", "collision"})),
    "joint": Element({"name": TEXT, "type": TEXT}, frozenset(ONCE_IN_JOINT)),
    "inertial": Element({}, frozenset({"origin", "mass", "inertia"}), is_closed=False),
    "origin": Element({"xyz": VECTOR, "rpy": VECTOR, "quat_xyzw": TEXT}),
    "mass": Element({"value": Form(required=True)}, missing=("E_INERTIAL", ': <inertial> has no <mass value="…"/>')),
    "inertia": Element(
        dict.fromkeys(PARTS, Form(required=True)),
        missing=("E_INERTIAL", f": <inertial> has no <inertia>; {', '.join(PARTS)} are needed"),
    ),
    "parent": Element({"link": TEXT}, missing=("E_NO_PARENT", ' has no parent link; <parent link="…"/> is needed')),
    "child": Element({"link": TEXT}, missing=("E_NO_CHILD", ' has no child link; <child link="…"/> is needed')),
    "axis": Element({"xyz": VECTOR}, missing=("W_AXIS_DEFAULT", " has no axis; the default 1 0 0 is used")),
    "limit": Element(
        dict.fromkeys(BOUNDS, Form(infinite=True)),
        missing=("E_LIMITS", " and has no limit; lower, upper, effort and velocity are needed"),
    ),
    "mimic": Element({"joint": TEXT, "multiplier": ONE, "offset": ONE}),
    "dynamics": Element({"damping": ONE, "friction": ONE}, is_closed=False),
    "box": Element({"size": VECTOR}, is_closed=False),
    "cylinder": Element({"radius": ONE, "length": ONE}, is_closed=False),
    "sphere": Element({"radius": ONE}, is_closed=False),
}


@final
@dataclass(frozen=True)
class Owner:
    """The robot, link or joint whose elements are read; its name starts each finding."""

    name: str
    findings: Findings

    def say(self, code: str, text: str, line: int) -> None:
        """Add a finding; the text continues the name."""
        self.findings.add(code, self.name + text, line)

    def child(self, node: Node, tag: str) -> Node | None:
        """Return the first child with a tag, or add the table's finding."""
        element = node.first(tag)
        if element is None:
            self.say(*GRAMMAR[tag].missing, node.line)
        return element

    def numbers(self, element: Node) -> dict[str, tuple[float, ...] | None]:
        """Return the numbers of an element by attribute, as `read` does."""
        return {name: self.read(element, name) for name, form in GRAMMAR[element.tag].attributes.items() if form.count}

    def read(self, node: Node, attribute: str) -> tuple[float, ...] | None:
        """Return the numbers of one attribute; None if wrong, or absent and not required."""
        form, text = GRAMMAR[node.tag].attributes[attribute], node.get(attribute)
        if text is None:
            if form.required:
                self.say("E_NUMBER", f": <{node.tag}> has no {attribute}; {_describe_count(form.count)}", node.line)
            return None
        result = parse_numbers(text, form.count, infinite=form.infinite)
        if isinstance(result, BadNumbers):
            self.say(result.code, f": <{node.tag}> {attribute}={shown(text)} {result.reason}", node.line)
            return None
        if node.has_breaks or is_misread(text, form.count):
            message = (
                "white space after a number, or other than blanks between numbers, is accepted here, but urdfdom "
                "(ROS, Gazebo, Pinocchio) drops the inertial or refuses the file; delete it"
            )
            self.findings.group("W_NUMBER_BLANKS", message, f"{self.name}: <{node.tag}> {attribute}", node.line)
        return result

    def placement(self, node: Node) -> tuple[Vector, Vector]:
        """Return position and angles of an element's origin, zeros if missing or wrong."""
        origin = node.first("origin")
        xyz, rpy = (None, None) if origin is None else map(as_vector, self.numbers(origin).values())
        return xyz or ZERO3, rpy or ZERO3

    def check_children(self, node: Node) -> None:
        """Refuse duplicates of single elements (``E_DUP_ELEMENT``); warn of unknown ones."""
        once, often = GRAMMAR[node.tag].once, GRAMMAR[node.tag].often
        seen: set[str] = set()
        for child in node.children:
            if child.tag in once:
                if child.tag in seen:
                    text = f": <{child.tag}> occurs more than once in <{node.tag}>; keep one"
                    self.say("E_DUP_ELEMENT", text, child.line)
                seen.add(child.tag)
                self.check_attributes(child)
            elif child.tag not in often:
                valid = ", ".join(sorted(once | often))
                message = f"unknown element <{child.tag[:40]}> in <{node.tag}> is ignored; valid: {valid}"
                self.findings.group("W_UNKNOWN_ELEMENT", message, self.name, child.line)

    def check_attributes(self, node: Node) -> None:
        """Warn of unknown attributes; refuse quaternions, which would otherwise be lost."""
        element = GRAMMAR.get(node.tag)
        if element is None or not element.is_closed:
            return
        for name in node.attributes:
            if name == "quat_xyzw":
                self.say("E_VERSION", ": quat_xyzw (URDF 1.1) is not read; write the rotation as rpy", node.line)
            elif name not in element.attributes and ":" not in name:
                valid = ", ".join(sorted(element.attributes))
                message = f"unknown attribute {shown(name)} of <{node.tag}> is ignored; valid: {valid}"
                self.findings.group("W_UNKNOWN_ATTRIBUTE", message, self.name, node.line)

    def check_placement(self, node: Node, xyz: Vector, rpy: Vector, position: str, angles: str) -> None:
        """Check position and angles of an element's origin, with their names for messages."""
        origin = node.first("origin")
        if origin is not None:
            self._check_units(xyz, position, origin.line, angles=False)
            self._check_units(rpy, angles, origin.line, angles=True)

    def _check_units(self, vector: Vector, what: str, line: int, *, angles: bool) -> None:
        """Refuse numbers beyond 1e6 (``E_UNITS``), warn of lengths over 20 m and angles over a turn (``W_UNITS``)."""
        largest = max(vector, key=abs)
        if angles:
            is_wide, unit, doubt = abs(largest) > WIDEST_ANGLE, "rad", ", over a full turn; are these degrees?"
        else:
            is_wide, unit, doubt = math.hypot(*vector) > LONGEST_REACH, "m", "; are these millimetres?"
        expected = "angles are in radians" if angles else "lengths are in metres"
        if abs(largest) > BEYOND_USE:
            text = f"{what} contains {largest:g} {unit}, which is implausibly large; {expected}"
            self.say("E_UNITS", text, line)
        elif is_wide:
            self.say("W_UNITS", f"{what} holds {largest:g} {unit}{doubt} {expected}", line)


def read_name(node: Node, findings: Findings) -> str | None:
    """Return the name of a robot, link or joint, or add an error and return None."""
    name = node.get("name")
    if name is None:
        findings.add("E_NO_NAME", f"this <{node.tag}> has no name", node.line)
    elif not name.strip():
        findings.add("E_EMPTY_NAME", f"the name of this <{node.tag}> is empty", node.line)
    return name if name and name.strip() else None


@final
@dataclass(frozen=True)
class BadNumbers:
    """Reason why a text is not numbers, with its code (``E_NUMBER`` or ``E_NOT_FINITE``)."""

    code: str
    reason: str


def parse_numbers(text: str, count: int, *, infinite: bool = False) -> tuple[float, ...] | BadNumbers:
    """Return ``count`` plain ASCII decimals, blanks between and around, or why the text is something else.

    ``infinite`` accepts ``inf`` and ``-inf``; an overflow such as ``1e400`` is never accepted.
    """
    words = BLANKS.split(text.strip(" \t\r\n"))
    needed = _describe_count(count)
    if words == [""]:
        return BadNumbers("E_NUMBER", f"is empty; {needed}")
    values = []
    for word in words:
        if PLAIN.fullmatch(word):
            value = float(word)
            if math.isinf(value):
                return BadNumbers("E_NOT_FINITE", f"holds {shown(word)}, which overflows; {needed}")
        elif NOT_FINITE.fullmatch(word):
            if not infinite or "inf" not in word.lower() or "#" in word:
                return BadNumbers("E_NOT_FINITE", f"holds {shown(word)}, which is not finite; {needed}")
            value = float(word)
        else:
            comma = " with a decimal point, and blanks (no commas) between them" if "," in word else ""
            return BadNumbers("E_NUMBER", f"holds {shown(word)}, not a plain number; {needed}{comma}")
        values.append(value)
    if len(values) != count:
        return BadNumbers("E_NUMBER", f"holds {len(values)} numbers; {needed}")
    return tuple(values)


def _describe_count(count: int) -> str:
    return "one finite decimal number is needed" if count == 1 else f"{count} finite decimal numbers are needed"


def is_misread(text: str, count: int) -> bool:
    """Return whether urdfdom, which splits only at blanks, fails on valid numbers."""
    pieces = [text] if count == 1 else text.split(" ")
    return any(piece[-1].isspace() or len(piece.split()) > 1 for piece in pieces if piece)


def as_vector(numbers: tuple[float, ...] | None) -> Vector | None:
    """Return three numbers as a vector."""
    return None if numbers is None else (numbers[0], numbers[1], numbers[2])
