"""Few measured samples: how much too little spread is drawn from them, and what the sheet says of it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from precision_pin.draws.laws import Empirical, Normal, Rows
from precision_pin.sheet.sheet_lint import FEW, few_samples

from .conftest import Load

SHEET = """\
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


def hazen_variance(x) -> np.ndarray:
    """Return the variance of samples (rows) with straight lines between the quantiles (k - 1/2)/n, by dense sampling."""
    x = np.sort(x, axis=1)
    n = x.shape[1]
    u = (np.arange(1000) + 0.5) / 1000
    place = np.clip(u * n - 0.5, 0, n - 1)
    low = np.minimum(place.astype(int), n - 2)
    drawn = x[:, low] + (place - low) * (x[:, low + 1] - x[:, low])
    return drawn.var(axis=1)


def table_of_the_page() -> dict[str, list[float]]:
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


def test_a_sheet_warns_at_every_law_once(load: Load, folder: Path):
    (folder / "few.csv").write_text("x [mm], rz [mrad]\n" + "".join(f"{0.1 * k}, {k * k}\n" for k in range(7)))
    (folder / "many.csv").write_text("x [mm]\n" + "".join(f"{0.01 * k}\n" for k in range(FEW)))
    found = [finding for finding in load(SHEET).findings if finding.code == "W_FEW_SAMPLES"]
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
    said = few_samples(Empirical.from_samples(samples))
    factor = np.sqrt(hazen_variance(samples[None])[0]) / samples.std(ddof=1)
    assert factor == pytest.approx(0.86, abs=0.005)
    assert said is not None
    assert f"{factor:.2f} times the samples' standard deviation" in said
    assert f"up to {np.sqrt(4 / stats.chi2.ppf(0.05, 4)):.1f} times" in said
    said = few_samples(Rows(((1.0, 5.0), (2.0, 5.0), (4.0, 5.0))))
    assert said is not None
    assert f"{np.sqrt(2 / 3):.2f} times the samples' standard deviation" in said


def test_the_limit_covers_the_true_deviation_as_often_as_it_says():
    """95 % of sets of five normal samples have 2.37 times their deviation above the true one."""
    sets = np.random.default_rng(2).normal(size=(20_000, 5)).std(axis=1, ddof=1)
    limit = float(np.sqrt(4 / stats.chi2.ppf(0.05, 4)))
    inside = int((sets * limit >= 1).sum())
    assert stats.binomtest(inside, sets.size, 0.95).pvalue > 0.01


def test_samples_without_spread_and_laws_without_samples():
    one, same = few_samples(Empirical.from_samples([0.1])), few_samples(Rows(((1.0,), (1.0,))))
    assert one is not None
    assert one.startswith("one measured sample has no spread")
    assert same is not None
    assert "all the same" in same
    assert few_samples(Empirical(((0.0, -1.0), (1.0, 1.0)))) is None
    assert few_samples(Empirical.from_samples(np.arange(FEW))) is None
    assert few_samples(Normal(1.0)) is None
