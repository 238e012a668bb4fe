"""Errors against datums: an independent simulation of 40 cases, closed forms by hand, properties of all, and refusals."""

import numpy as np
import pytest

from model.datum_cases import PROCEDURES, TASK, arm, at_task, datum, draws_of, symmetric
from precision_pin import Draw, ErrorModel, InputError, Normal, Scope, Space
from precision_pin.analyses.compensation.compensate import compensate
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.space import Estimates
from precision_pin.kernel import sampler
from precision_pin.robot.configurations import ApproachedPose
from precision_pin.robot.datums import Datum
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sampling import monte_carlo
from precision_pin.sampling.one_pose import relative
from precision_pin.sources import JointOffset
from precision_pin.sources.backlash import Backlash
from support.plain_robot import chain_of, random_arm

SAMPLES = 8_192
ALL_CASES = [(name, number) for name, entry in PROCEDURES.items() for number in range(len(entry["cases"]))]


# independent simulation -----------------------------------------------------------------------------------------------


@pytest.mark.fast(2)
@pytest.mark.parametrize(("name", "number"), ALL_CASES)
def test_first_order_of_independent_cases(name: str, number: int) -> None:
    case = PROCEDURES[name]["cases"][number]
    model, at = at_task(name, tuple(case["noise"]))
    expected = symmetric(case["first_order"]["covariance"])
    size = len(expected)
    # the sources are linear in their draws
    none, each = at.linear(np.zeros((model.space.size, 1))), at.linear(np.eye(model.space.size))
    covariance = (each - none) @ model.space.covariance @ (each - none).T
    deviations = np.sqrt(np.diag(expected))
    np.testing.assert_allclose((covariance[:size, :size] - expected) / np.outer(deviations, deviations), 0, atol=1e-8)
    mean = at.linear(model.space.mean[:, None])[:size, 0]
    np.testing.assert_allclose(mean, case["first_order"]["mean"], rtol=0, atol=1e-12)
    # the tangent at the means of biased errors differs in second order
    limit = 3e-3 if PROCEDURES[name]["arm"] == "ur5bias" else 1e-8
    np.testing.assert_allclose(np.diag(at.covariance)[:size], np.diag(expected), rtol=limit)


