"""What must not matter to clearance, backlash and bearing stiffness together, and the compiled sampler on them."""

from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError
from precision_pin.draws.draw import Draw
from precision_pin.draws.expressions import Component
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.kernel import sampler
from precision_pin.model.error_model import ErrorModel
from precision_pin.model.pose_model import PoseModel
from precision_pin.robot.chain import Chain
from precision_pin.sources.backlash import Backlash
from precision_pin.sources.beam import Beam
from precision_pin.sources.bearing_stiffness import BearingStiffness
from precision_pin.sources.clearance import Clearance
from precision_pin.sources.payload import Payload
from precision_pin.terms.source import Source
from precision_pin.terms.term import at_means
from support.plain_robot import PlainRobot, chain_of, joint, link, random_arm
from support.sheets import SEVEN_Q

GRAVITY = (0.5, -1.0, -9.0)
K = Draw("k", Uniform(1e6, mean=5e6))


def on_every_joint(chain: Chain) -> list[Source]:
    sources: list[Source] = [
        Payload(at="tool", mass=Uniform(0.5, mean=2.0), com=(Normal(0.01), 0.0, 0.1)),
        Beam(link="link3", EI=5e4, GI=4e4),
    ]
    for slides, name in zip(chain.prismatic, chain.joint_names, strict=True):
        free = {"roll": 1e4} if slides else {"axial": 2.0 * Component("k")}
        play = {} if slides else {"axial": Uniform(1e-5, mean=3e-5)}
        sources += [
            BearingStiffness(joint=name, radial="k", tilt=Uniform(1e3, mean=1e4), centre=0.03, **free),
            Clearance(joint=name, diametral=(Uniform(1e-5, mean=4e-5), 3e-5), span=0.1, start=-0.02, band=40.0, **play),
            Backlash(joint=name, backlash=Uniform(1e-4, mean=3e-4), band=4.0),
        ]
    return sources


def in_tool_axes(at: PoseModel, engine: str, x) -> np.ndarray:
    tool = at.posture.pose[:3, :3].T
    error = getattr(at, engine)(x)
    return np.concatenate([tool @ error[:3], tool @ error[3:]])


@pytest.mark.slow
@pytest.mark.parametrize("statics", ["nominal", "equilibrium"])
def test_where_the_base_stands_and_in_what_order_sources_do_not_matter(statics):
    text = random_arm(51, prismatic=(4,))
    mount = joint("mount", "fixed", "ground", "base", (0, 0, 0), (0.3, -0.4, 1.2))
    turned = text.replace('<robot name="arm">', f'<robot name="arm">{link("ground")}{mount}')
    rotation = PlainRobot.parse(turned).poses({})["base"][:3, :3]
    straight = chain_of(text, tip="tool", gravity=GRAVITY)
    tilted = chain_of(turned, tip="tool", gravity=tuple(rotation @ GRAVITY))
    sources = on_every_joint(straight)
    one = ErrorModel(straight, Space((K,)), sources, statics=statics)
    at = one.at(SEVEN_Q)
    sided = {factor.name for term in at.terms for factor in term.factors if isinstance(factor, Component)}
    # some bearings and drives are decided and some are not
    assert 3 < sum(name.endswith((".A.x", ".B.x", ".side")) for name in sided) < 18
    x = one.space.sample(4, 0, 5)
    expected = {engine: in_tool_axes(at, engine, x) for engine in ("exact", "linear")}
    shuffled = [sources[k] for k in np.random.default_rng(1).permutation(len(sources))]
    for other in (
        ErrorModel(tilted, Space((K,)), sources, statics=statics),
        ErrorModel(straight, Space((K,)), shuffled, statics=statics),
    ):
        rows = [one.space.index[name] for name in other.space.components]
        there = other.at(SEVEN_Q)
        for engine, same in expected.items():
            np.testing.assert_allclose(in_tool_axes(there, engine, x[rows]), same, rtol=0, atol=1e-12)


