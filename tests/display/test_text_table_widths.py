"""Columns that names fill on a terminal, beside wcwidth, whose tables are those of terminals."""

from __future__ import annotations

import pytest

from precision_pin.base.errors import visible
from precision_pin.render.text_table import aligned, width

NAMES = (
    "joint1", "関節1", "관절", "é", "e\u0301", "ｱｲｳ", "ｅ", "ไทย", "ที่", "नमस्ते", "שָׁלוֹם", "\u1112\u1161\u11ab", "δ µ °", "🤖",
    "a\u200bb",
)  # fmt: skip


@pytest.mark.parametrize("name", NAMES, ids=ascii)
def test_widths_are_those_of_wcwidth(name):
    wcwidth = pytest.importorskip("wcwidth")
    assert width(visible(name)) == wcwidth.wcswidth(visible(name))


def test_columns_of_names_of_any_script_begin_alike():
    wcwidth = pytest.importorskip("wcwidth")
    lines = aligned([[name, "|"] for name in NAMES])
    assert len({wcwidth.wcswidth(line) for line in lines}) == 1
