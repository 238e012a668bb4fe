"""The exact engine against the definition of places and against Pinocchio; what must not matter to it; a source of a user."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, final

import numpy as np
import pytest

from precision_pin import Chain, Draw, ErrorModel, InputError, Normal, Posture, Scope, Source, Space, Term, Uniform
from precision_pin.base import units
from precision_pin.base.errors import InternalError, SheetError, UnknownNameError
from precision_pin.draws.draw import Setting
from precision_pin.draws.space import LabelledSpace
from precision_pin.robot.examples import PAPER_SHEET, example_urdfs
from precision_pin.robot.places import Place
from precision_pin.sources import Frame, JointOffset, Length
from precision_pin.terms.bound_source import labels
from precision_pin.terms.term import JointValue
from support.oracles import displaced_pose, displacements, virtual_joint_pose
from support.plain_robot import PlainRobot, chain_of, inserted, joint, link, pose_error, random_arm
from support.sheets import PAPER_Q, SEVEN_Q, everything, geometry, loads, named, seven_joint_arm

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


def test_a_total_turn_of_nearly_pi_and_places_beyond_it():
    chain = seven_joint_arm()
    for turn in (3.0, 3.14):
        at = ErrorModel(chain, Space(), [Frame(frame="tool", rx=turn)]).at(SEVEN_Q)
        moved = at.posture.pose @ inserted([0, 0, 0, turn, 0, 0])
        expected = pose_error(moved, at.posture.pose)
        np.testing.assert_allclose(at.exact(NOTHING)[:, 0], expected, atol=1e-13)
    at = ErrorModel(chain, Space(), [Frame(frame="tool", rx=np.pi)]).at(SEVEN_Q)
    with pytest.raises(InputError, match="half a turn or more"):
        at.exact(NOTHING)


def test_errors_beyond_any_number_and_values_of_the_wrong_shape_are_refused():
    chain = seven_joint_arm()
    for far in ({"x": 1.7e308}, {"rx": 1e200}):
        at = ErrorModel(chain, Space(), [Frame(frame="tool", **far)] * 2).at(SEVEN_Q)
        with pytest.raises(InputError, match="too large to compute with"):
            at.exact(NOTHING)
    at = ErrorModel(chain, Space((Draw("a", Uniform(1.0)),)), [Frame(joint="joint1", x="a")]).at(SEVEN_Q)
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


def test_the_end_comes_before_the_seat():
    chain = seven_joint_arm()
    both = [Frame(joint="joint3", rx=0.5), Frame(link="link2", ry=0.7)]
    at = ErrorModel(chain, Space(), both).at(SEVEN_Q)
    origin = at.posture.place_pose(chain.end(2))
    moved = origin @ inserted([0, 0, 0, 0, 0.7, 0]) @ inserted([0, 0, 0, 0.5, 0, 0]) @ np.linalg.inv(origin)
    expected = pose_error(moved @ at.posture.pose, at.posture.pose)
    np.testing.assert_allclose(at.exact(NOTHING)[:, 0], expected, atol=1e-14)


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
    np.testing.assert_allclose(at.exact(NOTHING)[:, 0], expected, atol=1e-14)
    backwards = ErrorModel(chain, Space(), sources[::-1]).at(SEVEN_Q)
    np.testing.assert_array_equal(backwards.exact(NOTHING), at.exact(NOTHING))


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


# what must not matter ------------------------------------------------------------------------------------------------


def by_name(model: ErrorModel, x) -> dict[str, np.ndarray]:
    return dict(zip(model.space.components, x, strict=True))


def test_the_order_of_sources_does_not_matter():
    chain = seven_joint_arm()
    space, laden = loads()
    sources = [*laden, *geometry(chain), Frame(joint="joint4", x=Normal(1e-3)), Frame(joint="joint4", x=Uniform(1e-3))]
    shuffled = [sources[k] for k in np.random.default_rng(0).permutation(len(sources))]
    draws = [space.draws[k] for k in np.random.default_rng(0).permutation(len(space.draws))]
    one, two = ErrorModel(chain, space, sources), ErrorModel(chain, Space(tuple(draws)), shuffled)
    x, y = (model.space.sample(9, 5, 40) for model in (one, two))
    assert set(one.space.components) == set(two.space.components)
    for name, row in by_name(one, x).items():
        np.testing.assert_array_equal(row, by_name(two, y)[name], err_msg=name)
    a, b = one.at(SEVEN_Q), two.at(SEVEN_Q)
    np.testing.assert_allclose(a.exact(x), b.exact(y), atol=1e-14)
    np.testing.assert_allclose(a.linear(x), b.linear(y), atol=1e-14)
    columns = [two.space.index[name] for name in one.space.components]
    np.testing.assert_allclose(a.jacobian, b.jacobian[:, columns], rtol=1e-11, atol=1e-12)
    assert a.table.targets == b.table.targets


def test_two_sources_with_one_label_get_draws_of_their_own():
    chain = seven_joint_arm()
    pair = [Frame(joint="joint4", x=Uniform(1e-3)), Frame(joint="joint4", x=Uniform(2e-3))]
    assert labels(pair) == ("frame[joint4]", "frame[joint4]#2")
    assert labels(pair[::-1]) == ("frame[joint4]#2", "frame[joint4]")
    model = ErrorModel(chain, Space(), pair)
    assert model.space.components == ("frame[joint4].x", "frame[joint4]#2.x")
    x = model.space.sample(1, 0, 1000)
    # four standard errors of a correlation of independent numbers
    assert abs(np.corrcoef(x)[0, 1]) < 4 / np.sqrt(1000)
    # the very same source twice is two independent errors as well
    twins = ErrorModel(chain, Space(), [pair[0], pair[0]])
    assert twins.space.components == ("frame[joint4].x", "frame[joint4]#2.x")
    np.testing.assert_allclose(
        twins.at(SEVEN_Q).covariance, 2 * ErrorModel(chain, Space(), pair[:1]).at(SEVEN_Q).covariance
    )


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


def test_turning_base_and_gravity_together_leaves_the_errors_in_tool_axes():
    text = random_arm(51, prismatic=(4,))
    mount = joint("mount", "fixed", "ground", "base", (0, 0, 0), (0.3, -0.4, 1.2))
    turned = text.replace('<robot name="arm">', f'<robot name="arm">{link("ground")}{mount}')
    rotation = PlainRobot.parse(turned).poses({})["base"][:3, :3]
    gravity = (0.5, -1.0, -9.0)
    straight = everything(chain_of(text, tip="tool", gravity=gravity))
    tilted = everything(chain_of(turned, tip="tool", gravity=tuple(rotation @ gravity)))
    # the base mounting stands in axes that turn with the base, so all sources may stay
    sources = [source for source in straight.sources if source.subject != "base"]
    assert len(sources) == len(straight.sources) - 1
    straight, tilted = (ErrorModel(model.chain, named(model), sources) for model in (straight, tilted))
    assert straight.space.components == tilted.space.components
    x = straight.space.sample(4, 0, 20)
    for name in ("exact", "linear"):
        results = []
        for model in (straight, tilted):
            at = model.at(SEVEN_Q)
            tool = at.posture.pose[:3, :3].T
            error = getattr(at, name)(x)
            results.append(np.concatenate([tool @ error[:3], tool @ error[3:]]))
        np.testing.assert_allclose(results[0], results[1], atol=1e-12)


def test_scopes_reach_the_draws():
    chain = seven_joint_arm()
    laws = [Draw("", Uniform(1e-3), scope) for scope in Scope]
    model = ErrorModel(chain, Space(), [Length(joint="joint3", parameters=tuple(laws))])
    unit, pose, visit = (f"length[joint3].parameters{k}" for k in ("", "[1]", "[2]"))
    assert model.space.components == (unit, pose, visit)
    a, b, c = (by_name(model, model.space.sample(1, 0, 10, pose=p, visit=v)) for p, v in ((0, 0), (0, 1), (1, 0)))
    for name, same_visit, same_pose in ((unit, True, True), (pose, True, False), (visit, False, False)):
        assert np.array_equal(a[name], b[name]) is same_visit
        assert np.array_equal(a[name], c[name]) is same_pose


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


# a source that the package does not know -----------------------------------------------------------------------------

EXPANSION = units.Quantity("thermal expansion", "1/K", {"1/K": 1.0, "um/(m*K)": 1e-6})
TEMPERATURE = units.Quantity("temperature difference", "K", {"K": 1.0})


@final
@dataclass(frozen=True, kw_only=True)
class ThermalGrowth(Source):
    """A link grows along itself by length × expansion × warming."""

    link: str
    expansion: Annotated[Setting, EXPANSION]
    warming: Annotated[Setting, TEMPERATURE]

    @property
    def subject(self) -> str:
        return self.link

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        chain = posture.chain
        place = chain.end(chain.link_frame(self.link).link)
        growth = np.concatenate([place.frame[:3, :3].T @ place.frame[:3, 3], np.zeros(3)])
        expansion = space.value("expansion", self.expansion)
        yield Term.of(place, growth, expansion, space.value("warming", self.warming))


def test_a_source_of_a_user_from_a_sheet(tmp_path):
    """Link 2 is 1.97 m long, its x in the base at q = (-90, 3, …)° is (0, -cos 3°, -sin 3°)."""

    def load(warming: str, kinds: list[type[Source]]) -> ErrorModel:
        (tmp_path / "warm.yaml").write_text(
            f"precision-pin: 1\nrobot: {PAPER_SHEET.parent / '4dof.urdf'}\ntip: tool\nposes:\n  paper: -90 3 88 -91 deg\n"
            "sources:\n  - thermal_growth: {link: link2, expansion: {uniform: 1 um/(m*K), mean: 12 um/(m*K)}, "
            f"warming: {warming}}}\n"
        )
        return ErrorModel.load(tmp_path / "warm.yaml", kinds=kinds)

    model = load("{normal: {std: 5 K}, mean: 10 K}", [ThermalGrowth])
    (source,) = model.sources
    assert isinstance(source, ThermalGrowth)
    assert model.space.components == ("thermal_growth[link2].expansion", "thermal_growth[link2].warming")
    np.testing.assert_allclose(model.space.mean, [12e-6, 10.0])
    growth = 1.97 * 12e-6 * 10.0
    expected = growth * np.array([0, -np.cos(np.radians(3)), -np.sin(np.radians(3))])
    np.testing.assert_allclose(model.at("paper").exact(model.space.mean[:, None])[:3, 0], expected, atol=1e-15)
    for warming, kinds, message in (
        ("10 K", [], "unknown kind of source 'thermal_growth'"),
        ("10 mm", [ThermalGrowth], "K"),
    ):
        with pytest.raises(SheetError, match=rf"warm\.yaml:7: error E_\w+: .*{message}"):
            load(warming, kinds)
