from __future__ import annotations

import pytest

from precision_pin.base.errors import InputError
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources import joint_compliance
from precision_pin.sources.joint_compliance import JointCompliance
from support.checks.common import one_link
from support.checks.drives import check_joint_compliance


def test_by_hand_and_by_the_slope_of_the_potential_energy():
    check_joint_compliance(joint_compliance)


def test_a_vertical_axis_feels_no_weight():
    chain = one_link(mass=2.0, com=(0.4, 0.3, 0.1))
    (term,) = ErrorModel(chain, Space(), [JointCompliance(joint="hinge", compliance=1e-4)]).at([0.7]).terms
    assert abs(term.twist[0]) < 1e-19


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (-1e-6, r"compliance of joint_compliance\[hinge\] can become negative"),
        (Uniform(2e-5, mean=1e-5), r"compliance of joint_compliance\[hinge\] can become negative \(as low as -1e-05"),
        (Normal(2e-6, mean=1e-5), r"compliance of joint_compliance\[hinge\] can become negative"),
        (float("nan"), "finite"),
        (float("inf"), "finite"),
    ],
)
def test_a_negative_or_infinite_compliance_is_refused(value, message):
    chain = one_link(axis=(0, 1, 0), mass=2.0, com=(0.4, 0.3, 0.1))
    with pytest.raises(InputError, match=message):
        ErrorModel(chain, Space(), [JointCompliance(joint="hinge", compliance=value)]).at([0.7])
