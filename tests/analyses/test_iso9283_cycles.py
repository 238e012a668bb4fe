"""Figures of ISO 9283 of measured cycles, by hand; and the limit of RP, by integrals and by simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate
from scipy.spatial.transform import Rotation

import precision_pin as pp
from precision_pin.analyses.iso9283.figures import mean_distance, repeatability_limit
from precision_pin.base.errors import PrecisionPinWarning

HOME = np.zeros(6)


def cycles(*rows):
    """Return cycles ``(n, 6)`` from positions, or positions and angles."""
    return np.array([[*row, *[0.0] * (6 - len(row))] for row in rows])


# at a pose -----------------------------------------------------------------------------------------------------------


def test_position_by_hand():
    # barycentre (2, 1, 0); distances from it √2, √2, 0, 0: mean √2/2, variance 4 · (√2/2)² / 3 = 2/3
    found = pp.iso9283_of(HOME, cycles((1, 0, 0), (3, 2, 0), (2, 1, 0), (2, 1, 0)))
    assert pytest.approx(math.sqrt(5), abs=1e-15) == found.AP
    assert (found.AP_x, found.AP_y, found.AP_z) == (2, 1, 0)
    assert pytest.approx(math.sqrt(2) / 2 + 3 * math.sqrt(2 / 3), abs=1e-15) == found.RP
    assert (found.AP_a, found.RP_a) == (0, 0)


def test_angles_by_hand():
    # a: mean 2 mrad, deviations ∓1 mrad, S = √2 mrad; and b, c as they stand
    found = pp.iso9283_of(HOME, cycles((0, 0, 0, 1e-3, 0.1, -0.2), (0, 0, 0, 3e-3, 0.1, -0.2)))
    assert (found.AP_a, found.AP_b, found.AP_c) == pytest.approx((2e-3, 0.1, -0.2), abs=1e-15)
    assert (found.RP_a, found.RP_b, found.RP_c) == pytest.approx((3e-3 * math.sqrt(2), 0, 0), abs=1e-15)


def test_angles_are_about_the_base_axes():
    """A turn by 2 mrad about the base's z is c = 2 mrad, whatever the commanded orientation."""
    commanded = Rotation.from_euler("xyz", [0.4, -1.1, 2.0])
    turned = Rotation.from_rotvec([0, 0, 2e-3]) * commanded
    attained = np.tile(np.eye(4), (2, 1, 1))
    attained[:, :3, :3] = turned.as_matrix()
    wanted = np.eye(4)
    wanted[:3, :3] = commanded.as_matrix()
    found = pp.iso9283_of(wanted, attained)
    assert (found.AP_a, found.AP_b, found.AP_c) == pytest.approx((0, 0, 2e-3), abs=1e-15)


def test_matrices_and_angles_are_the_same():
    rng = np.random.default_rng(1)
    rows = rng.normal(0, 0.3, (7, 6))
    commanded = rng.normal(0, 0.3, 6)
    matrices = np.tile(np.eye(4), (8, 1, 1))
    for matrix, row in zip(matrices, [*rows, commanded], strict=True):
        matrix[:3, :3] = Rotation.from_euler("xyz", row[3:]).as_matrix()  # fixed axes, as in a URDF
        matrix[:3, 3] = row[:3]
    one, other = pp.iso9283_of(commanded, rows), pp.iso9283_of(matrices[7], matrices[:7])
    assert list(dict(one).values()) == pytest.approx(list(dict(other).values()), abs=1e-14)


def test_cycles_that_are_the_same_do_not_scatter():
    found = pp.iso9283_of([0.3, 0.2, 0.1, 0, 0, 0], np.tile([0.7, 0.1, 1 / 3, 0.1, 0.2, 0.3], (30, 1)))
    assert (found.RP, found.RP_a, found.RP_b, found.RP_c) == (0, 0, 0, 0)


