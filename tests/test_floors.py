"""The structure: imports go down by folder, no circle between files, one file for C++, no file too long to read.

A rule takes a package and returns what breaks it; each is seen to find a fault planted in a package of a few lines.
"""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from support.package_code import PACKAGE, nodes, tree

FLOORS = (
    *("base", "statistics", "render", "draws", "robot", "terms", "sources", "sheet", "model", "writers", "kernel"),
    *("sampling", "analyses", "pages", "cli", "__main__"),
)
"""Files and folders of the package, the lowest first."""

HIDDEN = {
    "sources": {"model", "kernel", "sampling", "analyses", "statistics", "sheet", "pages", "cli"},
    "kernel": {"robot", "sources", "sheet"},
    "statistics": {"sources"},
    "analyses": {"sources", "pages", "cli"},
    "pages": {"sources"},
}
"""What a folder must not know, whether it lies above or below."""

LONGEST = 600
"""Lines of code of a file: neither docstrings nor comments nor blank lines. None is cut to fit."""

ALL_COMPILED_CODE = "kernel/loops.py"
"""It stays in one file, however long: numba's cache does not see an edit of a callee in another file."""


def modules(package):
    return sorted(path for path in package.rglob("*.py") if "robots" not in path.relative_to(package).parts)


def home(path, package):
    """Return the folder of a file, or the file itself where it lies beside them."""
    relative = path.relative_to(package)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


def dotted(path, package):
    parts = ["precision_pin", *path.relative_to(package).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def named_modules(node, path, package):
    """Return the modules that an import or a string names, and what it takes from them as if that were modules too."""
    if isinstance(node, ast.Import):
        return {alias.name for alias in node.names}
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        # a module that is imported later, by its name
        return {node.value.partition(":")[0]} if re.fullmatch(r"precision_pin(\.\w+)+(:\w+)?", node.value) else set()
    if isinstance(node, ast.ImportFrom):
        above = ["precision_pin", *path.relative_to(package).parts[:-1]]
        start = above[: len(above) - node.level + 1] if node.level else []
        module = ".".join([*start, *([node.module] if node.module else [])])
        return {module, *(f"{module}.{alias.name}" for alias in node.names)}
    return set()


@cache
def imported_modules(path, package):
    """Return every module a file imports, at any depth of the code, type-checking blocks and names in strings included."""
    return {name for node in nodes(path) for name in named_modules(node, path, package)}


@cache
def homes(package):
    return frozenset(home(path, package) for path in modules(package))


def imported_homes(path, package):
    names = {name.split(".")[1] for name in imported_modules(path, package) if name.startswith("precision_pin.")}
    return names & homes(package) - {home(path, package)}


def imported_files(path, package, files):
    """Return which files a file imports when it is loaded; what it imports in a function comes later."""
    names = set()
    waiting = [tree(path)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            continue
        if isinstance(node, ast.ImportFrom):
            found = named_modules(node, path, package) & files
            # of a folder's module it is that file, not the folder's own
            names |= {name for name in found if not any(other.startswith(f"{name}.") for other in found)}
        else:
            names |= named_modules(node, path, package) & files
        waiting += ast.iter_child_nodes(node)
    return names - {dotted(path, package)}


def without_a_floor(package):
    return sorted({home(path, package) for path in modules(package)} - {"__init__", *FLOORS})


def imports_upwards(package):
    # the package itself names what users need, late
    files = [path for path in modules(package) if home(path, package) != "__init__"]
    return [
        f"{path.relative_to(package)} imports {other}"
        for path in files
        for other in sorted(imported_homes(path, package))
        if other in FLOORS and FLOORS.index(other) >= FLOORS.index(home(path, package))
    ]


def imports_of_what_is_hidden(package):
    return [
        f"{path.relative_to(package)} imports {other}"
        for path in modules(package)
        for other in sorted(imported_homes(path, package) & HIDDEN.get(home(path, package), set()))
    ]


def circles(package):
    files = {dotted(path, package) for path in modules(package)}
    graph = {dotted(path, package): imported_files(path, package, files) for path in modules(package)}
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        return [str(error)]
    return []


def users_of_pinocchio(package):
    files = [path for path in modules(package) if path.name != "pinocchio_model.py"]
    return [path.name for path in files if any(n.split(".")[0] == "pinocchio" for n in imported_modules(path, package))]


def lines_of_code(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    left_out = {number for number, line in enumerate(lines, 1) if not line.strip() or line.strip().startswith("#")}
    for node in nodes(path):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            left_out |= set(range(node.lineno, node.end_lineno + 1))
    return len(lines) - len(left_out)


def too_long(package):
    lengths = {path.relative_to(package).as_posix(): lines_of_code(path) for path in modules(package)}
    return [f"{name}: {n} lines" for name, n in lengths.items() if n > LONGEST and name != ALL_COMPILED_CODE]


def crowded(package):
    files = [path.name for path in package.glob("*.py") if not path.name.startswith("__")]
    return files if len(files) > 10 else []


def further_names_of_arrays(package):
    """Return files that give the type of an array of numbers a name of their own."""
    return [
        f"{path.relative_to(package)}: {ast.unparse(node)}"
        for path in modules(package)
        for node in tree(path).body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        and node.value is not None
        and ast.unparse(node.value).rpartition("NDArray")[2] in ("[np.float64]", "[float]", "[numpy.float64]")
        and path.relative_to(package).as_posix() != "base/arrays.py"
    ]


RULES = {
    without_a_floor: {"attic/old.py": ""},
    imports_upwards: {
        "draws/space.py": "def f():\n    from precision_pin.model import pose_model",
        "model/pose_model.py": "",
    },
    imports_of_what_is_hidden: {
        "kernel/arrays.py": "from precision_pin.robot.chain import Chain",
        "robot/chain.py": "",
    },
    circles: {"robot/a.py": "import precision_pin.robot.b", "robot/b.py": "from precision_pin.robot import a"},
    users_of_pinocchio: {"robot/chain.py": "import pinocchio as pin"},
    too_long: {"cli/long.py": "x = 1\n" * (LONGEST + 1)},
    crowded: {f"module{k}.py": "" for k in range(11)},
    further_names_of_arrays: {"draws/space.py": "Numbers = npt.NDArray[np.float64]"},
}
"""Each rule, and files in which it must find a fault."""


@pytest.mark.slow
@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_the_package_keeps_the_rule(rule):
    assert rule(PACKAGE) == []
    assert set(FLOORS) <= {home(path, PACKAGE) for path in modules(PACKAGE)}


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_the_rule_finds_a_planted_fault(rule, tmp_path):
    for name, text in RULES[rule].items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert rule(tmp_path)


def test_code_and_tests_name_no_place_outside_the_project():
    root = PACKAGE.parent.parent
    for folder in ("src", "tests", "scripts", "docs", "examples", "benchmarks", ".ci"):
        for path in (root / folder).rglob("*"):
            if path.suffix in (".py", ".md", ".yaml", ".urdf", "") and path.is_file() and path != Path(__file__):
                text = path.read_text(encoding="utf-8", errors="replace")
                assert "/wo" + "rk/" not in text, path
                assert "../sha" + "red" not in text, path
