"""Checks of a whole URDF: names, mimics, angles, the tree, inertias, size."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Final, Literal, TypeVar

import numpy as np

from precision_pin.base.arrays import Array
from precision_pin.base.errors import shown
from precision_pin.robot.urdf.robot import PARTS, Joint, Limits, Link, Robot, draft_command, likeliest_tip
from precision_pin.robot.urdf.xmltree import LONGEST_REACH, Findings, hint

Named = TypeVar("Named", Link, Joint)

MOST_NAMED: Final = 8
PLAIN_MARKS: Final = frozenset("_-.:")
# letters of other scripts that look like Latin ones, after case folding
LOOK_ALIKE: Final = str.maketrans(
    "авекмнорстухіјѕԁԛԝһӏαβεικνορτυχγ",
    "abekmhopctyxijsdqwhlabeikvoptuxy",
)
EIGHTH: Final = math.pi / 4
# 1.570796 (0.33 µrad off) is good enough for a thousandth of a millimetre at 2 m, 1.5708 (3.7 µrad) is not
GOOD_ENOUGH: Final = 1e-6
Verdict = Literal["physical", "point", "negative", "triangle"]

# inertias often have three digits; those of a plate then violate ixx + iyy = izz by as much
ROUNDING = 1e-3
# radius of gyration of one micrometre: export programs write such inertias for zeros
POINT_RADIUS = 1e-6
WHAT = {
    "negative": ("E_INERTIA_PD", "one is negative; all must be zero or more"),
    "triangle": ("E_INERTIA_TRIANGLE", "no mass distribution has one larger than the sum of the others"),
}
INERTIAS: Final = frozenset(code for code, _ in WHAT.values())


def check_names(links: Sequence[Link], joints: Sequence[Joint], findings: Findings) -> None:
    """Check for names that a person, a sheet, a browser or a spreadsheet would misread."""
    for kind, things in (("link", links), ("joint", joints)):
        looks: dict[str, str] = {}
        for thing in things:
            name, named = thing.name, f"the {kind} name {shown(thing.name)}"
            if name == "universe":
                findings.add("E_RESERVED_NAME", f"{named} is reserved for the world; choose another name", thing.line)
            if (odd := _find_odd_character(name)) is not None:
                message = f"{named} holds {odd}; letters, digits and _ - . : are safe everywhere"
                findings.add("W_NAME_CHARS", message, thing.line)
            twin = looks.setdefault(_skeleton(name), name)
            if twin != name:
                message = f"the {kind} names {shown(twin)} and {shown(name)} are easily confused"
                findings.add("W_NAME_CONFUSABLE", message, thing.line)
    joint_names = {joint.name for joint in joints}
    for link in links:
        if link.name in joint_names:
            findings.add("W_NAME_SHARED", f"a link and a joint share the name {shown(link.name)}", link.line)


def _find_odd_character(name: str) -> str | None:
    """Return a phrase for an unusual character of a name, None if there is none."""
    if name[0] in "-.:":
        return f"a leading {name[0]!r}"
    for character in name:
        if unicodedata.category(character)[0] not in "LMN" and character not in PLAIN_MARKS:
            return "a blank" if character == " " else f"the character {character!r}"
    return None


def _skeleton(name: str) -> str:
    """Return a name as seen at a glance: without case, width, script and invisible characters."""
    folded = unicodedata.normalize("NFKC", name).casefold().translate(LOOK_ALIKE)
    return "".join(character for character in folded if unicodedata.category(character)[0] not in "CZ")


def find_exact_angle(angle: float) -> float | None:
    """Return the multiple of 45° that an angle is rounded from, None if it is not rounded."""
    # A right angle counts as rounded if it is off by up to 2 mrad and has up to five decimals, since more look
    # measured. An odd multiple of 45° must be truncated or rounded at its last decimal.
    if abs(angle) > 4 * math.pi:
        return None
    turns = round(angle / EIGHTH)
    exact = turns * EIGHTH
    slip = abs(angle - exact)
    if turns == 0 or not GOOD_ENOUGH < slip <= 2e-3:
        return None
    exponent = Decimal(repr(angle)).as_tuple().exponent
    assert isinstance(exponent, int)
    return None if exponent < -5 or (turns % 2 and slip > 10.0**exponent) else exact


def snapped(robot: Robot) -> Robot:
    """Return the robot with rounded right angles of joint origins made exact, without ``W_ANGLE_ROUNDED``."""
    joints = []
    for joint in robot.joints:
        roll, pitch, yaw = (angle if (exact := find_exact_angle(angle)) is None else exact for angle in joint.rpy)
        joints.append(replace(joint, rpy=(roll, pitch, yaw)))
    findings = tuple(finding for finding in robot.findings if finding.code != "W_ANGLE_ROUNDED")
    return replace(robot, joints=tuple(joints), findings=findings)


def check_joints(joints: Sequence[Joint], findings: Findings) -> None:
    """Refuse meaningless mimics (``E_MIMIC``); warn of rounded right angles in origins (``W_ANGLE_ROUNDED``)."""
    by_name = {joint.name: joint for joint in joints}
    followers = {joint: joint.mimic.joint for joint in joints if joint.mimic is not None}
    for joint, target in followers.items():
        if target not in by_name or not by_name[target].moves:
            why = "is fixed and has no value; a moving joint is needed"
            why = why if target in by_name else f"does not exist{hint(target, by_name)}"
            findings.add("E_MIMIC", f"joint {shown(joint.name)} mimics {shown(target)}, which {why}", joint.line)

    def followed_by(name: str) -> str | None:
        target = followers.get(by_name[name])
        return target if target in by_name else None

    for circle in _find_circles(by_name, followed_by):
        names = " → ".join(shown(name) for name in [*circle[:MOST_NAMED], circle[0]])
        findings.add("E_MIMIC", f"joints mimic each other in a circle: {names}", by_name[circle[0]].line)
    for joint in joints:
        for name, angle in zip(("roll", "pitch", "yaw"), joint.rpy, strict=True):
            if (exact := find_exact_angle(angle)) is not None:
                message = (
                    f"joint {shown(joint.name)}: {name} {angle!r} is {abs(angle - exact):.1e} rad off "
                    f"{round(math.degrees(exact))}°; write {exact!r} if that is intended (snapping does it)"
                )
                findings.add("W_ANGLE_ROUNDED", message, joint.line)


def without_twins(things: Sequence[Named | None], kind: str, code: str, findings: Findings) -> tuple[Named, ...]:
    """Return the first link or joint of each name; add ``E_DUP_LINK`` or ``E_DUP_JOINT`` for others."""
    by_name: dict[str, Named] = {}
    for thing in things:
        if thing is None:
            continue
        first = by_name.setdefault(thing.name, thing)
        if first is not thing:
            message = f"{kind} {shown(thing.name)} occurs twice (first in line {first.line}); names must be unique"
            findings.add(code, message, thing.line)
    return tuple(by_name.values())


def check_tree(links: Sequence[Link], joints: Sequence[Joint], findings: Findings) -> bool:
    """Return whether the joints make one tree of the links; else add findings."""
    by_name = {link.name for link in links}
    parents: dict[str, Joint] = {}
    before = findings.errors
    for joint in joints:
        owner = f"joint {shown(joint.name)}"
        for end, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in by_name:
                message = f"{owner}: {end} link {shown(name)} does not exist{hint(name, by_name)}"
                findings.add("E_UNKNOWN_LINK", message, joint.line)
        if joint.parent == joint.child:
            message = f"{owner} joins link {shown(joint.child)} to itself; two links are needed"
            findings.add("E_LOOP", message, joint.line)
        elif joint.child in parents:
            both = f"link {shown(joint.child)} is the child of {owner} and of joint {shown(parents[joint.child].name)}"
            message = f"{both}; each link has one parent at most (closed loops are not supported)"
            findings.add("E_LOOP", message, joint.line)
        else:
            parents[joint.child] = joint
    return findings.errors == before and _check_roots(links, parents, findings)


def _check_roots(links: Sequence[Link], parents: dict[str, Joint], findings: Findings) -> bool:
    roots = [link for link in links if link.name not in parents]

    def parent_of(name: str) -> str | None:
        return parents[name].parent if name in parents else None

    circles = [sorted(circle) for circle in _find_circles((link.name for link in links), parent_of)]
    if not roots:
        message = f"no root: every link is some joint's child; a circle runs through {_list_names(circles[0])}"
        findings.add("E_NO_ROOT", message, links[0].line)
        return False
    if len(roots) > 1:
        listed = _list_names([link.name for link in roots])
        findings.add("E_TWO_ROOTS", f"{len(roots)} links have no parent: {listed}; one root is needed", roots[1].line)
    for circle in circles:
        message = f"links {_list_names(circle)} form a circle that is not connected to the root"
        findings.add("E_LOOP", message, parents[circle[0]].line)
    return len(roots) == 1 and not circles


def _find_circles(starts: Iterable[str], follow: Callable[[str], str | None]) -> list[list[str]]:
    done: set[str] = set()
    circles = []
    for start in starts:
        way: dict[str, None] = {}
        at: str | None = start
        while at is not None and at not in done and at not in way:
            way[at] = None
            at = follow(at)
        if at is not None and at in way:
            names = list(way)
            circles.append(names[names.index(at) :])
        done.update(way)
    return circles


def check_size(robot: Robot, line: int, limits: Limits, findings: Findings) -> None:
    """Check a sound tree and its reach: ``E_NO_DOF``, ``E_TOO_BIG``, ``W_BRANCHED``, ``W_UNITS``."""
    moving = len(robot.moving_joints)
    if moving == 0:
        findings.add("E_NO_DOF", "no joint moves; an arm needs one that is not fixed", line)
    depth, reach = {robot.root: 1}, {robot.root: 0.0}
    longest: dict[str, Joint] = {}
    for joint in robot.joints_from_root:
        depth[joint.child] = depth[joint.parent] + 1
        length = _length(joint)
        reach[joint.child] = reach[joint.parent] + length
        above = longest.get(joint.parent)
        longest[joint.child] = joint if above is None or length > _length(above) else above
    for count, of, most in (
        (moving, "moving joints", limits.moving_joints),
        (max(depth.values()), "links from root to tip", limits.links_in_depth),
    ):
        if count > most:
            message = f"{count} {of}; up to {most} are allowed (the limits can be raised)"
            findings.add("E_TOO_BIG", message, line)
    farthest = max(reach, key=lambda name: reach[name])
    # a single origin beyond the reach already has its own warning
    if reach[farthest] > LONGEST_REACH and all(_length(joint) <= LONGEST_REACH for joint in robot.joints):
        joint = longest[farthest]
        message = (
            f"the path from the root to {shown(farthest)} is {reach[farthest]:.4g} m long, "
            f"most of it ({_length(joint):.4g} m) in joint {shown(joint.name)}; are these millimetres?"
        )
        findings.add("W_UNITS", message, joint.line)
    if len(robot.leaves) > 1:
        message = (
            f"the robot has {len(robot.leaves)} tips: {_list_names(robot.leaves)}; name the one you mean, likely "
            f"{draft_command(robot.file, likeliest_tip(robot))}"
        )
        findings.add("W_BRANCHED", message, robot.link(robot.root).line)


def _length(joint: Joint) -> float:
    x, y, z = joint.xyz
    return float((x * x + y * y + z * z) ** 0.5)


def _list_names(names: Sequence[str]) -> str:
    more = f", … ({len(names)} in all)" if len(names) > MOST_NAMED else ""
    return ", ".join(shown(name) for name in names[:MOST_NAMED]) + more


def check_inertias(links: tuple[Link, ...], robot: Robot | None, findings: Findings) -> None:
    """Refuse unphysical inertias (``E_INERTIA_PD``, ``E_INERTIA_TRIANGLE``).

    Links that fixed joints join to a physical body only get a warning (``W_INERTIA``), because only the body's inertia
    has an effect. A link with mass and no inertia is a point mass (``W_INERTIA_ZERO``); one zero principal moment (a
    slender rod) is allowed. ``robot`` is None if there is no tree.
    """
    bodies = {} if robot is None else _bodies(robot)
    for link in links:
        inertial = link.inertial
        if inertial is None:
            continue
        moments = _moments(inertial.tensor)
        verdict = _verdict(moments, inertial.mass)
        owner = f"link {shown(link.name)}"
        if verdict == "point" and inertial.mass > 0:
            message = f"{owner}: the inertia is zero; its {inertial.mass:g} kg are treated as a point mass"
            findings.add("W_INERTIA_ZERO", message, link.line)
        if verdict not in WHAT:
            continue
        code, why = WHAT[verdict]
        listed = ", ".join(f"{moment:.4g}" for moment in moments)
        message = f"{owner}: principal moments of inertia {listed} kg·m²: {why}"
        body = bodies.get(link.name)
        remedy = "no analysis uses it: precision-pin init --mend-inertia writes a copy with one that a body can have"
        if body is not None and body.links > 1 and _is_physical(body):
            code, remedy = (
                "W_INERTIA",
                f"accepted, because the rigid body of {body.links} links that it belongs to is physical",
            )
        findings.add(code, f"{message}; {remedy}", link.line)


def mended_inertias(links: tuple[Link, ...]) -> dict[str, dict[str, float]]:
    """Return the parts of the nearest physical inertia, by name of each link with an unphysical one."""
    # negative second moments of its mass, tr(I)/2 - I, become zero; mass and centre of mass stay
    inertias = {}
    for link in links:
        if link.inertial is not None and _verdict(_moments(link.inertial.tensor), link.inertial.mass) in WHAT:
            ixx, ixy, ixz, iyy, iyz, izz = link.inertial.inertia
            tensor = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
            seconds, axes = np.linalg.eigh(np.eye(3) * np.trace(tensor) / 2 - tensor)
            second_moments = (axes * np.maximum(seconds, 0.0)) @ axes.T
            parts = (np.eye(3) * np.trace(second_moments) - second_moments)[np.triu_indices(3)]
            inertias[link.name] = dict(zip(PARTS, map(float, parts), strict=True))
    return inertias


def _verdict(moments: Array, mass: float) -> Verdict:
    if np.abs(moments).max() <= abs(mass) * POINT_RADIUS**2:
        return "point"
    if moments[0] < -ROUNDING * moments[2]:
        return "negative"
    if moments[2] > (moments[0] + moments[1]) + ROUNDING * moments[2]:
        return "triangle"
    return "physical"


def _is_physical(body: _Body) -> bool:
    # sums of huge numbers may have overflowed
    return bool(np.isfinite(body.tensor).all()) and _verdict(_moments(body.tensor), body.mass) not in WHAT


def _moments(tensor: Array) -> Array:
    """Return the principal moments in rising order."""
    return np.asarray(np.linalg.eigvalsh(tensor), dtype=np.float64)


@dataclass(frozen=True)
class _Body:
    """Links joined by fixed joints: their number, mass, and inertia about its centre in the topmost link's axes."""

    links: int
    mass: float
    tensor: Array


