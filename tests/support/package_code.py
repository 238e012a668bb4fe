"""The package's own files as trees of syntax, each parsed once for all the tests that look at the code."""

import ast
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "src" / "precision_pin"
FILES = sorted(PACKAGE.rglob("*.py"))


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """Return all that a file's tree has: to walk through it takes as long as to parse it."""
    return tuple(ast.walk(tree(path)))


@cache
def import_statements(path: Path) -> tuple[ast.Import | ast.ImportFrom, ...]:
    """Return the imports of a file, at any depth of the code."""
    return tuple(node for node in nodes(path) if isinstance(node, ast.Import | ast.ImportFrom))
