"""The names and formats that users rely on: public names, findings, the Python and the sheet of the contract."""

from __future__ import annotations

import importlib
import inspect
import json
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base import errors
from precision_pin.base.errors import Finding, InputError, SheetError, UnitError, UnknownNameError, nearest
from precision_pin.robot.examples import PAPER_SHEET

SNIPPET = """
import precision_pin as pp
chain = pp.Chain.from_urdf("arm.urdf", tip="tool0", base=None, gravity=(0, 0, -9.81), locked=None)
posture = chain.at(q)
pose = posture.pose
torque = posture.load_torque
mcpc = pp.mcpc.from_chain(chain)
errors = pp.mcpc.parameter_errors(mcpc, displacements, chart="complete")
back = pp.mcpc.frame_displacements(mcpc, errors)
model = pp.ErrorModel.load("sheet.yaml")
at = model.at(q)
result = pp.monte_carlo(model, q, samples=100_000, seed=0, model="exact", keep_samples=False)
quantile = result.position.norm.quantile(0.9973)
covariance = result.covariance
dataset = result.to_xarray()
text = result.to_json()
"""


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make the working folder: arm.urdf with the tip tool0, and sheet.yaml, from the paper's files."""
    for name, target in (("4dof.urdf", "arm.urdf"), ("4dof.errors.yaml", "sheet.yaml")):
        text = (PAPER_SHEET.parent / name).read_text(encoding="utf-8")
        text = text.replace('"tool"', '"tool0"').replace("tip: tool", "tip: tool0").replace("at: tool", "at: tool0")
        text = text.replace("frame: tool", "frame: tool0").replace("4dof.urdf", "arm.urdf")
        (tmp_path / target).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


# names ---------------------------------------------------------------------------------------------------------------


def test_every_public_name_is_there_and_says_what_it_is():
    for name in ("Chain", "ErrorModel", "monte_carlo", "mcpc"):
        assert name in pp.__all__, name
    for name in ("from_chain", "parameter_errors", "frame_displacements"):
        assert callable(getattr(pp.mcpc, name)), name
    for name in pp.__all__:
        thing = getattr(pp, name)
        assert name in dir(pp)
        assert inspect.getdoc(thing), name
        if inspect.isclass(thing):
            members = [member for key, member in vars(thing).items() if not key.startswith("_") and callable(member)]
            assert all(inspect.getdoc(member) for member in members), name


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'montecarlo'"):
        pp.montecarlo  # noqa: B018


def test_importing_the_package_imports_nothing_heavy():
    code = "import sys, precision_pin; print(*{name.split('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert not {"numpy", "pinocchio", "scipy", "numba", "matplotlib"} & set(done.stdout.split())


