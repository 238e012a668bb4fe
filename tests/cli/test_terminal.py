"""What is printed: verdicts in colour, sentences folded, rows whole, no digit that the samples do not support."""

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
def printed(monkeypatch):
    """Return what is printed in a terminal of 80 columns without colours."""
    for module in ("terminal", "streams"):
        monkeypatch.setattr(f"precision_pin.cli.{module}.count_columns", lambda _: 80)
    monkeypatch.setenv("NO_COLOR", "1")
    texts = []
    monkeypatch.setattr("precision_pin.cli.terminal.echo_data", texts.append)
    return texts


@pytest.mark.parametrize(
    ("is_terminal", "no_color", "coloured"), [(True, "", True), (True, "1", False), (False, "", False)]
)
def test_verdicts_are_coloured_on_a_terminal_only(monkeypatch, is_terminal, no_color, coloured):
    text = "spec |d| within 1 mm for 95 %: NOT MET - 3 % inside\nspec |dx| within 1 mm for 95 %: MET - 99 % inside"
    monkeypatch.setenv("NO_COLOR", no_color)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: is_terminal)
    printed = []
    monkeypatch.setattr("precision_pin.cli.terminal.echo_data", printed.append)
    echo_table(text)
    red, green = click.style("NOT MET", fg="red", bold=True), click.style("MET", fg="green", bold=True)
    assert printed == [text.replace("MET", green).replace(f"NOT {green}", red) if coloured else text]


def test_sentences_are_folded_and_rows_are_not(capsys):
    joints = ", ".join(f"joint_{k} -{k}0.5°" for k in range(12))
    row = "  ".join(f"cell{k}" for k in range(20))
    echo_table(f"arm.urdf: base to tool, pose ({joints})\n{row}")
    *folded, last = capsys.readouterr().out.splitlines()
    assert last == row
    assert max(map(len, folded)) <= WIDTH
    assert " ".join(line.strip() for line in folded) == f"arm.urdf: base to tool, pose ({joints})"
    # a joint and its value are in one line
    assert all(line.endswith((",", ")")) for line in folded)


def test_a_script_without_a_terminal_is_told_of_compiling(capsys):
    with compilation() as show:
        show(0.5)
    assert (
        capsys.readouterr().err
        == "precision-pin: compiling the sampler for this kind of model, once on this machine: some 8 s\n"
    )


def test_a_terminal_has_whole_rows_of_tables_and_lines_of_its_width(printed):
    names, heads = [f"frame[joint_{k}].x" for k in range(7)], [f"no {j}" for j in range(14)]
    cells = {(name, head): f"{head[3:]}.{k:04d}" for k, name in enumerate(names) for head in heads}
    rows = ([name, "mm", *(cells[name, head] for head in heads)] for name in names)
    sentence = "|d| within 40 mm for 95 % of robots; " * 5
    echo_table("\n".join([sentence, *aligned([["draw", "", *heads], *rows]), "sum: 1 mm"]))
    lines = printed[0].split("\n")
    assert max(map(len, lines)) <= 80
    # each block names its rows, and together they hold every cell once, below its heading
    found = {}
    for line in lines:
        if line.startswith("draw"):
            heads = re.findall(r"no \d+", line)
        elif line.startswith("frame["):
            name, *values = re.split(r" {2,}", line.replace("  mm", ""))
            found |= {(name, head): value for head, value in zip(heads, values, strict=True)}
    assert found == cells
    assert not any(line.endswith((" 40", " 95")) for line in lines)


def test_long_names_go_on_below_where_that_is_enough():
    long = "joint_compliance[shoulder_lift_joint].compliance"
    head = ["draw", "tolerance", "share %", "ST %"]
    rows = aligned([head, [long, "±1 mm", "12.30", "1.2 ± 0.1"], ["縦軸", "", "1", ""]])
    lines = folded(rows, 72)
    assert max(map(width, lines)) <= 72
    assert [line.split() for line in lines] == [
        ["draw", "tolerance", "share", "%", "ST", "%"],
        ["joint_compliance[shoulder_lift_joint]", "±1", "mm", "12.30", "1.2", "±", "0.1"],
        [".compliance"],
        ["縦軸", "1"],
    ]
    assert folded(rows, 100) == rows


TABLE = "\n".join(aligned([["draw", "", "share"], *([f"draw {k}", "mm", f"{k}.5"] for k in range(30))]))
RESULT = f"""worst pose 'far': NOT said in one row, {"for it goes on " * 6}

arm.urdf: base to tool, pose 'far' (shoulder_pan_joint 10°, elbow_joint -20.5°, quill -3 mm)

{TABLE}

what the columns are
rests on assumptions: 1 of 2 sources are marked as assumed in the sheet (beam)
they cause 1 % of the variance of the position, 2 % of the attitude"""
JUDGED = RESULT.replace("what", "spec |d| within 3 mm: MET - 99 % inside\nspec |d| within 1 mm: NOT MET\nwhat")


def test_a_low_terminal_has_the_answer_first_and_last(printed, monkeypatch):
    monkeypatch.setattr("precision_pin.cli.terminal.count_rows", lambda _: 24)

    def shown(text, is_whole):
        context = click.Context(click.Command("any"))
        context.params = {"is_whole": is_whole}
        with context:
            echo_table(text)
        return printed.pop().split("\n")

    for text, ends in (
        (RESULT, RESULT.partition("\n")[0].strip()),
        (JUDGED, "|d| within 1 mm: NOT MET |d| within 3 mm: MET"),
    ):
        lines = shown(text, False)
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
        rows = [line.split() for line in lines if line.startswith("draw ")]
        assert rows[1:] == [["draw", str(k), "mm", f"{k}.5"] for k in range(len(rows) - 1)]
        whole = shown(text, True)
        assert sum(line.startswith("draw ") for line in whole) == 31
        assert "what the columns are" in whole


