"""Beams in segments, and self-weight in its three ways, against Mohr's integrals and closed forms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from precision_pin import Draw, ErrorModel, InputError, Space, Uniform
from precision_pin.draws.space import LabelledSpace
from precision_pin.model.compliance import Elasticity, compliances_of
from precision_pin.robot.places import Load
from precision_pin.sources import Beam, JointCompliance
from precision_pin.sources.profiles import Segment
from support.checks.beam import integrals
from support.checks.common import evaluated, one_link
from support.plain_robot import chain_of, joint, link, robot

L = 1.7
GRAVITY = np.array([3.0, -4.0, -8.0])
ZERO, AXES = np.zeros(3), np.eye(3)


# where each step ends, then its GI, EI_y, EI_z, EA
STEPS = ((0.5, (700.0, 900.0, 2500.0, 3e5)), (1.1, (400.0, 600.0, 600.0, 2e5)), (1.7, (100.0, 90.0, 250.0, 1e5)))


SEGMENTS = (
    Segment(length=0.5, GI=700.0, EI_y=900.0, EI_z=2500.0, EA=3e5),
    Segment(GI=400.0, EI=600.0, EA=2e5),
    Segment(fraction=0.6 / 1.7, GI=100.0, EI_y=90.0, EI_z=250.0, EA=1e5),
)


def terms_of(source: Beam, chain, loads=()) -> np.ndarray:
    """Return the sum of a beam's terms without random numbers."""
    space = LabelledSpace(Space(), source.label())
    posture = chain.at([0.0]).with_loads([*loads, *source.loads(chain.at([0.0]), space)])
    return sum((term.twist for term in source.terms(posture, space)), np.zeros(6))


def same_end(total, expected) -> None:
    np.testing.assert_allclose(total, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())


def point_load(reach: float, mass: float, arm) -> Load:
    frame = np.eye(4)
    frame[0, 3] = reach
    return Load(1, frame, frame[:3, 3], False, ((mass * np.array([1.0, *arm]), ()),))


# before, at and after the steps, at the tip, beyond it (a bracket), and behind the clamp
POINTS = ((0.2, 1.1, (0.1, 0.0, 0.2)), (0.5, 2.0, ZERO), (0.8, 1.2, (0.1, -0.2, 0.3)), (1.7, 4.0, (0.2, 0.1, -0.1)))


def cantilever(points, spread, steps=STEPS, axes=AXES) -> np.ndarray:
    """Return the end's displacement by Mohr's integrals; ``points`` are (reach, force, moment), base axes."""
    return integrals(points, spread, L, axes, steps)


@pytest.mark.parametrize("roll", [0.0, 0.7])
def test_steps_against_mohrs_integrals(roll):
    """Loads before, at and behind the steps and at the tip, and weight along, in all three directions."""
    chain = one_link(length=L, gravity=tuple(GRAVITY), mass=3.0, com=(0.4, 0.1, 0.2))
    total = terms_of(Beam(link="arm", segments=SEGMENTS, roll=roll), chain, [point_load(*point) for point in POINTS])
    points = [(reach, mass * GRAVITY, np.cross(arm, mass * GRAVITY)) for reach, mass, arm in POINTS]
    axes = Rotation.from_euler("x", roll).as_matrix()
    same_end(total, cantilever(points, [(0.0, L, 3.0 * GRAVITY)], axes=axes))


@pytest.mark.parametrize("reach", [1.9, -0.3])
def test_a_load_on_a_bracket_beyond_the_link_acts_through_its_end(reach):
    chain = one_link(length=L, gravity=tuple(GRAVITY))
    total = terms_of(Beam(link="arm", segments=SEGMENTS), chain, [point_load(reach, 2.0, (0.1, 0.2, 0.3))])
    arm = np.array([reach - L + 0.1, 0.2, 0.3])
    expected = cantilever([(L, 2.0 * GRAVITY, np.cross(arm, 2.0 * GRAVITY))], []) if reach > 0 else np.zeros(6)
    np.testing.assert_allclose(total, expected, rtol=1e-7, atol=1e-15)


# --- self-weight ---


def on_the_way(gravity=GRAVITY):
    """Return a beam of three URDF links in a row, arm, fore and tool, with a motor bolted to its side."""
    turned = Rotation.from_euler("xyz", (0.3, 0.2, -0.4))
    back = turned.inv()
    return chain_of(
        robot(
            link("base"),
            joint("hinge", "revolute", "base", "arm", axis=(0, 0, 1)),
            link("arm", 2.0, (0.4, 0.1, -0.05)),
            joint("weld", "fixed", "arm", "fore", (0.8, 0, 0), (0.3, 0.2, -0.4)),
            link("fore", 1.5, (0.3, -0.1, 0.2)),
            joint("bolt", "fixed", "arm", "motor", (0.6, 0.05, 0)),
            link("motor", 0.7, (0.1, 0.0, 0.1)),
            joint("flange", "fixed", "fore", "tool", back.apply([0.9, 0, 0]), back.as_euler("xyz")),
            link("tool", 0.4, (0.05, 0, 0.1)),
        ),
        tip="tool",
        gravity=tuple(gravity),
    )


