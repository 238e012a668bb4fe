"""What is shown of a datum: both sizes of the error, what cancelled and what came on top, in texts, pages and pictures."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import precision_pin as pp
from outputs.view_cases import arm_model, arm_text, data_block, floats, likeness, matrix, nodes_of
from precision_pin.analyses.provenance import PoseLabel, Provenance
from precision_pin.analyses.result import subject
from precision_pin.analyses.shares import by_place
from precision_pin.base import se3
from precision_pin.model.datum import DatumEffect
from precision_pin.pages.report.datum import datum_effect
from precision_pin.pages.view import ViewPose, page, script_hashes
from precision_pin.pages.view.poses import tangent_of
from precision_pin.render import figure_style
from precision_pin.robot.datums import ThreePoints
from precision_pin.sampling import monte_carlo
from precision_pin.sampling.many_poses import sample_poses
from precision_pin.sampling.table import analysis_table, poses_table
from precision_pin.sources import JointOffset

# an arm of two joints cannot touch points in space, which robots solved one by one show
pytestmark = pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")

UNIT, VISIT, TOUCH = 1e-3, 0.4e-3, 0.2e-3
TASK, TAUGHT = "p", "q"
THREE = ([0.4, -0.7], [0.9, -0.2], [-0.4, 0.9])


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> pp.ErrorModel:
    """Return an arm of two joints with a zero drawn once for each robot, and another at each visit."""
    once = [JointOffset(joint=joint, offset=pp.Normal(UNIT)) for joint in ("turn", "bend")]
    anew = [
        JointOffset(joint=joint, offset=pp.Draw(f"{joint}-visit", pp.Normal(VISIT), pp.Scope.VISIT))
        for joint in ("turn", "bend")
    ]
    return arm_model(tmp_path_factory.mktemp("arm"), arm_text(), *once, *anew)


def taught(touch: float = TOUCH) -> pp.Datum:
    return pp.Datum.taught(TAUGHT, touch)


def tip_slopes(model: pp.ErrorModel, pose: str) -> np.ndarray:
    """Return the derivatives of the tip's position by the two joints, ``(3, 2)``, by differences of nominal poses."""
    q, step = model.configuration(pose), 1e-6
    ends = [[model.chain.at(q + sign * step * axis).pose[:3, 3] for sign in (1, -1)] for axis in np.eye(2)]
    return np.array([(high - low) / (2 * step) for high, low in ends]).T


def test_parts_of_the_variance(model: pp.ErrorModel) -> None:
    # taught by an arm of few joints: d = d at the task - d when taught + touch; the attitude stays
    task, place = tip_slopes(model, TASK), tip_slopes(model, TAUGHT)
    at = model.against(taught()).at(TASK)
    effect = DatumEffect.of(at)
    parts = {
        "robot": (UNIT**2 + VISIT**2) * (task**2).sum(),
        "procedure": UNIT**2 * (place**2).sum(),
        "common": -2 * UNIT**2 * (task * place).sum(),
        "visits": VISIT**2 * (place**2).sum(),
        "noise": 3 * TOUCH**2,
    }
    assert_allclose([getattr(effect, name)[0] for name in parts], list(parts.values()), rtol=1e-7)
    assert_allclose([effect.procedure[1], effect.common[1], effect.visits[1], effect.noise[1]], 0, atol=1e-30)
    assert_allclose(effect.with_datum**2, [np.trace(at.covariance[:3, :3]), np.trace(at.covariance[3:, 3:])], rtol=1e-9)
    assert_allclose(effect.without[0] ** 2, np.trace(model.at(TASK).covariance[:3, :3]), rtol=1e-9)
    assert_allclose(effect.on_top[0] ** 2, parts["visits"] + parts["noise"])
    assert_allclose(effect.cancelled[0], -(parts["procedure"] + parts["common"]) / parts["robot"])
    assert_allclose(effect.to_dict()["noise"], [3 * TOUCH**2, 0.0], rtol=1e-9)


