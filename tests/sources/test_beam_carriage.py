"""Beams on which a carriage travels: cantilevered rails, telescopes, rams and bridges, against closed forms.

At a distance a from the first support F acts along z and M about -y; so does the slope.
"""

from itertools import pairwise

import numpy as np
import pytest

from precision_pin import ErrorModel, Space, Uniform, map_poses, sources
from precision_pin.base.errors import InputError
from precision_pin.sources.profiles import Segment
from support.checks.beam import integrals
from support.checks.common import in_base
from support.plain_robot import chain_of, joint, link, robot

EI, GI, L, G = 700.0, 300.0, 1.6, 9.81
PLACES = (0.1, 0.4, 0.8, 1.1, 1.5)
TOOL, CENTRE = 3.0, (0.2, 0.1, 0.3)


def arm(start=0.0, rail=0.0, centre=(0.0, 0.0, 0.0), offset=(0.0, 0.0), kind="prismatic", load=TOOL) -> str:
    """Return a rail along x with a cart, whose joint's origin is ``start`` from the rail's own and ``offset`` beside it."""
    return robot(
        link("base"),
        joint("turn", "revolute", "base", "rail", axis=(0, 0, 1)),
        link("rail", rail, centre),
        joint("slide", kind, "rail", "cart", (start, *offset), axis=(1, 0, 0)),
        link("cart", load, CENTRE),
        joint("wrist", "revolute", "cart", "tool", (0.1, 0, 0), axis=(0, 0, 1)),
        link("tool"),
    )


def moved(text: str, q, beam, **settings) -> np.ndarray:
    """Return the displacement of the only place, in base axes."""
    at = ErrorModel(chain_of(text, **settings), Space(), [beam]).at(q)
    (place,) = {term.target for term in at.terms}
    return in_base(at.posture, {place: sum(term.twist for term in at.terms)})


def cantilever(a, f, m):
    return f * a**3 / (3 * EI) + m * a**2 / (2 * EI), f * a**2 / (2 * EI) + m * a / EI


def bridge(a, f, m):
    b = L - a
    crossed = a * b * (L - 2 * a) / (3 * EI * L)
    return f * a**2 * b**2 / (3 * EI * L) + m * crossed, f * crossed + m * (L**2 - 3 * a * L + 3 * a**2) / (3 * EI * L)


def weight_of_rail(a, q):
    return q * a**2 * (6 * L**2 - 4 * L * a + a**2) / (24 * EI), q * a * (3 * L**2 - 3 * L * a + a**2) / (6 * EI)


def weight_of_bridge(a, q):
    return q * a * (L**3 - 2 * L * a**2 + a**3) / (24 * EI), q * (L**3 - 6 * L * a**2 + 4 * a**3) / (24 * EI)


SHAPES = {
    "start": (cantilever, weight_of_rail, lambda a: a / GI),
    "both": (bridge, weight_of_bridge, lambda a: a * (L - a) / (GI * L)),
}


@pytest.mark.parametrize("start", [0.0, 0.5, -0.3])
@pytest.mark.parametrize("shape", SHAPES)
def test_a_carriage_bends_what_it_stands_on_where_its_joint_puts_it(shape, start):
    """Force across both ways, moment of the load's own centre and twist, wherever the joint's origin lies, and aside."""
    formula, _, twist = SHAPES[shape]
    beam = sources.Beam(link="rail", EI=EI, GI=GI, supports=shape, span=L, start=min(start, 0.0))
    down = np.array([0.0, 4.0, -9.0])
    for a in PLACES:
        for offset in ((0.0, 0.0), (0.2, 0.15)):
            force = TOOL * down
            (_, y, z), (_, slope_y, slope_z) = np.transpose(
                [(0, 0), *(formula(a, f, f * CENTRE[0]) for f in force[1:])]
            )
            about_x = np.cross(np.add(CENTRE, (0.0, *offset)), force)[0]
            turn = np.array([about_x * twist(a), -slope_z, slope_y])
            expected = [*(np.array([0, y, z]) + np.cross(turn, [0, *offset])), *turn]
            found = moved(arm(start, offset=offset), [0.0, a - max(start, 0.0), 0.4], beam, gravity=tuple(down))
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-16)


def test_by_default_a_rail_or_telescope_ends_at_its_carriage_on_either_side():
    """Nothing but EI given; the joint's origin on the beam, or at its start with the whole length from the value."""
    beam = sources.Beam(link="rail", EI=EI)
    for a in (*PLACES, -0.4):
        side = np.sign(a)
        sag, slope = cantilever(abs(a), -TOOL * G, -TOOL * G * CENTRE[0] * side)
        for start in (0.0, 1e-17, 0.5, -0.3):
            found = moved(arm(start), [0.0, a - start, 0.4], beam)
            np.testing.assert_allclose(found, [0, 0, sag, 0, -slope * side, 0], rtol=1e-12, atol=1e-16)
    assert not np.any(moved(arm(), [0.0, 0.0, 0.4], beam))


