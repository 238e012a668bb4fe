"""Warnings about links off the chain come once, summed up; names that links and joints share change nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base.errors import Finding
from precision_pin.robot import urdf
from precision_pin.robot.chain import Chain, chain_findings
from precision_pin.robot.examples import example_urdfs
from precision_pin.robot.urdf import parse
from support.plain_robot import random_arm

MOVING = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 1"/>{3}</joint>'
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
AWAY = '<limit lower="0.5" upper="1" effort="1" velocity="1"/>'
BODY = '<inertial><mass value="{}"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def robot(*, forearm: str = "", finger: str = "", cart: str = "", many: int = 0) -> bytes:
    """Return an arm of two joints with a finger on its tool, a cart on its base, and so many cameras on the cart."""
    cameras = "".join(f'<link name="camera {k}"/>' for k in range(many))
    mounts = "".join(MOVING.format(f"mount{k}", "cart", f"camera {k}", AWAY) for k in range(many))
    text = (
        '<robot name="r"><link name="base"/><link name="upper"/>'
        f'<link name="forearm">{forearm}</link><link name="finger">{finger}</link><link name="cart">{cart}</link>'
        + cameras
        + MOVING.format("shoulder", "base", "upper", LIMIT)
        + MOVING.format("elbow", "upper", "forearm", LIMIT)
        + MOVING.format("grip", "forearm", "finger", AWAY)
        + MOVING.format("wheel", "base", "cart", AWAY)
        + mounts
        + "</robot>"
    )
    return text.replace("><", ">\n<").encode()


def found(**parts: object) -> list[str]:
    chain = Chain.from_robot(urdf.parse(robot(**parts), "r.urdf"), "forearm")  # type: ignore[arg-type]
    return [str(finding).partition("warning ")[2] for finding in chain_findings(chain)]


def test_warnings_off_the_chain_are_one_line_with_their_codes():
    (line,) = found(many=30)
    # mount0 to mount29, grip and wheel stand away from zero; 30 names have a blank
    assert line == (
        "W_OFF_CHAIN: 62 warnings about links and joints off the chain (30 W_NAME_CHARS, 32 W_NEUTRAL); "
        "precision-pin check r.urdf lists them"
    )
    everything = urdf.parse(robot(many=30), "r.urdf").findings
    assert len([finding for finding in everything if finding.code != "W_BRANCHED"]) == 62


def test_warnings_about_the_chain_stay_as_they_are():
    zero = BODY.format(0)
    lines = found(forearm=zero, many=2)
    assert lines[0].startswith("W_MASS_ZERO: a mass of zero is given; it weighs nothing (link 'forearm')")
    assert lines[1].startswith("W_OFF_CHAIN: 6 warnings")
    assert len(lines) == 2


def test_a_list_of_links_of_which_one_is_on_the_chain_stays():
    zero = BODY.format(0)
    (mass, rest) = found(forearm=zero, finger=zero, cart=zero)
    assert mass.endswith("(link 'forearm', link 'finger', link 'cart')")
    assert rest.startswith("W_OFF_CHAIN: 2 warnings about links and joints off the chain (2 W_NEUTRAL)")
    assert found(finger=zero, cart=zero)[0].startswith("W_OFF_CHAIN: 3 warnings")


def test_a_weight_that_hangs_on_the_chain_stays_wherever_it_is():
    heavy = BODY.format(1e5)
    lines = found(finger=heavy)
    assert lines[0].startswith("W_MASS_LARGE: link 'finger': mass 100000 kg")
    assert lines[1].startswith("W_OFF_CHAIN: 2 warnings")
    # on the base it bends nothing
    (line,) = found(cart=heavy)
    assert line.startswith("W_OFF_CHAIN: 3 warnings about links and joints off the chain (W_MASS_LARGE, 2 W_NEUTRAL)")


def test_warnings_about_the_robot_itself_stay():
    text = robot(many=2).replace(b'<link name="base"/>', b'<link name="base"/><odd/><link name="x"><odd/></link>', 1)
    text = text.replace(
        b'<joint name="wheel"', MOVING.format("spare", "base", "x", LIMIT).encode() + b'<joint name="wheel"'
    )
    shown = chain_findings(Chain.from_robot(urdf.parse(text, "r.urdf"), "forearm"))
    assert [finding.message.partition(" is ignored")[0] for finding in shown[:-1]] == [
        "unknown element <odd> in <robot>"
    ]
    assert "W_UNKNOWN_ELEMENT" in shown[-1].message


@pytest.mark.parametrize("place", ["link 'forearm': <mass> value", "link 'forearm'", "joint 'elbow'"])
def test_a_list_whose_entries_say_more_than_a_name_is_understood(place):
    whole = urdf.parse(robot(many=2), "r.urdf")
    on = Finding("warning", "W_X", "read as it stands (…)", "r.urdf", 1, (place, "link 'cart': <mass> value"))
    off = Finding("warning", "W_Y", "read as it stands (…)", "r.urdf", 1, ("link 'cart': <mass> value",))
    chain = Chain.from_robot(replace(whole, findings=(*whole.findings, on, off)), "forearm")
    codes = [finding.code for finding in chain_findings(chain)]
    assert codes == ["W_X", "W_OFF_CHAIN"]


def test_one_warning_off_the_chain_is_given_as_it_is():
    # the grip is on this chain, the wheel is not
    chain = Chain.from_robot(urdf.parse(robot(), "r.urdf"), "finger")
    assert [finding.message for finding in chain_findings(chain)] == [
        "joint 'grip': zero is outside the limits 0.5 … 1",
        "joint 'wheel': zero is outside the limits 0.5 … 1",
    ]


@pytest.mark.parametrize("name", ["talos_full_v2", "pr2", "baxter"])
def test_of_a_large_robot_every_warning_is_shown_or_counted(name):
    whole = urdf.read(example_urdfs()[name])
    for tip in (whole.leaves[0], whole.leaves[-1]):
        chain = Chain.from_robot(whole, tip) if _moves(whole, tip) else None
        if chain is None:
            continue
        shown = chain_findings(chain)
        summed = [finding for finding in shown if finding.code == "W_OFF_CHAIN"]
        counted = int(summed[0].message.split()[0]) if summed else 0
        given = [finding for finding in whole.findings if finding.code != "W_BRANCHED"]
        assert len(shown) - len(summed) + counted == len(given)
        assert len(summed) <= 1


def _moves(whole: urdf.Robot, tip: str) -> bool:
    way = whole.path(whole.root, tip)
    return any(joint.moves for joint in way) and all(joint.mimic is None for joint in way)


@pytest.mark.slow
def test_a_sheet_and_a_python_result_have_the_sum(tmp_path):
    (tmp_path / "r.urdf").write_bytes(robot(many=3))
    sheet = tmp_path / "r.errors.yaml"
    sheet.write_text(
        "precision-pin: 1\nrobot: r.urdf\ntip: forearm\nposes: {start: 0 0 deg}\n"
        "sources:\n  - joint_offset: {joint: elbow, offset: {normal: 0.1 deg}}\n"
    )
    from precision_pin.sheet import read

    codes = [finding.code for finding in read(sheet).findings]
    assert codes == ["W_OFF_CHAIN"]
    warnings = pp.monte_carlo(pp.ErrorModel.load(sheet), samples=200, findings=read(sheet).findings).warnings
    assert [line for line in warnings if "W_NEUTRAL:" in line] == []
    assert len([line for line in warnings if "W_OFF_CHAIN: 8 warnings" in line]) == 1


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


@pytest.mark.slow
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