def test_parts_with_several_datums_add_up(model: pp.ErrorModel) -> None:
    at = model.against(pp.Datum.best_fit(THREE, 1e-4), pp.Datum.three_points(*THREE, 1e-4)).at(TASK)
    effect = DatumEffect.of(at)
    assert_allclose(effect.with_datum**2, [np.trace(at.covariance[:3, :3]), np.trace(at.covariance[3:, 3:])], rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "phrases"),
    [
        ({}, ("75 % of the variance of d cancelled, 0.1 mm rms came on top",)),
        ({"common": [-1e-6, 0.0]}, ("all of the variance of d cancelled",)),
        ({"common": [-0.9995e-6, 0.0]}, ("99.9 % of the variance of d cancelled",)),
        (
            {"common": [0.5e-6, 0.0]},
            ("nothing cancelled", "added 50 %", "the datum makes d worse: 1.23 mm rms instead of 1"),
        ),
        ({"robot": [0.0, 4e-6], "common": [0.0, 0.0]}, ("d does not vary in base axes, 0.1 mm", "makes d worse")),
        ({"noise": [1e-8, 5e-6]}, ("75 %", "the datum makes δ worse: 3 mrad rms instead of 2")),
    ],
)
def test_text_of_what_cancelled(change: dict[str, list[float]], phrases: tuple[str, ...]) -> None:
    parts = {"robot": [1e-6, 4e-6], "procedure": [0, 0], "common": [-0.75e-6, 0], "visits": [0, 0], "noise": [1e-8, 0]}
    text = DatumEffect(**{name: np.array(part, float) for name, part in (parts | change).items()}).text
    assert all(phrase in text for phrase in phrases), text
    assert ("worse" in text) == any("worse" in phrase for phrase in phrases)


@pytest.mark.slow
def test_base_axes_are_of_the_same_robots(model: pp.ErrorModel) -> None:
    analysis = monte_carlo(model.against(taught()), TASK, samples=2_000, seed=3)
    bare = monte_carlo(model, TASK, samples=2_000, seed=3, keep_samples=True).errors
    base = analysis.datum.base_axes
    sizes = np.linalg.norm(bare.reshape(2, 3, -1), axis=1)
    assert base["samples"] == 2_000
    assert_allclose(base["quantile_95"], np.quantile(sizes, 0.95, axis=1), rtol=1e-12)
    assert all(low < value < high for value, (low, high) in zip(base["quantile_95"], base["interval"], strict=True))
    text = analysis_table(analysis)
    (line,) = (
        line for line in text.splitlines() if line.startswith("against datum taught (1 pose): 95 % of robots within")
    )
    assert "(2,000 of these robots)" in line
    assert analysis.datum.effect.text in line
    assert "against datum" not in analysis_table(monte_carlo(model, TASK, samples=100))
    few = monte_carlo(model.against(taught()), TASK, samples=10).datum
    assert few.base_axes is None


@pytest.mark.slow
def test_table_of_several_poses_shows_the_worst(model: pp.ErrorModel) -> None:
    result = sample_poses(model.against(taught()), [TAUGHT, TASK], samples=500)
    effect = DatumEffect.of(result.error_model.at(TASK))
    assert result.worst_pose == 1
    line = f"against datum taught (1 pose), pose 'p': std of d {1e3 * effect.with_datum[0]:.3g} mm, in base axes"
    assert line in poses_table(result)
    assert effect.text in poses_table(result)


@pytest.mark.slow
def test_places_add_up_with_the_noise_of_each_datum(model: pp.ErrorModel) -> None:
    against = model.against(pp.Datum.best_fit(THREE, 3e-4, name="cell"), replace(taught(), name="stop"))
    at = against.at(TASK)
    places, effect = by_place(at, model.chain), DatumEffect.of(at)
    assert list(places)[-2:] == ["noise of datum cell", "noise of datum stop"]
    assert_allclose(sum(places.values()), np.diag(at.covariance), rtol=1e-9)
    assert_allclose(places["noise of datum cell"][:3].sum() + places["noise of datum stop"][:3].sum(), effect.noise[0])
    assert_allclose(places["noise of datum stop"][:3], TOUCH**2)
    # tables and figures of every analysis have these first lines
    provenance, label = Provenance.of(against, 0), PoseLabel.of(against, TASK, at)
    named = ", against datum cell, stop (best_fit, taught)"
    assert subject(provenance, label).startswith(f"arm.urdf: base to tool{named}, pose 'p'")
    caption = figure_style.caption("error budget", provenance, label)
    assert caption == f"error budget of arm.urdf, base to tool at pose p{named}"
    assert "datum" not in figure_style.caption("error budget", Provenance.of(model, 0), label)


@pytest.mark.slow
def test_report_has_both_numbers_and_the_bar(model: pp.ErrorModel) -> None:
    datums = (pp.Datum.best_fit(THREE, 1e-4, name="cell"), pp.Datum.three_points(*THREE, 1e-4, name="<fixture>"))
    analysis = monte_carlo(model.against(*datums), TASK, samples=1_000)
    html = datum_effect(SimpleNamespace(analysis=analysis, prefix="pose2-")).text
    assert "Against datum cell, &lt;fixture&gt; (best_fit, three_points, 6 poses): 95 % of robots within" in html
    assert 'id="figure-pose2-datum"' in html
    assert "<fixture>" not in html
    assert html.count("<svg") == 1
    assert "in base axes" in html
    assert datum_effect(SimpleNamespace(analysis=monte_carlo(model, TASK, samples=100), prefix="")).text == ""


