"""Readings and their derivatives, against homogeneous matrices and finite differences."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import precision_pin as pp
from analyses.calibration.arms import OFF_AXIS, plain_model, random_poses, readings_of
from precision_pin.base import se3
from precision_pin.base.errors import InputError
from precision_pin.sheet.measurement import Plane
from precision_pin.sources import Payload

KINDS = [
    pp.Measurement(kind, target=(0.1, -0.2, 0.05), base=base, target_known=known, anchor=anchor)
    for kind, base, known in itertools.product(("position", "pose", "distance"), ("known", "free"), (True, False))
    for anchor in [(0.4, 0.1, -0.2) if kind == "distance" else (0.0, 0.0, 0.0)]
]
POINT, NORMAL, SOCKETS = (0.2, 0.1, -0.3), (1.0, -2.0, 2.0), ((2.0, 2.0, 2.0), (0.1, 0.5, 0.3), (-2.0, 1.0, 0.0))
KINDS += [
    pp.Measurement(kind, target=(0.1, -0.2, 0.05), base=base, target_known=known, **place)  # type: ignore[arg-type]
    for kind, place in (("plane", {"plane": (POINT, NORMAL)}), ("socket", {"sockets": SOCKETS}))
    for base, known in (("known", True), ("free", False))
]


def test_the_tilts_of_a_plane_are_about_directions_in_it() -> None:
    """The two tilts are about directions in the plane."""
    axes = Plane(POINT, tuple(np.array(NORMAL) / 3)).axes
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(axes[:, 0], np.array(NORMAL) / 3)


def names(measurement: pp.Measurement) -> str:
    return f"{measurement.kind}-{measurement.base}-{measurement.target_known}"


def setting(measurement: pp.Measurement) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    generator = np.random.default_rng(3)
    pose = se3.pose(Rotation.random(rng=generator).as_matrix(), generator.uniform(-1, 1, 3))
    error = generator.normal(0, 0.1, 6)
    return pose, error, generator.normal(0, 0.2, len(measurement.nuisances))


def by_matrices(measurement: pp.Measurement, pose: np.ndarray, error: np.ndarray, nuisances: np.ndarray) -> np.ndarray:
    """Return a reading as a product of 4 × 4 matrices."""
    left = list(nuisances)

    def take(count: int) -> np.ndarray:
        taken, left[:] = left[:count], left[count:]
        return np.array(taken)

    tip = np.eye(4)
    tip[:3, :3] = Rotation.from_rotvec(error[3:]).as_matrix() @ pose[:3, :3]
    tip[:3, 3] = pose[:3, 3] + error[:3]
    base, anchor, target = np.eye(4), np.array(measurement.anchor), np.eye(4)
    of_place = np.zeros(9)
    if measurement.base == "free" and measurement.kind in ("plane", "socket"):
        own = take(3 if measurement.kind == "plane" else 9)
        of_place[: own.size] = own
    elif measurement.base == "free" and measurement.kind == "distance":
        anchor = anchor + take(3)
    elif measurement.base == "free":
        base[:3, 3], base[:3, :3] = take(3), Rotation.from_rotvec(take(3)).as_matrix()
    target[:3, 3] = measurement.target
    if not measurement.target_known:
        target[:3, 3] += take(3)
        if measurement.kind == "pose":
            target[:3, :3] = Rotation.from_rotvec(take(3)).as_matrix()
    seen = base @ tip @ target
    if measurement.kind == "distance":
        return np.array([np.linalg.norm(seen[:3, 3] - anchor)])
    if measurement.kind == "plane":
        # n from two points in the plane, each raised by its tilt
        normal = np.array(NORMAL) / 3
        first = np.cross(normal, np.eye(3)[0])
        first /= np.linalg.norm(first)
        second = np.cross(normal, first)
        turned = np.cross(first - of_place[1] * normal, second - of_place[2] * normal)
        turned /= np.linalg.norm(turned)
        return np.array([turned @ (seen[:3, 3] - POINT) - of_place[0]])
    if measurement.kind == "socket":
        nominal = pose[:3, :3] @ measurement.target + pose[:3, 3]
        distances = [np.linalg.norm(nominal - one) for one in SOCKETS]
        k = distances.index(min(distances))
        return seen[:3, 3] - SOCKETS[k] - of_place[3 * k : 3 * k + 3]
    turn = Rotation.from_matrix(seen[:3, :3] @ pose[:3, :3].T).as_rotvec()
    return np.concatenate([seen[:3, 3], turn])[: measurement.size]


@pytest.mark.parametrize("measurement", KINDS, ids=names)
def test_reading_is_the_product_of_matrices(measurement: pp.Measurement) -> None:
    pose, error, nuisances = setting(measurement)
    found = measurement.predict(pose, error[:, None], nuisances[:, None])[:, 0]
    np.testing.assert_allclose(found, by_matrices(measurement, pose, error, nuisances), atol=1e-14)


@pytest.mark.parametrize("measurement", KINDS, ids=names)
def test_slopes_are_finite_differences(measurement: pp.Measurement) -> None:
    pose, error, nuisances = setting(measurement)
    here = np.concatenate([error, nuisances])
    step = 1e-5

    def reading(values: np.ndarray) -> np.ndarray:
        return measurement.predict(pose, values[:6, None], values[6:, None])

    columns = []
    for k in range(here.size):
        ahead, behind = here.copy(), here.copy()
        ahead[k] += step
        behind[k] -= step
        columns.append(measurement.residual(reading(ahead), reading(behind))[:, 0] / (2 * step))
    slopes = measurement.slopes(pose, error, nuisances)
    np.testing.assert_allclose(np.hstack([slopes.error, slopes.nuisances]), np.array(columns).T, atol=2e-9)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kind": "angle"}, "the kind of a measurement must be position or pose or distance"),
        ({"std": 0.0}, "above zero and finite, in m"),
        ({"std": -1e-5}, "above zero"),
        ({"base": "unknown"}, "the base of a measurement must be known or free"),
        ({"target": (1.0, 2.0)}, "three lengths in m"),
        ({"attitude_std": 1e-4}, "belongs to the measurement of a pose"),
        ({"anchor": (1.0, 0.0, 0.0)}, "belongs to the measurement of a distance"),
        ({"sockets": ((1.0, 0.0, 0.0),)}, "sockets belongs to the measurement of a socket"),
        ({"kind": "socket"}, "the measurement of a socket needs sockets"),
        ({"kind": "socket", "sockets": 3}, "must be a list of points"),
        ({"kind": "socket", "sockets": ((0, 0, 0), (0, 0, 0))}, "two sockets of a measurement are at one place"),
        ({"kind": "plane"}, "the measurement of a plane needs plane"),
        ({"kind": "plane", "plane": (1, 2, 3)}, "must be a point and a normal"),
        ({"kind": "plane", "plane": ((0, 0, 0), (0, 0, 0))}, "normal of the plane of a measurement is zero"),
        ({"facing": (1.0, 0.0, 0.0)}, "facing of a measurement needs visible_from"),
        ({"cone": 0.5}, "cone of a measurement needs visible_from"),
        ({"visible_from": (1.0, 0.0, 0.0), "facing": (0.0, 0.0, 0.0)}, "facing of a measurement is zero"),
        ({"cone": 4.0}, "above zero and at most a half turn"),
        ({"load": (3.0,)}, "the load of a measurement"),
        ({"load": (Payload(at="tool", mass=pp.Normal(0.1, mean=1.0)),)}, "is given by fixed numbers"),
    ],
)
def test_wrong_settings_are_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        pp.Measurement(**settings)  # type: ignore[arg-type]


def test_slopes_of_the_model_at_other_values_are_finite_differences() -> None:
    from precision_pin.robot.examples import PAPER_SHEET

    at = pp.ErrorModel.load(PAPER_SHEET).at("paper")
    x = at.space.sample(5, 0, 1)[:, 0]
    error, slopes = at.tangent_at(x)
    std = np.sqrt(at.space.block_covariance.variances)
    ahead, behind = (at.exact(x[:, None] + sign * 1e-3 * np.diag(std)) for sign in (1, -1))
    np.testing.assert_allclose(error, at.exact(x[:, None])[:, 0], rtol=0, atol=0)
    np.testing.assert_allclose(slopes * std, (ahead - behind) / 2e-3, atol=1e-11)


@pytest.mark.slow
def test_what_is_measured_does_not_move_with_the_point_that_results_are_about() -> None:
    model, q = plain_model(), random_poses(4, 12)
    measurement = pp.Measurement(std=20e-6, target=OFF_AXIS)
    readings = readings_of(model, q, measurement, seed=2)
    away = pp.ErrorModel(model.chain.with_target((0.0, 0.1, 0.0)), pp.Space(), model.sources, model.poses)
    here, there = (pp.calibrate(each, (q, readings), measurement) for each in (model, away))
    assert there.posterior.mean == pytest.approx(here.posterior.mean, rel=1e-9, abs=1e-15)
    tip, point = here.predict("work"), there.predict("work")
    np.testing.assert_allclose(point[:3, 3], tip[:3, 3] + 0.1 * tip[:3, 1], atol=1e-12)
    plans = [pp.plan_calibration(each, q, 4, measurement, criterion="D").chosen for each in (model, away)]
    assert plans[0] == plans[1]


@pytest.mark.slow
def test_the_load_of_a_measurement_takes_the_place_of_payloads() -> None:
    """Without a payload its mass cannot be learned; with a known one the readings are those of an arm that carries it."""
    from dataclasses import replace

    from precision_pin.analyses.calibration.design import stations_of

    plain, q = plain_model(), random_poses(4, 10)
    loaded = Payload(at="tool", mass=pp.Uniform(0.5, mean=2.0))
    model = pp.ErrorModel(plain.chain, pp.Space(), (*plain.sources, loaded), plain.poses)
    measurement = pp.Measurement(std=20e-6, target=OFF_AXIS)
    learned = [
        pp.forecast_calibration(model, q, replace(measurement, load=load)).posterior.learned["payload[tool].mass"]
        for load in (None, (), (Payload(at="tool", mass=3.0),))
    ]
    assert learned[0] > 0.1
    assert learned[1:] == [0.0, 0.0]
    known = pp.ErrorModel(plain.chain, pp.Space(), (*plain.sources, Payload(at="tool", mass=3.0)), plain.poses)
    carrying = stations_of(model, q, replace(measurement, load=(Payload(at="tool", mass=3.0),)))
    for one, other in zip(carrying, stations_of(known, q, measurement), strict=True):
        columns = [one.at.space.index[name] for name in other.at.space.components]
        np.testing.assert_allclose(one.at.jacobian[:, columns], other.at.jacobian, rtol=0, atol=1e-15)
        np.testing.assert_allclose(one.at.error_at_means, other.at.error_at_means, rtol=0, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize(("facing", "axis"), [((0.0, 3.0, 0.0), 1), (None, 2)])
def test_a_target_is_seen_within_its_cone(facing: tuple[float, ...] | None, axis: int) -> None:
    """A target 0.1 m off the tip that faces along its y, or z, seen from 2 m along the base's y: by angles of plain vectors."""
    measurement = pp.Measurement(
        target=(0.0, 0.0, 0.1), visible_from=(0.0, 2.0, 0.5), facing=facing, cone=np.radians(40)
    )
    chain, seen = plain_model().chain, []
    q = random_poses(4, 60)
    for k in range(60):
        pose = chain.at(q[:, k]).pose
        target = pose @ [0.0, 0.0, 0.1, 1.0]
        sight = np.array([0.0, 2.0, 0.5]) - target[:3]
        angle = np.degrees(np.arccos(sight @ pose[:3, axis] / np.linalg.norm(sight)))
        assert measurement.sees(pose) == (angle <= 40)
        seen.append(angle <= 40)
    assert 2 < sum(seen) < 40
    plan = pp.plan_calibration(plain_model(), q, 3, measurement)
    assert plan.candidates == sum(seen)
    assert all(measurement.sees(chain.at(one).pose) for one in plan.q.T)
    assert "W_HIDDEN" in {finding.code for finding in plan.findings}
    with pytest.raises(InputError, match="sees the target at none of 1 candidates"):
        pp.plan_calibration(plain_model(), q[:, [seen.index(False)]], 1, measurement)
