"""Equilibrium statics: against exact rods, a fixed point found by another route, closed forms, and robots solved one by one.

Reference of the rods (worked out for this project apart from its code), for the paper's arm with C = 1e-5 rad/(N·m) on
every joint: |d| 35.877 mm, |δ| 15.614 mrad, ∂d/∂payload (2.703, 4.264, -3.639) mm/kg, ∂d/∂ln(all stiffness)
(-7.026, -26.942, 21.190) mm; loads re-evaluated until settled are off by 0.528, 0.267, 0.134, 0.054, 0.027 and 0.0027 % at
stiffness factors 0.5, 1, 2, 5, 10 and 100.
"""

import numpy as np
import pytest
from scipy import optimize
from scipy.spatial.transform import Rotation

from precision_pin import Chain, Draw, ErrorModel, Fixed, InputError, Lognormal, Normal, Source, Space, Uniform
from precision_pin.draws.expressions import Component
from precision_pin.draws.laws import Law
from precision_pin.kernel import sampler
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources import Beam, Frame, JointCompliance, JointOffset, Length, Levelling, Payload
from precision_pin.sources.profiles import Segment
from support.checks.common import one_link
from support.oracles import rods_error, settled_errors
from support.plain_robot import chain_of, joint, link, motion, pose_error, robot
from support.sheets import PAPER_Q

MM = 1e-3
JOINTS = ("joint1", "joint2", "joint3", "joint4")
ONE = Fixed(1.0)


@pytest.fixture(scope="module")
def arm() -> Chain:
    return Chain.from_urdf(PAPER_SHEET.parent / "4dof.urdf", tip="tool")


def loaded(
    arm: Chain,
    stiffness: Law = ONE,
    payload: Law = ONE,
    sources: tuple[Source, ...] = (),
    links=1.0,
    statics="equilibrium",
) -> ErrorModel:
    """Return the paper's arm with one factor on all stiffnesses, one more on the links'."""
    factor = Component("factor")
    flexible = [
        Payload(at="tool", mass="mass"),
        Beam(link="link2", EI=8000.0 * links * factor, GI=4000.0 * links * factor),
        Beam(link="link3", EI=8000.0 * links * factor, GI=1000.0 * links * factor),
        *(JointCompliance(joint=name, compliance=1e-5 / factor) for name in JOINTS),
    ]
    space = Space((Draw("factor", stiffness), Draw("mass", payload)))
    return ErrorModel(arm, space, [*flexible, *sources], statics=statics)


# --- exact rods ---


@pytest.mark.slow
def test_distance_and_slopes_of_the_rods(arm):
    """At most a tenth of what loads re-evaluated until they settle leave."""
    rods = {factor: rods_error(factor) for factor in (0.5, 1.0, 10.0)}
    assert np.linalg.norm(rods[1.0][:3]) / MM == pytest.approx(35.877, abs=5e-4)
    assert np.linalg.norm(rods[1.0][3:]) / MM == pytest.approx(15.614, abs=5e-4)
    for factor, settled_only in ((0.5, 0.528), (1.0, 0.267), (10.0, 0.027)):
        exact, error = rods[factor], loaded(arm, Fixed(factor)).at(PAPER_Q).tangent[0]
        for rows in (slice(0, 3), slice(3, 6)):
            gap = np.linalg.norm((error - exact)[rows])
            assert gap < 0.1 * settled_only / 100 * np.linalg.norm(exact[rows])
    jacobian = loaded(arm).at(PAPER_Q).jacobian
    h = 0.01
    by_payload = (rods_error(payload=1 + h) - rods_error(payload=1 - h)) / (2 * h)
    by_stiffness = (rods_error(np.exp(h)) - rods_error(np.exp(-h))) / (2 * h)
    np.testing.assert_allclose(by_payload[:3] / MM, [2.703, 4.264, -3.639], atol=5.1e-4)
    # the reference's derivative to ln(stiffness) is the difference over ± 5 %, 0.25 % above the limit
    over_5_percent = (rods_error(1.05) - rods_error(0.95))[:3] / 0.1
    np.testing.assert_allclose(over_5_percent / MM, [-7.026, -26.942, 21.190], atol=5.1e-4)
    for column, exact in ((1, by_payload), (0, by_stiffness)):
        for rows in (slice(0, 3), slice(3, 6)):
            gap = np.linalg.norm(jacobian[rows, column] - exact[rows])
            assert gap < 0.002 * np.linalg.norm(exact[rows])


