"""Equilibrium statics of robots whose stiffness and load vary: against exact rods, and against robots solved one by one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Draw
from precision_pin.draws.expressions import Component
from precision_pin.draws.laws import Fixed, Law, Lognormal, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources.beam import Beam
from precision_pin.sources.frame import Frame
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.sources.length import Length
from precision_pin.sources.payload import Payload
from precision_pin.terms.source import Source
from support.checks.common import one_link
from support.oracles import rods_error, settled_errors
from support.sheets import PAPER_Q

JOINTS = ("joint1", "joint2", "joint3", "joint4")


@pytest.fixture(scope="module")
def arm() -> Chain:
    return Chain.from_urdf(PAPER_SHEET.parent / "4dof.urdf", tip="tool")


def varied(arm: Chain, stiffness: Law, payload: Law | None = None, sources: tuple[Source, ...] = ()) -> ErrorModel:
    """Return the paper's arm with one factor on all stiffnesses."""
    factor = Component("factor")
    flexible = [
        Payload(at="tool", mass="mass"),
        Beam(link="link2", EI=8000.0 * factor, GI=4000.0 * factor),
        Beam(link="link3", EI=8000.0 * factor, GI=1000.0 * factor),
        *(JointCompliance(joint=name, compliance=1e-5 / factor) for name in JOINTS),
    ]
    space = Space((Draw("factor", stiffness), Draw("mass", payload or Fixed(1.0))))
    return ErrorModel(arm, space, [*flexible, *sources], statics="equilibrium")


# --- the tail ---


@pytest.mark.parametrize(
    ("law", "hundredth", "within"),
    [
        pytest.param(Uniform(0.2, mean=1.0), 0.804, 3e-4, marks=pytest.mark.slow),
        pytest.param(Uniform(0.3, mean=1.0), 0.706, 1e-3, marks=pytest.mark.slow),
        # median / exp(2.3263 s), s² = ln(1 + 0.2²)
        pytest.param(Lognormal(0.2, 1.0), 0.618607, 2e-3, marks=pytest.mark.slow),
    ],
)
def test_the_99_percent_quantile_is_that_of_exact_rods(arm, law, hundredth, within):
    """|d| falls with the stiffness, so its 99 % quantile is that of the robot at the stiffness's 1 % quantile."""
    at = varied(arm, law).at(PAPER_Q)
    truth = np.linalg.norm(rods_error(hundredth)[:3])
    modelled = np.linalg.norm(at.exact(np.array([[hundredth], [1.0]]))[:3])
    assert modelled == pytest.approx(truth, rel=within)
    sampled = np.linalg.norm(at.exact(at.space.sample(0, 0, 100_000))[:3], axis=0)
    # the quantile's standard error is below 0.1 % here
    assert np.quantile(sampled, 0.99) == pytest.approx(truth, rel=within + 3e-3)


@pytest.mark.slow
def test_products_of_load_and_stiffness_are_kept(arm):
    """Heavy and soft at once: against rods, where a first-order model is 10 % short."""
    at = varied(arm, Uniform(0.3, mean=1.0), Uniform(0.5, mean=1.0)).at(PAPER_Q)
    e0, jacobian = at.tangent
    for stiffness, mass in ((0.7, 1.5), (1.3, 1.5), (0.7, 0.5), (1.3, 0.5)):
        truth = rods_error(stiffness, mass)
        error = at.exact(np.array([[stiffness], [mass]]))[:, 0]
        assert np.linalg.norm((error - truth)[:3]) < 2e-3 * np.linalg.norm(truth[:3])
    first_order = e0 + jacobian @ [-0.3, 0.5]
    truth = rods_error(0.7, 1.5)
    assert np.linalg.norm((first_order - truth)[:3]) > 0.08 * np.linalg.norm(truth[:3])


@pytest.mark.slow
def test_stiffnesses_that_vary_one_by_one(arm):
    """A sheet with ± 30 % on EI and 10 % on every joint: 40 robots of it solved one by one, and the sampler."""
    sheet = ErrorModel.load(PAPER_SHEET)
    sources = [
        *(source for source in sheet.sources if not isinstance(source, Beam)),
        Beam(link="link2", EI=Uniform(2400.0, mean=8000.0), GI=4000.0),
        Beam(link="link3", EI=Uniform(2400.0, mean=8000.0), GI=1000.0),
    ]
    named = Space(tuple(draw for draw in sheet.space.draws if "[" not in draw.name))
    model = ErrorModel(sheet.chain, named, sources, sheet.poses, statics="equilibrium")
    at = model.at("paper")
    x = model.space.sample(3, 0, 40)
    errors = at.exact(x)
    alone = settled_errors(model, model.poses["paper"], x)
    assert (np.linalg.norm((errors - alone)[:3], axis=0) < 1e-3 * np.linalg.norm(alone[:3], axis=0)).all()
    sampled = sampler.errors(sampler.to_arrays(at), "exact", 3, 0, 40)
    np.testing.assert_allclose(sampled, errors, rtol=0, atol=1e-13)
    assert model.statics_findings(at) == ()


