"""Check that links and joints make one tree."""

from __future__ import annotations

from collections.abc import Sequence

from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.data import Joint, Limits, Link
from precision_pin.robot.urdf.findings import Findings, hint
from precision_pin.robot.urdf.robot import Robot
from precision_pin.robot.urdf.units import LONGEST_REACH

MOST_NAMED = 8


def without_twins(
    links: Sequence[Link], joints: Sequence[Joint], findings: Findings
) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Return links and joints with the first of each name; add ``E_DUP_LINK``, ``E_DUP_JOINT``."""
    kept_links: dict[str, Link] = {}
    for link in links:
        if kept_links.setdefault(link.name, link) is not link:
            first = kept_links[link.name].line
            message = f"link {shown(link.name)} occurs twice (first in line {first}); names must be unique"
            findings.error("E_DUP_LINK", message, link.line)
    kept_joints: dict[str, Joint] = {}
    for joint in joints:
        if kept_joints.setdefault(joint.name, joint) is not joint:
            first = kept_joints[joint.name].line
            message = f"joint {shown(joint.name)} occurs twice (first in line {first}); names must be unique"
            findings.error("E_DUP_JOINT", message, joint.line)
    return tuple(kept_links.values()), tuple(kept_joints.values())


def check_tree(links: Sequence[Link], joints: Sequence[Joint], findings: Findings) -> bool:
    """Return whether the joints make one tree of the links.

    Adds ``E_UNKNOWN_LINK``, ``E_LOOP``, ``E_NO_ROOT``, ``E_TWO_ROOTS``.
    """
    by_name = {link.name: link for link in links}
    parents: dict[str, Joint] = {}
    sound = True
    for joint in joints:
        owner = f"joint {shown(joint.name)}"
        for end, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in by_name:
                message = f"{owner}: {end} link {shown(name)} does not exist{hint(name, by_name)}"
                findings.error("E_UNKNOWN_LINK", message, joint.line)
                sound = False
        if joint.parent == joint.child:
            message = f"{owner} joins link {shown(joint.child)} to itself; two links are needed"
            findings.error("E_LOOP", message, joint.line)
            sound = False
        elif joint.child in parents:
            other = parents[joint.child].name
            message = (
                f"link {shown(joint.child)} is the child of {owner} and of joint {shown(other)}; "
                "each link has one parent at most (closed loops are not supported)"
            )
            findings.error("E_LOOP", message, joint.line)
            sound = False
        else:
            parents[joint.child] = joint
    return sound and _check_roots(links, parents, findings)


def _check_roots(links: Sequence[Link], parents: dict[str, Joint], findings: Findings) -> bool:
    roots = [link for link in links if link.name not in parents]
    circles = _circles(links, parents)
    if not roots:
        message = f"no root: every link is some joint's child; a circle runs through {_list_names(circles[0])}"
        findings.error("E_NO_ROOT", message, links[0].line)
        return False
    if len(roots) > 1:
        names = [link.name for link in roots]
        message = f"{len(roots)} links have no parent: {_list_names(names)}; one root is needed"
        findings.error("E_TWO_ROOTS", message, roots[1].line)
    for circle in circles:
        message = f"links {_list_names(circle)} form a circle that is not connected to the root"
        findings.error("E_LOOP", message, parents[circle[0]].line)
    return len(roots) == 1 and not circles


def _circles(links: Sequence[Link], parents: dict[str, Joint]) -> list[list[str]]:
    done: set[str] = set()
    circles = []
    for link in links:
        way: dict[str, None] = {}
        at: str | None = link.name
        while at is not None and at not in done and at not in way:
            way[at] = None
            joint = parents.get(at)
            at = None if joint is None else joint.parent
        if at is not None and at in way:
            names = list(way)
            circles.append(sorted(names[names.index(at) :]))
        done.update(way)
    return circles


def check_size(robot: Robot, line: int, limits: Limits, findings: Findings) -> None:
    """Check a sound tree: ``E_NO_DOF``, ``E_TOO_BIG``, ``W_BRANCHED``, and its reach (``W_UNITS``).

    ``line`` is the line of the robot element.
    """
    moving = len(robot.moving_joints)
    if moving == 0:
        findings.error("E_NO_DOF", "no joint moves; an arm needs one that is not fixed", line)
    if moving > limits.moving_joints:
        message = f"{moving} moving joints; up to {limits.moving_joints} are allowed (the limits can be raised)"
        findings.error("E_TOO_BIG", message, line)
    depth = {robot.root: 1}
    reach = {robot.root: 0.0}
    longest: dict[str, Joint] = {}
    for joint in robot.joints_from_root:
        depth[joint.child] = depth[joint.parent] + 1
        length = _length(joint)
        reach[joint.child] = reach[joint.parent] + length
        above = longest.get(joint.parent)
        longest[joint.child] = joint if above is None or length > _length(above) else above
    if max(depth.values()) > limits.links_in_depth:
        message = (
            f"{max(depth.values())} links from root to tip; up to {limits.links_in_depth} are allowed "
            "(the limits can be raised)"
        )
        findings.error("E_TOO_BIG", message, line)
    farthest = max(reach, key=lambda name: reach[name])
    # a single origin beyond the reach already has its own warning
    if reach[farthest] > LONGEST_REACH and all(_length(joint) <= LONGEST_REACH for joint in robot.joints):
        joint = longest[farthest]
        message = (
            f"the path from the root to {shown(farthest)} is {reach[farthest]:.4g} m long, "
            f"most of it ({_length(joint):.4g} m) in joint {shown(joint.name)}; are these millimetres?"
        )
        findings.warning("W_UNITS", message, joint.line)
    if len(robot.leaves) > 1:
        message = f"the robot has {len(robot.leaves)} tips: {_list_names(robot.leaves)}; name the one you mean"
        findings.warning("W_BRANCHED", message, robot.link(robot.root).line)


def _length(joint: Joint) -> float:
    x, y, z = joint.xyz
    return float((x * x + y * y + z * z) ** 0.5)


def _list_names(names: Sequence[str]) -> str:
    more = f", … ({len(names)} in all)" if len(names) > MOST_NAMED else ""
    return ", ".join(shown(name) for name in names[:MOST_NAMED]) + more
