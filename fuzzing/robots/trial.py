"""One changed robot through the package, compared with a second reading and with urdfdom."""

from __future__ import annotations

import random
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from precision_pin.base.errors import Finding, InputError, UrdfError
from precision_pin.pages.view.arm import draw_arm
from precision_pin.render.scene import Scene
from precision_pin.robot.chain import Chain
from precision_pin.robot.urdf import Joint, Robot, check, parse, read
from precision_pin.robot.urdf.editing import Placement, UrdfText

from .second_reading import PlainReading
from .urdfdom import read_urdfdom

__all__ = ["Outcome", "try_robot"]

Array = NDArray[np.float64]

AGREEMENT = 1e-9
"""Largest difference between readings, relative to reach, mass, or their product."""
SLOWEST = 5.0
"""Seconds of the processor that one robot may take."""
LONGEST_LINE = 3000
"""Characters of a finding."""
EXPLAINED = (
    (r"limit has no (effort|velocity)", {"W_LIMITS"}),
    (r"(upper|lower|effort|(?<!_)velocity) value \(.*\) is not a valid float", {"W_NUMBER_BLANKS", "W_LIMITS"}),
    (r"(damping|friction) value .* is not a valid float", {"W_NUMBER_BLANKS"}),
    (r"(multiplier|offset) value .* is not a valid float", {"W_NUMBER_BLANKS"}),
    (r"dynamics element specified with no damping and no friction", {"W_DYNAMICS"}),
    (r"k_velocity|k_position|soft_upper_limit|soft_lower_limit|rising value|falling value", {"W_IGNORED"}),
    (r"material '.*' is not unique", {"W_MATERIAL"}),
    (r"Could not parse inertial element", {"W_NUMBER_BLANKS"}),
    (r"Malformed (parent origin|axis) element", {"W_NUMBER_BLANKS"}),
)
"""What urdfdom says where it refuses or drops what is loaded here, and the findings of which one must tell of it."""
SPACED = re.compile(r"Unable to parse component \[[^\]]*[\t\r\n][^\]]*\]")
"""What it says of line ends and tabs between the numbers of a joint's vector, which XML takes for blanks: legal and silent."""
LOOKS = re.compile(r"visual|collision|[Mm]aterial|[Gg]eometry|[Mm]esh|color")
"""What it says of looks only: it leaves them out."""
DRAWN = 10
"""Every so many a robot is also read from a file and drawn."""
NO_CHAIN = re.compile(
    r"no joint moves between |the joint .* mimics .*; lock it at a value|.* leaves; name one as the tip"
)
"""Messages for a robot without a chain between two of its links."""


@dataclass
class Outcome:
    """What became of one robot.

    Attributes:
        loaded: Whether it was accepted.
        codes: Of its findings.
        problems: What did not hold.
        remarks: Known differences to urdfdom, by kind.
    """

    loaded: bool = False
    codes: tuple[str, ...] = ()
    problems: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)


def try_robot(data: bytes, seed: str, folder: Path, enter: Callable[[str], None] = lambda stage: None) -> Outcome:
    """Read a robot in every way and compare.

    Args:
        data: The file.
        seed: Of the choice of tip, base and configuration.
        folder: For files; it may hold meshes.
        enter: Is told which part begins, for a process that dies.
    """
    outcome = Outcome()
    started = time.process_time()
    try:
        _try(data, random.Random(seed), folder, enter, outcome)
    except Exception as error:  # noqa: BLE001 - any exception that gets here is what the trial is for
        outcome.problems.append(f"{type(error).__name__}: {str(error)[:300]}")
    seconds = time.process_time() - started
    if seconds > SLOWEST:
        outcome.problems.append(f"took {seconds:.1f} s")
    return outcome


