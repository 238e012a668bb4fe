"""One test for each numbered equation and reference case; equations 1-17, 20 and 22 are in ``mcpc/``.

Numbers: Table 1 and section 4 of Wei, Jia and Chen (MATEC Web of Conferences 35, 02013, 2015), and reference values that
were worked out for this project with 50-digit arithmetic and finite elements, apart from its code. Lengths in the text
of a case are mm, angles mrad, as they were printed.
"""

import itertools
import warnings

import numpy as np
import pinocchio
import pytest

from precision_pin import Chain, Draw, ErrorModel, Uniform
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.robot import examples
from precision_pin.sources import AxisInstall, Beam, JointCompliance, JointOffset, Length, Mcpc, Payload, axis_install
from support.checks.beam import BEAM_CASES, LENGTH, pure_load
from support.checks.bearings import check_axis_install
from support.checks.common import one_link
from support.oracles import displacements
from support.plain_robot import PlainRobot, chain_of, joint, link, robot

MM = 1e-3
Q = np.radians([-90, 3, 88, -91])
JOINTS = ("joint1", "joint2", "joint3", "joint4")
NOTHING = np.zeros((0, 1))


@pytest.fixture(scope="module")
def paper_arm():
    return Chain.from_urdf(examples.PAPER_SHEET.parent / "4dof.urdf")


def lengths(limits=(0.05, 0.05, 0.25, 0.05, 0.25, 0.05)):
    """a_0 … a_5 of section 4: a_1 moves joint 2 up and the tool out."""
    space = Space(tuple(Draw(f"a{k}", Uniform(limit * MM)) for k, limit in enumerate(limits)))
    return space, [
        Length(joint="joint2", along="z of joint1", parameters=("a0", "a1")),
        Length(joint="joint3", along="x of joint2", parameters=("a2",)),
        Length(joint="joint4", along="x of joint3", parameters=("a4",)),
        Length(frame="tool", along="-z of joint4", parameters=("a1", "a3", "a5")),
    ]


# --- R1: the paper's arm at q = (-90, 3, 88, -91)° ---


def test_r1_tip_pose_and_jacobian_columns(paper_arm):
    axes = [[0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, 0]]
    position = np.array([-274 * MM, -1936.409424072519 * MM, -1787.832254225412 * MM, 1])
    np.testing.assert_allclose(paper_arm.at(Q).pose, np.column_stack([axes, position]), atol=1e-15)
    columns = {
        "joint1": (1936.409424, -274, 0, 0, 0, 1),
        "joint2": (0, 1872.832254, -1936.409424, 1, 0, 0),
        "joint3": (0, 1769.730420, 30.890759, 1, 0, 0),
        "joint4": (0, 0, 0, 1, 0, 0),
    }
    expected = np.array([columns[name] for name in JOINTS]).T * np.array([[MM]] * 3 + [[1]] * 3)
    np.testing.assert_allclose(paper_arm.at(Q).joint_jacobian, expected, atol=6e-10)
    at = ErrorModel(paper_arm, Space(), [JointOffset(joint=name, offset=Uniform(1e-3)) for name in JOINTS]).at(Q)
    np.testing.assert_allclose(at.jacobian, expected, atol=6e-10)
    np.testing.assert_allclose(at.linear(np.eye(4)), expected, atol=6e-10)
    tilt = ErrorModel(paper_arm, Space(), [Mcpc(link="link2", alpha=Uniform(1e-3))]).at(Q)
    expected = [1768.921764 * MM, 14.340052 * MM, -273.624493 * MM, 0, -0.998630, -0.052336]
    np.testing.assert_allclose(tilt.jacobian[:, 0], expected, atol=6e-7)
    np.testing.assert_allclose(tilt.jacobian[:3, 0], expected[:3], atol=6e-10)


