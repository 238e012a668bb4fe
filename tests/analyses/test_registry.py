"""Registration of an analysis by its folder and one line: an added one is found by all parts of the package."""

import json
import runpy
from pathlib import Path

import pytest
from click.testing import CliRunner

import precision_pin as pp
from outputs.report_cases import Reader, results_of
from precision_pin.analyses import registry
from precision_pin.analyses.declaration import load
from precision_pin.analyses.result import Result
from precision_pin.cli.program import cli, list_commands
from precision_pin.pages.report.page import page
from precision_pin.robot.examples import PAPER_SHEET

FOLDER = {
    "__init__.py": """
from precision_pin.analyses.declaration import AT_POSES, Declaration, Option

DECLARATION = Declaration(
    name="offset",
    function=f"{__name__}.offset:offset",
    result=f"{__name__}.offset:OffsetResult",
    title="Offset",
    heading="Offset at the means",
    summary="Error with every parameter at its mean.",
    description="Show the error with every parameter at its mean.",
    options=(*AT_POSES, Option("--level", "confidence", "Of its intervals.", float, 0.95),),
)
""",
    "offset.py": """
from dataclasses import dataclass, fields
from typing import ClassVar

from precision_pin.analyses.moments.moments import MomentsResult, moments


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class OffsetResult(MomentsResult):
    schema: ClassVar[str] = "precision-pin/offset/1"


def offset(model, poses=None, **settings):
    found = moments(model, poses, method="closed", **settings)
    return OffsetResult(**{field.name: getattr(found, field.name) for field in fields(found)})
""",
    "table.py": """
def table(result):
    return "\\n".join(f"{1e3 * one.mean.value[0]:.4f} mm at {result.confidence}" for one in result.poses)
""",
    "figure.py": """
from precision_pin.analyses.moments.figure import figure
from precision_pin.render.html import paragraph


def content(result, results):
    return [paragraph(f"dx at the means is {1e3 * result.poses[0].mean.value[0]:.4f} mm")]
""",
}


MODEL = pp.ErrorModel.load(PAPER_SHEET)


OFFSET = pp.moments(MODEL, method="closed").poses[0].mean.value


@pytest.mark.slow
def test_an_added_analysis_is_found_everywhere(tmp_path, monkeypatch):
    # its folder, and one line
    (tmp_path / "offset_analysis").mkdir()
    for name, text in FOLDER.items():
        (tmp_path / "offset_analysis" / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "FOLDERS", [*registry.FOLDERS, "offset_analysis"])
    monkeypatch.chdir(tmp_path)
    # Python
    result = pp.offset(MODEL, poses="paper", confidence=0.9)
    assert (type(result).__name__, result.confidence) == ("OffsetResult", 0.9)
    assert (result.poses[0].mean.value == OFFSET).all()
    # a file
    result.save("offset.saved.json")
    assert type(result).load("offset.saved.json").to_json() == result.to_json()
    # the command line
    runner = CliRunner()
    assert "Error with every parameter at its mean." in runner.invoke(cli, ["--help"]).output
    assert "Of its intervals.  [default: 0.95]" in runner.invoke(cli, ["offset", "--help"]).output
    told = runner.invoke(cli, ["offset", "--level", "0.9", "--out", "made", "--json", "offset.json"])
    assert (told.exit_code, told.stdout.strip()) == (0, f"{1e3 * OFFSET[0]:.4f} mm at 0.9")
    assert sorted(path.name for path in Path("made").iterdir()) == ["offset.json", "offset.png", "offset.svg"]
    assert json.loads(Path("offset.json").read_text())["poses"] == json.loads(result.to_json())["poses"]
    # the documentation
    made = runpy.run_path(str(Path(__file__).parent.parent.parent / "docs" / "generate.py"))
    assert "`--level FLOAT`" in made["parameters"]("offset").replace("float", "FLOAT")
    assert "Error with every parameter at its mean." in made["commands"]()
    # the report, without the other analyses and the pictures of the sampling, which take seconds
    monkeypatch.setattr(registry, "FOLDERS", ["offset_analysis"])
    monkeypatch.setattr("precision_pin.pages.report.page.distributions", lambda _: "")
    reader = Reader(page(results_of(PAPER_SHEET)))
    assert (2, "Offset at the means") in reader.headings
    assert f"dx at the means is {1e3 * OFFSET[0]:.4f} mm" in reader.text


def test_an_analysis_that_draws_nothing_has_no_seed(tmp_path, monkeypatch):
    """Without the shared option ``seed`` its function takes none, and its result has none."""
    (tmp_path / "still_analysis").mkdir()
    texts = {name: text.replace("offset", "still").replace("Offset", "Still") for name, text in FOLDER.items()}
    texts["__init__.py"] = texts["__init__.py"].replace("*AT_POSES", '*(one for one in AT_POSES if one != "seed")')
    texts["still.py"] = texts.pop("offset.py").replace(
        "fields(found)})", "fields(found)} | {'provenance': Provenance.of(model)})"
    )
    texts["still.py"] = (
        texts["still.py"]
        .replace("**settings):", "*, findings, progress, **settings):")
        .replace("from dataclasses", "from precision_pin.analyses.provenance import Provenance\nfrom dataclasses")
    )
    for name, text in texts.items():
        (tmp_path / "still_analysis" / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "FOLDERS", [*registry.FOLDERS, "still_analysis"])
    monkeypatch.chdir(tmp_path)
    told = CliRunner().invoke(cli, ["still", "--json", "still.json"], catch_exceptions=False)
    assert (told.exit_code, told.stdout.strip()) == (0, f"{1e3 * OFFSET[0]:.4f} mm at 0.95")
    assert json.loads(Path("still.json").read_text())["seed"] is None
    refused = CliRunner().invoke(cli, ["still", "--seed", "1"])
    assert refused.exit_code == 2


@pytest.mark.parametrize("name", registry.declarations())
def test_a_declaration_names_what_there_is(name):
    one = registry.declarations()[name]
    assert getattr(pp, one.function.rpartition(":")[2]) is load(one.function)
    kind = load(one.result)
    assert kind.schema.startswith("precision-pin/")
    assert (one.prepare is None) == bool(one.heading) == issubclass(kind, Result)
    for place in ["figure:content", "figure:draw", "figure:figure"] * bool(one.heading):
        assert callable(load(f"{one.outputs}.{place}"))
    for place in (one.steps, *(option.check for option in one.own_options)):
        assert not place or callable(load(place))
    assert list_commands()[name] == one.summary
