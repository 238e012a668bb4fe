"""Completion in the shell, by the placeholder of an option or argument, such as ``POSE`` or ``FILE.csv``.

Sheet and URDF are read as far as they can be, without the slow libraries that the commands import. The scripts of the shells
are in ``completion.toml``.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from glob import escape, glob
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import click
import yaml
from click import shell_completion as shells
from click.shell_completion import CompletionItem

from precision_pin.base.errors import InputError
from precision_pin.cli.explain import list_codes
from precision_pin.cli.inputs import SHEET_SUFFIXES, beginning, find_inputs
from precision_pin.robot.examples import (
    DESCRIPTIONS,
    PREFIX,
    ROBOT_SUFFIXES,
    example_urdfs,
    find_sheet,
    own_urdfs,
    resolve_robot,
)

MOST_BYTES: Final = 2**17
"""Read of a sheet, in some 0.1 s; of a URDF it is 32 times as much."""
MOST_LEVELS: Final = 20
SINGLE: Final = ("gravity", "statics", "target", "calibrated", "measurement")
SECTIONS: Final = ("parameters", "poses", "locked", *SINGLE)
"""Keys of a sheet, besides its sources, with values that ``--set`` changes."""
QUANTITIES: Final = [
    f"{vector}{part}" for vector in ("position", "attitude") for part in ("", ".norm", ".x", ".y", ".z")
]


def complete(parameter: click.Parameter, context: click.Context, typed: str) -> list[CompletionItem[str]] | None:
    """Return the values of a parameter that begin with a text; None if its placeholder says nothing about them.

    Those of the type ``file`` are quoted as paths; those of the type ``part`` go on without a space.
    """
    placeholder = (parameter.metavar or "").strip("[].")
    suffixes = ("/",) if placeholder == "DIR" else tuple(re.findall(r"\.[a-z]+", placeholder))
    if placeholder in _NAMES:
        names = dict.fromkeys(_NAMES[placeholder](context, typed))
        items = [CompletionItem(name, "part" if name.endswith((".", ":", "=")) else "plain") for name in names]
    elif ".urdf" in suffixes and typed.startswith(PREFIX):
        items = [CompletionItem(PREFIX + name) for name in own_urdfs() | example_urdfs()]
    elif suffixes or isinstance(parameter.type, click.Path):
        data_suffixes = getattr(context.command, "data_suffixes", ()) if isinstance(parameter, click.Argument) else ()
        items = _files(typed, (*suffixes, *data_suffixes, *(SHEET_SUFFIXES if ".yaml" in suffixes else ())))
        items += [CompletionItem(PREFIX, "part")] if ".urdf" in suffixes and PREFIX.startswith(typed) else []
    else:
        return None
    begun = typed.casefold()
    return [item for item in items if item.value.casefold().startswith(begun) and item.value.isprintable()]


def _files(typed: str, suffixes: tuple[str, ...]) -> list[CompletionItem[str]]:
    """Return folders and files with one of the suffixes; all files if none has one and not only folders are wanted."""
    start = os.path.expanduser(typed)
    paths = [typed + path[len(start) :] + "/" * os.path.isdir(path) for path in sorted(glob(f"{escape(start)}*"))]
    fit = {path for path in paths if path.lower().endswith(suffixes)} or (set() if suffixes == ("/",) else {*paths})
    fit |= {path for path in paths if path.endswith("/")}
    return [CompletionItem(path, "part" if path.endswith("/") else "file") for path in paths if path in fit]


class _Pairs(list[Any]):
    """A mapping of YAML text: keys and values in turn."""


def _pairs(node: Any) -> list[tuple[str, Any]]:
    entries = zip(node[::2], node[1::2], strict=False) if isinstance(node, _Pairs) else ()
    return [(key, value) for key, value in entries if isinstance(key, str)]


def _read_yaml(text: str) -> Any:
    """Return YAML text up to its first mistake or a nesting that no sheet has; aliases are left empty."""
    holders: list[list[Any]] = [[]]
    top = holders[0]
    with suppress(yaml.YAMLError):
        for event in yaml.parse(text, Loader=getattr(yaml, "CBaseLoader", yaml.BaseLoader)):
            if len(holders) > MOST_LEVELS:
                break
            if isinstance(event, yaml.CollectionStartEvent):
                holders.append(_Pairs() if isinstance(event, yaml.MappingStartEvent) else [])
                holders[-2].append(holders[-1])
            elif isinstance(event, yaml.NodeEvent):
                holders[-1].append(getattr(event, "value", ""))
            elif isinstance(event, yaml.CollectionEndEvent):
                holders.pop()
    return top[0] if top else None


def _read(context: click.Context) -> tuple[dict[str, Any], Path | None]:
    """Return the keys and values of the sheet before the cursor, and the robot."""
    argument = next(parameter.name for parameter in context.command.params if isinstance(parameter, click.Argument))
    given = context.params.get(argument) or ()
    # click leaves in `args` what is in front of an option without its value
    texts = [*map(os.path.expanduser, [given] if isinstance(given, str) else given), *context.args]
    robots = [text for text in texts if text.startswith(PREFIX) or text.lower().endswith(ROBOT_SUFFIXES)][:1]
    sheets = [text for text in texts if text.lower().endswith(SHEET_SUFFIXES)][:1]
    inputs = find_inputs([*robots, *sheets], sheet_needed=False)
    robot, file = inputs.robot, inputs.sheet
    if robot is not None and file is None:
        file, _ = find_sheet(robots[0], robot)
    if file is None:
        return {}, robot
    sheet = dict(_pairs(_read_yaml(beginning(file, MOST_BYTES).decode(errors="replace"))))
    named = str(sheet.get("robot", ""))
    if robot is None and not named.startswith(DESCRIPTIONS):
        with suppress(InputError):
            robot = resolve_robot(named, file.parent)
    return sheet, robot


def _sources(sheet: dict[str, Any]) -> list[tuple[str, Any]]:
    """Return kind and settings of each source."""
    entries = sheet.get("sources")
    return [pair for entry in entries for pair in _pairs(entry)[:1]] if isinstance(entries, list) else []


def _elements(robot: Path | None) -> Iterator[ElementTree.Element]:
    """Yield the elements of a URDF up to its first mistake."""
    parser: Any = ElementTree.XMLPullParser(["start"])
    parser.feed(b"" if robot is None else beginning(robot, 32 * MOST_BYTES))
    with suppress(ElementTree.ParseError):
        yield from (element for _, element in parser.read_events())


def _links(context: click.Context, _: str) -> Iterator[str]:
    return (element.get("name", "") for element in _elements(_read(context)[1]) if element.tag == "link")


def _joint_values(context: click.Context, typed: str) -> Iterator[str]:
    """Yield what is typed with a further joint that has a value: from base to tip, all if the tip is not stated."""
    sheet, robot = _read(context)
    joints: dict[str, dict[str, str]] = {}
    for element in _elements(robot):
        if element.tag == "joint" and "type" in element.attrib:
            joints[element.get("name", "")] = joint = dict(element.attrib)
        elif element.tag in ("parent", "child", "mimic") and joints:
            joint[element.tag] = element.get("link", "")
    by_child = {joint.get("child"): name for name, joint in joints.items()}
    at, base = (context.params.get(end) or sheet.get(end) for end in ("tip", "base"))
    chain: list[str] = []
    while at in by_child and at != base:
        chain.insert(0, by_child.pop(at))
        at = joints[chain[0]].get("parent")
    held = dict(_pairs(sheet.get("locked")))
    before = re.sub(r"[^,\s][^,]*$", "", typed)
    for name in chain or joints:
        is_fixed = joints[name]["type"] == "fixed" or "mimic" in joints[name] or name in held
        if not is_fixed and f",{name}:" not in f",{before}".replace(" ", ""):
            yield f"{before}{name}:"


def _paths(context: click.Context, typed: str) -> Iterator[str]:
    """Yield the paths of ``--set``, to the next dot or equals sign."""
    sheet, _ = _read(context)
    sources, labels = _sources(sheet), Counter[str]()
    kinds = Counter(kind for kind, _ in sources)
    nodes = [(name, sheet.get(name)) for name in SECTIONS]
    for kind, settings in sources:
        nodes.append((kind if kinds[kind] == 1 else f"{kind}[*]", settings))
        stated = dict(_pairs(settings))
        for name in [stated[key] for key in ("joint", "link", "frame", "at") if key in stated][:1]:
            label = f"{kind}[{name}]"
            labels[label] += 1
            nodes.append((f"{label}#{labels[label]}".removesuffix("#1"), settings))
    for path in (*(f"{name}=" for name in SINGLE), *(path for node in nodes for path in _below(*node))):
        if len(path) > len(typed):
            yield path[: len(typed)] + re.sub(r"([.=]).*", r"\1", path[len(typed) :])


def _below(path: str, node: Any) -> Iterator[str]:
    entries = [(f"[{k}]", item) for k, item in enumerate(node)] if type(node) is list else []
    for step, value in entries or [(f".{key}", value) for key, value in _pairs(node)]:
        yield f"{path}{step}="
        yield from _below(path + step, value)


_NAMES: Final[dict[str, Callable[[click.Context, str], Iterable[str]]]] = {
    "POSE": lambda context, _: (name for name, _ in _pairs(_read(context)[0].get("poses"))),
    "DATUM": lambda context, _: ("none", *(name for name, _ in _pairs(_read(context)[0].get("datums")))),
    "FRAME": _links,
    "LINK": _links,
    "VALUES": _joint_values,
    "PATH=VALUE": _paths,
    "KIND": lambda context, _: (kind for kind, _ in _sources(_read(context)[0])),
    "QUANTITY": lambda *_: QUANTITIES,
    "CODE": lambda *_: (name for group in list_codes().values() for meaning in group.codes for name in meaning.names),
}
"""What completes a placeholder, given the text that is typed."""


def _split(text: str) -> list[str]:
    """Return the words of a line, the begun one last, which is empty after a space."""
    *words, last = shells.split_arg_string(f"{text}x")
    return [*words, last[:-1]]


class _Typed(shells.ShellComplete):
    """Completion of the text before the cursor as it was typed; silent whatever fails."""

    def source(self) -> str:
        """Return the script of the shell."""
        scripts = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
        return str(scripts[self.name]) % self.source_vars()

    def get_completion_args(self) -> tuple[list[str], str]:
        """Return the whole words, and the begun one."""
        words = _split(os.environ.get("COMP_LINE", ""))
        return words[1:-1], words[-1]

    def get_completions(self, args: list[str], incomplete: str) -> list[CompletionItem[str]]:
        """Return whole words, with the option that an equals sign joins."""
        option, equals, _ = incomplete.partition("=")
        before = option + equals if equals and option.startswith("--") else ""
        try:
            items = super().get_completions(args, incomplete)
        except Exception:  # noqa: BLE001 - a traceback would stand in the command line
            return []
        return [CompletionItem(before + item.value, item.type, item.help) for item in items]


class Bash(_Typed, shells.BashComplete):
    """Completion in bash, which breaks words at quotes, colons and equals signs and replaces what follows."""

    def get_completions(self, args: list[str], incomplete: str) -> list[CompletionItem[str]]:
        """Return what takes the place of the last part of the begun word, quoted but for paths."""
        items = super().get_completions(args, incomplete)
        last, is_quoted = (
            os.environ.get("COMP_WORD", incomplete),
            os.environ.get("COMP_QUOTED", "").startswith(("'", '"')),
        )
        start = len(incomplete) - len(last if is_quoted else _split(last)[-1])
        is_escaped = not is_quoted and all(item.type != "file" for item in items)
        for item in items:
            item.value = (
                re.sub(r"[^\w@%+=:,./~-]", r"\\\g<0>", item.value[start:]) if is_escaped else item.value[start:]
            )
        if is_quoted and [item.type for item in items] == ["part"]:
            # bash would close the quote after the only one
            items.append(CompletionItem(f"{items[0].value} ", "part"))
        return items


class Zsh(_Typed, shells.ZshComplete):
    """Completion in zsh."""


class Fish(_Typed, shells.FishComplete):
    """Completion in fish, which itself puts no space after a slash, colon, dot and equals sign."""

    def format_completion(self, item: CompletionItem[str]) -> str:
        """Return a value and its description."""
        return super().format_completion(item).partition(",")[2]


def register() -> None:
    """Let click complete in these shells."""
    for shell in (Bash, Zsh, Fish):
        shells.add_completion_class(shell)
