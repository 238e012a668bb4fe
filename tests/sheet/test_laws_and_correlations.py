"""How a sheet spells skewed and discrete laws, files of measured numbers, and correlations."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from precision_pin.base.errors import Finding
from precision_pin.draws.correlation import Correlation
from precision_pin.draws.draw import Draw, Scope
from precision_pin.draws.laws import Arcsine, Empirical, Law, Lognormal, Rows, TwoPoint
from precision_pin.model.error_model import ErrorModel
from precision_pin.sheet import json_schema

from .conftest import Load, Refuse, Write

HEAD = "precision-pin: 1\nrobot: 4dof.urdf\n"
GAUGE = "p, gap [um], shim [mm], turn [mrad]\n0, -30, 0.1, 1\n0.5, 10, 0.3, 2\n1, 20, 0.2, 3\n"


@pytest.fixture(autouse=True)
def gauge(folder: Path) -> None:
    (folder / "gauge.csv").write_text(GAUGE, encoding="utf-8")
    (folder / "single.csv").write_text("gap [mm]\n0.3\n0.1\n", encoding="utf-8")
    (folder / "high.csv").write_text("gap [mm]\nhigh\n", encoding="utf-8")


def laws(load: Load, *texts: str) -> list[Law]:
    lines = [f"  p{k}: {text}\n" for k, text in enumerate(texts)]
    return [draw.law for draw in load(HEAD + "parameters:\n" + "".join(lines)).space.draws]


SAMPLES = Empirical(((0.0, 1e-4), (0.25, 1e-4), (0.75, 3e-4), (1.0, 3e-4)))
"""Hazen's quantiles of 0.3 and 0.1 mm."""


@pytest.mark.parametrize(
    ("text", "law"),
    [
        ("{lognormal: {std: 0.1 mm}, mean: 1 mm}", Lognormal(1e-4, 1e-3)),
        ("{lognormal: {std: 2 N*m/rad}, mean: 10 N*m/rad}", Lognormal(2.0, 10.0)),
        ("{arcsine: 0.1 mm}", Arcsine(1e-4)),
        ("{arcsine: 0.1 mm, mean: -1 mm}", Arcsine(1e-4, -1e-3)),
        ("{two_point: 0.1 mm}", TwoPoint(1e-4)),
        ("{two_point: 0.1 mm, centre: 1 mm, probability: 0.3}", TwoPoint(1e-4, 1e-3, 0.3)),
        ("{two_point: 0.1 mm, probability: 30 %}", TwoPoint(1e-4, 0.0, 0.3)),
        ("{empirical: {samples: [0.3 mm, 100 um]}}", SAMPLES),
        ("{empirical: {samples: 0.3 0.1 mm}}", SAMPLES),
        ("{empirical: {samples: {file: single.csv}}}", SAMPLES),
        ("{empirical: {samples: {file: single.csv, column: gap}}}", SAMPLES),
        (
            "{empirical: {quantiles: [[0, -0.1 mm], [50 %, 0 mm], [1, 0.2 mm]]}}",
            Empirical(((0.0, -1e-4), (0.5, 0.0), (1.0, 2e-4))),
        ),
        (
            "{empirical: {quantiles: {file: gauge.csv, column: gap}}}",
            Empirical(((0.0, -3e-5), (0.5, 1e-5), (1.0, 2e-5))),
        ),
        ("{rows: [[0.1 mm, 0.2 mm], [0.3 mm, -400 um]]}", Rows(((1e-4, 2e-4), (3e-4, -4e-4)))),
        ("{rows: [0.1 0.2 mm, 0.3 -0.4 mm]}", Rows(((1e-4, 2e-4), (3e-4, -4e-4)))),
        (
            "{rows: {file: gauge.csv, columns: [shim, gap]}}",
            Rows(((1e-4, -3e-5), (3e-4, 1e-5), (2e-4, 2e-5))),
        ),
        ("{rows: {file: single.csv}}", Rows(((3e-4,), (1e-4,)))),
    ],
)
def test_laws(load: Load, text: str, law: Law) -> None:
    (seen,) = laws(load, text)
    assert type(seen) is type(law)
    np.testing.assert_allclose(seen.mean_vector, law.mean_vector, rtol=1e-14, atol=1e-19)
    np.testing.assert_allclose(seen.covariance, law.covariance, rtol=1e-13)
    u = np.linspace(0.01, 0.99, 99) * np.ones((law.size, 1))
    np.testing.assert_allclose(seen.inverse(u), law.inverse(u), rtol=1e-13, atol=1e-20)


