"""A law is one file: one added in a file of its own is known everywhere, and no other file names those there are."""

import ast
import math
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.base.arrays import Array
from precision_pin.base.units import LENGTH
from precision_pin.draws import laws
from precision_pin.draws.laws import LAWS, Law, laws_of_sheets
from precision_pin.draws.laws.law import MEAN
from precision_pin.kernel import sampler
from precision_pin.pages.report.page import parameters
from precision_pin.robot.examples import PAPER_SHEET
from precision_pin.sheet import json_schema
from precision_pin.sheet.settings import law_options, parse_law
from support.package_code import FILES, PACKAGE, tree

TRAPEZOID = '''
"""A symmetric trapezoid."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from precision_pin.draws.laws.law import Law
from precision_pin.draws.laws.law import MEAN, LawOption, SheetForm


@dataclass(frozen=True)
class Trapezoid(Law):
    """Equally likely within mean ± top, from there on less to mean ± half_width."""

    form: ClassVar = SheetForm(
        "trapezoid", {"trapezoid": "0.1 mm"}, "a trapezoid", (LawOption("top", "half of its top", "0.05 mm"), MEAN)
    )
    half_width: float
    top: float = 0.0
    mean: float = 0.0

    @property
    def breaks(self):
        slope = (self.half_width - self.top) / (self.half_width + self.top) / 2
        return slope, 1 - slope

    def sample(self, variates):
        tail, a, b = np.minimum(variates, 1 - variates), self.half_width, self.top
        size = np.where(tail < self.breaks[0], a - np.sqrt(2 * tail * (a * a - b * b)), (a + b) * (0.5 - tail))
        return self.mean + np.copysign(size, variates - 0.5)
'''

SHEET = """
precision-pin: 1
robot: {robot}
parameters:
  sorted: {{trapezoid: 0.3 mm, top: 0.1 mm}}
poses:
  p: -90 3 88 -91 deg
sources:
  - length: {{joint: joint3, along: x of joint2, parameters: sorted}}
"""
A, B = 0.3e-3, 0.1e-3
VARIANCE = (A * A + B * B) / 6
FOURTH = (A**4 + A**2 * B**2 + B**4) / 15
"""Moments of the trapezoid: the integrals of x² f and x⁴ f by hand, f = 1/(A + B) up to B, falling to zero at A."""
SHARES = np.array([1 / 8, 1 / 4, 1 / 2, 3 / 4, 7 / 8])
QUANTILES = np.array([-A + math.sqrt(0.5) * (A - B), -B, 0, B, A - math.sqrt(0.5) * (A - B)])
"""F = (x + A)²/(2(A² - B²)), 1/4 at -B and half of that at -A + (A - B)/√2, where F = 1/8."""


@pytest.fixture
def trapezoid(monkeypatch: pytest.MonkeyPatch) -> type[Law]:
    """Add a law: one class, and its line in the list of laws in draws/laws/__init__.py; no other file is needed."""
    module: Any = ModuleType("trapezoid")
    monkeypatch.setitem(sys.modules, "trapezoid", module)
    exec(TRAPEZOID, vars(module))
    monkeypatch.setattr(laws, "LAWS", (*LAWS, module.Trapezoid))
    return module.Trapezoid


@pytest.fixture
def model(trapezoid: type[Law], tmp_path: Path) -> pp.ErrorModel:
    sheet = tmp_path / "arm.errors.yaml"
    sheet.write_text(SHEET.format(robot=PAPER_SHEET.parent / "4dof.urdf"), encoding="utf-8")
    return pp.ErrorModel.load(sheet)


