"""From chains to MCPC parameters and back (the paper's eqs 1-3 and Table 1)."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import precision_pin
from precision_pin.base.errors import InputError
from precision_pin.robot import mcpc
from precision_pin.robot.chain import Chain
from robot.mcpc import cases

SEEDS = range(8)


def shipped_arm():
    return Chain.from_urdf(str(Path(precision_pin.__file__).parent / "robots" / "4dof.urdf"), tip="tool")


@pytest.mark.parametrize("chain", [cases.paper_arm, shipped_arm])
def test_table_1_of_the_paper(chain):
    """Table 1 with a_1 = 85, a_2 = 1970, a_4 = 1770, a_1+a_3+a_5 = 274 mm. a_0 is in none of its cells."""
    arm = mcpc.from_chain(chain())
    zero = [0.0] * 5
    for got, expected in (
        (arm.alpha, [0, -np.pi / 2, 0, 0, 0]),
        (arm.beta, zero),
        (arm.x, [0, 0, 1.970, 1.770, 0]),
        (arm.y, [0, -0.085, 0, 0, 0]),
        (arm.joint_offset, zero[:4]),
        (arm.joint_shift, zero[:4]),
        ([arm.gamma, arm.z, arm.base_turn], [0, -0.274, 0]),
    ):
        np.testing.assert_allclose(got, expected, rtol=0, atol=4e-16)


def test_table_rows_are_laid_out_as_table_1_and_show_turns_and_slides():
    rows = mcpc.from_chain(cases.paper_arm()).table
    assert [row.link for row in rows] == [0, 1, 2, 3, 4]
    assert [row.joint for row in rows] == [None, "joint1", "joint2", "joint3", "joint4"]
    assert [row.gamma for row in rows] == [None, None, None, None, 0.0]
    assert [row.z for row in rows] == [None, None, None, None, pytest.approx(-0.274, abs=1e-15)]
    assert (rows[1].alpha, rows[1].y, rows[2].x) == pytest.approx((-np.pi / 2, -0.085, 1.970), abs=1e-15)
    assert not any(str(value) == "-0.0" for row in rows for value in dataclasses.astuple(row))
    arm = cases.random_mcpc(3, 4)
    assert [row.turn for row in arm.table] == [arm.base_turn, *arm.joint_offset]
    assert [row.shift for row in arm.table] == [0.0, *arm.joint_shift]
    assert [row.prismatic for row in arm.table] == [False, *arm.prismatic.tolist()]
    with pytest.raises(ValueError, match="read-only"):
        arm.alpha[1] = 0.0


@pytest.mark.fast(5)
@pytest.mark.parametrize("seed", SEEDS)
def test_eq3_forward_kinematics_is_pinocchios_on_random_chains(seed):
    """And the ranges of what is chosen by sign."""
    chain = cases.random_chain(seed)
    q = cases.random_values(chain, np.random.default_rng(seed))
    arm = mcpc.from_chain(chain)
    np.testing.assert_allclose(arm.forward_kinematics(q), cases.pinocchio_tip(chain, q), rtol=0, atol=2e-14)
    assert np.all((arm.alpha > -np.pi) & (arm.alpha <= np.pi))
    assert np.all((arm.joint_offset > -np.pi / 2) & (arm.joint_offset <= np.pi / 2))
    assert -np.pi < arm.gamma <= np.pi
    assert np.abs(arm.beta[1:]).max() < 1e-11
    assert abs(np.cos(arm.beta[0])) > 0.1
    assert arm.base_turn in (0.0, np.pi / 2)


@pytest.mark.fast(8)
@pytest.mark.parametrize("seed", SEEDS)
def test_frame_in_link_has_its_axis_on_the_joints_and_stands_where_the_partial_products_lead(seed):
    """The z axis along the joint's, the origin on it and in the plane through the one before, normal to z.

    Frame i after Q_i, by eqs 1-3 from the base, against Pinocchio's joint frame times frame_in_link.
    """
    chain = cases.random_chain(seed)
    arm = mcpc.from_chain(chain)
    for i, axis in enumerate(chain.axes, start=1):
        frame = arm.frame_in_link[i]
        np.testing.assert_allclose(frame[:3, 2], axis, rtol=0, atol=1e-14)
        np.testing.assert_allclose(np.cross(frame[:3, 3], axis), 0, rtol=0, atol=1e-14)
        joint_before = chain.placements[i - 1] @ frame
        before = arm.frame_in_link[i - 1][:3, 3]
        assert abs((joint_before[:3, 3] - before) @ joint_before[:3, 2]) < 1e-13
    q = cases.random_values(chain, np.random.default_rng(seed))
    model, _ = cases.pinocchio_model(chain)
    data = model.createData()
    cases.pin.forwardKinematics(model, data, q)
    after = arm.forward_kinematics(q)
    links = cases.literal_links(arm, q, np.zeros(5 * len(q) + 6))
    for i in range(len(q), 0, -1):
        after = after @ np.linalg.inv(links[i]) @ arm.joint_pose(i, q[i - 1])
        np.testing.assert_allclose(data.oMi[i].homogeneous @ arm.frame_in_link[i], after, rtol=0, atol=1e-13)
        after = after @ np.linalg.inv(arm.joint_pose(i, q[i - 1]))
    np.testing.assert_allclose(after @ np.linalg.inv(arm.link_pose(0)), arm.frame_in_link[0], rtol=0, atol=1e-13)


Z = (0, 0, 1)


@pytest.mark.parametrize(
    ("second", "expected"),
    [
        # parallel, 0.3 along x and 0.4 along y: the turn makes y_1 = 0
        (cases.pose((0.3, 0.4, 0.2)), {"offset": np.arctan2(4, 3), "alpha": 0, "x": 0.5, "y": 0}),
        # parallel, behind: the offset stays in (-90°, 90°], so x_1 is negative
        (cases.pose((-0.3, -0.4, 0)), {"offset": np.arctan2(4, 3), "alpha": 0, "x": -0.5, "y": 0}),
        # parallel along -y: the tie goes to +90°
        (cases.pose((0, -0.5, 0)), {"offset": np.pi / 2, "alpha": 0, "x": -0.5, "y": 0}),
        # antiparallel: α is +180°, and y_1 = 0
        (cases.pose((0.3, 0.4, 0), (np.pi, 0, 0)), {"offset": np.arctan2(4, 3), "alpha": np.pi, "x": 0.5, "y": 0}),
        # coincident
        (cases.pose((0, 0, 0.7)), {"offset": 0, "alpha": 0, "x": 0, "y": 0}),
        # coincident but for 1e-10 m: the direction of so small a distance does not choose the turn
        (cases.pose((6e-11, 8e-11, 0.7)), {"offset": 0, "alpha": 0, "x": 6e-11, "y": 8e-11}),
        # along +y: Rot(x, -90°) brings z there; the height 0.2 shows as y = -0.2
        (cases.pose((0, 0, 0.2), (-np.pi / 2, 0, 0)), {"offset": 0, "alpha": -np.pi / 2, "x": 0, "y": -0.2}),
        # along +x: after a turn of +90° that is the -y direction, hence α = +90°
        (cases.pose((0, 0, 0.2), (0, np.pi / 2, 0)), {"offset": np.pi / 2, "alpha": np.pi / 2, "x": 0, "y": 0.2}),
        # 45° down the diagonal (1, 1): after a turn of -45° it lies in +y
        (
            cases.pose((0, 0, 0), (-np.pi / 4, 0, -np.pi / 4)),
            {"offset": -np.pi / 4, "alpha": -np.pi / 4, "x": 0, "y": 0},
        ),
    ],
)
def test_offset_and_parameters_by_hand(second, expected):
    chain = cases.stand_in([np.eye(4), second, np.eye(4)], [Z, Z])
    arm = mcpc.from_chain(chain)
    got = {"offset": arm.joint_offset[0], "alpha": arm.alpha[1], "x": arm.x[1], "y": arm.y[1]}
    assert got == pytest.approx(expected, rel=0, abs=1e-15)


def test_last_joint_turns_for_a_slanted_tip_only_and_half_a_turn_is_positive():
    tilted = cases.stand_in([np.eye(4), cases.pose((0, 0, 0), (0, 0.3, 0))], [Z])
    arm = mcpc.from_chain(tilted)
    # the tip's z leans to +x by 0.3: after +90° that is -y, α = +0.3, and γ = -90° undoes the turn
    assert (arm.joint_offset[0], arm.alpha[1], arm.gamma) == pytest.approx((np.pi / 2, 0.3, -np.pi / 2), abs=1e-15)
    straight = mcpc.from_chain(cases.stand_in([np.eye(4), cases.pose((0.3, 0.4, 0), (0, 0, 0.2))], [Z]))
    assert (straight.joint_offset[0], straight.alpha[1], straight.gamma) == pytest.approx((0, 0, 0.2), abs=1e-15)
    for yaw in (np.pi, -np.pi):
        turned = mcpc.from_chain(cases.stand_in([np.eye(4), cases.pose((0.1, 0, 0), (0, 0, yaw))], [Z]))
        assert turned.gamma == pytest.approx(np.pi, rel=0, abs=1e-15)


@pytest.mark.parametrize(
    ("roll", "turn"),
    [((0, np.pi / 2, 0), np.pi / 2), ((0, -1.5, 0), np.pi / 2), ((0, 1.4, 0), 0.0)],
)
def test_base_turns_where_link_0_is_nearly_singular(roll, turn):
    chain = cases.stand_in([cases.pose((0.1, 0.2, 0.3), roll), cases.pose((0.4, 0, 0))], [Z])
    arm = mcpc.from_chain(chain)
    assert arm.base_turn == turn
    assert abs(np.cos(arm.beta[0])) > 0.1
    np.testing.assert_allclose(arm.forward_kinematics([0.7]), cases.pinocchio_tip(chain, [0.7]), rtol=0, atol=1e-15)
    np.testing.assert_allclose(arm.frame_in_link[0], cases.rot("z", turn), rtol=0, atol=1e-15)


def test_a_chain_without_joints_and_a_tilt_on_either_side_of_parallel_lose_nothing():
    placement = cases.random_pose(np.random.default_rng(1))
    arm = mcpc.from_chain(cases.stand_in([placement], []))
    assert len(arm.parameter_names) == 6
    np.testing.assert_allclose(arm.forward_kinematics([]), placement, rtol=0, atol=1e-15)
    for tilt in (1e-8, 1e-12):
        placements = [np.eye(4), cases.pose((0.3, 0.4, 0), (tilt, -tilt, 0)), cases.pose((1, 0, 0), (0, tilt, 0))]
        chain = cases.stand_in(placements, [Z, Z])
        got = mcpc.from_chain(chain).forward_kinematics([0.3, 0.4])
        np.testing.assert_allclose(got, cases.pinocchio_tip(chain, [0.3, 0.4]), rtol=0, atol=1e-15)


@pytest.mark.fast(4)
@pytest.mark.parametrize("seed", range(6))
def test_placements_make_an_equivalent_chain_and_build_the_perturbed_robot(seed):
    """By Pinocchio, at several configurations, against eqs 1-3 read letter by letter."""
    chain = cases.random_chain(seed)
    arm = mcpc.from_chain(chain)
    generator = np.random.default_rng(seed)
    errors = generator.uniform(-0.4, 0.4, len(arm.parameter_names))
    changed = arm.perturbed(errors)
    placements, axes = mcpc.joint_placements(changed)
    equivalent = cases.stand_in(placements, axes, changed.prismatic)
    built = mcpc.to_placements(arm, changed, chain)
    for _ in range(2):
        q = cases.random_values(chain, generator)
        expected = cases.literal_tip(arm, q, errors)
        np.testing.assert_allclose(cases.pinocchio_tip(equivalent, q), expected, rtol=0, atol=2e-14)
        np.testing.assert_allclose(cases.pinocchio_tip(chain, q, built), expected, rtol=0, atol=1e-13)


def test_joint_placements_turn_the_base():
    arm = cases.random_mcpc(1, 3)
    q = [0.1, -0.2, 0.3]
    got = cases.pinocchio_tip(cases.stand_in(*mcpc.joint_placements(arm), arm.prismatic), q)
    np.testing.assert_allclose(got, arm.forward_kinematics(q), rtol=0, atol=1e-15)


def test_to_placements_touches_only_what_changed_and_moves_the_link_behind():
    chain = cases.random_chain(4)
    arm = mcpc.from_chain(chain)
    assert not chain.prismatic[1]
    np.testing.assert_array_equal(mcpc.to_placements(arm, arm, chain), chain.placements)
    errors = np.zeros(len(arm.parameter_names))
    errors[1] = 0.2
    placements = mcpc.to_placements(arm, arm.perturbed(errors), chain)
    changed = [i for i in range(len(placements)) if not np.array_equal(placements[i], chain.placements[i])]
    assert changed == [1]
    turned = np.eye(4)
    turned[:3, :3] = cases.Rotation.from_rotvec(0.2 * chain.axes[1]).as_matrix()
    np.testing.assert_allclose(placements[1], chain.placements[1] @ turned, rtol=0, atol=1e-14)


def test_to_placements_refuses_another_chain():
    chain, other = cases.random_chain(4), cases.random_chain(12)
    arm = mcpc.from_chain(chain)
    with pytest.raises(InputError, match="do not have the same joints"):
        mcpc.to_placements(arm, mcpc.from_chain(other), chain)
    moved = dataclasses.replace(chain, placements=chain.placements + 1e-6 * (np.arange(4) == 3)[None, None])
    with pytest.raises(InputError, match="placement 0 of the chain"):
        mcpc.to_placements(arm, arm, moved)


TWISTED = np.tile(np.eye(4), (5, 1, 1))
TWISTED[3, 0, 1] = 1e-6


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda arm: arm.forward_kinematics([0, 0, 0]), r"joint values q: shape \(3,\) is not \(4,\)"),
        (lambda arm: arm.jacobian([0, 0, np.nan, 0]), "joint values q must be finite"),
        (lambda arm: arm.perturbed(np.zeros(25)), r"parameter errors: shape \(25,\) is not \(26,\)"),
        (lambda arm: arm.link_matrix(5), r"from 0 to 4, got 5"),
        (lambda arm: arm.parameter_indices(5), r"from 0 to 4, got 5"),
        (lambda arm: dataclasses.replace(arm, x=np.zeros(4)), r"mcpc x: shape \(4,\) is not \(5,\)"),
        (lambda arm: dataclasses.replace(arm, gamma=np.inf), "mcpc gamma must be finite"),
        (lambda arm: dataclasses.replace(arm, prismatic=[True]), "mcpc prismatic: shape"),
        (lambda arm: mcpc.parameter_errors(arm, np.zeros((4, 6))), r"shape \(4, 6\) is not \(5, 6\) or \(5, 4, 4\)"),
        (lambda arm: mcpc.parameter_errors(arm, np.full((5, 6), np.nan)), "mcpc displacements must be finite"),
        (lambda arm: mcpc.parameter_errors(arm, [["x"] * 6] * 5), "mcpc displacements must be numbers"),
        (lambda arm: mcpc.parameter_errors(arm, TWISTED), "number 3 is not a rigid motion"),
        (lambda arm: mcpc.parameter_errors(arm, [np.diag([1, 1, -1, 1])] * 5), "number 0 is not a rigid motion"),
        (lambda arm: mcpc.parameter_errors(arm, np.zeros((5, 6)), chart="dh"), "must be complete or offsets, got 'dh'"),
        (lambda arm: mcpc.frame_displacements(arm, np.zeros(6)), r"shape \(6,\) is not \(26,\)"),
    ],
)
def test_bad_input_gives_one_clear_line(call, message):
    with pytest.raises(InputError, match=message) as caught:
        call(mcpc.from_chain(cases.paper_arm()))
    assert "\n" not in str(caught.value)
