"""A new source is one file: in the folder of sources, it goes through sheet, sampling, analyses, report and export."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from precision_pin import sources
from precision_pin.base import units
from precision_pin.base.errors import InputError
from precision_pin.cli import main
from precision_pin.draws.laws import Uniform
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import PAPER_SHEET

FILES_NEEDED = 1
CODE = '''"""Guides that sag."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, final

import numpy as np

from precision_pin.base import units
from precision_pin.draws.laws import Uniform
from precision_pin.draws.draw import Draw, Setting
from precision_pin.draws.space import LabelledSpace
from precision_pin.robot.chain import Posture
from precision_pin.terms.source import Dependence, Source
from precision_pin.terms.term import Term

__all__ = ["Sagging"]


@final
@dataclass(frozen=True, kw_only=True)
class Rail:
    """A rail of the guide.

    Attributes
    ----------
    sag
        How far down it is.
    """

    sag: Annotated[Setting, units.LENGTH]


@final
@dataclass(frozen=True, kw_only=True)
class Sagging(Source):
    """Guides that sag: a link's end moves down by the sags of its rails, and tilts by a side that is random.

    Attributes
    ----------
    link
        Whose end.
    rails
        Its rails.
    """

    link: str
    rails: tuple[Rail, ...]

    @property
    def subject(self) -> str:
        """The link."""
        return self.link

    @property
    def depends_on(self) -> Dependence:
        """The chain."""
        return "chain"

    def own_draws(self, label: str) -> tuple[Draw, ...]:
        """Return the tilt."""
        return (Draw(f"{label}.tilt", Uniform(1e-4), quantities=(units.ANGLE,)),)

    def terms(self, posture: Posture, space: LabelledSpace) -> Iterator[Term]:
        """Yield a term for each rail, and the tilt."""
        place = posture.chain.end(posture.chain.link_frame(self.link).link)
        for k, rail in enumerate(self.rails):
            yield Term.of(place, [0, 0, -1.0, 0, 0, 0], space.value(f"rails[{k}].sag", rail.sag))
        yield Term.of(place, np.eye(6)[3], space.component("tilt"))
'''
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
    assert len(list((folder / "more_sources").glob("*.py"))) == FILES_NEEDED
    assert "sagging" in sources.catalogue()
    assert set(json.loads(run("schema"))["$defs"]["sagging"]["properties"]) == {
        "link",
        "rails",
        "assumed",
        "provenance",
    }
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
    assert [draw.quantities for draw in model.space.draws] == [
        (units.LENGTH,),
        (units.MASS,),
        (units.LENGTH,),
        (units.ANGLE,),
    ]


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


@pytest.mark.slow
def test_into_the_report(folder, run):
    run("report", "arm.errors.yaml", "--samples", "2000", "--out", "report.html")
    page = (folder / "report.html").read_text(encoding="utf-8").partition("Random numbers of the model")[2]
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
