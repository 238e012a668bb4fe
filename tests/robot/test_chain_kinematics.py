"""Kinematics of a chain against a second reading of the URDF: any base and tip, places, values, what is refused."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from precision_pin.base.errors import InputError, InternalError, UnknownNameError
from precision_pin.robot import pinocchio_model
from precision_pin.robot.chain import Chain
from precision_pin.robot.urdf import Robot, canonical, parse
from support.plain_robot import (
    PlainRobot,
    chain_of,
    geometric_jacobian,
    joint,
    limits,
    link,
    random_arm,
    robot,
    unit,
)

ARM = random_arm(31, prismatic=(4,))
READING = PlainRobot.parse(ARM)
Q = dict(zip((f"joint{k}" for k in range(1, 8)), (0.3, -0.7, 1.1, 0.2, -1.3, 0.8, 2.5), strict=True))
FINGER = {"finger_joint": 0.07}


def chain_between(base: str, tip: str, **settings) -> tuple[Chain, dict[str, float], dict[str, float]]:
    """Return a chain, its values, and those of every joint of the arm, which the others are locked at."""
    everything = Q | FINGER
    probe = chain_of(ARM, base=base, tip=tip)
    own = {name: everything[name] for name in probe.joint_names}
    still = {name: value for name, value in everything.items() if name not in own}
    return chain_of(ARM, base=base, tip=tip, locked=still, **settings), own, everything


LINKS = ("base", "link1", "half2", "link6", "bracket", "tool", "finger")
PAIRS = [pair for pair in itertools.permutations(LINKS, 2) if set(pair) != {"link1", "bracket"}][
    ::4
]  # those are bolted


@pytest.mark.fast(4)
@pytest.mark.parametrize("ends", PAIRS, ids="-".join)
def test_any_base_and_tip(ends):
    """Pose, Jacobian and every link's place, from links that are not the root as well, up the tree and down."""
    base, tip = ends
    chain, own, everything = chain_between(base, tip)
    posture = chain.at(own)
    poses = READING.poses(everything, base)
    np.testing.assert_allclose(posture.pose, poses[tip], atol=1e-13)
    expected = geometric_jacobian(READING, chain.joint_names, tip, everything, base)
    np.testing.assert_allclose(posture.joint_jacobian, expected, atol=1e-13)
    for name in READING.masses:
        where = chain.link_frame(name)
        np.testing.assert_allclose(posture.link_poses[where.link] @ where.frame, poses[name], atol=1e-13)


def test_a_joint_locked_on_the_chain_is_a_rigid_piece_of_it():
    for name in ("joint2", "joint4", "joint7"):
        chain = chain_of(ARM, tip="tool", locked={name: Q[name]})
        assert name not in chain.joint_names
        others = {key: value for key, value in Q.items() if key != name}
        np.testing.assert_allclose(chain.at(others).pose, READING.poses(Q)["tool"], atol=1e-13)


def hinge(*more: str, kind: str = "revolute", **settings) -> str:
    """Return a robot of a base and an arm that turns or slides, and what hangs on them."""
    return robot(link("base"), joint("j", kind, "base", "arm", **settings), link("arm"), *more)


FLANGE = (joint("flange", "fixed", "arm", "tool", (1, 0, 0)), link("tool"))


def test_a_continuous_joint_comes_round():
    text = hinge(*FLANGE, kind="continuous")
    chain = chain_of(text)
    np.testing.assert_allclose(chain.at([0.4 + 6 * np.pi]).pose, chain.at([0.4]).pose, atol=1e-14)
    assert chain.at([100.0]).findings == ()
    limited = text.replace("</joint>", '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>', 1)
    assert chain_of(limited).at([100.0]).findings == ()


# --- places ---


def test_ends_and_seats_stand_at_the_next_origin_before_it_turns():
    chain = chain_of(ARM, tip="tool")
    posture = chain.at(Q)
    poses = READING.poses(Q)
    origins = {entry.name: poses[entry.parent] @ entry.origin for entry in READING.joints}
    for number in range(7):
        for place in (chain.end(number), chain.seat(number)):
            np.testing.assert_allclose(posture.place_pose(place), origins[f"joint{number + 1}"], atol=1e-13)
    np.testing.assert_allclose(posture.place_pose(chain.end(7)), poses["tool"], atol=1e-13)
    assert chain.end(3).order < chain.seat(3).order
    assert chain.frame_place("tool") == chain.end(7)
    assert chain.frame_place("half2").order < chain.end(2).order
    np.testing.assert_allclose(posture.place_pose(chain.frame_place("half2")), poses["half2"], atol=1e-13)