def test_an_added_law_is_read_from_a_sheet_and_described_in_the_report(trapezoid: Any, model: pp.ErrorModel) -> None:
    assert model.space.draws[0].law == trapezoid(A, B)
    law = json_schema()["$defs"]["law"]
    assert law["properties"]["top"] == {"description": "half of its top"}
    assert {"required": ["trapezoid"]} in law["oneOf"]
    parsed = parse_law("x", {"trapezoid": "1 mm", "mean": "2 mm"}, (LENGTH,)).draw.law
    assert parsed == trapezoid(1e-3, 0.0, 2e-3)
    for wrong, reason in (({"trapezoid": "-1 mm"}, "negative"), ({"step": "2"}, "'step' is no setting")):
        with pytest.raises(pp.InputError, match=reason):
            parse_law("x", {"trapezoid": "1 mm", **wrong}, (LENGTH,))
    with pytest.raises(pp.InputError, match=r"exactly one of fixed, .*rows, trapezoid; this one has none"):
        parse_law("x", {}, (LENGTH,))
    with pytest.raises(pp.InputError, match=r"the top of a trapezoid law must be .*finite.*, got nan"):
        trapezoid(1.0, math.nan)
    text = str(parameters([SimpleNamespace(model=model)]))  # type: ignore[arg-type]
    assert "Trapezoid, mean 0 mm, standard deviation 0.129099 mm" in text


def test_moments_of_an_added_law_are_those_by_hand(trapezoid: Any) -> None:
    law = trapezoid(A, B, 5e-3)
    assert law.mean_vector == pytest.approx([5e-3], rel=1e-14)
    assert law.covariance == pytest.approx(np.array([[VARIANCE]]), rel=1e-11)
    assert law.standardised_moments() == pytest.approx((0, FOURTH / VARIANCE**2, 1), rel=1e-10, abs=1e-10)
    assert law.tolerance((LENGTH,)) == "±0.3 mm"


@pytest.mark.slow
def test_an_added_law_is_sampled_alike_by_both_engines_and_known_to_the_analyses(model: pp.ErrorModel) -> None:
    clear = model.space.sample(3, 0, 20_000)
    assert abs(clear.std() / math.sqrt(VARIANCE) - 1) < 5 * math.sqrt((FOURTH / VARIANCE**2 - 1) / 80_000)
    compiled = sampler.sample(sampler.to_arrays(model.at("p")), 3, 0, 20_000)
    np.testing.assert_allclose(compiled, clear, rtol=0, atol=1.1e-7 * math.sqrt(VARIANCE))
    # how far the tip moves along y for each metre of the one length, by a difference
    errors = model.at("p").exact(np.array([[-1e-6, 1e-6]]))
    size = abs(float(errors[1, 1] - errors[1, 0])) / 2e-6
    assert size > 0.5
    assert pp.moments(model, "p").poses[0].std.value[1] == pytest.approx(size * math.sqrt(VARIANCE), rel=1e-3)
    exact = pp.exact_law(model, "p").poses[0].laws["position.y"]
    assert exact.error < 1e-9
    found = np.array([exact.law.quantile(p) for p in SHARES])
    np.testing.assert_allclose(found, exact.mean + size * QUANTILES, rtol=0, atol=1e-9 * A)
    worst = pp.worst_case(model, "p").poses[0].components[1]
    assert (worst.quantity, worst.high) == ("position.y", pytest.approx(size * A, rel=1e-3))
    assert pp.budget(model, "p").poses[0].std["position.y"] == pytest.approx(size * math.sqrt(VARIANCE), rel=1e-6)


# defaults ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Bare(Law):
    """A law of which only the quantile function is known."""

    law: Law
    variates = property(lambda self: self.law.variates)
    breaks = property(lambda self: self.law.breaks)

    def sample(self, variates: Array) -> Array:
        return self.law.sample(variates)