# --- the slopes ---


@pytest.mark.slow
def test_every_target_is_differentiated(arm):
    """Offsets, lengths, frames and axes of the arm at rest move its loads: slopes of robots settled anew, to 1e-6."""
    geometry = (
        JointOffset(joint="joint2", offset="o2"),
        JointOffset(joint="joint3", offset="o3"),
        Length(joint="joint3", along="x of joint2", parameters=("l",)),
        Frame(joint="joint4", x="x", rx="rx", rz="rz"),
    )
    names = ("o2", "o3", "l", "x", "rx", "rz")
    means = np.array([1e-3, -2e-3, 5e-4, 1e-3, 2e-3, -1e-3])
    base = varied(arm, Fixed(1.0), sources=())
    draws = tuple(Draw(name, Fixed(mean)) for name, mean in zip(names, means, strict=True))
    model = ErrorModel(arm, Space((*base.space.draws, *draws)), [*base.sources, *geometry], statics="equilibrium")
    jacobian = model.at(PAPER_Q).jacobian
    centre = np.concatenate([[1.0, 1.0], means])
    step = 1e-4
    moved = (
        centre[:, None]
        + step * np.concatenate([np.eye(8), -np.eye(8)], axis=1)[:, [2, 3, 4, 5, 6, 7, 10, 11, 12, 13, 14, 15]]
    )
    errors = settled_errors(model, PAPER_Q, moved)
    slopes = (errors[:, :6] - errors[:, 6:]) / (2 * step)
    np.testing.assert_allclose(jacobian[:, 2:], slopes, rtol=0, atol=2e-6)
    # without the loads' answer the slope of joint 2's offset is 2 % off
    rigid = ErrorModel(arm, Space(draws), geometry, statics="equilibrium").at(PAPER_Q).jacobian
    assert np.linalg.norm(rigid[:, 0] - slopes[:, 0]) > 0.01 * np.linalg.norm(slopes[:, 0])


# --- stable up to the critical load ---


def leaning(ratio: float, lean: float, down: float = -9.81) -> ErrorModel:
    """Return a weight above a soft hinge (below it with gravity up): C m g l = ratio."""
    tower = one_link(axis=(0, 1, 0), gravity=(down, 0.0, 0.0)).with_payload(10.0)
    sources = [JointCompliance(joint="hinge", compliance=ratio / (10.0 * abs(down)))]
    return ErrorModel(tower, Space(), sources, {"here": [lean]}, statics="equilibrium")


@pytest.mark.parametrize("ratio", [0.5, 0.8, 0.9, 0.99, 0.999])
def test_an_arm_is_at_rest_up_to_its_critical_load(ratio):
    """θ = r sin(lean + θ), by bisection."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if middle < ratio * np.sin(1e-3 + middle) else (low, middle)
    assert leaning(ratio, 1e-3).at().error_at_means[4] == pytest.approx(low, rel=1e-9)


@pytest.mark.fast(5)
@pytest.mark.parametrize("ratio", [1.001, 1.1, 2.0, 20.0])
@pytest.mark.parametrize("lean", [0.0, 1e-6, 1e-3])
def test_past_its_critical_load_it_is_refused_with_the_factor(ratio, lean):
    with pytest.raises(InputError, match="the arm buckles under its loads: beyond") as caught:
        leaning(ratio, lean).at()
    (finding,) = caught.value.findings
    assert "\n" not in finding.message
    assert float(finding.message.split("beyond ")[1].split()[0]) == pytest.approx(1 / ratio, rel=5e-3)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0, 100.0, 1e4])
def test_a_hanging_arm_is_at_rest_under_any_load(ratio):
    """θ = -r sin(lean + θ), at 30° from the vertical."""
    low, high = -0.5, 0.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if middle < -ratio * np.sin(0.5 + middle) else (low, middle)
    assert leaning(ratio, 0.5, 9.81).at().error_at_means[4] == pytest.approx(low, rel=1e-9)


def test_an_arm_leant_far_over_comes_to_rest_where_no_straight_one_would():
    low, high = 0.0, 2.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if middle < 1.3 * np.sin(0.7 + middle) else (low, middle)
    assert leaning(1.3, 0.7).at().error_at_means[4] == pytest.approx(low, rel=1e-9)


@pytest.mark.slow
def test_large_geometry_is_no_softness(arm):
    """A frame two metres off and a joint half a radian off: at rest where an arm drawn so is."""
    at = varied(arm, Fixed(1.0), sources=(JointOffset(joint="joint2", offset=0.5), Frame(joint="joint1", z=2.0))).at(
        PAPER_Q
    )
    drawn = varied(arm, Fixed(1.0)).at([PAPER_Q[0], PAPER_Q[1] + 0.5, *PAPER_Q[2:]])
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


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.9, 0.95])
def test_an_eccentric_column_bends_as_the_secant_formula_says(ratio):
    """The eccentricity times sec(π/2 √r) - 1, Timoshenko and Gere; one cubic has its critical load 0.75 % above Euler's."""
    expected = 1e-4 * (1 / np.cos(np.pi / 2 * np.sqrt(ratio)) - 1)
    moved = -column(ratio).at().error_at_means[2]
    assert abs(moved) == pytest.approx(expected, rel=0.012 * ratio / (1 - ratio) + 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1.02, 1.5, 4.0])
