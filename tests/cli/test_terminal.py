"""What is printed: verdicts in colour, sentences folded, rows whole, no digit that the samples do not support."""

from __future__ import annotations

import json
import re
import sys
from decimal import Decimal

import click
import pytest

from cli.conftest import LONG
from precision_pin.base.progress import compilation
from precision_pin.cli.terminal import WIDTH, echo_table
from precision_pin.render.text_table import aligned, folded, width

# a terminal ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return what is printed in a terminal of 80 columns without colours."""
    for module in ("terminal", "streams"):
        monkeypatch.setattr(f"precision_pin.cli.{module}.count_columns", lambda _: 80)
    monkeypatch.setenv("NO_COLOR", "1")
    texts: list[str] = []
    monkeypatch.setattr("precision_pin.cli.terminal.echo_data", texts.append)
    return texts


@pytest.mark.parametrize(
    ("is_terminal", "no_color", "coloured"), [(True, "", True), (True, "1", False), (False, "", False)]
)
def test_verdicts_are_coloured_on_a_terminal_only(monkeypatch, is_terminal, no_color, coloured) -> None:
    text = "spec |d| within 1 mm for 95 %: NOT MET - 3 % inside\nspec |dx| within 1 mm for 95 %: MET - 99 % inside"
    monkeypatch.setenv("NO_COLOR", no_color)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: is_terminal)
    printed: list[str] = []
    monkeypatch.setattr("precision_pin.cli.terminal.echo_data", printed.append)
    echo_table(text)
    red, green = click.style("NOT MET", fg="red", bold=True), click.style("MET", fg="green", bold=True)
    expected = text.replace("MET", green).replace(f"NOT {green}", red) if coloured else text
    assert printed == [expected]


def test_sentences_are_folded_and_rows_are_not(capsys: pytest.CaptureFixture[str]) -> None:
    joints = ", ".join(f"joint_{k} -{k}0.5°" for k in range(12))
    row = "  ".join(f"cell{k}" for k in range(20))
    echo_table(f"arm.urdf: base to tool, pose ({joints})\n{row}")
    *folded, last = capsys.readouterr().out.splitlines()
    assert last == row
    assert max(map(len, folded)) <= WIDTH
    assert " ".join(line.strip() for line in folded) == f"arm.urdf: base to tool, pose ({joints})"
    # a joint and its value are in one line
    assert all(line.endswith((",", ")")) for line in folded)


def test_a_script_without_a_terminal_is_told_of_compiling(capsys: pytest.CaptureFixture[str]) -> None:
    with compilation() as show:
        show(0.5)
    assert capsys.readouterr().err == "precision-pin: compiling the sampler, once on this machine: some 8 s\n"


def test_a_terminal_has_whole_rows_of_tables_and_lines_of_its_width(printed) -> None:
    names = [f"frame[joint_{k}].x" for k in range(7)]
    cells = [[f"{j}.{k:04d}" for j in range(14)] for k in range(7)]
    header = ["draw", "", *(f"no {j}" for j in range(14))]
    table = aligned([header, *([name, "mm", *row] for name, row in zip(names, cells, strict=True))])
    sentence = "|d| within 40 mm for 95 % of robots; " * 5
    echo_table("\n".join([sentence, *table, "sum: 1 mm"]))
    lines = printed[0].split("\n")
    assert max(map(len, lines)) <= 80
    # each block names its rows, and together they hold every cell once, below its heading
    found: dict[tuple[str, str], str] = {}
    heads: list[str] = []
    for line in lines:
        if line.startswith("draw"):
            heads = re.findall(r"no \d+", line)
        elif line.startswith("frame["):
            name, *values = re.split(r" {2,}", line.replace("  mm", ""))
            found |= {(name, head): value for head, value in zip(heads, values, strict=True)}
    assert found == {(name, f"no {j}"): cells[k][j] for k, name in enumerate(names) for j in range(14)}
    assert not any(line.endswith((" 40", " 95")) for line in lines)