def test_a_law_from_a_file_stands_inside_a_source_too(load: Load) -> None:
    sheet = load(
        HEAD + "sources:\n  - length: {joint: joint2, parameters: {empirical: {samples: {file: single.csv}}}}\n"
    )
    (source,) = sheet.sources
    (draw,) = source.draws(source.label())
    assert draw.law == Empirical.from_samples([3e-4, 1e-4])


def test_options_and_scopes_of_the_laws(load: Load) -> None:
    text = HEAD + "parameters:\n  a: {two_point: 1 mm, scope: visit}\n  b: {rows: [1 2 deg, 3 4 deg], scope: pose}\n"
    a, b = load(text + "sources:\n  - frame: {joint: joint2, x: a, rx: b.1}\n").space.draws
    assert a == Draw("a", TwoPoint(1e-3), Scope.VISIT)
    assert b.scope is Scope.POSE
    assert b.components == ("b.0", "b.1")


def mistakes(refuse: Refuse, law: str) -> Finding:
    (finding,) = refuse(HEAD + f"parameters:\n  fine: {{uniform: 1 mm}}\n  bad: {law}\n")
    assert finding.line == 5
    return finding


@pytest.mark.fast(19)
@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("{lognormal: 0.1 mm, mean: 1 mm}", r"lognormal takes the standard deviation of the number itself"),
        ("{lognormal: {std: 0.1 mm}}", "lognormal needs a mean"),
        ("{lognormal: {std: 0.1 mm}, mean: 0 mm}", "the mean of a lognormal law must be above zero, got 0 mm"),
        ("{lognormal: {std: -0.1 mm}, mean: 1 mm}", "negative"),
        ("{lognormal: {std: 0.1 mm}, mean: 1 deg}", "'deg' in '1 deg' is not a unit of length"),
        ("{lognormal: {std: 5 m}, mean: 1 mm}", "at most 1000 times its mean"),
        ("{arcsine: -1 mm}", "the half-width is negative"),
        ("{arcsine: 1 mm, k: 2}", "'k' is no setting of the law arcsine: valid: mean, scope"),
        (
            "{two_point: 1 mm, mean: 1 mm}",
            "'mean' is no setting of the law two_point: valid: centre, probability, scope",
        ),
        ("{two_point: 1 mm, probability: 1}", "probability must lie above 0 and below 1, got 1"),
        ("{two_point: 1 mm, probability: often}", "'often'"),
        ("{two_point: 1 mm, centre: 1 deg}", "'deg'"),
        ("{empirical: 0.1 mm}", "empirical takes samples"),
        ("{empirical: {sample: 0.1 mm}}", "empirical takes samples"),
        ("{empirical: {samples: 0.1 mm, quantiles: []}}", "empirical takes samples"),
        ("{empirical: {samples: []}}", "at least one sample"),
        ("{empirical: {samples: 0.1 0.2}}", "has no unit"),
        ("{empirical: {samples: [0.1 mm, 1 deg]}}", "'deg'"),
        ("{empirical: {samples: {fil: single.csv}}}", "{file: …, column: …}"),
        ("{empirical: {samples: {file: missing.csv}}}", r"missing.csv does not exist"),
        ("{empirical: {samples: {file: [a]}}}", "expected the name of a CSV file"),
        ("{empirical: {samples: {file: high.csv}}}", "high.csv, line 2: 'high' is not a number"),
        ("{empirical: {samples: {file: gauge.csv}}}", "has the columns p, gap, shim, turn: choose one with column:"),
        (
            "{empirical: {samples: {file: gauge.csv, column: gup}}}",
            "no column in .*gauge.csv named 'gup'; did you mean 'gap'",
        ),
        ("{empirical: {quantiles: {file: single.csv, column: gap}}}", "named 'p'"),
        ("{empirical: {quantiles: [0.1 mm]}}", "quantiles must be pairs of a probability and a value"),
        ("{empirical: {quantiles: [[0, 0.1 mm], [1]]}}", "quantiles must be pairs of a probability and a value"),
        ("{empirical: {quantiles: [[0, 0.1 mm], [half, 1 mm]]}}", "'half'"),
        ("{empirical: {quantiles: [[0, 0.1], [1, 1 mm]]}}", "has no unit"),
        ("{empirical: {quantiles: [[0, 0.1 mm], [0.9, 1 mm]]}}", "go from probability 0 to 1"),
        ("{empirical: {quantiles: [[0, 0.1 mm], [1, 0 mm]]}}", "the value 0 follows 0.0001"),
        ("{rows: 0.1 mm}", "rows takes rows of numbers that belong together"),
        ("{rows: []}", "rows takes rows of numbers that belong together"),
        ("{rows: [[0.1 mm, 0.2 mm], [0.3 mm]]}", "1 numbers, the first row has 2"),
        ("{rows: [[0.1 mm], [0.2 deg]]}", "'deg'"),
        ("{rows: {file: gauge.csv, columns: [gap, turn]}}", "'mrad' of the column 'turn' is not a unit of length"),
        ("{rows: {file: gauge.csv, columns: gap}}", "columns must be a list of column names"),
        ("{rows: {file: gauge.csv, columns: [gap, gup]}}", "did you mean 'gap'"),
    ],
)
def test_one_mistake_in_a_law_gives_one_line(refuse: Refuse, law: str, message: str) -> None:
    finding = mistakes(refuse, law)
    assert re.search(message, finding.message), finding.message