@pytest.mark.parametrize("weight", ["uniform", "centre", "section"])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_rail_sags_by_its_own_weight_where_the_carriage_is(shape, weight):
    spread = SHAPES[shape][1]
    settings = {"E": EI, "G": 1.0, "section": "general", "area": 1.0, "I_y": 1.0, "I_z": 1.0, "J": 1.0, "density": 5.0}
    if weight != "section":
        settings = {"EI": EI}
    beam = sources.Beam(link="rail", supports=shape, span=L, self_weight=weight, **settings)
    mass = 8.0
    for a in PLACES:
        found = moved(arm(0.5, mass, (0.5 * L, 0, 0), load=0.0), [0.0, a - 0.5, 0.4], beam)
        sag, slope = spread(a, -G * mass / L)
        if weight == "centre":
            sag, slope = by_integrals(shape, a, [(L / 2, -G * mass)])
        np.testing.assert_allclose(found, [0, 0, sag, 0, -slope, 0], rtol=1e-12, atol=1e-16)


def by_integrals(shape, a, forces):
    """Return sag and slope at a by forces, by the unit-load integrals of Mohr over Gauss points."""
    cuts = np.unique([0.0, a, L, *(x for x, _ in forces)])
    nodes, shares = np.polynomial.legendre.leggauss(4)
    x = np.concatenate([lo + (hi - lo) * (nodes + 1) / 2 for lo, hi in pairwise(cuts)])
    dx = np.concatenate([(hi - lo) * shares / 2 for lo, hi in pairwise(cuts)])

    def moment(at, force=0.0, couple=0.0):
        if shape == "start":
            return np.where(x < at, force * (at - x) + couple, 0.0)
        left = (force * (L - at) - couple) / L
        return -(left * x - np.where(x > at, force * (x - at) - couple, 0.0))

    total = sum(moment(at, force) for at, force in forces)
    return tuple(dx @ (total * unit) / EI for unit in (moment(a, 1.0), moment(a, 0.0, 1.0)))


@pytest.mark.parametrize("centre", [0.25, 0.8])
def test_without_a_length_the_rails_weight_is_spread_about_its_centre(centre):
    """A rail, or a telescope's tube, reaches twice as far as its centre, whether the carriage is there or beyond."""
    weight = np.array([0, 0, -8.0 * G])
    for a in PLACES:
        found = moved(arm(0.0, 8.0, (centre, 0, 0), load=0.0), [0.0, a, 0.4], sources.Beam(link="rail", EI=EI))
        expected = integrals([], [(0.0, 2 * centre, weight)], a, np.eye(3), (1e30, EI, EI, 1e30))
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-16)


def test_a_ram_in_fixed_guides_is_as_long_as_it_stands_out():
    """``pads_on: parent``: it begins at the guides; its weight reaches from its tip back through them."""
    text = robot(
        link("base"),
        joint("turn", "revolute", "base", "sleeve", axis=(0, 0, 1)),
        link("sleeve"),
        joint("slide", "prismatic", "sleeve", "ram", axis=(1, 0, 0)),
        link("ram", 8.0, (-0.2, 0, 0)),
        joint("wrist", "revolute", "ram", "tool", (0.3, 0, 0), axis=(0, 0, 1)),
        link("tool", TOOL, CENTRE),
    )
    beam = sources.Beam(link="ram", EI=EI, GI=GI, pads_on="parent")
    weight, down = TOOL * np.array([0, 0, -G]), np.array([0, 0, -8.0 * G])
    for a in PLACES:
        at = ErrorModel(chain_of(text), Space(), [beam]).at([0.0, a - 0.3, 0.0])
        expected = integrals(
            [(a, weight, np.cross(CENTRE, weight))], [(a - 1.0, a, down)], a, np.eye(3), (GI, EI, EI, 1e30)
        )
        np.testing.assert_allclose(at.linear(np.zeros((0, 1)))[:, 0], expected, rtol=1e-12, atol=1e-16)


@pytest.mark.parametrize("shape", SHAPES)
def test_on_the_side_of_the_base_the_carriage_holds_the_rail_and_what_stands_on_its_ends(shape):
    """The halves of a bridge are cantilevers from the carriage, their ends carry the rest and turn it; so is a rail."""
    rest, place, mass = 5.0, 0.6, 8.0
    text = arm(0.5, mass, (L / 2, 0, 0), load=0.0).replace('<link name="base"/>', link("base", rest, (place, 0, 0)))
    beam = sources.Beam(link="rail", EI=EI, supports=shape, span=L)
    for a in PLACES:
        q = mass * G / L
        if shape == "both":
            share = place / L
            ends = [
                (rest * G * part * reach**3 / 3 + q * reach**4 / 8) / EI
                for part, reach in ((1 - share, a), (share, L - a))
            ]
            slope = (ends[1] - ends[0]) / L
            sag = ends[0] + slope * a
        else:
            moment = -rest * G * place
            sag, slope = cantilever(a, rest * G, moment)
            sag, slope = sag + q * a**4 / (8 * EI), -(slope + q * a**3 / (6 * EI))
            sag += slope * a
        found = moved(text, {"turn": 0.0, "slide": a - 0.5, "wrist": 0.0}, beam, base="tool", tip="base")
        np.testing.assert_allclose(found, [0, 0, -sag, 0, slope, 0], rtol=1e-12, atol=1e-15)


