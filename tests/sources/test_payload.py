from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.draws.laws import Normal, Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources import payload
from precision_pin.sources.beam import Beam
from precision_pin.sources.payload import Payload
from support.checks.common import Q7, evaluated, one_link
from support.checks.loads import check_payload
from support.plain_robot import chain_of, random_arm


@pytest.mark.slow
def test_by_hand_and_by_a_chain_that_carries_it():
    check_payload(payload)


def test_alone_it_moves_nothing():
    at = ErrorModel(one_link(), Space(), [Payload(at="tool", mass=Uniform(0.1, mean=1.0))]).at([0.0])
    assert at.terms == ()
    np.testing.assert_array_equal(at.exact([[1.0]]), np.zeros((6, 1)))


def test_it_loads_a_beam_like_the_same_mass_in_the_chain():
    chain = chain_of(random_arm(23), tip="tool")
    beam = Beam(link="link4", EI=3000.0, GI=900.0, EA=1e5)
    random = Payload(at="tool", mass=Normal(0.1, mean=2.0), com=(Uniform(0.1), Uniform(0.1), 0.05))
    values = {"payload[tool].mass": 2.2, "payload[tool].com": 0.03, "payload[tool].com[1]": -0.08}
    _, by_source = evaluated(chain, Q7, [random, beam], values)
    _, by_chain = evaluated(chain.with_payload(2.2, (0.03, -0.08, 0.05)), Q7, [beam])
    np.testing.assert_allclose(*by_source.values(), *by_chain.values(), rtol=1e-12)


def test_two_payloads_add():
    chain = chain_of(random_arm(23), tip="tool")
    beam = Beam(link="link4", EI=3000.0)
    _, two = evaluated(chain, Q7, [Payload(at="tool", mass=1.0), Payload(at="link6", mass=2.0), beam])
    _, one = evaluated(chain.with_payload(1.0).with_payload(2.0, at="link6"), Q7, [beam])
    np.testing.assert_allclose(*two.values(), *one.values(), rtol=1e-12)


def test_a_centre_of_two_numbers_is_refused():
    with pytest.raises(InputError, match="com of a payload has 2 numbers, expected 3"):
        Payload(at="tool", mass=1.0, com=(0.0, 0.0))


@pytest.mark.parametrize("mass", [-1.0, Uniform(2.0, mean=1.0), Normal(0.2, mean=1.0)])
def test_a_mass_that_may_be_negative_is_refused(mass):
    with pytest.raises(InputError, match=r"mass of payload\[tool\] can become negative"):
        ErrorModel(one_link(), Space(), [Payload(at="tool", mass=mass)]).at([0.0])


def test_an_unknown_link_is_named_with_the_nearest():
    with pytest.raises(UnknownNameError, match="no link named 'tol'; did you mean 'tool'"):
        ErrorModel(one_link(), Space(), [Payload(at="tol", mass=1.0)]).at([0.0])
