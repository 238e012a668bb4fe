"""``precision-pin report``."""

from __future__ import annotations

import re

import pytest

LONG = "a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage"
FEW = ("--samples", "2000")


@pytest.mark.slow
def test_a_page_is_written_the_same_each_time_and_says_how_to_make_it(run, folder, new_files):
    arguments = ("report", "gantry.urdf", "gantry.errors.yaml", "--pose", "home", "--seed", "7", *FEW)
    outcome = run(*arguments, "--out", "page.html")
    assert (outcome.code, outcome.out) == (0, "")
    assert re.fullmatch(r"wrote page\.html \(\d\.\d MB\)", outcome.err_lines[-1])
    assert [line[:3] for line in outcome.err_lines[:-1] if re.match(r"\d/\d ", line)] == [f"{k}/7" for k in range(1, 8)]
    text = (folder / "page.html").read_text("utf-8")
    command = (
        "precision-pin report gantry.urdf gantry.errors.yaml --pose home --samples 2000 --seed 7 --model exact "
        "--out report.html"
    )
    assert f"<code>{command}</code>" in text
    assert str(folder) not in text
    (folder / "below").mkdir()
    assert run(*arguments, "--out", "below/again.html").code == 0
    assert (folder / "below" / "again.html").read_text("utf-8") == text
    assert new_files() == {"page.html", "below", "below/again.html"}


@pytest.mark.slow
def test_exit_code_says_whether_the_specifications_are_met(run, folder):
    arguments = ("report", f"{folder}/gantry.urdf", f"{folder}/gantry.errors.yaml", *FEW, "--out", "page.html")
    assert run(*arguments, "--spec", "1 m").code == 0
    assert "The specification is met" in (folder / "page.html").read_text("utf-8")
    outcome = run(
        *arguments, "--spec", "1 m", "--spec", "1 um", "--q", f"y_axis: 0.1 m, {LONG}: 10 deg", "--model", "linear"
    )
    assert outcome.code == 1
    text = (folder / "page.html").read_text("utf-8")
    assert "1 of 2 specifications are met" in text
    assert "linear: the displacements are superposed" in text
    # folders of the command line are left out, too
    assert str(folder) not in text
    assert "precision-pin report gantry.urdf gantry.errors.yaml --q &#x27;y_axis: 0.1 m, " in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--out", "page.html", "--samples", "0"), "number of samples"),
        (("--out", "page.html", "--seed", "-1"), "seed"),
        (("--out", "page.html", "--spec", "1 kg"), "'1 kg'"),
        (("--out", "page.html", "--pose", "nowhere"), "no pose named 'nowhere'"),
        (("--out", "page.html", "--pose", "paper", "--q", "1 2 3 4 deg"), "exclude each other"),
        (("--out", "page.html", "--all-poses", "--pose", "paper"), "--pose and --all-poses exclude each other"),
        (("--out", "page.html", "missing.yaml"), "does not exist"),
        (("--out", "page.html", "--model", "best"), "best"),
        (("--out", "nowhere/page.html"), "does not exist"),
        (("--out", "4dof.urdf/"), "it is a file"),
        (("--out", ""), "--out names no file"),
        ((), "--out"),
    ],
)
def test_a_wrong_line_is_one_clear_message_and_no_file(run, new_files, arguments, words):
    outcome = run("report", *arguments)
    assert (outcome.code, outcome.out) == (2, "")
    errors = [line for line in outcome.err_lines if " error " in line]
    assert len(errors) == 1
    assert words in errors[0]
    assert "Traceback" not in outcome.err
    assert new_files() == set()


@pytest.mark.slow
def test_one_missed_pose_of_several_is_exit_code_1(run, folder):
    arguments = ("report", "gantry.urdf", "gantry.errors.yaml", *FEW, "--out", "page.html")
    assert run(*arguments, "--spec", "1 m", "--all-poses").code == 0
    # the same samples without the page
    analyze = ("analyze", *arguments[1:-2], "--spec", "0.08 mm", "--pose")
    out, home = (run(*analyze, pose).code for pose in ("out", "home"))
    every = run(*arguments, "--spec", "0.08 mm", "--all-poses").code
    assert every == max(out, home) == 1
    text = (folder / "page.html").read_text("utf-8")
    assert "--spec &#x27;0.08 mm&#x27; --out report.html --all-poses" in text


