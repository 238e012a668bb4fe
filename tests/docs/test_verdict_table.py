"""Every sentence that promises something has a row in docs/verdicts.md, and every test that the table names exists."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import precision_pin

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PACKAGE = Path(precision_pin.__file__).parent
FOLDERS = ("analyses", "cli", "export", "model", "pages", "render", "sampling", "statistics")
WORDS = re.compile(
    r"\{VERDICT\}|\b(MET|NOT MET|[Mm]et|holds?|at least|at most|bounds?|certified|agrees?|AGREES|DISAGREES?|worst|never|always"
    r"|no allocation)\b(?!-case)"
)


def rows() -> list[list[str]]:
    """Return the cells of both tables."""
    text = (ROOT / "docs" / "verdicts.md").read_text(encoding="utf-8")
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| `")]
    assert len(lines) > 30
    return lines


def quoted(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)


def sentences(tree: ast.Module) -> Iterator[str]:
    """Yield the texts of a module that it may print, {} for what is filled in; neither docstrings, refusals nor keys."""
    left_out: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise):
            left_out |= {id(one) for one in ast.walk(node)}
        elif isinstance(node, ast.Expr):
            left_out.add(id(node.value))
        elif isinstance(node, ast.JoinedStr):
            left_out |= {id(one) for one in ast.walk(node) if isinstance(one, ast.Constant)}
    for node in ast.walk(tree):
        if id(node) in left_out:
            continue
        if isinstance(node, ast.JoinedStr):
            yield "".join(one.value if isinstance(one, ast.Constant) else filled_in(one) for one in node.values)
        elif (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and not re.fullmatch(r"[a-z_.=*]+", node.value)
        ):
            yield node.value


def filled_in(node: ast.expr) -> str:
    """Return {VERDICT} for a verdict in capitals: its own word, or what is said of it with its grounds."""
    return "{VERDICT}" if re.search(r"verdict.*\.upper\(\)|\.said\b", ast.unparse(node)) else "{}"


def test_every_sentence_has_a_row() -> None:
    known: dict[str, list[str]] = {}
    for row in rows():
        for file in quoted(row[1]):
            assert (PACKAGE / file).exists(), file
            known.setdefault(file, []).extend(quoted(row[0]))
    missing = []
    for folder in FOLDERS:
        for path in sorted((PACKAGE / folder).rglob("*.py")):
            file = path.relative_to(PACKAGE).as_posix()
            for text in sentences(ast.parse(path.read_text(encoding="utf-8"))):
                if WORDS.search(text) and not any(part in text for part in known.get(file, [])):
                    missing.append(f"{file}: {text}")
    assert missing == []


def test_every_sentence_of_the_table_is_printed() -> None:
    stale = []
    for row in rows():
        texts = [text for file in quoted(row[1]) for text in sentences(ast.parse((PACKAGE / file).read_text("utf-8")))]
        stale += [part for part in quoted(row[0]) if not any(part in text for text in texts)]
    assert stale == []


def test_every_test_of_the_table_exists() -> None:
    named = [name for row in rows() for name in re.findall(r"`(tests/\S+\.py::\w+)`", " ".join(row[2:]))]
    assert len(named) > 25
    for name in named:
        file, _, function = name.partition("::")
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        assert function in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}, name
    promised = [row for row in rows() if len(row) == 4]
    assert [row[0] for row in promised if "::" not in row[3]] == []
