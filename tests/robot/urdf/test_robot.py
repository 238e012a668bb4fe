"""A robot as a tree, its canonical text, and another root: by hand, against Pinocchio, and changed in every way.

Changed robots: findings or a robot whatever the bytes, and a share of ``python -m fuzzing urdfs``.
"""

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from fuzzing.robots.bases import base_robots
from fuzzing.robots.mutations import mutant
from fuzzing.robots.trial import try_robot

from precision_pin.base import se3
from precision_pin.base.errors import InputError, UnknownNameError, UrdfError
from precision_pin.robot.chain import Chain
from precision_pin.robot.urdf import Inertial, canonical, likeliest_tip, parse, read, rerooted, rpy_of, snapped

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


def test_tree_and_unknown_names_that_bring_the_nearest(robot):
    assert (robot.root, robot.leaves) == ("foot", ("tip", "hook"))
    assert (robot.parent_joint("foot"), robot.parent_joint("hook").name) == (None, "hinge")
    for joints, names in (
        (robot.child_joints("upper"), ["elbow", "hinge"]),
        (robot.child_joints("tip"), []),
        (robot.path("foot", "tip"), ["shoulder", "elbow", "slide", "flange"]),
        (robot.path("fore", "fore"), []),
        (robot.moving_joints, ["shoulder", "elbow", "slide", "hinge"]),
    ):
        assert [joint.name for joint in joints] == names
    for call, error, message in (
        (lambda: robot.link("tipp"), UnknownNameError, "'tip'"),
        (lambda: robot.joint("Elbow"), UnknownNameError, "'elbow'"),
        (lambda: robot.path("foot", "tp"), UnknownNameError, "'tip'"),
        (lambda: robot.link_poses({"wrist": 1.0}), UnknownNameError, "wrist"),
        (lambda: robot.path("fore", "hook"), InputError, "foot, upper, hook"),
    ):
        with pytest.raises(error, match=message):
            call()


def relative_poses(robot, values):
    poses = robot.link_poses(values)
    return {name: {other: se3.inverse(poses[name]) @ poses[other] for other in poses} for name in poses}


@pytest.mark.parametrize("base", ["foot", "ram", "tip", "hook"])
def test_another_root_is_the_same_mechanism(robot, base):
    turned = rerooted(robot, base)
    assert turned.root == base
    assert {link.name for link in robot.links} <= {link.name for link in turned.links}
    assert [joint.name for joint in turned.moving_joints] == [joint.name for joint in robot.moving_joints]
    assert sum(link.mass for link in turned.links) == sum(link.mass for link in robot.links)
    rng = np.random.default_rng(7)
    for _ in range(5):
        values = {joint.name: rng.uniform(-3, 3) for joint in robot.moving_joints}
        before, after = relative_poses(robot, values), relative_poses(turned, values)
        worst = max(np.abs(before[a][b] - after[a][b]).max() for a in before for b in before)
        assert worst < 1e-14


def test_joints_turned_round_are_marked_and_know_their_axis(robot):
    """What lies between the old root and the new one; turned round twice, a joint is as the file has it."""
    turned = rerooted(robot, "tip")
    between = {joint.name for joint in robot.path("foot", "tip")}
    assert {joint.name for joint in turned.joints if joint.reversed and joint.name in between} == between
    assert not any(joint.reversed for joint in turned.joints if joint.name in {j.name for j in robot.joints} - between)
    for joint in robot.moving_joints:
        np.testing.assert_array_equal(turned.joint(joint.name).written_axis, joint.axis)
    back = rerooted(turned, "foot")
    assert not any(joint.reversed for joint in back.joints)
    values = {"shoulder": 0.4, "elbow": -1.1, "slide": 0.1, "hinge": 0.9}
    for name, pose in robot.link_poses(values).items():
        np.testing.assert_allclose(back.link_poses(values)[name], pose, atol=1e-14)
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
        for _ in range(8):
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


