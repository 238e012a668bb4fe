"""Reader of a URDF's text into a `Robot`, with all findings at once."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from precision_pin.base.errors import Finding, UrdfError
from precision_pin.base.text_escape import shown
from precision_pin.robot.urdf.angles import check_angles
from precision_pin.robot.urdf.data import Limits
from precision_pin.robot.urdf.elements import check_attributes, check_children, read_name
from precision_pin.robot.urdf.files import read_regular_file
from precision_pin.robot.urdf.findings import Findings
from precision_pin.robot.urdf.inertia import check_inertias
from precision_pin.robot.urdf.joints import check_mimics, read_joint
from precision_pin.robot.urdf.links import read_link
from precision_pin.robot.urdf.meshes import MeshFiles
from precision_pin.robot.urdf.names import check_names
from precision_pin.robot.urdf.robot import Robot
from precision_pin.robot.urdf.structure import check_size, check_tree, without_twins
from precision_pin.robot.urdf.visuals import Looks
from precision_pin.robot.urdf.xmltree import Node, parse_xml

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
