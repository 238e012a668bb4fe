"""The two first-order models: tangent at the means (deflected arm), superposition at the undisplaced chain."""

from __future__ import annotations

import numpy as np
import pytest

from precision_pin import Chain, ErrorModel, Normal, Space, Uniform
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources import Beam, JointOffset, Payload
from support.checks.common import one_link
from support.sheets import PAPER_Q, SEVEN_Q, everything, geometry, loads, named, seven_joint_arm, spread_out

HALVINGS = (1.0, 0.5, 0.25, 0.125)


def paper_model() -> ErrorModel:
    return ErrorModel.load(PAPER_SHEET)


def paper_model_with_random_masses() -> ErrorModel:
    """Return the paper's arm with random payload, stiffness and compliance beside its tolerances."""
    model = paper_model()
    loaded = [
        Payload(at="tool", mass=Uniform(0.2, mean=1.0), com=(Normal(0.02), Uniform(0.03), Normal(0.02))),
        Beam(link="link2", EI=Uniform(800.0, mean=8000.0), GI=Normal(200.0, mean=4000.0), EA=1e7),
        Beam(link="link3", EI=Uniform(800.0, mean=8000.0), GI=Normal(50.0, mean=1000.0)),
    ]
    rest = [source for source in model.sources if source.kind() not in ("payload", "beam")]
    return ErrorModel(model.chain, named(model), [*rest, *loaded])


CASES = {
    "paper": (paper_model, PAPER_Q),
    "paper, random masses": (paper_model_with_random_masses, PAPER_Q),
    "seven joints": (lambda: everything(seven_joint_arm()), SEVEN_Q),
    "seven joints that turn": (lambda: everything(seven_joint_arm(prismatic=())), SEVEN_Q),
}


@pytest.mark.parametrize("name", ["paper", "seven"])
def test_superposition_is_of_second_order_without_gravity_and_with_zero_means(name):
    if name == "paper":
        loaded = paper_model()
        chain = Chain.from_urdf(PAPER_SHEET.parent / "4dof.urdf", gravity=(0, 0, 0))
        sources = [source for source in loaded.sources if source.kind() in ("length", "axis_install")]
        model, q = ErrorModel(chain, named(loaded), sources), PAPER_Q
    else:
        chain = seven_joint_arm(gravity=(0, 0, 0))
        model, q = ErrorModel(chain, Space(), geometry(chain)), SEVEN_Q
    np.testing.assert_array_equal(model.space.mean, 0)
    at = model.at(q)
    delta = spread_out(model, 1)
    remainders = [np.linalg.norm(at.exact(s * delta[:, None]) - at.linear(s * delta[:, None])) for s in HALVINGS]
    slope = np.polyfit(np.log2(HALVINGS), np.log2(remainders), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.05)
    np.testing.assert_allclose(at.jacobian, at.linear(np.eye(model.space.size)), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("case", CASES)
def test_the_tangent_against_finite_differences(case):
    """Fourth-order differences over a tenth of a deviation or so, every column to 1e-7 of its size."""
    build, q = CASES[case]
    model = build()
    check_columns(model, model.at(q))


def check_columns(model: ErrorModel, at) -> None:
    mean = model.space.mean
    np.testing.assert_array_equal(at.tangent[0], at.exact(mean[:, None])[:, 0])
    steps = np.maximum(np.abs(mean) * 1e-3, 1e-4)
    points = np.repeat(mean[:, None], 4 * model.space.size, axis=1)
    for k, step in enumerate(steps):
        points[k, 4 * k : 4 * k + 4] += step * np.array([-2, -1, 1, 2])
    values = at.exact(points).reshape(6, -1, 4)
    slopes = values @ np.array([1, -8, 8, -1]) / 12 / steps
    for k, name in enumerate(model.space.components):
        size = np.abs(slopes[:, k]).max()
        np.testing.assert_allclose(at.jacobian[:, k], slopes[:, k], rtol=0, atol=max(1e-7 * size, 1e-12), err_msg=name)


def test_products_of_three_factors_and_derived_parameters_have_their_slopes():
    chain = seven_joint_arm(prismatic=())
    space, sources = loads()
    model = ErrorModel(chain, space, sources)
    at = model.at(SEVEN_Q)
    assert max(len(term.factors) for term in at.terms) == 3
    assert len(at.table.program.operations) > 5
    check_columns(model, at)
    # at a parameter whose mean is zero, whose products have no other slope
    zero = model.space.index["payload[tool]#2.com[1]"]
    assert model.space.mean[zero] == 0
    assert np.abs(at.jacobian[:, zero]).max() > 1e-5


def test_the_covariance_is_that_of_the_tangent():
    model = everything(seven_joint_arm())
    at = model.at(SEVEN_Q)
    draws = np.linalg.cholesky(model.space.covariance + 1e-40 * np.eye(model.space.size))
    np.testing.assert_allclose(at.covariance, at.jacobian @ model.space.covariance @ at.jacobian.T, rtol=1e-14)
    spread = at.jacobian @ draws
    np.testing.assert_allclose(at.covariance, spread @ spread.T, rtol=1e-9)


def test_zero_tolerance_zero_spread():
    chain = seven_joint_arm()
    model = ErrorModel(chain, Space(), geometry(chain, scale=0.0))
    at = model.at(SEVEN_Q)
    assert model.space.size > 20
    x = model.space.sample(1, 0, 50)
    np.testing.assert_array_equal(x, 0)
    np.testing.assert_array_equal(at.linear(x), 0)
    np.testing.assert_allclose(at.exact(x), 0, atol=1e-14)
    assert np.ptp(at.exact(x), axis=1).max() == 0
    np.testing.assert_array_equal(at.covariance, 0)


def test_without_gravity_no_load_displaces_anything():
    chain = seven_joint_arm(gravity=(0, 0, 0))
    space, laden = loads()
    at = ErrorModel(chain, space, laden).at(SEVEN_Q)
    x = at.space.sample(1, 0, 10)
    np.testing.assert_array_equal(at.linear(x), 0)
    np.testing.assert_allclose(at.exact(x), 0, atol=1e-14)
    np.testing.assert_array_equal(at.jacobian, 0)


@pytest.mark.parametrize(("half_width", "warned"), [(0.080, True), (0.093, False)])
def test_superposition_stretched_is_warned_about(half_width, warned):
    """A fixed turn of 0.1 rad at 1 m: superposition is 5.0 mm off; a tenth of the spread is t/√3/10 and a bit."""
    chain = one_link()
    sources = [JointOffset(joint="hinge", offset=Uniform(half_width, mean=0.1))]
    at = ErrorModel(chain, Space(), sources).at([0.0])
    gap = np.hypot(np.cos(0.1) - 1, np.sin(0.1) - 0.1)
    assert bool(gap > 0.1 * half_width / np.sqrt(3)) is warned
    assert ([finding.code for finding in at.findings("linear")] == ["W_SUPERPOSITION"]) is warned
    assert at.findings("exact") == ()