@pytest.mark.slow
def test_view_draws_the_procedure(model: pp.ErrorModel) -> None:
    against = model.against(pp.Datum.best_fit(THREE, 1e-4), pp.Datum.three_points(*THREE, 1e-4, name="<fixture>"))
    at = against.at(TASK)
    errors = at.exact(at.space.sample(0, 0, 20))
    text = page([ViewPose(at, errors, "p")], seed=0, model_name="exact")
    nodes = nodes_of(text)
    tips = [model.chain.at(model.configuration(q)).pose[:3, 3] for q in THREE]
    for number in range(2):
        drawn = [nodes[f"/meshcat/datum/pose{number}-{k}"].transform[:3, 3] for k in range(3)]
        assert_allclose(drawn, tips, atol=1e-9)
    assert sum(name.startswith("/meshcat/datum/axis") for name in nodes) == 3
    assert "&lt;fixture&gt; (three_points): tip at its 3 poses; axes: frame" in text
    assert "sampled robots, as built, where the datum sees them" in text
    settings = data_block(text, "settings")
    ground = next(part for part in settings["parts"] if part["link"] == 0)
    shown = [*zip(settings["poses"][0]["ghosts"], errors.T, strict=False)]
    shown.append((settings["poses"][0]["deflected"], at.error_at_means))
    for packed, error in shown:
        stands, tip = likeness(settings, 0, floats(packed).reshape(-1, 6), 1)
        assert_allclose(tip[:3, 3], at.posture.pose[:3, 3] + error[:3], atol=1e-6)
        assert_allclose(tip[:3, :3], se3.exp_rotation(error[3:]) @ at.posture.pose[:3, :3], atol=1e-6)
        # what the procedure corrects moves the base with the arm
        assert np.any(error == 0) or np.abs(stands[ground["name"]] - matrix(ground["frame"])).max() > 1e-5
    assert 'id="show-datum"' in text
    assert all(source[1:-1].removeprefix("sha256-") in text for source in script_hashes(()))
    assert 'id="show-datum"' not in page([ViewPose(at.arm, errors, "p")], seed=0, model_name="exact")


def test_frame_of_three_points() -> None:
    points = np.array([[1.0, 0, 0], [1, 2, 0], [0, 5, 0]])
    places = np.repeat(np.eye(4)[None], 3, axis=0)
    places[:, :3, 3] = points
    datum = pp.Datum.three_points("a", "b", "c")
    assert isinstance(datum, ThreePoints)
    # x along +y of the base, y along -x, z up
    assert_allclose(datum.frames(places)["frame"][:3], [[0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 0]], atol=1e-12)


def test_frames_of_cameras() -> None:
    camera, board, place = np.eye(4), np.eye(4), np.eye(4)
    camera[:3, 3], board[:3, 3], place[:3, 3] = [0, 0, 1], [2, 0, 0], [0, 3, 0]
    settings = {"camera": camera, "board": board, "grasp": np.eye(4), "on": "tool", "noise": (1e-3, 1e-3)}
    places = np.repeat(place[None], 4, axis=0)
    hand_eye = pp.Datum.hand_eye(["a", "b", "c"], "v", **settings)
    assert_allclose(hand_eye.frames(places)["board"], board)
    assert_allclose(hand_eye.frames(places)["camera at view 1"][:3, 3], [0, 3, 1])
    fixed = pp.Datum.eye_to_hand(["a", "b", "c"], **settings).frames(places[:3])
    assert_allclose(fixed["camera"], camera)
    assert_allclose(fixed["board at the first pose"][:3, 3], [2, 3, 0])


@pytest.mark.parametrize("kind", ["exact", "linear"])
def test_sliders_follow_errors_against_the_datum(model: pp.ErrorModel, kind: str) -> None:
    at = model.against(taught()).at(TASK)
    middle, slopes = tangent_of(at, kind)
    errors, step = getattr(at, kind), 1e-5
    mean = at.space.mean[:, None]
    assert_allclose(middle, errors(mean)[:, 0], atol=1e-15)
    expected = (errors(mean + step * np.eye(len(mean))) - errors(mean - step * np.eye(len(mean)))) / (2 * step)
    assert_allclose(slopes, expected, atol=1e-8)
