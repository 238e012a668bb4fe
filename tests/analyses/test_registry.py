"""Registration of an analysis by its folder and one line: an added one is found by all parts of the package."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

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
    options=(*AT_POSES, Option("--factor", "factor", "Multiplies it.", float, 1.0),),
)
""",
    "offset.py": """
from dataclasses import dataclass
from typing import ClassVar

from precision_pin.analyses.provenance import PoseLabel, Provenance, listed_poses
from precision_pin.analyses.result import Result, list_warnings
from precision_pin.render.html import Table
from precision_pin.render.tables import data_frame


@dataclass(frozen=True)
class PoseOffset:
    pose: PoseLabel
    error: tuple[float, ...]

    def to_dict(self):
        return {"pose": self.pose.to_dict(), "error": list(self.error)}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class OffsetResult(Result):
    schema: ClassVar[str] = "precision-pin/offset/1"
    assumptions: ClassVar[tuple[str, ...]] = ("exact model",)

    def to_pandas(self):
        rows = [((name,), dict(enumerate(one.error))) for name, one in zip(self.labels, self.poses)]
        return data_frame(["pose"], rows, self.attributes())

    def _title(self):
        return "Offset"

    def _table(self, pose):
        return Table(("d",), [[str(value)] for value in pose.error])

    def _notes(self):
        return []


def offset(model, pose=None, *, factor=1.0, seed=0, findings=(), progress=None):
    found = []
    for one in listed_poses(pose):
        at = model.at(one)
        found.append(PoseOffset(PoseLabel.of(model, one, at), tuple((factor * at.error_at_means).tolist())))
    return OffsetResult(provenance=Provenance.of(model, seed), samples=0, confidence=0.95, poses=tuple(found),
                        findings=tuple(findings), warnings=list_warnings(findings, ()))
""",
    "table.py": """
def table(result):
    return "\\n".join(f"{1e3 * one.error[0]:.4f} mm" for one in result.poses)
""",
    "figure.py": """
from precision_pin.render.figure_style import DOUBLE_COLUMN, new_figure, style
from precision_pin.render.html import paragraph


def figure(result, which=0):
    with style():
        drawn = new_figure(DOUBLE_COLUMN)
        drawn.subplots().bar(range(6), result.poses[which].error)
    return drawn


def content(result, results):
    return [paragraph(f"dx at the means is {1e3 * result.poses[0].error[0]:.4f} mm")]
""",
}


MODEL = pp.ErrorModel.load(PAPER_SHEET)


OFFSET = MODEL.at().exact(MODEL.space.mean[:, None])[:, 0]


@pytest.fixture
def added(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Add the analysis ``offset``: its folder, and one line."""
    folder = tmp_path / "offset_analysis"
    folder.mkdir()
    for name, text in FOLDER.items():
        (folder / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "FOLDERS", [*registry.FOLDERS, "offset_analysis"])
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("added")
def test_an_added_analysis_is_found_everywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    # Python
    result = pp.offset(MODEL, pose="paper", factor=2.0)
    assert isinstance(result, Result)
    assert result.poses[0].error == pytest.approx(2 * OFFSET)
    assert len(result.to_pandas()) == 1
    # a file
    result.save("offset.saved.json")
    assert type(result).load("offset.saved.json").to_json() == result.to_json()
    # the command line
    runner = CliRunner()
    assert "Error with every parameter at its mean." in runner.invoke(cli, ["--help"]).output
    assert "Multiplies it.  [default: 1.0]" in runner.invoke(cli, ["offset", "--help"]).output
    told = runner.invoke(cli, ["offset", "--factor", "2", "--out", "made", "--json", "offset.json"])
    assert (told.exit_code, told.stdout.strip()) == (0, f"{2e3 * OFFSET[0]:.4f} mm")
    assert sorted(path.name for path in Path("made").iterdir()) == ["offset.json", "offset.png", "offset.svg"]
    assert json.loads(Path("offset.json").read_text())["poses"] == json.loads(result.to_json())["poses"]
    # the documentation
    assert "`--factor FLOAT`" in generator().parameters("offset").replace("float", "FLOAT")
    assert "Error with every parameter at its mean." in generator().commands()
    # the report, without the other analyses, which take seconds
    monkeypatch.setattr(registry, "FOLDERS", ["offset_analysis"])
    reader = Reader(page(results_of(PAPER_SHEET)))
    assert (2, "Offset at the means") in reader.headings
    assert f"dx at the means is {1e3 * OFFSET[0]:.4f} mm" in reader.text


def generator() -> ModuleType:
    """Return the program that makes the tables of the documentation."""
    file = Path(__file__).parent.parent.parent / "docs" / "generate.py"
    spec = importlib.util.spec_from_file_location("generate", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", registry.declarations())
def test_a_declaration_names_what_there_is(name: str) -> None:
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
