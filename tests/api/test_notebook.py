"""A model from the name of a robot, its draws and sources by name, poses of a model, and samples with their inputs."""

import pickle
import shutil

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import precision_pin as pp
from precision_pin.base import arguments
from precision_pin.robot.examples import PAPER_SHEET, shipped_sheets
from support.refusals import check_refused

MODEL = pp.ErrorModel.load(PAPER_SHEET)
WITH_VISITS = pp.ErrorModel(
    MODEL.chain,
    MODEL.space.including([pp.Draw("again", pp.Normal(1e-4), pp.Scope.VISIT)]),
    [*MODEL.sources, pp.sources.JointOffset(joint="joint1", offset="again")],
    MODEL.poses,
)


@pytest.mark.slow
def test_a_shipped_robot_comes_with_its_sheet(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sheets = shipped_sheets()
    for name in ("4dof", "ur5e"):
        loaded, read = pp.ErrorModel.load(f"example:{name}"), pp.ErrorModel.load(sheets[name])
        assert loaded.sheet.file == str(sheets[name])
        assert loaded.space == read.space
        assert_array_equal([*loaded.poses.values()], [*read.poses.values()])


@pytest.mark.slow
def test_a_robot_comes_with_the_sheet_that_the_command_line_takes(tmp_path, monkeypatch):
    """The one beside it, else that of its name in the working folder, before the shipped one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arms").mkdir()
    shutil.copy(MODEL.chain.robot.file, tmp_path / "arms" / "4dof.urdf")
    check_refused(("no sheet of error sources for arms/4dof.urdf; write one", pp.ErrorModel.load, "arms/4dof.urdf"))
    text = PAPER_SHEET.read_text(encoding="utf-8")
    for folder, name in ((".", "here"), ("arms", "beside")):
        (tmp_path / folder / "4dof.errors.yaml").write_text(text.replace("paper:", f"{name}:"), encoding="utf-8")
        assert [*pp.ErrorModel.load("arms/4dof.urdf").poses] == [name]
        assert [*pp.ErrorModel.load("example:4dof").poses] == ["here"]


def test_an_unknown_robot_is_refused_in_one_line():
    for name in ("example:ur5ee", "example:", "nosuch.urdf"):
        with pytest.raises(pp.PrecisionPinError, match=r"no example robot named|there is no file") as refused:
            pp.ErrorModel.load(name)
        assert "\n" not in str(refused.value)


def test_draws_by_name_have_law_scope_and_owners():
    draws = WITH_VISITS.draws
    assert tuple(draws) == tuple(draw.name for draw in WITH_VISITS.space.draws)
    assert draws["again"].law == pp.Normal(1e-4)
    assert (draws["again"].scope, draws["again"].owners) == (pp.Scope.VISIT, ("joint_offset[joint1]",))
    # in the sheet, a1 is a parameter of two lengths
    assert draws["a1"].owners == ("length[joint2]", "length[tool]")
    assert ("a11" in draws, draws.get("a11")) == (False, None)
    with pytest.raises(pp.InputError, match="no draw named 'a11'; did you mean 'a1'"):
        draws["a11"]
    (line,) = [line for line in repr(draws).splitlines() if line.startswith("again ")]
    assert line.split()[1:] == ["Normal(std=0.0001,", "mean=0.0)", "visit", "joint_offset[joint1]"]
    assert "<td" in draws._repr_html_()


def test_sources_are_a_sequence_and_found_by_label():
    sources = MODEL.sources
    assert [sources[label] for label in MODEL.labels] == [*sources] == [sources[k] for k in range(len(sources))]
    assert all(label.startswith(sources[label].kind()) for label in MODEL.labels)
    assert sources[1:3] == (sources[1], sources[2])
    with pytest.raises(pp.InputError, match=r"no source named 'payload'; did you mean 'payload\[tool\]'"):
        sources["payload"]
    assert sources._ipython_key_completions_() == list(MODEL.labels)
    again = pickle.loads(pickle.dumps(sources))
    assert (again, again["payload[tool]"]) == (sources, sources["payload[tool]"])


@pytest.mark.slow
def test_what_takes_a_chain_takes_a_model(tmp_path):
    data = {
        "precision-pin": 1, "robot": MODEL.chain.robot.file, "tip": "tool", "poses": {"zero": "0 0 0 0 deg"},
        "sources": [{"joint_offset": {"joint": "joint1", "offset": "±1 mrad"}}],
        "keep_out": [{"box": "4 4 1 m", "at": "2.5 0 0 m"}],
    }  # fmt: skip
    model = pp.ErrorModel.from_dict(data)
    chain, free = model.chain, pp.Orientation.free()
    (tmp_path / "way.csv").write_text(",".join(chain.joint_names) + "\n0,0,0,0\n")
    calls = {
        "random_poses": lambda arm: pp.random_poses(arm, 20, seed=2).q,
        "joint_grid": lambda arm: pp.joint_grid(arm, {name: [0.0, 1.0] for name in chain.joint_names}).q,
        "place_grid": lambda arm: pp.place_grid(arm, (0.6, 0, 0.9), free).q,
        "inverse_kinematics": lambda arm: pp.inverse_kinematics(arm, chain.at([0.1] * 4).pose, task="position").q,
        "read_trajectory": lambda arm: pp.read_trajectory(tmp_path / "way.csv", arm).poses.q,
        "every_frame": lambda arm: pp.every_frame(arm).space.covariance,
    }
    for name, call in calls.items():
        assert_array_equal(call(model), call(chain), name)
    # the sheet's rules: nothing is drawn with its tip in the box
    poses = pp.random_poses(model, 20, seed=2)
    is_inside = (np.abs(poses.position - np.array([[2.5], [0], [0]])) < np.array([[2], [2], [0.5]])).all(axis=0)
    assert poses.left_out
    assert not is_inside.any()
    check_refused(("chain must be of type Chain .* or an error model", pp.random_poses, "arm.urdf", 2))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["exact", "linear"])
def test_samples_stand_beside_their_inputs(kind, monkeypatch):
    result = pp.monte_carlo(WITH_VISITS, samples=2000, seed=7, model=kind, keep_samples=True)
    frame = result.samples_to_pandas(inputs=True)
    components, errors = [*WITH_VISITS.space.components], ["dx", "dy", "dz", "rx", "ry", "rz"]
    assert [*frame.columns] == [*components, *errors, "position.norm", "attitude.norm"]
    # outputs are the errors of the inputs, evaluated apart from the sampler
    at = WITH_VISITS.at()
    expected = (at.exact if kind == "exact" else at.linear)(frame[components].to_numpy().T)
    assert_allclose(frame[errors].to_numpy().T, expected, rtol=0, atol=1e-12)
    # and their statistics the result's
    assert_allclose(frame[errors].mean(), result.summary.mean, rtol=1e-9, atol=1e-15)
    assert_allclose(frame[errors].cov(), result.covariance, rtol=1e-9, atol=1e-18)
    for vector in (result.position, result.attitude):
        norm = frame["position.norm" if vector is result.position else "attitude.norm"]
        assert (norm.mean(), norm.max()) == pytest.approx((vector.norm.mean, vector.norm.max), rel=1e-12)
        assert norm.quantile(0.95) == pytest.approx(vector.norm.quantile(0.95), rel=5e-3)
    monkeypatch.setattr(arguments, "available_memory", lambda: 10**5)
    monkeypatch.setattr(arguments, "_UNCHECKED", 0)
    with pytest.raises(pp.InputError, match=r"a frame of 2,000 samples with 27 inputs takes .* GB"):
        result.samples_to_pandas(inputs=True)