CENTRES = (
    (2.0, np.array([0.4, 0.1, -0.05])),
    (1.5, np.array([0.8, 0, 0]) + Rotation.from_euler("xyz", (0.3, 0.2, -0.4)).apply([0.3, -0.1, 0.2])),
    (0.4, np.array([L + 0.05, 0, 0.1])),
)


MOTOR = (0.6, 0.7 * GRAVITY, np.cross([0.1, 0.05, 0.1], 0.7 * GRAVITY))


def test_weight_at_the_centres_of_mass():
    """Each URDF link at the projection of its centre, with the moment of what it lies off the axis."""
    points = [MOTOR]
    for mass, centre in CENTRES:
        reach = min(centre[0], L)
        points.append((reach, mass * GRAVITY, np.cross(centre - [reach, 0, 0], mass * GRAVITY)))
    same_end(terms_of(Beam(link="arm", self_weight="centre", segments=SEGMENTS), on_the_way()), cantilever(points, []))


def carried_on_the_way():
    """Return what hangs on the arm: the fore's weight from (start, stop, force), and its moment, tool and motor as points.

    The fore begins at 0.8 m and ends at the tip: its weight is spread about its centre as far as it goes to both sides.
    The tool's frame is the tip: it weighs there, with the moment of what its centre lies beyond.
    """
    (_, (mass, centre), (tool_mass, tool_centre)) = CENTRES
    room = min(centre[0] - 0.8, L - centre[0])
    spread = (centre[0] - room, centre[0] + room, mass * GRAVITY)
    points = [
        MOTOR,
        (centre[0], ZERO, np.cross(centre - [centre[0], 0, 0], mass * GRAVITY)),
        (L, tool_mass * GRAVITY, np.cross(tool_centre - [L, 0, 0], tool_mass * GRAVITY)),
    ]
    return spread, points


def test_uniform_weight_goes_along_its_own_link_and_what_is_bolted_on_acts_where_it_is():
    fore, points = carried_on_the_way()
    arm = (0.0, 0.8, CENTRES[0][0] * GRAVITY)
    same_end(terms_of(Beam(link="arm", segments=SEGMENTS), on_the_way()), cantilever(points, [arm, fore]))


TUBES = ((0.6, 0.06, 0.003), (1.1, 0.05, 0.002))


def tubes(**settings) -> Beam:
    parts = tuple(Segment(length=length, outer_diameter=outer, wall=wall) for length, outer, wall in TUBES)
    return Beam(link="arm", section="tube", material="aluminium", self_weight="section", segments=parts, **settings)


def tube_parts():
    """Return (end, rigidities) of the tubes, and (start, stop, weight)."""
    steps, weights, start = [], [], 0.0
    for length, outer, wall in TUBES:
        inner, end = outer - 2 * wall, start + length
        second, area = np.pi / 64 * (outer**4 - inner**4), np.pi / 4 * (outer**2 - inner**2)
        steps.append((end, (27e9 * 2 * second, 70e9 * second, 70e9 * second, 70e9 * area)))
        weights.append((start, end, 2700 * area * length * GRAVITY))
        start = end
    return steps, weights


def test_weight_by_section_takes_the_place_of_the_links_own_mass():
    """What is bolted to it stays, on the way (fore, tool) and beside it (motor)."""
    (fore, points), (steps, weights) = carried_on_the_way(), tube_parts()
    same_end(terms_of(tubes(), on_the_way()), cantilever(points, [*weights, fore], steps))


def test_weight_by_section_loads_the_joints_and_links_before_it_too():
    """Torque by hand: each tube at its middle, motor, fore and tool; the arm's own mass is gone."""
    chain = on_the_way()
    source = tubes()
    _, totals = evaluated(chain, [0.0], [source, JointCompliance(joint="hinge", compliance=1e-5)])
    torque = sum(weight[1] * (start + stop) / 2 for start, stop, weight in tube_parts()[1])
    torque += 0.7 * (0.7 * GRAVITY[1] - 0.05 * GRAVITY[0])
    torque += sum(mass * np.cross(centre, GRAVITY)[2] for mass, centre in CENTRES[1:])
    turn = next(total for target, total in totals.items() if total.shape == (1,))
    assert turn[0] == pytest.approx(1e-5 * torque, rel=1e-13)