def test_canonical_text_is_complete_and_reads_back_the_same(robot):
    text = canonical(robot)
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
    turned = Inertial(1, (0, 0, 0), (0, 0, math.pi / 2), (1, 0, 0, 2, 0, 3))
    np.testing.assert_allclose(turned.tensor, np.diag([2, 1, 3]), atol=1e-15)
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
    shared = parse(arm.replace('"fore"', '"elbow"').encode(), "arm.urdf")
    assert [found.code for found in shared.findings] == ["W_NAME_SHARED"]
    assert pin.buildModelFromXML(canonical(shared)).nq == 3
    model = pin.buildModelFromXML(canonical(odd))
    assert list(model.names)[1:] == [joint.name for joint in odd.moving_joints]


ARMS = {
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "pr2": "pr2_description/urdf/pr2.urdf",
    "baxter": "baxter_description/urdf/baxter.urdf",
    "double_pendulum_continuous": "double_pendulum_description/urdf/double_pendulum_continuous.urdf",
}


@pytest.mark.fast(2)
@pytest.mark.parametrize("arm", ARMS)
def test_pinocchio_agrees(shipped, arm):
    """Poses, masses and first moments of every link, which the chain compares when it loads the canonical text."""
    robot = read(shipped / ARMS[arm])
    chain = Chain.from_robot(robot, likeliest_tip(robot))
    assert chain.pinocchio.model.nq == len(chain.joints)


@pytest.mark.slow
def test_what_is_refused_and_rounded_among_all_shipped_files(shipped):
    refused, rounded = {}, set()
    for path in sorted(shipped.glob("*/*/*.urdf")):
        try:
            if any("W_ANGLE_ROUNDED" in str(one) for one in read(path).findings):
                rounded.add(path.stem)
        except UrdfError as problem:
            refused[path.stem] = {found.code for found in problem.findings if found.severity == "error"}
    assert rounded >= {"xarm7", "so101", "baxter"}
    assert not rounded & {"ur5_robot", "panda", "kinova", "z1", "pr2", "tiago"}
    assert refused == {
        "alex_psyonic_hands": {"E_MIMIC"},  # mimics joints that are called otherwise
        "iris_simple": {"E_NO_DOF"},
        "quadrotor_base": {"E_NO_DOF"},
        "romeo_laas_small": {"E_INERTIA_PD", "E_INERTIA_TRIANGLE"},
        "romeo_small": {"E_INERTIA_TRIANGLE"},
        "ur3": {"E_NO_NAME", "E_NO_LINKS"},  # an empty <robot>
    }


# --- changed robots ---


SEED = 15


@pytest.mark.slow
def test_changed_robots_are_refused_or_read_as_others_read_them(tmp_path):
    trials = {f"{SEED}/{number}": mutant(SEED, number) for number in range(60)}
    as_they_are = {str(number): text.encode() for number, text in enumerate(base_robots())}
    problems = {}
    for name, data in (trials | as_they_are).items():
        outcome = try_robot(data, name, tmp_path)
        if outcome.problems or (name in as_they_are and not outcome.loaded):
            problems[name] = outcome.problems
    assert problems == {}


def test_a_changed_robot_is_made_again_from_seed_and_number():
    assert mutant(3, 7) == mutant(3, 7)
    assert len({mutant(3, number) for number in range(20)}) > 17


def test_a_trial_sees_what_does_not_hold(tmp_path, monkeypatch):
    """A reader that takes the wrong sign of an axis, and one that loses a mass, are found out."""
    from fuzzing.robots import second_reading, trial

    text = base_robots()[3].encode()
    assert try_robot(text, "0", tmp_path).problems == []
    real = second_reading.PlainReading.of
    plain = real(text)
    joint = plain.joints["joint2"]
    turned = {**plain.joints, "joint2": second_reading.PlainJoint(**{**vars(joint), "axis": -joint.axis})}
    links = {**plain.links, "link2": None}
    for other in (second_reading.PlainReading(plain.links, turned), second_reading.PlainReading(links, plain.joints)):
        monkeypatch.setattr(trial.PlainReading, "of", lambda data, other=other: other)
        problems = " ".join(try_robot(text, "0", tmp_path).problems)
        assert ("differ by" in problems) == (other.links == plain.links)
        assert "urdfdom" in problems
        assert "load torques" in problems
