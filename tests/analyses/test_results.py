"""Common interface of the analyses: arguments, provenance, tables, files and progress of all results."""

import inspect
import json
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.analyses.budget.budget import evaluations
from precision_pin.analyses.budget.budget_result import BudgetResult
from precision_pin.analyses.exact_law import exact_law as exact_law_module
from precision_pin.analyses.result import Result
from precision_pin.base.errors import Finding
from precision_pin.render import figure_style
from precision_pin.render.columns import Column, frame_row, notebook_table, report_table, text_lines
from precision_pin.render.html import joined
from precision_pin.render.result_io import JsonResult
from precision_pin.robot.examples import PAPER_SHEET
from support.refusals import check_refused

MODEL = pp.ErrorModel.load(PAPER_SHEET)


pytestmark = pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")


KNOWN = (Finding("warning", "W_TRIED", "one that is handed over", "arm.yaml", 3),)


OUTSIDE = [0.1, 0.2, 0.3, 9.0]


CALLS = {
    "analysis": lambda poses, **k: pp.monte_carlo(MODEL, poses, samples=1000, **k),
    "budget": lambda **k: pp.budget(MODEL, samples=1024, **k),
    "worst-case": lambda **k: pp.worst_case(MODEL, samples=1000, **k),
    "exact-law": lambda **k: pp.exact_law(MODEL, samples=500, **k),
    "reliability": lambda **k: pp.reliability(MODEL, "60 mm @ 99 %", samples=1000, **k),
    "moments": lambda **k: pp.moments(MODEL, samples=1024, **k),
}


FUNCTIONS = (pp.budget, pp.worst_case, pp.exact_law, pp.reliability, pp.moments)


@pytest.fixture(scope="module")
def results():
    found = {name: call(poses="paper", seed=3, findings=KNOWN) for name, call in CALLS.items()}
    return found | {"poses": pp.sample_poses(MODEL, ["paper", "paper"], samples=500, seed=3, findings=KNOWN)}


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
def test_all_analyses_have_the_common_arguments(function):
    known = inspect.signature(function).parameters
    assert {"model", "poses", "seed", "samples", "confidence", "findings", "progress"} <= set(known)


def test_one_word_for_one_thing():
    """Names of arguments of all public functions; the error model is nameless where ``model`` is exact or linear."""
    known = {
        name: inspect.signature(value).parameters.values()
        for name in pp.__all__
        if inspect.isfunction(value := getattr(pp, name))
    }
    words = {argument.name for arguments in known.values() for argument in arguments}
    assert not words & {"error_models", "sample", "count_samples", "n", "seeds", "random_state", "level", "bound_at"}
    assert {name for name, arguments in known.items() if "q" in {a.name for a in arguments}} == {"monte_carlo"}
    for name, arguments in known.items():
        kinds = {argument.name: argument.kind for argument in arguments}
        if "error_model" in kinds:
            assert (kinds["error_model"], "model" in kinds) == (inspect.Parameter.POSITIONAL_ONLY, True), name
        assert not {"pose", "poses"} <= set(kinds), name


def test_every_json_has_the_same_surroundings(results):
    for name, result in results.items():
        data = json.loads(result.to_json())
        assert data["schema"] == f"precision-pin/{name}/1" == type(result).schema
        assert {"complete", "robot", "base", "tip", "seed", "versions", "statics", "warnings", "findings"} <= set(data)
        assert data["seed"] == 3
        told = {"severity": "warning", "code": "W_TRIED", "message": KNOWN[0].message, "file": "arm.yaml", "line": 3}
        assert data["findings"] == [told]
        assert data["warnings"][0] == str(KNOWN[0])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["budget", "moments", "worst-case"])
def test_warnings_of_a_pose_stand_at_the_top_too(name):
    result = CALLS[name](poses=OUTSIDE, findings=KNOWN)
    assert isinstance(result, Result)
    assert result.warnings == (str(KNOWN[0]), *result.new_warnings)
    assert any("W_LIMIT" in line or "limit" in line for line in result.new_warnings)


def test_every_result_is_a_frame_and_a_view_and_is_read_again_when_saved(results, tmp_path):
    pytest.importorskip("xarray")
    for name, result in results.items():
        file = tmp_path / f"{name}.json"
        frame = result.to_pandas()
        assert len(frame), name
        assert frame.attrs["seed"] == 3, name
        assert result.to_xarray().sizes
        assert "4dof.urdf" in result._repr_html_()
        result.save(file)
        assert file.read_text(encoding="utf-8") == result.to_json() + "\n"
        for kind in (type(result), JsonResult):
            again = kind.load(file)
            assert (again.to_json(), again["seed"]) == (result.to_json(), 3)
            assert "3" in repr(again)
            assert name in again._repr_html_()
        assert sorted(tmp_path.iterdir()) == [file]
        if name == "worst-case":
            # its numbers are a table
            seen, place = result.poses[0].position.seen.max, again["poses"][0]["nominal"]["position"][1]
            assert again.to_pandas().loc[("paper", "position.seen.max"), "value"] == seen
            assert float(again.to_xarray()["value"].sel(pose="paper", entry="nominal.position.1")) == place
        file.unlink()
    # what cannot be written leaves nothing
    (tmp_path / "folder").mkdir()
    for place in (tmp_path / "no" / "m.json", tmp_path / "folder"):
        with pytest.raises(pp.InputError, match="cannot write"):
            results["moments"].save(place)
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_a_file_that_is_no_such_result_is_refused(tmp_path):
    file = tmp_path / "budget.json"
    check_refused(("cannot read", BudgetResult.load, file))
    for text, said in (
        ("{", "is no JSON"),
        ('{"schema": "precision-pin/budget/1", "a": NaN}', "is no JSON"),
        ("[" * 100_000, "is no JSON"),
        ("[1]", "without a schema"),
        ('{"schema": "precision-pin/moments/1"}', "precision-pin/budget/1 is expected"),
    ):
        file.write_text(text)
        check_refused((rf"^[^\n]*{said}[^\n]*$", BudgetResult.load, file))