@pytest.mark.slow
def test_products_of_load_and_stiffness_are_kept(arm):
    """Heavy and soft at once: against rods, where a first-order model is 10 % short. And far from the means."""
    at = loaded(arm, Uniform(0.3, mean=1.0), Uniform(0.5, mean=1.0)).at(PAPER_Q)
    scattered = loaded(arm, Lognormal(0.2, 1.0)).at(PAPER_Q)
    e0, jacobian = at.tangent
    first_order = e0 + jacobian @ [-0.3, 0.5]
    # the softest of a hundred: of a uniform law, and of a lognormal one, exp(-2.3263 s) / √(1 + 0.2²), s² = ln(1 + 0.2²)
    quantiles = ((at, 0.706, 1.0, 1e-3), (scattered, 0.618607, 1.0, 2e-3))
    for model, stiffness, mass, within in ((at, 0.7, 1.5, 2e-3), (at, 1.3, 0.5, 2e-3), *quantiles):
        truth = rods_error(stiffness, mass)
        error = model.exact(np.array([[stiffness], [mass]]))[:, 0]
        assert np.linalg.norm((error - truth)[:3]) < within * np.linalg.norm(truth[:3])
        if mass > 1:
            assert np.linalg.norm((first_order - truth)[:3]) > 0.08 * np.linalg.norm(truth[:3])


@pytest.mark.slow
def test_stiffnesses_that_vary_one_by_one(arm):
    """A sheet with ± 30 % on EI and 10 % on every joint: 6 robots of it solved one by one, and the sampler."""
    sheet = ErrorModel.load(PAPER_SHEET)
    sources = [
        *(source for source in sheet.sources if not isinstance(source, Beam)),
        Beam(link="link2", EI=Uniform(2400.0, mean=8000.0), GI=4000.0),
        Beam(link="link3", EI=Uniform(2400.0, mean=8000.0), GI=1000.0),
    ]
    named = Space(tuple(draw for draw in sheet.space.draws if "[" not in draw.name))
    model = ErrorModel(sheet.chain, named, sources, sheet.poses, statics="equilibrium")
    at = model.at("paper")
    x = model.space.sample(3, 0, 6)
    errors = at.exact(x)
    alone = settled_errors(model, model.poses["paper"], x)
    assert (np.linalg.norm((errors - alone)[:3], axis=0) < 1e-3 * np.linalg.norm(alone[:3], axis=0)).all()
    sampled = sampler.errors(sampler.to_arrays(at), "exact", 3, 0, 6)
    np.testing.assert_allclose(sampled, errors, rtol=0, atol=1e-13)
    assert model.statics_findings(at) == ()


# --- another route ---


@pytest.mark.slow
def test_the_fixed_point_by_another_route(arm):
    """Soft joints and rigid links: angles by torques, torques by where the masses then are; and without weights."""
    gravity, softness = np.array([0, 0, -9.81]), Component("softness")
    masses = ((2, 1.4, (0.985, 0, 0)), (3, 1.4, (0.885, 0, 0)), (4, 3.3, (0, 0, -0.137)), (4, 1.0, (0, 0, -0.274)))

    def settled(compliance: float, payload: float) -> np.ndarray:
        turns, last = np.zeros(4), np.full(4, np.inf)
        while np.abs(turns - last).max() > 1e-16:
            last, links = turns, [np.eye(4)]
            for angle, place in zip(PAPER_Q + turns, arm.placements[:4], strict=True):
                links.append(links[-1] @ place @ motion((0, 0, 1), False, angle))
            weights = [(k, m * gravity, (links[k] @ [*centre, 1])[:3]) for k, m, centre in masses]
            weights[-1] = (4, payload * gravity, weights[-1][2])
            moments = [
                sum(np.cross(at - one[:3, 3], f) for k, f, at in weights if k >= i) for i, one in enumerate(links)
            ]
            turns = compliance * np.array([one[:3, 2] @ moment for one, moment in zip(links, moments, strict=True)])[1:]
        return pose_error(links[4] @ arm.placements[4], arm.at(PAPER_Q).pose)

    sources = [Payload(at="tool", mass="mass"), *(JointCompliance(joint=name, compliance=softness) for name in JOINTS)]
    for c, mass in ((2e-5, 3.0), (1e-6, 0.2)):
        space = Space((Draw("softness", Fixed(c)), Draw("mass", Fixed(mass))))
        error, jacobian = ErrorModel(arm, space, sources, statics="equilibrium").at(PAPER_Q).tangent
        np.testing.assert_allclose(error, settled(c, mass), atol=1e-12)
        # its slopes are those of the solution solved anew
        for k, step in enumerate(1e-3 * np.diag([c, mass])):
            ahead, behind = (settled(c + sign * step[0], mass + sign * step[1]) for sign in (1, -1))
            slope = (ahead - behind) / (2 * step[k])
            np.testing.assert_allclose(jacobian[:, k], slope, atol=3e-6 * np.abs(slope).max())
    weightless = Chain.from_urdf(PAPER_SHEET.parent / "4dof.urdf", gravity=(0, 0, 0))
    error, jacobian = loaded(weightless).at(PAPER_Q).tangent
    np.testing.assert_allclose(error, 0, atol=1e-14)
    np.testing.assert_allclose(jacobian, 0, atol=1e-12)


