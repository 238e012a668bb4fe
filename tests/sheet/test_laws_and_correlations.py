"""How a sheet spells laws, files of measured numbers and correlations; few samples are warned of."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from precision_pin import Correlation, Draw, ErrorModel, Scope
from precision_pin.draws import laws
from precision_pin.sheet.sheet_lint import FEW, few_samples

HEAD = "precision-pin: 1\nrobot: 4dof.urdf\n"
GAUGE = "p, gap [um], shim [mm], turn [mrad]\n0, -30, 0.1, 1\n0.5, 10, 0.3, 2\n1, 20, 0.2, 3\n"


@pytest.fixture(autouse=True)
def gauge(folder):
    (folder / "gauge.csv").write_text(GAUGE, encoding="utf-8")
    (folder / "single.csv").write_text("gap [mm]\n0.3\n0.1\n", encoding="utf-8")
    (folder / "high.csv").write_text("gap [mm]\nhigh\n", encoding="utf-8")


SAMPLES = laws.Empirical(((0.0, 1e-4), (0.25, 1e-4), (0.75, 3e-4), (1.0, 3e-4)))
"""Hazen's quantiles of 0.3 and 0.1 mm."""


LAWS = [
    ("{fixed: -0.1 mm}", laws.Fixed(-1e-4)),
    ("{uniform: 0.05 mm, mean: -2 mm}", laws.Uniform(5e-5, -2e-3)),
    ("{uniform: 0 mm}", laws.Uniform(0.0)),
    ("{triangular: 1 mrad, mean: 1 deg}", laws.Triangular(1e-3, math.pi / 180)),
    ("{normal: 0.3 mm}", laws.Normal(0.3e-3 / 3)),
    ("{normal: 0.3 mm, mean: 1 mm, k: 4.5}", laws.Normal(0.3e-3 / 4.5, 1e-3)),
    ("{normal: {std: 0.3 mm}, mean: 1 m}", laws.Normal(0.3e-3, 1.0)),
    ("{normal: 0.3 mm, truncated: true}", laws.TruncatedNormal(0.3e-3 / 3, 0.0, 3.0)),
    ("{normal: 0.3 mm, truncated: True, k: 2}", laws.TruncatedNormal(0.3e-3 / 2, 0.0, 2.0)),
    ("{normal: 0.3 mm, truncated: false}", laws.Normal(0.3e-3 / 3)),
    ("{normal: {std: 0.3 mm}, truncated: true, k: 2.5}", laws.TruncatedNormal(0.3e-3, 0.0, 2.5)),
    ("{disc: 0.1 mm}", laws.Disc(1e-4)),
    ("{circle: 0.1 mm}", laws.Circle(1e-4)),
    ("{sphere: 0.1 mm}", laws.Sphere(1e-4)),
    (
        "{joint_normal: {std: [1 mm, 2 mm]}, mean: [1 cm, -1 mm], correlation: [[1, -0.5], [-0.5, 1]]}",
        laws.JointNormal(((1e-6, -1e-6), (-1e-6, 4e-6)), (0.01, -0.001)),
    ),
    ("{lognormal: {std: 0.1 mm}, mean: 1 mm}", laws.Lognormal(1e-4, 1e-3)),
    ("{arcsine: 0.1 mm, mean: -1 mm}", laws.Arcsine(1e-4, -1e-3)),
    ("{two_point: 0.1 mm}", laws.TwoPoint(1e-4)),
    ("{two_point: 0.1 mm, centre: 1 mm, probability: 30 %}", laws.TwoPoint(1e-4, 1e-3, 0.3)),
    ("{empirical: {samples: [0.3 mm, 100 um]}}", SAMPLES),
    ("{empirical: {samples: 0.3 0.1 mm}}", SAMPLES),
    ("{empirical: {samples: {file: single.csv}}}", SAMPLES),
    ("{empirical: {quantiles: [[0, -0.1 mm], [50 %, 0 mm], [1, 0.2 mm]]}}", laws.Empirical(((0, -1e-4), (0.5, 0), (1, 2e-4)))),
    ("{empirical: {quantiles: {file: gauge.csv, column: gap}}}", laws.Empirical(((0, -3e-5), (0.5, 1e-5), (1, 2e-5)))),
    ("{rows: [[0.1 mm, 0.2 mm], [0.3 mm, -400 um]]}", laws.Rows(((1e-4, 2e-4), (3e-4, -4e-4)))),
    ("{rows: [0.1 0.2 mm, 0.3 -0.4 mm]}", laws.Rows(((1e-4, 2e-4), (3e-4, -4e-4)))),
    ("{rows: {file: gauge.csv, columns: [shim, gap]}}", laws.Rows(((1e-4, -3e-5), (3e-4, 1e-5), (2e-4, 2e-5)))),
    ("{rows: {file: single.csv}}", laws.Rows(((3e-4,), (1e-4,)))),
]  # fmt: skip


