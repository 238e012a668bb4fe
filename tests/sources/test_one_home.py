"""A source has one home: nothing outside it names its kind, and one file reads the settings of sources."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator

import pytest

from precision_pin.sources import catalogue
from support.package_code import FILES, PACKAGE, import_statements, tree

ABOVE = ("sheet", "model", "export", "kernel", "sampling", "analyses", "pages", "cli")
"""What may know sources at all; the folders below cannot."""
HOMES = (
    "sources/",
    "export/scaffold.py",
    "model/frame_models.py",
    "sheet/measurement.py",
)
"""Where kinds of sources may be named: the others are models made of them, and the load of a measurement, a payload."""
CODE = {path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8") for path in FILES}
OUTSIDE = [name for name in CODE if name.startswith(ABOVE) and not name.startswith(HOMES)]
KINDS = catalogue()
WORDS_OF_RESULTS = {"covariance", "frame", "length", "mcpc", "table"}
"""Kinds that are keys of results and tables too."""
CLASSES_OF_OTHERS = {"Covariance", "Frame", "Length", "Mcpc", "Table"}
"""Classes of sources whose names other things have too."""


def texts(module: ast.Module) -> Iterator[str]:
    """Yield the texts of a file that are not docstrings."""
    nodes = list(ast.walk(module))
    alone = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone:
            yield node.value


def imports(name: str) -> Iterator[tuple[str, str]]:
    """Yield modules and the names that are imported from them; of whole modules the name is empty."""
    for node in import_statements(PACKAGE / name):
        if isinstance(node, ast.ImportFrom):
            yield from ((node.module or "", alias.name) for alias in node.names)
        else:
            yield from ((alias.name, "") for alias in node.names)


def identifiers(code: str) -> set[str]:
    return {
        entry.string for entry in tokenize.generate_tokens(io.StringIO(code).readline) if entry.type == tokenize.NAME
    }


def named(code: str, module: ast.Module) -> set[str]:
    """Return the kinds and classes of sources that a file names."""
    classes = {kind.__name__ for kind in KINDS.values()} - CLASSES_OF_OTHERS
    long_kinds = {kind for kind in KINDS if "_" in kind}
    found = set(re.findall(r"\w+", code)) & (classes | long_kinds)
    if found:  # taking a file apart is slow: only where a word is there at all, and may stand in a comment
        found &= identifiers(code)
    for text in texts(module):
        # sentences may hold words of the field; what is one word, or begins a label, is a kind
        words = {text, text.partition("[")[0]} - WORDS_OF_RESULTS
        found |= (words & set(KINDS)) | (set(re.findall(r"\w+", text)) & (classes | long_kinds))
    return found


@pytest.mark.slow
def test_no_file_outside_its_home_names_a_source():
    assert len(OUTSIDE) > 100
    assert {name: kinds for name in OUTSIDE if (kinds := named(CODE[name], tree(PACKAGE / name)))} == {}
    imported = {
        name: [what for module, what in imports(name) if module.startswith("precision_pin.sources")] for name in OUTSIDE
    }
    assert {name: what for name, what in imported.items() if not set(what) <= {"catalogue"}} == {}


@pytest.mark.parametrize(
    "line",
    [
        'KINDS = {"backlash": 1}',
        'isinstance(source, Backlash)',
        'text = f"encoder[{joint}]"',
        'text = "the joint_offset of it"',
        'if source.kind() == "thermal": pass',
    ],
)  # fmt: skip
def test_a_file_that_names_a_source_would_be_found(line):
    assert named(line, ast.parse(line))


def test_pages_import_no_sources():
    users = [name for name, code in CODE.items() if name.startswith("pages/") and "precision_pin.sources" in code]
    assert users == []


def reflects(name: str) -> bool:
    calls = {what for module, what in imports(name) if module in ("typing", "dataclasses")} & {
        "get_type_hints",
        "fields",
    }
    return bool(
        calls or re.search(r"get_type_hints|dataclasses\.fields|__dataclass_fields__|__annotations__", CODE[name])
    )


@pytest.mark.slow
def test_one_file_reflects_over_sources():
    assert [name for name, code in CODE.items() if "get_type_hints" in code] == ["terms/source.py"]
    knowing = [
        name
        for name in CODE
        if any(
            module.startswith(("precision_pin.sources", "precision_pin.terms"))
            or what in ("Source", "catalogue", "Sheet")
            for module, what in imports(name)
        )
        or name.startswith(("sources/", "terms/"))
    ]
    assert len(knowing) > 30
    assert [name for name in knowing if reflects(name)] == ["terms/source.py"]
