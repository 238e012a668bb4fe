"""The scripts of ``examples/`` as the gallery shows them: question, answer, picture and code, made by running them."""

from __future__ import annotations

import ast
import contextlib
import io
import re
import runpy
import shutil
import tempfile
from pathlib import Path
from typing import Final

EXAMPLES: Final = Path(__file__).parents[1] / "examples"
ENTRY: Final = re.compile(r"^- \[(\w+)\]\(\.\./examples/\1\.py\)$", re.MULTILINE)
"""A line of the page: the script's name, linked to its file."""
STYLE: Final = {"backend": "Agg", "savefig.dpi": 160}  # sharp on screens with two pixels for one


def question(script: Path) -> str:
    """Return the question that a script answers: the first line of its docstring."""
    return _docstring(script).partition("\n")[0]


def _docstring(script: Path) -> str:
    return ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""


def run(script: Path, folder: Path) -> str:
    """Run a script in a folder, which its files go to; return what it prints."""
    import matplotlib as mpl  # late: it takes half a second, which who only looks for questions need not wait for
    import matplotlib.pyplot as plt

    printed = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed), mpl.rc_context(STYLE):
        runpy.run_path(str(script), run_name="__main__")
    plt.close("all")
    return printed.getvalue()


def filled(text: str, folder: Path) -> str:
    """Return the page with all questions at its top and every script run in the place of its link.

    Pictures go to ``folder``, which lies in a folder of the page's.
    """
    folder.mkdir(parents=True, exist_ok=True)
    questions = [f"- [{question(EXAMPLES / f'{name}.py')}](#{name})\n" for name in ENTRY.findall(text)]
    head, groups, rest = text.partition("\n## ")
    return f"{head}\n{''.join(questions)}{groups}{ENTRY.sub(lambda match: _section(match[1], folder), rest)}"


def _section(name: str, pictures: Path) -> str:
    script, picture = EXAMPLES / f"{name}.py", f"{name}.png"
    with tempfile.TemporaryDirectory() as folder:
        answer = run(script, Path(folder))
        if is_drawn := Path(folder, picture).exists():
            shutil.copy(Path(folder, picture), pictures)
    asked, _, case = _docstring(script).partition("\n\n")
    first = ast.parse(script.read_text(encoding="utf-8")).body[1].lineno
    parts = [
        f"({name})=\n\n### {asked}\n",
        f"{case}\n",
        f"```text\n{answer}```\n",
        f"```{{image}} {pictures.parent.name}/{pictures.name}/{picture}\n:alt: {asked}\n```\n" * is_drawn,
        f"```{{literalinclude}} ../examples/{name}.py\n:language: python\n:lines: {first}-\n```\n",
    ]
    return "\n".join(parts)
