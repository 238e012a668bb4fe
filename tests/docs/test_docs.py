"""README and docs: every block runs, every link leads somewhere, every table is in step with the code.

In a page's ``python`` blocks, which share one namespace, ``# → text`` behind a line is what that line prints. In a
``console`` block every ``$`` line is a ``precision-pin`` command, ``# exit N`` behind it its exit code if not 0, and the
lines below it, if any, what it prints (``...`` for anything). A ``yaml`` block with ``# file: NAME`` at its top is
that file; any other is part of a sheet of the paper's arm. An ``xml`` block is the file that its first line names. Every
page runs in a folder with the paper's arm and sheet, and with nothing installed but what the first set-up line installs,
unless it names an extra (``precision-pin[xarray]``).
"""

import ast
import contextlib
import doctest
import functools
import importlib
import importlib.metadata
import importlib.util
import inspect
import io
import itertools
import json
import re
import shlex
import shutil
import sys
import tomllib
import types
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import precision_pin as pp
from cli.conftest import undrawn_figures  # noqa: F401  (a fixture for all of these tests)
from precision_pin import cli
from precision_pin.base.errors import InputError
from precision_pin.base.extensions import GROUPS
from precision_pin.cli import exit_codes
from precision_pin.cli.explain import list_codes
from precision_pin.cli.program import list_commands
from precision_pin.draws.draw import MOST_POSES, MOST_VISITS
from precision_pin.draws.expressions import MOST_OPERATIONS
from precision_pin.draws.laws.projection import FARTHEST_NORMAL
from precision_pin.kernel.sampler import BLOCK
from precision_pin.model.error_model import ErrorModel
from precision_pin.robot.examples import example_urdfs
from precision_pin.sheet import read
from precision_pin.sheet.reader import LARGEST_FILE
from precision_pin.sheet.text import MOST_LEVELS, MOST_NODES
from precision_pin.sources import catalogue
from support.package_code import FILES, import_statements

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = {path.relative_to(ROOT).as_posix(): path for path in (ROOT / "README.md", *sorted(DOCS.glob("*.md")))}
QUICK = {"docs/errata.md", "docs/moments.md", "docs/start.md", "docs/sources.md", "docs/export.md", "docs/model.md"}
"""Pages whose blocks run in less than a second; those without blocks that run take no time."""
LANGUAGES = {"python", "console", "yaml", "xml", "toml", "text"}
HEAD = {"precision-pin": "1", "robot": "4dof.urdf", "tip": "tool"}
OF_THE_RUNNER = {"pytest", "_pytest", "pluggy", "iniconfig", "xdist", "execnet"}
SAME = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def _load(name: str) -> types.ModuleType:
    spec = importlib.util.spec_from_file_location(f"docs_{name}", DOCS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


generate = _load("generate")
architecture = _load("draw_architecture")


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text and the line of its first line."""

    language: str
    text: str
    line: int


def blocks(page: str) -> Iterator[Block]:
    text = PAGES[page].read_text(encoding="utf-8")
    for match in re.finditer(r"^```(\w*)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        yield Block(match[1], match[2], text[: match.start(2)].count("\n") + 1)


def takes_long(page: str) -> bool:
    return page not in QUICK and any(block.language in ("python", "console") for block in blocks(page))


# --- blocks ---


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    for path in (ROOT / "src" / "precision_pin" / "robots").glob("4dof.*"):
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@dataclass(frozen=True)
class Hidden:
    """A finder that has none of these modules, and stands before those that have."""

    modules: set[str]

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name.partition(".")[0] in self.modules:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def plain(name: str) -> str:
    """Return the name of a distribution as PyPI normalises it."""
    return re.sub(r"[-_.]+", "-", name).lower()


@functools.cache
def owners_of_modules() -> dict[str, list[str]]:
    """Return the distributions that install each module; reading what all of them list takes half a second."""
    return dict(importlib.metadata.packages_distributions())


def locked() -> set[str]:
    """Return the names of the distributions that the first set-up line installs."""
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    return {"precision-pin", *re.findall(r"^([a-z0-9-]+)==", text, re.MULTILINE)}


@pytest.fixture(autouse=True)
def _forget_half_of_trimesh() -> Iterator[None]:
    """Forget trimesh if a page loads it first: what is hidden here would be missing from it in later tests."""
    was_loaded = "trimesh" in sys.modules
    yield
    if not was_loaded:
        for module in [name for name in sys.modules if name.partition(".")[0] == "trimesh"]:
            del sys.modules[module]


@pytest.fixture(autouse=True)
def _undrawn_files(monkeypatch) -> None:
    """Leave the files of figures empty, which no page prints."""
    monkeypatch.setattr(
        "precision_pin.render.figure_style._ShownFigure.savefig", lambda _, stream, **__: stream.write(b"")
    )


def set_up_like_a_reader(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide what the tests have installed and the first set-up line has not, unless the page names an extra."""
    if re.search(r"precision-pin\[\w+\]", PAGES[page].read_text(encoding="utf-8")):
        return
    here, found = locked(), importlib.metadata.distribution

    def distribution(name: str) -> importlib.metadata.Distribution:
        if plain(name) not in here:
            raise importlib.metadata.PackageNotFoundError(name)
        return found(name)

    hidden = {
        module
        for module, owners in owners_of_modules().items()
        if module not in OF_THE_RUNNER and not {plain(owner) for owner in owners} & here
    }
    for module in [name for name in sys.modules if name.partition(".")[0] in hidden]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setattr(sys, "meta_path", [Hidden(hidden), *sys.meta_path])
    monkeypatch.setattr(importlib.metadata, "distribution", distribution)


@pytest.mark.slow
def test_a_reader_has_the_examples_and_not_what_only_the_tests_need(monkeypatch):
    set_up_like_a_reader("README.md", monkeypatch)
    assert example_urdfs()
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("xarray")
    with pytest.raises(importlib.metadata.PackageNotFoundError):
        importlib.metadata.distribution("hypothesis")


@pytest.mark.slow
def test_the_package_imports_nothing_that_is_neither_locked_nor_an_extra():
    # Pinocchio is found by a path of its own, this package by its sources
    owners = owners_of_modules() | {"precision_pin": ["precision-pin"], "pinocchio": ["pin"], "coal": ["coal"]}
    here = locked()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = " ".join(itertools.chain.from_iterable(project["optional-dependencies"].values()))
    for path in FILES:
        for node in import_statements(path):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            for name in {name.partition(".")[0] for name in names} - sys.stdlib_module_names:
                homes = set(map(plain, owners.get(name, [])))
                assert homes & here or any(home in extras for home in homes), f"{path}: {name} is in no lock"


@pytest.mark.parametrize("page", [pytest.param(page, marks=[pytest.mark.slow] * takes_long(page)) for page in PAGES])
def test_every_block_runs(page, folder, monkeypatch):
    set_up_like_a_reader(page, monkeypatch)
    module = types.ModuleType(f"page_{re.sub(r'[^a-z]', '_', page)}")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    for block in blocks(page):
        where = f"{page}:{block.line}"
        match block.language:
            case "python":
                run_python(block, where, module)
            case "console":
                run_console(block, where, monkeypatch)
            case "yaml":
                read_yaml(block, where, folder)
            case "xml":
                named = re.match(r"<!-- file: (\S+) -->\n", block.text)
                assert named, f"{where}: the first line names the file"
                (folder / named[1]).write_text(block.text, encoding="utf-8")
            case "toml":
                points = tomllib.loads(block.text)["project"]["entry-points"]
                assert set(points) <= {f"precision_pin.{kind}" for kind in GROUPS}, where


def run_python(block: Block, where: str, module: types.ModuleType) -> None:
    printed = io.StringIO()
    # blank lines before it, so that a failure names the line of the page
    code = compile(
        "\n" * (block.line - 1) + block.text, str(PAGES[where.rpartition(":")[0]]), "exec", dont_inherit=True
    )
    with contextlib.redirect_stdout(printed):
        exec(code, module.__dict__)
    expected = re.findall(r"# → (.+)$", block.text, re.MULTILINE)
    assert printed.getvalue().splitlines() == expected, where


def run_console(block: Block, where: str, monkeypatch) -> None:
    assert block.text.startswith("$ "), where
    for entry in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
        line, _, shown = entry.partition("\n")
        words = shlex.split(line, comments=True)
        assert words[0] == "precision-pin", f"{where}: only precision-pin may stand behind $"
        stated = re.search(r"# exit (\d+)", line)
        code, printed = command_line(words, monkeypatch)
        assert code == (int(stated[1]) if stated else 0), f"{where}: {line}\n{printed}"
        if shown.strip():
            checker, example = doctest.OutputChecker(), doctest.Example("", shown)
            difference = checker.output_difference(example, printed, SAME)
            assert checker.check_output(shown, printed, SAME), f"{where}: {line}\n{difference}"


def command_line(words: list[str], monkeypatch) -> tuple[int, str]:
    """Return the exit code, and what stdout and then stderr show."""
    out, err = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "argv", words)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), pytest.raises(SystemExit) as end:
        cli.main()
    messages = [line for line in err.getvalue().splitlines() if "\r" not in line]
    return int(end.value.code or 0), out.getvalue() + "\n".join(messages) + "\n"