@pytest.mark.parametrize("aside", [0.0, 1e-4, 0.01])
def test_a_column_past_eulers_load_is_refused(ratio, aside):
    with pytest.raises(InputError, match="the arm buckles under its loads: beyond") as caught:
        column(ratio, aside).at()
    factor = float(caught.value.findings[0].message.split("beyond ")[1].split()[0])
    assert factor == pytest.approx(1 / ratio, rel=0.01)


@pytest.mark.slow
def test_a_bent_cantilever_is_an_elastica_to_second_order():
    """Tip force F l²/EI = α across: shooting the elastica; the gap is of third order in α, with the shortening."""
    gaps = []
    for alpha in (0.1, 0.2, 0.4):
        chain = one_link(axis=(0, 1, 0))
        sources = [Beam(link="arm", EI=100.0), Payload(at="tool", mass=100.0 * alpha / 9.81)]
        error = ErrorModel(chain, Space(), sources, statics="equilibrium").at([0.0]).error_at_means
        expected = elastica(alpha)
        gaps.append(np.linalg.norm(error[[0, 2]] - expected) / np.linalg.norm(expected))
    np.testing.assert_allclose(np.diff(np.log(gaps)) / np.log(2), 2.0, atol=0.1)
    assert gaps[0] < 6e-4


def elastica(alpha: float) -> np.ndarray:
    """Return (x, z) of a cantilever's end by θ'' = -α cos θ, θ(0) = 0, θ'(1) = 0: Runge-Kutta and bisection."""

    def end(slope: float) -> tuple[float, float, float]:
        state, h = np.array([0.0, slope, 0.0, 0.0]), 1 / 200

        def rate(s):
            return np.array([s[1], -alpha * np.cos(s[0]), np.cos(s[0]) - 1, -np.sin(s[0])])

        for _ in range(200):
            a = rate(state)
            b = rate(state + h / 2 * a)
            c = rate(state + h / 2 * b)
            state = state + h / 6 * (a + 2 * b + 2 * c + rate(state + h * c))
        return state[1], state[2], state[3]

    low, high = 0.0, alpha
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if end(middle)[0] < 0 else (low, middle)
    return np.array(end(low)[1:])


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
    """Lognormal, 70 %: the robots that are solved one by one rest elsewhere by more than 2 %; ± 30 % needs no warning."""
    stretched = varied(arm, Lognormal(0.7, 1.0))
    (*_, finding) = stretched.statics_findings(stretched.at(PAPER_Q))
    assert finding.code == "W_STATICS"
    assert "solved one by one" in finding.message
    given, true = (float(finding.message.split("|d| ")[1].split(" mm for ")[k].split()[0]) for k in (0, 1))
    factor = varied(arm, Lognormal(0.7, 1.0)).space.sample(0, 0, 1000)[0]
    farthest = np.sort(factor)[[0, 9]]
    rods = [1e3 * np.linalg.norm(rods_error(value)[:3]) for value in farthest]
    assert min(abs(true / truth - 1) for truth in rods) < 5e-3
    assert abs(given / true - 1) > 0.005
    assert varied(arm, Uniform(0.3, mean=1.0)).statics_findings(varied(arm, Uniform(0.3, mean=1.0)).at(PAPER_Q)) == ()


def test_a_robot_of_the_sample_that_buckles_is_warned_of():
    tower = one_link(axis=(0, 1, 0), gravity=(-9.81, 0.0, 0.0)).with_payload(10.0)
    sources = [
        JointCompliance(joint="hinge", compliance=Uniform(0.4 / 98.1, mean=0.7 / 98.1)),
    ]
    model = ErrorModel(tower, Space(), sources, statics="equilibrium")
    codes = [(finding.code, "buckles" in finding.message) for finding in model.statics_findings(model.at([0.01]))]
    assert ("W_STATICS", True) in codes


def test_nominal_statics_do_not_hide_an_upright_arm_that_buckles():
    """It rests where it stands, but not stably: no load moves it there, so only a push tells."""
    upright = leaning(1.5, 0.0)
    nominal = ErrorModel(upright.chain, Space(), upright.sources, upright.poses)
    (finding,) = nominal.statics_findings(nominal.at())
    assert finding.code == "W_NO_REST"
    assert "buckles under its loads: beyond 0.667 times these" in finding.message