def test_figures_by_name():
    found = pp.iso9283_of(HOME, cycles((1, 0, 0), (3, 0, 0)))
    assert found["AP"] == found.AP == dict(found)["AP"] == found.to_dict()["AP"] == 2
    assert list(found) == ["AP", "AP_x", "AP_y", "AP_z", "AP_a", "AP_b", "AP_c", "RP", "RP_a", "RP_b", "RP_c"]
    with pytest.raises(pp.InputError, match="AP_q"):
        found["AP_q"]


# the distance of two poses -------------------------------------------------------------------------------------------


def test_distance_by_hand():
    # commanded 3-4-5; attained distances 5, 7, 6: mean 6, S = 1; along x 3, 3, 3; along y 4, √40, √27
    commanded = [(0, 0, 0, 0, 0, 0), (3, 4, 0, 0, 0, 0)]
    first = cycles((0, 0, 0), (0, 0, 0), (0, 0, 0))
    second = cycles((3, 4, 0), (3, math.sqrt(40), 0), (-3, math.sqrt(27), 0))
    found = pp.iso9283_distance(commanded, [first, second])
    assert pytest.approx((1, 3), abs=1e-14) == (found.AD, found.RD)
    along = np.array([4, math.sqrt(40), math.sqrt(27)])
    assert (found.AD_x, found.AD_y, found.AD_z) == pytest.approx((0, along.mean() - 4, 0), abs=1e-14)
    assert (found.RD_x, found.RD_y, found.RD_z) == pytest.approx((0, 3 * along.std(ddof=1), 0), abs=1e-14)


def test_angular_distance_by_hand():
    # |a₁ - a₂|: commanded 0.1; attained 0.12 and 0.10
    commanded = [(0, 0, 0, 0.3, 0, 0), (1, 0, 0, 0.2, 0, 0)]
    first, second = cycles((0, 0, 0, 0.31), (0, 0, 0, 0.30)), cycles((1, 0, 0, 0.19), (1, 0, 0, 0.20))
    found = pp.iso9283_distance(commanded, [first, second])
    assert (found.AD_a, found.AD_b, found.AD_c) == pytest.approx((0.01, 0, 0), abs=1e-15)
    assert found.RD_a == pytest.approx(3 * 0.02 / math.sqrt(2), abs=1e-15)


def test_distance_by_plain_sums():
    rng = np.random.default_rng(2)
    commanded = rng.normal(0, 1, (2, 6)) * [1, 1, 1, 0, 0, 0]
    attained = commanded[:, None] + 1e-3 * rng.normal(0, 1, (2, 30, 6))
    found = pp.iso9283_distance(commanded, attained)
    far = [math.dist(*rows) for rows in zip(attained[0, :, :3].tolist(), attained[1, :, :3].tolist(), strict=True)]
    mean = sum(far) / 30
    assert pytest.approx(mean - math.dist(commanded[0, :3], commanded[1, :3]), abs=1e-14) == found.AD
    assert pytest.approx(3 * math.sqrt(sum((d - mean) ** 2 for d in far) / 29), abs=1e-14) == found.RD


# wrong input ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("commanded", "attained", "message"),
    [
        (np.zeros(5), np.zeros((3, 6)), r"the commanded pose must be a pose \(4, 4\)"),
        (np.zeros((3, 3)), np.zeros((3, 6)), r"the commanded pose must be a pose \(4, 4\)"),
        (2 * np.eye(4), np.zeros((3, 6)), "the commanded pose must be rotation"),
        (np.diag([1.0, 1, -1, 1]), np.zeros((3, 6)), "the commanded pose must be rotation"),
        (HOME, np.zeros((3, 3)), r"the attained poses must be poses \(n, 4, 4\)"),
        (HOME, np.zeros(6), r"the attained poses must be poses \(n, 4, 4\)"),
        (HOME, np.zeros((1, 6)), "at least 2 cycles, got 1"),
        (HOME, np.eye(4)[None], "at least 2 cycles, got 1"),
        (HOME, np.array([np.eye(4), np.eye(4), np.ones((4, 4))]), "row 2 is not"),
        (HOME, [[np.nan] * 6] * 2, "the attained poses must be finite"),
        (HOME, "cycles", "the attained poses must be numbers"),
    ],
)
def test_wrong_cycles_are_refused_in_a_line(commanded, attained, message):
    with pytest.raises(pp.InputError, match=message) as caught:
        pp.iso9283_of(commanded, attained)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("commanded", "attained", "message"),
    [
        (HOME, [np.zeros((2, 6))] * 2, "the commanded poses must be two"),
        ([HOME, HOME], [np.zeros((2, 6))], "the attained poses must be two"),
        ([HOME, HOME], [np.zeros((2, 6)), np.zeros((3, 6))], "2 and 3 cycles at the two poses"),
        ([HOME, HOME], [np.zeros((2, 6)), np.zeros((3, 5))], "the attained poses at the second"),
    ],
)
def test_wrong_pairs_are_refused_in_a_line(commanded, attained, message):
    with pytest.raises(pp.InputError, match=message):
        pp.iso9283_distance(commanded, attained)


