"""Elements and attributes that a URDF may contain, and how often."""

from __future__ import annotations

from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.findings import Findings
from precision_pin.robot.urdf.xmltree import Node

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
