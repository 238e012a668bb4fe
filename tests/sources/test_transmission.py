from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError, SheetError
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources import transmission
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.payload import Payload
from precision_pin.sources.transmission import Transmission
from support.checks.common import one_link
from support.checks.drives import check_transmission
from support.engines import check_engines, check_no_spread, written


def test_against_hand_computed_numbers_and_the_potential_energy():
    check_transmission(transmission)


@pytest.mark.slow
def test_from_a_sheet_through_every_engine(tmp_path):
    file = written(
        tmp_path,
        "transmission: {joint: joint2, amplitude: [0.25 arcmin, {uniform: 5 arcsec, mean: 20 arcsec}], order: [200, 1]}\n"
        "transmission: {joint: joint3, stiffness: {uniform: 2 kN*m/rad, mean: 50 kN*m/rad}}\n"
        "transmission: {joint: joint1, amplitude: 10 arcsec, order: 2, period: 3.6 deg}\n"
        "payload: {at: tool, mass: {uniform: 0.5 kg, mean: 5 kg}, com: [{uniform: 5 mm}, 0 mm, 0 mm]}",
    )
    model = ErrorModel.load(file)
    assert "transmission[joint2].phase[1].y" in model.space.components
    # order 2 in 3.6° is 200 a turn
    by_period, by_turn = (
        ErrorModel(model.chain, Space(), [Transmission(joint="joint1", amplitude=(5e-5,), **settings)]).at(
            model.poses["here"]
        )
        for settings in ({"order": (2.0,), "period": np.radians(3.6)}, {"order": (200.0,)})
    )
    np.testing.assert_allclose(by_period.jacobian, by_turn.jacobian, rtol=1e-9, atol=1e-15)
    check_engines(model)


@pytest.mark.parametrize("statics", ["nominal", "equilibrium"])
def test_wind_up_is_the_compliance_of_its_stiffness(statics):
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0.3, 0.1))
    payload = Payload(at="tool", mass=Uniform(0.5, mean=3.0), com=(Uniform(0.1), 0.0, 0.0))
    wound = ErrorModel(chain, Space(), [payload, Transmission(joint="hinge", stiffness=2e3)], statics=statics)
    soft = ErrorModel(chain, Space(), [payload, JointCompliance(joint="hinge", compliance=5e-4)], statics=statics)
    x = wound.space.sample(1, 0, 20)
    np.testing.assert_allclose(wound.at([0.2]).exact(x), soft.at([0.2]).exact(x), rtol=1e-12, atol=1e-15)


def test_a_ball_screw_from_a_sheet(tmp_path):
    file = written(
        tmp_path,
        "transmission: {joint: rail, amplitude: 4 um, order: 1, period: 10 mm, lead_error: {uniform: 77 um/m}}\n"
        "transmission: {joint: lift, stiffness: {uniform: 5 N/um, mean: 50 N/um}, lead_error: {normal: 77 um/m}}",
        sliding=True,
    )
    model = ErrorModel.load(file)
    at = model.at()
    np.testing.assert_allclose(at.covariance[0, 0], (0.3 * 77e-6) ** 2 / 3 + 4e-6**2 / 2, rtol=1e-9)
    # 4 kg sink by 4 · 9.81 N / 50 N/µm
    np.testing.assert_allclose(at.tangent[0][2], -4 * 9.81 / 50e6, rtol=1e-9)
    np.testing.assert_allclose(
        at.covariance[2, 2], (0.2 * 77e-6 / 3) ** 2 + (4 * 9.81 * 5e6 / 50e6**2) ** 2 / 3, rtol=1e-9
    )
    check_engines(model)


def test_without_gravity_nothing_winds_up():
    chain = one_link(axis=(0, 1, 0), gravity=(0, 0, 0), mass=2.0, com=(0.4, 0, 0))
    source = Transmission(joint="hinge", stiffness=Uniform(10.0, mean=100.0))
    check_no_spread(ErrorModel(chain, Space(), [source]), [0.2])


def test_no_tolerance_no_spread():
    chain = one_link("prismatic", mass=1.0)
    settings = {"amplitude": (0.0, 0.0), "order": (1.0, 2.0), "period": 0.01, "lead_error": 0.0, "stiffness": 1e6}
    check_no_spread(ErrorModel(chain, Space(), [Transmission(joint="hinge", **settings)]), [0.2])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "transmission needs one of amplitude:, stiffness: and lead_error:"),
        ({"amplitude": (1e-3,)}, "one order: for each amplitude:, got 1 and 0"),
        ({"amplitude": (1e-3,), "order": (1.0, 2.0)}, "one order: for each amplitude:, got 1 and 2"),
        ({"amplitude": (1e-3,), "order": (0.0,)}, "an order of transmission must be positive"),
        ({"amplitude": (1e-3,), "order": (1.0,), "period": 0.0}, "period of transmission must be positive, got 0"),
        ({"stiffness": 1e3, "period": 1.0}, "period: of transmission is used only with amplitude:"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Transmission(joint="hinge", **settings)


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        ("revolute", {"lead_error": 1e-5}, r"transmission\[hinge\]: lead_error: is only for a prismatic joint"),
        (
            "prismatic",
            {"amplitude": (1e-5,), "order": (1.0,)},
            r"transmission\[hinge\]: .* needs period: with amplitude:",
        ),
        ("revolute", {"stiffness": 0.0}, r"stiffness of transmission\[hinge\] can become zero or negative"),
        ("revolute", {"stiffness": Normal(200.0, mean=1000.0)}, r"stiffness of transmission\[hinge\] can become zero"),
    ],
)
def test_settings_that_do_not_fit_the_joint_are_refused(kind, settings, message):
    with pytest.raises(InputError, match=message):
        ErrorModel(one_link(kind), Space(), [Transmission(joint="hinge", **settings)]).at([0.1])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("transmission: {joint: joint1, amplitude: 1 mm, order: 1}", "'mm' in '1 mm' is not a unit of angle"),
        ("transmission: {joint: joint1, amplitude: 1 mrad, order: {uniform: 1}}", "order"),
        ("transmission: {joint: joint1, amplitude: 1 mrad, order: [1, many]}", "order.*'many'"),
        ("transmission: {joint: joint1, amplitude: 1 mrad, order: 1 2}", "one order: for each amplitude:, got 1 and 2"),
        ("transmission: {joint: joint1, stiffness: 1e4 N*m}", "'N\\*m' .*angular stiffness"),
    ],
)
def test_bad_sheets_give_one_line(tmp_path, line, message):
    with pytest.raises(SheetError, match=rf"arm\.errors\.yaml:6: error E_\w+: .*{message}") as caught:
        ErrorModel.load(written(tmp_path, line))
    assert len(caught.value.findings) == 1