def test_r1_length_errors(paper_arm):
    space, sources = lengths()
    at = ErrorModel(paper_arm, space, sources).at(Q)
    s3, c3, s1, c1 = np.sin(np.radians(3)), np.cos(np.radians(3)), np.sin(np.radians(1)), np.cos(np.radians(1))
    expected = np.array(
        [[0, -1, 0, -1, 0, -1], [0, 0, -c3, 0, s1, 0], [1, 1, -s3, 0, -c1, 0], [0] * 6, [0] * 6, [0] * 6]
    )
    np.testing.assert_allclose(at.linear(np.eye(6)), expected, atol=1e-15)
    np.testing.assert_allclose(at.jacobian, expected, atol=1e-15)
    limits = np.array([0.05, 0.05, 0.25, 0.05, 0.25, 0.05])
    d = at.jacobian[:3]
    np.testing.assert_allclose(np.abs(d) @ limits, [0.15, 0.25402, 0.363046], atol=5e-7)
    np.testing.assert_allclose(np.sqrt(d**2 @ limits**2), [0.086603, 0.249696, 0.260100], atol=5e-7)
    corners = np.array(list(itertools.product((-1, 1), repeat=6))).T * limits[:, None]
    assert np.linalg.norm(at.exact(corners * MM)[:3], axis=0).max() / MM == pytest.approx(0.463111, abs=5e-7)


def test_r1_axis_installation(paper_arm):
    sources = [AxisInstall(joint=name, radius=0.1 * MM, span=100 * MM) for name in JOINTS]
    model = ErrorModel(paper_arm, Space(), sources)
    at = model.at(Q)
    by_superposition = at.linear(np.eye(model.space.size))
    covariance = by_superposition @ model.space.covariance @ by_superposition.T
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)[:3]) / MM, [2.623948, 1.360617, 1.439997], atol=5e-7)
    assert np.sqrt(np.trace(covariance[3:, 3:])) == pytest.approx(2e-3, rel=1e-12)
    np.testing.assert_allclose(at.covariance, covariance, atol=1e-18)


# --- R2, eqs 18 and 19: an axis through two points; R3 and eq 21: one beam, EI = 8000, GI = 1000 N·m², EA = 1e6 N ---


def test_eq18_19():
    """The seat's displacement, its covariance (r2), and the line through both points."""
    check_axis_install(axis_install)


@pytest.mark.parametrize(("row", "size", "spread", "expected"), [case[1:] for case in BEAM_CASES])
def test_eq21(row, size, spread, expected):
    """r3: each load alone."""
    gravity, load = pure_load(row, size, spread)
    posture = one_link(length=LENGTH, gravity=gravity).at([0.0]).with_loads([load])
    beam = Beam(link="arm", EI=8000.0, GI=1000.0, EA=1e6)
    total = sum(term.twist for term in beam.terms(posture, LabelledSpace(Space(), beam.label())))
    np.testing.assert_allclose(total, expected, rtol=1e-13, atol=1e-18)


# --- R4 and eq 23: gravity on the paper's arm, payload 1 kg at the tool point ---


@pytest.fixture(scope="module")
def laden_arm(paper_arm):
    return paper_arm.with_payload(1.0)


BEAMS = (Beam(link="link2", EI=8000.0, GI=4000.0), Beam(link="link3", EI=8000.0, GI=1000.0))


def test_r4_load_torque_wrenches_and_own_weight(laden_arm):
    posture = laden_arm.at(Q)
    np.testing.assert_allclose(posture.load_torque, [0, 121.999783, -1.515192, 0], atol=5e-7)
    wrenches = [
        [2.926470, 55.840368, 0, 7.113279, -0.372791, -1.515192],
        [42.176575, -0.736195, 0, -0.124314, -7.121956, 0],
    ]
    np.testing.assert_allclose(posture.link_wrench[2:4], wrenches, atol=5e-7)
    for number, length, expected in ((2, 1.97, (0.364864, 6.962019, 0)), (3, 1.77, (7.758140, -0.135419, 0))):
        (own,) = (load for load in posture.loads if load.link == number and load.along)
        (weight,) = posture.wrench_on([own], np.zeros(3)).values()
        q = posture.link_poses[number][:3, :3].T @ weight[:3] / length
        np.testing.assert_allclose(q, expected, atol=5e-7)