def _try(data: bytes, chance: random.Random, folder: Path, enter: Callable[[str], None], outcome: Outcome) -> None:
    enter("reading")
    try:
        robot = parse(data, "mutant.urdf")
        findings = robot.findings
    except UrdfError as refused:
        robot, findings = None, refused.findings
        if not any(found.severity == "error" for found in findings):
            outcome.problems.append("refused without an error")
    outcome.loaded, outcome.codes = robot is not None, tuple(found.code for found in findings)
    _check_lines(findings, outcome)
    if chance.randrange(DRAWN) == 0:
        enter("drawing")
        _try_file(data, robot, folder, outcome)
    if robot is None:
        return
    enter("second reading")
    plain = PlainReading.of(data)
    _compare_robots(robot, plain, chance, outcome)
    for _ in range(2):
        enter("chain")
        _compare_chain(robot, plain, chance, outcome)
    enter("editing")
    _edit(data, robot, outcome)
    enter("urdfdom")
    _compare_urdfdom(data, robot, plain, chance, outcome)


def _check_lines(findings: Sequence[Finding], outcome: Outcome) -> None:
    for found in findings:
        line = str(found)
        if len(line) > LONGEST_LINE or not line.isprintable():
            outcome.problems.append(f"a finding is long or not printable: {line[:100]!r}")


def _try_file(data: bytes, robot: Robot | None, folder: Path, outcome: Outcome) -> None:
    file = folder / "mutant.urdf"
    file.write_bytes(data)
    _check_lines(check(file), outcome)
    if robot is None:
        return
    again = read(file)
    if (again.links, again.joints) != (robot.links, robot.joints):
        outcome.problems.append("the file reads otherwise than its bytes")
    try:
        chain = Chain.from_robot(again, tip=again.leaves[-1])
    except InputError:
        return
    draw_arm(Scene(), chain.at(np.zeros(len(chain.joints))))


def _compare_robots(robot: Robot, plain: PlainReading, chance: random.Random, outcome: Outcome) -> None:
    kinds = {joint.name: (joint.kind, joint.parent, joint.child) for joint in robot.joints}
    if kinds != {joint.name: (joint.kind, joint.parent, joint.child) for joint in plain.joints.values()}:
        outcome.problems.append("other joints than in the second reading")
        return
    if {link.name for link in robot.links} != set(plain.links):
        outcome.problems.append("other links than in the second reading")
        return
    values = {joint.name: chance.uniform(-3, 3) for joint in robot.moving_joints}
    expected = plain.poses(values)
    _compare_poses("link poses", robot.link_poses(values), expected, outcome)
    for link in robot.links:
        body = plain.links[link.name]
        ours = link.inertial and (link.inertial.mass, link.inertial.com, link.inertial.rpy, link.inertial.inertia)
        theirs = body and (body.mass, body.centre, body.rpy, body.moments)
        if ours != theirs:
            outcome.problems.append(f"inertial of {link.name[:40]!r}: {ours} for {theirs}")


def _compare_chain(robot: Robot, plain: PlainReading, chance: random.Random, outcome: Outcome) -> None:
    names = [link.name for link in robot.links]
    tip = chance.choice(robot.leaves) if chance.random() < 0.7 else chance.choice(names)
    base = robot.root if chance.random() < 0.6 else chance.choice(names)
    locked = {joint.name: chance.uniform(-1, 1) for joint in robot.moving_joints if chance.random() < 0.15}
    try:
        chain = Chain.from_robot(robot, tip, base, locked=locked)
    except InputError as error:
        message = error.findings[0].message
        if not NO_CHAIN.match(message):
            outcome.problems.append(f"no chain: {message[:200]}")
        return
    q = np.array([chance.uniform(-3, 3) for _ in chain.joints])
    posture = chain.at(q)
    values = {**chain.locked, **dict(zip(chain.joint_names, map(float, q), strict=True))}
    poses = plain.poses(values)
    expected = np.linalg.inv(poses[base]) @ poses[tip]
    _compare_poses("the chain's tip", {"tip": posture.pose}, {"tip": expected}, outcome, reach=_reach(poses))
    torques = plain.torques(chain.joint_names, base, values)
    mass = 1 + sum(body.mass for body in plain.links.values() if body is not None)
    if np.abs(posture.load_torque - torques).max() > AGREEMENT * 10 * mass * (_reach(poses) + _levers(plain)):
        outcome.problems.append(f"load torques {posture.load_torque} for {torques}")
    chain.with_payload(1.0).at(q).load_torque.sum()


