"""The table a designer reads: no digit that the samples do not support, units that fit the joint, columns that align."""

from __future__ import annotations

import json
import math
import re
import unicodedata
from decimal import Decimal

import pytest

COLUMNS = ["mean", "std", "min", "max", "mode", "0.5", "0.95", "0.99", "0.9973"]
ROWS = [
    ("|d|", "mm", "position", "norm"), ("dx", "mm", "position", "x"), ("dy", "mm", "position", "y"),
    ("dz", "mm", "position", "z"), ("|δ|", "mrad", "attitude", "norm"), ("δx", "mrad", "attitude", "x"),
    ("δy", "mrad", "attitude", "y"), ("δz", "mrad", "attitude", "z"),
]  # fmt: skip
LONG = "a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage"


def table_and_result(run, folder, *arguments):
    """Return the printed cells by row and column, and the JSON of the same run."""
    outcome = run("analyze", *arguments, "--all", "--json", "result.json")
    lines = outcome.out.splitlines()
    header = ["mean", "std", "min", "max", "mode", "50", "%", "95", "%", "99", "%", "99.73", "%"]
    first = [line.split() for line in lines].index(header) + 1
    cells = {}
    for line, (symbol, unit, vector, part) in zip(lines[first : first + 8], ROWS, strict=True):
        name, printed_unit, *values = line.split()
        assert (name, printed_unit) == (symbol, unit)
        cells[vector, part] = dict(zip(COLUMNS, values, strict=True))
    return cells, json.loads((folder / "result.json").read_text("utf-8"))


def interval(entry: dict, column: str, samples: int) -> tuple[float, float] | None:
    """Return the 95 % interval of a statistic, in m or rad, from closed forms or the JSON; None where there is none."""
    if column in ("min", "max"):
        return entry[column], entry[column]
    if column == "mean":
        if entry["std"] is None or samples < 30:
            return None
        half = 1.959963984540054 * entry["std"] / math.sqrt(samples)
        return entry["mean"] - half, entry["mean"] + half
    return entry["quantile_interval"][column]


@pytest.mark.parametrize(
    "samples", [2, 200, 30_000, *(pytest.param(samples, marks=pytest.mark.slow) for samples in (50, 2_000))]
)
@pytest.mark.parametrize("robot", ["4dof.urdf", pytest.param("gantry.urdf", marks=pytest.mark.slow)])
def test_printed_digits_are_supported(run, folder, robot, samples):
    cells, data = table_and_result(run, folder, robot, "--samples", str(samples))
    for (vector, part), row in cells.items():
        entry = data[vector][part]
        for column in ("mean", "min", "max", "0.5", "0.95", "0.99", "0.9973"):
            ends = interval(entry, column, samples)
            value = entry[column] if column in entry else entry["quantiles"][column]
            if ends is None or value is None:
                assert row[column] == "-", (vector, part, column)
                continue
            printed = Decimal(row[column])
            unit = float(Decimal(1).scaleb(printed.as_tuple().exponent))
            low, value, high = 1e3 * ends[0], 1e3 * value, 1e3 * ends[1]
            assert abs(float(printed) - value) <= unit / 2 * (1 + 1e-9), (vector, part, column)
            # the last digit is the first uncertain one: half an interval is five of its units or less, unless a digit less
            # would be past the nearer end of the interval
            fewer = float(Decimal(value).quantize(Decimal(1).scaleb(printed.as_tuple().exponent + 1)))
            supported = max(high - value, value - low) <= 5 * unit * (1 + 1e-9)
            assert supported or not low <= fewer <= high, (vector, part, column)
            if column not in ("min", "max"):
                assert low - 1e-12 <= float(printed) <= high + 1e-12, (vector, part, column)
            assert len(printed.as_tuple().digits) <= 5
        assert (row["std"] == "-") == (entry["std_interval"] is None)
        assert row["std"] == "-" or samples >= 1000
        assert (row["mode"] == "-") == (entry["mode"] is None)
        if entry["std"] is not None and row["std"] != "-":
            # the standard error of a standard deviation is about std/√(2N) or more for these flat-topped sums; a digit
            # below a tenth of that would be noise
            unit = float(Decimal(1).scaleb(Decimal(row["std"]).as_tuple().exponent))
            assert abs(float(row["std"]) - 1e3 * entry["std"]) <= unit / 2 * (1 + 1e-9)
            assert entry["std"] == 0 or unit > 0.1 * 1e3 * entry["std"] / math.sqrt(4 * samples)