def test_laws(load):
    lines = [f"  p{k}: {text}\n" for k, (text, _) in enumerate(LAWS)]
    draws = load(HEAD + "parameters:\n" + "".join(lines)).space.draws
    for (text, law), draw in zip(LAWS, draws, strict=True):
        assert type(draw.law) is type(law), text
        np.testing.assert_allclose(draw.law.mean_vector, law.mean_vector, rtol=1e-14, atol=1e-19, err_msg=text)
        np.testing.assert_allclose(draw.law.covariance, law.covariance, rtol=1e-13, err_msg=text)
        assert draw.law.support(np.ones(law.size)) == pytest.approx(law.support(np.ones(law.size)), rel=1e-13), text
        if law.size == 1 and not isinstance(law, laws.Fixed):
            u = np.linspace(0.01, 0.99, 99) * np.ones((1, 1))
            np.testing.assert_allclose(draw.law.inverse(u), law.inverse(u), rtol=1e-13, atol=1e-20, err_msg=text)


def test_options_scopes_and_components_of_the_laws(load):
    text = "  a: {two_point: 1 mm, scope: visit}\n  b: {rows: [1 2 deg, 3 4 deg], scope: pose}\n  c: {disc: 0.1 mm}\n"
    sources = "  - frame: {joint: joint2, x: a, rx: b.1, y: c.x}\n"
    length = "  - length: {joint: joint2, parameters: {empirical: {samples: {file: single.csv}}}}\n"
    sheet = load(f"{HEAD}parameters:\n{text}sources:\n{sources}{length}")
    a, b, c = sheet.space.draws
    assert a == Draw("a", laws.TwoPoint(1e-3), Scope.VISIT)
    assert (b.scope, b.components) == (Scope.POSE, ("b.0", "b.1"))
    assert (c.scope, c.components) == (Scope.UNIT, ("c.x", "c.y"))
    frame, other = sheet.sources
    assert frame.settings()["rx"] == "b.1"
    # a law from a file stands inside a source too
    (draw,) = other.draws(other.label())
    assert draw.law == laws.Empirical.from_samples([3e-4, 1e-4])


