from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError
from precision_pin.draws.laws import Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot import mcpc as mcpc_package
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources import mcpc
from precision_pin.sources.mcpc import Mcpc
from support.checks.common import Q7
from support.checks.places import check_mcpc
from support.plain_robot import chain_of, pose_error, random_arm


def test_large_errors_of_every_parameter_are_exact():
    check_mcpc(mcpc)


def test_the_paper_arm_with_errors_of_half_a_radian():
    chain = ErrorModel.load(PAPER_SHEET).chain
    nominal = mcpc_package.from_chain(chain)
    q = np.radians([-90, 3, 88, -91])
    errors = np.zeros(5 * 4 + 6)
    names = list(nominal.parameter_names)
    settings = {"link1": {"alpha": 0.5, "y": 0.1}, "link3": {"beta": -0.4, "x": 0.2}, "tool": {"gamma": 0.3, "z": -0.1}}
    for number, link in ((1, "link1"), (3, "link3"), (4, "tool")):
        for field, value in settings[link].items():
            errors[names.index(f"{field}_{number}")] = value
    sources = [Mcpc(link=link, **values) for link, values in settings.items()]
    actual = ErrorModel(chain, Space(), sources).at(q).exact(np.zeros((0, 1)))[:, 0]
    expected = pose_error(nominal.perturbed(errors).forward_kinematics(q), nominal.forward_kinematics(q))
    np.testing.assert_allclose(actual, expected, atol=1e-12)


def test_the_linear_model_is_the_column_of_the_jacobian_in_base_axes():
    chain = chain_of(random_arm(21, prismatic=(3,)), tip="tool")
    nominal = mcpc_package.from_chain(chain)
    names = list(nominal.parameter_names)
    columns = nominal.jacobian_base(Q7)
    for number, link in ((0, "base"), (3, "link3"), (7, "link7")):
        for field in ("alpha", "beta", "x", "y") + (("gamma", "z") if number == 7 else ()):
            at = ErrorModel(chain, Space(), [Mcpc(link=link, **{field: Uniform(1e-3)})]).at(Q7)
            np.testing.assert_allclose(at.jacobian[:, 0], columns[:, names.index(f"{field}_{number}")], atol=1e-12)


def test_two_names_of_one_chain_link_add_up():
    chain = chain_of(random_arm(22), tip="tool")
    apart = ErrorModel(chain, Space(), [Mcpc(link="link2", alpha=0.01, x=1e-3), Mcpc(link="half2", alpha=0.02)])
    together = ErrorModel(chain, Space(), [Mcpc(link="link2", alpha=0.03, x=1e-3)])
    none = np.zeros((0, 1))
    np.testing.assert_allclose(apart.at(Q7).exact(none), together.at(Q7).exact(none), atol=1e-15)


@pytest.mark.parametrize("field", ["gamma", "z"])
def test_gamma_and_z_belong_to_the_last_link(field):
    chain = chain_of(random_arm(22), tip="tool")
    with pytest.raises(InputError, match="gamma and z are parameters of the last link only"):
        ErrorModel(chain, Space(), [Mcpc(link="link2", **{field: 1e-3})]).at(Q7)
