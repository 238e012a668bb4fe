"""Ways in which a robot is given, the tip that is proposed, and warnings: of links off the chain once, summed up.

Names that links and joints share change nothing else.
"""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy

import precision_pin as pp
from precision_pin.base.errors import Finding, InputError
from precision_pin.robot import urdf
from precision_pin.robot.chain import Chain, chain_findings
from precision_pin.robot.examples import example_urdfs
from precision_pin.robot.urdf import gripper_joint, likeliest_tip, parse
from support import plain_robot
from support.plain_robot import limits, random_arm

MOVING = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 0 1"/>{3}</joint>'
LIMIT = limits(-1, 1)
AWAY = limits(0.5, 1)
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


def test_warnings_about_the_chain_or_a_weight_that_hangs_on_it_stay():
    zero, heavy = BODY.format(0), BODY.format(1e5)
    lines = found(forearm=zero, many=2)
    assert lines[0].startswith("W_MASS_ZERO: a mass of zero is given; it weighs nothing (link 'forearm')")
    assert lines[1].startswith("W_OFF_CHAIN: 6 warnings")
    assert len(lines) == 2
    # a list of links of which one is on the chain
    (mass, rest) = found(forearm=zero, finger=zero, cart=zero)
    assert mass.endswith("(link 'forearm', link 'finger', link 'cart')")
    assert rest.startswith("W_OFF_CHAIN: 2 warnings about links and joints off the chain (2 W_NEUTRAL)")
    assert found(finger=zero, cart=zero)[0].startswith("W_OFF_CHAIN: 3 warnings")
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


def renamed(names: dict[str, str]) -> str:
    text = ARM
    for kind in ("link name", "parent link", "child link"):
        for old, new in names.items():
            text = text.replace(f'<{kind}="{old}"', f'<{kind}="\0{new}"')
    return text.replace("\0", "")


def test_a_joint_may_have_the_name_of_the_tip_and_the_other_way_round():
    text = renamed({"tool": "joint7", "link7": "flange"})
    robot = parse(text.encode(), "arm.urdf")
    assert [found.code for found in robot.findings if found.code != "W_BRANCHED"] == ["W_NAME_SHARED"] * 2
    chain = Chain.from_robot(robot, "joint7")
    assert chain.joint_index("joint7") == 6
    assert chain.link_frame("joint7").link == 7
    assert chain.frame_place("flange").link == 7


# --- tips, and ways in ---


EXAMPLES = example_urdfs()

# by the drawings of the robots: the flange or the point between the fingers
TIPS = {
    "ur5": "tool0",
    "panda": "panda_hand_tcp",
    "kinova": "j2s6s200_end_effector",
    "so101": "gripper_frame_link",
    "pr2": "r_gripper_tool_frame",
    "xarm7": "link_eef",
}


def tree(*joints: str) -> urdf.Robot:
    """Return a robot of joints written as ``parent name child kind``, each 0.1 m long."""
    rows = [joint.split() for joint in joints]
    links = dict.fromkeys(name for parent, _, child, _ in rows for name in (parent, child))
    parts = (plain_robot.joint(name, kind, parent, child, (0.1, 0, 0)) for parent, name, child, kind in rows)
    return urdf.parse(plain_robot.robot(*map(plain_robot.link, links), *parts).encode(), "r.urdf")


@pytest.mark.parametrize("name", TIPS)
def test_the_tip_of_a_robot_is_that_of_its_drawing(name):
    assert likeliest_tip(urdf.read(EXAMPLES[name])) == TIPS[name]


def test_names_come_before_lengths_and_lengths_before_fingers():
    arm = ("base turn arm revolute", "arm lift wrist revolute")
    far = (*arm, "base b1 x revolute", "x b2 y revolute", "y b3 z revolute")
    assert likeliest_tip(tree(*far)) == "z"
    assert likeliest_tip(tree(*far, "wrist f flange fixed")) == "flange"
    assert likeliest_tip(tree(*far, "wrist f flange fixed", "flange t tool0 fixed")) == "tool0"
    # a camera or a link whose name only holds the word is none
    assert likeliest_tip(tree(*far, "wrist f tool_camera fixed", "base g handle fixed")) == "z"
    fingers = (*arm, "wrist finger_joint left_finger revolute", "wrist other_finger right_finger revolute")
    assert likeliest_tip(tree(*fingers)) == "wrist"
    assert likeliest_tip(tree(arm[0], "arm finger_joint left_finger revolute")) == "arm"
    hand = urdf.read(EXAMPLES["finger_edu"])  # all of it is a finger
    assert gripper_joint(hand, likeliest_tip(hand)) is None


def test_a_chain_is_read_from_text_from_yourdfpy_and_by_name():
    path = EXAMPLES["so101"]
    named = pp.Chain.from_urdf("example:so101", TIPS["so101"])
    q = np.linspace(-0.4, 0.5, len(named.joints))
    other = yourdfpy.URDF.load(str(path), load_meshes=False)
    for given in (path, path.read_text(encoding="utf-8"), path.read_bytes(), other):
        chain = pp.Chain.from_urdf(given, TIPS["so101"])
        assert np.abs(chain.at(q).pose - named.at(q).pose).max() < 1e-14
        assert np.abs(chain.at(q).load_torque - named.at(q).load_torque).max() < 1e-14
    with pytest.raises(InputError, match=r"E_XML_SYNTAX"):
        pp.Chain.from_urdf("<robot", "tool")


def test_a_chain_of_a_pinocchio_model_is_where_that_has_it():
    path = EXAMPLES["ur5"]
    for root in ((), (pin.JointModelFreeFlyer(),)):
        model = pin.buildModelFromUrdf(str(path), *root)
        model.gravity.linear = np.array([0.0, 1.0, -9.0])
        chain = pp.Chain.from_pinocchio(model, path, "tool0")
        assert chain.gravity.tolist() == [0.0, 1.0, -9.0]
        assert len(chain.joints) == 6
    model = pin.buildModelFromUrdf(str(path))
    at = pin.neutral(model)
    at[model.joints[model.getJointId("elbow_joint")].idx_q] = 0.7
    reduced = pin.buildReducedModel(model, [model.getJointId("elbow_joint")], at)
    with pytest.raises(InputError, match=r"has 'tool0' 0\.644 away .* locked at {'elbow_joint': 0\.0}"):
        pp.Chain.from_pinocchio(reduced, path, "tool0")
    chain = pp.Chain.from_pinocchio(reduced, path, "tool0", locked={"elbow_joint": 0.7})
    pin.seed(1)
    q = pin.randomConfiguration(reduced)
    data = reduced.createData()
    pin.framesForwardKinematics(reduced, data, q)
    tool = data.oMf[reduced.getFrameId("tool0")].homogeneous
    assert np.abs(chain.at(dict(zip(reduced.names[1:], q, strict=True))).pose - tool).max() < 1e-12
    with pytest.raises(InputError, match="no frame 'panda_link0'"):
        pp.Chain.from_pinocchio(model, EXAMPLES["panda"], TIPS["panda"])
    with pytest.raises(InputError, match=r"must be a pinocchio\.Model"):
        pp.Chain.from_pinocchio("ur5", path, "tool0")
