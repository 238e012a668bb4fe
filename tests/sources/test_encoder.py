from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError, SheetError
from precision_pin.draws.draw import Scope
from precision_pin.draws.laws import Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources import encoder
from precision_pin.sources.encoder import Encoder
from support.checks.common import one_link
from support.checks.drives import ARCSEC, check_encoder
from support.engines import check_engines, check_no_spread, written


def test_against_hand_computed_and_published_numbers():
    check_encoder(encoder)


@pytest.mark.slow
def test_from_a_sheet_through_every_engine(tmp_path):
    file = written(
        tmp_path,
        "encoder: {joint: joint1, resolution: 20 arcsec, offset: {normal: 0.02 deg}, eccentricity: 10 um, radius: 20 mm}\n"
        "encoder: {joint: joint2, amplitude: {uniform: 10 arcsec, mean: 30 arcsec}, order: 2, heads: 2, ratio: 50}\n"
        "encoder: {joint: joint3, resolution: 0.1 deg, ratio: 100, scope: visit}",
    )
    model = ErrorModel.load(file)
    assert model.space.components == (
        "encoder[joint1].offset",
        "encoder[joint1].quantisation",
        "encoder[joint1].phase.x",
        "encoder[joint1].phase.y",
        "encoder[joint2].amplitude",
        "encoder[joint2].phase.x",
        "encoder[joint2].phase.y",
        "encoder[joint3].quantisation",
    )
    scopes = [draw.scope for draw in model.space.draws if "quantisation" in draw.name]
    assert scopes == [Scope.POSE, Scope.VISIT]
    variances = dict(zip(model.space.components, np.diag(model.space.covariance), strict=True))
    np.testing.assert_allclose(variances["encoder[joint1].quantisation"], (20 * ARCSEC) ** 2 / 12, rtol=1e-14)
    np.testing.assert_allclose(variances["encoder[joint3].quantisation"], np.radians(1e-3) ** 2 / 12, rtol=1e-14)
    # 10 µm on 20 mm is 0.5 mrad, at -90° all of it times minus cos φ
    (x, y) = (term for term in model.at().terms if "joint1].phase" in str(term.factors))
    np.testing.assert_allclose([x.twist[0], y.twist[0]], [-5e-4, 0], atol=1e-18)
    check_engines(model)


def test_a_linear_encoder_from_a_sheet(tmp_path):
    file = written(
        tmp_path,
        "encoder: {joint: rail, resolution: 5 um, amplitude: 0.5 um, period: 20 um, scale: {uniform: 5 um/m}}\n"
        "encoder: {joint: lift, offset: {uniform: 20 um}}",
        sliding=True,
    )
    model = ErrorModel.load(file)
    at = model.at()
    # 0.3 m along the rail: ±1.5 µm of scale, ±2.5 µm of a step, ±0.5 µm within the period
    expected = (1.5e-6**2 + 2.5e-6**2) / 3 + 0.5e-6**2 / 2
    np.testing.assert_allclose(at.covariance[0, 0], expected, rtol=1e-9)
    np.testing.assert_allclose(at.covariance[2, 2], 20e-6**2 / 3, rtol=1e-12)
    check_engines(model)


def test_the_phase_is_the_same_at_every_pose_of_a_built_robot():
    model = ErrorModel(one_link(), Space(), [Encoder(joint="hinge", amplitude=1e-3, resolution=1e-5)])
    here, there = (model.space.sample(5, 0, 200, pose=pose) for pose in (0, 1))
    rows = dict(zip(model.space.components, zip(here, there, strict=True), strict=True))
    for axis in "xy":
        np.testing.assert_array_equal(*rows[f"encoder[hinge].phase.{axis}"])
    assert not np.array_equal(*rows["encoder[hinge].quantisation"])
    # half a turn on, every robot errs the other way
    errors = [model.at([q]).exact(np.where([[0], [1], [1]], here, 0.0))[5] for q in (0.4, 0.4 + np.pi)]
    np.testing.assert_allclose(errors[0], -errors[1], atol=1e-15)


def test_two_heads_cancel_eccentricity():
    source = Encoder(joint="hinge", eccentricity=1e-5, radius=0.02, heads=2, offset=Uniform(1e-3))
    model = ErrorModel(one_link(), Space(), [source])
    assert model.space.components == ("encoder[hinge].offset",)


