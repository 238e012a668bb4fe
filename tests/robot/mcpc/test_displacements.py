"""Displacements to parameter errors and back: what stands for eqs 20 and 22 of the paper.

Erratum: the paper writes ΔΩ_k = J_k⁻¹ D_k, but J_k is 6×5 and has no inverse.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.linalg import expm

from precision_pin.base.errors import InputError
from precision_pin.robot import mcpc
from robot.mcpc import cases

SEEDS = range(25)
CHARTS = ("complete", "offsets")


def displacement(values):
    """Trans(d)·Exp(δ) by scipy."""
    matrix = cases.trans(*values[:3]).astype(float)
    matrix[:3, :3] = cases.Rotation.from_rotvec(values[3:]).as_matrix()
    return matrix


def random_sixes(seed, count, size):
    generator = np.random.default_rng(1000 + seed)
    return size * generator.uniform(-1, 1, (count, 6))


@pytest.mark.fast(26)
@pytest.mark.parametrize("chart", CHARTS)
@pytest.mark.parametrize("size", [1e-3, 0.5, 2.5])
@pytest.mark.parametrize("seed", SEEDS)
def test_eq20_eq22_parameter_errors_move_the_tip_as_the_displacements_do(seed, size, chart):
    """At any size, at every q, in both charts, from six-vectors and from poses."""
    chain = cases.random_chain(seed)
    arm = mcpc.from_chain(chain)
    sixes = random_sixes(seed, len(chain.placements), size)
    poses = [displacement(values) for values in sixes]
    errors = mcpc.parameter_errors(arm, sixes, chart)
    np.testing.assert_allclose(mcpc.parameter_errors(arm, poses, chart), errors, rtol=0, atol=1e-12)
    generator = np.random.default_rng(seed)
    for _ in range(2):
        q = cases.random_values(chain, generator)
        expected = cases.displaced_tip(arm, q, poses)
        np.testing.assert_allclose(cases.literal_tip(arm, q, errors), expected, rtol=0, atol=5e-14 * (1 + 9 * size))
        np.testing.assert_allclose(arm.perturbed(errors).forward_kinematics(q), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("chart", CHARTS)
def test_eq20_holds_for_parameters_anywhere(seed, chart):
    """Not only extracted ones: β in every cell, offsets, shifts, a base turn, and no joint at all."""
    arm = cases.random_mcpc(seed, seed % 5)
    sixes = random_sixes(seed, seed % 5 + 1, 0.2)
    errors = mcpc.parameter_errors(arm, sixes, chart)
    q = np.random.default_rng(seed).uniform(-3, 3, seed % 5)
    expected = cases.displaced_tip(arm, q, [displacement(values) for values in sixes])
    np.testing.assert_allclose(cases.literal_tip(arm, q, errors), expected, rtol=0, atol=2e-14)


@pytest.mark.fast(10)
@pytest.mark.parametrize("seed", SEEDS)
def test_eq20_which_parameters_each_chart_uses(seed):
    chain = cases.random_chain(seed)
    arm = mcpc.from_chain(chain)
    sixes = random_sixes(seed, len(chain.placements), 0.01)
    joints = len(chain.joint_names)
    assert not mcpc.parameter_errors(arm, sixes, "complete")[:joints].any()
    assert mcpc.parameter_errors(arm, sixes, "offsets")[:joints].all()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, 7, 13, 28, 31, 39])
@pytest.mark.parametrize("chart", CHARTS)
def test_eq20_linearised_is_eq15_with_the_six_vectors_put_straight_in(seed, chart):
    """J_E ∂ΔΩ/∂D = [Ad(U_1⁻¹) … Ad(U_{n+1}⁻¹)]; the derivative by central differences of fourth order."""
    chain = cases.random_chain(seed)
    arm = mcpc.from_chain(chain)
    q = cases.random_values(chain, np.random.default_rng(seed))
    count = len(chain.placements)
    step = 1e-4

    def difference(unit, steps):
        displacements = steps * step * unit.reshape(count, 6)
        return mcpc.parameter_errors(arm, displacements, chart) - mcpc.parameter_errors(arm, -displacements, chart)

    units = np.eye(6 * count)
    derivative = np.column_stack([(8 * difference(u, 1) - difference(u, 2)) / (12 * step) for u in units])
    expected = np.hstack(list(arm.propagation(q)))
    np.testing.assert_allclose(arm.jacobian(q) @ derivative, expected, rtol=0, atol=2e-10)


@pytest.mark.parametrize("chart", CHARTS)
def test_eq15_leaves_an_error_of_second_order(chart):
    """Slope of |exact - linear| over the size: 2."""
    arm = mcpc.from_chain(cases.paper_arm())
    sixes = random_sixes(5, 5, 0.02)
    linear = np.einsum("nij,nj->i", arm.propagation(cases.PAPER_Q), sixes)
    tip = arm.forward_kinematics(cases.PAPER_Q)
    rotation = tip[:3, :3]
    in_base = np.concatenate([rotation @ linear[:3], rotation @ linear[3:]])
    scales = np.array([1, 1 / 2, 1 / 4, 1 / 8])
    left = []
    for scale in scales:
        built = arm.perturbed(mcpc.parameter_errors(arm, scale * sixes, chart)).forward_kinematics(cases.PAPER_Q)
        left.append(np.linalg.norm(cases.pose_error(built, tip) - scale * in_base))
    slopes = np.diff(np.log(left)) / np.diff(np.log(scales))
    np.testing.assert_allclose(slopes, 2, rtol=0, atol=0.05)


def test_eq20_pseudo_inverse_loses_error_and_the_exact_route_none():
    """A 1 mrad tilt of joint 2 about x moves the tip 1.893 mm.

    ω × r with ω = 1 mrad along -y of the base, r = (-274, -1936.4, -1872.8) mm. The least-squares answer for
    α_1, whose column is [0, 0, -a_1; 1, 0, 0], is Δα = 1 mrad/(1 + a_1²): a_1 = 85 loses everything, a_1 = 0.085
    loses 0.098 mm.
    """
    arm = mcpc.from_chain(cases.paper_arm())
    q = cases.PAPER_Q
    tilt = np.array([0, 0, 0, 1e-3, 0, 0])
    true = arm.propagation(q)[1] @ tilt
    assert np.linalg.norm(true[:3]) == pytest.approx(1.893e-3, abs=5e-7)

    lost = {}
    for unit, per_metre in (("mm", 1000.0), ("m", 1.0)):
        scale = np.diag([per_metre] * 3 + [1.0] * 3)
        lengths = np.diag([1.0, 1.0, 1.0, 1 / per_metre, 1 / per_metre])  # θ, α, β rad; x, y in the unit
        guess = lengths @ np.linalg.pinv(scale @ arm.link_matrix(1) @ lengths) @ scale @ tilt
        kept = arm.propagation(q)[1] @ arm.link_matrix(1) @ guess
        lost[unit] = np.linalg.norm((true - kept)[:3])
    assert np.linalg.matrix_rank(arm.link_matrix(1), tol=1e-9) == 4
    assert lost["mm"] == pytest.approx(1.893e-3, abs=1e-6)
    assert lost["m"] == pytest.approx(0.098e-3, abs=5e-7)

    displacements = np.zeros((5, 6))
    displacements[1] = tilt
    exact = cases.pose_error(
        cases.displaced_tip(arm, q, [displacement(values) for values in displacements]), arm.forward_kinematics(q)
    )
    for chart in CHARTS:
        errors = mcpc.parameter_errors(arm, displacements, chart)
        got = cases.pose_error(arm.perturbed(errors).forward_kinematics(q), arm.forward_kinematics(q))
        np.testing.assert_allclose(got, exact, rtol=0, atol=3e-15)
        linear = arm.jacobian(q) @ errors
        np.testing.assert_allclose(linear, true, rtol=0, atol=3e-6)  # second order: 1e-6 rad² times 2 m


def test_eq20_by_hand_on_the_paper():
    """Joint 2 shifted by 1 mm along its own axis: nothing in its own link; it lands in z_4."""
    arm = mcpc.from_chain(cases.paper_arm())
    displacements = np.zeros((5, 6))
    displacements[1, 2] = 1e-3
    errors = mcpc.parameter_errors(arm, displacements)
    expected = np.zeros(26)
    expected[arm.parameter_names.index("z_4")] = 1e-3
    np.testing.assert_allclose(errors, expected, rtol=0, atol=1e-15)
    # joint 3 turned by 1 mrad about its own axis: Δθ_3 in one chart, carried on to γ_4 and x, y in the other
    displacements = np.zeros((5, 6))
    displacements[2, 5] = 1e-3
    expected = np.zeros(26)
    expected[arm.parameter_names.index("theta_3")] = 1e-3
    np.testing.assert_allclose(mcpc.parameter_errors(arm, displacements, "offsets"), expected, rtol=0, atol=1e-15)
    complete = dict(zip(arm.parameter_names, mcpc.parameter_errors(arm, displacements), strict=True))
    assert complete["gamma_4"] == pytest.approx(1e-3, abs=1e-15)
    assert complete["y_3"] == pytest.approx(1.770 * np.sin(1e-3), abs=1e-15)
    assert complete["x_3"] == pytest.approx(1.770 * (np.cos(1e-3) - 1), abs=1e-15)


def test_eq20_prismatic_joint_takes_the_shift():
    chain = cases.stand_in(
        [np.eye(4), cases.pose((0.3, 0, 0)), cases.pose((0.2, 0, 0))], np.tile((0, 0, 1), (2, 1)), [False, True]
    )
    arm = mcpc.from_chain(chain)
    displacements = np.zeros((3, 6))
    displacements[1] = (0, 0, 2e-3, 0, 0, 1e-2)
    errors = dict(zip(arm.parameter_names, mcpc.parameter_errors(arm, displacements, "offsets"), strict=True))
    assert errors["d_2"] == pytest.approx(2e-3, abs=1e-16)
    assert errors["gamma_2"] == pytest.approx(1e-2, abs=1e-16)
    assert errors["theta_1"] == 0


@pytest.mark.fast(10)
@pytest.mark.parametrize("seed", SEEDS)
def test_frame_displacements_come_back_as_the_same_errors(seed):
    """All 5n+6 of them in chart "offsets"; in "complete" those without Δθ and Δd."""
    arm = mcpc.from_chain(cases.random_chain(seed))
    joints = arm.joint_count
    errors = np.random.default_rng(seed).uniform(-0.4, 0.4, 5 * joints + 6)
    back = mcpc.parameter_errors(arm, mcpc.frame_displacements(arm, errors), "offsets")
    np.testing.assert_allclose(back, errors, rtol=0, atol=1e-13)
    errors[:joints] = 0
    back = mcpc.parameter_errors(arm, mcpc.frame_displacements(arm, errors), "complete")
    np.testing.assert_allclose(back, errors, rtol=0, atol=1e-13)


@pytest.mark.fast(10)
@pytest.mark.parametrize("seed", SEEDS)
def test_frame_displacements_give_the_perturbed_tip(seed):
    chain = cases.random_chain(seed)
    arm = mcpc.from_chain(chain)
    generator = np.random.default_rng(seed)
    errors = generator.uniform(-2, 2, len(arm.parameter_names))
    displacements = mcpc.frame_displacements(arm, errors)
    q = cases.random_values(chain, generator)
    got = cases.displaced_tip(arm, q, displacements)
    np.testing.assert_allclose(got, cases.literal_tip(arm, q, errors), rtol=0, atol=5e-14)


def test_frame_displacements_follow_the_columns_of_eq8():
    """One parameter of one link: E_i = Exp(k Δ), the exponential by scipy."""
    arm = cases.random_mcpc(2, 3)
    for link in range(4):
        for k, twist in zip(arm.parameter_indices(link), arm.link_matrix(link).T, strict=True):
            if k < 3:
                continue
            errors = np.zeros(21)
            errors[k] = 0.3
            got = mcpc.frame_displacements(arm, errors)
            np.testing.assert_allclose(got[link], expm(0.3 * cases.hat(twist)), rtol=0, atol=1e-15)
            others = np.delete(got, link, axis=0)
            np.testing.assert_allclose(others, np.tile(np.eye(4), (3, 1, 1)), rtol=0, atol=1e-15)


# --- continuity: the paper's reason for MCPC ---


def denavit_hartenberg_offsets(placements, axes) -> np.ndarray:
    """d_i of joints 2..n-1 at zero angles: from one common normal's foot to the next along axis i."""
    pose = np.eye(4)
    lines = []
    for placement, axis in zip(placements, axes, strict=False):
        pose = pose @ placement
        lines.append((pose[:3, 3], pose[:3, :3] @ axis))
    feet_on_second, feet_on_first = [], []
    for (p, u), (r, v) in itertools.pairwise(lines):
        normal = np.cross(u, v)
        if normal @ normal == 0:  # parallel: the normal through the foot before
            start = feet_on_second[-1] if feet_on_second else p
            feet_on_first.append(start)
            feet_on_second.append(r + v * (v @ (start - r)))
            continue
        along_first = np.cross(r - p, v) @ normal / (normal @ normal)
        along_second = np.cross(r - p, u) @ normal / (normal @ normal)
        feet_on_first.append(p + along_first * u)
        feet_on_second.append(r + along_second * v)
    return np.array([
        (feet_on_first[i] - feet_on_second[i - 1]) @ lines[i][1] for i in range(1, len(lines) - 1)
    ])  # fmt: skip


