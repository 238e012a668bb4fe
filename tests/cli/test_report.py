"""``precision-pin report``: the page, its sections and the exit code."""

import re
from unittest.mock import Mock

import click
import pytest

from cli.conftest import LONG
from precision_pin.cli import report as report_command

pytestmark = pytest.mark.slow
ASKED = ("report", "gantry.errors.yaml", "--quiet", "--samples", "1000", "--out", "page.html")


@pytest.fixture
def report(run, folder):
    """Return the page of a report."""

    def command(*options, code=0):
        outcome = run(*ASKED, *options, code=code)
        assert (outcome.out, [line for line in outcome.err_lines if ": warning " not in line]) == ("", [])
        return (folder / "page.html").read_text("utf-8")

    return command


def test_a_page_says_how_to_make_it_and_names_no_folder(run, folder, new_files):
    files = (f"{folder}/gantry.urdf", f"{folder}/gantry.errors.yaml")
    # met at the first pose, where the turn moves nothing along y
    asked = ("--q", "0 m, 90 deg", "--q", "0 m, 0 deg", "--seed", "7", "--samples", "1000", "--model", "linear")
    outcome = run("report", *files, *asked, "--spec", "y 120 um @ 99 %", "--out", "page.html", code=1)
    assert outcome.out == ""
    assert re.fullmatch(r"wrote page\.html \(\d\.\d MB\)", outcome.err_lines[-1])
    told = re.findall(r"^(\d+)/(\d+) ", outcome.err, re.MULTILINE)
    assert told == [(str(k), str(len(told))) for k in range(1, len(told) + 1)]
    text = (folder / "page.html").read_text("utf-8")
    command = (
        "precision-pin report gantry.urdf gantry.errors.yaml --q &#x27;0 m, 90 deg&#x27; --q &#x27;0 m, 0 deg&#x27; "
        "--samples 1000 --seed 7 --model linear --spec &#x27;y 120 um @ 99 %&#x27; --out report.html"
    )
    assert f"<code>{command}</code>" in text
    assert "linear: the displacements are superposed" in text
    assert str(folder) not in text
    assert new_files() == {"page.html"}


def test_the_command_on_a_page_has_every_option_that_was_given():
    words = ["arm.urdf"]
    for option in report_command.command.params:
        if isinstance(option, click.Option) and option.expose_value:
            kind, text = option.type, "." if option.name == "package_dirs" else "-1 deg, a b"
            value = kind.choices[-1] if isinstance(kind, click.Choice) else "7" if kind is click.INT else text
            for _ in range(2 if option.multiple else 1):
                words += [option.opts[0]] if option.is_flag else [option.opts[0], value]
    given = report_command.command.make_context("report", list(words))
    with given:
        printed = report_command._given()
    again = report_command.command.make_context("report", ["arm.urdf", *printed])
    assert again.params == {**given.params, "out": "report.html"}
    assert None not in given.params.values()


def test_a_page_that_cannot_be_drawn_leaves_the_old_one(run, folder, monkeypatch):
    (folder / "page.html").write_text("old", "utf-8")
    monkeypatch.setattr("precision_pin.pages.report.page.page", Mock(side_effect=KeyboardInterrupt))
    run(*ASKED, code=130)
    assert (folder / "page.html").read_text("utf-8") == "old"


def test_a_limit_missed_on_the_map_or_along_the_path_is_exit_code_1(refused, report, folder):
    (folder / "grid.yaml").write_text(f"joints:\n  y_axis: 0 100 mm\n  {LONG}: 0 30 deg\n")
    (folder / "way.csv").write_text(f"y_axis [mm],{LONG} [deg]\n0,0\n100,30\n")
    at = ("--spec", "y 120 um @ 99 %", "--q", f"y_axis: 0 m, {LONG}: 90 deg")
    page = report("--map", "grid.yaml", *at, "--full", code=1)
    assert "--map grid.yaml" in page
    assert "--full --out report.html" in page
    assert "The specification is met, but not on the map" in page
    # all is open and nothing is kept from the printer, but for the view
    assert re.findall(r'<details class="fold"><summary><h2 id="(\w+)-heading', page) == ["view"]
    assert "not printed" not in page
    page = report("--path", "way.csv", "--iso9283", "poses", *at, code=1)
    for said in (
        "--path way.csv", "--iso9283 poses", "Along the path: spec", 'href="#path"', 'href="#iso9283"',
        "largest error along the path: 95 % of robots within |d|", "95 % of robots built will show AP of",
    ):  # fmt: skip
        assert said in page
    refused(*ASKED[:-2], "--map", "grid.yaml", "--out", "grid.yaml")
    refused(*ASKED[:-2], "--path", "nosuch.csv", "--out", "other.html")


def test_an_allocation_has_a_section_and_its_answer_at_the_head_and_a_compensation_a_section(run, refused, folder):
    (folder / "way.csv").write_text("joint4,joint3,joint2,joint1\n-1.588,1.536,0.0524,-1.571\n-1.4,1.3,0.1,-1.2\n")
    text = (
        "precision-pin: 1\nrobot: 4dof.urdf\ntip: tool\nposes: {paper: -90 3 88 -91 deg}\nsources:\n"
        "  - axis_install: {joint: joint1, radius: 0.1 mm, span: 100 mm}\n"
        "  - length: {frame: tool, parameters: {uniform: 1 mm, mean: 3 mm}}\n"
    )
    entry = "{path: 'axis_install[joint1].radius', cost: {reciprocal: 1 mm}, min: 0.05 mm}"
    (folder / "wanted.yaml").write_text(f"{text}allocate:\n  specs: [3 mm @ 95 %]\n  tolerances: [{entry}]\n")
    asked = ("--samples", "2000", "--allocate", "--out")
    run("report", "wanted.yaml", "--compensate", "way.csv", *asked, "page.html", code=1)
    page = (folder / "page.html").read_text("utf-8")
    assert "Allocation: no allocation was found that meets position.norm 3 mm @ 95 %" in page.replace("&nbsp;", " ")
    for said in (
        'href="#allocation"', "--allocate", "constant part", "axis_install[joint1].radius", 'href="#compensation"',
        "--compensate way.csv",
    ):  # fmt: skip
        assert said in page
    assert "the sheet has no allocate:" in refused("report", "4dof.errors.yaml", *asked, "other.html")
