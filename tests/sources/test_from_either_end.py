"""The same mechanism with its base at either end, and written from either end: directions, heights and loads agree.

Seen from the tool, the error is that of the base: with the tip at p, R and errors d, δ in base axes, a small relative
displacement of the two is ``d' = -Rᵀ(d + p × δ)``, ``δ' = -Rᵀ δ`` in tool axes.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from precision_pin import Chain, ErrorModel, Space, Uniform, sources
from precision_pin.sources.places import direction_of
from precision_pin.sources.profiles import Segment
from precision_pin.sources.strut import StrutEnd
from support.checks.beam import integrals
from support.checks.common import evaluated, in_base, one_link
from support.plain_robot import PlainRobot, chain_of, joint, limits, link, robot, unit

GRAVITY = np.array([2.0, -3.0, -8.0])
Q = {"joint1": 0.4, "joint2": -0.8, "slide": 0.15, "joint4": 0.6}
WEIGHT, CENTRE = 7.0, np.array([0.1, -0.2, 0.15])


def arm() -> str:
    """Return an arm without masses: slanted axes, one that slides, and a link in two parts."""
    generator = np.random.default_rng(5)
    kinds = {"joint1": "revolute", "joint2": "revolute", "slide": "prismatic", "joint4": "revolute"}
    parts, parent = [link("base")], "base"
    for k, (name, kind) in enumerate(kinds.items(), start=1):
        xyz, rpy = generator.uniform(-0.5, 0.5, 3), generator.uniform(-3, 3, 3)
        parts += [joint(name, kind, parent, f"link{k}", xyz, rpy, unit(generator.normal(size=3))), link(f"link{k}")]
        parent = f"link{k}"
        if k == 2:
            parts += [joint("split", "fixed", parent, "half2", (0.2, 0.1, -0.1), (0.4, 1.0, -0.3)), link("half2")]
            parent = "half2"
    parts += [joint("flange", "fixed", parent, "tool", (0.1, 0.3, 0.2), (0.3, -0.2, 1.1)), link("tool")]
    return robot(*parts)


TEXT = arm()
POSE = PlainRobot.parse(TEXT).poses(Q)["tool"]


def seen_from_the_tool(errors, pose=POSE) -> np.ndarray:
    turn, p = pose[:3, :3], pose[:3, 3]
    lever = np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])
    return -np.block([[turn.T, turn.T @ lever], [np.zeros((3, 3)), turn.T]]) @ errors


def chains(weight: float = 0.0) -> tuple[Chain, Chain]:
    """Return the arm from base to tool and from tool to base.

    A weight hangs on the tool; from the tool it is its reaction that hangs on the base, at the same point in space: every
    joint and link between the two feels the same.
    """
    forth = chain_of(TEXT, base="base", tip="tool", gravity=tuple(GRAVITY))
    back = chain_of(TEXT, base="tool", tip="base", gravity=tuple(-POSE[:3, :3].T @ GRAVITY))
    point = POSE[:3, :3] @ CENTRE + POSE[:3, 3]
    return forth.with_payload(weight, CENTRE), back.with_payload(weight, point)


def mean_errors(chain: Chain, source) -> np.ndarray:
    at = ErrorModel(chain, Space(), [source]).at(Q)
    return at.linear(at.space.mean[:, None])[:, 0]


TAPER = (Segment(length=0.1, EI_y=30.0, EI_z=90.0, GI=50.0, EA=1e4), Segment(EI_y=500.0, EI_z=150.0, GI=80.0, EA=2e4))
STRUT = sources.Strut(
    from_=StrutEnd(link="link1", point=(0.1, 0.2, 0.0)),
    to=StrutEnd(link="link3", point=(0.0, -0.1, 0.3)),
    push=300.0,
    rate=200.0,
    at_length=0.5,
)
LOADED = (
    *(sources.JointCompliance(joint=name, compliance=1e-4) for name in Q),
    *(sources.Transmission(joint=name, stiffness=2e4) for name in Q),
    *(sources.Backlash(joint=name, backlash=1e-3, band=1e-6) for name in Q),
    *(
        sources.BearingStiffness(joint=name, radial=1e6, axial=None if name == "slide" else 3e6, tilt=2e4, centre=0.07)
        for name in Q
    ),
    sources.BearingStiffness(joint="slide", radial=1e6, tilt=2e4, roll=1e4, centre=-0.03, pads_on="parent"),
    *(sources.Clearance(joint=name, diametral=(1e-4, 3e-4), span=0.1, start=0.03, band=1e-6) for name in Q),
    sources.Clearance(joint="slide", diametral=(1e-4, 3e-4), span=0.1, start=0.03, band=1e-6, pads_on="parent"),
    sources.Clearance(joint="joint2", diametral=(1e-4,), axial=2e-4, span=0.1, start=0.03, band=1e-6),
    *(sources.Beam(link=name, EI_y=300.0, EI_z=900.0, GI=80.0, EA=1e4, roll=0.4) for name in ("base", "tool")),
    *(sources.Beam(link=name, segments=TAPER, roll=-0.7) for name in ("base", "link1", "half2", "link3", "tool")),
    *(
        sources.Beam(link=name, EI_y=300.0, EI_z=900.0, GI=80.0, EA=1e4, roll=0.4, pads_on=pads_on, **settings)
        for name, pads_on in (("half2", "child"), ("link3", "parent"))
        for settings in ({"supports": "start"}, {"supports": "both", "span": 2.0, "start": -1.0})
    ),
    *(
        sources.Beam(link=name, segments=TAPER, roll=-0.7, supports="start", span=2.0, start=-1.0, pads_on=pads_on)
        for name, pads_on in (("half2", "child"), ("link3", "parent"))
    ),
    sources.Beam(link="link1", EI=300.0, GI=80.0, supports="both", span=3.0),
)
STILL = (
    *(sources.JointOffset(joint=name, offset=1e-3) for name in Q),
    *(sources.Encoder(joint=name, offset=1e-3) for name in Q),
    sources.Encoder(joint="slide", scale=1e-3),
    sources.Transmission(joint="slide", lead_error=1e-3),
    *(
        sources.Thermal(link=name, expansion=1e-5, temperature_change=20.0, gradient=50.0, across="-y of joint2")
        for name in ("base", "link1", "half2", "tool")
    ),
    sources.Thermal(link="link1", expansion=1e-5, gradient=50.0, across="axis of slide"),
)


@pytest.mark.fast(14)
@pytest.mark.parametrize(
    ("source", "weight"),
    [*((source, WEIGHT) for source in LOADED), *((source, 0.0) for source in STILL)],
    ids=lambda value: value.label() if hasattr(value, "label") else "",
)
def test_what_gives_under_a_load_or_errs_without_one_does_the_same_from_either_end(source, weight):
    forth, back = (mean_errors(chain, source) for chain in chains(weight))
    assert np.linalg.norm(forth) > 1e-6
    np.testing.assert_allclose(back, seen_from_the_tool(forth), rtol=1e-9, atol=1e-12)


def test_a_strut_pulls_the_same_from_either_end():
    soft = [sources.JointCompliance(joint=name, compliance=1e-6) for name in Q]
    resting = [ErrorModel(chain, Space(), [*soft, STRUT], statics="equilibrium").at(Q) for chain in chains()]
    forth, back = (at.error_at_means for at in resting)
    assert np.linalg.norm(forth) > 1e-4
    # exactly: the base seen from the tool is the inverse of the tool seen from the base
    turn, shift = Rotation.from_rotvec(np.array(forth[3:])).as_matrix() @ POSE[:3, :3], POSE[:3, 3] + forth[:3]
    np.testing.assert_allclose(back[:3], POSE[:3, :3].T @ POSE[:3, 3] - turn.T @ shift, rtol=0, atol=1e-12)
    soft += [sources.BearingStiffness(joint=name, radial=1e6, tilt=2e4, centre=0.07) for name in Q]
    soft += [sources.Beam(link=name, EI=3e3, GI=8e2, EA=1e5) for name in ("base", "link1", "half2", "link3", "tool")]
    forth, back = (
        at.linear(at.space.mean[:, None])[:, 0]
        for at in (ErrorModel(chain, Space(), [*soft, STRUT]).at(Q) for chain in chains())
    )
    np.testing.assert_allclose(back, seen_from_the_tool(forth), rtol=1e-9, atol=1e-12)


LOOSE = {"diametral": (1e-4, 3e-4), "span": 0.1, "start": 0.3}
SCATTERED = (
    *(sources.AxisInstall(joint=name, radius=1e-4, span=0.1, start=0.3) for name in Q),
    *(
        sources.Clearance(joint=name, **LOOSE, direction="random", scope="unit", axial=0.0 if name == "slide" else 1e-4)
        for name in Q
    ),
    sources.Clearance(joint="slide", **LOOSE, direction="random", scope="unit", pads_on="parent"),
    sources.Clearance(joint="joint2", **LOOSE, band=1e6, scope="pose"),
    sources.Transmission(joint="joint2", amplitude=(1e-3, 2e-3), order=(3.0, 50.0)),
    sources.Encoder(joint="joint4", resolution=1e-3, eccentricity=1e-5, radius=0.02),
    sources.Guide(
        joint="slide", EXX=(1e-4,), EYX=(2e-4,), EZX=(3e-4,), EAX=(1e-3,), EBX=(2e-3,), ECX=(3e-3,), length=0.4
    ),
    sources.JointOffset(joint="slide", offset=Uniform(1e-3)),
    sources.Thermal(expansion=Uniform(1e-6), temperature_change=5.0, gradient=9.0, across="y of joint2"),
    sources.JointCompliance(joint="joint2", compliance=Uniform(1e-5, mean=1e-4)),
    sources.BearingStiffness(joint="joint2", tilt=Uniform(1e3, mean=2e4)),
    sources.Beam(link="half2", EI=Uniform(30.0, mean=300.0), supports="both", span=2.0, start=-1.0),
)


@pytest.mark.parametrize("source", SCATTERED, ids=lambda source: source.label())
def test_what_scatters_scatters_the_same_from_either_end(source):
    """The same draws move the same robot in the same way, at every pose: what is fixed in one link is so from either end."""
    for shift in (0.0, 0.7):
        q = {key: value + shift for key, value in Q.items()}
        reading = PlainRobot.parse(TEXT).poses(q)["tool"]
        forth, back = (ErrorModel(chain, Space(), [source]).at(q) for chain in chains(WEIGHT))
        assert forth.space.components == back.space.components
        x = forth.space.sample(3, 0, 4)
        # a weight is at the same point in space at the first pose only
        if not shift or not any(term.loaded for term in forth.terms):
            expected = seen_from_the_tool(forth.linear(x), reading)
            np.testing.assert_allclose(back.linear(x), expected, rtol=1e-9, atol=1e-14)


def test_directions_are_those_of_the_file_from_either_end():
    """Axis and frame of the joint as the plain reading has them: the child link's, after it turned."""
    reading = PlainRobot.parse(TEXT)
    forth, back = (chain.at(Q) for chain in chains())
    for entry in (entry for entry in reading.joints if entry.kind != "fixed"):
        turned = reading.poses(Q)[entry.child][:3, :3]
        for word, expected in zip(("x", "y", "z", "axis"), (*turned.T, turned @ entry.axis), strict=True):
            text = f"{word} of {entry.name}"
            np.testing.assert_allclose(direction_of(text, forth), expected, atol=1e-14)
            np.testing.assert_allclose(POSE[:3, :3] @ direction_of(text, back), expected, atol=1e-14)
            np.testing.assert_allclose(direction_of(f"-{text}", back), -direction_of(text, back), atol=0)