@pytest.mark.parametrize("chart", CHARTS)
@pytest.mark.parametrize("direction", [0.3, np.pi / 2, 2.0, -1.0])
def test_continuity_where_denavit_hartenberg_jumps(direction, chart):
    """Axis 3, parallel to axis 2 at 1.97 m, tilted by 1e-6 rad: errors of that order, offsets by kilometres."""
    chain = cases.paper_arm()
    arm = mcpc.from_chain(chain)
    tilt = 1e-6
    displacements = np.zeros((5, 6))
    displacements[2, 3:5] = tilt * np.cos(direction), tilt * np.sin(direction)
    errors = mcpc.parameter_errors(arm, displacements, chart)
    assert 0.5 * tilt < np.abs(errors).max() < 4 * tilt  # lengths up to 1.97 + 1.77 m
    names = arm.parameter_names
    assert errors[names.index("beta_2")] == pytest.approx(tilt * np.sin(direction), abs=1e-11)
    assert errors[names.index("alpha_2")] == pytest.approx(tilt * np.cos(direction), abs=1e-11)

    tilted = chain.placements.copy()
    tilted[2] = tilted[2] @ displacement(displacements[2])
    before = denavit_hartenberg_offsets(chain.placements, chain.axes)
    after = denavit_hartenberg_offsets(tilted, chain.axes)
    np.testing.assert_allclose(before, [0, 0], rtol=0, atol=1e-12)
    assert np.abs(after).max() > 1e5


