"""Correlated parameters in what ``analyze`` prints."""

from __future__ import annotations

import math
from pathlib import Path

SHEET = """\
precision-pin: 1
robot: 4dof.urdf
tip: tool
poses: {paper: -90 3 88 -91 deg}
parameters:
  one: {uniform: 0.05 mm}
  two: {uniform: 0.2 mm}
correlations:
  - {parameters: [one, two], correlation: 0.7}
sources:
  - length: {joint: joint3, parameters: [one]}
  - length: {joint: joint4, parameters: [two]}
"""


def test_scores_and_pearson_are_reported(run, tmp_path: Path) -> None:
    Path("correlated.errors.yaml").write_text(SHEET, encoding="utf-8")
    outcome = run("analyze", "correlated.errors.yaml", "--samples", "100", "--json", "-")
    (group,) = outcome.json["correlations"]
    # two uniform numbers under a Gaussian copula: Pearson = 6/π asin(ρ/2) (Pearson, 1907)
    pearson = 6 / math.pi * math.asin(0.35)
    assert group["parameters"] == ["one", "two"]
    assert group["scores"] == [[1.0, 0.7], [0.7, 1.0]]
    assert abs(group["pearson"][0][1] - pearson) < 1e-9
    text = run("analyze", "correlated.errors.yaml", "--samples", "100", "--all").out
    assert f"correlation of one and two: 0.7 of the normal scores, {pearson:.4g} of the numbers (Pearson)" in text
