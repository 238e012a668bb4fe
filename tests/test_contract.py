"""The names and formats that users rely on: public names, findings, the Python and the sheet of the contract."""

import importlib
import inspect
import itertools
import json
import pickle
import pkgutil
import re
import subprocess
import sys

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base import errors
from precision_pin.base.errors import Finding, InputError, SheetError, UnitError, UnknownNameError, nearest
from precision_pin.robot.examples import PAPER_SHEET

SNIPPET = """
import precision_pin as pp
chain = pp.Chain.from_urdf("4dof.urdf", tip="tool", base=None, gravity=(0, 0, -9.81), locked=None)
posture = chain.at(q)
pose = posture.pose
torque = posture.load_torque
mcpc = pp.mcpc.from_chain(chain)
errors = pp.mcpc.parameter_errors(mcpc, displacements, chart="complete")
back = pp.mcpc.frame_displacements(mcpc, errors)
model = pp.ErrorModel.load("4dof.errors.yaml")
at = model.at(q)
result = pp.monte_carlo(model, q, samples=10_000, seed=0, model="exact", keep_samples=False)
quantile = result.position.norm.quantile(0.9973)
covariance = result.covariance
dataset = result.to_xarray()
text = result.to_json()
"""


# names ---------------------------------------------------------------------------------------------------------------


def test_every_public_name_is_there_and_says_what_it_is():
    for name in pp.__all__:
        thing = getattr(pp, name)
        assert name in dir(pp)
        assert inspect.getdoc(thing), name
        assert re.search(rf"\b{name}\b", pp.__doc__), name  # in a group of help(pp)
        if inspect.isclass(thing):
            members = [member for key, member in vars(thing).items() if not key.startswith("_") and callable(member)]
            assert all(inspect.getdoc(member) for member in members), name
    with pytest.raises(AttributeError, match="has no attribute 'montecarlo'"):
        pp.montecarlo  # noqa: B018


def test_importing_the_package_imports_nothing_heavy():
    code = "import sys, precision_pin; print(*{name.split('.')[0] for name in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert not {"numpy", "pinocchio", "scipy", "numba", "matplotlib"} & set(done.stdout.split())


def test_every_module_exports_what_it_says():
    for found in pkgutil.walk_packages(pp.__path__, "precision_pin."):
        if not found.name.endswith("__main__"):
            module = importlib.import_module(found.name)
            assert all(hasattr(module, public) for public in getattr(module, "__all__", ())), found.name


def test_signatures():
    for function, expected in (
        (pp.Chain.from_urdf, {"tip": None, "base": None, "gravity": (0, 0, -9.81), "locked": None}),
        (pp.monte_carlo, {"samples": 100_000, "seed": 0, "model": "exact", "keep_samples": False}),
        (pp.mcpc.parameter_errors, {"chart": "complete"}),
    ):
        given = inspect.signature(function).parameters
        assert {name: given[name].default for name in expected} == expected
    assert list(inspect.signature(pp.ErrorModel).parameters)[:3] == ["chain", "space", "sources"]


# the contract's Python -----------------------------------------------------------------------------------------------


def test_the_snippet_of_the_contract(monkeypatch):
    monkeypatch.chdir(PAPER_SHEET.parent)
    q = np.radians([-90.0, 3.0, 88.0, -91.0])
    displacements = np.random.default_rng(1).normal(scale=1e-3, size=(5, 6))
    names = {"q": q, "displacements": displacements}
    exec(compile(SNIPPET, "contract", "exec"), names)

    # the tip by hand, from Table 1: the arm stands in the plane of joint 1 at -90°, folded by 3°, 91° and 0°
    reach = 1.97 * np.cos(np.radians(3)) + 1.77 * np.cos(np.radians(91))
    height = 0.085 - 1.97 * np.sin(np.radians(3)) - 1.77 * np.sin(np.radians(91))
    assert names["pose"].shape == (4, 4)
    side = names["pose"][:3, 2] * -0.274  # along joint 4's axis
    np.testing.assert_allclose(names["pose"][:3, 3] - side, [0.0, -reach, height], atol=1e-12)
    # joint 4's axis is horizontal and square to the arm's plane
    np.testing.assert_allclose(np.abs(names["pose"][:3, 2]), [1, 0, 0], atol=1e-12)

    # what the weights put on joint 2: forces times horizontal arms (kg, m, 9.81 m/s²); joint 1 is upright
    elbow = 1.97 * np.cos(np.radians(3))
    weights = 1.4 * elbow / 2 + 1.4 * (elbow + 1.77 * np.cos(np.radians(91)) / 2) + 3.3 * reach
    assert names["torque"].shape == (4,)
    assert names["torque"][:2] == pytest.approx([0.0, 9.81 * weights], rel=1e-12, abs=1e-12)

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
    e0, jacobian = at.tangent
    shapes = [made.shape for made in (x, at.linear(x), at.exact(x), e0, jacobian)]
    assert shapes == [(d, 7), (6, 7), (6, 7), (6,), (6, d)]
    np.testing.assert_array_equal(at.jacobian, jacobian)
    assert all(isinstance(term, pp.Term) for term in at.terms)

    result = names["result"]
    assert result.errors is None
    assert names["quantile"] == result.to_dict()["position"]["norm"]["quantiles"]["0.9973"]
    assert names["covariance"].shape == (6, 6)
    assert json.loads(names["text"]) == result.to_dict()
    np.testing.assert_array_equal(names["dataset"]["covariance"], names["covariance"])


