"""Wrong command lines end with code 2 and lines that name the problem, and write nothing; hostile names stay one line."""

import json
import os
import re
import shlex

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cli.conftest import GANTRY
from precision_pin.base.errors import LONGEST_LINE, Finding, InputError, UnknownNameError, one_line, shown, visible

ROBOT = "precision-pin: 1\nrobot: 4dof.urdf\n"
JOINTS = "joint1 [deg],joint2 [deg],joint3 [deg],joint4 [deg]"

WRONG = {
    # commands and options
    "analyse": "no command named 'analyse'; did you mean 'analyze'?",
    "--samples 10 analyze": "--samples",
    "analyze --sampels 10": "No such option:? '?--sampels'?.*--samples",
    "analyze --samples": "'--samples' requires an argument.*see precision-pin analyze --help",
    "analyze --model quadratic": "'quadratic' is not one of 'exact', 'linear'",
    "analyze --spec 1 mm @ 95 %": "E_USAGE: one robot and one sheet are expected.*need quotes",
    # samples and seed
    "analyze --samples 0": "samples must be a whole number from 1 to .*got 0",
    "analyze --seed -1": "seed must be a whole number from 0 to 2\\^64 - 1, got -1",
    # specifications
    "analyze --spec '1 mm' --spec 0.5": "'0.5' has no unit: '0.5 mm' limits the position, '0.5 mrad' the attitude",
    "analyze --spec '0 mm'": "the limit must be positive",
    "analyze --spec '1 mm @ 95 mm'": "is not a unit of ratio",
    "exact-law --spec '0.1 mm lateral'": "exact-law: error E_USAGE: no option '--spec': this command judges no limits; analyze",
    "moments --spec 'all of: 0.2 mm, 1 mrad tilt @ 99 %'": "moments: error E_USAGE: no option '--spec': .*analyze --spec does",
    "analyze --all-poses --spec-everywhere": "--spec-everywhere needs a --spec",
    # poses and joint values
    "analyze --pose papper": "no pose named 'papper'; did you mean 'paper'?",
    "analyze --q '1 2 3 deg'": "--q: 3 joint values for 4 joints.*joint1, joint2",
    "analyze --q '1 deg, 2 deg'": "--q: 2 joint values for 4 joints",
    "analyze --q '1 2 3 4'": "--q: '1 2 3 4' has no unit; an? angle needs one of: rad",
    "analyze --q 'joint1: 0 deg, joint2: 0 deg'": "--q: no value for the joints joint3, joint4",
    "analyze --q 'joint7: 0 deg'": "--q: no joint on the chain named 'joint7'; did you mean",
    "analyze --q 'joint1: 0 deg, joint1: 1 deg'": "--q: the joint 'joint1' is given twice",
    "analyze --q 'joint1: 0 deg, 1 deg'": "--q: '1 deg' names no joint",
    "analyze gantry.urdf --q '1 2 m'": "--q: .*revolute and prismatic joints",
    "analyze gantry.urdf --q '1 deg, 2 deg'": "--q: 'deg' in '1 deg' is not a unit of length",
    "analyze poseless.yaml": "poseless.yaml: error E_POSE: the sheet has no poses; .*--q",
    "analyze --pose paper --q '0 0 0 0 deg'": "--pose and --q exclude each other",
    "view --pose paper --all-poses --out page.html": "--pose and --all-poses exclude each other",
    "report --out page.html --all-poses --grid way.csv": "--all-poses and --grid exclude each other",
    "analyze gantry.urdf --all-poses --until '95 % to 0.01 mm'": "--until is for one pose, and 2 are given",
    "report gantry.urdf --trajectory long.csv --out page.html": "long.csv:14: error E_TRAJECTORY: more than 12 poses",
    "report many.yaml --all-poses --out page.html": "13 poses; a report shows at most 12",
    "analyze --trajectory way.csv --json way.csv": "way.csv: it is an input of this command",
    "analyze --trajectory way.csv --step '2 parsec'": "is not a unit of time or angle or length",
    "analyze --trajectory way.csv --step '0 s'": "way.csv: error E_TRAJECTORY: --step '0 s': time_step must be positive",
    "analyze --trajectory way.csv --step '1 s' --step '1 ms'": "--step '1 ms': a second step of time",
    "analyze --trajectory way.csv --step '1e-9 s'": "--step '1e-9 s': the steps make 1,000,000,001 poses",
    "analyze --trajectory still.csv": "still.csv:3: error E_TRAJECTORY: the time stands still at 0 s; it must increase",
    "map --all-poses --journal run.journal": "a journal keeps sampled poses; give the number of samples too",
    # approach and target
    "analyze --approach joint2": "--approach: 'joint2' is no approach",
    "analyze --approach previous": "--approach previous is the way from the pose before, and there is one pose",
    "analyze --target '0 200 mm'": "--target: '0 200 mm' has 2 numbers, expected 3; write it as '0 0",
    # one pose relative to another
    "analyze gantry.urdf --relative-to home --all-poses": "--relative-to is for one pose",
    "analyze gantry.urdf --relative-to home --until '95 % to 1 mm'": "--until and --relative-to exclude each other",
    "analyze gantry.urdf --relative-to home --processes 2": "--processes and --relative-to exclude each other",
    "analyze gantry.urdf --relative-to home --spec '1 mm' --spec-everywhere": "--spec-everywhere and --relative-to",
    # tip and base
    "analyze --tip tol": "no link named 'tol'; did you mean 'tool'?",
    "analyze --base bass": "no link named 'bass'; did you mean 'base'?",
    "analyze --tip base": "no joint moves between 'base' and 'base'",
    # changes
    "analyze --set payload.mass=": "--set: 'PATH=VALUE' is expected",
    "analyze --set 'payloud.mass=1 kg'": "no source named 'payloud'; did you mean 'payload'",
    "mcpc gantry.urdf --set 'payload.mass=1 kg'": "--set changes a sheet, and none is given",
    # files
    "analyze nosuch.urdf 4dof.errors.yaml": "nosuch.urdf: error E_",
    "analyze nosuch.yaml": "nosuch.yaml: error E_FILE: the sheet does not exist",
    "analyze 4dof.urdf gantry.urdf 4dof.errors.yaml": "one robot and one sheet are expected",
    "analyze .": "error E_FILE",
    "analyze 4dof.urdf folder.yaml": "folder.yaml: error E_FILE: the sheet is not a regular file",
    "analyze notes.txt 4dof.errors.yaml": "notes.txt:1: error E_",
    "analyze broken.yaml": "broken.yaml:[23]: error E_YAML",
    "analyze example:ur55 4dof.errors.yaml": "no example robot named 'ur55'; did you mean 'ur5'",
    "analyze ''": "error E_FILE",
    "analyze orphan.yaml": "gone.urdf: error E_",
    # places to write to
    "analyze --json nowhere/result.json": "nowhere does not exist",
    "analyze --json 4dof.urdf/result.json": "4dof.urdf is not a folder",
    "analyze --json folder.yaml": "cannot write folder.yaml: it is a folder",
    "analyze --json new/": "cannot write new/: it is a folder",
    "analyze --out 4dof.urdf": "cannot write to the folder 4dof.urdf: it is a file",
    "analyze --out 4dof.urdf/plots": "4dof.urdf is not a folder",
    "analyze --out ''": "--out names no folder",
    "analyze --json new --journal ./new": "--journal and --json name the same file",
    "analyze --journal plots/j --out plots": "lies in the folder of --out",
    "analyze gantry.urdf --pose out --pose home --json plots/poses.json --out plots": "lies in the folder of --out",
    "init gantry.urdf --out folder.yaml": "it is a folder",
    "mcpc 4dof.urdf --package-dir nosuch": "Directory 'nosuch' does not exist",
    "report --out ''": "--out names no file",
    "view --samples 10 --out no/page.html": "no does not exist",
    # what single commands take
    "view --samples 1000000 --out page.html": "more than a page can show",
    "view --samples 10 --factor 0 --out page.html": "factor",
    "export": "Missing option '--out'",
    "export --out ''": "--out names no folder",
    "export --out o --units 0": "--units 0: from 1 to 100000 robots",
    "export --out o --first -1": "--first -1: units -1 to -1 do not exist",
    "export --out o --first 18446744073709551616": "do not exist, from 0 to 2\\^64 - 1",
    "export --out taken": "cannot write taken/units.csv: it is a folder",
    "export made.urdf 4dof.errors.yaml --out o": "made.urdf:2: error E_XACRO: unprocessed xacro",
    "export soft.yaml --out o": "does not come to rest|buckles|180°",
    "map --relative-to nowhere": "--relative-to: no pose named 'nowhere'",
    "path --pose paper": "a path has two poses or more",
    "path gantry.urdf --all-poses --samples 10": "10 samples do not resolve the 95 % quantile",
    "compensate --mode pose --weights '1 2'": "six numbers are expected",
    "compare gantry.errors.yaml": "two sheets are needed, A.yaml B.yaml; or one and what --set changes in it",
    "compare gantry.errors.yaml gantry.errors.yaml": "gantry.errors.yaml is given twice",
    "compare gantry.errors.yaml 4dof.errors.yaml": "only arms with the same joints can be compared",
    "iso9283 --target '1 2 3'": "--target: ",
    "iso9283 --spec '1 mm'": "no figure of a specification named '1'",
    "iso9283 --load 3": "--load: ",
    "iso9283 --measured nothing.csv": "nothing.csv",
    "allocate": "allocate:",
    "simulate --out r.csv --unit -1": "--unit must be a whole number from 0 to 2\\^64 - 1",
    "simulate --out r.csv --cycles 1": "--cycles must be a whole number from 2",
    "simulate --out r.csv --cycles 3 --kind distance": "--cycles are positions or poses",
    "simulate --out r.csv --std '0 mm'": "above zero",
    "calibrate": "nothing to do: give readings \\(DATA.csv\\), --forecast, --plan M or --factory FILE",
    "calibrate 4dof.errors.yaml --population": "at least two robots are needed",
    "calibrate 4dof.errors.yaml --population a.csv b.csv --plan 3": "--population takes no --plan",
    "calibrate 4dof.errors.yaml a.csv b.csv": "several robots need --population",
    "calibrate --forecast --means-free": "--means-free belongs to --population",
    "calibrate --factory x.conf --forecast": "--factory takes no --forecast",
    "calibrate --factory x.conf": "is none of UR3, UR5",
    "calibrate --forecast --pose paper --q '0 10 20 30 deg'": "exclude each other",
    "calibrate --forecast --plan 3": "--forecast and --plan exclude each other",
    "calibrate --forecast --csv x.csv": "--csv belongs to --plan",
    "calibrate 4dof.errors.yaml --plan 3 data.csv": "--plan takes no data",
    "calibrate --plan 9 --random 8": "the number of poses to choose must be a whole number from 1 to 8, the number of",
    "calibrate --forecast --criterion D": "--criterion belongs to --plan",
    "calibrate 4dof.errors.yaml --forecast data.csv": "--forecast takes no data",
    "calibrate 4dof.errors.yaml data.csv --random 3": "the measured poses are those of the data",
    "calibrate --forecast --urdf x.urdf": "--no-prior, --only, --urdf and --sheet belong to a calibration with data",
    "calibrate --forecast --std 0.1": "--std",
    "calibrate --forecast --kind distance --std '1 um + 2 kg'": "--std: std of a distance such as",
    "calibrate --forecast --at nowhere": "nowhere",
    "calibrate 4dof.errors.yaml flat.csv": "flat.csv.*no column for z; a position needs x, y, z",
    "calibrate 4dof.errors.yaml angle.csv": "angle.csv.*'deg' of the column 'x' is not a unit of length",
}
FILES = {
    "notes.txt": "remember the milk\n",
    "broken.yaml": "precision-pin: 1\nrobot: [4dof.urdf\n",
    "orphan.yaml": "precision-pin: 1\nrobot: gone.urdf\n",
    "poseless.yaml": ROBOT,
    "many.yaml": f"{ROBOT}poses:\n" + "".join(f"  p{k}: {k} 0 0 0 deg\n" for k in range(13)),
    "way.csv": "t,joint1,joint2,joint3,joint4\n0,0,0,0,0\n1,1,0,0,0\n",
    "still.csv": "t,joint1,joint2,joint3,joint4\n0,0,0,0,0\n0,1,0,0,0\n",
    "long.csv": "a_rather_long_name_for_a_joint_that_turns_about_x_of_the_carriage,y_axis\n" + "0,0\n" * 15,
    "made.urdf": '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">\n<xacro:arm/></robot>',
    "flat.csv": f"{JOINTS},x [mm],y [mm]\n0,0,0,0,1,2\n",
    "angle.csv": f"{JOINTS},x [deg],y [mm],z [mm]\n0,0,0,0,1,2,3\n",
}