@pytest.mark.fast(12)
@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("{lognormal: 0.1 mm, mean: 1 mm}", r"lognormal takes the standard deviation of the number itself"),
        ("{lognormal: {std: 0.1 mm}}", "lognormal needs a mean"),
        ("{lognormal: {std: 0.1 mm}, mean: 0 mm}", "the mean of a lognormal law must be above zero, got 0 mm"),
        ("{lognormal: {std: 5 m}, mean: 1 mm}", "at most 1000 times its mean"),
        ("{arcsine: -1 mm}", "the half-width is negative"),
        ("{two_point: 1 mm, mean: 1 mm}", "valid: centre, probability, scope"),
        ("{two_point: 1 mm, probability: 1}", "probability must lie above 0 and below 1, got 1"),
        ("{empirical: 0.1 mm}", "empirical takes samples"),
        ("{empirical: {samples: []}}", "at least one sample"),
        ("{empirical: {samples: {fil: single.csv}}}", "{file: …, column: …}"),
        ("{empirical: {samples: {file: missing.csv}}}", r"missing.csv does not exist"),
        ("{empirical: {samples: {file: [a]}}}", "expected the name of a CSV file"),
        ("{empirical: {samples: {file: high.csv}}}", "high.csv, line 2: 'high' is not a number"),
        ("{empirical: {samples: {file: gauge.csv}}}", "has the columns p, gap, shim, turn: choose one with column:"),
        ("{empirical: {samples: {file: gauge.csv, column: gup}}}", "named 'gup'; did you mean 'gap'"),
        ("{empirical: {quantiles: {file: single.csv, column: gap}}}", "named 'p'"),
        ("{empirical: {quantiles: [[0, 0.1 mm], [1]]}}", "quantiles must be pairs of a probability and a value"),
        ("{empirical: {quantiles: [[0, 0.1 mm], [half, 1 mm]]}}", "'half'"),
        ("{empirical: {quantiles: [[0, 0.1 mm], [0.9, 1 mm]]}}", "go from probability 0 to 1"),
        ("{empirical: {quantiles: [[0, 0.1 mm], [1, 0 mm]]}}", "the value 0 follows 0.0001"),
        ("{rows: 0.1 mm}", "rows takes rows of numbers that belong together"),
        ("{rows: [[0.1 mm, 0.2 mm], [0.3 mm]]}", "1 numbers, the first row has 2"),
        ("{rows: {file: gauge.csv, columns: [gap, turn]}}", "'mrad' of the column 'turn' is not a unit of length"),
        ("{rows: {file: gauge.csv, columns: gap}}", "columns must be a list of column names"),
    ],
)
def test_one_mistake_in_a_law_gives_one_line(refuse, law, message):
    (finding,) = refuse(HEAD + f"parameters:\n  fine: {{uniform: 1 mm}}\n  bad: {law}\n")
    assert finding.line == 5
    assert re.search(message, finding.message), finding.message


def test_a_mistake_inside_a_law_stands_at_its_own_line_and_its_users_are_not_reported_too(refuse):
    for text, line in (
        ("  bad:\n    empirical:\n      quantiles:\n        - [0, 0.1 mm]\n        - [1, 0.1 deg]\n", 8),
        ("  bad:\n    empirical:\n      samples:\n        file: missing.csv\n", 7),
        (
            "  bad: {rows: {file: missing.csv}}\nsources:\n  - length: {joint: joint2, parameters: bad.1}\n"
            "correlations:\n  - {parameters: [bad.0, bad.1], correlation: 0.5}\n",
            4,
        ),
    ):
        assert [finding.line for finding in refuse(f"{HEAD}parameters:\n{text}")] == [line]


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


def test_correlations_of_two_and_of_several(load):
    text = HEAD + PARAMETERS + "correlations:\n  - {parameters: [a1, c], correlation: -0.5}\n"
    text += "  - parameters: [a3, a5]\n    matrix:\n      - [1, 30 %]\n      - [0.3, 1]\n"
    text += "sources:\n  - length: {joint: joint2, parameters: [a1, a3, {uniform: 0.1 mm}]}\n"
    space = ErrorModel.from_sheet(load(text)).space
    assert space.correlations == (Correlation.pair("a1", "c", -0.5), Correlation.pair("a3", "a5", 0.3))
    assert space.pearson[space.index["a3"], space.index["a5"]] == pytest.approx(0.3, abs=0.01)
    assert space.pearson[space.index["a1"], space.index["c"]] < -0.4


def correlation(refuse, entry):
    text = HEAD + PARAMETERS + f"correlations:\n  - {{parameters: [a3, a5], correlation: 0.1}}\n{entry}\n"
    (finding,) = refuse(text)
    return finding