def test_the_dataset_holds_what_the_json_does():
    model = pp.ErrorModel.load(PAPER_SHEET)
    result = pp.monte_carlo(model, samples=2000, seed=3, keep_samples=True)
    data, dataset = result.to_dict(), result.to_xarray()

    def assert_same(held, value):
        np.testing.assert_array_equal(held, np.array(value, dtype=float) if value is not None else np.nan)

    for vector, part in itertools.product(("position", "attitude"), ("norm", "x", "y", "z")):
        entry, here = data[vector][part], dataset.sel(quantity=f"{vector}.{part}")
        for name in ("mean", "std", "min", "max", "mode", "mean_interval", "std_interval", "mode_interval"):
            assert_same(here[name], entry[name])
        for content, bounds in entry["tolerance_bounds"].items():
            assert_same(here["tolerance_bounds"].sel(content=float(content)), bounds)
        for level, value in entry["quantiles"].items():
            cell = here.sel(probability=float(level))
            assert_same(cell["quantile_interval"], entry["quantile_interval"][level])
            assert_same(cell["quantile"], value)
    assert dataset["error"].shape == (6, 2000)
    assert_same(dataset["error"].sel(component="rz"), result.errors[5])
    assert_same(dataset["nominal"], [*data["nominal"]["position"], *data["nominal"]["attitude"]])
    for name in ("covariance", "covariance_interval"):
        assert_same(dataset[name], data[name])
    assert dataset.attrs["tip"] == "tool"
    assert all(isinstance(value, str) for value in dataset.attrs.values())  # what a netCDF file can hold
    dataset = pp.monte_carlo(model, samples=1).to_xarray()
    for name in ("std", "covariance", "quantile"):
        assert np.isnan(dataset[name]).all()
    assert not np.isnan(dataset["mean"]).any()
    assert "error" not in dataset


# the contract's sheet ------------------------------------------------------------------------------------------------


def test_a_finding_prints_as_the_contract_says_and_is_placed_only_where_it_has_no_place():
    for finding, text in (
        (Finding("error", "E_X", "no good", "a.yaml", 3), "a.yaml:3: error E_X: no good"),
        (Finding("warning", "W_X", "odd", "a.yaml"), "a.yaml: warning W_X: odd"),
        (Finding("error", "E_X", "no good"), "precision-pin: error E_X: no good"),
        (Finding("error", "E_X", "no good", line=1), "precision-pin:1: error E_X: no good"),
    ):
        assert str(finding) == text
    assert Finding("error", "E", "m").at("f", 2) == Finding("error", "E", "m", "f", 2)
    assert Finding("error", "E", "m", "own", 9).at("f", 2) == Finding("error", "E", "m", "own", 9)
    # the line is one of the file f
    assert Finding("error", "E", "m", "own").at("f", 2) == Finding("error", "E", "m", "own")
    assert Finding("error", "E", "m", "f").at("f", 2) == Finding("error", "E", "m", "f", 2)


def test_every_input_error_is_one_of_ours_and_internal_errors_are_not_input_errors():
    for kind in (errors.UrdfError, SheetError, UnitError, UnknownNameError, errors.OutputError):
        assert issubclass(kind, InputError)
    assert issubclass(InputError, errors.PrecisionPinError)
    assert issubclass(errors.InternalError, errors.PrecisionPinError)
    assert not issubclass(errors.InternalError, InputError)
    assert issubclass(errors.PrecisionPinWarning, UserWarning)


def test_findings_are_kept_in_order_printed_one_a_line_and_survive_the_way_to_another_process():
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


def test_nearest_names_and_a_long_list_is_cut_and_counted():
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
