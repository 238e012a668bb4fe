"""Rooms that can be taken out: no analysis, source or law is known outside its own, and the rest runs without it."""

import ast
import json
import os
import re
import shutil
import subprocess
import sys

import pytest

from precision_pin.analyses import registry
from precision_pin.sources import catalogue
from support.package_code import FILES, PACKAGE, nodes

FOLDERS = {
    folder.rpartition(".")[2]: name for folder, name in zip(registry.FOLDERS, registry.declarations(), strict=True)
}
"""Command of each analysis by its folder."""
KNOWN = {"sources.frame": {"model"}, "sources.payload": {"sheet"}}
"""Sources that are a part of the model: a displaced arm consists of frames, a measured one carries payloads."""


def rooms_named(path):
    """Return the folders of analyses and the files of sources that a file names, by import or as text."""
    named = set()
    for node in nodes(path):
        if isinstance(node, ast.ImportFrom) and node.module:
            words = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            words = [alias.name for alias in node.names]
        else:
            words = [node.value] if isinstance(node, ast.Constant) and isinstance(node.value, str) else []
        for word in words:
            named |= {".".join(found) for found in re.findall(r"\bprecision_pin\.(analyses|sources)\.(\w+)", word)}
    return named


SOURCES = {".".join(kind.__module__.split(".")[1:]) for kind in catalogue().values()}


def needed(folder):
    return {other for other, name in FOLDERS.items() if name in registry.declarations()[FOLDERS[folder]].needs}


def test_no_room_is_named_outside_it():
    found = []
    for path in FILES:
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if parts in (("__init__",), ("analyses", "registry")):
            continue  # the names of the package, and the line of each analysis
        own = {".".join(parts[:2])} | (
            {f"analyses.{name}" for name in needed(parts[1])} if parts[1:2] and parts[1] in FOLDERS else set()
        )
        for name in rooms_named(path) - own:
            if (name in SOURCES or name.removeprefix("analyses.") in FOLDERS) and parts[0] not in KNOWN.get(name, ()):
                found.append(f"{'/'.join(parts)} names {name}")
    assert not found, "\n".join(found)


COMMON = {"map", "path", "moments", "calibration", "stiffness"}
"""Words for something else too: moments of a mass, a tag of a URDF, a setting of sources."""


def test_no_analysis_is_chosen_by_its_name():
    found = [
        f"{path.relative_to(PACKAGE)}:{node.lineno} has {node.value!r}"
        for path in FILES
        if path.relative_to(PACKAGE).parts[0] not in ("analyses", "__init__.py")
        for node in nodes(path)
        if isinstance(node, ast.Constant) and node.value in {*FOLDERS, *FOLDERS.values()} - COMMON
    ]
    assert not found, "\n".join(found)


SHEET = """precision-pin: 1
robot: 4dof.urdf
tip: tool
poses: {paper: -90 3 88 -91 deg, other: -60 10 70 -80 deg}
sources:
  - joint_offset: {joint: joint2, offset: {uniform: 0.1 mrad}}
  - frame: {frame: tool, x: {normal: 0.1 mm}}
  - joint_compliance: {joint: joint2, compliance: 1e-6 rad/(N*m)}
"""
ASKED = {
    "budget": "--samples 1024",
    "worst-case": "--samples 200",
    "exact-law": "--samples 200",
    "reliability": "--samples 200 --spec '5 mm @ 90 %'",
    "moments": "--samples 1024",
    "map": "--verify 0",
    "path": "--all-poses --samples 200",
    "compare": "--samples 200 --set statics=nominal",
    "iso9283": "--robots 20",
    "calibrate": "--forecast --random 8",
    "allocate": "--pareto 0",
    "stiffness": "--robots 100",
}
"""What each command needs to run, and to run quickly."""
SMOKE = """
import importlib.util, json, shlex, sys
from click.testing import CliRunner
from precision_pin.analyses.registry import declarations
from precision_pin.cli.program import cli, list_commands
from precision_pin.render import figure_style
from precision_pin.sheet import json_schema

figure_style._svg = lambda _: b"<svg viewBox='0 0 1 1'/>"  # drawing would take most of the time
asked, taken = json.loads(sys.argv[1])


def run(name, *words):
    told = CliRunner().invoke(cli, [name, *words], catch_exceptions=False)
    assert told.exit_code == 0, (name, told.output)


kept = set(declarations())
assert importlib.util.find_spec(taken) is None
json_schema()
run("--help")
run("check", "arm.yaml")
run("analyze", "arm.yaml", "--samples", "200")
for name in kept:
    run(name, "allocate.yaml" if name == "allocate" else "arm.yaml", *shlex.split(asked.get(name, "")))
parts = {"map": "--map grid.yaml", "path": "--path way.csv", "compensate": "--compensate way.csv", "iso9283": "--iso9283 poses"}
words = [word for name in kept for word in parts.get(name, "").split()]
if "report" in list_commands():
    run("report", "arm.yaml", "--samples", "200", "--out", "page.html", *words)
run("view", "arm.yaml", "--samples", "50", "--out", "view.html", *[word for word in words if word not in ("--iso9283", "poses")])
"""


