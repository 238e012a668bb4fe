"""The exact engine against the definition of places and Pinocchio, its first-order models, and what must not matter."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from precision_pin import Chain, Draw, ErrorModel, InputError, Scope, Source, Space, Term, Uniform
from precision_pin.base.errors import InternalError, UnknownNameError
from precision_pin.draws.expressions import Component
from precision_pin.draws.space import LabelledSpace
from precision_pin.robot.examples import PAPER_SHEET, example_urdfs
from precision_pin.robot.places import Place
from precision_pin.sources import Frame, JointOffset, Length
from precision_pin.terms.bound_source import labels
from precision_pin.terms.term import JointValue
from support.checks.common import one_link
from support.oracles import displaced_pose, displacements, virtual_joint_pose
from support.plain_robot import inserted, pose_error
from support.sheets import PAPER_Q, SEVEN_Q, everything, geometry, seven_joint_arm, spread_out

NOTHING = np.zeros((0, 1))


def check_against_definition(model: ErrorModel, q, x: np.ndarray, atol: float) -> None:
    at = model.at(q)
    nominal = displaced_pose(model.chain, q, {})
    np.testing.assert_allclose(nominal, at.posture.pose, atol=1e-14)
    for error, column in zip(at.exact(x).T, x.T, strict=True):
        totals = displacements(at.terms, dict(zip(model.space.components, column, strict=True)))
        np.testing.assert_allclose(error, pose_error(displaced_pose(model.chain, q, totals), nominal), atol=atol)


@pytest.mark.fast(1)
@pytest.mark.parametrize(("prismatic", "scale"), [((2, 7), 30.0), ((), 1.0)])
def test_sampled_errors_of_all_sources_against_the_definition(prismatic, scale):
    model = everything(seven_joint_arm(prismatic=prismatic), scale)
    x = model.space.sample(11, 0, 6)
    check_against_definition(model, SEVEN_Q, x, 1e-13)
    assert np.linalg.norm(model.at(SEVEN_Q).exact(x)[:3], axis=0).min() > 1e-3 * scale


def test_the_paper_sheet_against_the_definition():
    model = ErrorModel.load(PAPER_SHEET)
    check_against_definition(model, PAPER_Q, model.space.sample(3, 1000, 8), 1e-14)


def frames_and_offsets(chain: Chain, joint_errors, ends, seats) -> ErrorModel:
    """Six fixed errors at every end and seat, one at every joint."""
    names = ("x", "y", "z", "rx", "ry", "rz")
    first = {where.link: name for name, where in reversed(chain.link_frames.items())}
    sources: list[Source] = []
    for number, error in enumerate(ends):
        sources.append(Frame(link=first[number], **dict(zip(names, map(float, error), strict=True))))
    for name, error in zip(chain.joint_names, seats, strict=False):
        sources.append(Frame(joint=name, **dict(zip(names, map(float, error), strict=True))))
    for name, error in zip(chain.joint_names, joint_errors, strict=True):
        sources.append(JointOffset(joint=name, offset=float(error)))
    return ErrorModel(chain, Space(), sources)


@pytest.mark.fast(2)
@pytest.mark.parametrize(("name", "turn"), [("seven", 0.12), ("ur5", 0.02), ("panda", 0.12), ("tiago", 1e-4)])
@pytest.mark.filterwarnings("ignore:.*W_JOINT_LIMIT")
def test_pinocchio_with_a_virtual_joint_for_every_error(name, turn):
    """Three slides and a ball at every end and seat; at the largest size about 1.5 to 2.5 rad of turns in all."""
    tips = {"ur5": "tool0", "panda": "panda_hand_tcp", "tiago": "arm_tool_link"}
    chain = seven_joint_arm(prismatic=(2, 6)) if name == "seven" else Chain.from_urdf(example_urdfs()[name], tips[name])
    generator = np.random.default_rng(8)
    count = len(chain.joints)
    q = generator.uniform(-1.2, 1.2, count)
    joint_errors = generator.uniform(-turn, turn, count)
    ends, seats = (generator.uniform(-1, 1, (count + 1, 6)) * ([turn / 3] * 3 + [turn] * 3) for _ in range(2))
    seats[-1] = 0
    total = sum(np.linalg.norm(rows[:, 3:], axis=1).sum() for rows in (ends, seats)) + np.abs(joint_errors).sum()
    assert turn < 0.1 or total > 1.4
    at = frames_and_offsets(chain, joint_errors, ends, seats).at(q)
    none = np.zeros(count)
    still = np.zeros((count + 1, 6))
    expected = pose_error(
        virtual_joint_pose(chain, q, joint_errors, ends, seats), virtual_joint_pose(chain, q, none, still, still)
    )
    np.testing.assert_allclose(at.exact(np.zeros((0, 1)))[:, 0], expected, atol=2e-13)


def test_turns_of_nearly_pi_are_exact_and_beyond_it_and_any_number_they_are_refused():
    chain = seven_joint_arm()
    for turn in (3.0, 3.14):
        at = ErrorModel(chain, Space(), [Frame(frame="tool", rx=turn)]).at(SEVEN_Q)
        expected = pose_error(at.posture.pose @ inserted([0, 0, 0, turn, 0, 0]), at.posture.pose)
        np.testing.assert_allclose(at.exact(NOTHING)[:, 0], expected, atol=1e-13)
    for far, message in (
        ({"rx": np.pi / 2}, "180° or more"),
        ({"x": 1.7e308}, "too large to compute with"),
        ({"rx": 1e200}, "too large to compute with"),
    ):
        at = ErrorModel(chain, Space(), [Frame(frame="tool", **far)] * 2).at(SEVEN_Q)
        with pytest.raises(InputError, match=message):
            at.exact(NOTHING)


def test_values_of_the_wrong_shape_are_refused():
    at = ErrorModel(seven_joint_arm(), Space(), [Frame(joint="joint1", x=Uniform(1.0))]).at(SEVEN_Q)
    for x in (np.zeros(1), np.zeros((2, 3)), np.zeros((1, 2, 3)), 0.0):
        with pytest.raises(InputError, match=r"expected \(1, N\)"):
            at.exact(x)


def test_a_place_adds_what_several_sources_do_to_it():
    """Not the product of their motions: Σd and Σδ make one E."""
    chain = seven_joint_arm()
    sources = [
        Frame(joint="joint3", x=0.1, rx=0.5),
        Frame(joint="joint3", y=0.2, ry=-0.7),
        Frame(joint="joint3", z=-0.1, rz=0.4),
    ]
    one = Frame(joint="joint3", x=0.1, y=0.2, z=-0.1, rx=0.5, ry=-0.7, rz=0.4)
    apart, together = (ErrorModel(chain, Space(), given).at(SEVEN_Q).exact(NOTHING) for given in (sources, [one]))
    np.testing.assert_allclose(apart, together, atol=1e-15)


@dataclass(frozen=True, eq=False, kw_only=True)
class Custom(Source):
    """Turns a place of its own about z."""

    name: str
    shift: float
    turn: float

    @property
    def subject(self) -> str:
        return self.name

    def terms(self, posture, space: LabelledSpace):
        place = Place.custom(2, 0, self.name, inserted([self.shift, 0, 0, 0, 0, 0]))
        yield Term.of(place, [0, 0, 0, 0, 0, 1.0], self.turn)


def test_places_of_different_sources_may_have_one_rank():
    chain = seven_joint_arm()
    sources = [Custom(name="a", shift=0.1, turn=0.3), Custom(name="b", shift=0.3, turn=-0.4)]
    one, other = (ErrorModel(chain, Space(), order) for order in (sources, sources[::-1]))
    assert len(one.at(SEVEN_Q).table.targets) == 2
    check_against_definition(one, SEVEN_Q, np.zeros((0, 1)), 1e-14)
    np.testing.assert_array_equal(other.at(SEVEN_Q).exact(NOTHING), one.at(SEVEN_Q).exact(NOTHING))
    with pytest.raises(InternalError, match="two different places"):
        ErrorModel(chain, Space(), [sources[0], replace(sources[1], name="a")]).at(SEVEN_Q)


def test_no_sources_no_error():
    at = ErrorModel(seven_joint_arm(), Space(), []).at(SEVEN_Q)
    error, jacobian = at.tangent
    assert jacobian.shape == (6, 0)
    for found in (at.exact(np.zeros((0, 3))), at.linear(np.zeros((0, 3))), error, at.covariance):
        np.testing.assert_array_equal(found, np.zeros(found.shape))


def test_terms_are_checked():
    factors = tuple(Component(name) for name in "abcd")
    for target, twist, many, message in (
        (JointValue(0), np.zeros(6), 0, "must be 1 finite"),
        (seven_joint_arm().end(1), np.zeros(1), 0, "must be 6 finite"),
        (seven_joint_arm().end(1), np.full(6, np.nan), 0, "must be 6 finite"),
        (JointValue(0), np.ones(1), 4, "4 factors, at most 3"),
    ):
        with pytest.raises(InputError, match=message):
            Term(target, twist, factors[:many])
    assert Term.of(JointValue(0), 2.0, 3.0, factors[0], 0.5).twist.tolist() == [3.0]


# what must not matter ------------------------------------------------------------------------------------------------


def test_two_sources_with_one_label_get_draws_of_their_own():
    pair = [Frame(joint="joint4", x=Uniform(1e-3)), Frame(joint="joint4", x=Uniform(2e-3))]
    assert labels(pair) == ("frame[joint4]", "frame[joint4]#2")
    assert labels(pair[::-1]) == ("frame[joint4]#2", "frame[joint4]")
    # the very same source twice is two independent errors as well
    one, twins = (ErrorModel(seven_joint_arm(), Space(), of) for of in (pair[:1], [pair[0], pair[0]]))
    assert twins.space.components == ("frame[joint4].x", "frame[joint4]#2.x")
    np.testing.assert_allclose(twins.at(SEVEN_Q).covariance, 2 * one.at(SEVEN_Q).covariance)


def test_a_shared_parameter_is_one_number_and_one_name_with_two_laws_is_refused():
    chain = seven_joint_arm()

    def sharing(one, other) -> ErrorModel:
        sources = [Frame(joint="joint4", x=Draw("a", one)), Frame(frame="tool", y=Draw("a", other))]
        return ErrorModel(chain, Space(), sources)

    model = sharing(Uniform(1e-3), Uniform(1e-3))
    assert model.space.components == ("a",)
    alone = [ErrorModel(chain, Space(), [source]).at(SEVEN_Q).jacobian for source in model.sources]
    np.testing.assert_allclose(model.at(SEVEN_Q).jacobian, sum(alone), atol=1e-15)
    with pytest.raises(InputError, match="'a' is given twice with different laws"):
        sharing(Uniform(1e-3), Uniform(2e-3))


def test_scopes_reach_the_draws():
    laws = tuple(Draw("", Uniform(1e-3), scope) for scope in Scope)
    space = ErrorModel(seven_joint_arm(), Space(), [Length(joint="joint3", parameters=laws)]).space
    assert [draw.name for draw in space.draws] == [f"length[joint3].parameters{k}" for k in ("", "[1]", "[2]")]
    assert [draw.scope for draw in space.draws] == list(Scope)


def test_poses_by_name_in_order_and_by_default():
    chain = seven_joint_arm()
    model = ErrorModel(chain, Space(), [], poses={"first": SEVEN_Q, "zero": [0.0] * 7})
    np.testing.assert_array_equal(model.configuration(), SEVEN_Q)
    np.testing.assert_array_equal(model.at("zero").posture.q, np.zeros(7))
    np.testing.assert_array_equal(model.at(SEVEN_Q).posture.q, SEVEN_Q)
    with pytest.raises(UnknownNameError, match="no pose named 'frist'; did you mean 'first'"):
        model.at("frist")
    with pytest.raises(InputError, match="the model has no poses"):
        ErrorModel(chain, Space(), []).at()


def test_superposition_is_of_second_order_without_gravity_and_with_zero_means():
    chain = seven_joint_arm(gravity=(0, 0, 0))
    model = ErrorModel(chain, Space(), geometry(chain))
    np.testing.assert_array_equal(model.space.mean, 0)
    at = model.at(SEVEN_Q)
    halvings, delta = np.array([1.0, 0.5, 0.25, 0.125]), spread_out(model, 1)[:, None]
    remainders = np.linalg.norm(at.exact(delta * halvings) - at.linear(delta * halvings), axis=0)
    assert np.polyfit(np.log2(halvings), np.log2(remainders), 1)[0] == pytest.approx(2.0, abs=0.05)
    np.testing.assert_allclose(at.jacobian, at.linear(np.eye(model.space.size)), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("name", ["paper", "seven joints", "seven joints that turn"])
def test_the_tangent_against_finite_differences(name):
    """Fourth-order differences over a tenth of a deviation or so, every column to 1e-7 of its size."""
    prismatic = () if name.endswith("turn") else (4,)
    model = ErrorModel.load(PAPER_SHEET) if name == "paper" else everything(seven_joint_arm(prismatic=prismatic))
    at, mean = model.at(PAPER_Q if name == "paper" else SEVEN_Q), model.space.mean
    np.testing.assert_array_equal(at.tangent[0], at.exact(mean[:, None])[:, 0])
    steps = np.maximum(np.abs(mean) * 1e-3, 1e-4)
    points = np.repeat(mean[:, None], 4 * model.space.size, axis=1)
    for k, step in enumerate(steps):
        points[k, 4 * k : 4 * k + 4] += step * np.array([-2, -1, 1, 2])
    slopes = at.exact(points).reshape(6, -1, 4) @ np.array([1, -8, 8, -1]) / 12 / steps
    size = np.abs(slopes).max(axis=0)
    worst = np.abs(at.jacobian - slopes) / np.maximum(1e-7 * size, 1e-12)
    assert worst.max() <= 1, model.space.components[worst.max(axis=0).argmax()]


def test_the_covariance_is_that_of_the_tangent():
    model = everything(seven_joint_arm())
    at = model.at(SEVEN_Q)
    np.testing.assert_allclose(at.covariance, at.jacobian @ model.space.covariance @ at.jacobian.T, rtol=1e-14)


@pytest.mark.parametrize(("half_width", "warned"), [(0.080, True), (0.093, False)])
def test_superposition_stretched_is_warned_about(half_width, warned):
    """A fixed turn of 0.1 rad at 1 m: superposition is 5.0 mm off; a tenth of the spread is t/√3/10 and a bit."""
    chain = one_link()
    sources = [JointOffset(joint="hinge", offset=Uniform(half_width, mean=0.1))]
    at = ErrorModel(chain, Space(), sources).at([0.0])
    gap = np.hypot(np.cos(0.1) - 1, np.sin(0.1) - 0.1)
    assert bool(gap > 0.1 * half_width / np.sqrt(3)) is warned
    assert ([finding.code for finding in at.findings("linear")] == ["W_SUPERPOSITION"]) is warned
    assert at.findings("exact") == ()