def _edit(data: bytes, robot: Robot, outcome: Outcome) -> None:
    """Write every placement again, which must change nothing."""
    placements = {joint.name: Placement(joint.xyz, joint.rpy) for joint in robot.joints}
    again = parse(UrdfText.scan(data).edited(placements, comment=["x"]), "edited.urdf")
    if [_numbers(joint) for joint in again.joints] != [_numbers(joint) for joint in robot.joints]:
        outcome.problems.append("placements written again read otherwise")


def _numbers(joint: Joint) -> tuple[object, ...]:
    return (joint.name, joint.kind, joint.parent, joint.child, joint.xyz, joint.rpy, joint.axis)


def _compare_urdfdom(data: bytes, robot: Robot, plain: PlainReading, chance: random.Random, outcome: Outcome) -> None:
    declared_otherwise = b"encoding=" in data and b'"UTF-8"' not in data[:80]
    if b"\0" in data or (declared_otherwise and not data.isascii()):
        return  # it reads every file as if it were UTF-8
    text = data.decode("utf-8")
    theirs = read_urdfdom(text)
    kind = _kind_of(theirs.log)
    if SPACED.search(theirs.log):
        outcome.remarks.append("urdfdom does not take line ends and tabs between numbers")
        return
    told = [codes for pattern, codes in EXPLAINED if re.search(pattern, theirs.log, re.DOTALL)]
    if theirs.model is None and not theirs.log:
        told.append({"W_DYNAMICS"})  # Pinocchio refuses a negative friction without a word
    if any(codes.isdisjoint(outcome.codes) for codes in told) or (
        theirs.log and not told and not LOOKS.search(theirs.log)
    ):
        outcome.problems.append(f"urdfdom complains, without a finding here: {theirs.log[:300]!r}; {outcome.codes}")
    if theirs.model is None:
        outcome.remarks.append(f"urdfdom refuses: {kind}")
        if not told:
            outcome.problems.append(f"urdfdom refuses for another reason: {theirs.log[:300]!r}; {outcome.codes}")
        return
    if theirs.log and not told:
        outcome.remarks.append("urdfdom leaves looks out")
    values = {joint.name: chance.uniform(-3, 3) for joint in robot.moving_joints}
    if set(theirs.model.names) != {"universe", *values}:
        outcome.problems.append(f"urdfdom finds other joints: {kind}")
        return
    differing = Outcome()
    _compare_poses("link poses of urdfdom", theirs.poses(values), plain.poses(values), differing)
    if differing.problems:
        outcome.problems.append(f"{differing.problems[0]} ({kind}; {outcome.codes})")
    bodies = {joint.child: joint.name for joint in robot.moving_joints} | {robot.root: "universe"}
    moments = plain.lumped()
    for link, joint in bodies.items():
        scale = max(1.0, float(moments[link][0])) * (1 + _levers(plain))
        if np.abs(theirs.moments(joint) - moments[link]).max() > AGREEMENT * scale:
            outcome.remarks.append(f"urdfdom finds another mass: {kind}")
            if "W_NUMBER_BLANKS" not in outcome.codes:
                outcome.problems.append(f"another mass in urdfdom: {kind}; {outcome.codes}")
            break


def _compare_poses(
    what: str, found: Mapping[str, Array], expected: Mapping[str, Array], outcome: Outcome, reach: float | None = None
) -> None:
    if set(found) != set(expected):
        outcome.problems.append(f"{what}: other names")
        return
    scale = reach or _reach(expected)
    worst = max(float(np.abs(found[name] - expected[name]).max()) for name in expected)
    if not worst <= AGREEMENT * scale:
        outcome.problems.append(f"{what} differ by {worst:.3g} of {scale:.3g}")


def _reach(poses: Mapping[str, Array]) -> float:
    return 1.0 + max(float(np.abs(pose[:3, 3]).max()) for pose in poses.values())


def _levers(plain: PlainReading) -> float:
    return max((max(map(abs, body.centre)) for body in plain.links.values() if body is not None), default=0.0)


def _kind_of(log: str) -> str:
    """Return the first line of urdfdom's log with what it quotes left out."""
    first = log.strip().splitlines()[0] if log.strip() else "says nothing"
    return re.sub(r"\[.*\]|\(.*\)|[-+\d.e]{2,}", "…", first)[:100]