CLOSED: list[tuple[Law, float, float]] = [
    (pp.Uniform(0.2, 3.0), 1e-11, 1e-9),
    (pp.Triangular(0.2, -3.0), 1e-11, 1e-9),
    (pp.TruncatedNormal(1.0, 0.0, 2.5), 1e-11, 1e-9),
    (pp.TruncatedNormal(1.0, 0.0, 0.1), 1e-11, 1e-9),
    (pp.Arcsine(2.0, 1.0), 2e-8, 1e-4),
    (pp.Normal(0.3, 2.0), 1e-11, 1e-9),
    (pp.Lognormal(0.3, 1.0), 1e-11, 1e-9),
    (pp.Lognormal(2.0, 1.0), 1e-11, 1e-9),
    (pp.TwoPoint(0.5, 1.0, 0.3), 1e-11, math.nan),
    (pp.Empirical(((0.0, -1.0), (0.2, -0.5), (0.2, 0.1), (0.9, 2.0), (1.0, 2.5))), 1e-11, 1e-9),
    (pp.Empirical.from_samples([1.0, 2.0, 3.0, 3.0, 7.0]), 1e-11, math.nan),
]
"""Every law of one number that varies, and how far what is derived of it may be off: probabilities, densities times σ."""


@pytest.mark.fast(4)
@pytest.mark.parametrize(("law", "error", "roughness"), CLOSED, ids=[repr(law)[:30] for law, *_ in CLOSED])
def test_what_follows_from_the_quantiles_is_what_closed_forms_say(law: Law, error: float, roughness: float) -> None:
    bare, std = Bare(law), math.sqrt(law.covariance[0, 0])
    assert abs(bare.mean_vector - law.mean_vector)[0] < 1e-11 * std
    assert bare.covariance[0, 0] == pytest.approx(std**2, rel=1e-8 if std == 2.0 else 1e-11)
    assert [bare.support([w]) for w in (1.0, -2.0, 0.0)] == [pytest.approx(law.support([w])) for w in (1.0, -2.0, 0.0)]
    assert bare.interval(0) == pytest.approx(law.interval(0), rel=1e-12)
    assert bare.standardised_moments() == pytest.approx(law.standardised_moments(), rel=1e-12)
    omega = np.concatenate([np.linspace(-30, 30, 61), np.geomspace(30, 1e3, 20)]) / std
    np.testing.assert_allclose(bare.characteristic(omega[None]), law.characteristic(omega[None]), rtol=0, atol=error)
    for weight in (1.5, -0.7):
        known, part = (each.projection(np.array([weight])) for each in (law, bare))
        if known is None:
            continue  # a normal law has none
        np.testing.assert_allclose(part.ends, known.ends, rtol=1e-12)
        low, high = known.within(6.0)
        assert part.within(6.0) == pytest.approx((low, high), rel=1e-9)
        x = np.linspace(low, high, 1000)[1:-1]
        x = x[np.abs(x[:, None] - np.array(known.kinks)).min(axis=1) > 1e-3 * std]
        np.testing.assert_allclose(part.cumulative(x), known.cumulative(x), rtol=0, atol=error)
        if math.isfinite(roughness):
            np.testing.assert_allclose(part.density(x) * std, known.density(x) * std, rtol=roughness, atol=roughness)
        positive = np.abs(omega)
        wave = known.characteristic(positive)
        np.testing.assert_allclose(part.characteristic(positive), wave, rtol=0, atol=error)
        assert error > 1e-11 or part.characteristic_error < 1e-10
        for each in (known, part):
            assert (each.envelope(positive) >= np.abs(wave) - 1e-14).all()
            assert (np.diff(each.envelope(np.sort(positive))) <= 0).all()


def test_the_lines_that_the_loops_draw_from_are_close_to_the_quantiles() -> None:
    u = np.concatenate([[2.0**-53, 1e-9, 1 - 2.0**-53], np.random.default_rng(1).random(10_000)])
    for law in (law for law, *_ in CLOSED if law.variates == "uniform"):
        row = Bare(law).kernel_row()
        begin, value, slope, end = row.numbers.T
        k = np.searchsorted(begin, u, side="right") - 1
        drawn = np.minimum(value[k] + slope[k] * (u - begin[k]), end[k])
        np.testing.assert_allclose(drawn, law.sample(u[None])[0], rtol=0, atol=1.1e-7 * math.sqrt(law.covariance[0, 0]))
        low, high = law.interval(0)
        assert low <= value.min()
        assert end.max() <= high


