"""What every command of an analysis keeps, made from its declaration: help, refusals, outputs and exit codes."""

from __future__ import annotations

import fnmatch
import re
from pathlib import Path

import numpy as np
import pytest

import precision_pin as pp
from precision_pin.analyses.declaration import Declaration, Option
from precision_pin.analyses.registry import declarations
from precision_pin.cli.analyses import analysis_of
from precision_pin.cli.program import load_command
from precision_pin.robot.pose_set import PoseSet

SHEET = "small.yaml"
SHEET_TEXT = """precision-pin: 1
robot: gantry.urdf
poses: {out: [250 mm, 30 deg], home: [0 mm, 0 deg]}
sources:
  - joint_offset: {joint: y_axis, offset: {uniform: 0.1 mm}}
allocate:
  specs: ['5 mm @ 90 %']
  tolerances: [{path: 'joint_offset[y_axis].offset.uniform', cost: {reciprocal: 1 mm}, max: 1 mm}]
"""
ASKED = {
    "budget": ("--samples", "1024"),
    "worst-case": ("--samples", "200"),
    "exact-law": ("--samples", "200"),
    "reliability": ("--samples", "200", "--spec", "5 mm @ 90 %"),
    "moments": ("--samples", "1024"),
    "map": ("--verify", "0"),
    "path": ("--all-poses", "--samples", "200"),
    "compare": ("--samples", "200", "--set", "statics=nominal"),
    "compensate": ("--mode", "pose", "--weights", "1 1 1 1 1 1"),
    "iso9283": ("--robots", "20"),
    "calibrate": ("--forecast", "--random", "8"),
}
"""What each needs to run, and to run quickly; nothing for the others."""
DECLARED = list(declarations().values())
AT_POSES = [one for one in DECLARED if "poses" in one.options]


def named(one: Declaration) -> str:
    return one.name


every = pytest.mark.parametrize("one", DECLARED, ids=named)


@pytest.fixture(autouse=True)
def sheet(folder) -> None:
    (folder / SHEET).write_text(SHEET_TEXT)


def asked(one: Declaration) -> tuple[str, ...]:
    """Return a command line that runs."""
    return (one.name, SHEET, *ASKED.get(one.name, ()))


def refused(outcome) -> str:
    """Return the one line that is not a warning or a note; the first command of a fresh installation says that it compiles."""
    assert (outcome.code, outcome.out) == (2, ""), outcome
    (line,) = [
        line for line in outcome.err_lines if " warning " not in line and not line.startswith("compiling the sampler")
    ]
    assert re.search(r"error E_[A-Z_]+: ", line)
    return line


@every
def test_help_has_what_is_declared(run, one) -> None:
    text = " ".join(run(one.name, "--help").out.split())
    for option in one.own_options:
        assert f" {option.flag} " in text
        assert " ".join(option.help.split()) in text
    assert " ".join(one.description.replace("\b", "").split()) in text
    assert one.summary in " ".join(run("--help").out.split())


@every
def test_wrong_options_are_one_line_and_nothing_is_done(run, one, contents, monkeypatch) -> None:
    before = contents()
    monkeypatch.setattr("precision_pin.cli.analyses.read_sheet", lambda *_: pytest.fail("work was begun"))
    assert "No such option" in refused(run(*asked(one), "--nonsense"))
    assert "--tip is given 2 times" in refused(run(*asked(one), "--tip", "a", "--tip", "b"))
    if "seed" in one.options:
        assert "the seed must be" in refused(run(*asked(one), "--seed", "-1"))
    if "spec" in one.options:
        assert "specification '5 kg'" in refused(run(*asked(one), "--spec", "5 kg"))
    for option in one.own_options:
        if option.choices:
            assert "is not one of" in refused(run(one.name, SHEET, option.flag, "nonsense"))
    if "poses" in one.options:
        assert "exclude each other" in refused(run(*asked(one), "--q", "0 mm, 0 deg", "--trajectory", "way.csv"))
        assert "--step needs a --trajectory" in refused(run(*asked(one), "--step", "1 s"))
    assert contents() == before