@pytest.mark.fast(8)
@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("  - 0.5", "a correlation is {parameters: [a1, a2], correlation: 0.5}"),
        ("  - {parameters: a1, correlation: 0.5}", "expected the names of two or more parameters"),
        ("  - {parameters: [a1, [c]], correlation: 0.5}", "expected the names of two or more parameters"),
        ("  - {parameters: [a1, c]}", "needs either correlation: (of two) or matrix:"),
        ("  - {parameters: [a1, c], correlation: 0.5, matrix: [[1, 0], [0, 1]]}", "needs either correlation:"),
        ("  - {parameters: [a1], correlation: 0.5}", "correlation: is for two parameters, these are 1"),
        ("  - {parameters: [a1, a1], correlation: 0.5}", "the correlation names 'a1' twice"),
        ("  - {parameters: [a1, c], correlation: 1.5}", "'a1' and 'c' is 1.5; it must lie between -1"),
        ("  - {parameters: [a1, c], matrix: 0.5}", "expected rows of plain numbers"),
        ("  - {parameters: [a1, c], matrix: [[1, 0.5], [0.4, 1]]}", "is 0.5 in one place and 0.4 in the other"),
        ("  - {parameters: [a1, c], matrix: [[1, 0.5]]}", "expected 2 of 2"),
        ("  - {parameters: [a1, a33], correlation: 0.5}", "did you mean 'a3'"),
        ("  - {parameters: [a1, pin], correlation: 0.5}", "'pin' draws 2 numbers"),
        ("  - {parameters: [a1, pin.x], correlation: 0.5}", "'pin.x' is one of the several numbers of 'pin'"),
        ("  - {parameters: [a1, play], correlation: 0.5}", "'a1' is drawn for each unit, 'play' for each visit"),
        ("  - {parameters: [a1, still], correlation: 0.5}", "'still' is fixed"),
        ("  - {parameters: [a1, a5], correlation: 0.5}", "'a5' is in two correlations"),
        (
            "  - {parameters: [a1, c, z], matrix: [[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]]}",
            "not positive definite (",
        ),
    ],
)
def test_one_mistake_in_a_correlation_gives_one_line(refuse, entry, message):
    finding = correlation(refuse, entry)
    assert message in finding.message
    assert finding.line == 13


def test_a_mistake_inside_a_correlation_stands_at_its_own_line(refuse):
    for entry, line in (
        ("  - parameters:\n      - a1\n      - cc\n    correlation: 0.5", 15),
        ("  - parameters: [a1, c]\n    correlation: high", 14),
        ("  - parameters: [a1, c]\n    matrix:\n      - [1, 2]\n      - [2, 1]", 14),
        ("  - parameters: [a1, c]\n    matrix:\n      - [1, 0.5]\n      - [0.5, one]", 16),
    ):
        assert correlation(refuse, entry).line == line
    (finding,) = refuse(HEAD + PARAMETERS + "correlations: {parameters: [a1, c]}\n")
    assert (finding.line, "expected a list" in finding.message) == (11, True)


# ---- few samples ----

FEW_SHEET = """\
precision-pin: 1
robot: 4dof.urdf
tip: tool
parameters:
  gap: {empirical: {samples: 0.1 0.12 0.11 0.13 0.09 mm}}
  pair: {rows: [[1 mm, 2 mm], [2 mm, 2 mm], [3 mm, 3 mm]]}
sources:
  - length: {joint: joint2, parameters: [gap, pair.0, {empirical: {samples: 0.1 0.2 mm}}]}
  - length: {joint: joint3, parameters: [gap, pair.1]}
  - table: {frame: tool, file: few.csv}
  - table: {frame: tool, file: many.csv}
"""
DOCS = Path(__file__).parents[2] / "docs" / "sheet.md"


