"""The tip that is proposed, the gripper that is named, and the ways in which a robot is given."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy

import precision_pin as pp
from precision_pin.base.errors import InputError
from precision_pin.robot import urdf
from precision_pin.robot.examples import example_urdfs
from precision_pin.robot.urdf import gripper_joint, likeliest_tip

EXAMPLES = example_urdfs()

# by the drawings of the robots: the flange or the point between the fingers
TIPS = {
    "ur5": "tool0",
    "panda": "panda_hand_tcp",
    "kinova": "j2s6s200_end_effector",
    "so101": "gripper_frame_link",
    "so100": "gripper",
    "pr2": "r_gripper_tool_frame",
    "talos_left_arm": "wrist_left_ft_tool_link",
    "xarm7": "link_eef",
}


def tree(*joints: str) -> urdf.Robot:
    """Return a robot of joints written as ``parent name child kind``, each 0.1 m long."""
    names = dict.fromkeys(name for joint in joints for name in joint.split()[::2][:2])
    links = "".join(f'<link name="{name}"/>' for name in names)
    lines = []
    for joint in joints:
        parent, name, child, kind = joint.split()
        limit = '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind == "revolute" else ""
        lines.append(
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="0.1 0 0"/>{limit}</joint>'
        )
    return urdf.parse(f'<robot name="r">{links}{"".join(lines)}</robot>'.encode(), "r.urdf")


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
