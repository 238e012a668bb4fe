"""The map of a report: its section, its place, and a verdict that the top of the page does not hide."""

from __future__ import annotations

import re

import numpy as np
import pytest

import precision_pin as pp
from outputs.report_cases import Reader, paper
from precision_pin.analyses.map.figure import map_chapter
from precision_pin.pages.report.page import page

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")]


def test_the_map_has_a_section_and_its_verdict_stands_at_the_top():
    results, without = paper()
    model = results.model
    q = model.configuration("paper")[:, None] + np.outer([0, 1, 0, 0], np.linspace(-1, 1, 30))
    found = pp.map_poses(model, q, specifications=["50 mm", "1 m"], verify=1)
    text = page(results, [map_chapter(found)], missed=["on the map"])
    reader = Reader(text)
    sections = [tag.attributes["id"] for tag in reader.named("section")]
    assert sections[sections.index("map") + 1] == "view"
    assert "#map" in [tag.attributes["href"] for tag in reader.named("a")]
    # nothing stands before the verdict, and its answers are in the same section
    assert "On the map" not in text[: text.index('class="verdict')]
    head = text[text.index('id="verdict"') : text.index('id="assumptions"')]
    kept = [int((found.probability[rank] >= 0.95).sum()) for rank in range(2)]
    verdicts = re.findall(r"On the map: .*?: (MET|NOT MET) - .*?met at (\d+) of 30 poses", head)
    assert verdicts == [("NOT MET", str(kept[0])), ("MET", "30")]
    assert f"On the map: worst pose 'pose {int(np.argmax(found.quantile[1, 0])) + 1}'" in reader.text
    own = text[text.index('id="map"') :]
    worst = int(np.argmax(found.quantile[1, 0]))
    assert f"pose {worst + 1}" in own
    assert f"{1e3 * found.quantile[1, 0, worst]:.4g} mm" in own
    assert "On the map" not in without
    assert 'id="map"' not in without
