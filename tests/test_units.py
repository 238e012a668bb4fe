"""Numbers with units: every unit against pint, and what is refused."""

import itertools
import math
import pickle

import numpy as np
import pytest

from precision_pin.base import units
from precision_pin.base.errors import UnitError

EVERY_UNIT = [(quantity, unit) for quantity in units.QUANTITIES for unit in quantity.units]


def test_quantities_are_distinct_frozen_and_can_be_sent_to_workers():
    assert len(set(units.QUANTITIES)) == len(units.QUANTITIES)
    per_joint = units.PerJoint(units.ANGLE, units.LENGTH)
    assert {per_joint: 1}[units.PerJoint(units.ANGLE, units.LENGTH)] == 1
    assert (per_joint.revolute, per_joint.prismatic) == (units.ANGLE, units.LENGTH)
    for quantity in units.QUANTITIES:
        arrived = pickle.loads(pickle.dumps(quantity))
        assert (arrived, hash(arrived)) == (quantity, hash(quantity))
        with pytest.raises(TypeError):
            arrived.units["furlong"] = 201.168


def test_factors_are_those_of_pint():
    import pint

    registry = pint.UnitRegistry()
    for quantity, unit in EVERY_UNIT:
        # a difference of temperatures: for pint a degC of its own
        expected = registry.Quantity(1.0, unit.replace("degC", "delta_degC")).to(quantity.si).magnitude
        assert units.parse(f"1 {unit}", quantity) == pytest.approx(expected, rel=4e-16), (quantity.name, unit)
        glued = f"-2.5e-3{' ' if unit.startswith('1') else ''}{unit}"
        assert units.split(f"1 {unit}") == ([1.0], unit)
        assert units.parse(glued, quantity) == pytest.approx(-2.5e-3 * expected, rel=1e-15), (quantity.name, unit)
    assert {quantity.units[quantity.si] for quantity in units.QUANTITIES} == {1.0}


@pytest.mark.parametrize(
    ("text", "quantity", "expected"),
    [
        ("50 µm", units.LENGTH, 5e-5),
        ("50 μm", units.LENGTH, 5e-5),
        ("50um", units.LENGTH, 5e-5),
        ("  1e-4\tm ", units.LENGTH, 1e-4),
        ("+.5 mm", units.LENGTH, 5e-4),
        ("5. mm", units.LENGTH, 5e-3),
        ("1\u00a0mm", units.LENGTH, 1e-3),
        ("180°", units.ANGLE, math.pi),
        ("8 kN·m²", units.BENDING_RIGIDITY, 8000),
        ("8 kN * m ^ 2", units.BENDING_RIGIDITY, 8000),
        ("8000 N*m**2", units.BENDING_RIGIDITY, 8000),
        ("3 Nm/rad", units.ANGULAR_STIFFNESS, 3),
        ("1 µrad/(Nm)", units.ANGULAR_COMPLIANCE, 1e-6),
        ("12e-6 1 / degC", units.THERMAL_EXPANSION, 12e-6),
        ("23 µm/(m·K)", units.THERMAL_EXPANSION, 23e-6),
        ("0.5", units.RATIO, 0.5),
        ("50 %", units.RATIO, 0.5),
        (0.25, units.RATIO, 0.25),
        (np.float64(0.25), units.RATIO, 0.25),
    ],
)
def test_parse(text, quantity, expected):
    assert units.parse(text, quantity) == pytest.approx(expected, rel=4e-16)


MALFORMED = """mm|nan mm|inf mm|-inf|1e400 mm|1,5 mm|1, 5 mm|0,05 mm|,5 mm|1.2.3 mm|1e mm|--1 mm|+-1 mm|1 - 2 mm|1 ± 0.1 mm
0x10 mm|1_000 mm|1'000 mm|١ mm|½ mm|1/2 mm|(1) mm|1 2 mm|1 mm 2|1 mm mm|1 mm,|1 mM|1 MM|1 Mm|1 metre|3 "|1 m m|1 e3 mm
0.05 mm # x| |"""


def test_malformed_length_is_refused_in_one_line():
    for text in [*MALFORMED.replace("\n", "|").split("|"), True, None, [1], {"mm": 1}, b"1 mm"]:
        with pytest.raises(UnitError) as caught:
            units.parse(text, units.LENGTH)
        assert "\n" not in str(caught.value)
    for text in ("1 2 mm", "1 2 3 4 mm", "1,2,3 mm", "1, 2, 3 mm", "1 mm 2 mm 3 mm", "1 2 nan mm", "1 2 3"):
        with pytest.raises(UnitError):
            units.parse_vector(text, units.LENGTH, count=3)
    # the one of a reciprocal is no number
    for text in ("12e-61/K", "12e-6 /K", "1 2 1/K", "12e-6 2/K", "1/K"):
        with pytest.raises(UnitError):
            units.parse(text, units.THERMAL_EXPANSION)


def test_bare_number_is_refused_and_the_units_are_listed():
    for text, quantity in itertools.product(("0.05", "-1e-3", 5), set(units.QUANTITIES) - {units.RATIO}):
        with pytest.raises(UnitError, match="has no unit") as caught:
            units.parse(text, quantity)
        assert all(unit in str(caught.value) for unit in quantity.units)
    assert [finding.code for finding in caught.value.findings] == ["E_UNIT"]


def test_every_unit_of_another_quantity_is_refused():
    for quantity, (other, unit) in itertools.product(units.QUANTITIES, EVERY_UNIT):
        if other is not quantity:
            with pytest.raises(UnitError):
                units.parse(f"1 {unit}", quantity)


def test_number_too_large_or_small_in_si_is_refused():
    for text, quantity in (
        ("1e308 kN/um", units.LINEAR_STIFFNESS),
        ("-1e48 t", units.MASS),
        ("1.1e50", units.RATIO),
        ("9e-48 mm", units.LENGTH),
    ):
        with pytest.raises(UnitError, match=r"too (large; at most 1e[+]50|small; at least 1e-50)"):
            units.parse(text, quantity)


def test_unit_decides_between_quantities():
    either = (units.ANGULAR_COMPLIANCE, units.LINEAR_COMPLIANCE)
    assert units.parse("1 mrad/(N*m)", *either) == 1e-3
    assert units.parse("1 um/N", *either) == 1e-6
    with pytest.raises(UnitError, match="angular compliance or linear compliance"):
        units.parse("1 mm", *either)


def test_vector():
    assert units.parse_vector("-90 3 88 -91 deg", units.ANGLE) == np.radians([-90, 3, 88, -91]).tolist()
    assert units.parse_vector("0 0 -9.81 m/s^2", units.ACCELERATION, count=3) == [0, 0, -9.81]
    assert units.parse_vector("1 2", units.RATIO) == [1, 2]