@pytest.fixture
def odd_files(folder):
    for name, text in FILES.items():
        (folder / name).write_text(text)
    (folder / "folder.yaml").mkdir()
    (folder / "plots").mkdir()
    (folder / "taken" / "units.csv").mkdir(parents=True)
    soft = (folder / "4dof.errors.yaml").read_text("utf-8") + "  - frame: {joint: joint2, rx: {fixed: 200 deg}}\n"
    (folder / "soft.yaml").write_text(soft, "utf-8")
    return folder


@pytest.mark.fast(50)
@pytest.mark.parametrize("line", WRONG)
def test_a_wrong_command_line(refused, odd_files, line):
    assert re.search(WRONG[line], refused(*shlex.split(line)))


def test_numbers_beyond_all_reason(refused, folder):
    text = (folder / "4dof.errors.yaml").read_text()
    for old, new in (
        ("a1: {uniform: 0.05 mm}", "a1: {uniform: 1e45 m}"),
        ("a1: {uniform: 0.05 mm}", "a1: {normal: 1 m, k: 1e-100}"),
        ("mass: 1 kg", "mass: 1e300 kg"),
        ("-9.81 m/s^2", "-1e305 m/s^2"),
        ("link2, EI: 8000", "link2, EI: 1e-300"),
        ("{joint: joint1, radius: 0.1 mm, span: 100", "{joint: joint1, radius: 0.1 mm, span: 1e-300"),
        ("{joint: joint1, radius: 0.1 mm", "{joint: joint1, radius: 20 m"),
    ):
        assert text.count(old) == 1
        (folder / "absurd.yaml").write_text(text.replace(old, new))
        line = refused("analyze", "absurd.yaml", "--samples", "500", "--out", "plots")
        assert re.search("too large|too small|must lie|positive|beyond", line), new


