"""A package of others that adds an analysis, a source and a law by entry points, installed as pip installs it."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from analyses.test_registry import FOLDER
from draws.test_law_files import TRAPEZOID
from precision_pin.analyses.declaration import SHARED_OPTIONS
from precision_pin.cli.analyses import _SHARED
from precision_pin.robot.examples import PAPER_SHEET
from sources.test_new_source import CODE
from support.package_code import PACKAGE

BROKEN = {
    "misspelt": ("offset:offset", "offset:ofset", "the module 'extra_errors.misspelt.offset' has no 'ofset'"),
    "unread": (
        "*AT_POSES",
        '*AT_POSES, "postures"',
        "no shared options are named 'postures'; those are poses, target, ",
    ),
    "unwritten": ("*AT_POSES", '"poses", "chain"', "its options lack 'json', or one of 'out' and 'plot'"),
}
"""Name of an analysis → a mistake in its declaration, and the reason why it is left out."""
LACKING = {
    "untabled": ("table.py", "there is no module 'extra_errors.untabled.table'"),
    "undrawn": ("figure.py", "there is no module 'extra_errors.undrawn.figure'"),
}
"""Name of an analysis → a file that its folder lacks, and the reason why it is left out."""
POINTS = f"""
[precision_pin.analyses]
offset = extra_errors.offset:DECLARATION
missing = extra_errors.missing:DECLARATION
{"".join(f"{name} = extra_errors.{name}:DECLARATION" + chr(10) for name in (*BROKEN, *LACKING))}
[precision_pin.sources]
sagging = extra_errors.sagging:Sagging
frame = precision_pin.sources.frame:Frame
[precision_pin.laws]
trapezoid = extra_errors.trapezoid:Trapezoid
number = extra_errors.trapezoid:np
"""
SHEET = f"""precision-pin: 1
robot: {PAPER_SHEET.parent / "4dof.urdf"}
tip: tool
gravity: none
poses: {{paper: -90 3 88 -91 deg}}
parameters: {{sorted: {{trapezoid: 0.3 mm, top: 0.1 mm}}}}
sources:
  - sagging: {{link: link2, rails: [{{sag: sorted}}]}}
"""
USED = """
import json, runpy, sys
from click.testing import CliRunner
from precision_pin.cli.program import cli
from precision_pin.render import figure_style

figure_style._svg = lambda _: b"<svg viewBox='0 0 1 1'/>"
docs = runpy.run_path(sys.argv[1])
told = {}
for words in ("--help", "doctor", "schema", "offset arm.yaml", "report arm.yaml --samples 200 --out page.html", "check arm.yaml"):
    ended = CliRunner().invoke(cli, words.split(), catch_exceptions=False)
    told[words.split()[0]] = [ended.exit_code, ended.stdout, ended.stderr]
json.dump({**told, "docs": docs["commands"]() + docs["laws"]()}, sys.stdout)
"""


def install(folder):
    """Install a wheel with the three into a folder, without its dependencies."""
    about = "extra_errors-1.2.dist-info"
    files = {f"extra_errors/offset/{name}": text for name, text in FOLDER.items()}
    for name in (*BROKEN, *LACKING):
        right, wrong, _ = BROKEN.get(name, ("", "", ""))
        declaration = FOLDER["__init__.py"].replace('name="offset"', f'name="{name}"').replace(right, wrong, 1)
        texts = {**FOLDER, "__init__.py": declaration}
        texts.pop(LACKING.get(name, ("",))[0], None)
        files |= {f"extra_errors/{name}/{file}": text for file, text in texts.items()}
    files |= {"extra_errors/__init__.py": "", "extra_errors/sagging.py": CODE, "extra_errors/trapezoid.py": TRAPEZOID}
    files |= {
        f"{about}/METADATA": "Metadata-Version: 2.1\nName: extra-errors\nVersion: 1.2\n",
        f"{about}/WHEEL": "Wheel-Version: 1.0\nGenerator: by hand\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{about}/entry_points.txt": POINTS,
    }
    wheel = folder / "extra_errors-1.2-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, text in {**files, f"{about}/RECORD": "".join(f"{name},,\n" for name in files)}.items():
            archive.writestr(name, text)
    words = ("install", "-q", "--no-deps", "--no-index", "--no-compile", "--target", str(folder / "site"), str(wheel))
    subprocess.run([sys.executable, "-m", "pip", *words], check=True)


@pytest.mark.slow
def test_what_others_install_stands_where_ours_does_and_what_is_broken_is_named(tmp_path):
    install(tmp_path)
    (tmp_path / "arm.yaml").write_text(SHEET)
    generate = Path(__file__).parents[1] / "docs" / "generate.py"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (tmp_path / "site", PACKAGE.parent)))}
    ended = subprocess.run(
        [sys.executable, "-c", USED, str(generate)], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    told = json.loads(ended.stdout)
    docs = told.pop("docs")
    assert {name: code for name, (code, _, _) in told.items()} == dict.fromkeys(told, 0)
    assert "offset" in told["--help"][1]
    assert "Error with every parameter at its mean." in docs
    assert "`trapezoid`" in docs
    schema = json.loads(told["schema"][1])
    assert "sagging" in schema["$defs"]
    assert {"required": ["trapezoid"]} in schema["$defs"]["law"]["oneOf"]
    assert told["offset"][1].endswith(" mm at 0.95\n")
    assert "Offset at the means" in (tmp_path / "page.html").read_text("utf-8")
    lines = [" ".join(line.split()) for line in told["doctor"][1].splitlines()]
    for line in (
        "analysis offset extra_errors.offset:DECLARATION, of extra-errors 1.2",
        "analysis missing LEFT OUT: ModuleNotFoundError: No module named 'extra_errors.missing'",
        "source sagging extra_errors.sagging:Sagging, of extra-errors 1.2",
        "source frame LEFT OUT: the name 'frame' is taken",
        "law trapezoid extra_errors.trapezoid:Trapezoid, of extra-errors 1.2",
        "law number LEFT OUT: not a subclass of precision_pin.draws.laws.Law",
    ):
        assert line in lines
    for name, (*_, reason) in (BROKEN | LACKING).items():
        assert any(line.startswith(f"analysis {name} LEFT OUT: {reason}") for line in lines), name
    left_out = "missing of extra-errors 1.2 (extra_errors.missing:DECLARATION) is left out"
    assert f"warning W_EXTENSION: {left_out}" in told["offset"][2]


def test_the_words_for_shared_options_are_those_of_the_commands():
    assert set(SHARED_OPTIONS) == set(_SHARED)