# --- the slopes ---


@pytest.mark.slow
def test_slopes_with_segments_a_sliding_joint_and_a_branch():
    """Two links, the second slides at a slant and carries a bracket: stiffnesses, loads, and geometry, which moves loads."""
    chain = chain_of(
        robot(
            link("base"),
            joint("turn", "revolute", "base", "upper", (0.1, 0, 0.3), (0.2, 0.1, 0), (0, 1, 0)),
            link("upper", 4.0, (0.4, 0.02, 0)),
            joint("slide", "prismatic", "upper", "fore", (0.9, 0.1, 0.05), (0, 0.4, 0.3), (0.6, 0, 0.8)),
            link("fore", 2.0, (0.3, 0, 0.02)),
            joint("bolt", "fixed", "fore", "bracket", (0.3, 0.1, 0)),
            link("bracket", 1.0, (0, 0.1, 0.1)),
            joint("flange", "fixed", "fore", "tool", (0.7, 0, 0.1)),
            link("tool", 0.5, (0, 0, 0.1)),
        ),
        tip="tool",
        gravity=(1.0, -2.0, -9.0),
    )
    means = {"EI": 300.0, "GI": 200.0, "C": 2e-4, "D": 4e-5, "wall": 2e-3, "m": 1.5, "x": 0.05}
    means |= {"offset": 1e-2, "length": 5e-3, "y": 1e-2, "rx": 2e-2, "rz": -1e-2, "tilt": 1e-2}
    segments = (
        Segment(fraction=0.4, section="tube", outer_diameter=0.03, wall="wall", material="aluminium"),
        Segment(EI="EI", GI="GI"),
    )
    sources = [
        Payload(at="tool", mass="m", com=("x", 0.0, 0.1)),
        Beam(link="upper", segments=segments),
        Beam(link="fore", section="rod", diameter=0.02, material="steel", self_weight="section"),
        JointCompliance(joint="turn", compliance="C"),
        JointCompliance(joint="slide", compliance="D"),
        JointOffset(joint="turn", offset="offset"),
        Length(joint="slide", along="x of turn", parameters=("length",)),
        Frame(joint="slide", y="y", rx="rx", rz="rz"),
        Levelling(rx="tilt"),
    ]
    space = Space(tuple(Draw(name, Fixed(value)) for name, value in means.items()))
    model = ErrorModel(chain, space, sources, statics="equilibrium")
    q, mean = [0.3, 0.2], model.space.mean
    error, jacobian = model.at(q).tangent
    assert np.linalg.norm(error[:3]) > 0.02
    # each to 1e-6, against differences of arms settled anew
    groups, h = (("EI", "GI", "wall", "m"), ("C", "D", "x"), ("offset", "length", "tilt"), ("y", "rx", "rz")), 2e-4
    along = np.transpose([np.where(np.isin(model.space.components, names), mean, 0.0) for names in groups])
    ahead, behind = np.split(settled_errors(model, q, mean[:, None] + h * np.hstack([along, -along])), 2, axis=1)
    for names, found, slope in zip(groups, (jacobian @ along).T, ((ahead - behind) / (2 * h)).T, strict=True):
        np.testing.assert_allclose(found, slope, atol=1e-6 * np.abs(slope).max(), err_msg=str(names))


