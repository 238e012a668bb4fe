from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.draws.draw import Draw
from precision_pin.draws.laws import Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources import length
from precision_pin.sources.length import Length
from support.checks.common import one_link
from support.checks.places import check_length


@pytest.mark.slow
def test_by_hand_and_by_moving_the_origin():
    check_length(length)


def test_a_shared_parameter_moves_both_lengths_and_unnamed_laws_are_apart():
    chain = one_link()
    shared = [
        Length(joint="hinge", along="z of hinge", parameters=("a", Uniform(1e-3))),
        Length(frame="tool", along="-z of hinge", parameters=(Uniform(1e-3), "a", Uniform(2e-3))),
    ]
    model = ErrorModel(chain, Space((Draw("a", Uniform(1e-3)),)), shared)
    assert model.space.components == (
        "a",
        "length[hinge].parameters[1]",
        "length[tool].parameters",
        "length[tool].parameters[2]",
    )
    up = model.at([0.3]).linear(np.eye(4))[2]
    np.testing.assert_allclose(up, [0, 1, -1, -1], atol=1e-16)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"parameters": (1e-3,)}, "either joint: or frame:"),
        ({"joint": "hinge", "frame": "tool", "parameters": (1e-3,)}, "either joint: or frame:"),
        ({"frame": "tool", "parameters": ()}, "at least one"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Length(**settings)


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"joint": "hinge"}, InputError, "the link has no length; give a direction"),
        ({"frame": "tool", "along": "w of hinge"}, InputError, "'w of hinge' is not understood"),
        ({"frame": "tool", "along": "z of hing"}, UnknownNameError, "did you mean 'hinge'"),
        ({"joint": "arm"}, UnknownNameError, "no joint on the chain named 'arm'"),
        ({"frame": "tol"}, UnknownNameError, "did you mean 'tool'"),
        ({"frame": "tool", "parameters": ("b",)}, UnknownNameError, "no parameter named 'b'"),
    ],
)
def test_what_the_chain_does_not_have_is_named(settings, error, message):
    with pytest.raises(error, match=message):
        ErrorModel(one_link(), Space(), [Length(**{"parameters": (1e-3,)} | settings)]).at([0.0])
