"""Reader of ``<joint>`` elements."""

from __future__ import annotations

import math
from typing import cast

from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.data import Joint, JointKind, Limit, Mimic, Vector
from precision_pin.robot.urdf.elements import check_attributes, check_children, read_name
from precision_pin.robot.urdf.findings import Findings, hint
from precision_pin.robot.urdf.numbers import BadNumbers, is_misread, parse_numbers, read_numbers, read_vector
from precision_pin.robot.urdf.units import check_angle, check_length
from precision_pin.robot.urdf.xmltree import Node

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