@pytest.mark.parametrize(
    "axis", [(0, 0, 1), (0, 0, -1), (1, 0, 0), unit((1, 2, 3)), unit((1e-9, 0, -1)), unit((1e-9, 1e-9, 1))]
)
def test_the_smallest_rotation_that_brings_z_onto_the_axis(axis):
    chain = chain_of(hinge(axis=axis))
    turn = chain.axis_alignment(0)
    np.testing.assert_allclose(turn @ (0, 0, 1), axis, atol=1e-15)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1)
    angle = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))
    assert angle == pytest.approx(np.arctan2(np.hypot(axis[0], axis[1]), axis[2]), abs=3e-8)
    if tuple(axis) == (0, 0, -1):
        np.testing.assert_array_equal(turn, np.diag([1, -1, -1]))


# --- values in, and what is refused ---


def test_values_by_name_or_in_order():
    chain = chain_of(ARM, tip="tool")
    by_name = dict(reversed(list(Q.items())))
    np.testing.assert_array_equal(chain.at(by_name).q, list(Q.values()))
    np.testing.assert_array_equal(chain.at(list(Q.values())).pose, chain.at(by_name).pose)


@pytest.mark.parametrize(
    ("q", "message"),
    [
        ([0.0] * 6, "6 joint values for 7 joints; expected joint1, joint2"),
        ([[0.0] * 7], "7 joint values for 7 joints|expected joint1"),
        ([0.0] * 6 + [float("nan")], "joint values must be finite"),
        ({name: 0.0 for name in Q if name != "joint3"}, "no value for the joints joint3"),
        (Q | {"joint_3": 0.0}, "no joint on the chain named 'joint_3'; did you mean 'joint3'"),
        ([[0.0], [0.0, 1.0]], "joint values must be numbers"),
        (Q | {"joint3": "1.0 kg"}, "the joint value of joint3: 'kg' in '1.0 kg' is not a unit of angle"),
        (Q | {"joint3": "far"}, "the joint value of joint3 must be finite, in rad or with a unit, got 'far'"),
    ],
)
def test_wrong_joint_values_are_refused(q, message):
    with pytest.raises(InputError, match=message):
        chain_of(ARM, tip="tool").at(q)


def test_a_joint_slides_within_reason_and_turns_at_will():
    chain = chain_of(ARM, tip="tool")  # the fourth joint slides
    for q in ([0, 0, 0, 1e308, 0, 0, 0], [0, 0, 0, -1.1e6, 0, 0, 0]):
        for call in (lambda q=q: chain.at(q), lambda q=q: chain.at_many(np.array([np.zeros(7), q]).T)):
            with pytest.raises(InputError, match=r"joint value .* m of joint4; it slides 1,000,000 m at most"):
                call()
    assert np.isfinite(chain.at([0, 1e15, 0, 0, 0, 0, 0]).pose).all()


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({}, InputError, "2 leaves; name one as the tip: bracket, finger"),
        ({"tip": "tol"}, UnknownNameError, "no link named 'tol'; did you mean 'tool'"),
        ({"tip": "tool", "base": "link"}, UnknownNameError, "no link named 'link'; did you mean"),
        ({"tip": "bracket", "base": "link1"}, InputError, "no joint moves between 'link1' and 'bracket'"),
        ({"tip": "tool", "gravity": (0, 0)}, InputError, "gravity must be three finite numbers"),
        ({"tip": "tool", "gravity": "down"}, InputError, "gravity must be three finite numbers.*'down'"),
        ({"tip": "tool", "locked": {"finger": 0.0}}, UnknownNameError, "no joint to lock named 'finger'"),
        ({"tip": "tool", "locked": {"finger_joint": float("nan")}}, InputError, "must be a finite number, got nan"),
        ({"tip": "tool", "locked": {f"joint{k}": 0.0 for k in range(1, 8)}}, InputError, "no joint moves"),
    ],
)
def test_wrong_chains_are_refused(settings, error, message):
    with pytest.raises(error, match=message):
        chain_of(ARM, **settings)


def test_the_only_leaf_is_the_tip_and_values_outside_the_limits_are_warned_about():
    chain = chain_of(hinge(extra=limits(-1, 2)))
    assert chain.tip == "arm"
    assert chain.at([1.9]).findings == ()
    (finding,) = chain.at([2.1]).findings
    assert (finding.severity, finding.code) == ("warning", "W_JOINT_LIMIT")
    assert "joint j at 120.321 deg is outside its limits -57.2958 to 114.592 deg" in finding.message
    with pytest.raises(InputError, match="'finger' is not on the path from 'base' to 'tool'"):
        chain_of(ARM, tip="tool").frame_place("finger")


