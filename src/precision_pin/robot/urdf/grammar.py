"""Elements and attributes that a URDF may contain, and how often."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.findings import Findings
from precision_pin.robot.urdf.robot import Vector
from precision_pin.robot.urdf.xmltree import Node

ZERO3 = (0.0, 0.0, 0.0)
PLAIN = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
NOT_FINITE = re.compile(r"[+-]?(?:nan(?:\([0-9a-z_]*\))?|inf(?:inity)?|1\.#(?:inf|ind|qnan).*)", re.IGNORECASE)
BLANKS = re.compile(r"[ \t\r\n]+")


@dataclass(frozen=True)
class BadNumbers:
    """Reason that a text is not numbers, with its code (``E_NUMBER`` or ``E_NOT_FINITE``)."""

    code: str
    reason: str


def parse_numbers(text: str, count: int, *, infinite: bool = False) -> tuple[float, ...] | BadNumbers:
    """Return ``count`` numbers, or the reason that the text is something else.

    Parameters
    ----------
    text
        Decimals such as ``-1``, ``.5``, ``+2.5e-3`` with blanks, tabs or newlines between and around.
    count
        Number of numbers expected.
    infinite
        True to accept ``inf`` and ``-inf``. An overflow such as ``1e400`` is never accepted.
    """
    words = BLANKS.split(text.strip(" \t\r\n"))
    if words == [""]:
        return BadNumbers("E_NUMBER", f"is empty; {_describe_count(count)}")
    values = []
    for word in words:
        if PLAIN.fullmatch(word):
            value = float(word)
            if math.isinf(value):
                return BadNumbers("E_NOT_FINITE", f"holds {shown(word)}, which overflows; {_describe_count(count)}")
        elif NOT_FINITE.fullmatch(word):
            if not infinite or "inf" not in word.lower() or "#" in word:
                return BadNumbers("E_NOT_FINITE", f"holds {shown(word)}, which is not finite; {_describe_count(count)}")
            value = float(word)
        else:
            comma = " with a decimal point, and blanks (no commas) between them" if "," in word else ""
            return BadNumbers("E_NUMBER", f"holds {shown(word)}, not a plain number; {_describe_count(count)}{comma}")
        values.append(value)
    if len(values) != count:
        return BadNumbers("E_NUMBER", f"holds {len(values)} numbers; {_describe_count(count)}")
    return tuple(values)


def _describe_count(count: int) -> str:
    return "one finite decimal number is needed" if count == 1 else f"{count} finite decimal numbers are needed"


def read_numbers(
    node: Node, attribute: str, count: int, owner: str, findings: Findings, *, infinite: bool = False
) -> tuple[float, ...] | None:
    """Return an attribute's numbers, or add an error naming its owner and return None.

    A missing attribute is an error like an empty one; for an optional attribute check before that it is there.
    """
    text = node.get(attribute)
    if text is None:
        findings.error("E_NUMBER", f"{owner}: <{node.tag}> has no {attribute}; {_describe_count(count)}", node.line)
        return None
    result = parse_numbers(text, count, infinite=infinite)
    if isinstance(result, BadNumbers):
        message = f"{owner}: <{node.tag}> {attribute}={shown(text)} {result.reason}"
        findings.error(result.code, message, node.line)
        return None
    if node.has_breaks or is_misread(text, count):
        message = (
            "white space after a number, or other than blanks between numbers, is accepted here, but urdfdom "
            "(ROS, Gazebo, Pinocchio) drops the inertial or refuses the file; delete it"
        )
        findings.grouped_warning("W_NUMBER_BLANKS", message, f"{owner}: <{node.tag}> {attribute}", node.line)
    return result


def is_misread(text: str, count: int) -> bool:
    """Return whether urdfdom fails on valid numbers, since it splits them at blanks only."""
    pieces = [text] if count == 1 else text.split(" ")
    return any(piece[-1].isspace() or len(piece.split()) > 1 for piece in pieces if piece)


def read_vector(node: Node | None, attribute: str, owner: str, findings: Findings) -> tuple[float, float, float]:
    """Return three numbers, zeros if the element or attribute is missing or wrong."""
    if node is None or node.get(attribute) is None:
        return ZERO3
    values = read_numbers(node, attribute, 3, owner, findings)
    return ZERO3 if values is None else (values[0], values[1], values[2])


LONGEST_REACH = 20.0
BEYOND_USE = 1e6
# a full turn written with four digits is still a full turn
WIDEST_ANGLE = 2 * math.pi * (1 + 1e-4)


def check_length(vector: Vector, what: str, line: int, findings: Findings) -> None:
    """Refuse a vector beyond 1000 km (``E_UNITS``), warn beyond 20 m (``W_UNITS``)."""
    largest = max(vector, key=abs)
    if abs(largest) > BEYOND_USE:
        message = f"{what} contains {largest:g} m, which is implausibly large; lengths are in metres"
        findings.error("E_UNITS", message, line)
    elif math.hypot(*vector) > LONGEST_REACH:
        message = f"{what} holds {largest:g} m; are these millimetres? lengths are in metres"
        findings.warning("W_UNITS", message, line)


def check_angle(rpy: Vector, what: str, line: int, findings: Findings) -> None:
    """Refuse angles beyond 1e6 rad (``E_UNITS``), warn beyond a full turn (``W_UNITS``)."""
    largest = max(rpy, key=abs)
    if abs(largest) > BEYOND_USE:
        findings.error(
            "E_UNITS", f"{what} contains {largest:g} rad, which is implausibly large; angles are in radians", line
        )
    elif abs(largest) > WIDEST_ANGLE:
        message = f"{what} holds {largest:g} rad, over a full turn; are these degrees? angles are in radians"
        findings.warning("W_UNITS", message, line)


# parent → (children allowed once, children allowed often)
CHILDREN: dict[str, tuple[frozenset[str], frozenset[str]]] = {
    "robot": (
        frozenset(),
        frozenset({"link", "joint", "material", "gazebo", "transmission", "ros2_control", "sensor"}),
    ),
    "link": (frozenset({"inertial"}), frozenset({"visual", "collision"})),
    "inertial": (frozenset({"origin", "mass", "inertia"}), frozenset()),
    "joint": (
        frozenset(
            {"origin", "parent", "child", "axis", "limit", "mimic", "dynamics", "calibration", "safety_controller"}
        ),
        frozenset(),
    ),
}
# only elements whose numbers or names are used: in others an unknown attribute changes nothing
ATTRIBUTES: dict[str, frozenset[str]] = {
    "robot": frozenset({"name", "version"}),
    "link": frozenset({"name", "type"}),
    "joint": frozenset({"name", "type"}),
    "origin": frozenset({"xyz", "rpy", "quat_xyzw"}),
    "mass": frozenset({"value"}),
    "inertia": frozenset({"ixx", "ixy", "ixz", "iyy", "iyz", "izz"}),
    "parent": frozenset({"link"}),
    "child": frozenset({"link"}),
    "axis": frozenset({"xyz"}),
    "limit": frozenset({"lower", "upper", "effort", "velocity"}),
    "mimic": frozenset({"joint", "multiplier", "offset"}),
}


def check_children(node: Node, owner: str, findings: Findings) -> None:
    """Refuse a second element where only one is allowed (``E_DUP_ELEMENT``); warn of unknown ones."""
    once, often = CHILDREN[node.tag]
    seen: set[str] = set()
    for child in node.children:
        if child.tag in once:
            if child.tag in seen:
                message = f"{owner}: <{child.tag}> occurs more than once in <{node.tag}>; keep one"
                findings.error("E_DUP_ELEMENT", message, child.line)
            seen.add(child.tag)
            check_attributes(child, owner, findings)
        elif child.tag not in often:
            valid = ", ".join(sorted(once | often))
            message = f"unknown element <{child.tag[:40]}> in <{node.tag}> is ignored; valid: {valid}"
            findings.grouped_warning("W_UNKNOWN_ELEMENT", message, owner, child.line)


def check_attributes(node: Node, owner: str, findings: Findings) -> None:
    """Warn of unknown attributes; refuse quaternions, which would otherwise be lost."""
    valid = ATTRIBUTES.get(node.tag)
    if valid is None:
        return
    for name in node.attributes:
        if name == "quat_xyzw":
            message = f"{owner}: quat_xyzw (URDF 1.1) is not read; write the rotation as rpy"
            findings.error("E_VERSION", message, node.line)
        elif name not in valid and ":" not in name:
            message = f"unknown attribute {shown(name)} of <{node.tag}> is ignored; valid: {', '.join(sorted(valid))}"
            findings.grouped_warning("W_UNKNOWN_ATTRIBUTE", message, owner, node.line)


def read_name(node: Node, findings: Findings) -> str | None:
    """Return the name of a robot, link or joint, or add an error and return None."""
    name = node.get("name")
    if name is None:
        findings.error("E_NO_NAME", f"this <{node.tag}> has no name", node.line)
        return None
    if not name.strip():
        findings.error("E_EMPTY_NAME", f"the name of this <{node.tag}> is empty", node.line)
        return None
    return name
