"""Specifications as text: all names that tables print, and slips that give an error instead of a wrong verdict."""

from __future__ import annotations

import time

import pytest

from precision_pin.base.errors import InputError
from precision_pin.render.tables import symbol
from precision_pin.statistics import QUANTITIES
from precision_pin.statistics.plan import specification
from precision_pin.statistics.precision import target


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_every_name_of_the_tables_is_taken(quantity: str) -> None:
    unit = "mm" if quantity.startswith("position") else "mrad"
    for name in (quantity, symbol(quantity)):
        for text in (
            f"{name} 0.2 {unit} @ 99 %",
            f"{name} ≤ 0.2{unit} @ 0.99",
            f"{name}<=0.2 {unit}@99%",
            f" {name} < 0.2 {unit} @ 99 % ",
        ):
            found = specification(text)
            assert (found.quantity, found.limit, found.required) == (quantity, pytest.approx(2e-4), pytest.approx(0.99))
        assert target(f"{name} 95 % to 0.01 {unit}").quantity == quantity
        assert target(f"{name} mean to 1 %").quantity == quantity


def test_an_absolute_value_may_be_written_so() -> None:
    assert specification("|dz| ≤ 0.3 mm") == specification("z 0.3 mm")
    assert specification("|position.z| 0.3 mm") == specification("z 0.3 mm")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1 mm @ 95", "did you mean '95 %'?"),
        ("1 mm @ 99.9", "did you mean '99.9 %'?"),
        ("1 mm @ 1", "no number of samples shows that all robots are inside"),
        ("1 mm @ 100 %", "no number of samples shows that all robots are inside"),
        ("1 mm @ 120", "above 0 and below 1"),
        ("1 mm @ 0", "above 0 and below 1"),
        ("1 mm @ -95", "above 0 and below 1"),
        ("1 mm @ 0.95 %", "did you mean '95 %'? (or the plain ratio 0.0095)"),
        ("1 mm @ 0.9973%", "did you mean '99.73 %'?"),
        ("0.3", "'0.3' has no unit: '0.3 mm' limits the position, '0.3 mrad' the attitude"),
        ("x 0.3 @ 95 %", "'0.3' has no unit"),
        ("1 mm @", "write it as"),
        ("mm", "expected a number with a unit"),
        ("inf mm", "expected a number with a unit"),
        ("dw 1 mm", "no quantity of a specification named 'dw'"),
        ("dx 1 mrad", "dx is limited by a length"),
        ("|δ| 1 mm", "|δ| is limited by an angle"),
        ("5 rad", "no attitude error is larger than half a turn; did you mean deg, or mrad?"),
        ("rx 200 deg", "no attitude error is larger than half a turn; did you mean mrad?"),
    ],
)
def test_slips_get_one_line(text: str, says: str) -> None:
    with pytest.raises(InputError) as raised:
        specification(text)
    assert says in str(raised.value)
    assert "\n" not in str(raised.value)


def test_less_than_one_per_cent_can_be_asked_for() -> None:
    assert specification("1 mm @ 0.0095").required == 0.0095
    assert specification("1 mm @ 1 %").required == 0.01
    assert target("0.135 % to 1 mm").statistic == pytest.approx(0.00135)


@pytest.mark.parametrize(
    ("text", "says"), [("95 to 0.01 mm", "did you mean '95 %'?"), ("95 % to 0.01", "the tolerance 0.01 has no unit")]
)
def test_slips_in_targets(text: str, says: str) -> None:
    with pytest.raises(InputError) as raised:
        target(text)
    assert says in str(raised.value)


@pytest.mark.parametrize(
    "text",
    [" " * 50_000 + "x", "x" + " " * 50_000 + "@", "a." * 50_000 + "1", "|" * 50_000, "1 mm" + " " * 50_000 + "é"],
)
def test_long_texts_take_no_time(text: str) -> None:
    begun = time.perf_counter()
    for read in (specification, target):
        with pytest.raises(InputError):
            read(text)
    assert time.perf_counter() - begun < 1
