"""A source has one home: a new one is one file that goes through sheet, sampling, report and export, and nothing else names it.

One file reads the settings of sources, and each has its words.
"""

from __future__ import annotations

import ast
import json
import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import precision_pin as pp
from precision_pin import ErrorModel, InputError, Space, Uniform, sources
from precision_pin.base import units
from precision_pin.cli import main
from precision_pin.pages.report.page import parameters
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sources import catalogue
from support.package_code import FILES, PACKAGE

CODE = """
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from precision_pin.draws.laws import Uniform
from precision_pin.terms import Draw, Setting, Source, Term, units


@dataclass(frozen=True, kw_only=True)
class Rail:
    sag: Annotated[Setting, units.LENGTH]


@dataclass(frozen=True, kw_only=True)
class Sagging(Source):
    link: str
    rails: tuple[Rail, ...]
    depends_on = "chain"

    def own_draws(self, label):
        return (Draw(f"{label}.tilt", Uniform(1e-4), quantities=(units.ANGLE,)),)

    def terms(self, posture, space):
        place = posture.chain.end(posture.chain.link_frame(self.link).link)
        for k, rail in enumerate(self.rails):
            yield Term.of(place, [0, 0, -1.0, 0, 0, 0], space.value(f"rails[{k}].sag", rail.sag))
        yield Term.of(place, np.eye(6)[3], space.component("tilt"))
"""
"""Guides that sag: a link's end moves down by the sags of its rails, and tilts by a side that is random."""
SHEET = f"""precision-pin: 1
robot: {PAPER_SHEET.parent / "4dof.urdf"}
tip: tool
poses: {{paper: -90 3 88 -91 deg}}
parameters:
  left: {{uniform: 0.1 mm, mean: 0.3 mm}}
  idle: {{uniform: 0.2 kg}}
sources:
  - sagging: {{link: link2, rails: [{{sag: left}}, {{sag: ±0.05 mm}}]}}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    home = tmp_path / "more_sources"
    home.mkdir()
    (home / "sagging.py").write_text(CODE, encoding="utf-8")
    monkeypatch.setattr(sources, "__path__", [*sources.__path__, str(home)])
    sources.catalogue.cache_clear()
    (tmp_path / "arm.errors.yaml").write_text(SHEET, encoding="utf-8")
    yield tmp_path
    sources.catalogue.cache_clear()
    sys.modules.pop("precision_pin.sources.sagging", None)
    vars(sources).pop("sagging", None)


@pytest.fixture
def run(folder, monkeypatch, capsys):
    def call(*words: str) -> str:
        monkeypatch.chdir(folder)
        monkeypatch.setattr(sys, "argv", ["precision-pin", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        assert ended.value.code == 0, err
        return out

    return call


def test_a_new_source_takes_one_file(folder, run):
    assert len(list((folder / "more_sources").glob("*.py"))) == 1
    assert "sagging" in sources.catalogue()
    properties = json.loads(run("schema"))["$defs"]["sagging"]["properties"]
    assert set(properties) == {"link", "rails", "assumed", "provenance"}
    assert json.loads(run("check", "arm.errors.yaml", "--json")) == {"errors": [], "warnings": []}


def test_its_numbers_are_known_by_owner_and_quantity(folder):
    model = ErrorModel.load(folder / "arm.errors.yaml")
    names = [draw.name for draw in model.space.draws]
    assert dict(zip(names, model.owners, strict=True)) == {
        "left": ("sagging[link2]",),
        "idle": (),
        "sagging[link2].rails[1].sag": ("sagging[link2]",),
        "sagging[link2].tilt": ("sagging[link2]",),
    }
    # by the setting, by the unit in the sheet, by the setting of a part, and as the source says
    quantities = [draw.quantities for draw in model.space.draws]
    assert quantities == [(units.LENGTH,), (units.MASS,), (units.LENGTH,), (units.ANGLE,)]


def test_through_sampling_budget_and_export(folder, run):
    found = json.loads(run("analyze", "arm.errors.yaml", "--samples", "4000", "--json", "-"))
    # link 2 turns rigidly: its end goes down its own z by the sum of sags, 0.3 mm on the mean, with these spreads
    model = ErrorModel.load(folder / "arm.errors.yaml")
    at = model.at("paper")
    z = at.posture.place_pose(at.posture.chain.end(2))[:3, 2]
    np.testing.assert_allclose(at.error_at_means[:3], -0.3e-3 * z, atol=1e-15)
    sags = np.outer(z, z) * (0.1e-3**2 + 0.05e-3**2) / 3
    way = at.posture.pose[:3, 3] - at.posture.place_pose(at.posture.chain.end(2))[:3, 3]
    x = at.posture.place_pose(at.posture.chain.end(2))[:3, 0]
    tilts = np.outer(np.cross(x, way), np.cross(x, way)) * 1e-4**2 / 3
    np.testing.assert_allclose(at.covariance[:3, :3], sags + tilts, atol=1e-20)
    np.testing.assert_allclose(
        np.sqrt(np.diag(found["covariance"])[:3]), np.sqrt(np.diag(sags + tilts)), rtol=0.1, atol=1e-9
    )
    shares = json.loads(run("budget", "arm.errors.yaml", "--samples", "1024", "--json", "-"))["poses"][0]["sources"]
    (own,) = (line for line in shares if line["sources"] == ["sagging[link2]"])
    assert own["draws"] == ["left", "sagging[link2].rails[1].sag", "sagging[link2].tilt"]
    assert own["share"]["position"] == pytest.approx(1.0)
    run("export", "arm.errors.yaml", "--units", "1", "--out", "units")
    (urdf,) = (folder / "units").glob("*.urdf")
    assert "No source was seen to depend on the pose." in " ".join(urdf.read_text(encoding="utf-8").split())


def test_into_the_report(folder):
    page = str(parameters([SimpleNamespace(model=ErrorModel.load(folder / "arm.errors.yaml"))]))
    for name, quantity in (("left", "length"), ("sagging[link2].tilt", "angle")):
        (row,) = (row for row in page.split("<tr>") if f'data-label="name">{name}<' in row)
        assert f">{quantity}<" in row


def test_a_source_whose_types_no_module_knows_is_sampled_and_named_where_they_are_needed(monkeypatch):
    module = ModuleType("nowhere")
    with monkeypatch.context() as while_made:
        while_made.setitem(sys.modules, "nowhere", module)
        exec(compile(CODE, "nowhere.py", "exec"), vars(module))
    names = vars(module)
    chain = ErrorModel.load(PAPER_SHEET).chain
    source = names["Sagging"](link="link2", rails=(names["Rail"](sag=Uniform(1e-4)),))
    model = ErrorModel(chain, Space(), [source])
    assert model.at(np.zeros(4)).covariance.any()
    assert [draw.quantities for draw in model.space.draws] == [(), (units.ANGLE,)]
    with pytest.raises(InputError, match=r"nowhere\.(Sagging|Rail): the types of its settings cannot be found"):
        _ = model.owners


# --- who names sources ---


ABOVE = ("sheet", "model", "export", "kernel", "sampling", "analyses", "pages", "cli")
"""What may know sources at all; the folders below cannot."""
HOMES = ("sources/", "export/scaffold.py", "model/error_model.py", "sheet/measurement.py")
"""Where kinds of sources may be named: the others are models made of them, and the load of a measurement, a payload."""
TEXTS = {path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8") for path in FILES}
OUTSIDE = [name for name in TEXTS if name.startswith(ABOVE) and not name.startswith(HOMES)]
KINDS = catalogue()
CATALOGUE = {f"from precision_pin.sources import catalogue{ending}" for ending in ("", " as catalogue")}
OTHERS = {"covariance", "frame", "length", "mcpc", "table"}
"""Kinds that are keys of results and tables too, with classes whose names other things have too."""


def named(code: str) -> set[str]:
    """Return the kinds and classes of sources that a file names outside comments and docstrings."""
    long = {kind.__name__ for name, kind in KINDS.items() if name not in OTHERS} | {
        kind for kind in KINDS if "_" in kind
    }
    short, found = KINDS.keys() - OTHERS, set()
    if not set(re.findall(r"\w+", code)) & (long | short):
        return found
    nodes = list(ast.walk(ast.parse(code)))
    docstrings = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    for node in nodes:
        for text in (
            value for _, value in ast.iter_fields(node) if isinstance(value, str) and id(node) not in docstrings
        ):
            found |= set(re.findall(r"\w+", text)) & long
            if isinstance(node, ast.Constant):
                # sentences may hold words of the field; what is one word, or begins a label, is a kind
                found |= {text, text.partition("[")[0]} & short
    return found


@pytest.mark.slow
def test_no_file_outside_its_home_names_a_source():
    assert len(OUTSIDE) > 100
    assert {name: kinds for name in OUTSIDE if (kinds := named(TEXTS[name]))} == {}
    imported = {name: re.findall(r"(?:from|import) precision_pin\.sources.*", TEXTS[name]) for name in OUTSIDE}
    assert {name: what for name, what in imported.items() if not set(what) <= CATALOGUE} == {}
    assert [name for name, code in TEXTS.items() if name.startswith("pages/") and "precision_pin.sources" in code] == []


@pytest.mark.parametrize(
    "line",
    [
        'KINDS = {"backlash": 1}',
        'isinstance(source, Backlash)',
        'text = f"encoder[{joint}]"',
        'text = "the joint_offset of it"',
        'if source.kind() == "thermal": pass',
    ],
)  # fmt: skip
def test_a_file_that_names_a_source_would_be_found(line):
    assert named(line)


def test_one_file_reflects_over_sources():
    knows = re.compile(r"(from|import) precision_pin\.(sources|terms)|import .*\b(Source|catalogue|Sheet)\b")
    reflects = r"get_type_hints|dataclasses\.fields|from dataclasses .*\bfields\b|__dataclass_fields__|__annotations__"
    knowing = [name for name, code in TEXTS.items() if name.startswith(("sources/", "terms/")) or knows.search(code)]
    assert len(knowing) > 30
    assert [name for name in knowing if re.search(reflects, TEXTS[name])] == ["terms/source.py"]
    assert [name for name, code in TEXTS.items() if "get_type_hints" in code] == ["terms/source.py"]


# --- words ---


WORDS = f"""precision-pin: 1
robot: {PAPER_SHEET.parent / "4dof.urdf"}
poses: {{home: 0 0 0 0 deg}}
parameters:
  a1: {{uniform: 0.05 mm}}
  a2: {{uniform: 0.02 mm}}
  k: {{normal: {{std: 10 arcsec}}}}
  t: {{normal: 0.01 deg}}
  t2: {{normal: 0.06 mm, k: 2}}
