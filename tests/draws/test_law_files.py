"""A law is one file: one added in a file of its own is known everywhere, and no other file names those there are."""

from __future__ import annotations

import ast
import importlib.util
import math
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

import precision_pin as pp
from precision_pin.base.units import LENGTH
from precision_pin.draws import laws
from precision_pin.draws.laws import LAWS, Law, laws_of_sheets
from precision_pin.kernel import sampler
from precision_pin.pages.report.parameters import parameters
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import json_schema
from precision_pin.sheet.settings import law_options, parse_law
from support.package_code import FILES, PACKAGE, tree

RESOLUTION = '''
"""What rounding to steps leaves."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from precision_pin.draws.laws.kernel_row import KernelRow
from precision_pin.draws.laws.law import Law, take_size
from precision_pin.draws.laws.projection import Lines
from precision_pin.draws.laws.sheet_form import LawOption, SheetForm
from precision_pin.draws.laws.wording import write_number


@final
@dataclass(frozen=True)
class Resolution(Law):
    """Anywhere within half a step of the middle of a step."""

    form: ClassVar = SheetForm(
        "resolution", {"resolution": "0.1 mm"}, "within half a step", (LawOption("steps", "how many steps", "2"),)
    )
    step: float

    def __post_init__(self):
        take_size(self, "step", "the step of a resolution law")

    @classmethod
    def from_sheet(cls, reader):
        steps = reader.ratio("steps") if "steps" in reader.settings else 1.0
        if steps < 1:
            raise reader.error(("steps",), "there is at least one step")
        return cls(reader.half_width("resolution") * steps)

    def describe(self, quantities):
        return f"rounded to {write_number(self.step, quantities[0])}"

    def sample(self, variates):
        return self.step * (variates - 0.5)

    @property
    def mean_vector(self):
        return np.zeros(1)

    @property
    def covariance(self):
        return np.array([[self.step**2 / 12]])

    def support(self, direction):
        return abs(float(np.asarray(direction)[0])) * self.step / 2

    def characteristic(self, frequency):
        return np.sinc(np.asarray(frequency)[0] * self.step / (2 * np.pi)).astype(complex)

    def projection(self, weights):
        half = abs(float(weights[0])) * self.step / 2
        return Lines(np.ones(1), np.array([-half]), np.array([half]))

    def kernel_row(self):
        return KernelRow("uniform", np.array([0.0, self.step / 2]))
'''

SHEET = """
precision-pin: 1
robot: {robot}
parameters:
  rounding: {{resolution: 0.1 mm, steps: 2}}
poses:
  p: -90 3 88 -91 deg
sources:
  - length: {{joint: joint3, along: x of joint2, parameters: rounding}}
"""
STEP = 0.2e-3
LEVELS = (0.025, 0.5, 0.975)