# outputs in the place of inputs --------------------------------------------------------------------------------------

SHEET = """precision-pin: 1
robot: gantry.urdf
poses: {home: [0 mm, 0 deg]}
sources:
  - joint_offset: {joint: y_axis, offset: {empirical: {samples: {file: TABLE, column: gap}}}}
"""
TABLE = "gap [mm]\n" + "\n".join(f"{k / 100}" for k in range(50)) + "\n"
MESH = '<link name="tool"><visual><geometry><mesh filename="part.stl"/></geometry></visual></link>'
INPUTS = (
    "analyze --json 4dof.errors.yaml 4dof.errors.yaml",
    "analyze 4dof.errors.yaml --json ./4dof.urdf",
    "analyze 4dof.urdf 4dof.errors.yaml --json soft.urdf",
    "analyze 4dof.urdf 4dof.errors.yaml --json hard.urdf",
    "analyze table0.yaml --json table.csv",
    "analyze mesh.urdf gantry.errors.yaml --json part.stl",
    "analyze 4dof.urdf 4dof.errors.yaml --journal 4dof.errors.yaml",
    "analyze table1.yaml --out plots",
    "budget table2.yaml --out plots/",
    "report 4dof.errors.yaml --out sheet.html",
    "view 4dof.errors.yaml --trajectory way.csv --out way.html",
    "export table3.yaml --out .",
    "simulate 4dof.errors.yaml --trajectory way.csv --out way.csv",
    "init 4dof.urdf --force --out 4dof.urdf",
    "init mesh.urdf --force --out part.stl",
)