@pytest.mark.slow
def test_random_rigidities_at_many_poses():
    """Every robot at every pose has its own F a³/3EI, and a map of all poses the same numbers."""
    chain = chain_of(arm(0.5, load=0.0).replace('<link name="tool"/>', link("tool", TOOL)))
    softness = Uniform(100.0, mean=EI)
    model = ErrorModel(chain, Space(), [sources.Beam(link="rail", EI=softness)])
    poses = [[0.0, a - 0.5, 0.0] for a in PLACES]
    for a, q in zip(PLACES, poses, strict=True):
        at = model.at(q)
        x = at.space.sample(0, 0, 3)
        sag = -TOOL * G * (a**3 / 3 + a**2 * 0.1 / 2) / x[0]
        slope = TOOL * G * (a**2 / 2 + a * 0.1) / x[0]
        np.testing.assert_allclose(at.linear(x)[[2, 4]], [sag - 0.1 * slope, slope], rtol=1e-12)
    means = map_poses(model, poses).to_xarray()["mean"].values
    np.testing.assert_allclose(means, [model.at(q).tangent[0] for q in poses], rtol=1e-12, atol=1e-16)


def test_parts_of_a_rail_bend_as_far_as_the_carriage():
    parts = (Segment(length=0.7, EI=900.0, GI=500.0), Segment(EI=400.0, GI=200.0))
    weight = TOOL * np.array([0, 0, -G])
    for a in PLACES:
        found = moved(arm(0.5), [0.0, a - 0.5, 0.0], sources.Beam(link="rail", span=L, segments=parts))
        rigidities = [(0.7, (500.0, 900.0, 900.0, 1e30)), (L, (200.0, 400.0, 400.0, 1e30))]
        expected = integrals([(a, weight, np.cross(CENTRE, weight))], [], a, np.eye(3), rigidities)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-16)


@pytest.mark.slow
def test_equilibrium_statics_agree_with_a_beam_of_that_length_or_refuse():
    """A carriage's load moves with it; bending stays of first order, so a load along a column must be far from buckling."""
    for a in PLACES[1:]:
        beam = sources.Beam(link="rail", EI=4e3, GI=3e3)
        found = [
            ErrorModel(chain_of(text), Space(), [beam], statics="equilibrium").at(q).error_at_means
            for text, q in ((arm(0.5), [0.0, a - 0.5, 0.0]), (arm(a, kind="revolute"), [0.0, 0.0, 0.0]))
        ]
        assert np.linalg.norm(found[0]) > 1e-4
        np.testing.assert_allclose(found[0], found[1], atol=5e-3 * np.linalg.norm(found[1]))
    for shape, length in (("start", 2 * 1.1), ("both", L)):
        beam = sources.Beam(link="rail", EI=EI, supports=shape, span=L)
        critical = np.pi**2 * EI / length**2
        for share, is_refused in ((0.004, False), (0.006, True)):
            text = arm(load=0.0).replace('<link name="tool"/>', link("tool", share * critical / G))
            model = ErrorModel(chain_of(text, gravity=(-G, 0, 1e-3)), Space(), [beam], statics="equilibrium")
            if is_refused:
                with pytest.raises(InputError, match=r"beam\[rail\]: the load along it is 0.006 of its buckling load"):
                    model.at([0.0, 1.1, 0.0])
            else:
                model.at([0.0, 1.1, 0.0])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"supports": "both", "EI": 1.0}, "supports: both of beam needs span:"),
        ({"supports": "both", "span": 1.0, "segments": (Segment(EI=1.0),)}, "and no segments:"),
        ({"supports": "end", "EI": 1.0}, "supports of beam must be start or both, got 'end'"),
        ({"pads_on": "both", "EI": 1.0}, "pads_on of beam must be child or parent, got 'both'"),
        ({"span": 0.0, "EI": 1.0}, "the span of beam must be positive"),
        ({"span": 0.2, "EI": 1.0}, r"beam\[rail\]: the carriage is at 0.4 m, beyond the ends at 0 and 0.2 m"),
        ({"start": 0.5, "span": 2.0, "EI": 1.0}, "is at -0.1 m"),
        ({"bending_stiffness": 1.0}, "give EI:, GI: and EA:"),
        ({"segments": (Segment(EI=1.0),)}, "need span:, the length of the beam"),
        ({"pads_on": "parent", "EI": 1.0}, "has no length, so it cannot bend; name the link:"),
    ],
)
def test_what_a_beam_with_a_carriage_lacks_is_said_in_one_line(settings, message):
    with pytest.raises(InputError, match=message) as caught:
        moved(arm(), [0.0, 0.4, 0.0], sources.Beam(link="rail", **settings))
    assert "\n" not in str(caught.value)
