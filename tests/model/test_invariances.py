"""What must not matter: order of sources, other sources, where the base stands, how a law is written."""

from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources.frame import Frame
from precision_pin.sources.joint_offset import JointOffset
from precision_pin.sources.length import Length
from precision_pin.terms.bound_source import labels
from support.plain_robot import PlainRobot, chain_of, joint, link, random_arm
from support.sheets import SEVEN_Q, everything, geometry, loads, named, seven_joint_arm


def by_name(model: ErrorModel, x) -> dict[str, np.ndarray]:
    return dict(zip(model.space.components, x, strict=True))


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_sources_does_not_matter(seed):
    chain = seven_joint_arm()
    space, laden = loads()
    sources = [*laden, *geometry(chain), Frame(joint="joint4", x=Normal(1e-3)), Frame(joint="joint4", x=Uniform(1e-3))]
    shuffled = [sources[k] for k in np.random.default_rng(seed).permutation(len(sources))]
    draws = [space.draws[k] for k in np.random.default_rng(seed).permutation(len(space.draws))]
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


def test_adding_a_source_elsewhere_changes_no_other_draw():
    chain = seven_joint_arm()
    sources = geometry(chain)
    one = ErrorModel(chain, Space(), sources)
    more = ErrorModel(chain, Space(), [JointOffset(joint="joint7", offset=Normal(1.0)), *sources])
    x, y = (by_name(model, model.space.sample(9, 0, 30)) for model in (one, more))
    assert set(y) - set(x) == {"joint_offset[joint7].offset"}
    for name, row in x.items():
        np.testing.assert_array_equal(row, y[name])


def test_two_sources_with_one_label_get_draws_of_their_own():
    chain = seven_joint_arm()
    pair = [Frame(joint="joint4", x=Uniform(1e-3)), Frame(joint="joint4", x=Uniform(2e-3))]
    assert labels(pair) == ("frame[joint4]", "frame[joint4]#2")
    assert labels(pair[::-1]) == ("frame[joint4]#2", "frame[joint4]")
    model = ErrorModel(chain, Space(), pair)
    assert model.space.components == ("frame[joint4].x", "frame[joint4]#2.x")
    x = model.space.sample(1, 0, 1000)
    assert not np.allclose(x[0] / 1e-3, x[1] / 2e-3)
    # four standard errors of a correlation of independent numbers
    assert abs(np.corrcoef(x)[0, 1]) < 4 / np.sqrt(1000)
    # the very same source twice is two independent errors as well
    twins = ErrorModel(chain, Space(), [pair[0], pair[0]])
    assert twins.space.components == ("frame[joint4].x", "frame[joint4]#2.x")
    np.testing.assert_allclose(
        twins.at(SEVEN_Q).covariance, 2 * ErrorModel(chain, Space(), pair[:1]).at(SEVEN_Q).covariance
    )


def test_a_shared_parameter_is_one_number():
    chain = seven_joint_arm()
    space = Space((Draw("a", Uniform(1e-3)),))
    shared = [Frame(joint="joint4", x="a"), Frame(frame="tool", y="a")]
    at = ErrorModel(chain, space, shared).at(SEVEN_Q)
    assert at.space.components == ("a",)
    alone = [ErrorModel(chain, space, [source]).at(SEVEN_Q).jacobian for source in shared]
    np.testing.assert_allclose(at.jacobian, sum(alone), atol=1e-15)


def test_one_name_with_two_laws_is_refused():
    named = [Frame(joint="joint4", x=Draw("a", Uniform(1e-3))), Frame(frame="tool", y=Draw("a", Uniform(2e-3)))]
    with pytest.raises(InputError, match="'a' is given twice with different laws"):
        ErrorModel(seven_joint_arm(), Space(), named)
    same = [Frame(joint="joint4", x=Draw("a", Uniform(1e-3))), Frame(frame="tool", y=Draw("a", Uniform(1e-3)))]
    assert ErrorModel(seven_joint_arm(), Space(), same).space.components == ("a",)


@pytest.mark.parametrize("rpy", [(0.3, -0.4, 1.2), (np.pi, 0, 0), (0, np.pi / 2, 0)])
def test_turning_base_and_gravity_together_leaves_the_errors_in_tool_axes(rpy):
    text = random_arm(51, prismatic=(4,))
    mount = joint("mount", "fixed", "ground", "base", (0, 0, 0), rpy)
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
