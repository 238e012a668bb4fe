from __future__ import annotations

import numpy as np
import pytest

from precision_pin.base.errors import InputError, SheetError
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.sources import covariance
from precision_pin.sources.covariance import Covariance
from precision_pin.sources.frame import Frame
from support.checks.common import Q7, one_link
from support.checks.places import CORRELATION, STD, check_covariance, rows
from support.engines import check_engines, check_no_spread, written
from support.plain_robot import chain_of, random_arm

STDS = "[0.1 mm, 0.2 mm, 0.3 mm, 1 mrad, 2 mrad, 3 mrad]"


def flow(matrix) -> str:
    return "[" + ", ".join("[" + ", ".join(map(repr, row)) + "]" for row in rows(matrix)) + "]"


def test_by_hand_and_against_the_displaced_robot():
    check_covariance(covariance)


def test_from_a_sheet_through_every_engine(tmp_path):
    square = CORRELATION * np.outer(STD, STD)
    file = written(
        tmp_path,
        f"covariance: {{joint: joint3, std: {STDS}, correlation: {flow(CORRELATION)}, scope: visit}}\n"
        f"covariance: {{frame: tool, matrix: {flow(square)}, mean: [1 mm, 0 m, 0 m, 0.1 deg, 0 deg, 0 deg]}}",
    )
    model = ErrorModel.load(file)
    one, two = model.space.draws
    np.testing.assert_allclose(one.law.covariance, square, rtol=1e-14, atol=0)
    np.testing.assert_allclose(two.law.covariance, square, rtol=1e-14, atol=0)
    np.testing.assert_allclose(two.law.mean_vector, [1e-3, 0, 0, np.radians(0.1), 0, 0], rtol=1e-15)
    assert (one.scope, two.scope) == (Scope.VISIT, Scope.UNIT)
    assert one.components[5] == "covariance[joint3].error.5"
    check_engines(model)


def test_it_is_a_frame_with_a_joint_normal_law():
    chain = chain_of(random_arm(12), tip="tool")
    source = Covariance(link="link3", std=STD, correlation=rows(CORRELATION))
    (draw,) = source.draws("x")
    names = ("x", "y", "z", "rx", "ry", "rz")
    frame = Frame(link="link3", **{name: f"measured.{k}" for k, name in enumerate(names)})
    by_frame = ErrorModel(chain, Space((Draw("measured", draw.law),)), [frame]).at(Q7)
    by_source = ErrorModel(chain, Space(), [source]).at(Q7)
    np.testing.assert_array_equal(by_source.jacobian, by_frame.jacobian)
    np.testing.assert_array_equal(by_source.covariance, by_frame.covariance)


def test_a_direction_that_does_not_vary():
    """Measured in a plane: rank 3, fully correlated."""
    correlation = np.eye(6)
    correlation[0, 5] = correlation[5, 0] = 1.0
    source = Covariance(joint="hinge", std=(1e-4, 1e-4, 0.0, 0.0, 0.0, 1e-3), correlation=rows(correlation))
    model = ErrorModel(one_link(), Space(), [source])
    x = model.space.sample(1, 0, 50)
    np.testing.assert_allclose(x[0] / 1e-4, x[5] / 1e-3, rtol=1e-12)
    np.testing.assert_array_equal(x[2:5], np.zeros((3, 50)))


def test_no_tolerance_no_spread():
    zero = Covariance(joint="hinge", std=(0.0,) * 6, mean=(1e-3, 0.0, 0.0, 0.0, 1e-3, 0.0))
    check_no_spread(ErrorModel(one_link(), Space(), [zero]), [0.2])


NEGATIVE = np.eye(6)
NEGATIVE[0, 1] = NEGATIVE[1, 0] = NEGATIVE[0, 2] = NEGATIVE[2, 0] = 0.9
NEGATIVE[1, 2] = NEGATIVE[2, 1] = -0.9
SKEW = np.eye(6)
SKEW[0, 1] = 0.5


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"std": STD}, "covariance needs one of joint:, link: and frame:"),
        ({"joint": "hinge", "frame": "tool", "std": STD}, "covariance needs one of joint:, link: and frame:"),
        ({"joint": "hinge"}, "covariance needs either std: or matrix:"),
        ({"joint": "hinge", "std": STD, "matrix": rows(np.eye(6))}, "covariance needs either std: or matrix:"),
        (
            {"joint": "hinge", "matrix": rows(np.eye(6)), "correlation": rows(np.eye(6))},
            "used only with std:, not with matrix:",
        ),
        ({"joint": "hinge", "std": STD[:5]}, "std: of covariance has 5 numbers, expected 6"),
        ({"joint": "hinge", "std": STD, "mean": (0.0,)}, "mean: of covariance has 1 numbers, expected 6"),
        ({"joint": "hinge", "std": (-1e-4, *STD[1:])}, "a standard deviation of covariance is negative"),
        ({"joint": "hinge", "std": STD, "correlation": rows(np.eye(5))}, "correlation: .* must be 6 rows of 6 numbers"),
        ({"joint": "hinge", "std": STD, "correlation": rows(2 * np.eye(6))}, "must have 1 on its diagonal"),
        ({"joint": "hinge", "std": STD, "correlation": rows(SKEW)}, "must be symmetric"),
        ({"joint": "hinge", "std": STD, "correlation": rows(NEGATIVE)}, "negative eigenvalue"),
        ({"joint": "hinge", "matrix": rows(-np.eye(6))}, "negative variance"),
        ({"joint": "hinge", "matrix": ((1.0,),)}, "matrix: of covariance must be 6 rows of 6 numbers"),
        ({"joint": "hinge", "matrix": rows(np.full((6, 6), np.nan))}, "finite numbers"),
        ({"joint": "hinge", "std": STD, "scope": "day"}, "scope: of covariance must be unit, pose or visit, got 'day'"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        Covariance(**settings)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ("std: [1 mm, 1 mm, 1 mm, 1 mm, 1 mrad, 1 mrad]", "'mm' in '1 mm' is not a unit of angle"),
        ("std: [1 mm, 1 mm, 1 mm]", "std: 3 numbers, expected 6"),
        ("std: 1 mm", "std: expected a list of numbers"),
        (f"std: {STDS}, correlation: 0.5", "correlation: expected rows of numbers"),
        (f"std: {STDS}, correlation: [[1, high]]", "correlation.*'high'"),
        ("matrix: [[1, 0], [0, 1]]", "matrix: of covariance must be 6 rows of 6 numbers"),
        (f"std: {STDS}, correlation: {flow(NEGATIVE)}", "negative eigenvalue"),
    ],
)
def test_bad_sheets_give_one_line(tmp_path, settings, message):
    with pytest.raises(SheetError, match=rf"arm\.errors\.yaml:6: error E_\w+: .*{message}") as caught:
        ErrorModel.load(written(tmp_path, f"covariance: {{joint: joint1, {settings}}}"))
    assert len(caught.value.findings) == 1
