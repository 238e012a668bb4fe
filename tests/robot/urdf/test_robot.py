"""The tree and its changes, and the arms of example-robot-data against Pinocchio and yourdfpy."""

from __future__ import annotations

import math
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from precision_pin.base import se3
from precision_pin.base.errors import InputError, UnknownNameError, UrdfError
from precision_pin.robot.urdf import Inertial, canonical, parse, read, rerooted, rpy_of, snapped

BRANCH = (
    '<link name="hook"><inertial><origin xyz="0.1 0.2 0.3" rpy="0.4 -0.5 0.6"/><mass value="0.7"/>'
    '<inertia ixx="0.03" ixy="0.001" ixz="-0.002" iyy="0.04" iyz="0.003" izz="0.05"/></inertial></link>'
    '<joint name="hinge" type="revolute"><parent link="upper"/><child link="hook"/>'
    '<origin xyz="0.1 -0.2 0.3" rpy="1 -1.2 2"/><axis xyz="1 2 -2"/>'
    '<limit lower="-1" upper="1" effort="5" velocity="1"/></joint></robot>'
)


@pytest.fixture
def robot(arm):
    return parse(arm.replace("</robot>", BRANCH).encode(), "arm.urdf")


def test_tree(robot):
    assert robot.root == "foot"
    assert robot.leaves == ("tip", "hook")
    assert [joint.name for joint in robot.child_joints("upper")] == ["elbow", "hinge"]
    assert robot.child_joints("tip") == ()
    assert robot.parent_joint("foot") is None
    assert robot.parent_joint("hook").name == "hinge"
    assert [joint.name for joint in robot.path("foot", "tip")] == ["shoulder", "elbow", "slide", "flange"]
    assert [joint.name for joint in robot.path("fore", "ram")] == ["slide"]
    assert robot.path("fore", "fore") == ()
    assert [joint.name for joint in robot.moving_joints] == ["shoulder", "elbow", "slide", "hinge"]


def test_unknown_names_bring_the_nearest(robot):
    with pytest.raises(UnknownNameError, match="'tip'"):
        robot.link("tipp")
    with pytest.raises(UnknownNameError, match="'elbow'"):
        robot.joint("Elbow")
    with pytest.raises(UnknownNameError, match="'tip'"):
        robot.path("foot", "tp")
    with pytest.raises(UnknownNameError):
        robot.link_poses({"wrist": 1.0})
    with pytest.raises(InputError, match="foot, upper, hook"):
        robot.path("fore", "hook")


def test_forward_kinematics_by_hand(robot):
    # shoulder axis points along +y of the foot; at 90° the upper arm points down
    poses = robot.link_poses({"shoulder": math.pi / 2})
    np.testing.assert_allclose(poses["upper"][:3, 3], [0, 0, 0.3], atol=1e-15)
    np.testing.assert_allclose(poses["upper"][:3, 0], [0, 0, -1], atol=1e-15)
    np.testing.assert_allclose(poses["fore"][:3, 3], [0, 0, -0.1], atol=1e-15)
    # the slide moves along the forearm's x, whatever came before
    near, far = (
        robot.link_poses({"shoulder": 0.3, "elbow": -2}),
        robot.link_poses({"shoulder": 0.3, "elbow": -2, "slide": 0.2}),
    )
    np.testing.assert_allclose(far["tip"][:3, 3] - near["tip"][:3, 3], 0.2 * near["fore"][:3, 0], atol=1e-15)


def relative_poses(robot, values):
    poses = robot.link_poses(values)
    return {name: {other: se3.inverse(poses[name]) @ poses[other] for other in poses} for name in poses}


@pytest.mark.parametrize("base", ["foot", "upper", "fore", "ram", "tip", "hook"])
def test_another_root_is_the_same_mechanism(robot, base):
    turned = rerooted(robot, base)
    assert turned.root == base
    assert {link.name for link in robot.links} <= {link.name for link in turned.links}
    assert [joint.name for joint in turned.moving_joints] == [joint.name for joint in robot.moving_joints]
    assert sum(link.mass for link in turned.links) == sum(link.mass for link in robot.links)
    rng = np.random.default_rng(7)
    for _ in range(20):
        values = {joint.name: rng.uniform(-3, 3) for joint in robot.moving_joints}
        before, after = relative_poses(robot, values), relative_poses(turned, values)
        worst = max(np.abs(before[a][b] - after[a][b]).max() for a in before for b in before)
        assert worst < 1e-14


