from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate

from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Draw
from precision_pin.draws.expressions import Component
from precision_pin.draws.laws import Uniform
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.loads import Load
from precision_pin.sources import beam
from precision_pin.sources.beam import Beam, point_flexibility, stretch_flexibility, weight_flexibility
from support.checks.beam import beam_loads, check_beam, integrals
from support.checks.common import Q7, evaluated, in_base, one_link
from support.plain_robot import PlainRobot, chain_of, joint, link, random_arm, robot

L, EI_Y, EI_Z, GI, EA = 1.7, 900.0, 2500.0, 700.0, 3e5


@pytest.mark.slow
def test_reference_table_axes_integrals_and_settings():
    check_beam(beam)


def test_against_a_frame_of_200_elements():
    # loads at the tip, at mid-span (off the axis too), behind each other, self-weight along all three axes; the masses
    # are given as loads, so that the wrenches are known by hand
    gravity = np.array([3.0, -4.0, -8.0])
    chain = one_link(length=L, gravity=tuple(gravity))
    points = [(0.85, 2.0, (0.0, 0.0, 0.0)), (0.34, 1.2, (0.1, -0.2, 0.3)), (1.7, 4.0, (0.2, 0.1, -0.1))]
    loads = [Load(1, np.eye(4), np.zeros(3), True, ((np.array([3.0, 1.0, 0, 0]), ()),))]
    for reach, mass, arm in points:
        frame = np.eye(4)
        frame[0, 3] = reach
        loads.append(Load(1, frame, frame[:3, 3], False, ((mass * np.array([1.0, *arm]), ()),)))
    source = Beam(link="arm", EI_y=EI_Y, EI_z=EI_Z, GI=GI, EA=EA)
    posture = chain.at([0.0]).with_loads(loads)
    total = sum(term.twist for term in source.terms(posture, LabelledSpace(Space(), source.label())))

    elements = 200
    step = L / elements
    stiffness, force = np.zeros((6 * (elements + 1),) * 2), np.zeros(6 * (elements + 1))
    element = _element(step)
    weight = 3.0 * gravity / L
    for k in range(elements):
        rows = slice(6 * k, 6 * k + 12)
        stiffness[rows, rows] += element
        force[rows] += _consistent(weight, step)
    for reach, mass, arm in points:
        node = round(reach / step)
        assert node * step == pytest.approx(reach, abs=1e-12)
        force[6 * node : 6 * node + 3] += mass * gravity
        force[6 * node + 3 : 6 * node + 6] += np.cross(arm, mass * gravity)
    solution = np.linalg.solve(stiffness[6:, 6:], force[6:])
    # cubic elements are exact at their nodes; 200 of them cost about six digits of conditioning
    np.testing.assert_allclose(total, solution[-6:], rtol=2e-7, atol=1e-10)


def _element(h):
    """Stiffness of a straight element with twelve degrees of freedom, x along it (any textbook)."""
    k = np.zeros((12, 12))
    for i, value in ((0, EA / h), (3, GI / h)):
        k[i, i] = k[i + 6, i + 6] = value
        k[i, i + 6] = k[i + 6, i] = -value
    for w, t, rigidity, sign in ((1, 5, EI_Z, 1), (2, 4, EI_Y, -1)):
        rows = [w, t, w + 6, t + 6]
        k[np.ix_(rows, rows)] += (rigidity / h**3) * np.array(
            [
                [12, sign * 6 * h, -12, sign * 6 * h],
                [sign * 6 * h, 4 * h * h, -sign * 6 * h, 2 * h * h],
                [-12, -sign * 6 * h, 12, -sign * 6 * h],
                [sign * 6 * h, 2 * h * h, -sign * 6 * h, 4 * h * h],
            ]
        )
    return k


def _consistent(q, h):
    f = np.zeros(12)
    f[:3] = f[6:9] = q * h / 2
    f[5], f[11] = q[1] * h * h / 12, -q[1] * h * h / 12
    f[4], f[10] = -q[2] * h * h / 12, q[2] * h * h / 12
    return f


@pytest.mark.parametrize("reach", [0.0, 0.6, 1.7])
def test_point_loads_against_the_differential_equation(reach):
    """EI w'' = M(x) integrated twice by quadrature, for a force and a moment at ``reach``."""

    def bend(moment):
        slope = integrate.quad(moment, 0, reach)[0]
        return integrate.quad(lambda x: (L - x) * moment(x), 0, reach)[0], slope

    f_w, f_slope = bend(lambda x: reach - x)
    m_w, m_slope = bend(lambda x: 1.0)
    table = point_flexibility(L, reach)
    np.testing.assert_allclose([table[1, 1], table[5, 1], table[1, 5], table[5, 5]], [f_w, f_slope, m_w, m_slope])
    np.testing.assert_allclose([table[2, 2], table[4, 2], table[2, 4], table[4, 4]], [f_w, -f_slope, -m_w, m_slope])
    q_w = integrate.quad(lambda x: (L - x) * (L - x) ** 2 / 2, 0, L)[0] / L
    q_slope = integrate.quad(lambda x: (L - x) ** 2 / 2, 0, L)[0] / L
    spread = weight_flexibility(L)
    np.testing.assert_allclose([spread[1, 1], spread[2, 2], spread[5, 1], spread[4, 2]], [q_w, q_w, q_slope, -q_slope])