@dataclass(frozen=True)
class Odd(Law):
    """Samples that do not rise, or two numbers, and nothing else."""

    numbers: int = 1
    size = property(lambda self: self.numbers)

    def sample(self, variates: Array) -> Array:
        return np.cos(7 * variates)


def test_what_does_not_follow_is_said() -> None:
    assert Odd().kernel_row() is None
    assert Odd().projection(np.ones(1)) is None
    with pytest.raises(pp.InputError, match="the samples of the law Odd do not rise"):
        Odd().characteristic([1.0])
    for ask, what in ((lambda law: law.mean_vector, "mean"), (lambda law: law.support([1.0, 0.0]), "support function")):
        with pytest.raises(pp.InputError, match=f"the law Odd of 2 numbers does not define its {what}"):
            ask(Odd(2))


# what there is -------------------------------------------------------------------------------------------------------


BASES = {"SymmetricLaw", "BoundedLaw", "RoundLaw", "HalfWidthLaw"}


def test_the_list_of_laws_is_complete_and_each_is_tried() -> None:
    found = {
        node.name
        for path in (PACKAGE / "draws" / "laws").glob("*.py")
        for node in tree(path).body
        if isinstance(node, ast.ClassDef) and any(ast.unparse(base) in ("Law", *BASES) for base in node.bases)
    }
    assert found - BASES == {law.__name__ for law in LAWS}
    tried = {type(law).__name__ for law, *_ in CLOSED} | {"Fixed", "Disc", "Circle", "Sphere", "JointNormal", "Rows"}
    assert tried == found - BASES
    for law in LAWS:
        assert law.__module__.startswith("precision_pin.draws.laws.")
        assert getattr(laws, law.__name__) is getattr(pp, law.__name__) is law


def test_the_example_of_a_form_is_read_with_each_option() -> None:
    for key, law in laws_of_sheets().items():
        assert parse_law("x", law.form.example, (LENGTH,)).draw.law.size >= 1
        for option in law.form.options:
            parse_law("x", {**law.form.example, option.key: option.example}, (LENGTH,))
        size = ("size",) if MEAN in law.form.options else ()
        assert law_options(key) == (*(option.key for option in law.form.options), *size, "scope")


NAMED = {
    # what a name that could not be read stands for, rare loops, what is left uncertain, geometric errors of one size
    *("sheet/reader.py", "kernel/arrays.py", "draws/space.py", "model/error_model.py", "model/datum.py"),
    # forces and joint steps that are varied, not drawn
    "model/compliance.py",
    # the physics of a source says what its own draws follow
    *(
        f"sources/{name}.py"
        for name in [
            "axis_install",
            "backlash",
            "clearance",
            "covariance",
            "encoder",
            "force",
            "periodic",
            "places",
            "table",
        ]
    ),
}
"""Files outside draws/laws that name a law, to draw from it."""


def law_names(path: Path) -> set[str]:
    """Return the laws that a file names, as imported or as an attribute."""
    text = path.read_text(encoding="utf-8")
    imported = re.findall(r"from [\w.]*\blaws[\w.]* import (\([^)]*\)|.*)", text)
    return {law.__name__ for law in LAWS} & {
        *re.findall(r"\w+", " ".join(imported)),
        *re.findall(r"(?<![\w.])laws\.(\w+)", text),
    }


def asked_classes(path: Path) -> set[str]:
    """Return the classes that a file asks for: a law is told from others by what it says of itself."""
    asked = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance":
            asked |= {ast.unparse(part) for part in node.args[1:]}
        elif isinstance(node, ast.MatchClass):
            asked.add(ast.unparse(node.cls))
    return asked


@pytest.mark.slow
def test_no_other_file_names_a_law_and_those_that_do_draw_from_it() -> None:
    found = {path.relative_to(PACKAGE).as_posix(): law_names(path) for path in FILES}
    outside = {name for name in found if not name.startswith("draws/laws/") and name != "__init__.py"}
    assert {name for name in outside if found[name]} == NAMED
    assert not [name for name in NAMED if asked_classes(PACKAGE / name) & found[name]]
