"""The lowest dependencies that CI installs are those that pyproject.toml names."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parent.parent
UNBOUNDED = {"types-tqdm"}


def test_the_lowest_versions_are_those_of_pyproject() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    listed = [*project["dependencies"], *(one for extra in project["optional-dependencies"].values() for one in extra)]
    named = {}
    for requirement in listed:
        match = re.fullmatch(r"([A-Za-z0-9._-]+)(?:\[.*\])?(?:>=([0-9.]+)(?:,<[0-9]+)?)?", requirement)
        assert match is not None, requirement
        if match[1] != project["name"]:
            named[match[1]] = match[2]
    assert {name for name, lowest in named.items() if lowest is None} == UNBOUNDED
    lines = (ROOT / "requirements-lowest.txt").read_text(encoding="utf-8").splitlines()
    lowest = dict(line.split("==") for line in lines if not line.startswith("#"))
    bounds = {canonicalize_name(name): version for name, version in named.items() if version is not None}
    assert {name: Version(lowest[name]) for name in bounds} == {name: Version(text) for name, text in bounds.items()}


def test_every_python_that_ci_runs_is_named() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    named = {line.rpartition(" ")[2] for line in project["classifiers"] if line.startswith("Programming Language")}
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    others = re.search(r"for version in (.+); do", script)
    assert others is not None
    assert named == {project["requires-python"].removeprefix(">="), *others[1].split()}