def _bodies(robot: Robot) -> dict[str, _Body]:
    top: dict[str, str] = {robot.root: robot.root}
    poses: dict[str, Array] = {robot.root: np.eye(4)}
    for joint in robot.joints_from_root:
        if joint.moves:
            top[joint.child], poses[joint.child] = joint.child, np.eye(4)
        else:
            top[joint.child] = top[joint.parent]
            poses[joint.child] = poses[joint.parent] @ joint.origin
    held: dict[str, list[Link]] = {}
    for link in robot.links:
        held.setdefault(top[link.name], []).append(link)
    bodies = {name: _join(links, poses) for name, links in held.items()}
    return {name: bodies[at] for name, at in top.items()}


def _join(links: Sequence[Link], poses: Mapping[str, Array]) -> _Body:
    """Return links as one body (parallel-axis theorem)."""
    heavy = [(link.inertial, poses[link.name]) for link in links if link.inertial is not None]
    mass = sum(inertial.mass for inertial, _ in heavy)
    tensor = np.zeros((3, 3))
    with np.errstate(over="ignore", invalid="ignore"):
        centres = [pose[:3, :3] @ np.array(inertial.com) + pose[:3, 3] for inertial, pose in heavy]
        weighed = zip(heavy, centres, strict=True)
        middle = sum((inertial.mass / (mass or 1.0) * centre for (inertial, _), centre in weighed), np.zeros(3))
        for (inertial, pose), centre in zip(heavy, centres, strict=True):
            apart, turn = centre - middle, pose[:3, :3]
            tensor += turn @ inertial.tensor @ turn.T
            tensor += inertial.mass * (apart @ apart * np.eye(3) - np.outer(apart, apart))
    return _Body(len(links), mass, tensor)
