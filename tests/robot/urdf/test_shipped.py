"""The arms of example-robot-data: our reading against Pinocchio and against yourdfpy."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from precision_pin.base.errors import UrdfError
from precision_pin.robot.urdf import canonical, read, rerooted

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


def test_rounded_right_angles_among_shipped_files(shipped):
    found = {name for name in ARMS if any("W_ANGLE_ROUNDED" in str(one) for one in read(shipped / ARMS[name]).findings)}
    assert found == {"xarm7", "so101", "baxter"}