def test_mimic_joints():
    """Off the chain they follow the joint that they mimic; on it they must be locked."""
    mimic = '<mimic joint="left" multiplier="-2" offset="0.01"/>'
    text = hinge(
        joint("left", "prismatic", "arm", "one", axis=(0, 1, 0)), link("one", 1.0),
        joint("right", "prismatic", "arm", "two", axis=(0, 1, 0), extra=mimic), link("two", 1.0), *FLANGE,
    )  # fmt: skip
    chain = chain_of(text, tip="tool", locked={"left": 0.03})
    assert chain.locked == pytest.approx({"left": 0.03, "right": -0.05})
    assert chain.link_frame("two").frame[1, 3] == pytest.approx(-0.05)
    with pytest.raises(InputError, match="'right' on the chain mimics 'left'; lock it"):
        chain_of(text, tip="two")
    assert chain_of(text, tip="two", locked={"right": 0.2}).at([0.0]).pose[1, 3] == pytest.approx(0.2)


def test_a_joint_off_the_chain_stands_at_the_limit_nearest_to_zero():
    grip = joint("grip", "prismatic", "arm", "finger", axis=(0, 1, 0), extra=limits(0.02, 0.04))
    assert chain_of(hinge(grip, link("finger", 1.0), *FLANGE), tip="tool").locked == {"grip": 0.02}


def test_a_mimic_of_a_joint_on_the_chain_stands_still_and_says_so():
    mimic = '<mimic joint="j" multiplier="2" offset="0.1"/>'
    text = hinge(joint("k", "revolute", "base", "rod", (0, 0.1, 0), extra=mimic), link("rod", 1.0, (0.3, 0, 0)))
    chain = chain_of(text, tip="arm")
    assert chain.locked == {"k": 0.1}
    assert chain.at([0.0]).findings == ()
    (finding,) = chain.at([0.5]).findings
    assert (finding.severity, finding.code) == ("warning", "W_MIMIC")
    assert "joint k mimics j, so it would be at 63.0254 deg here, but it is locked at 5.72958 deg" in finding.message
    assert chain_of(text, tip="arm", locked={"k": 1.1}).at([0.5]).findings == ()


# --- the second look at what Pinocchio loaded ---


def changed(read: Robot, where: str, name: str, **changes) -> Robot:
    """Return the robot with a joint, or a link's inertia, changed."""
    if where == "joint":
        joints = [replace(entry, **changes) if entry.name == name else entry for entry in read.joints]
        return replace(read, joints=tuple(joints))
    links = [
        replace(entry, inertial=replace(entry.inertial, **changes)) if entry.name == name else entry
        for entry in read.links
    ]
    return replace(read, links=tuple(links))


@pytest.mark.parametrize(
    ("where", "name", "changes", "message"),
    [
        ("link", "half2", {"mass": 0.6999}, "lost mass of the link 'half2'"),
        ("link", "base", {"mass": 2.9}, "lost mass of the link 'base'"),
        ("link", "link5", {"com": (0.1, 0.1, 0.1)}, "lost mass of the link 'link5'"),
        ("joint", "joint3", {"kind": "fixed"}, "loaded the joints"),
        ("joint", "split2", {"rpy": (0.1, 0.2, 0.3)}, "places the link"),
        ("joint", "finger_joint", {"axis": (1.0, 0.0, 0.0)}, "places the link 'finger'"),
        ("joint", "joint5", {"kind": "prismatic"}, "places the link"),
    ],
)
def test_a_difference_to_our_own_reading_is_noticed(monkeypatch, where, name, changes, message):
    read = parse(ARM.encode(), "arm.urdf")
    links = {f"link{k:06d}": name for k, name in enumerate(sorted(link.name for link in read.links))}
    joints = {f"joint{k:06d}": name for k, name in enumerate(sorted(joint.name for joint in read.joints))}

    def other(robot: Robot) -> str:
        """Return the text of the changed robot, with the names that Pinocchio gets to see."""
        assert {joints[joint.name]: links[joint.child] for joint in robot.joints} == {
            joint.name: joint.child for joint in read.joints
        }
        text = canonical(changed(read, where, name, **changes))
        for part, names in (("link name", links), ("link", links), ("joint name", joints)):
            for new, old in names.items():
                text = text.replace(f'{part}="{old}"', f'{part}="{new}"')
        return text

    monkeypatch.setattr(pinocchio_model, "canonical", other)
    with pytest.raises(InternalError, match=message):
        Chain.from_robot(read, tip="tool")
