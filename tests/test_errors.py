"""Findings, the exception tree, and the nearest valid names."""

import pickle

import pytest

from precision_pin.base import errors
from precision_pin.base.errors import Finding, InputError, SheetError, UnitError, UnknownNameError, nearest


@pytest.mark.parametrize(
    ("finding", "text"),
    [
        (Finding("error", "E_X", "no good", "a.yaml", 3), "a.yaml:3: error E_X: no good"),
        (Finding("warning", "W_X", "odd", "a.yaml"), "a.yaml: warning W_X: odd"),
        (Finding("error", "E_X", "no good"), "precision-pin: error E_X: no good"),
        (Finding("error", "E_X", "no good", line=1), "precision-pin:1: error E_X: no good"),
    ],
)
def test_a_finding_prints_as_the_contract_says(finding: Finding, text: str) -> None:
    assert str(finding) == text


def test_at_places_a_finding_only_where_it_has_no_place() -> None:
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


def test_a_message_becomes_one_finding_with_the_code_of_its_class() -> None:
    (finding,) = UnitError("no unit").findings
    assert (finding.severity, finding.code, finding.message) == ("error", "E_UNIT", "no unit")


def test_findings_are_kept_in_order_and_printed_one_a_line() -> None:
    found = [Finding("error", "E_A", "a", "f", 1), Finding("warning", "W_B", "b", "f", 2)]
    error = SheetError(found)
    assert error.findings == tuple(found)
    assert str(error).splitlines() == ["f:1: error E_A: a", "f:2: warning W_B: b"]


@pytest.mark.parametrize("error", [InputError("no"), SheetError([Finding("error", "E", "m", "f", 1)])])
def test_errors_survive_the_way_to_another_process(error: InputError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert again.findings == error.findings


def test_an_unknown_name_survives_the_way_to_another_process() -> None:
    error = UnknownNameError("joint", "jont1", ["joint1", "joint2"])
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is UnknownNameError
    assert (again.name, str(again)) == (error.name, str(error))


@pytest.mark.parametrize(
    ("name", "valid", "expected"),
    [
        ("jont1", ["joint1", "elbow"], "did you mean 'joint1'?"),
        ("TOOL", ["tool", "base"], "did you mean 'tool'?"),
        ("x", [], "there are none"),
        ("zzz", ["b", "a", "a"], "valid: a, b"),
    ],
)
def test_nearest(name: str, valid: list[str], expected: str) -> None:
    assert nearest(name, valid) == expected


def test_a_long_list_of_names_is_cut_and_counted() -> None:
    message = nearest("qqq", [f"name{k:02}" for k in range(40)])
    assert message.startswith("valid: name00, ")
    assert message.endswith(", … (40 in all)")
    assert message.count("name") == 12


def test_unknown_name_says_what_was_looked_for() -> None:
    error = UnknownNameError("pose", "papr", {"paper": 1, "folded": 2})
    assert str(error) == "precision-pin: error E_NAME: no pose named 'papr'; did you mean 'paper'?"
    assert error.name == "papr"