def test_a_mistake_inside_a_law_stands_at_its_own_line(refuse: Refuse) -> None:
    text = (
        HEAD + "parameters:\n  bad:\n    empirical:\n      quantiles:\n        - [0, 0.1 mm]\n        - [1, 0.1 deg]\n"
    )
    (finding,) = refuse(text)
    assert finding.line == 8
    text = HEAD + "parameters:\n  bad:\n    empirical:\n      samples:\n        file: missing.csv\n"
    assert refuse(text)[0].line == 7


def test_what_uses_a_law_that_could_not_be_read_is_not_reported_too(refuse: Refuse) -> None:
    text = (
        HEAD
        + "parameters:\n  bad: {rows: {file: missing.csv}}\nsources:\n  - length: {joint: joint2, parameters: bad.1}\n"
    )
    text += "correlations:\n  - {parameters: [bad.0, bad.1], correlation: 0.5}\n"
    (finding,) = refuse(text)
    assert "missing.csv" in finding.message


# ---- correlations ----

PARAMETERS = """\
parameters:
  a1: {uniform: 0.05 mm}
  a3: {normal: 0.05 mm}
  a5: {triangular: 0.05 mm}
  c: {lognormal: {std: 1e-6 rad/(N*m)}, mean: 1e-5 rad/(N*m)}
  pin: {disc: 0.1 mm}
  play: {uniform: 0.1 mm, scope: visit}
  still: {fixed: 1 mm}
"""


