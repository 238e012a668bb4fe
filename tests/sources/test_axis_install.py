from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError, UnknownNameError
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources import axis_install
from precision_pin.sources.axis_install import AxisInstall
from support.checks.bearings import bearing, check_axis_install


def test_by_hand_and_by_the_line_of_the_axis():
    check_axis_install(axis_install)


def test_the_points_are_drawn_inside_their_discs():
    model = ErrorModel(bearing(), Space(), [AxisInstall(joint="hinge", radius=1e-4, span=0.1)])
    assert model.space.components == tuple(f"axis_install[hinge].{point}" for point in ("A.x", "A.y", "B.x", "B.y"))
    x = model.space.sample(3, 0, 20_000)
    for rows in (x[:2], x[2:]):
        square = (rows**2).sum(axis=0) / 1e-8
        assert square.max() <= 1 + 1e-12
        # uniform over the area: r²/R² is uniform, so its mean is 1/2 with standard error 1/sqrt(12 N); 5 of them
        assert abs(square.mean() - 0.5) < 5 / np.sqrt(12 * 20_000)


def test_halving_the_span_doubles_the_tilt_and_keeps_the_shift_at_the_seat():
    twists = []
    for span in (0.1, 0.05):
        at = ErrorModel(bearing(), Space(), [AxisInstall(joint="hinge", radius=1e-4, span=span)]).at([0.0])
        twists.append(np.array([term.twist for term in at.terms]))
    np.testing.assert_array_equal(twists[1][:, 3:], 2 * twists[0][:, 3:])
    np.testing.assert_array_equal(twists[1][:, :3], twists[0][:, :3])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "either radius: or diameter:"),
        ({"radius": 1e-4, "diameter": 2e-4}, "either radius: or diameter:"),
        ({"radius": -1e-4}, "must not be negative"),
        ({"diameter": -1e-4}, "must not be negative"),
        ({"radius": 1e-4, "span": 0.0}, "span of axis_install must be positive"),
        ({"radius": 1e-4, "span": -0.1}, "span of axis_install must be positive"),
        ({"radius": 1e-4, "span": float("nan")}, "span of axis_install must be positive"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        AxisInstall(**{"joint": "hinge", "span": 0.1} | settings)


def test_an_unknown_joint_is_named_with_the_nearest():
    with pytest.raises(UnknownNameError, match="no joint on the chain named 'hinges'; did you mean 'hinge'"):
        ErrorModel(bearing(), Space(), [AxisInstall(joint="hinges", radius=1e-4, span=0.1)]).at([0.0])
