"""The examples run, the README's commands stand, the locks hold what is named, and the package carries its robots."""

import csv
import itertools
import os
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from precision_pin.base.errors import UrdfError
from precision_pin.robot.examples import example_urdfs
from precision_pin.robot.urdf import check as findings_of
from precision_pin.robot.urdf import gripper_joint, likeliest_tip, parse, read
from precision_pin.robot.urdf.reader import mended

ROOT = Path(__file__).parent.parent
SCRIPTS = ROOT / "scripts"
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def readme_commands() -> list[str]:
    """Return the commands of the README's set-up section, one line each."""
    section = text_of("README.md").split("## Set up")[1].split("\n## ")[0]
    return [line.strip() for line in section.splitlines() if line.startswith("    ")]


# scripts -------------------------------------------------------------------------------------------------------------


def run_script(name: str, *arguments: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    runpy.run_path(str(SCRIPTS / name), run_name="__main__")


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_every_script_has_a_test_and_says_its_question():
    tested = Path(__file__).read_text(encoding="utf-8")
    for path in SCRIPTS.glob("*.py"):
        assert f'"{path.name}"' in tested, path.name
        text = path.read_text(encoding="utf-8")
        assert re.search(rf"python \S*{path.name}", text.split('"""')[1]), path.name
        assert "?" in text.split('"""')[1].splitlines()[0], path.name


@pytest.mark.slow
def test_paper_case(tmp_path, monkeypatch, capsys):
    run_script("paper_case.py", str(tmp_path / "new" / "figures"), monkeypatch=monkeypatch)
    out = capsys.readouterr().out
    assert [f"{count} samples, seed 0" in out for count in ("2,000", "100,000")] == [True, True]
    assert names_in(tmp_path / "new" / "figures") == ["fig5.png", "fig5.svg", "fig6.png", "fig6.svg"]


@pytest.mark.slow
def test_any_arm(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run_script("any_arm.py", monkeypatch=monkeypatch)
    out = capsys.readouterr().out
    for name, tip in (("ur5", "tool0"), ("panda", "panda_hand_tcp")):
        assert re.search(rf"^{name}\S*\.urdf: \S+ to {tip}, pose \(", out, re.MULTILINE)
    assert out.count("spec |d| within 1 mm for 95 %: ") == 2
    assert names_in(tmp_path) == []


@pytest.mark.slow
def test_the_table_of_robots_has_them_all_with_the_tips_that_are_proposed(monkeypatch, capsys):
    """A row for each robot: its proposed tip and the joints before it, or the error that reading it ends with."""
    run_script("all_robots.py", "quadrotor_base", "TwoDofs", monkeypatch=monkeypatch)
    table, printed = text_of("docs/robots.csv").splitlines(), capsys.readouterr().out.splitlines()
    assert len(printed) == 2
    assert {*printed} <= {*table}
    _, *rows = csv.reader(table)
    assert [row[0] for row in rows] == list(example_urdfs())
    for name, tip, joints, _, why_not in rows:
        if not joints:  # opening all meshes takes long, so only these are checked
            errors = [one for one in findings_of(example_urdfs()[name]) if one.severity == "error"]
            assert why_not in [f"{one.code}: {one.message}" for one in errors], name
        else:
            try:
                robot = read(example_urdfs()[name])
            except UrdfError:  # the script takes what `init --mend-inertia` writes
                robot = parse(mended(example_urdfs()[name])[0], name)
            end = likeliest_tip(robot) if len(robot.leaves) > 1 else robot.leaves[0]
            grip = gripper_joint(robot, end)
            expected = end if grip is None else grip.parent
            assert (tip, int(joints)) == (expected, sum(joint.moves for joint in robot.path(robot.root, tip))), name


@pytest.mark.slow
def test_view_poses(tmp_path, monkeypatch, capsys):
    run_script("view_poses.py", str(tmp_path), monkeypatch=monkeypatch)
    assert names_in(tmp_path) == ["view_folded.html", "view_paper.html"]
    assert all(path.read_text("utf-8").lstrip().lower().startswith("<!doctype html") for path in tmp_path.iterdir())
    assert capsys.readouterr().out.count("half of the units miss by more than") == 2


def test_ur_sheets_says_in_a_line_what_it_wants(tmp_path, monkeypatch, capsys):
    (tmp_path / "named").mkdir()
    (tmp_path / "named" / "robot.yaml").touch()
    for arguments, told in (
        ([str(tmp_path)], "has no calibration of a robot"),
        ([str(tmp_path / "named")], "the name must begin with a type"),
        ([], "usage: python ur_sheets.py FOLDER"),
        (["--help"], None),
    ):
        with pytest.raises(SystemExit) as ended:
            run_script("ur_sheets.py", *arguments, monkeypatch=monkeypatch)
        assert (ended.value.code is None) == (told is None)
        assert told is None or (told in str(ended.value) and "\n" not in str(ended.value))
    assert "Usage: python ur_sheets.py FOLDER" in capsys.readouterr().out
    assert names_in(tmp_path) == ["named"]


@pytest.mark.slow
def test_ur_sheets_finds_the_spread_that_was_planted():
    """Three robots each of six types, with known means, spreads and sizes, three times over; then robots yet to come."""
    laws = runpy.run_path(str(SCRIPTS / "ur_sheets.py"))["laws"]
    laws.__globals__["DRAWS"] = 600
    rng = np.random.default_rng(0)
    spread, size = np.geomspace(0.05e-3, 5e-3, 16), np.array([0.7, 1.4, 1.02, 0.83, 1.2, 1.0])[:, None]  # middle 1
    kinds = [k for k in range(6) for _ in range(3)]
    held, inside = 0, []
    for _ in range(3):
        means = rng.normal(0, 1, (6, 16)) * spread
        built = means + rng.normal(0, 1, (3, 6, 16)) * spread * size
        found, interval = laws(built.swapaxes(0, 1).reshape(18, 16), kinds)
        held += int(((interval[:, 0] < spread) & (spread < interval[:, 1])).sum())
        new = means + rng.normal(0, 1, (200, 6, 16)) * spread * size
        inside += [(np.abs(new[:, k] - found[k].mean) < 1.645 * found[k].std).mean() for k in range(6)]
    assert held >= 40  # of 48 at 95 %: fewer with probability 0.001
    assert 0.82 < np.mean(inside) < 0.95  # means are estimated from three


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::precision_pin.base.errors.PrecisionPinWarning")
def test_ur_sheets(tmp_path, capsys):
    """Simulated robots of three types, one of them in two files."""
    source = tmp_path / "files"
    source.mkdir()
    rng, text = np.random.default_rng(0), ""
    for name in ("ur3e-0", "ur3e-1", "ur3e-2", "ur10-3", "ur10-4", "ur5-5", "ur5-6"):
        if name != "ur5-6":
            # as calibration.conf has them, no zeros
            rows = rng.normal(0, 5e-4, (4, 6)) * np.array([0, 1, 1, 1])[:, None]
            rows[1:, 5] *= [0, 1, 0]
            keys = ("delta_theta", "delta_a", "delta_d", "delta_alpha")
            text = "".join(f"{key} = {row.tolist()}\n" for key, row in zip(keys, rows, strict=True))
        (source / f"{name}.yaml").write_text(text)
    main = runpy.run_path(str(SCRIPTS / "ur_sheets.py"))["main"]
    main.__globals__.update(RANDOM=20, ROBOTS=200, SAMPLES=2000, DRAWS=200)
    main(source, tmp_path / "out")
    out = capsys.readouterr().out
    assert "ur5-6.yaml: the same robot as another file, left out" in out
    assert re.search(r"^UR3e: \d of 3 \(\d+ to \d+ %\), \d+ % of the poses inside$", out, re.MULTILINE)
    robots = ["ur10e.urdf", "ur3e.urdf", "ur5e.urdf"]
    assert names_in(tmp_path / "out") == sorted([*robots, "ur-left-out.png", "ur3e.errors.yaml"])
    text = (tmp_path / "out" / "ur3e.errors.yaml").read_text(encoding="utf-8")
    assert "factory calibrations of 3 UR3e, spread pooled over 6 UR robots" in text
    for name in robots:
        assert (tmp_path / "out" / name).read_text() == text_of(f"src/precision_pin/robots/{name}")


# set-up --------------------------------------------------------------------------------------------------------------


def test_the_readme_has_two_commands_that_refer_to_files_that_exist():
    case, tests = readme_commands()
    assert case.endswith(".venv/bin/precision-pin analyze")
    assert tests.endswith("-m pytest")
    for command, lock in ((case, "requirements.lock"), (tests, "requirements-dev.lock")):
        assert re.findall(r"-r (\S+)", command) == [lock]
        assert (ROOT / lock).is_file()
        parts = command.split(" && ")
        assert parts[0] == "python3 -m venv .venv"
        assert "--no-deps -e ." in parts[2]  # pip takes no hashes together with an editable install


def test_the_continuous_integration_runs_the_readmes_test_command_as_it_stands():
    script = ROOT / ".ci" / "run"
    assert os.access(script, os.X_OK)
    text = script.read_text(encoding="utf-8")
    subprocess.run(["bash", "-n", str(script)], check=True)
    (command,) = re.findall(r"^command_line=\$\((grep .*)\)$", text, re.MULTILINE)
    taken = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert taken.strip() == readme_commands()[1]
    for words in ('bash -euo pipefail -c "$command_line"', "ruff check", "ruff format --check", "mypy"):
        assert words in text


def test_contributing_names_the_sessions_of_nox_and_hooks_have_the_locked_ruff():
    sessions = re.findall(r"^@nox\.session.*\ndef (\w+)", text_of("noxfile.py"), re.MULTILINE)
    assert sorted(re.findall(r"`nox -s (\w+)`", text_of("CONTRIBUTING.md"))) == sorted(sessions)
    assert f"rev: v{locked('requirements-dev.lock')['ruff']}\n" in text_of(".pre-commit-config.yaml")


def locked(name: str) -> dict[str, str]:
    """Return the versions of a lock, in which no host is named."""
    text = text_of(name)
    for line in text.splitlines():
        entry = line.strip()
        if entry and not entry.startswith("#"):
            assert re.match(r"[A-Za-z0-9._-]+==\S+( ;.*)?( \\)?$|--hash=sha256:[0-9a-f]{64}( \\)?$", entry), entry
    found = re.findall(r"^([A-Za-z0-9._-]+)==(\S+)", text, re.MULTILINE)
    return {canonicalize_name(name): version for name, version in found}


def declared() -> dict[str, list[Requirement]]:
    """Return what the package needs, and under their names what its extras and dependency groups do."""
    groups = {
        name: [one for one in listed if isinstance(one, str)] for name, listed in PYPROJECT["dependency-groups"].items()
    }
    listed = {"": PROJECT["dependencies"]} | PROJECT["optional-dependencies"] | groups
    return {name: [*map(Requirement, texts)] for name, texts in listed.items()}


def test_the_locks_hold_every_dependency_and_agree():
    run_time, tests = locked("requirements.lock"), locked("requirements-dev.lock")
    names = {extra: {canonicalize_name(one.name) for one in listed} for extra, listed in declared().items()}
    assert names[""] <= set(run_time)
    assert set().union(*names.values()) - {"precision-pin"} <= set(tests)
    assert {name: tests.get(name) for name in run_time} == run_time


# the package ---------------------------------------------------------------------------------------------------------


def test_the_robots_are_reachable_from_the_installed_package():
    folder = resources.files("precision_pin") / "robots"
    assert folder.joinpath("4dof.errors.yaml").read_text(encoding="utf-8").startswith("# The paper's case")
    assert "<robot name=" in folder.joinpath("4dof.urdf").read_text(encoding="utf-8")
    assert resources.files("precision_pin").joinpath("py.typed").is_file()


def test_the_package_has_no_links_which_a_source_distribution_would_drop():
    package = ROOT / "src" / "precision_pin"
    assert (package / "robots" / "4dof.errors.yaml").is_file()
    assert [path for path in package.rglob("*") if path.is_symlink()] == []


def test_the_tour_of_the_built_package_is_the_readmes_and_notices_other_words(tmp_path):
    (tmp_path / "bin").mkdir()
    for name in ("python", "precision-pin"):
        (tmp_path / "bin" / name).symlink_to(shutil.which("echo"))
    tour = runpy.run_path(str(ROOT / ".ci" / "package.py"))["tour"]
    with pytest.raises(SystemExit, match=r"other words than\n4dof\.urdf: base to tool"):
        tour(tmp_path, tmp_path / "desk")


def test_the_lowest_versions_are_those_of_pyproject() -> None:
    bounds = {}
    for one in itertools.chain.from_iterable(declared().values()):
        assert re.fullmatch(r"|>=[0-9.]+|<[0-9]+,>=[0-9.]+", str(one.specifier)), one
        if one.name != PROJECT["name"]:
            bounds[canonicalize_name(one.name)] = [end.version for end in one.specifier if end.operator == ">="]
    assert {name for name, lowest in bounds.items() if not lowest} == {"types-tqdm"}
    lines = text_of("requirements-lowest.txt").splitlines()
    lowest = dict(line.split("==") for line in lines if not line.startswith("#"))
    assert {name: [Version(lowest[name])] for name, low in bounds.items() if low} == {
        name: [*map(Version, low)] for name, low in bounds.items() if low
    }


def test_every_python_that_ci_runs_is_named() -> None:
    named = {line.rpartition(" ")[2] for line in PROJECT["classifiers"] if line.startswith("Programming Language")}
    others = re.search(r"for version in (.+); do", text_of(".ci/run"))[1]
    assert named == {PROJECT["requires-python"].removeprefix(">="), *others.split()}