def test_an_axis_without_error_is_exactly_zero(run, folder):
    cells, _ = table_and_result(run, folder, "gantry.urdf", "--samples", "2000")
    assert cells["attitude", "y"] == dict.fromkeys(COLUMNS, "0")


def test_sliding_joints_are_printed_in_mm_and_turning_ones_in_degrees(run):
    first = run("analyze", "gantry.urdf", "--samples", "10", "--all").out.splitlines()[:2]
    # joint and value stay together where the line is folded
    assert first == ["gantry.urdf: frame to tool, pose 'out' (y_axis 250 mm,", f"  {LONG} 30°)"]
    first = run("analyze", "gantry.urdf", "--q", "-1.5 mm, 0.1 deg", "--samples", "10", "--all").out.splitlines()[:2]
    assert first == ["gantry.urdf: frame to tool, pose (y_axis -1.5 mm,", f"  {LONG} 0.1°)"]


def test_no_minus_zero(run):
    for line in run("analyze", "gantry.urdf", "--pose", "home", "--samples", "200").out.splitlines():
        assert "-0," not in line
        assert "-0)" not in line
        assert "-0 " not in line
        assert "-0°" not in line


WRITTEN = {"position.norm": "|d|", "position.x": "|dx|", "position.z": "|dz|", "attitude.x": "|δx|"}


def test_the_spec_line_agrees_with_the_result(run, folder):
    specs = ("40 mm @ 95 %", "36.9 mm @ 50.5 %", "x 1 nm @ 1 %", "z 1 m @ 99.7 %", "rx 16 mrad")
    arguments = [part for spec in specs for part in ("--spec", spec)]
    outcome = run("analyze", "--samples", "1500", *arguments, "--json", "result.json")
    lines = [line for line in outcome.out.splitlines() if line.startswith("spec ")]
    for line, entry in zip(lines, json.loads((folder / "result.json").read_text("utf-8"))["spec"], strict=True):
        head, _, rest = line.partition(": ")
        verdict, _, numbers = rest.partition(" - ")
        numbers, _, index = numbers.partition(", Cpk ")
        assert index == (f"{entry['cpk']:.2f}" if entry["cpk"] is not None else "") or verdict == "UNDECIDED"
        low, high = entry["interval"]
        too_few = "UNDECIDED" if high >= entry["required"] else "NOT MET"
        assert verdict == ("MET" if low >= entry["required"] else too_few)
        unit = 1e3
        assert f" {WRITTEN[entry['quantity']]} within {unit * entry['limit']:.6g} m" in head
        inside, low, high = (Decimal(word) / 100 for word in numbers.replace("%", "").split() if word[0].isdigit())
        step = Decimal(1).scaleb(inside.as_tuple().exponent)
        assert abs(float(inside) - entry["probability"]) <= float(step) / 2 * (1 + 1e-9)
        # rounded outwards, to two digits of the interval's width or as the demand has
        assert float(low) <= entry["interval"][0] < float(low + step)
        assert float(high - step) < entry["interval"][1] <= float(high)
        assert (float(low) >= entry["required"]) == entry["met"]


def test_norms_nominal_and_bandwidth_are_named(run):
    out = run("analyze", "--samples", "2000", "--all").out
    assert "min and max are the smallest and largest seen, not bounds" in out
    assert "mode: peak of the histogram smoothed by |d| " in out
    assert (
        "error with every parameter at its mean: d = (7.691, 28.34, -22.13) mm" in out
    )  # the deflection under gravity


def columns(text: str) -> int:
    return sum(0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in text)


def test_mcpc_columns_align_with_names_of_any_script(run, folder):
    text = (folder / "gantry.urdf").read_text("utf-8")
    (folder / "named.urdf").write_text(text.replace("y_axis", "縦軸").replace(LONG, "gelenk_a\u0308rm"), "utf-8")
    outcome = run("mcpc", "named.urdf")
    assert outcome.code == 0
    header, *rows = outcome.out.splitlines()
    names = ("base", "縦軸 \\(slides\\)", "gelenk_a\u0308rm")
    assert len(rows) == len(names)
    # the first column of numbers is flush right below its heading
    ends = {columns(header[: header.index("offset °") + len("offset °")])}
    for row, name in zip(rows, names, strict=True):
        cell = re.match(rf"\d +{name} +-?[\d.]+", row)
        assert cell is not None, row
        ends.add(columns(cell[0]))
    assert len(ends) == 1