def standard_errors(errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return those of mean and covariance, ``(k,)`` and ``(k, k)``."""
    count, squares = errors.shape[1], (errors - errors.mean(axis=1, keepdims=True)) ** 2
    covariance = np.cov(errors)
    return np.sqrt(np.diag(covariance) / count), np.sqrt(np.abs(squares @ squares.T / count - covariance**2) / count)


def quantile(values: np.ndarray, level: float) -> tuple[float, float]:
    """Return the quantile of sorted values and its standard error, by the order statistics three of them away."""
    count, middle = len(values), level * (len(values) - 1)
    width = np.sqrt(count * level * (1 - level))
    low, high = max(int(middle - 3 * width), 0), min(int(middle + 3 * width), count - 1)
    return float(np.quantile(values, level)), float((values[high] - values[low]) / (high - low) * width)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "number"), ALL_CASES)
def test_sampled_law_of_independent_cases(name: str, number: int) -> None:
    case = PROCEDURES[name]["cases"][number]
    model, at = at_task(name, tuple(case["noise"]))
    size = len(case["mean"])
    errors = sampler.errors(sampler.to_arrays(at), "exact", 20 + number, 0, SAMPLES)[:size]
    mean, covariance = errors.mean(axis=1), np.cov(errors)
    mean_se, covariance_se = standard_errors(errors)
    if PROCEDURES[name]["arm"] == "ur5x10":
        # of errors as large as these, the second order that the model leaves out shows: take it from solved robots
        x = model.space.sample(5, 0, 100)
        gap = model.procedures.solved(at, x)[:size] - at.exact(x)[:size]
        mean, mean_se = mean + gap.mean(axis=1), np.hypot(mean_se, gap.std(axis=1) / np.sqrt(100))
        assert (gap.std(axis=1) < 0.2 * errors.std(axis=1)).all()
        covariance_se = covariance_se + 0.02 * np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    upper = np.triu_indices(size)
    off = [
        *((mean - case["mean"]) / np.hypot(mean_se, case["mean_se"])),
        *((covariance[upper] - case["covariance"]) / np.hypot(covariance_se[upper], case["covariance_se"])),
    ]
    for rows, key in ((errors[:3], "d"), (errors[3:], "delta")):
        values = np.sort(np.linalg.norm(rows, axis=0))
        for level, expected, error in case.get(key, ()):
            found, own = quantile(values, level)
            off.append((found - expected) / np.hypot(own, error))
    # of some 35 figures one may be off by more than three standard errors
    assert np.sort(np.abs(off))[-2] < 3
    assert np.max(np.abs(off)) < 4


@pytest.mark.fast(2)
@pytest.mark.parametrize("name", PROCEDURES)
def test_single_robots_of_independent_cases(name: str) -> None:
    model, at = at_task(name)
    for entry in PROCEDURES[name]["robots"]:
        x, expected = draws_of(model, entry)[:, None], np.array(entry["with_datum"])
        rows = slice(0, len(expected))
        np.testing.assert_allclose(at.linear(x)[rows, 0], entry["first_order"], rtol=0, atol=1e-10)
        np.testing.assert_allclose(model.procedures.solved(at, x)[rows, 0], expected, rtol=0, atol=1e-10)
        gap = np.abs(at.exact(x)[rows, 0] - expected).max()
        assert gap < 0.1 * np.abs(expected).max()


# wrong inputs ---------------------------------------------------------------------------------------------------------

PLACES = {"camera": np.eye(4), "board": np.eye(4), "grasp": np.eye(4)}
VIEWS = {"on": "tool0", "weights": (1e-3, 1e-3), **PLACES}
SAME_AXIS = [[0.1, -1.2, 1.4, -1.5, -1.2, angle] for angle in (0.0, 0.5, 1.0, -0.7)]
HAND = ("H1", "H2", "H3", "H4")

WRONG = [
    ("the noise of a datum must be zero or more", lambda: Datum.best_fit(["M1", "M2", "M3"], -1e-3)),
    ("'deg' in '1 deg' is not a unit of length", lambda: Datum.three_points("O", "X", "Y", "1 deg")),
    ("2 poses for a datum; give at least 3", lambda: Datum.tool_pivot(["P1", "P2"])),
    ("must be a list of names or joint values, got 'M1'", lambda: Datum.best_fit("M1")),
    ("the keys std and attitude", lambda: Datum.taught("A", {"sd": 1e-3})),
    ("the attitude of a touch must be zero or more", lambda: Datum.taught("A", {"attitude": -1e-3})),
    ("the noise of a camera must be", lambda: Datum.eye_to_hand(HAND, **VIEWS, noise=(1, 2, 3))),
    ("the noise of a camera must be zero or more", lambda: Datum.eye_to_hand(HAND, **VIEWS, noise=(-1, 2))),
    ("give the weights of the solver", lambda: Datum.eye_to_hand(HAND, on="tool0", **PLACES)),
    ("the pose of the board is not a rotation", lambda: Datum.eye_to_hand(HAND, **{**VIEWS, "board": 2 * np.eye(4)})),
    ("the pose of the grasp is not a rotation", lambda: Datum.eye_to_hand(HAND, **{**VIEWS, "grasp": np.eye(4) + np.eye(4)[3]})),
    ("the pose of the camera must be", lambda: Datum.eye_to_hand(HAND, **{**VIEWS, "camera": np.eye(3)})),
    ("on, the link that carries .* must be text, .* got None", lambda: Datum.eye_to_hand(HAND, **{**VIEWS, "on": None})),
    ("the name of a datum must be text", lambda: Datum.taught("A", name=None)),
    ("'' is not a name of a datum", lambda: Datum.taught("A", name="")),
    ("no pose named 'AA'; did you mean 'A'", Datum.taught("AA")),
    ("3 joint values for 6 joints", Datum.taught([1, 2, 3])),
    ("no link named 'tol0'", Datum.eye_to_hand(HAND, **{**VIEWS, "on": "tol0"})),
    ("'ee_link' is not on the path from world to tool0", Datum.eye_to_hand(HAND, **{**VIEWS, "on": "ee_link"})),
    ("the points of a three_points lie on a line", Datum.three_points("A", "A", "O")),
    ("the points of a best_fit lie on a line", Datum.best_fit(["A", "O", "A", "O"])),
    ("they are up to .* mm from their mean", Datum.tool_pivot(["A", "T1", "O"])),
    ("need at least two axes of rotation", Datum.tool_pivot(["A", "A", "A"])),
    ("do not determine the camera; turn the hand about two axes", Datum.eye_to_hand(SAME_AXIS, **VIEWS)),
    ("do not determine the camera", Datum.hand_eye(["A"] * 4, "A", **VIEWS)),
    ("no pose named 'T9'", Datum.hand_eye(HAND, {"T9": "V1"}, **VIEWS)),
]  # fmt: skip


def test_wrong_datums_are_refused() -> None:
    for message, given in WRONG:
        with pytest.raises(InputError, match=message) as caught:
            arm("ur5").against(given if isinstance(given, Datum) else given())
        assert len(caught.value.findings) == 1
    touch, camera = Datum.taught("A"), Datum.hand_eye(HAND, "V1", **VIEWS)
    for message, *given in (
        ("two datums have the same name, got 'taught', 'taught'", touch, Datum.taught("T1")),
        ("datum hand_eye: a camera sees one workpiece; give it as the last datum", camera, touch),
        ("each of the datums must be of type Datum", 3),
        ("no datum named 'fixture'", "fixture"),
    ):
        with pytest.raises(InputError, match=message):
            arm("ur5").against(*given)
    with pytest.raises(InputError, match="an arm of 4 joints cannot be taught an attitude"):
        arm("paper").against(Datum.taught("A", turns=True))
    viewed = arm("ur5").against(Datum.hand_eye(HAND, {"T1": "V1"}, **VIEWS))
    assert viewed.at("T1").covariance.any()
    with pytest.raises(InputError, match="no view is given for this task"):
        viewed.at("M1")


# other settings of a model --------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_equilibrium_statics() -> None:
    """Taught at the pose of the task, nothing is left, loads and deflections included."""
    for statics in ("nominal", "equilibrium"):
        model = ErrorModel.load(PAPER_SHEET).with_({"statics": statics})
        there = model.against(Datum.taught("paper")).at("paper")
        x = model.space.sample(1, 0, 50)
        assert np.abs(there.exact(x)[:3]).max() < 1e-12
        assert np.abs(there.tangent[0][:3]).max() < 1e-12
        fixture = model.against(Datum.three_points([0.1, 0.2, 0.4, 0.1], [0.5, -0.2, 0.6, 0], [-0.5, 0.3, 0.9, 0.3]))
        at = fixture.at("paper")
        assert np.isfinite(at.covariance).all()
        if statics == "nominal":
            # warnings of statics are those of the arm, not of what the datum leaves of its errors
            assert fixture.statics_findings(at) == model.statics_findings(model.at("paper"))


def test_approaches_of_measuring_poses() -> None:
    """Play taken up on the same side cancels, on opposite sides it doubles."""
    chain = arm("paper").chain
    source = Backlash(joint="joint2", backlash=Normal(1e-5, mean=1e-4), band=1.0, scope="unit")
    model = ErrorModel(chain, Space(), [source])
    pose = [0.1, 0.2, 0.4, 0.3]
    approached = {side: ApproachedPose(pose, f"joint2 {side}") for side in ("+", "-")}
    alone = model.at(approached["+"]).error_at_means[:3]
    assert np.linalg.norm(alone) > 1e-5
    for there in "+-":
        for here in "+-":
            at = model.against(Datum.taught(approached[there])).at(approached[here])
            own = model.at(approached[here]).error_at_means - model.at(approached[there]).error_at_means
            np.testing.assert_allclose(at.error_at_means[:3], own[:3], rtol=0, atol=1e-13)
            assert np.allclose(at.error_at_means[:3], 0, atol=1e-13) == (here == there)


def test_a_calibrated_arm_and_another_target() -> None:
    model = arm("ur5")
    names = [name for draw in model.space.draws if draw.scope is Scope.UNIT for name in draw.components]
    remaining = np.diag(np.linspace(1e-10, 4e-10, len(names)))
    estimates = Estimates(tuple(names), np.full(len(names), 1e-5), remaining)
    fixture = datum("ur5/three_points", (0.0, 0.0))
    calibrated = model.calibrated(estimates).against(fixture)
    at = calibrated.at(TASK)
    assert at.covariance[0, 0] < 0.3 * model.against(fixture).at(TASK).covariance[0, 0]
    x = calibrated.space.sample(0, 0, 20)
    gap = at.exact(x)[:3] - calibrated.procedures.solved(at, x)[:3]
    assert np.abs(gap).max() < 1e-2 * np.abs(at.exact(x)[:3]).max()
    # like: the same datum, for a point elsewhere on the tool; G there is that of a rigid body
    against = model.against(fixture)
    moved = against.like(model.chain.with_target([0.0, 0.0, 0.3]), against.space)
    direct = model.like(moved.chain, model.space).against(fixture)
    np.testing.assert_array_equal(moved.at(TASK).covariance, direct.at(TASK).covariance)


def test_correlated_draws_of_visits_are_correlated_at_each_visit() -> None:
    chain = chain_of(random_arm(4, joints=6), tip="tool")
    draws = [Draw(name, Normal(1e-4), Scope.VISIT) for name in ("a", "b")]
    sources = [JointOffset(joint="joint2", offset="a"), JointOffset(joint="joint5", offset="b")]
    model = ErrorModel(chain, Space(tuple(draws), (Correlation.pair("a", "b", 0.8),)), sources)
    pose, task = np.full(6, 0.3), np.full(6, 0.7)
    found = model.against(Datum.taught(pose)).at(task)
    # by hand: two independent visits of the same law, the first transported as a rigid body
    lever = chain.at(task).pose[:3, 3] - chain.at(pose).pose[:3, 3]
    transport = np.eye(6)
    transport[:3, 3:] = [[0, lever[2], -lever[1]], [-lever[2], 0, lever[0]], [lever[1], -lever[0], 0]]
    there, here = model.at(pose).covariance, model.at(task).covariance
    np.testing.assert_allclose(found.covariance, here + transport @ there @ transport.T, rtol=1e-9, atol=1e-20)


def test_what_relative_leaves_and_taught_does_not() -> None:
    # the same robots: the turn of the taught frame, times the way from it to the work
    chain = chain_of(random_arm(3), tip="tool")
    offsets = [JointOffset(joint=joint.name, offset=Normal(1e-3)) for joint in chain.joints]
    model = ErrorModel(chain, Space(), offsets)
    place, task = 0.1 * np.ones(7), np.linspace(0.4, -0.3, 7)
    settings = {"samples": 64, "model": "linear", "keep_samples": True}
    difference = relative(model, task, place, **settings).errors
    taught = monte_carlo(model.against(Datum.taught(place)), task, **settings).errors
    turn = model.at(place).linear(model.space.sample(0, 0, 64))[3:]
    way = chain.at(task).pose[:3, 3] - chain.at(place).pose[:3, 3]
    np.testing.assert_allclose(difference[:3] - taught[:3], np.cross(turn, way, axis=0), atol=1e-15)
    np.testing.assert_allclose(difference[3:], taught[3:], atol=1e-15)
    # a base that is turned: nothing of it is left where the way turns with the frame taught
    base = ErrorModel(chain, Space(), [JointOffset(joint=chain.joints[0].name, offset=Normal(1e-3))])
    assert np.abs(base.against(Datum.taught(place)).at(task).jacobian).max() < 1e-12


def test_a_compensated_arm_is_one_that_goes_to_corrected_joint_values() -> None:
    model = ErrorModel.load("example:ur5")
    compensated = model.against("compensated")
    x = model.space.sample(5, 0, 2000)
    for pose in ("ready", "stretched"):
        corrected = compensate(model, [pose], mode="pose").corrected[:, 0]
        driven, nominal = model.at(corrected), model.at(pose).posture.pose
        misses = driven.posture.pose[:3, 3, None] + driven.exact(x)[:3] - nominal[:3, 3, None]
        errors = compensated.at(pose).exact(x)[:3]
        # the correction moves the joints by a few mrad, and errors turn with them
        assert np.linalg.norm(misses - errors, axis=0).max() < 0.02 * np.linalg.norm(errors, axis=0).max()
        levels = [np.quantile(np.linalg.norm(d, axis=0), [0.5, 0.95]) for d in (misses, errors)]
        np.testing.assert_allclose(*levels, rtol=2e-3)


def test_compensation_after_a_procedure_subtracts_its_error_at_the_means() -> None:
    model = ErrorModel.load("example:ur5")
    taught = model.against(Datum.taught("folded", "0.05 mm"))
    both = model.against(Datum.taught("folded", "0.05 mm"), Datum.compensated())
    x = both.space.sample(1, 0, 50)
    mean = both.space.mean[:, None]
    for q, pose in zip(both.at_many(["ready", "stretched"]), ("ready", "stretched"), strict=True):
        at = taught.at(pose)
        expected = at.exact(x) - at.exact(mean)
        np.testing.assert_allclose(q.exact(x), expected, rtol=0, atol=1e-15)
        np.testing.assert_allclose(q.solved(x), at.solved(x) - at.exact(mean), rtol=0, atol=1e-14)
        np.testing.assert_allclose(
            sampler.errors(sampler.to_arrays(q), "exact", 1, 0, 50), expected, rtol=0, atol=1e-12
        )
        arm = model.at(pose)
        drawn = x[: model.space.size]
        expected = arm.exact(drawn) - arm.exact(model.space.mean[:, None])
        np.testing.assert_allclose(q.in_base_axes.exact(x), expected, rtol=0, atol=1e-15)


def test_an_arm_of_few_joints_keeps_its_attitude_when_compensated() -> None:
    at = ErrorModel.load(PAPER_SHEET).against("compensated").at("paper")
    bare = ErrorModel.load(PAPER_SHEET).at("paper")
    assert np.abs(at.error_at_means[:3]).max() < 1e-15
    np.testing.assert_array_equal(at.error_at_means[3:], bare.error_at_means[3:])
    assert np.linalg.norm(bare.error_at_means[:3]) > 8e-3
    offset = JointOffset(joint="joint1", offset=Normal(1e-4, mean=1e-3))
    built = ErrorModel(ErrorModel.load(PAPER_SHEET).chain, Space(), [offset]).against("compensated")
    assert np.abs(built.at([0, 0, 0, 0]).error_at_means[:3]).max() < 1e-15
    # what is stated counts, not the number of joints
    told = ErrorModel.load(PAPER_SHEET).against(Datum.compensated(turns=True)).at("paper")
    assert np.abs(told.error_at_means).max() < 1e-15
    six = ErrorModel.load("example:ur5")
    kept = six.against(Datum.compensated(turns=False)).at("ready").error_at_means
    assert np.abs(kept[:3]).max() < 1e-15
    np.testing.assert_array_equal(kept[3:], six.at("ready").error_at_means[3:])
    with pytest.raises(InputError, match="other than none and compensated"):
        Datum.taught("paper", name="compensated")