sources:
  - length: {{joint: joint2, parameters: a1}}
  - length: {{joint: joint4, parameters: [a2, a1, ±0.1 mm]}}
  - joint_offset: {{joint: joint1, offset: k}}
  - frame: {{joint: joint3, rz: ±0.02 deg, x: {{triangular: 4 um, mean: 2 um}}}}
  - axis_install: {{joint: joint1, radius: 0.1 mm, span: 100 mm}}
  - joint_offset: {{joint: joint2, offset: t}}
  - length: {{joint: joint3, parameters: t2}}
  - payload: {{at: tool, mass: 1 ± 0.05 kg}}
  - clearance: {{joint: joint2, diametral: 0.05 mm, span: 100 mm, direction: random}}
  - joint_offset: {{joint: joint4, offset: {{lognormal: {{std: 0.1 mrad}}, mean: 0.3 mrad}}}}
"""


def test_draws_are_named_as_a_reader_would(tmp_path) -> None:
    path = tmp_path / "words.errors.yaml"
    path.write_text(WORDS, encoding="utf-8")
    model = pp.ErrorModel.load(path)
    found = {
        draw.name: (words, draw.tolerance) for draw, words in zip(model.space.draws, model.draw_words, strict=True)
    }
    expected = {
        "a1": ("a1 (length to joint2 and 1 more)", "±0.05 mm"),
        "a2": ("a2 (length to joint4)", "±0.02 mm"),
        "length[joint4].parameters[2]": ("length to joint4 (3)", "±0.1 mm"),
        "k": ("k (zero of joint1)", "σ 10 arcsec"),
        # a half-width of three standard deviations, or of as many as the sheet says
        "t": ("t (zero of joint2)", "±0.01° (σ 0.0033°)"),
        "t2": ("t2 (length to joint3)", "±0.06 mm (σ 0.03 mm)"),
        "frame[joint3].rz": ("tilt of joint3 about z", "±0.02 deg"),
        "frame[joint3].x": ("position of joint3 along x", "±4 um"),
        "axis_install[joint1].A": ("axis of joint1, bearing A", "radius 0.1 mm"),
        "payload[tool].mass": ("payload mass at tool", "±0.05 kg"),
        # what is drawn is a direction; the clearance itself is one number
        "clearance[joint2].A": ("play in bearing A of joint2", ""),
        "joint_offset[joint4].offset": ("zero of joint4", "σ 0.1 mrad"),
    }
    assert expected.items() <= found.items()


def test_words_are_of_settings_that_there_are() -> None:
    own = {
        "A",
        "B",
        "side",
        "phase",
        "quantisation",
        "row",
        "error",
        "height",
        "across",
        "approach",
        "radial_phase",
        "axial_phase",
        "tilt_phase",
        *(f"{name}_phase" for name in ("EXX", "EYX", "EZX", "EAX", "EBX", "ECX")),
    }
    for kind in KINDS.values():
        assert set(kind.words) <= {*kind.__dataclass_fields__, *own}
        assert all(text.format(subject="joint1", at="tool") for text in kind.words.values())