POSES = ["paper", [0.1, 0.2, 0.3, 0.4]]


STEPS = {
    "budget": (CALLS["budget"], evaluations(MODEL.space, 1024)),
    "exact_law": (lambda **k: pp.exact_law(MODEL, POSES, samples=500, **k), 3 * 500),
    "moments": (lambda **k: pp.moments(MODEL, POSES, samples=2048, **k), 2 * 2048),
    "closed moments": (lambda **k: pp.moments(MODEL, "paper", method="closed", **k), 0),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", STEPS)
def test_the_steps_are_as_many_as_the_bar_has(name, monkeypatch):
    call, total = STEPS[name]
    told = []
    call(progress=told.append)
    assert sum(told) == total
    bars = []
    shown = pp.progress

    def bar(total, **_):
        bars.append(total)
        return shown(total)

    monkeypatch.setattr("precision_pin.base.progress.progress", bar)
    call(progress=True)
    assert bars == [total]


def test_a_draw_that_does_not_vary_is_no_step():
    space = pp.Space((pp.Draw("a", pp.Uniform(1.0)), pp.Draw("b", pp.Fixed(1.0)), pp.Draw("c", pp.Normal(1.0))))
    # two sets, two exchanged for each draw that varies, one plain, one halved for each
    assert evaluations(space, 1024) == 1024 * (2 + 2 * 2 + 1 + 2)


def test_samples_of_the_exact_law_do_not_depend_on_how_many_are_drawn_at_once(monkeypatch):
    whole = exact_law_module._deviations(MODEL.space, 3, 5000, lambda _: None)
    np.testing.assert_array_equal(whole, MODEL.space.sample(3, 0, 5000) - MODEL.space.mean[:, None])
    monkeypatch.setattr(exact_law_module, "_AT_ONCE", 777)
    np.testing.assert_array_equal(exact_law_module._deviations(MODEL.space, 3, 5000, lambda _: None), whole)


@pytest.mark.parametrize("name", ["moments", "worst-case"])
def test_a_column_is_one_line(results, name, monkeypatch):
    """One more column stands in terminal, notebook, report and data frame, with its value of every row."""
    result = results[name]
    column = Column(
        lambda row: 1000.0 + len(row.quantity), "{:.2f}".format, "of text", "of notebook", "of report", "of_frame"
    )
    monkeypatch.setattr(type(result), "COLUMNS", (*type(result).COLUMNS, column))
    figure = import_module(f"precision_pin.analyses.{name.replace('-', '_')}.figure")
    for drawn in {"figure", "inline_figure"} & vars(figure).keys():
        monkeypatch.setattr(figure, drawn, lambda *_: "")
    monkeypatch.setattr(figure_style, "inline_figure", lambda *_: "")
    report = joined(figure.content(result, SimpleNamespace(prefix="", causes=()))).text
    components = [f"{1000 + len(f'{vector}.{axis}'):.2f}" for vector in ("position", "attitude") for axis in "xyz"]
    for text, heading in (
        (result.declaration.table(result), "of text"),
        (result._repr_html_(), "of notebook"),
        (report, "of report"),
    ):
        assert text.count(heading) >= 1
        for cell in components:
            assert text.count(cell) >= components.count(cell), heading
    frame = result.to_pandas()["of_frame"]
    assert frame.to_dict() == {(pose, quantity): 1000.0 + len(quantity) for pose, quantity in frame.index}


def test_what_a_column_lacks_is_written_as_missing_in_each_output():
    row = SimpleNamespace(name="one", part=None, pair=(1.5, None))
    columns = [
        Column("name", str.upper, text="", notebook="", report=""),
        Column("part.size", "{:.1f}".format, "size", "size", "size", "size", is_words=True),
        Column("pair", lambda pair: f"{pair[0]}", notebook="pair", frame="pair", has_interval=True),
    ]
    assert text_lines(columns, [row]) == ["     size", "ONE  -"]
    table = notebook_table(columns, [row], "above")
    assert (table.columns, table.rows, table.heading, table.words) == (
        ["", "size", "pair"],
        [["ONE", "-", "1.5"]],
        "above",
        2,
    )
    assert '<td data-label="size">–</td>' in report_table("Caption", columns, [row]).text
    found = frame_row(columns, row)
    assert list(found) == ["size", "pair", "pair_lower", "pair_upper"]
    assert np.isnan([found["size"], found["pair_lower"], found["pair_upper"]]).all()
    assert found["pair"] == 1.5
