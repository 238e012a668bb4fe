"""How Sphinx builds the site: ``python -m sphinx -W -b html docs docs/_build/html``. It needs no network."""

from __future__ import annotations

import functools
import gc
import importlib
import inspect
import pkgutil
import re
import sys
from collections.abc import Mapping
from html import escape
from importlib.metadata import version as installed_version
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Any, Final

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx import addnodes
from sphinx.pycode.parser import Parser
from sphinx.util.docutils import SphinxDirective
from sphinx.util.inspect import stringify_signature

import precision_pin

if TYPE_CHECKING:
    from sphinx.addnodes import pending_xref
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment
    from sphinx.writers.html5 import HTML5Translator

project = "precision-pin"
version = release = installed_version(project)
copyright = "2026, the precision-pin authors"

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
exclude_patterns = ["_build", "drawings"]
highlight_language = "text"

html_theme = "furo"
html_title = "precision-pin"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_copy_source = False

copybutton_prompt_text = "$ "  # of a console block only the commands are copied, without what they print

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3  # links such as page.md#heading work here as on a forge
nb_execution_mode = "off"  # the tutorial is kept executed

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # types are shown as they are written, see signature_as_written
autodoc_use_type_comments = False  # there are none, and to look for them takes its time
python_maximum_signature_line_length = 88
python_use_unqualified_type_names = True
napoleon_numpy_docstring = False
napoleon_custom_sections = [("Attributes", "params_style")]

PAGES: Final = Path(__file__).parent
GROUP: Final = re.compile(r"^## (.+)\n((?:\n|(?!#).+\n)*)", re.MULTILINE)
PAGE: Final = re.compile(r"^- \[[^]]*\]\(([\w/-]+)\.\w+\)", re.MULTILINE)
WORDS: Final = re.compile(r"^- \*\*(.+?)\*\*:", re.MULTILINE)
CODE: Final = re.compile(r"(``.*?``|:\w+:`[^`]*`)")
MARK: Final = re.compile(r"\||(?<=\w)_(?!\w)")
BACKTICKS: Final = re.compile(r"`([^`]+)`")
WORD: Final = re.compile(r"(?<![\w.'\"])[A-Za-z]\w*")
TAG: Final = re.compile(r"\\tag\{(\w+)\}")