def test_no_tolerance_no_spread():
    settings = {"resolution": 0.0, "offset": 0.0, "amplitude": 0.0}
    check_no_spread(ErrorModel(one_link(), Space(), [Encoder(joint="hinge", **settings)]), [0.3])
    chain = one_link("prismatic")
    check_no_spread(ErrorModel(chain, Space(), [Encoder(joint="hinge", period=1e-3, scale=0.0, **settings)]), [0.3])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "encoder needs one of resolution:, offset:, amplitude:, eccentricity: and scale:"),
        ({"amplitude": 1e-3, "eccentricity": 1e-5, "radius": 0.02}, "one of amplitude: and eccentricity:"),
        ({"eccentricity": 1e-5}, "both of eccentricity: and radius:"),
        ({"radius": 1e-2, "offset": 0.1}, "both of eccentricity: and radius:"),
        ({"eccentricity": 1e-5, "radius": 0.0}, "radius of encoder must be positive, got 0"),
        ({"resolution": -1e-5}, "resolution of encoder must be zero or more, got -1e-05"),
        ({"resolution": float("inf")}, "resolution of encoder must be zero or more, got inf"),
        ({"resolution": 1e-5, "ratio": -100.0}, "ratio of encoder must be positive, got -100"),
        ({"amplitude": 1e-3, "order": 0}, "order of encoder must be 1, 2, 3, …, got 0"),
        ({"amplitude": 1e-3, "order": 1.5}, "order of encoder must be 1, 2, 3, …, got 1.5"),
        ({"eccentricity": 1e-5, "radius": 0.02, "order": 2}, "eccentricity: of encoder is a once-per-turn error"),
        ({"amplitude": 1e-3, "heads": 3}, "heads: of encoder must be 1 or 2, got 3"),
        ({"resolution": 1e-3, "scope": "unit"}, "scope: of encoder must be pose or visit, got 'unit'"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Encoder(joint="hinge", **settings)


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        ("revolute", {"amplitude": 1e-3, "period": 1e-3}, "period: is only for a prismatic joint"),
        ("revolute", {"scale": 1e-6}, "scale: is only for a prismatic joint"),
        ("prismatic", {"amplitude": 1e-6}, "both of amplitude: and period:"),
        ("prismatic", {"offset": 1e-6, "period": 1e-3}, "both of amplitude: and period:"),
        ("prismatic", {"eccentricity": 1e-6, "radius": 0.02}, "are only for a revolute joint"),
        ("prismatic", {"offset": 1e-6, "ratio": 100.0}, "are only for a revolute joint"),
        ("prismatic", {"amplitude": 1e-6, "period": 1e-3, "heads": 2}, "are only for a revolute joint"),
    ],
)
def test_settings_of_the_other_kind_of_joint_are_refused(kind, settings, message):
    with pytest.raises(InputError, match=rf"encoder\[hinge\]: .*{message}"):
        ErrorModel(one_link(kind), Space(), [Encoder(joint="hinge", **settings)]).at([0.1])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("encoder: {joint: joint1, resolution: 1 mm}", "'mm' in '1 mm' is not a unit of angle"),
        ("encoder: {joint: joint1, resolution: {uniform: 1 deg}}", "expected a plain quantity, not a law"),
        ("encoder: {joint: joint1, amplitude: 1 mrad, order: two}", "order: .*integer"),
        ("encoder: {joint: joint1, amplitude: 1 mrad, ratio: 1:100}", "ratio: .*'1:100'"),
        ("encoder: {joint: joint1, resolution: 1 deg, scope: day}", "scope: .*'pose' or 'visit'"),
        ("encoder: {joint: joint1, scale: {uniform: 5 um/m}}", "is only for a prismatic joint"),
        ("encoder: {joint: joint1, scale: {uniform: 5 ppm}}", "'ppm' .*not a unit of relative length"),
    ],
)
def test_bad_sheets_give_one_line(tmp_path, line, message):
    with pytest.raises(SheetError, match=rf"arm\.errors\.yaml:6: error E_\w+: .*{message}") as caught:
        ErrorModel.load(written(tmp_path, line))
    assert len(caught.value.findings) == 1