def test_a_sliding_joint_on_a_spring_by_hand():
    """A weight slides down a slope on a spring: the force does not change with the way, so x = C m g sin α exactly.

    The hinge before it turns by C' m g (l + x) cos(α + turn).
    """
    slope, reach, mass, give, twist = 0.4, 0.8, 3.0, 1e-3, 2e-3
    chain = chain_of(
        robot(
            link("base"),
            joint("hinge", "revolute", "base", "rail", axis=(0, 1, 0)),
            link("rail"),
            joint("slide", "prismatic", "rail", "tool", axis=(1, 0, 0)),
            link("tool", mass),
        )
    )
    sources = [
        JointCompliance(joint="slide", compliance=Uniform(1e-4, mean=give)),
        JointCompliance(joint="hinge", compliance=twist),
    ]
    at = ErrorModel(chain, Space(), sources, statics="equilibrium").at([slope, reach])
    weight, angle, way = mass * 9.81, slope, reach
    for _ in range(200):
        angle, way = slope + twist * weight * way * np.cos(angle), reach + give * weight * np.sin(angle)
    start, rest = (r * np.array([np.cos(a), 0, -np.sin(a)]) for r, a in ((reach, slope), (way, angle)))
    error, jacobian = at.tangent
    np.testing.assert_allclose(error, [*(rest - start), 0, angle - slope, 0], atol=1e-12)
    # dx = sin a W dC + C W cos a da, da = C' W (cos a dx - x sin a da)
    matrix = [
        [1, -give * weight * np.cos(angle)],
        [-twist * weight * np.cos(angle), 1 + twist * weight * way * np.sin(angle)],
    ]
    dway, dangle = np.linalg.solve(matrix, [weight * np.sin(angle), 0])
    along, across = (np.array([np.cos(angle), 0, -np.sin(angle)]), np.array([-np.sin(angle), 0, -np.cos(angle)]))
    np.testing.assert_allclose(jacobian[:3, 0], along * dway + way * across * dangle, atol=1e-7)


@pytest.mark.slow
def test_geometry_keeps_its_terms_exactly(arm):
    """Lengths, frames and offsets stand beside loads as in nominal statics, bit for bit; only loaded terms are new."""
    geometry = (
        Length(joint="joint3", parameters=(Uniform(1e-3, mean=2e-4),)),
        Frame(joint="joint4", x=Uniform(1e-3), ry=Normal(1e-4)),
        JointOffset(joint="joint2", offset=Uniform(1e-3)),
    )
    terms = [loaded(arm, sources=geometry, statics=one).at(PAPER_Q).terms for one in ("nominal", "equilibrium")]
    one, other = ([(t.target, t.factors, t.twist.tolist()) for t in each if not t.loaded] for each in terms)
    assert len(one) == 4
    assert one == other


# --- stable up to the critical load ---


def leaning(ratio: float, lean: float, down: float = -9.81) -> ErrorModel:
    """Return a weight above a soft hinge (below it with gravity up): C m g l = ratio."""
    tower = one_link(axis=(0, 1, 0), gravity=(down, 0.0, 0.0)).with_payload(10.0)
    sources = [JointCompliance(joint="hinge", compliance=ratio / (10.0 * abs(down)))]
    return ErrorModel(tower, Space(), sources, {"here": [lean]}, statics="equilibrium")


@pytest.mark.parametrize(
    ("ratio", "lean"), [(0.5, 1e-3), (0.9, 1e-3), (0.999, 1e-3), (1.3, 0.7), (-0.5, 0.5), (-1e4, 0.5)]
)
def test_an_arm_is_at_rest_up_to_its_critical_load_and_under_any_if_it_hangs(ratio, lean):
    """Upright; leant far over, where no straight one would rest; and hanging, at 30° from the vertical: θ = r sin(lean + θ)."""
    angle = leaning(abs(ratio), lean, np.copysign(9.81, -ratio)).at().error_at_means[4]
    ends = (0.0, 2.0) if ratio > 0 else (-0.5, 0.0)
    expected = optimize.brentq(lambda turn: turn - ratio * np.sin(lean + turn), *ends, xtol=1e-15)
    assert angle == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("ratio", [1.001, 1.1, 20.0])
