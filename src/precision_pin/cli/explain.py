"""``precision-pin explain``, ``schema`` and ``doctor``."""

from __future__ import annotations

import importlib.resources
import json
import os
import platform
import re
import sys
import textwrap
import tomllib
from typing import Final, NamedTuple

import click

from precision_pin.base.errors import UnknownNameError
from precision_pin.cli.options import Command, argument
from precision_pin.cli.streams import count_columns, echo_data

WIDTH: Final = 100


class CodeMeaning(NamedTuple):
    """Meaning and remedy of some codes, as Markdown."""

    names: tuple[str, ...]
    means: str
    remedy: str


class CodeGroup(NamedTuple):
    """Codes of one kind, with its heading."""

    title: str
    codes: tuple[CodeMeaning, ...]


def list_codes() -> dict[str, CodeGroup]:
    """Return every code of errors and warnings, in groups."""
    text = importlib.resources.files(__package__).joinpath("codes.toml").read_text("utf-8")
    return {
        name: CodeGroup(
            group["title"],
            tuple(CodeMeaning(tuple(entry["names"]), entry["means"], entry["remedy"]) for entry in group["codes"]),
        )
        for name, group in tomllib.loads(text).items()
    }


@click.command("explain", cls=Command)
@argument("codes", metavar="[CODE]...", nargs=-1)
def command(codes: tuple[str, ...]) -> None:
    """Say what a code of an error or a warning means, and what to do about it; without a code, list them all."""
    groups = list_codes()
    known = {name: (group.title, entry) for group in groups.values() for entry in group.codes for name in entry.names}
    if not codes:
        echo_data("\n\n".join(_listed(group) for group in groups.values()))
        return
    asked = [code.strip().upper() for code in codes]
    for code in asked:
        if code not in known:
            raise UnknownNameError("code", code, known)
    echo_data("\n\n".join(_explained(code, *known[code]) for code in dict.fromkeys(asked)))


def _listed(group: CodeGroup) -> str:
    lines = [group.title]
    for meaning in group.codes:
        lines.append(f"  {', '.join(meaning.names)}")
        lines += _wrapped("      ", "      ", meaning.means)
    return "\n".join(lines)


def _explained(code: str, title: str, meaning: CodeMeaning) -> str:
    also = [name for name in meaning.names if name != code]
    named = f"{code}, with {', '.join(also)}" if also else code
    lines = [f"{named} ({title[0].lower()}{title[1:]})", *_wrapped("  means  ", " " * 9, meaning.means)]
    return "\n".join([*lines, *(_wrapped("  to do  ", " " * 9, meaning.remedy) if meaning.remedy else [])])


def _wrapped(first: str, others: str, markdown: str) -> list[str]:
    text = re.sub(r"\[([^]]*)\]\((\w[\w-]*)\.md(?:#[\w-]*)?\)", r"\1 (page \2 of the documentation)", markdown)
    columns = min(count_columns(sys.stdout) or WIDTH, WIDTH)
    return textwrap.wrap(text, columns, initial_indent=first, subsequent_indent=others, break_long_words=False)


@click.command("schema", cls=Command)
def schema() -> None:
    """Print the JSON schema of the sheet, for editors and checkers."""
    from precision_pin.sheet import json_schema

    echo_data(json.dumps(json_schema(), indent=2, ensure_ascii=False))


@click.command("doctor", cls=Command)
def doctor() -> None:
    """Print the versions and paths that a result depends on; good to put into a bug report."""
    import precision_pin
    from precision_pin import sources
    from precision_pin.analyses import registry
    from precision_pin.base.versions import versions
    from precision_pin.draws import laws
    from precision_pin.robot.examples import PAPER_SHEET, example_urdfs

    lines = {
        **versions(),
        "system": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "package": os.path.dirname(os.path.abspath(precision_pin.__file__)),
        "paper's case": f"{PAPER_SHEET} ({'found' if PAPER_SHEET.is_file() else 'MISSING'})",
        "example robots": f"{len(example_urdfs())} (example-robot-data)" if example_urdfs() else "not installed",
    }
    for kind, module in (("analysis", registry), ("source", sources), ("law", laws)):
        for extension in module.extensions():
            said = f"LEFT OUT: {extension.error}" if extension.error else f"{extension.place}, of {extension.package}"
            lines[f"{kind} {extension.name}"] = said
    width = max(map(len, lines))
    echo_data("\n".join(f"{name:<{width}}  {value}" for name, value in lines.items()))