@pytest.mark.filterwarnings(
    "ignore:.*W_(NO_POSES|FEW_SAMPLES|CONSTANT|OFF_CHAIN):precision_pin.base.errors.PrecisionPinWarning"
)
def test_correlations_of_two_and_of_several(load: Load, write: Write) -> None:
    text = HEAD + PARAMETERS + "correlations:\n  - {parameters: [a1, c], correlation: -0.5}\n"
    text += "  - parameters: [a3, a5]\n    matrix:\n      - [1, 30 %]\n      - [0.3, 1]\n"
    text += "sources:\n  - length: {joint: joint2, parameters: [a1, a3, {uniform: 0.1 mm}]}\n"
    sheet = load(text)
    expected = (Correlation.pair("a1", "c", -0.5), Correlation.pair("a3", "a5", 0.3))
    assert sheet.space.correlations == expected
    model = ErrorModel.load(write(text))
    assert model.space.correlations == expected
    index = model.space.index
    assert model.space.pearson[index["a3"], index["a5"]] == pytest.approx(0.3, abs=0.01)
    assert model.space.pearson[index["a1"], index["c"]] < -0.4


def correlation(refuse: Refuse, entry: str) -> Finding:
    text = HEAD + PARAMETERS + f"correlations:\n  - {{parameters: [a3, a5], correlation: 0.1}}\n{entry}\n"
    (finding,) = refuse(text)
    return finding


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("  - 0.5", "a correlation is {parameters: [a1, a2], correlation: 0.5}"),
        ("  - {parameters: [a1, c], rho: 0.5}", "a correlation is {parameters: [a1, a2], correlation: 0.5}"),
        ("  - {parameters: a1, correlation: 0.5}", "expected the names of two or more parameters"),
        ("  - {correlation: 0.5}", "expected the names of two or more parameters"),
        ("  - {parameters: [a1, c]}", "needs either correlation: (of two) or matrix:"),
        (
            "  - {parameters: [a1, c], correlation: 0.5, matrix: [[1, 0], [0, 1]]}",
            "needs either correlation: (of two) or",
        ),
        ("  - {parameters: [a1], correlation: 0.5}", "correlation: is for two parameters, these are 1"),
        ("  - {parameters: [a1, a1], correlation: 0.5}", "the correlation names 'a1' twice"),
        (
            "  - {parameters: [a1, c], correlation: 1.5}",
            "correlation of 'a1' and 'c' is 1.5; it must lie between -1 and 1",
        ),
        ("  - {parameters: [a1, c], correlation: 0.5 mm}", "'mm'"),
        ("  - {parameters: [a1, c], correlation: [0.5]}", "expected a plain number"),
        ("  - {parameters: [a1, c], matrix: 0.5}", "expected rows of plain numbers"),
        ("  - {parameters: [a1, c], matrix: [[1, 0.5], [0.4, 1]]}", "is 0.5 in one place and 0.4 in the other"),
        ("  - {parameters: [a1, c], matrix: [[1, 0.5]]}", "expected 2 of 2"),
        ("  - {parameters: [a1, c], matrix: [[1, high], [0.4, 1]]}", "'high'"),
        ("  - {parameters: [a1, b], correlation: 0.5}", "no parameter named 'b'"),
        ("  - {parameters: [a1, a33], correlation: 0.5}", "did you mean 'a3'"),
        ("  - {parameters: [a1, pin], correlation: 0.5}", "'pin' draws 2 numbers"),
        ("  - {parameters: [a1, pin.x], correlation: 0.5}", "'pin.x' is one of the several numbers of 'pin'"),
        ("  - {parameters: [a1, play], correlation: 0.5}", "'a1' is drawn for each unit, 'play' for each visit"),
        ("  - {parameters: [a1, still], correlation: 0.5}", "'still' is fixed"),
        ("  - {parameters: [a1, a5], correlation: 0.5}", "'a5' is in two correlations"),
        (
            "  - {parameters: [a1, c, z], matrix: [[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]]}",
            "not positive definite (smallest eigenvalue -0.8",
        ),
    ],
)
def test_one_mistake_in_a_correlation_gives_one_line(refuse: Refuse, entry: str, message: str) -> None:
    finding = correlation(refuse, entry)
    assert message in finding.message
    assert finding.line == 13