@pytest.fixture
def resolution(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> type[Law]:
    """Add a law: a file of its own, and its line in the list of laws in draws/laws/__init__.py; no other is needed."""
    file = tmp_path / "resolution.py"
    file.write_text(RESOLUTION, encoding="utf-8")
    spec = importlib.util.spec_from_file_location("resolution", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "resolution", module)
    spec.loader.exec_module(module)
    monkeypatch.setattr(laws, "LAWS", (*LAWS, module.Resolution))
    resolution: type[Law] = module.Resolution
    return resolution


@pytest.fixture
def model(resolution: type[Law], tmp_path: Path) -> pp.ErrorModel:
    sheet = tmp_path / "arm.errors.yaml"
    sheet.write_text(SHEET.format(robot=PAPER_SHEET.parent / "4dof.urdf"), encoding="utf-8")
    return pp.ErrorModel.load(sheet)


def test_a_law_of_its_own_file_is_read_from_a_sheet(resolution: type[Law], model: pp.ErrorModel) -> None:
    assert model.space.draws[0].law == resolution(STEP)  # type: ignore[call-arg]
    law = json_schema()["$defs"]["law"]
    assert law["properties"]["steps"] == {"description": "how many steps"}
    assert {"required": ["resolution"]} in law["oneOf"]
    for wrong, reason in (({"steps": "0"}, "at least one step"), ({"step": "2"}, "'step' is no setting of the law")):
        with pytest.raises(pp.InputError, match=reason):
            parse_law("x", {"resolution": "1 mm", **wrong}, (LENGTH,))
    with pytest.raises(pp.InputError, match=r"exactly one of fixed, .*rows, resolution; this one has none"):
        parse_law("x", {}, (LENGTH,))


def test_a_law_of_its_own_file_is_sampled_alike_by_both_engines(model: pp.ErrorModel) -> None:
    clear = model.space.sample(3, 0, 20_000)
    assert stats.kstest(clear[0], stats.uniform(-STEP / 2, STEP).cdf).pvalue > 1e-6
    compiled = sampler.sample(sampler.to_arrays(model.at("p")), 3, 0, 20_000)
    np.testing.assert_allclose(compiled, clear, rtol=0, atol=1e-16 * STEP)
    found = pp.monte_carlo(model, "p", samples=100_000, seed=1)
    middle = stats.uniform(-slope(model) * STEP / 2, slope(model) * STEP)
    np.testing.assert_allclose(
        [found.position.y.quantile(p) for p in LEVELS], middle.ppf(LEVELS), rtol=0, atol=0.01 * STEP
    )


def test_a_law_of_its_own_file_is_known_to_the_analyses(model: pp.ErrorModel) -> None:
    size = slope(model)
    assert pp.moments(model, "p").poses[0].std.value[1] == pytest.approx(size * STEP / math.sqrt(12), rel=1e-3)
    exact = pp.exact_law(model, "p").poses[0].laws["position.y"]
    assert exact.law is not None
    middle = stats.uniform(exact.mean - size * STEP / 2, size * STEP)
    np.testing.assert_allclose([exact.law.quantile(p) for p in LEVELS], middle.ppf(LEVELS), rtol=1e-9)
    worst = pp.worst_case(model, "p").poses[0].components[1]
    assert (worst.quantity, worst.high) == ("position.y", pytest.approx(size * STEP / 2, rel=1e-3))


def test_a_law_of_its_own_file_is_described_in_the_report(model: pp.ErrorModel) -> None:
    text = str(parameters([SimpleNamespace(model=model)]))  # type: ignore[arg-type]
    assert "rounded to 0.2 mm" in text


def slope(model: pp.ErrorModel) -> float:
    """How far the tip moves along y for each metre of the one length, by a difference."""
    at = model.at("p")
    errors = at.exact(np.array([[-1e-6, 1e-6]]))
    found = abs(float(errors[1, 1] - errors[1, 0])) / 2e-6
    assert found > 0.5
    return found


# what there is -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_every_law_has_a_file_of_its_own(law: type[Law]) -> None:
    name = "".join(f"_{c.lower()}" if c.isupper() else c for c in law.__name__).lstrip("_")
    assert law.__module__ == f"precision_pin.draws.laws.{name}"
    assert getattr(laws, law.__name__) is law
    assert getattr(pp, law.__name__) is law


BASES = {"SymmetricLaw", "BoundedLaw", "PlaneLaw", "HalfWidthLaw"}


def test_the_list_of_laws_is_complete() -> None:
    found = {
        node.name
        for path in (PACKAGE / "draws" / "laws").glob("*.py")
        for node in tree(path).body
        if isinstance(node, ast.ClassDef) and any(ast.unparse(base) in ("Law", *BASES) for base in node.bases)
    }
    assert found - BASES == {law.__name__ for law in LAWS}


@pytest.mark.parametrize("key", laws_of_sheets())
def test_the_example_of_a_form_is_read_with_each_option(key: str) -> None:
    form = laws_of_sheets()[key].form
    assert parse_law("x", form.example, (LENGTH,)).draw.law.size >= 1
    for option in form.options:
        parse_law("x", {**form.example, option.key: option.example}, (LENGTH,))
    assert law_options(key) == (*(option.key for option in form.options), "scope")


NAMED = {
    # a name that could not be read as anything must stand for something while the rest of a sheet is read
    "sheet/reader.py": {"Fixed"},
    # loops of rare laws are compiled for the types of any space that has one
    "kernel/arrays.py": {"Disc"},
    # what is left uncertain is normal, and geometric errors of one size
    "draws/estimates.py": {"JointNormal"},
    "model/frame_models.py": {"Normal"},
    # the physics of a source says what its own draws follow
    "sources/axis_install.py": {"Disc"},
    "sources/backlash.py": {"Uniform"},
    "sources/clearance.py": {"Circle", "Disc", "Uniform"},
    "sources/covariance.py": {"JointNormal"},
    "sources/encoder.py": {"Uniform"},
    "sources/periodic.py": {"Circle"},
    "sources/table.py": {"Rows"},
}
"""Files outside draws/laws that name a law, to draw from it."""


def law_names(path: Path) -> set[str]:
    """Return the laws that a file names, as imported or as an attribute."""
    known = {law.__name__ for law in LAWS}
    names: set[str] = set()
    for node in ast.walk(tree(path)) if "laws" in path.read_text(encoding="utf-8") else ():
        if isinstance(node, ast.ImportFrom) and "laws" in (node.module or "").split("."):
            names |= {alias.name for alias in node.names} & known
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "laws":
            names |= {node.attr} & known
    return names


def test_no_other_file_names_a_law() -> None:
    found: dict[str, Any] = {}
    for path in FILES:
        relative = path.relative_to(PACKAGE)
        if relative.parts[:2] != ("draws", "laws") and str(relative) != "__init__.py":
            names = law_names(path)
            if names:
                found[relative.as_posix()] = names
    assert found == NAMED


@pytest.mark.parametrize("name", NAMED)
def test_what_names_a_law_draws_from_it_and_asks_for_no_class(name: str) -> None:
    """A law is told from others by what it says of itself."""
    asked = {
        ast.unparse(part)
        for node in ast.walk(tree(PACKAGE / name))
        for part in (
            node.args[1:] if isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance"
            else [node.cls] if isinstance(node, ast.MatchClass) else []
        )
    }  # fmt: skip
    assert not asked & NAMED[name]
