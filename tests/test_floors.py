"""The structure: imports go down by folder, no circle between files, one file for C++."""

from __future__ import annotations

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

from support.package_code import FILES, PACKAGE, import_statements, tree

FLOORS = (
    "visible",
    "typing",
    "typing",
    "errors",
    "call_warnings",
    "se3",
    "units",
    "compile_ahead",
    "jit",
    "inputs",
    "display",
    "draws",
    "robot",
    "terms",
    "sources",
    "sheet",
    "statistics",
    "model",
    "kernel",
    "sampling",
    "analyses",
    "outputs",
    "cli",
    "__main__",
)
"""Files and folders of the package, the lowest first."""

APART = ("old_paths",)
"""What imports modules by name only."""

MODULES = [path for path in FILES if "robots" not in path.parts]


def room(path: Path) -> str:
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


@cache
def imported_modules(path: Path) -> set[str]:
    """Every module a file imports, at any depth of the code, type-checking blocks included; full dotted names."""
    package = ["precision_pin", *path.relative_to(PACKAGE).parts[:-1]]
    names: set[str] = set()
    for node in import_statements(path):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        else:
            home = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*home, *([node.module] if node.module else [])])
            names.add(module)
            if module == "precision_pin":
                names |= {f"precision_pin.{alias.name}" for alias in node.names}
    return names


def dotted(path: Path) -> str:
    parts = ["precision_pin", *path.relative_to(PACKAGE).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported_files(path: Path, files: set[str]) -> set[str]:
    """Return which files a file imports when it is loaded; what it imports in a function comes later."""
    names: set[str] = set()
    waiting: list[ast.AST] = [tree(path)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        if isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= inner & files or {node.module}
        waiting += ast.iter_child_nodes(node)
    return names & files - {dotted(path)}


def test_every_module_has_a_floor() -> None:
    assert {room(path) for path in MODULES} - {"__init__", *APART} == set(FLOORS)


def test_no_folder_of_the_package_is_crowded() -> None:
    assert len([path for path in PACKAGE.glob("*.py") if not path.name.startswith("__")]) <= 10


def test_files_import_each_other_in_no_circle() -> None:
    files = {dotted(path) for path in MODULES}
    graph = {dotted(path): imported_files(path, files) for path in MODULES}
    tuple(TopologicalSorter(graph).static_order())


def test_imports_go_down_only() -> None:
    wrong = []
    for path in MODULES:
        own = room(path)
        if own in ("__init__", *APART):
            continue  # the package itself names what users need, late
        others = {name.split(".")[1] for name in imported_modules(path) if name.startswith("precision_pin.")}
        wrong += [
            f"{path.relative_to(PACKAGE)} imports {other}"
            for other in sorted(others - {own})
            if FLOORS.index(other) >= FLOORS.index(own)
        ]
    assert wrong == []


def test_only_one_file_of_the_package_uses_pinocchio() -> None:
    users = [path.name for path in MODULES if any(n.split(".")[0] == "pinocchio" for n in imported_modules(path))]
    assert users == ["pinocchio_model.py"]


def test_sources_and_analyses_do_not_know_each_other() -> None:
    hidden = {
        "sources": {"model", "sampling", "analyses", "statistics", "kernel", "sheet"},
        **{key: {"sources"} for key in ("analyses", "kernel", "statistics")},
    }
    wrong = []
    for path in MODULES:
        others = {name.split(".")[1] for name in imported_modules(path) if name.startswith("precision_pin.")}
        known = others & hidden.get(room(path), set())
        wrong += [f"{path.relative_to(PACKAGE)} imports {other}" for other in sorted(known)]
    assert wrong == []


def test_no_file_is_two_rooms() -> None:
    lengths = {str(path.relative_to(PACKAGE)): len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES}
    # all compiled code stays in one file: numba's cache does not see an edit of a callee in another file
    too_long = {name: length for name, length in lengths.items() if length > 620 and name != "kernel/loops.py"}
    assert too_long == {}


def test_code_and_tests_name_no_place_outside_the_project() -> None:
    root = PACKAGE.parent.parent
    for folder in ("src", "tests", "scripts", "docs", "robots", "benchmarks", ".ci"):
        for path in (root / folder).rglob("*"):
            if path.suffix in (".py", ".md", ".yaml", ".urdf", "") and path.is_file() and path != Path(__file__):
                text = path.read_text(encoding="utf-8", errors="replace")
                assert "/wo" + "rk/" not in text, path
                assert "../sha" + "red" not in text, path


def test_arrays_have_one_name() -> None:
    homes = [
        str(path.relative_to(PACKAGE))
        for path in MODULES
        if "= NDArray[np.float64]" in path.read_text(encoding="utf-8")
    ]
    assert homes == ["typing.py"]