def test_r4_beams(laden_arm):
    at = ErrorModel(laden_arm, Space(), BEAMS).at(Q)
    totals = {target.link: total for target, total in displacements(at.terms, {}).items()}
    for number, expected in (
        (2, (0, 19.05923, 0.09042, 3.50329, -0.09180, 14.28021)),
        (3, (0, -0.19087, 1.39452, -0.22004, -1.57573, -0.15980)),
    ):
        np.testing.assert_allclose(totals[number] / MM, expected, atol=5e-6)


COMPLIANT = [JointCompliance(joint=name, compliance=1e-5) for name in JOINTS]


def test_r4_tip(paper_arm, laden_arm):
    for chain, payload in ((laden_arm, []), (paper_arm, [Payload(at="tool", mass=1.0)])):
        error = ErrorModel(chain, Space(), [*BEAMS, *payload]).at(Q).linear(NOTHING)[:, 0] / MM
        np.testing.assert_allclose(error[:3], [7.687663, 26.051149, -19.987957], atol=5e-7)
        np.testing.assert_allclose(error[3:], [14.120, -5.083, 0.101], atol=5e-4)
        assert np.linalg.norm(error[:3]) == pytest.approx(33.7236, abs=5e-5)
        error = ErrorModel(chain, Space(), [*BEAMS, *payload, *COMPLIANT]).at(Q).linear(NOTHING)[:, 0] / MM
        np.testing.assert_allclose(error[:3], [7.6877, 28.3092, -22.3508], atol=5e-5)
        np.testing.assert_allclose(error[3:], [15.3253, -5.0826, 0.1008], atol=5e-5)
        assert np.linalg.norm(error[:3]) == pytest.approx(36.879, abs=5e-4)


def test_r4_derivative_to_the_payload(paper_arm):
    """∂d/∂payload by superposition: (2.901, 4.533, -3.866) mm/kg."""
    payload = Payload(at="tool", mass=Uniform(0.1, mean=1.0))
    at = ErrorModel(paper_arm, Space(), [*BEAMS, payload, *COMPLIANT]).at(Q)
    slope = at.linear([[1.5]]) - at.linear([[0.5]])
    np.testing.assert_allclose(slope[:3, 0] / MM, [2.901, 4.533, -3.866], atol=5e-4)


def test_r4_the_sheet_says_the_same():
    """At its means the shipped sheet is the reference case with C = 1e-5 rad/(N·m)."""
    model = ErrorModel.load(examples.PAPER_SHEET)
    np.testing.assert_allclose(model.configuration(), Q, atol=1e-15)
    error = model.at().linear(model.space.mean[:, None])[:, 0] / MM
    np.testing.assert_allclose(error, [7.6877, 28.3092, -22.3508, 15.3253, -5.0826, 0.1008], atol=5e-5)


def test_eq23(laden_arm):
    """dθ_i = C_i τ_i, with τ what the load puts on the joint."""
    sources = [JointCompliance(joint=name, compliance=2e-5) for name in JOINTS]
    at = ErrorModel(laden_arm, Space(), sources).at(Q)
    turns = {target.joint: total[0] for target, total in displacements(at.terms, {}).items()}
    expected = 2e-5 * np.array([0, 121.999783, -1.515192, 0])
    np.testing.assert_allclose([turns[k] for k in range(4)], expected, atol=1e-11)


# --- R5: small arms ---


def test_r5_one_joint():
    d = ErrorModel(one_link(), Space(), [JointOffset(joint="hinge", offset=1 * MM)]).at([0.0]).exact(NOTHING)[:3, 0]
    np.testing.assert_allclose(d, [-4.99999958e-7, 9.99999833e-4, 0], atol=5e-13)
    assert d[0] == pytest.approx(-4.99999958e-7, abs=5e-16)