def test_there_and_back_again(robot):
    back = rerooted(rerooted(robot, "tip"), "foot")
    values = {"shoulder": 0.4, "elbow": -1.1, "slide": 0.1, "hinge": 0.9}
    for name, pose in robot.link_poses(values).items():
        np.testing.assert_allclose(back.link_poses(values)[name], pose, atol=1e-14)


def test_joints_turned_round_are_marked_and_know_their_axis(robot):
    """What lies between the old root and the new one; turned round twice, a joint is as the file has it."""
    turned = rerooted(robot, "tip")
    between = {joint.name for joint in robot.path("foot", "tip")}
    assert {joint.name for joint in turned.joints if joint.reversed and joint.name in between} == between
    assert not any(joint.reversed for joint in turned.joints if joint.name in {j.name for j in robot.joints} - between)
    for joint in robot.moving_joints:
        np.testing.assert_array_equal(turned.joint(joint.name).written_axis, joint.axis)
    assert not any(joint.reversed for joint in rerooted(turned, "foot").joints)


def test_the_same_root_changes_nothing(robot):
    assert rerooted(robot, "foot") == robot
    with pytest.raises(UnknownNameError):
        rerooted(robot, "nowhere")


def test_added_names_never_clash(arm):
    robot = parse(arm.replace("tip", "shoulder_reversed").encode(), "arm.urdf")
    turned = rerooted(robot, "ram")
    names = [link.name for link in turned.links]
    assert len(names) == len(set(names))
    assert "shoulder_reversed_" in names


def test_rpy_of_is_accurate_at_the_poles():
    rng = np.random.default_rng(1)
    pitches = [math.pi / 2, -math.pi / 2, math.pi / 2 - 1e-9, 1e-8 - math.pi / 2, math.pi / 2 - 1e-5, 0.0, 1.1]
    for pitch in pitches:
        for _ in range(50):
            rotation = se3.rpy_rotation((rng.uniform(-3, 3), pitch, rng.uniform(-3, 3)))
            np.testing.assert_allclose(se3.rpy_rotation(rpy_of(rotation)), rotation, rtol=0, atol=2e-15)


def test_snapping_makes_right_angles_exact_and_nothing_else(arm):
    text = arm.replace('rpy="0.1 0.2 0.3"', 'rpy="1.57 -3.1416 0.7854"').replace("0 0.5 0", "0 0.785398 1.5712345")
    rounded = parse(text.encode(), "arm.urdf")
    assert [found.code for found in rounded.findings] == ["W_ANGLE_ROUNDED"] * 3
    exact = snapped(rounded)
    assert exact.findings == ()
    assert exact.joint("elbow").rpy == (math.pi / 2, -math.pi, math.pi / 4)
    assert exact.joint("flange").rpy == (0, 0.785398, 1.5712345)
    same = replace(
        exact, joints=tuple(replace(new, rpy=old.rpy) for new, old in zip(exact.joints, rounded.joints, strict=True))
    )
    assert same == replace(rounded, findings=())
    plain = parse(arm.encode(), "arm.urdf")
    assert snapped(plain) == plain


def test_the_inertia_tensor_turns_with_its_axes(robot):
    inertial = Inertial(1, (0, 0, 0), (0, 0, math.pi / 2), (1, 0, 0, 2, 0, 3))
    np.testing.assert_allclose(inertial.tensor, np.diag([2, 1, 3]), atol=1e-15)