def hazen_variance(x):
    """Return the variance of samples (rows) with straight lines between the quantiles (k - 1/2)/n, by dense sampling."""
    x = np.sort(x, axis=1)
    n = x.shape[1]
    u = (np.arange(1000) + 0.5) / 1000
    place = np.clip(u * n - 0.5, 0, n - 1)
    low = np.minimum(place.astype(int), n - 2)
    drawn = x[:, low] + (place - low) * (x[:, low + 1] - x[:, low])
    return drawn.var(axis=1)


def table_of_the_page():
    rows = [line for line in DOCS.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    cells = {row.split("|")[1].strip(): re.findall(r"[\d.]+", row.split("|", 2)[2]) for row in rows}
    wanted = ("samples n", "σ of `rows`", "σ of `empirical`", "true σ")
    return {key: [float(x) for x in next(cells[name] for name in cells if name.startswith(key))] for key in wanted}


@pytest.mark.slow
def test_the_numbers_of_the_documentation_by_many_sets_of_samples():
    table = table_of_the_page()
    rng = np.random.default_rng(11)
    for k, count in enumerate(map(int, table["samples n"])):
        sets = rng.normal(size=(3000, count))
        rows, lines = sets.var(axis=1).mean() ** 0.5, hazen_variance(sets).mean() ** 0.5
        limit = float(np.sqrt((count - 1) / stats.chi2.ppf(0.05, count - 1)))
        # 3000 sets know the root of a mean variance to about 1.3 %/√(n - 1) and half a digit is printed
        assert table["σ of `rows`"][k] == pytest.approx(rows, abs=0.005 + 0.04 / np.sqrt(count - 1))
        assert table["σ of `empirical`"][k] == pytest.approx(lines, abs=0.005 + 0.04 / np.sqrt(count - 1))
        assert table["true σ"][k] == pytest.approx(limit, abs=0.05)


def test_a_sheet_warns_at_every_law_once(load, folder):
    (folder / "few.csv").write_text("x [mm], rz [mrad]\n" + "".join(f"{0.1 * k}, {k * k}\n" for k in range(7)))
    (folder / "many.csv").write_text("x [mm]\n" + "".join(f"{0.01 * k}\n" for k in range(FEW)))
    found = [finding for finding in load(FEW_SHEET).findings if finding.code == "W_FEW_SAMPLES"]
    said = [(finding.severity, finding.line, *finding.message.split(":")[:2]) for finding in found]
    assert said == [
        ("warning", 5, "gap", " 5 measured samples"),
        ("warning", 6, "pair", " 3 measured samples"),
        ("warning", 8, "length[joint2].parameters[2]", " 2 measured samples"),
        ("warning", 10, "table[tool].row", " 7 measured samples"),
    ]


def test_the_factor_is_that_of_these_samples():
    """Five evenly spaced samples: 0.86, the true deviation up to 2.4 times theirs."""
    samples = np.array([0.1, 0.12, 0.11, 0.13, 0.09])
    said = few_samples(laws.Empirical.from_samples(samples))
    factor = np.sqrt(hazen_variance(samples[None])[0]) / samples.std(ddof=1)
    assert factor == pytest.approx(0.86, abs=0.005)
    assert f"{factor:.2f} times the samples' standard deviation" in said
    assert f"up to {np.sqrt(4 / stats.chi2.ppf(0.05, 4)):.1f} times" in said
    said = few_samples(laws.Rows(((1.0, 5.0), (2.0, 5.0), (4.0, 5.0))))
    assert f"{np.sqrt(2 / 3):.2f} times the samples' standard deviation" in said


def test_samples_without_spread_and_laws_without_samples():
    one_has_none = few_samples(laws.Empirical.from_samples([0.1]))
    assert one_has_none.startswith("one measured sample has no spread")
    assert "all the same" in few_samples(laws.Rows(((1.0,), (1.0,))))
    enough = laws.Empirical.from_samples(np.arange(FEW))
    for law in (laws.Empirical(((0.0, -1.0), (1.0, 1.0))), enough, laws.Normal(1.0)):
        assert few_samples(law) is None
