"""Displacements to parameter errors and back: what stands for eqs 20 and 22 of the paper.

Erratum: the paper writes ΔΩ_k = J_k⁻¹ D_k, but J_k is 6×5 and has no inverse; its pseudo-inverse loses a tilt of joint 2.
"""

import numpy as np
import pytest

from precision_pin.robot import mcpc
from robot.mcpc import cases
from support.plain_robot import inserted

CHARTS = ("complete", "offsets")


def random_sixes(seed, count, size):
    generator = np.random.default_rng(1000 + seed)
    return size * generator.uniform(-1, 1, (count, 6))


@pytest.mark.fast(6)
@pytest.mark.parametrize("chart", CHARTS)
@pytest.mark.parametrize("seed", range(6))
def test_eq20_eq22_parameter_errors_move_the_tip_as_the_displacements_do(seed, chart):
    """At any size, at every q, in both charts, from six-vectors and from poses; and which parameters a chart uses."""
    chain = cases.random_chain(seed)
    arm = mcpc.from_chain(chain)
    generator = np.random.default_rng(seed)
    for size in (1e-3, 0.5, 2.5):
        sixes = random_sixes(seed, len(chain.placements), size)
        poses = [inserted(values) for values in sixes]
        errors = mcpc.parameter_errors(arm, sixes, chart)
        np.testing.assert_allclose(mcpc.parameter_errors(arm, poses, chart), errors, rtol=0, atol=1e-12)
        joints = errors[: arm.joint_count]
        assert joints.all() if chart == "offsets" else not joints.any()
        q = cases.random_values(chain, generator)
        expected = cases.displaced_tip(arm, q, poses)
        np.testing.assert_allclose(cases.literal_tip(arm, q, errors), expected, rtol=0, atol=5e-14 * (1 + 9 * size))
        np.testing.assert_allclose(arm.perturbed(errors).forward_kinematics(q), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("joints", [0, 1, 4])
@pytest.mark.parametrize("chart", CHARTS)
def test_eq20_holds_for_parameters_anywhere(joints, chart):
    """Not only extracted ones: β in every cell, offsets, shifts, a base turn, and no joint at all."""
    arm = cases.random_mcpc(joints + 5, joints)
    sixes = random_sixes(joints, joints + 1, 0.2)
    errors = mcpc.parameter_errors(arm, sixes, chart)
    q = np.random.default_rng(joints).uniform(-3, 3, joints)
    expected = cases.displaced_tip(arm, q, [inserted(values) for values in sixes])
    np.testing.assert_allclose(cases.literal_tip(arm, q, errors), expected, rtol=0, atol=2e-14)


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


@pytest.mark.fast(3)
@pytest.mark.parametrize("seed", range(5))
def test_frame_displacements_give_the_perturbed_tip_and_come_back_as_the_same_errors(seed):
    """All 5n+6 of them in chart "offsets"; in "complete" those without Δθ and Δd."""
    chain = cases.random_chain(seed)
    arm = mcpc.from_chain(chain)
    generator = np.random.default_rng(seed)
    errors = generator.uniform(-2, 2, len(arm.parameter_names))
    q = cases.random_values(chain, generator)
    got = cases.displaced_tip(arm, q, mcpc.frame_displacements(arm, errors))
    np.testing.assert_allclose(got, cases.literal_tip(arm, q, errors), rtol=0, atol=5e-14)
    errors = errors / 5
    for chart in ("offsets", "complete"):
        if chart == "complete":
            errors[: arm.joint_count] = 0
        back = mcpc.parameter_errors(arm, mcpc.frame_displacements(arm, errors), chart)
        np.testing.assert_allclose(back, errors, rtol=0, atol=1e-13)


@pytest.mark.parametrize("chart", CHARTS)
@pytest.mark.parametrize("direction", [0.3, -1.0])
def test_continuity_where_denavit_hartenberg_jumps(direction, chart):
    """Axis 3, parallel to axis 2 at 1.97 m, tilted by 1e-6 rad: errors of that order, where its offsets go far."""
    arm = mcpc.from_chain(cases.paper_arm())
    tilt = 1e-6
    displacements = np.zeros((5, 6))
    displacements[2, 3:5] = tilt * np.cos(direction), tilt * np.sin(direction)
    errors = mcpc.parameter_errors(arm, displacements, chart)
    assert 0.5 * tilt < np.abs(errors).max() < 4 * tilt  # lengths up to 1.97 + 1.77 m
    names = arm.parameter_names
    assert errors[names.index("beta_2")] == pytest.approx(tilt * np.sin(direction), abs=1e-11)
    assert errors[names.index("alpha_2")] == pytest.approx(tilt * np.cos(direction), abs=1e-11)