def test_a_mistake_inside_a_correlation_stands_at_its_own_line(refuse: Refuse) -> None:
    entry = "  - parameters:\n      - a1\n      - cc\n    correlation: 0.5"
    assert correlation(refuse, entry).line == 15
    entry = "  - parameters: [a1, c]\n    correlation: high"
    assert correlation(refuse, entry).line == 14
    entry = "  - parameters: [a1, c]\n    matrix:\n      - [1, 2]\n      - [2, 1]"
    assert correlation(refuse, entry).line == 14
    entry = "  - parameters: [a1, c]\n    matrix:\n      - [1, 0.5]\n      - [0.5, one]"
    assert correlation(refuse, entry).line == 16


def test_correlations_must_be_a_list(refuse: Refuse) -> None:
    (finding,) = refuse(HEAD + PARAMETERS + "correlations: {parameters: [a1, c]}\n")
    assert finding.line == 11
    assert "expected a list" in finding.message


# ---- schema ----

WHOLE = (
    HEAD
    + PARAMETERS
    + """\
  hum: {arcsine: 5 um}
  side: {two_point: 0.02 mm, centre: 1 mm, probability: 0.3}
  seen: {empirical: {samples: 0.1 0.2 mm}}
  listed: {empirical: {samples: [0.1 mm, 0.2 mm]}}
  filed: {empirical: {samples: {file: single.csv, column: gap}}}
  table: {empirical: {quantiles: [[0, 0.1 mm], [1, 0.2 mm]]}}
  sets: {rows: [[0.1 mm, 0.2 mm], [0.3 mm, 0.4 mm]]}
  taken: {rows: {file: gauge.csv, columns: [gap, shim]}}
correlations:
  - {parameters: [a1, c], correlation: 0.5}
  - {parameters: [a3, a5], matrix: [[1, 0.5], [0.5, 1]]}
sources:
  - table: {joint: joint2, file: plane.csv, scope: visit}
"""
)


def faults(text: str) -> list[str]:
    jsonschema = pytest.importorskip("jsonschema")
    sheet: Any = YAML(typ="safe", pure=True).load(text)
    validator = jsonschema.Draft202012Validator(json_schema())
    return [error.message for error in validator.iter_errors(json.loads(json.dumps(sheet)))]


@pytest.mark.slow
def test_the_schema_passes_what_the_reader_reads(load: Load, folder: Path) -> None:
    (folder / "plane.csv").write_text("x [mm], rz [deg]\n0.1, 0.2\n", encoding="utf-8")
    assert faults(WHOLE) == []
    sheet = load(WHOLE)
    assert len(sheet.space.draws) == 15
    assert len(sheet.space.correlations) == 2


@pytest.mark.fast(4)
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("{std: 1e-6 rad/(N*m)}", "1e-6 rad/(N*m)"),
        ("probability: 0.3", "chance: 0.3"),
        ("samples: 0.1 0.2 mm", "sample: 0.1 0.2 mm"),
        ("{file: single.csv, column: gap}", "{column: gap}"),
        ("columns: [gap, shim]", "columns: gap"),
        ("[a1, c], correlation: 0.5", "[a1], correlation: 0.5"),
        ("[a1, c], correlation: 0.5", "[a1, c]"),
        ("matrix: [[1, 0.5], [0.5, 1]]", "matrix: 0.5"),
        ("file: plane.csv, ", ""),
        ("file: plane.csv", "file: [plane.csv]"),
    ],
)
def test_the_schema_refuses_what_the_reader_refuses(refuse: Refuse, old: str, new: str) -> None:
    assert WHOLE.count(old) == 1
    text = WHOLE.replace(old, new)
    assert faults(text)
    assert refuse(text)