def test_long_names_go_on_below_where_that_is_enough() -> None:
    long = "joint_compliance[shoulder_lift_joint].compliance"
    rows = aligned(
        [["draw", "tolerance", "share %", "ST %"], [long, "±1 mm", "12.30", "1.2 ± 0.1"], ["縦軸", "", "1", ""]]
    )
    lines = folded(rows, 72)
    assert max(map(width, lines)) <= 72
    assert [line.split() for line in lines] == [
        ["draw", "tolerance", "share", "%", "ST", "%"],
        ["joint_compliance[shoulder_lift_joint]", "±1", "mm", "12.30", "1.2", "±", "0.1"],
        [".compliance"],
        ["縦軸", "1"],
    ]
    assert folded(rows, 100) == rows


RESULT = "\n".join(
    [
        "worst pose 'far': NOT said in one row, " + "for it goes on " * 6,
        "",
        "arm.urdf: base to tool, pose 'far' (shoulder_pan_joint 10°, elbow_joint -20.5°, quill -3 mm)",
        "",
        *aligned([["draw", "", "share"], *([f"draw {k}", "mm", f"{k}.5"] for k in range(30))]),
        "",
        "what the columns are",
        "rests on assumptions: 1 of 2 sources are marked as assumed in the sheet (beam)",
        "they cause 1 % of the variance of the position, 2 % of the attitude",
    ]
)


@pytest.mark.parametrize(
    ("text", "ends"),
    [
        (RESULT, RESULT.partition("\n")[0].strip()),
        (
            RESULT.replace("what", "spec |d| within 3 mm: MET - 99 % inside\nspec |d| within 1 mm: NOT MET\nwhat"),
            "|d| within 1 mm: NOT MET |d| within 3 mm: MET",
        ),
    ],
    ids=["first sentence", "verdict"],
)
def test_a_low_terminal_has_the_answer_first_and_last(printed, monkeypatch, text: str, ends: str) -> None:
    monkeypatch.setattr("precision_pin.cli.terminal.count_rows", lambda _: 24)

    def command(is_whole: bool) -> list[str]:
        context = click.Context(click.Command("any"))
        context.params = {"is_whole": is_whole}
        with context:
            echo_table(text)
        return printed.pop().split("\n")

    lines = command(False)
    # a row for the prompt
    assert len(lines) == 23
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith("worst pose 'far'")
    last = next(k for k, line in enumerate(lines) if line.startswith("--all prints "))
    assert " ".join(line.strip() for line in lines[last + 1 :]) == ends
    assert "arm.urdf: base to tool, pose 'far' (10°, -20.5°, -3 mm)" in lines
    assert " ".join(line.strip() for line in lines[last - 2 : last]) == (
        "rests on assumptions: 1 of 2 sources are marked as assumed in the sheet; they cause 1 % of the variance of the "
        "position, 2 % of the attitude"
    )
    # rows of the table in their order, from the first
    shown = [line.split() for line in lines if line.startswith("draw ")]
    assert shown[1:] == [["draw", str(k), "mm", f"{k}.5"] for k in range(len(shown) - 1)]
    whole = command(True)
    assert sum(line.startswith("draw ") for line in whole) == 31
    assert "what the columns are" in whole


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["", "example:panda"])
def test_an_answer_fits_a_screen_and_ends_with_the_verdict(run, monkeypatch: pytest.MonkeyPatch, robot: str) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr("precision_pin.cli.terminal.count_columns", lambda _: 80)
    monkeypatch.setattr("precision_pin.cli.streams.count_columns", lambda _: 80)
    arguments = [*filter(None, [robot]), "--samples", "5000", "--spec", "5 mm @ 95 %"]
    brief = run("analyze", *arguments)
    lines = [*brief.err_lines, *brief.out.splitlines()]
    assert len(lines) <= 23  # and a row for the prompt
    assert max(map(len, lines)) <= 80
    (first,) = [line for line in lines if line.startswith("spec ")]
    assert lines[-1].startswith(first[5:].partition(" - ")[0])
    assert "tolerance bounds:" not in brief.out
    whole = run("analyze", *arguments, "--all").out
    assert whole.splitlines()[-1] == lines[-1]
    assert "tolerance bounds:" in whole
    assert "joint1 -90°" in whole or robot
    several = run("analyze", *arguments, "--all-poses") if robot else brief
    assert len([*several.err_lines, *several.out.splitlines()]) <= 23
    assert " - worst pose " in several.out.splitlines()[-2] + several.out.splitlines()[-1] or not robot