def test_canonical_text_is_complete_and_reads_back_the_same(robot):
    text = canonical(robot)
    tree = ElementTree.fromstring(text.split("\n", 1)[1])
    assert all(link.find("inertial/inertia").get("izz") for link in tree.findall("link"))
    assert {element.tag for element in tree.iter()} == {
        "robot", "link", "inertial", "origin", "mass", "inertia", "joint", "parent", "child", "axis", "limit",
    }  # fmt: skip
    assert [joint.get("type") for joint in tree.findall("joint")] == [
        "revolute", "revolute", "prismatic", "fixed", "revolute",
    ]  # fmt: skip
    again = parse(text.encode(), "again.urdf")
    for old, new in zip(robot.joints, again.joints, strict=True):
        assert (new.name, new.parent, new.child) == (old.name, old.parent, old.child)
        assert (new.xyz, new.rpy) == (old.xyz, old.rpy)
        np.testing.assert_allclose(new.axis, old.axis, rtol=0, atol=2e-16)
    for old, new in zip(robot.links, again.links, strict=True):
        assert new.mass == old.mass
        if old.inertial is not None:
            assert new.inertial == old.inertial


def test_pinocchio_sees_the_same_masses_and_inertias(robot):
    model = pin.buildModelFromXML(canonical(robot))
    assert (model.nq, model.nv) == (4, 4)
    assert (np.abs(model.upperPositionLimit) < 1e10).all()
    hook = model.inertias[model.getJointId("hinge")]
    assert hook.mass == 0.7
    np.testing.assert_allclose(hook.lever, [0.1, 0.2, 0.3], rtol=0, atol=1e-15)
    np.testing.assert_allclose(hook.inertia, robot.link("hook").inertial.tensor, rtol=0, atol=1e-15)
    # massless ram and tip
    assert model.inertias[model.getJointId("slide")].mass == 0


ODD = "a <&> \"b\"\n\t'c' %s ü 腕"


def test_any_name_survives(arm):
    plain = parse(arm.encode(), "arm.urdf")
    links = tuple(replace(link, name=f"{ODD}{link.name}") for link in plain.links)
    joints = tuple(
        replace(joint, name=f"{ODD}{joint.name}", parent=f"{ODD}{joint.parent}", child=f"{ODD}{joint.child}")
        for joint in plain.joints
    )
    odd = replace(plain, name=ODD, links=links, joints=joints)
    again = parse(canonical(odd).encode(), "odd.urdf")
    assert again.name == ODD
    assert [link.name for link in again.links] == [link.name for link in links]
    model = pin.buildModelFromXML(canonical(odd))
    assert list(model.names)[1:] == [joint.name for joint in odd.moving_joints]


@pytest.mark.parametrize("name", ["shoulder", "elbow"])
def test_pinocchio_takes_a_link_and_a_joint_of_one_name(arm, name):
    robot = parse(arm.replace('"fore"', f'"{name}"').encode(), "arm.urdf")
    assert [found.code for found in robot.findings] == ["W_NAME_SHARED"]
    assert pin.buildModelFromXML(canonical(robot)).nq == 3


ARMS = {
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "z1": "z1_description/urdf/z1.urdf",
    "so101": "so_arm_description/urdf/so101.urdf",
    "talos": "talos_data/robots/talos_left_arm.urdf",
    "talos_full": "talos_data/robots/talos_reduced.urdf",
    "tiago": "tiago_description/robots/tiago.urdf",
    "pr2": "pr2_description/urdf/pr2.urdf",
    "baxter": "baxter_description/urdf/baxter.urdf",
    "anymal-kinova": "anymal_b_simple_description/robots/anymal-kinova.urdf",
    "finger_edu": "finger_edu_description/robots/finger_edu.urdf",
    "double_pendulum_continuous": "double_pendulum_description/urdf/double_pendulum_continuous.urdf",
}


def random_values(robot, seed):
    rng = np.random.default_rng(seed)
    return {joint.name: rng.uniform(-2, 2) for joint in robot.moving_joints}