def test_past_its_critical_load_it_is_refused_with_the_factor(ratio):
    for lean in (0.0, 1e-6, 1e-3):
        with pytest.raises(InputError, match="the arm buckles under its loads: beyond") as caught:
            leaning(ratio, lean).at()
        (finding,) = caught.value.findings
        assert "\n" not in finding.message
        assert float(finding.message.split("beyond ")[1].split()[0]) == pytest.approx(1 / ratio, rel=5e-3)


@pytest.mark.slow
def test_large_geometry_is_no_softness(arm):
    """A frame two metres off and a joint half a radian off: at rest where an arm drawn so is."""
    geometry = (JointOffset(joint="joint2", offset=0.5), Frame(joint="joint1", z=2.0))
    at = loaded(arm, sources=geometry).at(PAPER_Q)
    drawn = loaded(arm).at([PAPER_Q[0], PAPER_Q[1] + 0.5, *PAPER_Q[2:]])
    rigid = arm.at([PAPER_Q[0], PAPER_Q[1] + 0.5, *PAPER_Q[2:]]).pose[:3, 3] - arm.at(PAPER_Q).pose[:3, 3]
    np.testing.assert_allclose(
        at.error_at_means[:3], rigid + np.array([0, 0, 2.0]) + drawn.error_at_means[:3], rtol=0, atol=1e-12
    )


# --- columns ---


def column(ratio: float, aside: float = 1e-4, rigidity: float = 100.0) -> ErrorModel:
    """Return an upright link with a weight a little aside of its top: ratio of Euler's load π² EI / 4 l²."""
    mass = ratio * np.pi**2 * rigidity / 4 / 9.81
    sources = [Beam(link="arm", EI=rigidity), Payload(at="tool", mass=mass, com=(0.0, 0.0, aside))]
    chain = one_link(axis=(0, 1, 0), gravity=(-9.81, 0.0, 0.0))
    return ErrorModel(chain, Space(), sources, {"here": [0.0]}, statics="equilibrium")


def test_an_eccentric_column_bends_as_the_secant_formula_says():
    """The eccentricity times sec(π/2 √r) - 1, Timoshenko and Gere."""
    for ratio in (0.1, 0.5, 0.95):
        expected = 1e-4 * (1 / np.cos(np.pi / 2 * np.sqrt(ratio)) - 1)
        moved = -column(ratio).at().error_at_means[2]
        assert abs(moved) == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("ratio", "aside"), [(1.02, 0.0), (1.5, 1e-4)])
def test_a_column_past_eulers_load_is_refused(ratio, aside):
    with pytest.raises(InputError, match="the arm buckles under its loads: beyond") as caught:
        column(ratio, aside).at()
    factor = float(caught.value.findings[0].message.split("beyond ")[1].split()[0])
    assert factor == pytest.approx(1 / ratio, rel=0.01)


def rod(forces: np.ndarray, offset: np.ndarray, rigidities: np.ndarray, count: int) -> np.ndarray:
    """Return ``[d; δ]`` of a cantilever's end along x, l = 1: a Kirchhoff rod of straight pieces with a weight at its end.

    The weight hangs off the end by ``offset`` in the end's axes, which turn with it. Shape, moments and curvatures in turn.
    """
    curvatures = np.zeros((count, 3))
    for _ in range(100):
        turn, here, middles, frames = np.eye(3), np.zeros(3), [], []
        for curvature in curvatures:
            half = Rotation.from_rotvec(curvature / (2 * count)).as_matrix()
            frames.append(turn @ half)
            middles.append(here + frames[-1][:, 0] / (2 * count))
            here, turn = here + frames[-1][:, 0] / count, frames[-1] @ half
        weight = here + turn @ offset
        last = curvatures
        curvatures = np.array(
            [
                frame.T @ np.cross(weight - middle, forces) / rigidities
                for frame, middle in zip(frames, middles, strict=True)
            ]
        )
        if np.abs(curvatures - last).max() < 1e-13:
            break
    return np.concatenate([here - [1.0, 0, 0], Rotation.from_matrix(turn).as_rotvec()])