def test_the_compliance_of_a_tube_that_gives_its_weight_is_that_of_its_section():
    """A force at the end bends each tube by its distance: ∫ (L - x)²/EI dx."""
    model = ErrorModel(on_the_way(), Space(), [tubes()])
    compliance = compliances_of(model, [0.0])["beam[arm]"]
    start, bent = 0.0, 0.0
    for end, (_, _, stiffness, _) in tube_parts()[0]:
        bent += ((L - start) ** 3 - (L - end) ** 3) / (3 * stiffness)
        start = end
    assert compliance[2, 2] == pytest.approx(bent, rel=1e-12)
    first, _ = Elasticity(model).at_many([[0.0], [0.3]])
    assert first.whole(np.zeros((0, 1)))[2, 2, 0] == pytest.approx(bent, rel=1e-12)


def test_a_density_given_is_used_instead_of_the_materials():
    light = one_link(length=L, gravity=tuple(GRAVITY))
    tube = {"section": "tube", "outer_diameter": 0.06, "wall": 0.003, "self_weight": "section"}
    one = terms_of(Beam(link="arm", material="aluminium", **tube), light)
    two = terms_of(Beam(link="arm", material="aluminium", density=5400.0, **tube), light)
    np.testing.assert_allclose(two, 2 * one, rtol=1e-14)


def test_two_beams_that_give_one_link_its_weight_are_refused():
    chain = on_the_way()
    other = Beam(link="tool", section="rod", diameter=0.05, material="steel", self_weight="section", roll=0.1)
    with pytest.raises(InputError, match="two beams give the link of 'arm' its weight by section"):
        ErrorModel(chain, Space(), [tubes(), other]).at([0.0])


@pytest.mark.parametrize("weight", ["uniform", "centre", "section"])
def test_gravity_off_leaves_nothing_of_any_weight(weight):
    source = Beam(link="arm", section="rod", diameter=0.05, material="steel", self_weight=weight)
    np.testing.assert_array_equal(terms_of(source, on_the_way(ZERO)), np.zeros(6))


# --- lengths and names ---


def test_segments_of_another_length_than_the_link_are_refused():
    chain = one_link(length=L, gravity=tuple(GRAVITY), mass=1.0)
    for segments, message in (
        ((Segment(length=0.5, EI=1.0), Segment(length=1.0, EI=1.0)), "are 1.5 m long in all, its link 1.7 m"),
        ((Segment(length=1.7, EI=1.0), Segment(EI=1.0)), "leaves nothing for the one without length:"),
        ((Segment(EI=1.0), Segment(EI=1.0)), "only one of a beam's segments"),
        ((Segment(fraction=0.6, EI=1.0), Segment(fraction=0.6, EI=1.0)), "are 2.04 m long"),
    ):
        with pytest.raises(InputError, match=message):
            terms_of(Beam(link="arm", segments=segments), chain)


def test_what_segments_have_from_the_beam():
    """Section and material where a segment names none; a material of its own takes nothing from the beam's."""
    chain = one_link(length=L, gravity=tuple(GRAVITY)).with_payload(1.0)
    size = {"outer_diameter": 0.06, "wall": 0.003}
    bulk = {"E": 7e10, "poisson_ratio": 0.3}
    last = Segment(EI=900.0, GI=700.0)
    shared = (
        Segment(length=0.5, **size),
        Segment(length=0.4, material="steel", **size),
        Segment(length=0.3, section="rod", diameter=0.03),
        last,
    )
    spelled = (
        Segment(length=0.5, section="tube", **bulk, **size),
        Segment(length=0.4, section="tube", material="steel", **size),
        Segment(length=0.3, section="rod", diameter=0.03, **bulk),
        last,
    )
    by_beam = Beam(link="arm", section="tube", segments=shared, **bulk)
    np.testing.assert_array_equal(terms_of(by_beam, chain), terms_of(Beam(link="arm", segments=spelled), chain))


def test_random_numbers_in_segments_have_names_and_those_of_the_beam_are_shared():
    chain = one_link(length=L, gravity=tuple(GRAVITY)).with_payload(1.0)
    law = Uniform(1e9, mean=7e10)
    first = {"length": 0.5, "outer_diameter": 0.06}
    random = (
        Segment(wall=Uniform(1e-4, mean=0.003), **first),
        Segment(outer_diameter=Draw("", Uniform(1e-4, mean=0.05)), wall="sheet"),
    )
    source = Beam(link="arm", section="tube", E=law, G=2.7e10, segments=random)
    model = ErrorModel(chain, Space((Draw("sheet", Uniform(1e-4, mean=0.002)),)), [source])
    own = ("E", "segments[0].wall", "segments[1].outer_diameter")
    assert model.space.components == ("sheet", *(f"beam[arm].{name}" for name in own))
    x = np.array([0.0021, 6.9e10, 0.00305, 0.0501])
    known = (Segment(wall=0.00305, **first), Segment(outer_diameter=0.0501, wall=0.0021))
    fixed = Beam(link="arm", section="tube", E=6.9e10, G=2.7e10, segments=known)
    expected = ErrorModel(chain, Space(), [fixed]).at([0.0]).exact(np.zeros((0, 1)))
    np.testing.assert_allclose(model.at([0.0]).exact(x[:, None]), expected, rtol=1e-12, atol=1e-18)