def test_r5_two_joints():
    parts = (
        joint("one", "revolute", "base", "upper"),
        joint("two", "revolute", "upper", "fore", (1, 0, 0)),
        joint("flange", "fixed", "fore", "tool", (0.5, 0, 0)),
    )
    chain = chain_of(robot(*map(link, ("base", "upper", "fore", "tool")), *parts))
    sources = [
        Length(joint="two", parameters=(1 * MM,)),
        Length(frame="tool", parameters=(-0.5 * MM,)),
        JointOffset(joint="one", offset=1 * MM),
        JointOffset(joint="two", offset=-2 * MM),
    ]
    error = ErrorModel(chain, Space(), sources).at(np.radians([30, 60])).linear(NOTHING)[:, 0] / MM
    np.testing.assert_allclose(error, [0.8660254, 0.8660254, 0, 0, 0, -1], atol=5e-8)


# --- R7: arms that ship with example-robot-data ---

ARMS = {
    "ur5": "tool0",
    "ur10": "tool0",
    "panda": "panda_hand_tcp",
    "kinova": "j2s6s200_end_effector",
    "xarm7": "link_eef",
    "z1": "gripperMover",
    "so101": "gripper_frame_link",
    "talos_left_arm": "gripper_left_base_link",
    "tiago": "arm_tool_link",
}


def pinocchio_of(path, chain):
    model = pinocchio.buildModelFromUrdf(str(path))
    assert model.existFrame(chain.tip, pinocchio.FrameType.BODY)
    return model, model.createData(), model.getFrameId(chain.tip, pinocchio.FrameType.BODY)


def full_configuration(model, chain, q):
    full = pinocchio.neutral(model)
    for name, value in {**chain.locked, **dict(zip(chain.joint_names, q, strict=True))}.items():
        entry = model.joints[model.getJointId(name)]
        full[entry.idx_q : entry.idx_q + entry.nq] = [np.cos(value), np.sin(value)] if entry.nq == 2 else [value]
    return full


@pytest.mark.parametrize("name", ARMS)
def test_r7_kinematics_and_gravity_torques(name):
    """Against yourdfpy and Pinocchio, each on its own reading of the file, and the slope of the potential energy."""
    import yourdfpy

    path = examples.example_urdfs()[name]
    chain = Chain.from_urdf(path, tip=ARMS[name])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        other = yourdfpy.URDF.load(str(path), load_meshes=False, build_scene_graph=True)
    model, data, frame = pinocchio_of(path, chain)
    columns = [model.joints[model.getJointId(joint_name)].idx_v for joint_name in chain.joint_names]
    reading = PlainRobot.parse(path.read_text(encoding="utf-8"))
    generator = np.random.default_rng(7)
    for _ in range(3):
        q = generator.uniform(-1.5, 1.5, len(chain.joints))
        posture, full = chain.at(q), full_configuration(model, chain, q)
        other.update_cfg(dict(zip(chain.joint_names, q, strict=True)))
        np.testing.assert_allclose(posture.pose, other.get_transform(chain.tip, chain.base), atol=1e-12)
        pinocchio.framesForwardKinematics(model, data, full)
        np.testing.assert_allclose(posture.pose, data.oMf[frame].homogeneous, atol=1e-12)
        gravity = pinocchio.computeGeneralizedGravity(model, data, full)
        np.testing.assert_allclose(posture.load_torque, -gravity[columns], atol=1e-9)
        values = dict(chain.locked) | dict(zip(chain.joint_names, q, strict=True))
        np.testing.assert_allclose(posture.load_torque, reading.load_torque(chain.joint_names, values), atol=1e-9)
        basis = [sum(posture.torque_on(k).values()) for k in range(len(q))]
        np.testing.assert_allclose(posture.load_torque, basis, atol=1e-9)
