"""The compiled engine with a datum against the oracle in numpy, and the same bits at many poses and for any threads."""

import numpy as np
import pytest

import precision_pin as pp
from precision_pin import ErrorModel, Normal, Scope
from precision_pin.draws.draw import Draw
from precision_pin.kernel import sampler
from precision_pin.kernel.sampler import BLOCK
from precision_pin.robot.datums import Datum
from precision_pin.sampling.many_poses import sample_poses
from precision_pin.sources import JointOffset
from precision_pin.terms.bound_source import LabelledSources
from support.sheets import everything, seven_joint_arm

ARM = everything(seven_joint_arm(), 3.0)
Q = np.random.default_rng(3).uniform(-1, 1, (7, 12))


def with_own_draws(model: ErrorModel = ARM) -> ErrorModel:
    """Return the model with draws of every scope, one of them in a product and a formula."""
    space = model.space.including([Draw("slip", Normal(1e-4), Scope.VISIT), Draw("again", Normal(1e-4), Scope.POSE)])
    result = model.like(model.chain, space)
    offsets = (JointOffset(joint="joint3", offset="slip"), JointOffset(joint="joint6", offset="again"))
    result.sources = LabelledSources((*model.sources, *offsets), (*model.labels, "slip", "again"))
    return result


def fixture(noise: float = 1e-4) -> tuple[Datum, ...]:
    place = np.eye(4)
    cameras = {
        "camera": place,
        "board": place,
        "grasp": place,
        "on": "link7",
        "noise": (noise, noise),
        "weights": (1, 1),
    }
    return Datum.three_points(*Q[:, :3].T, noise), Datum.eye_to_hand(list(Q[:, 3:7].T), **cameras)


@pytest.mark.parametrize("count", [1, 2])
def test_both_models_equal_the_oracle_with_a_datum(count: int) -> None:
    model = with_own_draws().against(*fixture()[:count])
    at = model.at(Q[:, 8])
    x = model.space.sample(2, 0, 300)
    layout = sampler.to_arrays(at)
    for name, oracle in (("exact", at.exact), ("linear", at.linear)):
        expected = oracle(x)
        scale = np.abs(expected).max()
        assert np.abs(sampler.errors_at(layout, name, x) - expected).max() < 1e-12 * (1 + scale)
        assert np.abs(sampler.errors(layout, name, 2, 0, 300) - expected).max() < 1e-12 * (1 + scale)
        # the datum counts
        assert np.abs(expected - getattr(at.arm, name)(x)).max() > 0.1 * scale


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*W_(SUPERPOSITION|DATUM|DEFLECTION)")
@pytest.mark.parametrize("how", ["exact", "linear"])
def test_many_poses_with_a_datum_have_the_samples_of_one_pose_alone(how) -> None:
    offsets = [JointOffset(joint=f"joint{k}", offset=Normal(1e-3)) for k in range(1, 8)]
    model = with_own_draws(ErrorModel(ARM.chain, pp.Space(), offsets)).against(*fixture())
    samples = BLOCK + 300
    settings = {"samples": samples, "seed": 5, "model": how}
    runs = [sample_poses(model, Q[:, 7:10], threads=threads, **settings) for threads in (1, 3)]
    assert runs[0].to_json() == runs[1].to_json()
    for pose in (0, 2):
        at = sampler.to_arrays(model.at(Q[:, 7 + pose]))
        errors = sampler.errors(at, how, 5, 0, samples, pose=pose)
        if pose == 0 and how == "exact":
            one = pp.monte_carlo(model, Q[:, 7], keep_samples=True, **settings)
            assert one.errors.tobytes() == errors.tobytes()
        norms = np.array([np.linalg.norm(errors[rows], axis=0) for rows in (slice(0, 3), slice(3, 6))])
        np.testing.assert_allclose(runs[0].norm_max[:, pose], norms.max(axis=1), rtol=1e-14)
        np.testing.assert_allclose(runs[0].mean[:, pose], errors.mean(axis=1), rtol=1e-10, atol=1e-15)
        np.testing.assert_allclose(
            runs[0].covariance[:, :, pose], np.cov(errors), rtol=1e-8, atol=1e-10 * np.cov(errors).max()
        )


def test_without_a_datum_nothing_changes() -> None:
    model = with_own_draws()
    there = model.against(*fixture())
    back = there.against()
    assert back.space.draws == model.space.draws
    assert back.labels == model.labels
    errors = [sampler.errors(sampler.to_arrays(m.at(Q[:, 9])), "exact", 1, 0, 500) for m in (model, back, there)]
    assert errors[0].tobytes() == errors[1].tobytes()
    # the robots are the same, against a datum too
    x, same = there.space.sample(1, 0, 500), model.space.sample(1, 0, 500)
    rows = [there.space.index[name] for name in model.space.components]
    np.testing.assert_array_equal(x[rows], same)
    np.testing.assert_allclose(there.at(Q[:, 9]).arm.exact(x), errors[0], rtol=0, atol=1e-13)


def test_a_pose_with_a_view_of_its_own() -> None:
    """Gains of visits that do not count at a pose are zero, and poses together give what each gives alone."""
    place = np.eye(4)
    views = {name: Q[:, k] for k, name in enumerate("ab")}
    poses = {"a": Q[:, 8], "b": Q[:, 9]}
    model = ErrorModel(
        ARM.chain, pp.Space(), [JointOffset(joint=f"joint{k}", offset=Normal(1e-3)) for k in range(1, 8)], poses
    )
    cameras = {"camera": place, "board": place, "grasp": place, "on": "link7", "noise": (1e-4, 1e-4)}
    model = model.against(Datum.hand_eye(list(Q[:, 3:7].T), views, **cameras))
    together = sampler.to_arrays_at_poses([model.at("a"), model.at("b")])
    for name, layout in zip("ab", together, strict=True):
        at = model.at(name)
        assert sum(1 for _ in at.datum.counted) == 5
        x = model.space.sample(0, 0, 50)
        np.testing.assert_allclose(sampler.errors_at(layout, "exact", x), at.exact(x), rtol=0, atol=1e-13)
    result = sample_poses(model, ["a", "b"], samples=2000, seed=1)
    for pose, name in enumerate("ab"):
        errors = sampler.errors(sampler.to_arrays(model.at(name)), "exact", 1, 0, 2000, pose=pose)
        np.testing.assert_allclose(
            result.covariance[:, :, pose], np.cov(errors), rtol=1e-8, atol=1e-10 * np.cov(errors).max()
        )
