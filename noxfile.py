#!/usr/bin/env -S uv run --script

# /// script
# dependencies = ["nox[uv]>=2025.2"]
# ///

"""Daily commands: `nox -l` lists them, `nox -s fast` runs one. `--no-venv` takes the active environment."""

from pathlib import Path

import nox

nox.needs_version = ">=2025.2"
nox.options.default_venv_backend = "uv|virtualenv"
nox.options.reuse_existing_virtualenvs = True

PROJECT = nox.project.load_toml("pyproject.toml")


def prepare(session: nox.Session) -> None:
    """Install the locked versions, and the package as it stands here."""
    session.install("-r", "requirements-dev.lock")
    session.install("--no-deps", "-e", ".")


@nox.session
def fast(session: nox.Session) -> None:
    """Run the tests but the slow ones: while you work."""
    prepare(session)
    session.run("python", "-m", "pytest", "-m", "not slow", *session.posargs)


@nox.session(default=False)
def full(session: nox.Session) -> None:
    """Run all tests."""
    prepare(session)
    session.run("python", "-m", "pytest", *session.posargs)


@nox.session(default=False, python=nox.project.python_versions(PROJECT))
def smoke(session: nox.Session) -> None:
    """Run some tests of each folder: what `.ci/run` tries on other Pythons and with the lowest dependencies."""
    prepare(session)
    session.run("python", "-m", "pytest", "-n", "0", "-m", "not slow", *Path("tests/smoke.txt").read_text().split())


@nox.session
def lint(session: nox.Session) -> None:
    """Check the code with ruff."""
    prepare(session)
    session.run("python", "-m", "ruff", "check", ".")
    session.run("python", "-m", "ruff", "format", "--check", ".")


@nox.session
def types(session: nox.Session) -> None:
    """Check the types with mypy."""
    prepare(session)
    session.run("python", "-m", "mypy")


@nox.session(default=False)
def docs(session: nox.Session) -> None:
    """Rewrite the generated tables and build the site in docs/_build/html; a warning is an error."""
    prepare(session)
    session.run("python", "docs/generate.py")
    session.run("python", "-m", "sphinx", "-W", "--keep-going", "-q", "docs", "docs/_build/html")


@nox.session(default=False)
def bench(session: nox.Session) -> None:
    """Measure and write docs/benchmarks.md, on a quiet machine."""
    prepare(session)
    session.run("python", "-m", "benchmarks", "--out", "docs")


if __name__ == "__main__":
    nox.main()