@pytest.mark.slow
def test_a_link_bends_and_twists_as_a_rod_in_space_to_second_order():
    """A slanted weight well off the end of a link with three rigidities: the gap is of third order in the load."""
    down, offset, rigidities = np.array([-3.0, 5.0, -7.0]), np.array([0.1, 0.3, -0.2]), np.array([60.0, 200.0, 90.0])
    gaps = []
    for mass in (0.25, 0.5, 1.0):
        chain = one_link(axis=(0, 0, 1), gravity=tuple(down))
        sources = [
            Beam(link="arm", GI=rigidities[0], EI_y=rigidities[1], EI_z=rigidities[2]),
            Payload(at="tool", mass=mass, com=tuple(offset)),
        ]
        error = ErrorModel(chain, Space(), sources, statics="equilibrium").at([0.0]).error_at_means
        coarse, fine = (rod(mass * down, offset, rigidities, count) for count in (40, 80))
        expected = (4 * fine - coarse) / 3
        gaps.append(np.linalg.norm(error - expected) / np.linalg.norm(expected))
    np.testing.assert_allclose(np.diff(np.log(gaps)) / np.log(2), 2.0, atol=0.15)


# --- warnings ---


@pytest.mark.slow
def test_a_robot_that_varies_too_much_is_warned_of(arm):
    """Lognormal, 70 %: the robots that are solved one by one rest elsewhere by more than 2 %."""
    model = loaded(arm, Lognormal(0.7, 1.0))
    (*_, finding) = model.statics_findings(model.at(PAPER_Q))
    assert finding.code == "W_STATICS"
    assert "solved one by one" in finding.message
    given, true = (float(finding.message.split("|d| ")[1].split(" mm for ")[k].split()[0]) for k in (0, 1))
    farthest = np.sort(model.space.sample(0, 0, 1000)[0])[[0, 9]]
    rods = [1e3 * np.linalg.norm(rods_error(value)[:3]) for value in farthest]
    assert min(abs(true / truth - 1) for truth in rods) < 5e-3
    assert abs(given / true - 1) > 0.005


def test_a_robot_of_the_sample_that_buckles_is_warned_of():
    tower = one_link(axis=(0, 1, 0), gravity=(-9.81, 0.0, 0.0)).with_payload(10.0)
    sources = [JointCompliance(joint="hinge", compliance=Uniform(0.4 / 98.1, mean=0.7 / 98.1))]
    model = ErrorModel(tower, Space(), sources, statics="equilibrium")
    at = model.at([0.01])
    tenth = 1e3 * np.sort(np.linalg.norm(at.exact(model.space.sample(0, 0, 1000))[:3], axis=0))[-10]
    told = f"of 1,000 robots the one with |d| {tenth:.3g} mm fails: the arm buckles"
    assert any(found.code == "W_STATICS" and told in found.message for found in model.statics_findings(at))


def test_nominal_statics_do_not_hide_an_upright_arm_that_buckles():
    """It rests where it stands, but not stably: no load moves it there, so only a push tells."""
    upright = leaning(1.5, 0.0)
    nominal = ErrorModel(upright.chain, Space(), upright.sources, upright.poses)
    (finding,) = nominal.statics_findings(nominal.at())
    assert finding.code == "W_NO_REST"
    assert "buckles under its loads: beyond 0.667 times these" in finding.message


@pytest.mark.slow
def test_nominal_statics_warn_where_they_are_stretched(arm):
    """About a millimetre apart at the paper's stiffness: more than a tenth of a spread of 1 mm, less of one of 20 mm."""
    tolerance = {spread: Length(joint="joint3", parameters=(Uniform(spread * np.sqrt(3)),)) for spread in (1e-3, 20e-3)}

    def model(factor: float, spread: float) -> ErrorModel:
        return loaded(arm, Fixed(factor), sources=(tolerance[spread],), statics="nominal")

    def warned(given: ErrorModel) -> list[str]:
        return [finding.code for finding in given.statics_findings(given.at(PAPER_Q))]

    soft = model(1.0, 1e-3)
    (finding,) = soft.statics_findings(soft.at(PAPER_Q))
    gap = np.linalg.norm((soft.at(PAPER_Q).tangent[0] - loaded(arm).at(PAPER_Q).tangent[0])[:3])
    assert finding.code == "W_STATICS"
    assert finding.severity == "warning"
    assert f"put the tip {gap * 1e3:.3g} mm away" in finding.message
    assert warned(model(1.0, 20e-3)) == []
    assert warned(model(0.02, 1e-3)) == ["W_DEFLECTION", "W_STATICS"]  # links bend by more than a radian
    assert warned(ErrorModel(arm, Space(), [tolerance[1e-3]])) == []