def test_values_limits_and_mimics_are_those_of_the_file_from_either_end():
    """A finger that mimics a locked joint, and a joint beyond its upper limit: the same words from either end."""
    text = robot(
        *(link(name) for name in ("base", "arm", "hand", "finger")),
        joint("low", "revolute", "base", "arm", (0.3, 0, 0), extra=limits(-0.1, 0.2)),
        joint("held", "revolute", "arm", "hand", (0.4, 0, 0)),
        joint("grip", "prismatic", "hand", "finger", (0.1, 0, 0),
              extra='<mimic joint="held" multiplier="2" offset="0.1"/>' + limits(-7, 7)),
    )  # fmt: skip
    forth, back = (
        chain_of(text, base=base, tip=tip, locked={"held": 0.3}) for base, tip in (("base", "hand"), ("hand", "base"))
    )
    assert dict(forth.locked) == dict(back.locked) == {"held": 0.3, "grip": pytest.approx(0.7)}
    for q, wrong in ((-0.05, 0), (0.15, 0), (0.25, 1), (-0.15, 1)):
        said = [[finding.message for finding in chain.at([q]).findings] for chain in (forth, back)]
        assert said[0] == said[1]
        assert len(said[0]) == wrong
        np.testing.assert_allclose(back.at([q]).pose, np.linalg.inv(forth.at([q]).pose), atol=1e-15)


