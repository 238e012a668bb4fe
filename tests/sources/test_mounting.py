from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError, SheetError, UnknownNameError
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources import mounting
from precision_pin.sources.joint_compliance import JointCompliance
from precision_pin.sources.mounting import Mounting
from support.checks.common import Q7, one_link
from support.checks.places import NAMES, check_mounting
from support.engines import check_engines, check_no_spread, written
from support.plain_robot import chain_of, random_arm


def test_against_the_displaced_robot():
    check_mounting(mounting)


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore:.*W_(NO_POSES|FEW_SAMPLES|CONSTANT|OFF_CHAIN):precision_pin.base.errors.PrecisionPinWarning"
)
def test_from_a_sheet_through_every_engine(tmp_path):
    file = written(
        tmp_path,
        "mounting: {at: base, x: {normal: 0.5 mm}, y: {normal: 0.5 mm}, rz: {uniform: 0.5 mrad}, ry: 0.1 mrad}\n"
        "mounting: {at: tool, flange: link4, rx: {uniform: 0.2 mrad}, z: grip}\n"
        "mounting: {at: tool, z: grip}",
        parameters="grip: {uniform: 20 um, scope: visit}",
    )
    model = ErrorModel.load(file)
    assert model.space.components == (
        "grip",
        "mounting[base].x",
        "mounting[base].y",
        "mounting[base].rz",
        "mounting[tool].rx",
    )
    check_engines(model)


def test_it_does_not_turn_gravity():
    """A tilted base leaves the torques what they are; that it turns gravity is a levelling."""
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0, 0))
    flexible = JointCompliance(joint="hinge", compliance=1e-4)
    alone = ErrorModel(chain, Space(), [flexible]).at([0.1])
    tilted = ErrorModel(chain, Space(), [flexible, Mounting(at="base", rx=0.1, ry=0.2)]).at([0.1])
    (droop,) = (term for term in tilted.terms if term.loaded)
    np.testing.assert_array_equal(droop.twist, alone.terms[0].twist)


def test_no_tolerance_no_spread():
    chain = chain_of(random_arm(12), tip="tool")
    for settings in ({"at": "base"}, {"at": "tool"}, {"at": "tool", "flange": "link7"}):
        zero = Mounting(**settings, **dict.fromkeys(NAMES, Normal(0.0)))
        check_no_spread(ErrorModel(chain, Space(), [zero]), Q7)


def test_bad_settings_are_refused():
    with pytest.raises(InputError, match="at: of mounting must be base or tool, got 'tip'"):
        Mounting(at="tip", x=1e-3)
    with pytest.raises(InputError, match="flange: of mounting is used only with at: tool"):
        Mounting(at="base", flange="link7", x=1e-3)
    chain = chain_of(random_arm(12), tip="tool")
    with pytest.raises(
        InputError,
        match=r"mounting\[tool\]: 'half2' is no flange of the tool: it is not beyond the last joint, 'joint7'",
    ):
        ErrorModel(chain, Space(), [Mounting(at="tool", flange="half2", x=Uniform(1e-3))]).at(Q7)
    with pytest.raises(InputError, match="'finger' is not on the path from 'base' to 'tool'"):
        ErrorModel(chain, Space(), [Mounting(at="tool", flange="finger", x=Uniform(1e-3))]).at(Q7)
    with pytest.raises(UnknownNameError, match="no link named 'link8'"):
        ErrorModel(chain, Space(), [Mounting(at="tool", flange="link8", x=Uniform(1e-3))]).at(Q7)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("mounting: {x: 1 mm}", "the key 'at' is missing"),
        ("mounting: {at: floor, x: 1 mm}", "at: .*'base' or 'tool'"),
        ("mounting: {at: base, rx: 1 mm}", "'mm' in '1 mm' is not a unit of angle"),
        (
            "mounting: {at: tool, flange: link2, x: 1 mm}",
            "'link2' is no flange of the tool: it is not beyond the last joint, 'joint4'",
        ),
    ],
)
def test_bad_sheets_give_one_line(tmp_path, line, message):
    with pytest.raises(SheetError, match=rf"arm\.errors\.yaml:6: error E_\w+: .*{message}") as caught:
        ErrorModel.load(written(tmp_path, line))
    assert len(caught.value.findings) == 1