def test_a_link_split_by_a_fixed_joint_is_the_same_link():
    def arm(*middle: str, parent: str = "upper", where=(0.5, 0, 0.1)) -> Chain:
        parts = (
            link("base"),
            joint("joint1", "revolute", "base", "upper", (0, 0, 0.2), (0.4, 0.2, 0), (0, 1, 0)),
            link("upper", 3.0, (0.2, 0, 0.05)),
            *middle,
            joint("joint2", "revolute", parent, "tool", where, axis=(0, 0.6, 0.8)),
            link("tool", 2.0, (0.3, 0.1, 0)),
        )
        return chain_of(f'<robot name="arm">{"".join(parts)}</robot>')

    whole = arm()
    split = arm(
        joint("weld", "fixed", "upper", "half", (0.2, 0, 0.1)),
        link("half"),
        joint("shim", "fixed", "half", "thin", (0, 0, 0)),
        link("thin"),
        parent="thin",
        where=(0.3, 0, 0),
    )
    results = []
    for chain in (whole, split):
        sources = [source for source in on_every_joint(chain) if source.kind() != "beam"]
        model = ErrorModel(chain, Space((K,)), sources)
        x = model.space.sample(4, 0, 20)
        results.append(model.at([0.3, -0.8]).exact(x))
    np.testing.assert_allclose(results[0], results[1], rtol=0, atol=1e-14)


@pytest.mark.slow
def test_the_tangent_is_the_slope_of_the_displaced_chain():
    chain = chain_of(random_arm(51, prismatic=(4,)), tip="tool", gravity=GRAVITY)
    model = ErrorModel(chain, Space((K,)), on_every_joint(chain))
    at = model.at(SEVEN_Q)
    mean = model.space.mean
    spread = np.sqrt(np.diag(model.space.covariance))
    for k in range(model.space.size):
        step = np.zeros(model.space.size)
        step[k] = 1e-3 * spread[k]
        ahead, behind = (at.exact((mean + sign * step)[:, None])[:, 0] for sign in (1, -1))
        np.testing.assert_allclose(at.jacobian[:, k] * 2 * step[k], ahead - behind, rtol=2e-6, atol=2e-14)


def test_the_compiled_sampler_draws_and_moves_as_the_clear_model():
    chain = chain_of(random_arm(51, prismatic=(4,)), tip="tool", gravity=GRAVITY)
    model = ErrorModel(chain, Space((K,)), on_every_joint(chain))
    at = model.at(SEVEN_Q)
    layout = sampler.to_arrays(at)
    for pose, visit in ((0, 0), (2, 5)):
        x = model.space.sample(7, 10, 50, pose=pose, visit=visit)
        np.testing.assert_allclose(sampler.sample(layout, 7, 10, 50, pose=pose, visit=visit), x, rtol=1e-12, atol=1e-15)
    for engine in ("linear", "exact"):
        expected = getattr(at, engine)(x)
        np.testing.assert_allclose(sampler.errors_at(layout, engine, x), expected, rtol=1e-9, atol=1e-14)


def test_numbers_at_the_means_of_their_factors():
    space = Space((K, Draw("m", Uniform(1.0, mean=2.0)), Draw("w", Normal(0.1, mean=-0.5))))
    k, m, w = (space.parameter(name) for name in ("k", "m", "w"))
    wrench = np.arange(1.0, 7.0)
    values = {(): wrench, (m,): 10 * wrench, (m, w): 100 * wrench, (m, m / k, w): -1e6 * wrench}
    # 1 + 10·2 + 100·2·(-0.5) - 1e6·2·(2/5e6)·(-0.5)
    np.testing.assert_allclose(at_means(values, space), (1 + 20 - 100 + 0.4) * wrench, rtol=1e-14)
    assert at_means({}, space) == 0.0
    with pytest.raises(InputError, match="formula"):
        at_means({(1 / (k - 5e6),): 1.0}, space)