def copied(folder):
    """Copy the package with what numba has compiled, which goes by the times of the files."""
    shutil.copytree(PACKAGE, folder / "precision_pin", copy_function=shutil.copy2)
    return folder / "precision_pin"


def smoke(folder, taken):
    (folder / "arm.yaml").write_text(SHEET)
    shutil.copy(PACKAGE / "robots" / "4dof.urdf", folder)
    tolerances = "[{path: 'joint_offset[joint2].offset.uniform', cost: {reciprocal: 1 mrad}, max: 1 mrad}]"
    (folder / "allocate.yaml").write_text(f"{SHEET}allocate: {{specs: ['5 mm @ 90 %'], tolerances: {tolerances}}}\n")
    (folder / "way.csv").write_text(
        "joint1 [deg],joint2 [deg],joint3 [deg],joint4 [deg]\n-90,3,88,-91\n-60,10,70,-80\n"
    )
    (folder / "grid.yaml").write_text("joints: {joint1: 0 deg, joint2: 3 10 deg, joint3: 88 deg, joint4: -91 deg}\n")
    words = [sys.executable, "-c", SMOKE, json.dumps([ASKED, taken])]
    told = subprocess.run(
        words, cwd=folder, env={**os.environ, "PYTHONPATH": str(folder)}, capture_output=True, text=True
    )
    assert told.returncode == 0, told.stderr[-2000:]


@pytest.mark.slow
@pytest.mark.parametrize("folder", FOLDERS)
def test_the_rest_runs_without_an_analysis(folder, tmp_path):
    package = copied(tmp_path)
    without = {folder} | {other for other in FOLDERS if folder in needed(other)}
    for one in without:
        shutil.rmtree(package / "analyses" / one)
    take_out(package / "analyses" / "registry.py", *(rf'    "precision_pin\.analyses\.{one}",\n' for one in without))
    smoke(tmp_path, f"precision_pin.analyses.{folder}")


def take_out(file, *patterns):
    text = file.read_text("utf-8")
    for pattern in patterns:
        text, count = re.subn(pattern, "", text)
        assert count
    file.write_text(text, "utf-8")


@pytest.mark.slow
def test_the_rest_runs_without_a_source_a_law_and_an_output(tmp_path):
    package = copied(tmp_path)
    (package / "sources" / "levelling.py").unlink()
    laws = package / "draws" / "laws"
    (laws / "lognormal.py").unlink()
    take_out(
        laws / "__init__.py", r"from precision_pin\.draws\.laws\.lognormal import Lognormal\n", r'    "?Lognormal"?,\n'
    )
    shutil.rmtree(package / "pages" / "report")
    (package / "pages" / "documents.py").unlink()
    (package / "cli" / "report.py").unlink()
    take_out(package / "cli" / "program.py", r'    "report": \(\n(?:        .*\n)+    \),\n')
    smoke(tmp_path, "precision_pin.draws.laws.lognormal")
