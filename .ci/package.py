"""What users install: a source distribution, from it a wheel, both checked; then the README's tour with nothing but the wheel.

Usage: python .ci/package.py FOLDER

The environment has build, twine, check-wheel-contents, validate-pyproject and uv. FOLDER is for distributions, the
environment of the wheel and the files of the tour.
"""

import doctest
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def call(*words: str | os.PathLike[str]) -> None:
    """Run a command of this environment in the project's folder; a failure ends this program."""
    print("+", *words, flush=True)
    subprocess.run([Path(sys.executable).with_name(str(words[0])), *words[1:]], cwd=ROOT, check=True)


def build(folder: Path) -> Path:
    """Return the wheel, built from the source distribution, after the checks of the metadata and contents of both."""
    call("validate-pyproject", "pyproject.toml")
    # without --wheel it is built from the source distribution
    call("python", "-m", "build", "--installer", "uv", "--outdir", folder)
    (wheel,), (source,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    call("twine", "check", "--strict", wheel, source)
    # what is compiled while the tests run lies beside the sources and belongs in no wheel
    sources = shutil.copytree(
        ROOT / "src" / "precision_pin", folder / "precision_pin", ignore=lambda *_: {"__pycache__"}
    )
    call("check-wheel-contents", "--package", sources, wheel)
    return wheel


def install(wheel: Path, home: Path) -> None:
    """Install a wheel and what it asks for into a new environment, in the versions of the lock."""
    versions = re.findall(r"^[\w.-]+==[^\\\n]+", (ROOT / "requirements.lock").read_text(encoding="utf-8"), re.MULTILINE)
    constraints = wheel.with_name("constraints.txt")
    constraints.write_text("\n".join(versions), encoding="utf-8")
    call("uv", "venv", "-q", "-p", sys.executable, home)
    call("uv", "pip", "install", "-q", "-p", home, "-c", constraints, wheel)


def tour(home: Path, desk: Path) -> None:
    """Run the README's blocks of the console and of Python one after the other in an empty folder."""
    desk.mkdir()
    # no setting of the caller, such as PYTHONPATH, decides which package is found
    environment = {"PATH": f"{home / 'bin'}:/usr/bin:/bin", "HOME": str(desk)}
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for language, block in re.findall(r"^```(console|python)\n(.*?)^```$", readme, re.DOTALL | re.MULTILINE):
        if language == "python":
            expected = "\n".join(re.findall(r"# → (.+)$", block, re.MULTILINE))
            steps = [(["python", "-c", block], 0, expected)]
        else:
            entries = (entry.partition("\n") for entry in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:])
            steps = [
                (shlex.split(line, comments=True), int((re.findall(r"# exit (\d+)", line) or [0])[0]), shown)
                for line, _, shown in entries
            ]
        for words, code, shown in steps:
            print("+", shlex.join(words), flush=True)
            ended = subprocess.run(
                [home / "bin" / words[0], *words[1:]], cwd=desk, env=environment, capture_output=True, text=True
            )
            printed = f"{ended.stdout}{ended.stderr}"
            matches = not shown.strip() or doctest.OutputChecker().check_output(
                f"{shown.strip()}\n", f"{printed.strip()}\n", doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
            )
            if ended.returncode != code or not matches:
                sys.exit(f"exit code {ended.returncode} instead of {code}, or other words than\n{shown}\n{printed}")


def main(folder: Path) -> None:
    """Build, check, install, and take the tour."""
    wheel = build(folder / "dist")
    install(wheel, folder / "home")
    tour(folder / "home", folder / "desk")
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    print(f"precision-pin {version}: the tour runs from {wheel.name}, built from the source distribution")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
