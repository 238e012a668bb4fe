"""Names that a link and a joint share, or that a library would take for its own, change nothing but the findings."""

from __future__ import annotations

import numpy as np
import pytest

from precision_pin.robot.chain import Chain
from precision_pin.robot.urdf import parse
from support.plain_robot import random_arm

ARM = random_arm(4)
LINKS = ("base", "link1", "bracket", "link2", "half2", "link3", "link7", "tool", "finger")
JOINTS = ("joint1", "split2", "bolt", "joint3", "flange", "finger_joint")
# tip, base, locked: with and without joints that Pinocchio removes from its model
CUTS = [
    ("tool", None, ()),
    ("tool", None, ("joint3",)),
    ("finger", "bracket", ()),
    ("link1", "tool", ("joint1", "joint5")),
]


def renamed(names: dict[str, str]) -> str:
    text = ARM
    for kind in ("link name", "parent link", "child link"):
        for old, new in names.items():
            text = text.replace(f'<{kind}="{old}"', f'<{kind}="\0{new}"')
    return text.replace("\0", "")


def results(text: str, tip: str, base: str | None, locked: tuple[str, ...]) -> list[np.ndarray]:
    values = dict.fromkeys(locked, 0.3)
    chain = Chain.from_robot(parse(text.encode(), "arm.urdf"), tip, base, locked=values)
    posture = chain.with_payload(2.0, (0.1, 0.0, 0.2)).at(np.linspace(-1, 1, len(chain.joints)))
    return [posture.pose, posture.load_torque, posture.link_wrench, posture.joint_jacobian]


@pytest.mark.parametrize(
    ("tip", "base", "locked"),
    [CUTS[0], CUTS[-1], *(pytest.param(*cut, marks=pytest.mark.slow) for cut in CUTS[1:-1])],
)
def test_shared_names_change_nothing(tip, base, locked):
    plain = results(ARM, tip, base, locked)
    changes = [{link: joint} for link in LINKS for joint in JOINTS[:2]] + [
        dict(zip(LINKS, JOINTS, strict=False)),
        dict(
            zip(
                LINKS,
                ("root_joint", "joint000000", "link000001", "world", "a&b<'>", "%s", "$x$", "é", "\u0627"),
                strict=True,
            )
        ),
    ]
    for names in changes:
        escaped = {old: new.replace("&", "&amp;").replace("<", "&lt;") for old, new in names.items()}
        found = results(renamed(escaped), names.get(tip, tip), base and names.get(base, base), locked)
        for ours, theirs in zip(found, plain, strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)


def test_a_joint_may_have_the_name_of_the_tip_and_the_other_way_round():
    text = renamed({"tool": "joint7", "link7": "flange"})
    robot = parse(text.encode(), "arm.urdf")
    assert [found.code for found in robot.findings if found.code != "W_BRANCHED"] == ["W_NAME_SHARED"] * 2
    chain = Chain.from_robot(robot, "joint7")
    assert chain.joint_index("joint7") == 6
    assert chain.link_frame("joint7").link == 7
    assert chain.frame_place("flange").link == 7