@pytest.mark.slow
def test_a_shipped_sheet_gives_no_warning_and_its_result_lists_what_it_accepts(run) -> None:
    outcome = run("analyze", "example:ur5", "--samples", "50", "--json", "-")
    assert [line for line in outcome.err_lines if "with the sheet" not in line] == []
    assert outcome.json["warnings"]
    assert all(": note W_" in line and "; accepted: " in line for line in outcome.json["warnings"])


@pytest.mark.slow
def test_a_urdf_has_one_line_in_a_command_and_all_in_check(run, folder) -> None:
    sheet = (
        "robot: example:ur5\ntip: tool0\nposes: {p: 0 -90 90 -90 -90 0 deg}\n"
        "sources:\n  - encoder: {joint: elbow_joint, resolution: 1 mrad}\n"
    )
    (folder / "a.yaml").write_text(f"precision-pin: 1\n{sheet}", "utf-8")
    (folder / "b.yaml").write_text(f"precision-pin: 1\n{sheet.replace('1 mrad', '2 mrad')}", "utf-8")
    line = "example:ur5: 1 warning (W_MASS_ZERO); precision-pin check example:ur5 lists it"
    assert run("compare", "a.yaml", "b.yaml", "--samples", "100").err_lines == [line]
    (listed,) = [one for one in run("check", "a.yaml").out.splitlines() if "W_MASS_ZERO" in one]
    assert listed.startswith("example:ur5:")
    (spelled,) = run("analyze", "a.yaml", "--samples", "50", "--all-warnings").err_lines
    assert spelled == listed


@pytest.mark.slow
def test_warnings_of_one_code_are_one_line_unless_all_are_asked_for(run, folder) -> None:
    drafted = run("init", "example:xarm7", "--tip", "link7", "--out", "seven.yaml")
    lines = [line for line in drafted.err_lines if "W_ANGLE_ROUNDED" in line]
    assert len(lines) == 1
    assert lines[0].endswith("; and 5 more W_ANGLE_ROUNDED: --all-warnings")
    one = run("analyze", "seven.yaml", "--samples", "50")
    assert one.err_lines == [
        "example:xarm7: 6 warnings (W_ANGLE_ROUNDED); precision-pin check example:xarm7 lists them"
    ]
    every = run("analyze", "seven.yaml", "--samples", "50", "--all-warnings")
    lines = [line for line in every.err_lines if "W_ANGLE_ROUNDED" in line]
    assert len(lines) == 6
    assert not any("--all-warnings" in line for line in lines)


# the table -----------------------------------------------------------------------------------------------------------


def test_joints_in_their_units_and_zeros_without_sign(run):
    out = run("analyze", "gantry.urdf", "--samples", "2000", "--all").out
    row = next(line.split() for line in out.splitlines() if line.startswith("δy  "))
    assert row == ["δy", "mrad", *["0"] * 9]
    # joint and value stay together where the line is folded
    assert out.splitlines()[:2] == ["gantry.urdf: frame to tool, pose 'out' (y_axis 250 mm,", f"  {LONG} 30°)"]
    out = run("analyze", "gantry.urdf", "--q", "-1.5 mm, 0.1 deg", "--samples", "10", "--all").out
    assert out.splitlines()[:2] == ["gantry.urdf: frame to tool, pose (y_axis -1.5 mm,", f"  {LONG} 0.1°)"]
    assert not re.search(r"-0[,) °]", run("analyze", "gantry.urdf", "--pose", "home", "--samples", "200").out)


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
