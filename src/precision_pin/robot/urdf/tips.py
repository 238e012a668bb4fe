"""Which link of a robot is likely its tip, and where a gripper begins."""

from __future__ import annotations

import re
import shlex
from typing import Final

from precision_pin.robot.urdf.robot import Joint, Robot

_WORDS: Final = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[0-9]+")
_TIPS: Final = tuple(
    re.compile(rf"(?:^|_)(?:{words})$")
    for words in (
        "tcp(?:_link|_frame)?",
        "tool(?:_0|_frame|_link)?",
        "(?:gripper|grasp|grasping)_(?:frame|center|centre)(?:_link)?",
        "(?:ee|eef|end_effector)(?:_link|_frame)?",
        "flange(?:_link|_frame)?",
        "(?:gripper|hand|palm)(?:_link|_base_link)?",
    )
)
"""Endings of names of tips, in words joined by _, the likeliest first."""
_FINGERS: Final = "finger|thumb|jaw|knuckle|claw"
_TURNS: Final = "(?:^|_)(?:roll|pitch|yaw|wrist)(?:_|$)"


def likeliest_tip(robot: Robot) -> str:
    """Return the link that is likely meant as the tip: one named so (``tool0``, ``hand_tcp``, …), else the farthest leaf.

    Of several named alike that with the most moving joints before it. Leaves beyond a gripper's joints stand for the link
    before them; links that follow a mimic joint or no joint at all are the last choice.
    """
    ways = {link.name: robot.path(robot.root, link.name) for link in robot.links}

    def merit(name: str) -> tuple[bool, int, float]:
        way = ways[name]
        is_arm = any(joint.moves for joint in way) and not any(joint.mimic is not None for joint in way)
        return is_arm, sum(joint.moves for joint in way), sum(sum(x * x for x in joint.xyz) ** 0.5 for joint in way)

    def rank(name: str) -> int:
        words = _words(name)
        return next((k for k, pattern in enumerate(_TIPS) if pattern.search(words)), len(_TIPS))

    named = [name for name in ways if rank(name) < len(_TIPS) and merit(name)[0] and gripper_joint(robot, name) is None]
    if named:
        return max(named, key=lambda name: (-rank(name), merit(name)))
    ends = [name if (joint := gripper_joint(robot, name)) is None else joint.parent for name in robot.leaves]
    return max(ends, key=lambda name: (merit(name)[0], merit(name)[2]))


def gripper_joint(robot: Robot, tip: str) -> Joint | None:
    """Return the first of the gripper's joints that end the way to a tip, None if it ends with a joint of the arm."""
    moving = [joint for joint in robot.path(robot.root, tip) if joint.moves]
    first = None
    while len(moving) > 1 and _grips(moving[-1]):
        first = moving.pop()
    return None if moving and _grips(moving[-1]) else first


def ask_for_tip(robot: Robot) -> str:
    """Return the message that asks which of several leaves is the tip, with a proposal."""
    return (
        f"{robot.file} has {len(robot.leaves)} leaves; name one as the tip: {', '.join(sorted(robot.leaves))} "
        f"(--tip, or tip: in a sheet); likely --tip {shlex.quote(likeliest_tip(robot))}"
    )


def draft_command(robot: str, tip: str) -> str:
    """Return the command that drafts a sheet for a robot, as named on the command line, and a tip."""
    return shlex.join(["precision-pin", "init", robot, "--tip", tip])


def _grips(joint: Joint) -> bool:
    """Return whether a moving joint opens a gripper, by its name or that of the link that it moves."""
    name = _words(joint.name)
    is_finger = re.search(f"{_FINGERS}|grip", name) or re.search(_FINGERS, _words(joint.child))
    return is_finger is not None and not re.search(_TURNS, name)


def _words(name: str) -> str:
    return "_".join(_WORDS.findall(name)).lower()