def read_yaml(block: Block, where: str, folder: Path) -> None:
    named = re.match(r"# file: (\S+)\n", block.text)
    if named:
        (folder / named[1]).write_text(block.text, encoding="utf-8")
        return
    given = set(re.findall(r"^([\w-]+):", block.text, re.MULTILINE))
    assert given, f"{where}: a fragment of a sheet begins with a top-level key"
    head = "".join(f"{key}: {value}\n" for key, value in HEAD.items() if key not in given)
    fragment = folder / "fragment.errors.yaml"
    fragment.write_text(head + block.text, encoding="utf-8")
    try:
        ErrorModel.from_sheet(read(fragment))  # what there is to warn of a fragment is no news
    except InputError as error:
        pytest.fail(f"{where}: {error}")


def test_every_block_names_its_language():
    for page in PAGES:
        assert {block.language for block in blocks(page)} <= LANGUAGES, page


def test_the_runner_notices_what_is_wrong(folder, monkeypatch):
    page = next(iter(PAGES))
    module = types.ModuleType("page")
    with pytest.raises(AssertionError):
        run_python(Block("python", "print(1 + 1)  # → 3\n", 1), f"{page}:1", module)
    for text in ("$ precision-pin nonsense\n", "$ precision-pin check  # exit 2\n", "$ precision-pin check\nbad\n"):
        with pytest.raises(AssertionError):
            run_console(Block("console", text, 1), page, monkeypatch)
    with pytest.raises(pytest.fail.Exception):
        read_yaml(Block("yaml", "sources:\n  - lenght: {joint: joint1}\n", 1), page, folder)