@pytest.mark.fast(8)
@pytest.mark.parametrize("line", INPUTS)
def test_no_input_is_written_over(refused, odd_files, monkeypatch, line):
    os.symlink("4dof.urdf", odd_files / "soft.urdf")
    os.link(odd_files / "4dof.urdf", odd_files / "hard.urdf")
    # pages are refused by their names first: these could be pages
    os.symlink("4dof.errors.yaml", odd_files / "sheet.html")
    os.symlink("way.csv", odd_files / "way.html")
    for number, table in enumerate(("table.csv", "plots/analysis.json", "plots/budget-3.png", "units.csv")):
        (odd_files / table).write_text(TABLE)
        (odd_files / f"table{number}.yaml").write_text(SHEET.replace("TABLE", table))
    (odd_files / "part.stl").write_text("solid part\nendsolid part\n")
    (odd_files / "mesh.urdf").write_text(GANTRY.replace('<link name="tool"/>', MESH), "utf-8")
    model = "precision_pin.model.error_model.ErrorModel.from_sheet"
    monkeypatch.setattr(model, lambda *_: pytest.fail("work was begun"))
    assert re.search(r"cannot write \S+: it is an input of this command", refused(*line.split()))


# names that forge lines, turn the writing or have no end -------------------------------------------------------------

