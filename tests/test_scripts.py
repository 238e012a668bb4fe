"""The examples run, the README's commands stand, the locks name no host, and the package carries its robots."""

from __future__ import annotations

import os
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib import resources
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SCRIPTS = ROOT / "scripts"
LOCKS = ("requirements.lock", "requirements-dev.lock")


def readme_commands() -> list[str]:
    """Return the commands of the README's set-up section, one line each."""
    section = (ROOT / "README.md").read_text(encoding="utf-8").split("## Set up")[1].split("\n## ")[0]
    return [line.strip() for line in section.splitlines() if line.startswith("    ")]


# scripts -------------------------------------------------------------------------------------------------------------


def run_script(name: str, *arguments: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    runpy.run_path(str(SCRIPTS / name), run_name="__main__")


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
    assert "2,000 samples, seed 0" in out
    assert "100,000 samples, seed 0" in out
    assert {path.name for path in (tmp_path / "new" / "figures").iterdir()} == {
        "fig5.png", "fig5.svg", "fig6.png", "fig6.svg",
    }  # fmt: skip


@pytest.mark.slow
def test_any_arm(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run_script("any_arm.py", monkeypatch=monkeypatch)
    out = capsys.readouterr().out
    assert re.search(r"^ur5\S*\.urdf: \S+ to tool0, pose \(", out, re.MULTILINE)
    assert re.search(r"^panda\S*\.urdf: \S+ to panda_hand_tcp, pose \(", out, re.MULTILINE)
    assert out.count("spec |d| within 1 mm for 95 %: ") == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_view_poses(tmp_path, monkeypatch, capsys):
    run_script("view_poses.py", str(tmp_path), monkeypatch=monkeypatch)
    pages = {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()}
    assert sorted(pages) == ["view_folded.html", "view_paper.html"]
    assert all(text.lstrip().lower().startswith("<!doctype html") for text in pages.values())
    assert capsys.readouterr().out.count("half of the units miss by more than") == 2


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
    found = re.search(r"^command_line=\$\((grep .*)\)$", text, re.MULTILINE)
    assert found is not None
    taken = subprocess.run(["bash", "-c", found[1]], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert taken.strip() == readme_commands()[1]
    assert 'bash -euo pipefail -c "$command_line"' in text
    for check in ("ruff check", "ruff format --check", "mypy"):
        assert check in text


def test_contributing_names_the_targets_of_the_makefile_and_hooks_fetch_nothing():
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    named = re.findall(r"`make (\w+)`", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    assert sorted(named) == sorted(targets)
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    assert re.findall(r"repo: (\S+)", hooks) == ["local"]
    assert set(re.findall(r"language: (\w+)", hooks)) == {"system"}


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_names_no_host(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    assert "://" not in text
    assert "index-url" not in text
    assert "find-links" not in text
    for line in text.splitlines():
        entry = line.strip()
        if not entry or entry.startswith("#"):
            continue
        assert re.match(r"[A-Za-z0-9._-]+==\S+( ;.*)?( \\)?$|--hash=sha256:[0-9a-f]{64}( \\)?$", entry), entry


def locked(name: str) -> dict[str, str]:
    text = (ROOT / name).read_text(encoding="utf-8")
    return {plain(name): version for name, version in re.findall(r"^([A-Za-z0-9._-]+)==(\S+)", text, re.MULTILINE)}


def plain(requirement: str) -> str:
    """Return the name that a requirement is about, as PyPI normalises it."""
    return re.sub(r"[-_.]+", "-", re.split(r"[<>=!~\[; ]", requirement)[0].lower())


def test_the_locks_hold_every_dependency_and_agree():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    run_time, tests = locked("requirements.lock"), locked("requirements-dev.lock")
    assert {plain(entry) for entry in project["dependencies"]} <= set(run_time)
    extras = project["optional-dependencies"]
    wanted = {plain(entry) for extra in ("dev", "xarray") for entry in extras[extra]} - {"precision-pin"}
    assert wanted <= set(tests)
    assert {name: tests.get(name) for name in run_time} == run_time


# the package ---------------------------------------------------------------------------------------------------------


def test_the_robots_are_reachable_from_the_installed_package():
    folder = resources.files("precision_pin") / "robots"
    assert folder.joinpath("4dof.errors.yaml").read_text(encoding="utf-8").startswith("# The paper's case")
    assert "<robot name=" in folder.joinpath("4dof.urdf").read_text(encoding="utf-8")
    assert resources.files("precision_pin").joinpath("py.typed").is_file()


@pytest.mark.slow
def test_the_wheel_holds_the_robots_and_every_module(tmp_path):
    source = tmp_path / "source"
    skipped = shutil.ignore_patterns("__pycache__", "*.pyc")
    for name in ("src", "robots"):
        shutil.copytree(ROOT / name, source / name, symlinks=True, ignore=skipped)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    made = subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--wheel-dir", str(tmp_path), str(source)],
        capture_output=True,
        text=True,
        timeout=300,
    )
    if made.returncode and re.search(
        "No matching distribution|connection|Temporary failure", made.stderr, re.IGNORECASE
    ):
        pytest.skip("the package index, from which the build tool comes, is not to be reached")
    assert made.returncode == 0, made.stderr
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        for robot in (ROOT / "robots").iterdir():
            assert archive.read(f"precision_pin/robots/{robot.name}") == robot.read_bytes()
        points = next(name for name in names if name.endswith("entry_points.txt"))
        assert "precision-pin = precision_pin.cli:main" in archive.read(points).decode()
    package = ROOT / "src" / "precision_pin"
    files = {
        f"precision_pin/{path.relative_to(package)}"
        for path in package.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert files <= names
    assert not any(name.startswith(("tests", "scripts", "docs")) for name in names)