def test_every_module_exports_what_it_says():
    root = Path(pp.__file__).parent
    for path in sorted(root.rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        name = ".".join(("precision_pin", *(part for part in parts if part != "__init__")))
        if name.endswith("__main__"):
            continue
        module = importlib.import_module(name)
        for public in getattr(module, "__all__", ()):
            assert hasattr(module, public), f"{name}.{public}"


def parameters(function: Callable[..., Any]) -> dict[str, Any]:
    return {name: entry.default for name, entry in inspect.signature(function).parameters.items()}


def test_signatures():
    empty = inspect.Parameter.empty
    given = parameters(pp.Chain.from_urdf)
    assert list(given) == ["path", "tip", "base", "gravity", "locked"]
    assert given == {"path": empty, "tip": None, "base": None, "gravity": (0, 0, -9.81), "locked": None}
    given = parameters(pp.monte_carlo)
    assert list(given)[:2] == ["error_model", "q"]
    assert given.items() >= {"samples": 100_000, "seed": 0, "model": "exact", "keep_samples": False}.items()
    assert parameters(pp.mcpc.parameter_errors)["chart"] == "complete"
    given = parameters(pp.ErrorModel)
    assert list(given)[:3] == ["chain", "space", "sources"]
    assert [given[name] for name in ("chain", "space", "sources")] == [empty] * 3


# the contract's Python -----------------------------------------------------------------------------------------------


def test_the_snippet_of_the_contract(arm):
    q = np.radians([-90.0, 3.0, 88.0, -91.0])
    displacements = np.random.default_rng(1).normal(scale=1e-3, size=(5, 6))
    names: dict[str, Any] = {"q": q, "displacements": displacements}
    exec(compile(SNIPPET, "contract", "exec"), names)

    # the tip by hand, from Table 1: the arm stands in the plane of joint 1 at -90°, folded by 3°, 91° and 0°
    reach = 1.97 * np.cos(np.radians(3)) + 1.77 * np.cos(np.radians(91))
    height = 0.085 - 1.97 * np.sin(np.radians(3)) - 1.77 * np.sin(np.radians(91))
    assert names["pose"].shape == (4, 4)
    tip = [0.0, -reach, height]
    side = names["pose"][:3, 2] * -0.274  # along joint 4's axis
    np.testing.assert_allclose(names["pose"][:3, 3], tip + side, atol=1e-12)
    # joint 4's axis is horizontal and square to the arm's plane
    np.testing.assert_allclose(np.abs(names["pose"][:3, 2]), [1, 0, 0], atol=1e-12)

    # what the weights put on joint 2: forces times horizontal arms (kg, m, 9.81 m/s²); joint 1 is upright
    elbow = 1.97 * np.cos(np.radians(3))
    weights = 1.4 * elbow / 2 + 1.4 * (elbow + 1.77 * np.cos(np.radians(91)) / 2) + 3.3 * reach
    assert names["torque"].shape == (4,)
    assert names["torque"][0] == pytest.approx(0.0, abs=1e-12)
    assert names["torque"][1] == pytest.approx(9.81 * weights, rel=1e-12)

    n = 4
    assert names["errors"].shape == (5 * n + 6,)
    assert len(names["mcpc"].table) == n + 1
    assert names["mcpc"].forward_kinematics(q) == pytest.approx(names["pose"], abs=1e-12)
    assert names["mcpc"].jacobian(q).shape == names["mcpc"].jacobian_base(q).shape == (6, 5 * n + 6)
    assert names["back"].shape == (n + 1, 4, 4)
    again = pp.mcpc.parameter_errors(names["mcpc"], names["back"])
    np.testing.assert_allclose(again, names["errors"], atol=1e-12)

    at = names["at"]
    d = names["model"].space.size
    x = names["model"].space.sample(0, 0, 7)
    assert x.shape == (d, 7)
    assert at.linear(x).shape == at.exact(x).shape == (6, 7)
    e0, jacobian = at.tangent
    assert e0.shape == (6,)
    assert jacobian.shape == (6, d)
    np.testing.assert_array_equal(at.jacobian, jacobian)
    assert all(isinstance(term, pp.Term) for term in at.terms)

    result = names["result"]
    assert result.errors is None
    assert names["quantile"] == result.to_dict()["position"]["norm"]["quantiles"]["0.9973"]
    assert names["covariance"].shape == (6, 6)
    assert json.loads(names["text"]) == result.to_dict()
    np.testing.assert_array_equal(names["dataset"]["covariance"], names["covariance"])


def test_joint_values_by_name_and_in_chain_order(arm):
    chain = pp.Chain.from_urdf("arm.urdf")
    q = [0.1, 0.2, 0.3, 0.4]
    named = {f"joint{k}": value for k, value in reversed(list(enumerate(q, start=1)))}
    np.testing.assert_array_equal(chain.at(named).pose, chain.at(q).pose)
    model = pp.ErrorModel.load("sheet.yaml")
    results = [pp.monte_carlo(model, where, samples=100, seed=3).to_json() for where in (q, tuple(q), named)]
    assert results[0] == results[1] == results[2]


def test_the_dataset_holds_what_the_json_does(arm, tmp_path):
    model = pp.ErrorModel.load("sheet.yaml")
    result = pp.monte_carlo(model, samples=2000, seed=3, keep_samples=True)
    data, dataset = result.to_dict(), result.to_xarray()
    for vector in ("position", "attitude"):
        for part in ("norm", "x", "y", "z"):
            entry, here = data[vector][part], dataset.sel(quantity=f"{vector}.{part}")
            for name in ("mean", "std", "min", "max", "mode"):
                np.testing.assert_array_equal(here[name], np.nan if entry[name] is None else entry[name])
            for name in ("mean_interval", "std_interval", "mode_interval"):
                np.testing.assert_array_equal(here[name], entry[name] or [np.nan, np.nan])
            for content, bounds in entry["tolerance_bounds"].items():
                np.testing.assert_array_equal(
                    here["tolerance_bounds"].sel(content=float(content)), bounds or [np.nan, np.nan]
                )
            for level, value in entry["quantiles"].items():
                cell = here.sel(probability=float(level))
                ends = entry["quantile_interval"][level] or [np.nan, np.nan]
                np.testing.assert_array_equal(cell["quantile_interval"], ends)
                np.testing.assert_array_equal(cell["quantile"], np.nan if value is None else value)
    assert dataset["error"].shape == (6, 2000)
    np.testing.assert_array_equal(dataset["error"].sel(component="rz"), result.errors[5])
    np.testing.assert_array_equal(dataset["nominal"], [*data["nominal"]["position"], *data["nominal"]["attitude"]])
    np.testing.assert_array_equal(dataset["covariance"], data["covariance"])
    np.testing.assert_array_equal(dataset["covariance_interval"], data["covariance_interval"])
    assert dataset.attrs["tip"] == "tool0"
    assert all(isinstance(value, str) for value in dataset.attrs.values())  # what a netCDF file can hold
    dataset = pp.monte_carlo(model, samples=1).to_xarray()
    for name in ("std", "covariance", "quantile"):
        assert np.isnan(dataset[name]).all()
    assert not np.isnan(dataset["mean"]).any()
    assert "error" not in dataset


def test_wrong_arguments_in_python(arm):
    model = pp.ErrorModel.load("sheet.yaml")
    for settings, message in (
        ({"samples": 0}, "from 1 to"),
        ({"samples": 1.5}, "whole number"),
        ({"samples": True}, "whole number"),
        ({"seed": -1}, "from 0 to"),
        ({"seed": 0.0}, "whole number"),
        ({"model": "quadratic"}, "exact or linear"),
        ({"confidence": 95}, "above 0 and below 1"),
        ({"q": [0, 0, 0]}, "3 joint values for 4 joints"),
        ({"q": {"joint1": 0}}, "joint2, joint3, joint4"),
        ({"q": {"joint9": 0}}, "no joint on the chain named 'joint9'"),
        ({"q": "nosuch"}, "no pose named 'nosuch'"),
        ({"q": [0, 0, 0, np.nan]}, "finite"),
    ):
        with pytest.raises(pp.InputError, match=message):
            pp.monte_carlo(model, **{"q": None, **settings})


# the contract's sheet ------------------------------------------------------------------------------------------------

SHEET = """\
precision-pin: 1
robot: 4dof.urdf                    # paths are relative to the sheet
tip: tool
gravity: 0 0 -9.81 m/s^2            # base axes; or earth, moon, none
statics: nominal
locked: {finger: 0.04 m}            # joints off the chain
poses:
  paper: -90 3 88 -91 deg           # chain order
  folded: {joint1: 0 deg, joint2: 10 deg, joint3: 90 deg, joint4: 0 deg}
parameters:
  a1: {uniform: 0.05 mm}
  tool_mass: {normal: 0.06 kg, mean: 1 kg, scope: visit}
sources:
  - payload: {at: tool, mass: tool_mass, com: 0 0 0 mm}
  - length: {joint: joint2, along: z of joint1, parameters: [a0, a1]}
  - length: {frame: tool, along: -z of joint4, parameters: [a1, a3, a5]}
  - axis_install: {joint: joint2, radius: 0.1 mm, span: 100 mm}
  - beam: {link: link2, EI: 8000 N*m^2, GI: 4000 N*m^2}
  - joint_compliance: {joint: joint2, compliance: {uniform: 1e-6 rad/(N*m), mean: 1e-5 rad/(N*m)}}
"""
FINGER = """
  <link name="finger_tip"/>
  <joint name="finger" type="prismatic"><parent link="link4"/><child link="finger_tip"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.05" effort="10" velocity="1"/></joint>
</robot>"""


def test_the_sheet_of_the_contract_runs_unchanged(tmp_path):
    robot = shutil.copy(PAPER_SHEET.parent / "4dof.urdf", tmp_path)
    Path(robot).write_text(Path(robot).read_text("utf-8").replace("</robot>", FINGER), "utf-8")
    # a0, a3, a5 are used there and stand nowhere: defined here as a1 is
    text = SHEET.replace(
        "  a1: {", "".join(f"  {name}: {{uniform: 0.05 mm}}\n" for name in ("a0", "a3", "a5")) + "  a1: {"
    )
    (tmp_path / "sheet.yaml").write_text(text, "utf-8")
    model = pp.ErrorModel.load(tmp_path / "sheet.yaml")
    assert list(model.poses) == ["paper", "folded"]
    np.testing.assert_allclose(model.poses["folded"], np.radians([0, 10, 90, 0]), rtol=1e-15)
    assert model.chain.locked == {"finger": 0.04}
    mass = next(draw for draw in model.space.draws if draw.name == "tool_mass")
    assert mass.scope is pp.Scope.VISIT
    assert mass.law == pp.Normal(0.02, mean=1.0)  # ± 0.06 kg is three standard deviations
    result = pp.monte_carlo(model, "folded", samples=1000)
    assert result.position.norm.mean > 0
    assert result.scopes["visit"] == 1


def test_a_finding_prints_as_the_contract_says_and_is_placed_only_where_it_has_no_place() -> None:
    for finding, text in (
        (Finding("error", "E_X", "no good", "a.yaml", 3), "a.yaml:3: error E_X: no good"),
        (Finding("warning", "W_X", "odd", "a.yaml"), "a.yaml: warning W_X: odd"),
        (Finding("error", "E_X", "no good"), "precision-pin: error E_X: no good"),
        (Finding("error", "E_X", "no good", line=1), "precision-pin:1: error E_X: no good"),
    ):
        assert str(finding) == text
    assert Finding("error", "E", "m").at("f", 2) == Finding("error", "E", "m", "f", 2)
    assert Finding("error", "E", "m", "own", 9).at("f", 2) == Finding("error", "E", "m", "own", 9)
    assert Finding("error", "E", "m", "own").at("f", 2) == Finding("error", "E", "m", "own", 2)


def test_every_input_error_is_one_of_ours_and_internal_errors_are_not_input_errors() -> None:
    for name in ("UrdfError", "SheetError", "UnitError", "UnknownNameError", "OutputError"):
        assert issubclass(getattr(errors, name), InputError)
    assert issubclass(InputError, errors.PrecisionPinError)
    assert issubclass(errors.InternalError, errors.PrecisionPinError)
    assert not issubclass(errors.InternalError, InputError)
    assert issubclass(errors.PrecisionPinWarning, UserWarning)


def test_findings_are_kept_in_order_printed_one_a_line_and_survive_the_way_to_another_process() -> None:
    (finding,) = UnitError("no unit").findings
    assert (finding.severity, finding.code, finding.message) == ("error", "E_UNIT", "no unit")
    found = [Finding("error", "E_A", "a", "f", 1), Finding("warning", "W_B", "b", "f", 2)]
    assert SheetError(found).findings == tuple(found)
    assert str(SheetError(found)).splitlines() == ["f:1: error E_A: a", "f:2: warning W_B: b"]
    unknown = UnknownNameError("pose", "papr", {"paper": 1, "folded": 2})
    assert str(unknown) == "precision-pin: error E_NAME: no pose named 'papr'; did you mean 'paper'?"
    for error in (InputError("no"), SheetError(found), unknown):
        again = pickle.loads(pickle.dumps(error))
        assert (type(again), str(again), again.findings) == (type(error), str(error), error.findings)
    assert pickle.loads(pickle.dumps(unknown)).name == unknown.name == "papr"


def test_nearest_names_and_a_long_list_is_cut_and_counted() -> None:
    for name, valid, expected in (
        ("jont1", ["joint1", "elbow"], "did you mean 'joint1'?"),
        ("TOOL", ["tool", "base"], "did you mean 'tool'?"),
        ("x", [], "there are none"),
        ("zzz", ["b", "a", "a"], "valid: a, b"),
    ):
        assert nearest(name, valid) == expected
    message = nearest("qqq", [f"name{k:02}" for k in range(40)])
    assert message.startswith("valid: name00, ")
    assert message.endswith(", … (40 in all)")
    assert message.count("name") == 12