@pytest.mark.parametrize("one", AT_POSES, ids=named)
def test_a_wrong_pose_is_one_line(run, one, contents) -> None:
    before, (name, *rest) = contents(), [word for word in asked(one) if word not in ("--all-poses", "--random", "8")]
    for given in (("--pose", "hom"), ("--q", "0 mm"), ("--trajectory", "nosuch.csv"), ("--grid", "nosuch.yaml")):
        line = refused(run(name, *rest, *given))
        assert ("did you mean 'home'" if given[1] == "hom" else "--q" if given[0] == "--q" else given[1]) in line
    assert contents() == before


@every
def test_outputs_that_cannot_be_written_are_refused_before_any_work(run, one, contents, folder, monkeypatch) -> None:
    (folder / "file").write_text("")
    (folder / "there").mkdir()
    before, flags = contents(), {option.name: option.opts[0] for option in load_command(one.name).params}
    monkeypatch.setattr(
        "precision_pin.model.error_model.ErrorModel.from_sheet", lambda *_: pytest.fail("work was begun")
    )
    assert "is an input of this command" in refused(run(*asked(one), "--json", SHEET))
    assert "--json and --out name the same place" in refused(run(*asked(one), "--json", "new", "--out", "new"))
    assert "--out takes a folder" in refused(run(*asked(one), "--out", "made.json"))
    own = (one.files or (f"{one.name}.*",))[0].replace("*", "json")
    assert "lies in the folder of --out" in refused(run(*asked(one), "--out", "there", "--json", f"there/{own}"))
    for flag in ["--out", *(flags[name] for name in one.writes)]:
        if one.name == "calibrate" and flag in ("--csv", "--urdf", "--sheet"):
            continue  # not with a forecast
        assert "file is not a folder" in refused(run(*asked(one), flag, "file/new"))
    assert contents() == before


@every
def test_the_result_is_printed_and_written_whole(run, one, folder, new_files, monkeypatch) -> None:
    drawn: list[Path] = []
    monkeypatch.setattr("precision_pin.sampling.figures.save", lambda _, path: drawn.append(path))
    told = run(*asked(one), "--json", "-")
    assert told.code == 0, told.err
    assert told.json["schema"].startswith("precision-pin/")
    assert new_files() == set()
    table = run(*asked(one), "--json", "result.json", "--out", "made")
    assert table.code == 0
    assert table.out
    assert not table.out.startswith("{")
    assert (folder / "result.json").read_text("utf-8") == told.out
    (written,) = [path for path in (folder / "made").iterdir() if path.suffix == ".json"]
    assert written.read_text("utf-8") == told.out
    patterns = one.files or (f"{one.name}.*", f"{one.name}-*")
    for path in [*(folder / "made").iterdir(), *(Path(f"{path}.svg") for path in drawn)]:
        assert any(fnmatch.fnmatchcase(path.name, pattern) for pattern in patterns)
    note = table.err_lines[-1]
    assert note.startswith(f"wrote made: {written.name}, ")
    assert all(path.name in note for path in [*drawn, *(folder / "made").iterdir()])
    quiet = run(*asked(one), "--quiet", "--out", "made")
    assert (quiet.code, quiet.out) == (0, table.out)
    assert quiet.err_lines == [line for line in table.err_lines if " warning " in line]


def test_what_a_page_shows_beside_the_arm_has_the_defaults_of_its_command(folder) -> None:
    sheet = pp.ErrorModel.load(SHEET).sheet
    poses = PoseSet.at(sheet.chain, np.array([[0.0, 0.1], [0.0, 0.2]]))
    law = analysis_of("path", sheet, poses, seed=3)
    assert (law.probability, law.samples, law.provenance.seed) == (0.95, 10_000, 3)


JUDGED = {
    "reliability": ("--spec", "0.001 mm @ 99 %"),
    "map": ("--samples", "200", "--spec", "0.001 mm @ 99 %"),
    "path": ("--spec", "0.001 mm @ 99 %"),
    "compare": ("--spec", "0.001 mm @ 99 %"),
    "iso9283": ("--spec", "AP 0.001 mm @ 99 %"),
}


def test_every_command_that_judges_is_tried() -> None:
    judging = {one.name for one in DECLARED for option in one.options
               if option == "spec" or (isinstance(option, Option) and option.flag == "--spec")}  # fmt: skip
    assert set(JUDGED) == judging


@pytest.mark.parametrize("name", JUDGED)
def test_a_limit_that_is_missed_is_exit_code_1(run, name) -> None:
    missed = run(*asked(declarations()[name]), *JUDGED[name])
    assert missed.code == 1
    assert "NOT MET" in missed.out