@pytest.mark.fast(7)
@pytest.mark.parametrize("arm", ARMS)
def test_pinocchio_agrees(shipped, arm):
    robot = read(shipped / ARMS[arm])
    model = pin.buildModelFromXML(canonical(robot))
    data = model.createData()
    assert sorted(list(model.names)[1:]) == sorted(joint.name for joint in robot.moving_joints)
    values = random_values(robot, 3)
    q = np.zeros(model.nq)
    for name, value in values.items():
        q[model.joints[model.getJointId(name)].idx_q] = value
    pin.framesForwardKinematics(model, data, q)
    poses = robot.link_poses(values)
    masses = np.zeros(model.njoints)
    moments = np.zeros((model.njoints, 3))
    for link in robot.links:
        body = model.frames[model.getFrameId(link.name, pin.FrameType.BODY)]
        placement = data.oMf[model.getFrameId(link.name, pin.FrameType.BODY)]
        np.testing.assert_allclose(placement.homogeneous, poses[link.name], rtol=0, atol=1e-12)
        if link.inertial is None:
            continue
        joint = robot.parent_joint(link.name)
        if joint is not None and not joint.moves:
            own = model.frames[model.getFrameId(joint.name, pin.FrameType.FIXED_JOINT)].inertia
            assert own.mass == link.mass
            if link.mass > 0:
                np.testing.assert_allclose(own.lever, link.inertial.com, rtol=0, atol=1e-12)
        # Pinocchio lumps links that fixed joints hold together: compare mass and first moment of each lump
        masses[body.parentJoint] += link.mass
        moments[body.parentJoint] += link.mass * body.placement.act(np.array(link.inertial.com))
    for mass, moment, lump in zip(masses, moments, model.inertias, strict=True):
        assert lump.mass == pytest.approx(mass, rel=1e-12, abs=0)
        np.testing.assert_allclose(lump.mass * lump.lever, moment, rtol=0, atol=1e-12 * max(1.0, mass))


@pytest.mark.parametrize("arm", ["ur5", "panda", "xarm7", "so101", "tiago"])
def test_yourdfpy_agrees(shipped, arm):
    import yourdfpy

    path = shipped / ARMS[arm]
    robot = read(path)
    other = yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=True)
    values = random_values(robot, 5)
    # yourdfpy couples mimic joints itself: give both the coupled values
    for joint in robot.joints:
        if joint.mimic is not None:
            values[joint.name] = joint.mimic.multiplier * values[joint.mimic.joint] + joint.mimic.offset
    other.update_cfg({name: values[name] for name in other.actuated_joint_names})
    for name, pose in robot.link_poses(values).items():
        np.testing.assert_allclose(other.get_transform(name, robot.root), pose, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("arm", "base"), [("ur5", "ee_link"), ("tiago", "torso_lift_link"), ("pr2", "l_gripper_tool_frame")]
)
def test_another_root_in_pinocchio(shipped, arm, base):
    robot = read(shipped / ARMS[arm])
    model = pin.buildModelFromXML(canonical(rerooted(robot, base)))
    data = model.createData()
    values = random_values(robot, 11)
    q = np.zeros(model.nq)
    for name, value in values.items():
        q[model.joints[model.getJointId(name)].idx_q] = value
    pin.framesForwardKinematics(model, data, q)
    poses = robot.link_poses(values)
    for link in robot.links:
        expected = np.linalg.inv(poses[base]) @ poses[link.name]
        found = data.oMf[model.getFrameId(link.name, pin.FrameType.BODY)].homogeneous
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_what_is_refused_among_all_shipped_files(shipped):
    refused = {}
    for path in sorted(shipped.glob("*/*/*.urdf")):
        try:
            read(path)
        except UrdfError as problem:
            refused[path.stem] = {found.code for found in problem.findings if found.severity == "error"}
    assert refused == {
        "alex_psyonic_hands": {"E_MIMIC"},  # mimics joints that are called otherwise
        "iris_simple": {"E_NO_DOF"},
        "quadrotor_base": {"E_NO_DOF"},
        "romeo_laas_small": {"E_INERTIA_PD", "E_INERTIA_TRIANGLE"},
        "romeo_small": {"E_INERTIA_TRIANGLE"},
        "ur3": {"E_NO_NAME", "E_NO_LINKS"},  # an empty <robot>
    }


@pytest.mark.slow
def test_rounded_right_angles_among_shipped_files(shipped):
    found = {name for name in ARMS if any("W_ANGLE_ROUNDED" in str(one) for one in read(shipped / ARMS[name]).findings)}
    assert found == {"xarm7", "so101", "baxter"}