# --- docstrings ---


WITHOUT_EXAMPLE = {"PrecisionPinError", "Source", "ur_calibration"}
"""Public names that nobody calls, and one that reads a file of a robot's maker."""
SOURCES = {f"sources.{kind.__name__}": kind for kind in catalogue().values()}
PUBLIC = {name: getattr(pp, name) for name in pp.__all__} | SOURCES | {"mcpc.from_chain": pp.mcpc.from_chain}


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, it in PUBLIC.items() if not inspect.ismodule(it)])
def test_examples_of_docstrings_print_what_stands_there(name, folder):
    tests = doctest.DocTestFinder().find(PUBLIC[name], name, module=False, globs={"pp": pp, "np": np})
    assert bool(tests[0].examples) is (name not in WITHOUT_EXAMPLE)
    runner, printed = doctest.DocTestRunner(), io.StringIO()
    for test in tests:
        runner.run(test, out=printed.write)
    assert not runner.failures, printed.getvalue()


# --- links ---


def prose(page: str) -> str:
    """Return a page without its blocks and code."""
    text = re.sub(r"^```.*?^```$", "", PAGES[page].read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"`[^`\n]+`", lambda code: re.sub(r"[^\w -]", "", code[0]), text)


def anchors(path: Path) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_and_pictures_lead_somewhere():
    for page in PAGES:
        check_links(page, prose(page))
    # what the site alone has
    for page, made in generate.BUILT.items():
        text = (DOCS / page).read_text(encoding="utf-8")
        assert set(made) <= set(re.findall(r"<!-- (?:built|table): (.+?) -->", text)), page
        assert set(re.findall(r"<!-- built: (.+?) -->", text)) <= set(made), page
        check_links(f"docs/{page}", "".join(text() for text in made.values()))


