from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError, SheetError, UnknownNameError
from precision_pin.draws.laws import Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources import thermal
from precision_pin.sources.thermal import Thermal
from support.checks.common import Q7, one_link
from support.checks.loads import check_thermal
from support.engines import check_engines, check_no_spread, written
from support.plain_robot import chain_of, joint, link, random_arm, robot


@pytest.mark.slow
def test_against_similarity_roark_and_slices():
    check_thermal(thermal)


def test_from_a_sheet_through_every_engine(tmp_path):
    file = written(
        tmp_path,
        "thermal: {expansion: {uniform: 1 ppm/K, mean: 23e-6 1/K}, temperature_change: warmth}\n"
        "thermal: {link: link3, expansion: 12 um/(m*K), gradient: {uniform: 20 K/m}, across: z of base}\n"
        "thermal: {link: link2, expansion: {fixed: 1 um/(m*degC)}, temperature_change: 3 degC}",
        parameters="warmth: {uniform: 2 K}",
    )
    model = ErrorModel.load(file)
    assert model.space.components == (
        "warmth",
        "thermal[arm].expansion",
        "thermal[link3].gradient",
        "thermal[link2].expansion",
    )
    np.testing.assert_allclose(model.space.mean, [0, 23e-6, 0, 1e-6], rtol=1e-15)
    check_engines(model)


def test_the_whole_arm_is_every_link_with_the_same_numbers():
    chain = chain_of(random_arm(33, prismatic=(2,)), tip="tool")
    settings = {
        "expansion": Uniform(1e-6, mean=12e-6),
        "temperature_change": Uniform(5.0, mean=1.0),
        "gradient": Uniform(3.0),
        "across": "y of joint3",
    }
    whole = ErrorModel(chain, Space(), [Thermal(**settings)])
    names = {"expansion": "thermal[arm].expansion", "temperature_change": "thermal[arm].temperature_change"}
    names |= {"gradient": "thermal[arm].gradient"}
    links = [Thermal(link=name, across="y of joint3", **names) for name in ("base", *(f"link{k}" for k in range(1, 8)))]
    single = ErrorModel(chain, whole.space, links)
    x = whole.space.sample(2, 0, 10)
    np.testing.assert_allclose(single.at(Q7).exact(x), whole.at(Q7).exact(x), rtol=0, atol=1e-15)


def test_a_split_link_and_one_without_length_change_nothing():
    def arm(middle: str) -> str:
        return robot(
            link("base"),
            joint("hinge", "revolute", "base", "arm", (0, 0.1, 0.2)),
            link("arm"),
            middle,
            joint("wrist", "revolute", "arm" if not middle else "half", "hand", (0.6 if not middle else 0.4, 0, 0)),
            link("hand"),
            joint("roll", "revolute", "hand", "flange", (0, 0, 0), (0, 0, 0), (1, 0, 0)),
            link("flange"),
            joint("bolt", "fixed", "flange", "tool", (0.1, 0, 0)),
            link("tool"),
        )

    split = joint("weld", "fixed", "arm", "half", (0.2, 0, 0)) + link("half")
    source = Thermal(expansion=1e-5, temperature_change=Uniform(2.0, mean=3.0), gradient=4.0, across="z of base")
    errors = []
    for text in (arm(""), arm(split)):
        model = ErrorModel(chain_of(text, tip="tool"), Space(), [source])
        errors.append(model.at([0.3, -0.8, 0.2]).exact(model.space.sample(1, 0, 5)))
    np.testing.assert_allclose(*errors, rtol=0, atol=1e-15)


def test_no_tolerance_no_spread():
    source = Thermal(expansion=0.0, temperature_change=Uniform(2.0), gradient=Uniform(1.0), across="z of hinge")
    check_no_spread(ErrorModel(one_link(), Space(), [source]), [0.2])
    source = Thermal(expansion=Uniform(1e-6, mean=12e-6), temperature_change=0.0, gradient=0.0, across="z of hinge")
    check_no_spread(ErrorModel(one_link(), Space(), [source]), [0.2])


def test_bad_settings_are_refused():
    with pytest.raises(InputError, match="thermal needs temperature_change: or gradient:, or both"):
        Thermal(expansion=1e-5)
    with pytest.raises(InputError, match="thermal needs both of gradient: and across:"):
        Thermal(expansion=1e-5, gradient=1.0)
    with pytest.raises(InputError, match="thermal needs both of gradient: and across:"):
        Thermal(expansion=1e-5, temperature_change=1.0, across="z of hinge")
    with pytest.raises(InputError, match=r"thermal\[base\]: the link has no length"):
        ErrorModel(one_link(), Space(), [Thermal(link="base", expansion=1e-5, temperature_change=1.0)]).at([0.0])
    with pytest.raises(UnknownNameError, match="no joint on the chain named 'hing'; did you mean 'hinge'"):
        ErrorModel(one_link(), Space(), [Thermal(expansion=1e-5, gradient=1.0, across="x of hing")]).at([0.0])
    with pytest.raises(InputError, match="direction 'up' is not understood"):
        ErrorModel(one_link(), Space(), [Thermal(expansion=1e-5, gradient=1.0, across="up")]).at([0.0])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (
            "thermal: {expansion: 12e-6, temperature_change: 1 K}",
            "'12e-6' has no unit; a thermal expansion needs one of",
        ),
        ("thermal: {expansion: 12 ppm/K, temperature_change: 1 °C}", "'°C' .*not a unit of temperature difference"),
        (
            "thermal: {expansion: 12 ppm/K, gradient: 1 K, across: z of base}",
            "'K' .*not a unit of temperature gradient",
        ),
        ("thermal: {temperature_change: 1 K}", "the key 'expansion' is missing"),
        ("thermal: {link: lnk2, expansion: 12 ppm/K, temperature_change: 1 K}", "no link named 'lnk2'; did you mean"),
    ],
)
def test_bad_sheets_give_one_line(tmp_path, line, message):
    with pytest.raises(SheetError, match=rf"arm\.errors\.yaml:6: error E_\w+: .*{message}") as caught:
        ErrorModel.load(written(tmp_path, line))
    assert len(caught.value.findings) == 1