@pytest.mark.parametrize(("start", "stop"), [(0.0, 0.6), (0.4, 1.1), (1.2, L), (0.5, 0.5 + 1e-7)])
def test_a_weight_on_a_part_is_the_mean_of_point_loads(start, stop):
    nodes, weights = np.polynomial.legendre.leggauss(4)
    reaches = start + (stop - start) * (nodes + 1) / 2
    mean = sum(w / 2 * point_flexibility(L, reach) for w, reach in zip(weights, reaches, strict=True))
    mean[:, 3:] = 0.0  # a weight has no moment
    np.testing.assert_allclose(stretch_flexibility(L, start, stop), mean, rtol=1e-13, atol=1e-15)
    np.testing.assert_array_equal(stretch_flexibility(L, 0.0, L), weight_flexibility(L))


def test_tip_flexibility_is_symmetric_by_maxwell_and_betti():
    table = point_flexibility(L, L)
    np.testing.assert_array_equal(table, table.T)
    assert (np.linalg.eigvalsh(table) > 0).all()


def test_a_round_section_given_by_its_diameter():
    """EI = E π d⁴/64 and GI = 2 G I as formulas of random numbers."""
    chain = one_link(length=L, gravity=(0.0, -5.0, -9.0), mass=2.0, com=(0.8, 0, 0)).with_payload(3.0, (0, 0.2, 0.1))
    modulus, diameter = Component("E"), Component("d")
    second_moment = diameter**4 * (np.pi / 64)
    source = Beam(link="arm", EI=modulus * second_moment, GI=0.8 * (modulus * second_moment))
    draws = [Draw("E", Uniform(1e10, mean=7e10)), Draw("d", Uniform(1e-3, mean=0.03))]
    e, d = 7.3e10, 0.0295
    _, totals = evaluated(chain, [0.1], [source], {"E": e, "d": d}, draws)
    second = np.pi * d**4 / 64
    _, plain = evaluated(chain, [0.1], [Beam(link="arm", EI=e * second, GI=0.8 * e * second)])
    np.testing.assert_allclose(*totals.values(), *plain.values(), rtol=1e-12)


@pytest.mark.parametrize("number", [2, 5])
def test_seen_from_the_tool_the_same_link_bends_the_other_way_round(number):
    """A chain from the tool to the base: the link is clamped at its outer joint and carries the rest of the arm."""
    text = random_arm(19)
    reading = PlainRobot.parse(text)
    gravity = (2.0, -3.0, -8.0)
    chain = chain_of(text, base="tool", tip="base", gravity=gravity)
    q = dict(zip((f"joint{k}" for k in range(1, 8)), Q7, strict=True))
    poses = reading.poses(q, "tool")
    (outer,) = (entry for entry in reading.joints if entry.name == f"joint{number + 1}")
    start = (poses[outer.parent] @ outer.origin)[:3, 3]
    end = poses[f"link{number}"][:3, 3]
    length = float(np.linalg.norm(end - start))
    x = (end - start) / length
    beyond = reading.beyond(f"joint{number}", "tool")
    here = reading.beyond(outer.name, "tool") - beyond
    names = dict.fromkeys(here, (0.0, length)) | dict.fromkeys(beyond, length)
    if number == 2:
        joined = float(x @ (poses["half2"][:3, 3] - start))
        names |= {"link2": (joined, length), "half2": (0.0, joined, "about")}
    loads, spread = beam_loads(reading, names, "tool", q, gravity, start, x, length)
    axes = np.linalg.svd(x[None])[2].T  # any axes normal to x do for equal rigidities
    axes[:, 0] = x
    at, totals = evaluated(chain, q, [Beam(link=f"link{number}", EI=3000.0, GI=800.0, EA=2e5)])
    expected = integrals(loads, spread, length, axes, (800.0, 3000.0, 3000.0, 2e5))
    np.testing.assert_allclose(in_base(at.posture, totals), expected, atol=1e-13)


def test_a_link_without_length_cannot_bend():
    chain = chain_of(
        robot(
            link("base"),
            joint("one", "revolute", "base", "hub"),
            link("hub"),
            joint("two", "revolute", "hub", "arm", axis=(0, 1, 0)),
            link("arm"),
            joint("flange", "fixed", "arm", "tool", (1, 0, 0)),
            link("tool"),
        )
    )
    with pytest.raises(InputError, match=r"chain link 1 \(end of link 1 \(two\)\) has no length, so it cannot bend"):
        ErrorModel(chain, Space(), [Beam(link="hub", EI=1.0)]).at([0, 0])
    with pytest.raises(InputError, match="chain link 0"):
        ErrorModel(chain, Space(), [Beam(link="base", EI=1.0)]).at([0, 0])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "needs a stiffness"),
        ({"EI": 1.0, "EI_y": 1.0, "EI_z": 1.0}, "one of EI"),
        ({"EI": 1.0, "bending_stiffness": 1.0}, "one of EI"),
        ({"EI_y": 1.0}, "both of EI_y"),
        ({"GI": 1.0, "torsion_stiffness": 1.0}, "one of GI"),
        ({"EI": 0.0}, "EI of a beam must be positive"),
        ({"GI": -3.0}, "GI of a beam must be positive"),
        ({"EA": float("nan")}, "EA of a beam must be positive"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Beam(link="arm", **settings)