def check_links(page: str, text: str) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if target.startswith(("https://", "http://")):
            continue
        name, _, anchor = target.partition("#")
        path = (PAGES[page].parent / name) if name else PAGES[page]
        assert path.exists(), f"{page}: {target}"
        assert not anchor or anchor in anchors(path), f"{page}: {target}"


def test_the_index_names_every_page_and_the_readme_stays_short_and_says_how_to_set_up():
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    pages = [path for path in (*DOCS.glob("*.md"), *DOCS.glob("*.ipynb")) if path.name != "index.md"]
    assert [path.name for path in pages if f"({path.name})" not in text] == []
    readme = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(readme) <= 107
    set_up = [line for line in readme if line.startswith("    python3 -m venv .venv && ")]
    commands = [line.rpartition(" && ")[2] for line in set_up]
    assert commands == [".venv/bin/precision-pin analyze", ".venv/bin/python -m pytest"]
    start = (DOCS / "start.md").read_text(encoding="utf-8").splitlines()
    assert next(line for line in start if " -m venv " in line) in readme


# --- tables ---


def test_generated_tables_are_in_step():
    for page in generate.TABLES:
        text = (DOCS / page).read_text(encoding="utf-8")
        assert set(re.findall(r"<!-- table: (.+?) -->", text)) == set(generate.TABLES[page])
        assert text == generate.spliced(page, text), "run: python docs/generate.py"


@pytest.mark.slow
def test_the_picture_of_the_architecture_is_in_step():
    assert architecture.PICTURE.read_text(encoding="utf-8") == architecture.picture(), (
        "run: python docs/draw_architecture.py"
    )


def test_the_picture_leaves_out_arrows_that_follow_from_others():
    graph = {"top": {"middle", "bottom"}, "middle": {"bottom"}, "bottom": set(), "aside": {"bottom"}}
    assert architecture.floors(graph) == {"top": 2, "middle": 1, "bottom": 0, "aside": 2}
    assert architecture.direct(graph) == [("aside", "bottom"), ("middle", "bottom"), ("top", "middle")]


def rows(page: str, first_column: str) -> list[list[str]]:
    """Return the rows of the table whose first column has this heading."""
    text = (DOCS / page).read_text(encoding="utf-8")
    found = re.search(rf"^\| {re.escape(first_column)} \|.*\n\| ---.*\n((?:\|.*\n)+)", text, re.MULTILINE)
    assert found is not None, f"{page} has no table {first_column!r}"
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in found[1].splitlines()]


def resolve(dotted: str) -> object:
    """Return what a dotted name inside the package stands for."""
    parts = dotted.split(".")
    for count in range(len(parts), 0, -1):
        name = ".".join(["precision_pin", *parts[:count]])
        with contextlib.suppress(ModuleNotFoundError):
            value: object = importlib.import_module(name)
            for part in parts[count:]:
                value = getattr(value, part)
            return value
    raise AssertionError(f"{dotted} does not exist")


@functools.cache
def functions_of(file: str) -> set[str]:
    tree = ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


@pytest.mark.slow
def test_every_equation_has_a_function_and_a_test():
    for number, *_, functions, tests in rows("equations.md", "eq") + rows("equations.md", "no."):
        names = re.findall(r"`([\w.]+)`", functions)
        places = [place.split("::") for place in re.findall(r"`([\w/.]+::\w+)`", tests)]
        assert names, number
        assert places, number
        for name in names:
            resolve(name)
        assert [name for file, name in places if name not in functions_of(file)] == [], number


def test_no_equation_is_missing():
    of_the_paper: list[int] = []
    for numbers, *_ in rows("equations.md", "eq"):
        first, _, last = numbers.partition("-")
        of_the_paper += range(int(first), int(last or first) + 1)
    assert of_the_paper == list(range(1, 24))
    shown: list[str] = []
    for path in DOCS.glob("*.md"):
        shown += re.findall(r"\\tag\{(\w+)\}", path.read_text(encoding="utf-8"))
    assert {tag for tag in shown if tag.isdecimal()} <= set(map(str, of_the_paper))
    assert sorted(tag for tag in shown if not tag.isdecimal()) == sorted(
        cells[0] for cells in rows("equations.md", "no.")
    )


