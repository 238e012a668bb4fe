"""What every command of an analysis keeps, made from its declaration: help, refusals, outputs and exit codes."""

import fnmatch

import pytest

import precision_pin as pp
from precision_pin.analyses.registry import declarations
from precision_pin.cli.analyze import FILES as ANALYZE_FILES
from precision_pin.cli.page_parts import read_parts
from precision_pin.cli.program import load_command

SHEET = "small.yaml"
SHEET_TEXT = """precision-pin: 1
robot: gantry.urdf
poses: {out: [250 mm, 30 deg], home: [0 mm, 0 deg]}
sources:
  - joint_offset: {joint: y_axis, offset: {uniform: 0.1 mm}}
  - joint_compliance: {joint: y_axis, compliance: 1e-8 m/N}
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


every = pytest.mark.parametrize("one", DECLARED, ids=lambda one: one.name)


@pytest.fixture(autouse=True)
def sheet(folder):
    (folder / SHEET).write_text(SHEET_TEXT)


def asked(one):
    """Return a command line that runs."""
    return (one.name, SHEET, *ASKED.get(one.name, ()))


@every
def test_help_has_what_is_declared(run, one):
    text = " ".join(run(one.name, "--help").out.split())
    for option in one.own_options:
        assert f" {option.flag} " in text
        assert " ".join(option.help.split()) in text
    assert " ".join(one.description.replace("\b", "").split()) in text
    assert one.summary in " ".join(run("--help").out.split())


@every
def test_wrong_options_are_one_line_and_nothing_is_done(refused, one, monkeypatch):
    monkeypatch.setattr("precision_pin.cli.analyses.read_sheet", lambda *_: pytest.fail("work was begun"))
    wrong = {"--nonsense": "No such option", "--tip a --tip b": "--tip is given 2 times"}
    if "seed" in one.options:
        wrong["--seed -1"] = "the seed must be"
    if "spec" in one.options:
        wrong["--spec 5kg"] = "specification '5kg'"
    if "poses" in one.options:
        wrong |= {"--q 0 --trajectory way.csv": "exclude each other", "--step 1s": "--step needs a --trajectory"}
    for option in one.own_options:
        if option.choices:
            said = "is not one of" if len(option.choices) > 1 else f"is not '{option.choices[0]}'"
            assert said in refused(one.name, SHEET, option.flag, "nonsense")
    for words, said in wrong.items():
        assert said in refused(*asked(one), *words.split())


@pytest.mark.parametrize("one", AT_POSES, ids=lambda one: one.name)
def test_a_wrong_pose_is_one_line(refused, one):
    name, *rest = [word for word in asked(one) if word not in ("--all-poses", "--random", "8")]
    for *given, said in (
        ("--pose", "hom", "did you mean 'home'"),
        ("--q", "0 mm", "--q"),
        ("--trajectory", "nosuch.csv", "nosuch.csv"),
        ("--grid", "nosuch.yaml", "nosuch.yaml"),
    ):
        assert said in refused(name, *rest, *given)


@every
def test_outputs_that_cannot_be_written_are_refused_before_any_work(refused, one, folder, monkeypatch):
    (folder / "file").write_text("")
    (folder / "there").mkdir()
    flags = {option.name: option.opts[0] for option in load_command(one.name).params}
    model = "precision_pin.model.error_model.ErrorModel.from_sheet"
    monkeypatch.setattr(model, lambda *_: pytest.fail("work was begun"))
    own = (one.files or (f"{one.name}.*",))[0].replace("*", "json")
    for words, said in (
        (f"--json {SHEET}", "is an input of this command"),
        ("--json new --out new", "--json and --out name the same place"),
        ("--out made.json", "--out takes a folder"),
        (f"--out there --json there/{own}", "lies in the folder of --out"),
        *((f"{flag} file/new", "file is not a folder") for flag in ["--out", *(flags[name] for name in one.writes)]),
    ):
        if one.name != "calibrate" or not words.startswith(("--csv", "--urdf", "--sheet")):  # not with a forecast
            assert said in refused(*asked(one), *words.split())


@every
def test_commands_share_a_folder_without_losing_files(one):
    # what a command may write is removed there before it writes
    others = {pattern: pattern.replace("*", "png") for pattern in ANALYZE_FILES}
    for other in declarations().values():
        if other.name != one.name:
            patterns = other.files or (f"{other.name}.*", f"{other.name}-*")
            others |= {f"{other.name} {pattern}": pattern.replace("*", "png") for pattern in patterns}
    for pattern in one.files or (f"{one.name}.*", f"{one.name}-*"):
        assert not [label for label, name in others.items() if fnmatch.fnmatchcase(name, pattern)]


@every
def test_the_result_is_printed_and_written_whole(run, one, folder, new_files, monkeypatch):
    drawn = []
    monkeypatch.setattr("precision_pin.sampling.figures.save", lambda _, path: drawn.append(path.name))
    told = run(*asked(one), "--json", "-")
    assert told.json["schema"].startswith("precision-pin/")
    assert new_files() == set()
    table = run(*asked(one), "--json", "result.json", "--out", "made")
    assert table.out
    widest = {"compare": 120, "reliability": 130}.get(one.name, 100)
    assert max(map(len, table.out.splitlines())) <= widest
    made = [path.name for path in (folder / "made").iterdir()]
    (written,) = [name for name in made if name.endswith(".json")]
    for file in ("result.json", f"made/{written}"):
        assert (folder / file).read_text("utf-8") == told.out
    for name in [*made, *(f"{name}.svg" for name in drawn)]:
        assert any(fnmatch.fnmatchcase(name, pattern) for pattern in one.files or (f"{one.name}.*", f"{one.name}-*"))
    note = table.err_lines[-1]
    assert note.startswith(f"wrote made: {written}, ")
    assert all(name in note for name in drawn + made)
    quiet = run(*asked(one), "--quiet", "--out", "made")
    assert quiet.out == table.out
    assert quiet.err_lines == [line for line in table.err_lines if " warning " in line]


def test_what_a_page_shows_beside_the_arm_has_the_defaults_of_its_command(folder):
    sheet = pp.ErrorModel.load(SHEET).sheet
    (folder / "way.csv").write_text("y_axis [m], " + sheet.chain.joint_names[1] + " [rad]\n0, 0\n0.1, 0.2\n")
    options = dict.fromkeys(one.part.option.argument for one in DECLARED if one.part is not None)
    (part,) = read_parts(sheet, {**options, "path_file": "way.csv"}, seed=3)
    law = part.run()
    assert (law.probability, law.samples, law.provenance.seed) == (0.95, 10_000, 3)


JUDGED = {
    "reliability": ("--spec", "0.001 mm @ 99 %"),
    "map": ("--samples", "200", "--spec", "0.001 mm @ 99 %"),
    "path": ("--spec", "0.001 mm @ 99 %"),
    "compare": ("--spec", "0.001 mm @ 99 %"),
    "iso9283": ("--spec", "AP 0.001 mm @ 99 %"),
}


def judges(one):
    return any(option == "spec" or getattr(option, "flag", "") == "--spec" for option in one.options)


@pytest.mark.parametrize("one", [one for one in DECLARED if judges(one)], ids=lambda one: one.name)
def test_a_limit_that_is_missed_is_exit_code_1(run, one):
    assert "NOT MET" in run(*asked(one), *JUDGED[one.name], code=1).out