FORGED = "precision-pin: error E_FORGED: forged"
HOSTILE = f"a\u202eb\u2066c\u200bd\ufeffe\x1b[31m\x9b31mred\x85\n{FORGED}\r\n\u2028{FORGED}"
ENDLESS = HOSTILE + "N" * 300_000


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.text())
def test_a_message_is_one_printable_line_that_tells_names_apart(text):
    line = one_line(text)
    assert line.isprintable()
    assert len(line) <= LONGEST_LINE
    if text.isprintable() and len(text) <= 260:
        assert line == text
    if len(text) <= 80:
        assert eval(shown(text)) == text
    assert visible(text).isprintable()


@pytest.mark.parametrize("name", [ENDLESS, "w " * 50_000], ids=["hostile", "words"])
def test_findings_and_errors(name):
    finding = Finding("error", "E_X", f"no joint named {name}", f"/{name}.urdf", 3)
    assert finding.message == f"no joint named {name}"  # for those who want it whole
    unknown = UnknownNameError("joint", name, ["a", name + "b"])
    for line in map(str, (finding, InputError(f"the file {name} is not there"), unknown)):
        assert line.isprintable()
        assert len(line) < LONGEST_LINE + 600


NAMED = (
    "NAME", "analyze --NAME", "analyze --seed NAME", "analyze --pose NAME", "analyze --q NAME", "analyze --spec NAME",
    "analyze --until NAME", "mcpc 4dof.urdf --tip NAME", "mcpc NAME.urdf", "analyze NAME.yaml", "mcpc example:NAME",
    "analyze --json NAME", "analyze --out NAME", "view --out NAME.html", "mcpc 4dof.urdf --package-dir NAME",
    "view --trajectory NAME --out page.html",
)  # fmt: skip


@pytest.mark.fast(7)
@pytest.mark.parametrize("line", NAMED)
def test_names_in_command_lines(refused, line):
    assert refused(*(word.replace("NAME", ENDLESS) for word in line.split())).isprintable()


@pytest.mark.slow
def test_names_in_tables_and_json(run, folder):
    name = HOSTILE.replace("\x1b", "").replace("\x9b", "")  # which XML has not
    attribute = "".join(f"&#{ord(one)};" for one in name)
    (folder / "hostile.urdf").write_text(GANTRY.replace('"y_axis"', f'"{attribute}"'), "utf-8")
    quoted = json.dumps(name)
    sheet = f"precision-pin: 1\nrobot: hostile.urdf\nposes: {{{quoted}: [0 mm, 0 deg]}}\n"
    sheet += f"sources:\n  - joint_offset: {{joint: {quoted}, offset: {{uniform: 0.1 mm}}}}\n"
    (folder / "hostile.yaml").write_text(sheet, "utf-8")
    for command in ("analyze", "mcpc", "worst-case", "exact-law"):
        outcome = run(command, *(("--samples", "200") if command != "mcpc" else ()), "hostile.yaml")
        assert all(line.isprintable() for line in (outcome.out + outcome.err).split("\n"))
        assert not any(line.startswith(FORGED) for line in outcome.out.splitlines())
    result = run("analyze", "--samples", "10", "hostile.yaml", "--json", "-").json
    assert (result["pose"]["name"], name in result["pose"]["q"]) == (name, True)
