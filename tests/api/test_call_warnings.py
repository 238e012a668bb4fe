"""Python's warnings of what stretches an assumption: once a call, at the caller's line, and none from the command line."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_array_equal

import precision_pin as pp
from api.api_calls import model
from precision_pin.base.errors import Finding, PrecisionPinWarning
from precision_pin.cli.program import cli
from precision_pin.robot.examples import PAPER_SHEET, resolve_robot
from precision_pin.sheet import read

ARM = pp.ErrorModel(
    pp.Chain.from_urdf(model().chain.robot.file, model().chain.tip, gravity=(0, 0, 0)),
    model().space,
    [source for source in model().sources if source.kind() == "length"],
)
SOFT = pp.ErrorModel(ARM.chain, pp.Space(), [pp.sources.JointCompliance(joint="joint1", compliance=1e-6)])
INSIDE = [0.1, 0.2, 0.3, 0.4]
OUTSIDE = [0.1, 0.2, 9.0, 0.4]
SAMPLED = {"samples": 1024}


def told(call):
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        call()
    return [one for one in seen if issubclass(one.category, PrecisionPinWarning)]


CALLS = {
    "ErrorModel.at": lambda q: ARM.at(q),
    "ErrorModel.at_many": lambda q: ARM.at_many([q]),
    "monte_carlo": lambda q: pp.monte_carlo(ARM, q, **SAMPLED),
    "monte_carlo linear": lambda q: pp.monte_carlo(ARM, q, model="linear", **SAMPLED),
    "sample_poses": lambda q: pp.sample_poses(ARM, [q], **SAMPLED),
    "moments": lambda q: pp.moments(ARM, q, **SAMPLED),
    "budget": lambda q: pp.budget(ARM, q, **SAMPLED),
    "worst_case": lambda q: pp.worst_case(ARM, q, **SAMPLED),
    "exact_law": lambda q: pp.exact_law(ARM, q, **SAMPLED),
    "stiffness": lambda q: pp.stiffness(SOFT, q, robots=2),
    "reliability": lambda q: pp.reliability(ARM, "200 mm", q, **SAMPLED),
}


@pytest.mark.fast(3)
@pytest.mark.parametrize("name", CALLS)
def test_limits_are_warned_of_once_at_the_callers_line(name):
    seen = [one for one in told(lambda: CALLS[name](OUTSIDE)) if "W_JOINT_LIMIT" in str(one.message)]
    assert len(seen) == 1
    assert "joint3" in str(seen[0].message)
    assert Path(seen[0].filename) == Path(__file__)
    assert [one for one in told(lambda: CALLS[name](INSIDE)) if "use analyze" not in str(one.message)] == []


@pytest.mark.slow
def test_a_sheet_that_is_loaded_tells_its_findings_once_at_the_callers_line(tmp_path):
    assert told(lambda: pp.ErrorModel.load(PAPER_SHEET)) == []
    sheet = tmp_path / "arm.yaml"
    text = PAPER_SHEET.read_text().replace("robot: 4dof.urdf", f"robot: {model().chain.robot.file}")
    sheet.write_text(text.replace("poses:\n  paper: -90 3 88 -91 deg\n", ""))
    seen = told(lambda: pp.ErrorModel.load(sheet))
    assert [str(one.message) for one in seen] == [str(finding) for finding in read(sheet).findings]
    assert len(seen) == 1
    assert "W_NO_POSES" in str(seen[0].message)
    assert Path(seen[0].filename) == Path(__file__)


def test_the_result_holds_what_was_warned_of():
    with pytest.warns(PrecisionPinWarning, match="W_JOINT_LIMIT"):
        result = pp.monte_carlo(ARM, OUTSIDE, **SAMPLED)
    assert [line for line in result.warnings if "W_JOINT_LIMIT" in line]
    with pytest.warns(PrecisionPinWarning, match="1 of 2 poses are outside joint limits, the first of them pose 2"):
        poses = pp.sample_poses(ARM, [INSIDE, OUTSIDE], **SAMPLED)
    assert len(poses.warnings) == 1


def test_findings_that_were_handed_in_are_not_told_again():
    finding, found = Finding("warning", "W_ELSEWHERE", "known already"), []
    assert told(lambda: found.append(pp.monte_carlo(ARM, INSIDE, findings=[finding], **SAMPLED))) == []
    assert str(finding) in found[0].warnings


@pytest.mark.slow
def test_the_command_line_tells_by_its_findings_alone():
    found = []
    words = ["analyze", "--q", "0 0 300 0 deg", "--samples", "1000"]
    assert told(lambda: found.append(CliRunner().invoke(cli, words))) == []
    assert (found[0].exit_code, found[0].stderr.count("W_JOINT_LIMIT")) == (0, 1)


def test_a_square_array_of_poses_is_doubted_unless_the_limits_tell():
    inside = np.full((4, 4), 0.1)
    for call in (ARM.chain.at_many, lambda q: list(ARM.at_many(q)), lambda q: pp.sample_poses(ARM, q, samples=64)):
        assert ["W_SQUARE_POSES" in str(one.message) for one in told(lambda: call(inside))] == [True]  # noqa: B023
        assert told(lambda: call(list(inside.T))) == []  # noqa: B023
        assert told(lambda: call(inside[:, :3])) == []  # noqa: B023


def test_limits_tell_rows_from_columns():
    """The elbow alone is limited to half a turn, the other joints to a whole one."""
    chain = pp.Chain.from_urdf(resolve_robot("example:ur5"), tip="tool0")
    columns = np.zeros((6, 6))
    columns[0] = 4.0  # the first joint at every pose; of rows, every joint of the first pose
    assert told(lambda: chain.at_many(columns)) == []
    (warning,) = told(lambda: chain.at_many(columns.T))
    assert "as rows they would be within the joint limits" in str(warning.message)


@pytest.mark.parametrize("count", [3, 5])
def test_poses_in_rows_are_refused_with_a_hint(count):
    with pytest.raises(pp.InputError, match="poses are columns, so transpose it"):
        ARM.chain.at_many(np.zeros((count, 4)))
    with pytest.raises(pp.InputError, match=r"pose 0 of the list: .* 4 joints"):
        ARM.chain.at_many(np.zeros((4, count)).tolist())


def test_a_list_of_poses_may_mix_names_and_values():
    arm = pp.ErrorModel(ARM.chain, ARM.space, ARM.sources, {"home": INSIDE})
    named = dict(zip(ARM.chain.joint_names, INSIDE, strict=True))
    result = pp.sample_poses(arm, ["home", INSIDE, named], samples=64)
    assert result.names == ("home", "", "")
    assert_array_equal(result.q, np.tile(np.array(INSIDE)[:, None], 3))
    with pytest.raises(pp.InputError, match="no pose named 'house'; did you mean 'home'"):
        pp.sample_poses(arm, ["home", "house"])


@pytest.mark.slow
def test_texts_and_lists_are_taken_where_specifications_are():
    one = pp.specification("1 mm @ 99 %")
    for given in ("1 mm @ 99 %", ["1 mm @ 99 %"], ("1 mm @ 99 %",), one, [one]):
        assert pp.monte_carlo(ARM, INSIDE, specifications=given, samples=64).summary.specifications[0].limit == 1e-3
        assert pp.sample_poses(ARM, [INSIDE], specifications=given, samples=64).specifications == (one,)
    result = pp.reliability(ARM, "9 mm @ 99 %", poses=INSIDE, **SAMPLED)
    assert result.poses[0].pose.q == dict(zip(ARM.chain.joint_names, INSIDE, strict=True))
