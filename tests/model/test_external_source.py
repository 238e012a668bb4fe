"""A source that the package does not know goes through every engine and through the sheet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, final

import numpy as np
import pytest

from precision_pin.base import units
from precision_pin.base.errors import SheetError
from precision_pin.draws.draw import Setting
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import LabelledSpace, Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.chain import Posture
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling import monte_carlo
from precision_pin.sources import catalogue
from precision_pin.sources.frame import Frame
from precision_pin.terms.source import Source
from precision_pin.terms.term import Term
from support.oracles import displaced_pose, displacements
from support.plain_robot import pose_error
from support.sheets import SEVEN_Q, seven_joint_arm

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


STEEL = Uniform(1e-6, mean=12e-6)
WARMING = Normal(5.0, mean=10.0)


def test_it_is_no_part_of_the_package():
    assert "thermal_growth" not in catalogue()
    assert ThermalGrowth.kind() == "thermal_growth"


def test_through_every_engine():
    chain = seven_joint_arm()
    model = ErrorModel(chain, Space(), [ThermalGrowth(link="link2", expansion=STEEL, warming=WARMING)])
    assert model.space.components == ("thermal_growth[link2].expansion", "thermal_growth[link2].warming")
    at = model.at(SEVEN_Q)
    way = at.posture.place_pose(chain.end(2))[:3, 3] - at.posture.link_poses[2][:3, 3]
    x = np.array([[12e-6, 13e-6], [10.0, -20.0]])
    for engine in (at.linear, at.exact):
        errors = engine(x)
        np.testing.assert_allclose(errors[:3], np.outer(way, x[0] * x[1]), atol=2e-15)
        np.testing.assert_allclose(errors[3:], 0, atol=1e-15)
    error, jacobian = at.tangent
    np.testing.assert_allclose(error[:3], way * 12e-5, atol=2e-15)
    np.testing.assert_allclose(jacobian[:3], np.outer(way, [10.0, 12e-6]), rtol=1e-12)
    variance = 10.0**2 * (1e-6) ** 2 / 3 + (12e-6) ** 2 * 5.0**2
    np.testing.assert_allclose(at.covariance[:3, :3], np.outer(way, way) * variance, rtol=1e-12)


def test_in_samples_beside_another_source():
    chain = seven_joint_arm()
    sources = [
        ThermalGrowth(link="link2", expansion=STEEL, warming=WARMING),
        ThermalGrowth(link="link4", expansion=STEEL, warming=20.0),
        Frame(joint="joint1", rz=Uniform(0.01)),
    ]
    model = ErrorModel(chain, Space(), sources)
    at = model.at(SEVEN_Q)
    x = model.space.sample(6, 0, 5)
    nominal = at.posture.pose
    for error, column in zip(at.exact(x).T, x.T, strict=True):
        totals = displacements(at.terms, dict(zip(model.space.components, column, strict=True)))
        np.testing.assert_allclose(error, pose_error(displaced_pose(chain, SEVEN_Q, totals), nominal), atol=1e-13)


@pytest.mark.slow
def test_in_a_monte_carlo_run():
    """The blocks of the sampler against the clear engine on the same numbers."""
    sources = [ThermalGrowth(link="link2", expansion=STEEL, warming=WARMING), Frame(joint="joint1", rz=Uniform(1e-3))]
    model = ErrorModel(seven_joint_arm(), Space(), sources)
    at = model.at(SEVEN_Q)
    x = model.space.sample(12, 0, 20_000)
    for name, engine in (("exact", at.exact), ("linear", at.linear)):
        result = monte_carlo(model, SEVEN_Q, samples=20_000, seed=12, model=name)
        expected = np.cov(engine(x))
        deviation = np.sqrt(np.diag(expected)) + 1e-12
        assert np.abs((result.covariance - expected) / np.outer(deviation, deviation)).max() < 1e-9


SHEET = """\
precision-pin: 1
robot: {robot}
tip: tool
poses:
  paper: -90 3 88 -91 deg
sources:
  - thermal_growth: {{link: link2, expansion: {{uniform: 1 um/(m*K), mean: 12 um/(m*K)}}, warming: {warming}}}
"""


def written(folder, warming="{normal: {std: 5 K}, mean: 10 K}"):
    file = folder / "warm.yaml"
    file.write_text(SHEET.format(robot=PAPER_SHEET.parent / "4dof.urdf", warming=warming), encoding="utf-8")
    return file


def test_from_a_sheet(tmp_path):
    model = ErrorModel.load(written(tmp_path), kinds=[ThermalGrowth])
    (source,) = model.sources
    assert isinstance(source, ThermalGrowth)
    assert model.space.components == ("thermal_growth[link2].expansion", "thermal_growth[link2].warming")
    np.testing.assert_allclose(model.space.mean, [12e-6, 10.0])
    at = model.at("paper")
    # link 2 is 1.97 m long, its x in the base at q = (-90, 3, …)° is (0, -cos 3°, -sin 3°)
    growth = 1.97 * 12e-6 * 10.0
    expected = growth * np.array([0, -np.cos(np.radians(3)), -np.sin(np.radians(3))])
    np.testing.assert_allclose(at.exact(model.space.mean[:, None])[:3, 0], expected, atol=1e-15)


@pytest.mark.parametrize(
    ("warming", "kinds", "message"),
    [
        ("10 K", [], "unknown kind of source 'thermal_growth'"),
        ("10 mm", [ThermalGrowth], "K"),
        ("10", [ThermalGrowth], "K"),
    ],
)
def test_its_settings_are_checked_like_any_other(tmp_path, warming, kinds, message):
    with pytest.raises(SheetError, match=rf"warm\.yaml:7: error E_\w+: .*{message}"):
        ErrorModel.load(written(tmp_path, warming), kinds=kinds)