def test_every_erratum_has_a_number_that_its_section_computes():
    text = (DOCS / "errata.md").read_text(encoding="utf-8")
    sections = re.split(r"^## (\d+)\. .+$", text, flags=re.MULTILINE)
    listed = rows("errata.md", "no.")
    assert sections[1::2] == [cells[0] for cells in listed]
    printed = " ".join(re.findall(r"# → (.+)$", text, re.MULTILINE))
    for (number, _, evidence, _), section in zip(listed, sections[2::2], strict=True):
        assert re.search(r"# → .*\d", section), f"erratum {number} computes nothing"
        shown = set(re.findall(r"[\d.]*\d", evidence))
        assert shown, f"erratum {number} has no number"
        assert shown <= set(re.findall(r"[\d.]*\d", printed)), number


def test_every_source_has_a_section():
    text = (DOCS / "sources.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^## `(\w+)`", text, re.MULTILINE)) == set(catalogue())


def test_every_command_has_a_section_and_every_exit_code_a_row():
    text = (DOCS / "command-line.md").read_text(encoding="utf-8")
    assert set(list_commands()) <= set(re.findall(r"^## `([\w-]+)`", text, re.MULTILINE))
    codes = {int(cells[0]) for cells in rows("command-line.md", "exit code")}
    ended = {128 + number for number in cli.interrupts.NAMES}
    assert codes == {0, exit_codes.EXIT_SPEC, exit_codes.EXIT_INPUT, exit_codes.EXIT_INTERNAL} | ended


@pytest.mark.slow
def test_the_keys_of_the_result_are_those_of_the_page(folder, monkeypatch):
    words = ["precision-pin", "analyze", "--samples", "500", "--spec", "45 mm", "--json", "result.json"]
    assert command_line(words, monkeypatch)[0] == 0
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    listed = [key for cells in rows("command-line.md", "key") for key in re.findall(r"`(.+?)`", cells[0])]
    assert set(paths(result)) == set(listed)
    assert len(listed) == len(set(listed))


def paths(value: object, path: str = "") -> Iterator[str]:
    """Dotted keys; S for a distribution's, and one name for keys that are names or levels."""
    if path in ("versions", "pose.q", "scopes") or path.endswith(".parameters"):
        yield path
    elif isinstance(value, dict) and set(value) >= {"mean", "quantiles"}:
        yield path
        yield from (f"S.{key}" for key in value)
    elif isinstance(value, dict):
        for key, entry in value.items():
            yield from paths(entry, f"{path}.{key}" if path else key)
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        yield from paths(value[0], f"{path}[]")
    else:
        yield path


def test_every_code_is_explained_and_every_explained_code_is_used():
    used: dict[str, str] = {}
    for path in sorted((ROOT / "src" / "precision_pin").rglob("*.py")):
        for code in re.findall(r"""["']([EW]_[A-Z0-9_]+)["']""", path.read_text(encoding="utf-8")):
            used.setdefault(code, path.relative_to(ROOT).as_posix())
    listed = [name for group in list_codes().values() for one in group.codes for name in one.names if name[0] != "N"]
    new = {code: path for code, path in used.items() if code not in listed}
    assert not new, f"cli/codes.toml has no {new}; say there what each means and what to do"
    gone = [code for code in listed if code not in used]
    assert not gone, f"cli/codes.toml has {gone}, which no file of the package uses"
    assert len(listed) == len(set(listed)), "cli/codes.toml has a code twice"


def test_every_code_in_the_prose_exists():
    source = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "src" / "precision_pin").rglob("*.py"))
    for page, path in PAGES.items():
        for code in re.findall(r"`([EW]_[A-Z0-9_]+)`", path.read_text(encoding="utf-8")):
            assert f'"{code}"' in source, f"{page}: {code}"


def test_limits_in_the_prose_are_those_of_the_code():
    for page, stated in (
        ("sheet.md", f"{LARGEST_FILE >> 20} MiB, {MOST_NODES:,} entries, {MOST_LEVELS} levels"),
        ("sheet.md", f"its mean is {FARTHEST_NORMAL} standard deviations"),
        ("model.md", f"at most {MOST_OPERATIONS} of + − × ÷"),
        ("reproducibility.md", f"at most {MOST_POSES:,} poses and {MOST_VISITS:,} visits"),
        ("reproducibility.md", f"blocks of {BLOCK:,} units"),
    ):
        assert stated in " ".join((DOCS / page).read_text(encoding="utf-8").split()), f"{page}: {stated}"