# --- written from either end ---


STAND = (2.5, (0.05, 0.1, 0.2))
BOLT = ((0.3, -0.2, 0.1), (0.2, 0.5, -0.4))


def two_arms(way: str) -> str:
    """Return a body with an arm on either side, held by a stand; the body's frame lies between the two joints.

    The stand's joint is at the body's frame: written from the stand on (``fixed``, or ``locked``, a hinge that stands
    still), or from the body on, by a stub.
    """
    turn = Rotation.from_euler("xyz", BOLT[1])
    back = turn.inv()
    behind = (-back.apply(BOLT[0]), back.as_euler("xyz"))
    parts = [
        link("body", 3.0, (0.1, 0.0, 0.05)),
        joint("left", "revolute", "body", "left_arm", (-0.8, 0, 0), (0, 0, 0), (0, 1, 0)),
        link("left_arm", 1.0, (0, 0, 0.3)),
        joint("right", "revolute", "body", "right_arm", (0.9, 0, 0), (0, 0, 0), (0, 0, 1)),
        link("right_arm", 4.0, (0.4, 0.1, 0)),
        link("stand", *STAND),
    ]
    if way == "stub":
        fixed = (
            joint("stub_joint", "fixed", "body", "stub"),
            link("stub"),
            joint("foot", "fixed", "stub", "stand", *behind),
        )
        return robot(*parts, *fixed)
    kind = {"fixed": "fixed", "locked": "revolute"}[way]
    return robot(*parts, joint("foot", kind, "stand", "body", *BOLT))


