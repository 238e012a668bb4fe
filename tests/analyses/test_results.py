"""Common interface of the analyses: arguments, provenance, tables and files of all results."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import precision_pin as pp
from precision_pin.analyses.budget.budget_result import BudgetResult
from precision_pin.analyses.result import Result
from precision_pin.base.errors import Finding
from precision_pin.render.result_io import JsonResult
from precision_pin.robot.examples import PAPER_SHEET

MODEL = pp.ErrorModel.load(PAPER_SHEET)
pytestmark = pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")

KNOWN = (Finding("warning", "W_TRIED", "one that is handed over", "arm.yaml", 3),)
OUTSIDE = [0.1, 0.2, 0.3, 9.0]
CALLS: dict[str, Callable[..., Any]] = {
    "analysis": lambda **k: pp.monte_carlo(MODEL, samples=1000, **k),
    "budget": lambda **k: pp.budget(MODEL, samples=1024, **k),
    "worst-case": lambda **k: pp.worst_case(MODEL, samples=1000, **k),
    "exact-law": lambda **k: pp.exact_law(MODEL, samples=500, **k),
    "reliability": lambda **k: pp.reliability(MODEL, "60 mm @ 99 %", samples=1000, **k),
    "moments": lambda **k: pp.moments(MODEL, samples=1024, **k),
}
FUNCTIONS = (pp.monte_carlo, pp.budget, pp.worst_case, pp.exact_law, pp.reliability, pp.moments)


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    found = {name: call(pose="paper", seed=3, findings=KNOWN) for name, call in CALLS.items()}
    return found | {"poses": pp.sample_poses(MODEL, ["paper", "paper"], samples=500, seed=3, findings=KNOWN)}


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
def test_all_analyses_have_the_common_arguments(function: Callable[..., Any]) -> None:
    known = inspect.signature(function).parameters
    assert next(iter(known)) == "error_model"
    assert {"pose", "q", "seed", "samples", "confidence", "findings", "progress"} <= set(known)
    with pytest.raises(pp.InputError, match="mean the same"):
        function(*([MODEL, "1 mm"] if function is pp.reliability else [MODEL]), pose="paper", q="paper")


def test_every_json_has_the_same_surroundings(results: dict[str, Any]) -> None:
    for name, result in results.items():
        data = json.loads(result.to_json())
        assert data["schema"] == f"precision-pin/{name}/1" == type(result).schema
        assert {"complete", "robot", "base", "tip", "seed", "versions", "statics", "warnings", "findings"} <= set(data)
        assert data["seed"] == 3
        assert data["findings"] == [
            {"severity": "warning", "code": "W_TRIED", "message": KNOWN[0].message, "file": "arm.yaml", "line": 3}
        ]
        assert data["warnings"][0] == str(KNOWN[0])


@pytest.mark.slow
def test_warnings_of_a_pose_stand_at_the_top_too() -> None:
    for name in ("budget", "moments", "worst-case", "exact-law"):
        result = CALLS[name](pose=OUTSIDE, findings=KNOWN)
        assert isinstance(result, Result)
        assert result.warnings == (str(KNOWN[0]), *result.new_warnings)
        assert name == "exact-law" or any("W_LIMIT" in line or "limit" in line for line in result.new_warnings), name


def test_what_is_saved_is_read_again(results: dict[str, Any], tmp_path: Path) -> None:
    for name, result in results.items():
        file = tmp_path / f"{name}.json"
        result.save(file)
        assert file.read_text(encoding="utf-8") == result.to_json() + "\n"
        for kind in (type(result), JsonResult):
            again = kind.load(file)
            assert again.to_json() == result.to_json()
            assert again["seed"] == 3
            assert "3" in repr(again)
            assert name in again._repr_html_()
        assert sorted(tmp_path.iterdir()) == [file]
        file.unlink()


def test_numbers_of_a_saved_result_are_a_table(results: dict[str, Any], tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    results["worst-case"].save(tmp_path / "w.json")
    saved = type(results["worst-case"]).load(tmp_path / "w.json")
    frame = saved.to_pandas()
    assert frame.loc[("paper", "position.seen.max"), "value"] == results["worst-case"].poses[0].position.seen.max
    assert (
        float(saved.to_xarray()["value"].sel(pose="paper", entry="nominal.position.1"))
        == saved["poses"][0]["nominal"]["position"][1]
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "cannot read"),
        ("{", "is no JSON"),
        ('{"schema": "precision-pin/budget/1", "a": NaN}', "is no JSON"),
        ("[" * 100_000, "is no JSON"),
        ("[1]", "without a schema"),
        ('{"schema": "precision-pin/moments/1"}', "precision-pin/budget/1 is expected"),
    ],
)
def test_a_file_that_is_no_such_result_is_refused(text: str | None, said: str, tmp_path: Path) -> None:
    file = tmp_path / "budget.json"
    if text is not None:
        file.write_text(text)
    with pytest.raises(pp.InputError, match=said) as refused:
        BudgetResult.load(file)
    assert "\n" not in str(refused.value)


def test_a_result_that_cannot_be_written_leaves_nothing(results: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(pp.InputError, match="cannot write"):
        results["moments"].save(tmp_path / "no" / "m.json")
    (tmp_path / "folder").mkdir()
    with pytest.raises(pp.InputError, match="cannot write"):
        results["moments"].save(tmp_path / "folder")
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_every_result_is_a_frame_a_dataset_and_a_view(results: dict[str, Any]) -> None:
    pytest.importorskip("xarray")
    for name, result in results.items():
        frame = result.to_pandas()
        assert len(frame)
        assert frame.attrs["seed"] == 3, name
        assert result.to_xarray().sizes
        assert "4dof.urdf" in result._repr_html_()