def test_perturbed_arm_keeps_the_nominal_offsets():
    """β carries the tilt; the offsets do not jump as those of a fresh extraction may."""
    chain = cases.paper_arm()
    arm = mcpc.from_chain(chain)
    displacements = np.zeros((5, 6))
    displacements[2, 4] = 1e-6
    built = arm.perturbed(mcpc.parameter_errors(arm, displacements))
    np.testing.assert_array_equal(built.joint_offset, arm.joint_offset)
    tilted = chain.placements.copy()
    tilted[2] = tilted[2] @ displacement(displacements[2])
    fresh = mcpc.from_chain(cases.stand_in(tilted, chain.axes))
    assert abs(fresh.joint_offset[1]) > 1
    q = [0.1, 0.2, 0.3, 0.4]
    np.testing.assert_allclose(built.forward_kinematics(q), fresh.forward_kinematics(q), rtol=0, atol=2e-15)


# --- bad input ---


def twisted(value):
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[3, 0, 1] = value
    return poses


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda arm: mcpc.parameter_errors(arm, np.zeros((4, 6))), r"shape \(4, 6\) is not \(5, 6\) or \(5, 4, 4\)"),
        (lambda arm: mcpc.parameter_errors(arm, np.full((5, 6), np.nan)), "mcpc displacements must be finite"),
        (lambda arm: mcpc.parameter_errors(arm, [["x"] * 6] * 5), "mcpc displacements must be numbers"),
        (lambda arm: mcpc.parameter_errors(arm, twisted(1e-6)), "number 3 is not a rigid motion"),
        (lambda arm: mcpc.parameter_errors(arm, twisted(np.inf)), "mcpc displacements must be finite"),
        (lambda arm: mcpc.parameter_errors(arm, [np.diag([1, 1, -1, 1])] * 5), "number 0 is not a rigid motion"),
        (lambda arm: mcpc.parameter_errors(arm, np.zeros((5, 6)), chart="dh"), "must be complete or offsets, got 'dh'"),
        (lambda arm: mcpc.frame_displacements(arm, np.zeros(6)), r"shape \(6,\) is not \(26,\)"),
    ],
)
def test_bad_input_gives_one_clear_line(call, message):
    with pytest.raises(InputError, match=message) as caught:
        call(mcpc.from_chain(cases.paper_arm()))
    assert "\n" not in str(caught.value)