@pytest.mark.slow
def test_an_answer_fits_a_screen_and_ends_with_the_verdict(run, monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    for module in ("terminal", "streams"):
        monkeypatch.setattr(f"precision_pin.cli.{module}.count_columns", lambda _: 80)
    asked = ("analyze", "example:panda", "--samples", "5000", "--spec", "5 mm @ 95 %")
    brief = run(*asked, code=1)
    lines = [*brief.err_lines, *brief.out.splitlines()]
    assert len(lines) <= 23  # and a row for the prompt
    assert max(map(len, lines)) <= 80
    (first,) = [line for line in lines if line.startswith("spec ")]
    assert lines[-1].startswith(first[5:].partition(" - ")[0])
    assert "tolerance bounds:" not in brief.out
    whole = run(*asked, "--all", code=1).out
    assert whole.splitlines()[-1] == lines[-1]
    assert "tolerance bounds:" in whole
    several = run(*asked, "--all-poses", code=1)
    assert len(several.lines) <= 23
    assert " - worst pose " in "".join(several.out.splitlines()[-2:])


@pytest.mark.slow
def test_a_shipped_sheet_gives_no_warning_and_its_result_lists_what_it_accepts(run):
    outcome = run("analyze", "example:ur5", "--samples", "50", "--json", "-")
    assert [line for line in outcome.err_lines if "with the sheet" not in line] == []
    assert outcome.json["warnings"]
    assert all(": note W_" in line and "; accepted: " in line for line in outcome.json["warnings"])


@pytest.mark.slow
def test_a_urdf_has_one_line_in_a_command_and_all_in_check(run, folder):
    sheet = (
        "precision-pin: 1\nrobot: example:ur5\ntip: tool0\nposes: {p: 0 -90 90 -90 -90 0 deg}\n"
        "sources:\n  - encoder: {joint: elbow_joint, resolution: 1 mrad}\n"
    )
    (folder / "a.yaml").write_text(sheet, "utf-8")
    (folder / "b.yaml").write_text(sheet.replace("1 mrad", "2 mrad"), "utf-8")
    line = "example:ur5: 1 warning (W_MASS_ZERO); precision-pin check example:ur5 lists it"
    assert run("compare", "a.yaml", "b.yaml", "--samples", "100").err_lines == [line]
    (listed,) = [one for one in run("check", "a.yaml").out.splitlines() if "W_MASS_ZERO" in one]
    assert listed.startswith("example:ur5:")
    assert run("analyze", "a.yaml", "--samples", "50", "--all-warnings").err_lines == [listed]


@pytest.mark.slow
def test_warnings_of_one_code_are_one_line_unless_all_are_asked_for(run, folder):
    drafted = run("init", "example:xarm7", "--tip", "link7", "--out", "seven.yaml")
    (line,) = [line for line in drafted.err_lines if "W_ANGLE_ROUNDED" in line]
    assert line.endswith("; and 5 more W_ANGLE_ROUNDED: --all-warnings")
    asked = ("analyze", "seven.yaml", "--samples", "50")
    summary = "example:xarm7: 6 warnings (W_ANGLE_ROUNDED); precision-pin check example:xarm7 lists them"
    assert run(*asked).err_lines == [summary]
    lines = [line for line in run(*asked, "--all-warnings").err_lines if "W_ANGLE_ROUNDED" in line]
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


def test_norms_nominal_and_bandwidth_are_named(run):
    out = run("analyze", "--samples", "2000", "--all").out
    assert "min and max are the smallest and largest seen, not bounds" in out
    assert "mode: peak of the histogram smoothed by |d| " in out
    # the deflection under gravity
    assert "error with every parameter at its mean: d = (7.691, 28.34, -22.13) mm" in out


def test_the_spec_line_agrees_with_the_result(run, folder):
    specs = ("40 mm @ 95 %", "36.9 mm @ 50.5 %", "x 1 nm @ 1 %", "z 1 m @ 99.7 %", "rx 16 mrad")
    asked = [part for spec in specs for part in ("--spec", spec)]
    outcome = run("analyze", "--samples", "1500", *asked, "--json", "result.json", code=1)
    lines = [line for line in outcome.out.splitlines() if line.startswith("spec ")]
    written = {"position.norm": "|d|", "position.x": "|dx|", "position.z": "|dz|", "attitude.x": "|δx|"}
    for line, entry in zip(lines, json.loads((folder / "result.json").read_text("utf-8"))["spec"], strict=True):
        head, _, rest = line.partition(": ")
        verdict, _, numbers = rest.partition(" - ")
        numbers, _, index = numbers.partition(", Cpk ")
        assert index == (f"{entry['cpk']:.2f}" if entry["cpk"] is not None else "") or verdict == "UNDECIDED"
        low, high = entry["interval"]
        too_few = "UNDECIDED" if high >= entry["required"] else "NOT MET"
        assert verdict == ("MET" if low >= entry["required"] else too_few)
        assert f" {written[entry['quantity']]} within {1e3 * entry['limit']:.6g} m" in head
        inside, low, high = (Decimal(word) / 100 for word in numbers.replace("%", "").split() if word[0].isdigit())
        step = Decimal(1).scaleb(inside.as_tuple().exponent)
        assert abs(float(inside) - entry["probability"]) <= float(step) / 2 * (1 + 1e-9)
        # rounded outwards, to two digits of the interval's width or as the demand has
        assert float(low) <= entry["interval"][0] < float(low + step)
        assert float(high - step) < entry["interval"][1] <= float(high)
        assert (float(low) >= entry["required"]) == entry["met"]