def test_near_the_singularity_of_the_angles_it_warns():
    near, far = [0, 0, 0, 0, 1.5, 0.3], [0, 0, 0, 0.1, 1.4, 0]
    with pytest.warns(PrecisionPinWarning, match="W_ANGLES.*b = 85.94 deg"):
        pp.iso9283_of(near, np.tile(near, (2, 1)))
    pp.iso9283_of(far, np.tile(far, (2, 1)))  # a warning is an error in the tests


# RP of many cycles ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("axes", "expected"), [((1, 1, 1), 3.616088), ((1, 1, 0), 3.218723), ((0, 0, 1), 2.606315), ((0, 0, 0), 0.0)]
)
def test_limit_in_space_in_a_plane_and_on_a_line(axes, expected):
    assert repeatability_limit(np.diag(np.array(axes, dtype=float))) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("spread", [(1, 2, 3), (1e-5, 0.3, 1), (0, 1e-3, 1), (0, 0.2, 0.7), (1e-6, 1e-6, 4e-6)])
def test_mean_distance_by_its_integral(spread):
    variances = np.array(spread, dtype=float) ** 2
    scale = variances.max()

    def integrand(u):
        return -np.expm1(-0.5 * np.log1p(2 * variances / scale * u * u).sum()) / (u * u)

    whole = sum(integrate.quad(integrand, *ends, limit=500)[0] for ends in ((0, 1), (1, np.inf)))
    assert mean_distance(np.diag(variances)) == pytest.approx(math.sqrt(scale / math.pi) * whole, rel=1e-7)


def test_limit_does_not_depend_on_the_axes():
    turn = Rotation.from_rotvec([0.3, -1.0, 0.8]).as_matrix()
    covariance = np.diag([1e-10, 4e-10, 0.0])
    limits = repeatability_limit(np.array([covariance, turn @ covariance @ turn.T]))
    assert limits[0] == pytest.approx(limits[1], rel=1e-9)


@pytest.mark.slow
def test_thirty_cycles_by_simulation():
    """Mean 2.2 % below the limit, single tests scatter by some 9 %, and E[l̄] = √(1 - 1/n) m exactly."""
    rng = np.random.default_rng(3)
    tests = [rng.normal(size=(30, 3)) for _ in range(4000)]
    found = np.array([pp.iso9283_of(HOME, np.hstack([one, np.zeros((30, 3))])).RP for one in tests[:800]])
    limit = float(repeatability_limit(np.eye(3)))
    assert found.mean() / limit == pytest.approx(1 - 0.022, abs=4 * found.std() / limit / math.sqrt(800))
    assert found.std() / limit == pytest.approx(0.09, abs=0.01)
    distances = [np.linalg.norm(one - one.mean(axis=0), axis=1).mean() for one in tests]
    expected = math.sqrt(1 - 1 / 30) * float(mean_distance(np.eye(3)))
    assert np.mean(distances) == pytest.approx(expected, abs=4 * np.std(distances) / math.sqrt(4000))