def add_toctrees(app: Sphinx, docname: str, source: list[str]) -> None:
    """Make the lists of the index the site's table of contents, so that the index reads well on a forge too."""
    del app
    if docname == "index":
        for title, text in GROUP.findall(source[0]):
            pages = "\n".join(PAGE.findall(text))
            if pages:
                source[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{pages}\n```\n"


def fill(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put in what a page has on the site alone."""
    del app
    if "<!-- built: " in source[0] or "<!-- table: " in source[0]:
        sys.path.insert(0, str(PAGES))
        source[0] = importlib.import_module("generate").built(f"{docname}.md", source[0])


def fill_gallery(app: Sphinx, docname: str, source: list[str]) -> None:
    """Run the scripts that the gallery lists."""
    if docname == "gallery":
        sys.path.insert(0, str(PAGES))
        source[0] = importlib.import_module("gallery").filled(source[0], app.srcdir / "_build" / "gallery")


def add_index_entries(app: Sphinx, docname: str, source: list[str]) -> None:
    """Make the words of the glossary entries of the index, which a search puts first."""
    del app
    if docname == "glossary":
        words = [word for entry in WORDS.findall(source[0]) for word in entry.split(", ")]
        title, text = source[0].split("\n", 1)
        entries = "\n".join(f"! single: {word}" for word in words)
        source[0] = f"{title}\n\n```{{eval-rst}}\n.. index::\n{indent(entries, '   ')}\n```\n{text}"


def escape_marks(app: Sphinx, what: str, name: str, it: object, options: object, lines: list[str]) -> None:
    """Keep reStructuredText from reading ``|d|`` and ``w_`` in docstrings as references, and ```x``` as a title.

    Formulas that stand indented in a module's docstring stay as they are written, and so do examples.
    """
    del app, name, it, options
    read: list[str] = []
    is_formula = is_example = False
    for line, before in zip(lines, ["", *lines], strict=False):
        is_example = bool(line.strip()) and (is_example or line.lstrip().startswith(">>>"))
        is_indented = what == "module" and line.startswith("    ")
        if is_indented and not is_formula and not before:
            read += ["::", ""]
            is_formula = True
        is_formula = is_formula and (is_indented or not line)
        if not is_formula and not is_example:
            parts = CODE.split(line)
            parts[::2] = [BACKTICKS.sub(r"``\1``\\ ", MARK.sub(r"\\\g<0>", part)) for part in parts[::2]]
            line = "".join(parts)
        read.append(line)
    lines[:] = read


def signature_as_written(
    app: Sphinx, what: str, name: str, it: object, options: object, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    """Return a signature of the package with its types as the code has them, not the long names behind their aliases."""
    del app, name, options
    if signature is None or not callable(it) or not it.__module__.startswith("precision_pin"):
        return signature, returns
    names = vars(sys.modules[it.__module__])
    read = inspect.signature(it)
    parameters = [
        entry.replace(annotation=linked(entry.annotation, names), default=readable(entry.default))
        for entry in read.parameters.values()
    ]
    if what == "method" and parameters and parameters[0].name in ("self", "cls"):
        del parameters[0]
    result = read.empty if inspect.isclass(it) else linked(read.return_annotation, names)
    return stringify_signature(read.replace(parameters=parameters, return_annotation=result)), None


def linked(annotation: object, names: Mapping[str, object]) -> object:
    """Return an annotation with the package's classes by their full names, shown by their last."""

    def full(match: re.Match[str]) -> str:
        value = names.get(match[0])
        if not inspect.isclass(value) or not value.__module__.startswith("precision_pin."):
            return match[0]
        return f"~{value.__module__}.{value.__qualname__}"

    return WORD.sub(full, annotation) if isinstance(annotation, str) else annotation


class Bare(str):
    """A text that stands in a signature without quotation marks."""

    __repr__ = str.__str__


def readable(default: object) -> object:
    """Return a default as it is shown: a class or function by its name, without its address."""
    if default is inspect.Parameter.empty or not (inspect.isroutine(default) or inspect.isclass(default)):
        return default
    return Bare("..." if default.__name__ == "<lambda>" else default.__name__)


class Rooms(SphinxDirective):
    """Document modules, one section each.

    ``name.*`` stands for those of a package that the page has not listed, ``others`` for those of public names that no page
    has listed.
    """

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        named = [line.strip() for line in self.content if line.strip()]
        modules: dict[str, None] = {}
        for name in named:
            if name.endswith(".*"):
                package = importlib.import_module(name.removesuffix(".*"))
                found = [f"{package.__name__}.{entry.name}" for entry in pkgutil.iter_modules(package.__path__)]
                modules |= dict.fromkeys(sorted(set(found) - set(named)))
            elif name == "others":
                modules |= dict.fromkeys(sorted(unlisted_homes()))
            else:
                modules[name] = None
        sections = []
        for name in modules:
            title = name.removeprefix("precision_pin.")
            sections.append(f"``{title}``\n{'=' * (len(title) + 4)}\n\n.. automodule:: {name}\n   :members:\n\n")
        return self.parse_text_to_nodes("".join(sections), allow_section_headings=True)


def unlisted_homes() -> set[str]:
    """Return the modules of public names that no page of the reference lists, by themselves or by their package."""
    listed = {
        line.strip().removesuffix(".*") for page in PAGES.glob("api/*.rst") for line in page.open(encoding="utf-8")
    }
    objects = [getattr(precision_pin, name) for name in precision_pin.__all__]
    homes = {it.__name__ if inspect.ismodule(it) else it.__module__ for it in objects}
    return {home for home in homes if home not in listed and home.rpartition(".")[0] not in listed}


class PublicNames(SphinxDirective):
    """A table of what ``import precision_pin as pp`` gives, each name with the first line of its docstring."""

    def run(self) -> list[nodes.Node]:
        """Return the table."""
        lines = [".. list-table::", "   :header-rows: 1", "", "   * - name", "     - what it is"]
        for name in precision_pin.__all__:
            first = (inspect.getdoc(getattr(precision_pin, name)) or "").partition("\n")[0].replace("|", r"\|")
            role = "mod" if inspect.ismodule(getattr(precision_pin, name)) else "obj"
            lines += [f"   * - :py:{role}:`pp.{name} <precision_pin.{name}>`", f"     - {first}"]
        return self.parse_text_to_nodes("\n".join(lines))


def find_public_name(
    app: Sphinx, env: BuildEnvironment, node: pending_xref, contents: nodes.TextElement
) -> nodes.reference | None:
    """Resolve ``precision_pin.NAME`` where the name stands in the package for something in a module of it."""
    package, _, name = node.get("reftarget", "").rpartition(".")
    if node.get("refdomain") != "py" or package != "precision_pin" or name not in precision_pin.__all__:
        return None
    it = getattr(precision_pin, name)
    domain = env.domains.python_domain
    if inspect.ismodule(it):  # one that has moved, under its public name
        return domain.resolve_xref(env, node["refdoc"], app.builder, "mod", it.__name__, node, contents)
    homes = it.__module__.split(".")  # a package documents what its modules define
    targets = [".".join([*homes[:count], name]) for count in range(len(homes), 1, -1)]
    target = next((target for target in targets if target in domain.objects), "")
    return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", target, node, contents)


def shorten_search(app: Sphinx, env: BuildEnvironment) -> None:
    """Look up only those names with which one of the reference ends: Sphinx compares each with all, a third of all its time."""
    del app
    domain = env.domains.python_domain
    find, ends = domain.find_obj, {name.rpartition(".")[2] for name in domain.objects}

    def find_obj(env: BuildEnvironment, module: str, class_: str, name: str, *rest: object) -> list[tuple[str, object]]:
        return find(env, module, class_, name, *rest) if name.removesuffix("()").rpartition(".")[2] in ends else []

    domain.find_obj = find_obj


def shorten_contents(app: Sphinx, env: BuildEnvironment) -> None:
    """List classes without their members beside a page of the reference, where they would hide the classes."""
    del app
    for contents in env.tocs.values():
        for entry in contents.findall(addnodes.compact_paragraph):
            if entry.get("skip_section_number"):
                del entry.parent[1:]


def shorten_navigation(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: object) -> None:
    """Make the navigation of titles, which is all it shows; Sphinx copies every heading of the site for each page else."""
    del page, template, tree
    env, toctree = app.env, context["toctree"]

    def of_titles(**options: object) -> str:
        whole, env.tocs = env.tocs, titles_of(env)
        try:
            return toctree(**options)
        finally:
            env.tocs = whole

    context["toctree"] = of_titles


@functools.cache
def titles_of(env: BuildEnvironment) -> dict[str, nodes.bullet_list]:
    """Return the contents of each page without its headings; pages that it lists stay."""
    titles = {page: contents.deepcopy() for page, contents in env.tocs.items()}
    for contents in titles.values():
        for entry in contents:
            if len(entry) > 1:
                entry[1][:] = list(entry[1].findall(addnodes.toctree))
    return titles


def mathml(text: str, *, block: bool) -> str:
    """Return a formula as MathML; bars about something as a pair of fences, which sets them close to it."""
    return tex2mathml(text.replace(r"\lvert", r"\left\lvert").replace(r"\rvert", r"\right\rvert"), as_block=block)


def visit_math(translator: HTML5Translator, node: nodes.math) -> None:
    """Write an inline formula as MathML, which browsers show without scripts."""
    translator.body.append(mathml(node.astext(), block=False))
    raise nodes.SkipNode


def visit_math_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    r"""Write a displayed formula as MathML, its ``\tag`` beside it."""
    text = node.astext()
    tags = TAG.findall(text)
    number = "".join(f'<span class="eqno">({escape(tag)})</span>' for tag in tags)
    ids = [f"equation-{tag.lower()}" for tag in tags]
    translator.body.append(translator.starttag(node, "div", "", CLASS="math", ids=ids))
    formula = mathml(TAG.sub("", text), block=True)
    translator.body.append(f'<div class="formula">{formula}</div>{number}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register what this site adds to Sphinx, and leave out what takes time and changes no page."""
    gc.disable()  # pages stay to the end of the build, and are looked through again and again
    Parser.parse_definition = lambda _: None  # the lines of definitions, for pages of the source: there are none
    app.connect("source-read", add_toctrees)
    app.connect("source-read", fill)
    app.connect("source-read", fill_gallery)
    app.connect("source-read", add_index_entries)
    app.connect("autodoc-process-docstring", escape_marks, priority=400)  # before napoleon's
    app.connect("autodoc-process-signature", signature_as_written)
    app.connect("env-check-consistency", shorten_search)
    app.connect("env-check-consistency", shorten_contents)
    app.connect("html-page-context", shorten_navigation, priority=400)  # before furo's
    app.connect("missing-reference", find_public_name)
    app.add_directive("rooms", Rooms)
    app.add_directive("public-names", PublicNames)
    app.add_html_math_renderer("mathml", inline_renderers=(visit_math, None), block_renderers=(visit_math_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