def test_too_many_poses_are_refused_before_anything_is_computed(run, folder, new_files):
    text = (folder / "gantry.errors.yaml").read_text("utf-8")
    poses = "".join(f"  p{k}: [{k} mm, 0 deg]\n" for k in range(13))
    (folder / "gantry.errors.yaml").write_text(text.replace("poses:\n", f"poses:\n{poses}"), "utf-8")
    outcome = run("report", "gantry.urdf", "gantry.errors.yaml", *FEW, "--all-poses", "--out", "page.html")
    assert outcome.code == 2
    assert "15 poses; a report shows at most 12" in outcome.err
    assert new_files() == set()


@pytest.mark.slow
def test_a_page_that_cannot_be_drawn_leaves_the_old_one(run, folder, monkeypatch):
    (folder / "page.html").write_text("old", "utf-8")

    def stop(*_: object, **__: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr("precision_pin.pages.report.page.page", stop)
    assert run("report", "gantry.urdf", *FEW, "--out", "page.html").code == 130
    assert (folder / "page.html").read_text("utf-8") == "old"


@pytest.mark.slow
def test_a_limit_missed_on_the_map_is_exit_code_1(run, folder):
    (folder / "grid.yaml").write_text(f"joints:\n  y_axis: 0 100 mm\n  {LONG}: 0 30 deg\n")
    arguments = ("report", "gantry.errors.yaml", *FEW, "--map", "grid.yaml", "--out", "page.html")
    assert run(*arguments, "--spec", "y 120 um @ 99 %", "--q", f"y_axis: 0 m, {LONG}: 90 deg", "--full").code == 1
    page = (folder / "page.html").read_text("utf-8")
    assert "--map grid.yaml" in page
    assert "--out report.html --full" in page
    assert "The specification is met, but not on the map" in page
    # all is open and nothing is kept from the printer, but for the view
    folded = re.findall(r'<details class="fold"><summary><h2 id="(\w+)-heading', page)
    assert folded == ["view"]
    assert "not printed" not in page
    refused = run(*arguments[:-1], "grid.yaml")
    assert refused.code == 2
    assert "joints:" in (folder / "grid.yaml").read_text()


@pytest.mark.slow
def test_a_path_and_a_test_have_sections_and_verdicts_that_count(run, folder):
    (folder / "way.csv").write_text(f"y_axis [mm],{LONG} [deg]\n0,0\n100,30\n")
    at = ("--q", f"y_axis: 0 m, {LONG}: 90 deg", "--iso9283", "poses", "--out", "page.html")
    made = run("report", "gantry.errors.yaml", *FEW, "--path", "way.csv", "--spec", "y 120 um @ 99 %", *at)
    assert made.code == 1
    page = (folder / "page.html").read_text("utf-8")
    for said in (
        "--path way.csv", "--iso9283 poses", "Along the path: spec", 'href="#path"', 'href="#iso9283"',
        "largest error along the path: 95 % of robots within |d|", "95 % of robots built will show AP of",
    ):  # fmt: skip
        assert said in page
    refused = run("report", "gantry.errors.yaml", *FEW, "--path", "nosuch.csv", "--out", "other.html")
    assert (refused.code, len(refused.said)) == (2, 1)
    assert not (folder / "other.html").exists()


@pytest.mark.slow
def test_an_allocation_has_a_section_and_its_answer_at_the_head(run, folder):
    text = (folder / "4dof.errors.yaml").read_text()
    entry = "{path: 'axis_install[joint1].radius', cost: {reciprocal: 1 mm}, min: 0.05 mm}"
    (folder / "wanted.yaml").write_text(f"{text}\nallocate:\n  specs: [30 mm @ 95 %]\n  tolerances: [{entry}]\n")
    assert run("report", "wanted.yaml", *FEW, "--allocate", "--out", "page.html").code == 1
    page = (folder / "page.html").read_text("utf-8")
    assert "Allocation: no allocation was found that meets position.norm 30 mm @ 95 %" in page.replace("&nbsp;", " ")
    for said in ('href="#allocation"', "--allocate", "constant part", "axis_install[joint1].radius"):
        assert said in page
    refused = run("report", "4dof.errors.yaml", *FEW, "--allocate", "--out", "other.html")
    assert (refused.code, len(refused.said)) == (2, 1)
    assert "the sheet has no allocate:" in refused.said[0]
    assert not (folder / "other.html").exists()
