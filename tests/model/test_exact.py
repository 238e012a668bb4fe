"""The exact engine against chains multiplied out from the definition of places, and against Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from precision_pin.base.errors import InputError, InternalError
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Uniform
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Chain
from precision_pin.robot.examples import PAPER_SHEET, example_urdfs
from precision_pin.robot.places import Place
from precision_pin.sources.frame import Frame
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.terms.source import Source
from precision_pin.terms.term import JointValue, Term
from support.oracles import displaced_pose, displacements, virtual_joint_pose
from support.plain_robot import inserted, pose_error
from support.sheets import PAPER_Q, SEVEN_Q, everything, seven_joint_arm


@pytest.mark.fast(3)
@pytest.mark.parametrize("scale", [1.0, 30.0])
@pytest.mark.parametrize("prismatic", [(), (4,), (2, 7)])
def test_sampled_errors_of_all_sources_against_the_definition(prismatic, scale):
    model = everything(seven_joint_arm(prismatic=prismatic), scale)
    at = model.at(SEVEN_Q)
    x = model.space.sample(11, 0, 6)
    nominal = displaced_pose(model.chain, SEVEN_Q, {})
    np.testing.assert_allclose(nominal, at.posture.pose, atol=1e-14)
    for error, column in zip(at.exact(x).T, x.T, strict=True):
        totals = displacements(at.terms, dict(zip(model.space.components, column, strict=True)))
        expected = pose_error(displaced_pose(model.chain, SEVEN_Q, totals), nominal)
        np.testing.assert_allclose(error, expected, atol=1e-13)
        assert np.linalg.norm(error[:3]) > 1e-3 * scale


def test_the_paper_sheet_against_the_definition():
    model = ErrorModel.load(PAPER_SHEET)
    at = model.at()
    x = model.space.sample(3, 1000, 8)
    nominal = displaced_pose(model.chain, PAPER_Q, {})
    for error, column in zip(at.exact(x).T, x.T, strict=True):
        totals = displacements(at.terms, dict(zip(model.space.components, column, strict=True)))
        np.testing.assert_allclose(error, pose_error(displaced_pose(model.chain, PAPER_Q, totals), nominal), atol=1e-14)


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
@pytest.mark.parametrize("turn", [0.12, *(pytest.param(turn, marks=pytest.mark.slow) for turn in (1e-4, 0.02))])
@pytest.mark.parametrize("name", ["seven", "ur5", "panda", "tiago"])
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


def test_a_total_turn_of_nearly_pi_and_places_beyond_it():
    chain = seven_joint_arm()
    for turn in (3.0, 3.14):
        at = ErrorModel(chain, Space(), [Frame(frame="tool", rx=turn)]).at(SEVEN_Q)
        moved = at.posture.pose @ inserted([0, 0, 0, turn, 0, 0])
        expected = pose_error(moved, at.posture.pose)
        np.testing.assert_allclose(at.exact(np.zeros((0, 1)))[:, 0], expected, atol=1e-13)
    at = ErrorModel(chain, Space(), [Frame(frame="tool", rx=np.pi)]).at(SEVEN_Q)
    with pytest.raises(InputError, match="half a turn or more"):
        at.exact(np.zeros((0, 1)))


@pytest.mark.parametrize("far", [{"x": 1.7e308}, {"rx": 1e200}])
def test_errors_beyond_any_number_are_refused(far):
    at = ErrorModel(seven_joint_arm(), Space(), [Frame(frame="tool", **far)] * 2).at(SEVEN_Q)
    with pytest.raises(InputError, match="too large to compute with"):
        at.exact(np.zeros((0, 1)))


def test_a_place_adds_what_several_sources_do_to_it():
    """Not the product of their motions: Σd and Σδ make one E."""
    chain = seven_joint_arm()
    sources = [
        Frame(joint="joint3", x=0.1, rx=0.5),
        Frame(joint="joint3", y=0.2, ry=-0.7),
        Frame(joint="joint3", z=-0.1, rz=0.4),
    ]
    one = Frame(joint="joint3", x=0.1, y=0.2, z=-0.1, rx=0.5, ry=-0.7, rz=0.4)
    none = np.zeros((0, 1))
    apart, together = (ErrorModel(chain, Space(), given).at(SEVEN_Q).exact(none) for given in (sources, [one]))
    np.testing.assert_allclose(apart, together, atol=1e-15)


def test_the_end_comes_before_the_seat():
    chain = seven_joint_arm()
    both = [Frame(joint="joint3", rx=0.5), Frame(link="link2", ry=0.7)]
    at = ErrorModel(chain, Space(), both).at(SEVEN_Q)
    origin = at.posture.place_pose(chain.end(2))
    moved = origin @ inserted([0, 0, 0, 0, 0.7, 0]) @ inserted([0, 0, 0, 0.5, 0, 0]) @ np.linalg.inv(origin)
    expected = pose_error(moved @ at.posture.pose, at.posture.pose)
    np.testing.assert_allclose(at.exact(np.zeros((0, 1)))[:, 0], expected, atol=1e-14)


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
        place = Place.custom(2, 0, self.name, at_x(self.shift))
        yield Term.of(place, [0, 0, 0, 0, 0, 1.0], self.turn)


def at_x(distance: float) -> np.ndarray:
    return inserted([distance, 0, 0, 0, 0, 0])


def test_places_of_different_sources_may_have_one_rank():
    chain = seven_joint_arm()
    sources = [Custom(name="a", shift=0.1, turn=0.3), Custom(name="b", shift=0.3, turn=-0.4)]
    at = ErrorModel(chain, Space(), sources).at(SEVEN_Q)
    assert len(at.table.targets) == 2
    base = at.posture.link_poses[2]
    moved = base
    for place, turn in ((at_x(0.1), 0.3), (at_x(0.3), -0.4)):
        moved = moved @ place @ inserted([0, 0, 0, 0, 0, turn]) @ np.linalg.inv(place)
    expected = pose_error(moved @ np.linalg.inv(base) @ at.posture.pose, at.posture.pose)
    np.testing.assert_allclose(at.exact(np.zeros((0, 1)))[:, 0], expected, atol=1e-14)
    backwards = ErrorModel(chain, Space(), sources[::-1]).at(SEVEN_Q)
    np.testing.assert_array_equal(backwards.exact(np.zeros((0, 1))), at.exact(np.zeros((0, 1))))


def test_one_place_with_two_frames_is_a_fault_of_the_source():
    sources = [Custom(name="a", shift=0.1, turn=0.3), Custom(name="a", shift=0.2, turn=0.3)]
    with pytest.raises(InternalError, match="two different places"):
        ErrorModel(seven_joint_arm(), Space(), sources).at(SEVEN_Q)


def test_no_sources_no_error():
    at = ErrorModel(seven_joint_arm(), Space(), []).at(SEVEN_Q)
    assert at.table.targets == ()
    np.testing.assert_array_equal(at.exact(np.zeros((0, 3))), np.zeros((6, 3)))
    np.testing.assert_array_equal(at.linear(np.zeros((0, 3))), np.zeros((6, 3)))
    error, jacobian = at.tangent
    np.testing.assert_array_equal(error, np.zeros(6))
    assert jacobian.shape == (6, 0)
    np.testing.assert_array_equal(at.covariance, np.zeros((6, 6)))


@pytest.mark.parametrize("x", [np.zeros(1), np.zeros((2, 3)), np.zeros((1, 2, 3)), 0.0])
def test_values_of_the_wrong_shape_are_refused(x):
    model = ErrorModel(seven_joint_arm(), Space((Draw("a", Uniform(1.0)),)), [Frame(joint="joint1", x="a")])
    with pytest.raises(InputError, match=r"expected \(1, N\)"):
        model.at(SEVEN_Q).exact(x)


def test_terms_are_checked():
    chain = seven_joint_arm()
    for target, twist, message in (
        (JointValue(0), np.zeros(6), "must be 1 finite"),
        (chain.end(1), np.zeros(1), "must be 6 finite"),
        (chain.end(1), np.full(6, np.nan), "must be 6 finite"),
    ):
        with pytest.raises(InputError, match=message):
            Term(target, twist)
    space = Space(tuple(Draw(name, Uniform(1.0)) for name in "abcd"))
    factors = tuple(space.parameter(name) for name in "abcd")
    with pytest.raises(InputError, match="4 factors, at most 3"):
        Term(JointValue(0), np.ones(1), factors)
    assert Term.of(JointValue(0), 2.0, 3.0, factors[0], 0.5).twist.tolist() == [3.0]