@pytest.mark.parametrize("way", ["fixed", "locked", "stub"])
def test_a_branch_loads_the_beam_where_its_joint_stands_whichever_way_it_is_written(way):
    """Against Mohr's integrals: the stand at 0.8 of 1.7 m, with the moment of its own centre; the body along it."""
    text = two_arms(way)
    chain = chain_of(text, base="left_arm", tip="right_arm", gravity=tuple(GRAVITY))
    at, totals = evaluated(chain, [0.0, 0.0], [sources.Beam(link="body", EI=700.0, GI=300.0, EA=1e5)])
    turn = Rotation.from_euler("xyz", BOLT[1])
    stand = turn.inv().apply(np.array(STAND[1]) - BOLT[0])
    mass, arm_centre = 4.0, np.array([0.9 + 0.4, 0.1, 0.0])
    loads = [
        (0.8, STAND[0] * GRAVITY, np.cross(stand, STAND[0] * GRAVITY)),
        (1.7, mass * GRAVITY, np.cross(arm_centre - [0.9, 0, 0], mass * GRAVITY)),
    ]
    expected = integrals(loads, [(0.0, 1.7, 3.0 * GRAVITY)], 1.7, np.eye(3), (300.0, 700.0, 700.0, 1e5))
    np.testing.assert_allclose(in_base(at.posture, totals), expected, rtol=1e-12, atol=1e-15)


def test_a_body_is_the_links_own_whichever_way_the_file_is_written():
    """A link in parts: the same loads from the file's root to the tool as with the base at the tool's end.

    Seen from the hand the motor is spread about its centre, 0.2 m along, as far as it goes; the arm from there on.
    """
    parts = (
        link("base"),
        joint("hinge", "revolute", "base", "dummy", axis=(0, 1, 0)),
        link("dummy"),
        joint("zero", "fixed", "dummy", "arm"),
        link("arm", 2.0, (0.3, 0, 0)),
        joint("weld", "fixed", "arm", "motor", (0.7, 0, 0)),
        link("motor", 3.0, (0.1, 0, 0)),
        joint("plate", "fixed", "motor", "frame", (0.2, 0, 0)),
        link("frame"),
        joint("wrist", "revolute", "frame", "hand", (0.1, 0, 0), axis=(0, 0, 1)),
        link("hand"),
    )
    for base, tip in (("base", "hand"), ("hand", "base")):
        chain = chain_of(robot(*parts), base=base, tip=tip)
        assert {name for name, frame in chain.link_frames.items() if frame.is_own and frame.link == 1} == {"arm"}
        there = {name: np.sort(chain.link_frames[name].stretch[:, 0]) for name in ("arm", "motor")}
        along = {"base": 0.0, "hand": 1.0}[base]
        for name, span in (("arm", (0.0, 0.7)), ("motor", (0.7, 1.0))):
            np.testing.assert_allclose(
                np.sort(np.abs(there[name])), np.sort(np.abs(np.array(span) - along)), atol=1e-15
            )
    at, totals = evaluated(chain, [0.0, 0.0], [sources.Beam(link="motor", EI=700.0, GI=300.0, EA=1e5)])
    weight = np.array([0.0, 0.0, -9.81])
    spread = [(0.1, 0.3, 3.0 * weight), (0.3, 1.0, 2.0 * weight)]
    expected = integrals([], spread, 1.0, np.diag([-1.0, 1.0, -1.0]), (300.0, 700.0, 700.0, 1e5))
    np.testing.assert_allclose(in_base(at.posture, totals), expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("reach", [0.0, 0.4, 1.0, 1.3])
def test_a_payload_on_the_way_bends_the_beam_where_its_centre_of_mass_is(reach):
    """On the arm's own frame, which is the clamp: F a²(3l - a)/6EI, through the end from beyond it."""
    beam, expected = sources.Beam(link="arm", EI=8000.0), min(reach, 1.0)
    expected = expected**2 * (3 - expected) / 6 + (reach - expected) * expected / 2
    hung = sources.Payload(at="arm", mass=2.0, com=(Uniform(0.1, mean=reach), 0.0, 0.0))
    carrying = one_link().with_payload(2.0, (reach, 0, 0), "arm")
    for chain, given in ((carrying, [beam]), (one_link(), [hung, beam])):
        _, totals = evaluated(chain, [0.0], given)
        moved = sum(totals.values(), np.zeros(6))
        assert moved[2] == pytest.approx(-2 * 9.81 * expected / 8000.0, rel=1e-13)
