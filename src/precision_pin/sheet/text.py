"""Parser of YAML text into plain data with line numbers.

Every scalar remains text, so that YAML converts none of ``1e-4``, ``on`` and ``12:30``; units.py reads the numbers.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any, Final

from precision_pin.base.errors import Finding, SheetError

Path = tuple[str | int, ...]
"""Keys and positions from the top of a sheet."""

MOST_LEVELS: Final = 12
MOST_NODES: Final = 100_000
"""Nested levels and nodes of a sheet, aliases expanded: eight levels are needed; 100,000 nodes take 0.6 s, by ruamel 7 s."""

_OTHERWISE: Final = re.compile(
    r"[^\n -~\xa0-\u2027\u202a-\ufefe\uff00-\U0010ffff]|^(?:%|---|\.\.\.)|[{,]\s*:|:\s*[]},]|(?:^|[\s[{,:])[&*!]"
    r"|[|>][-+\d]* *(?:#|$)|.{1000}",
    re.MULTILINE,
)
"""Text that libyaml may read differently: tabs, control characters, other line ends, directives, several documents, empty
keys and values, anchors and tags, block scalars, long keys."""


def written_yaml(data: Mapping[str, Any]) -> str:
    """Return data as the text of a sheet."""
    from ruamel.yaml import YAML  # late: 55 ms, and most sheets are read without it

    writer = YAML()
    writer.width = 120
    text = io.StringIO()
    writer.dump({**data, **({"precision-pin": 1} if "precision-pin" in data else {})}, text)
    return text.getvalue()


def edited_yaml(source: str, data: Mapping[str, Any]) -> str:
    """Return the text of a sheet with other data: its values replaced where they differ, its comments and order kept.

    New keys of the top follow at the end. Where that is not the data, as below an anchor, all is written anew.
    """
    from ruamel.yaml import YAML

    before = read_text(source, "").data
    text = source.removesuffix("\n") + "\n"
    for start, end, value in sorted(_edits(YAML().compose(source), before, data), reverse=True):
        text = text[:start] + value + text[end:]
    added = {key: value for key, value in data.items() if key not in before}
    text += written_yaml(added) if added else ""
    with suppress(SheetError):
        if read_text(text, "").data == data:
            return text
    return written_yaml(data)


def _edits(node: Any, before: Any, after: Any) -> Iterator[tuple[int, int, str]]:
    """Yield begin, end and new text of each value below a node that differs."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key, value in node.value:
            yield from _edits(value, before[key.value], after.get(key.value))
    elif isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        for entry in zip(node.value, before, after, strict=True):
            yield from _edits(*entry)
    elif before != after:
        is_plain = isinstance(after, str) and re.fullmatch(r"[\w±][\w ±+./*^()%°·-]*", after)
        yield node.start_mark.index, node.end_mark.index, after if is_plain else json.dumps(after, ensure_ascii=False)


@dataclass(frozen=True)
class Text:
    """A sheet's contents.

    Attributes:
        lines: Line of every key and item by its path.
        findings: Findings about the text itself, such as duplicate keys.
        changes: Names of later changes in messages, by path.
    """

    data: Any
    lines: dict[Path, int]
    findings: tuple[Finding, ...]
    changes: Mapping[Path, str] = field(default_factory=dict)

    def line(self, path: Path) -> int | None:
        """Return the line of a path, or of the innermost entry around it; None if the data were not text."""
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path)

    def change(self, path: Path) -> str | None:
        """Return the name of the change that a path is part of, if any."""
        return next((name for changed, name in self.changes.items() if path[: len(changed)] == changed), None)


@dataclass(slots=True)
class _Node:
    """A scalar with its ``text``, a list, or a mapping with keys and values in turn as entries."""

    line: int
    text: str | None = None
    is_mapping: bool = False
    entries: list[_Node] = field(default_factory=list)


def read_text(text: str, file: str) -> Text:
    """Return the contents of YAML text.

    libyaml, some ten times faster, reads valid text; ruamel.yaml reads text with findings or possible differences.
    """
    findings: list[Finding] = []

    def wrong(message: str, line: int | None) -> Finding:
        return Finding("error", "E_YAML", message, file, line)

    quick = _read_with_libyaml(text, file, wrong)
    if quick is not None:
        return quick
    from ruamel.yaml import YAML, events
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        root = _compose(YAML(typ="safe", pure=True).parse(text), events, findings, wrong)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else None
        raise SheetError([wrong(f"not YAML: {error.problem or error.context}", line)]) from None
    except (YAMLError, ValueError, OverflowError) as error:
        # raised by the parser, though not its own errors, for numbers out of range such as \UFFFFFFFF
        raise SheetError([wrong(f"not YAML: {str(error).splitlines()[0]}", 1)]) from None
    return _Conversion(file, findings, wrong).text(root)


Wrong = Callable[[str, int | None], Finding]


def _read_with_libyaml(text: str, file: str, wrong: Wrong) -> Text | None:
    """Return the contents of YAML text; None if there are findings, or if libyaml is missing or may differ."""
    try:
        from yaml import YAMLError as OtherError
        from yaml import events as kinds
        from yaml.cyaml import CParser
    except ImportError:  # PyYAML can be built without libyaml
        return None
    if _OTHERWISE.search(text):
        return None
    findings: list[Finding] = []
    try:
        root = _compose(iter(CParser(text).get_event, None), kinds, findings, wrong)
        result = _Conversion(file, findings, wrong).text(root)
    except (OtherError, SheetError, ValueError):
        return None
    return None if findings else result


def _compose(stream: Iterable[Any], kinds: ModuleType, findings: list[Finding], wrong: Wrong) -> _Node | None:
    """Return the tree of a stream of events, without recursion, since text may be nested to any depth."""
    # Every alias adds the anchor's node once more. `kinds` is the module `events` of either library.
    open_nodes: list[_Node] = [_Node(1)]
    anchors: dict[str, _Node] = {}
    documents = 0
    ends, starts = kinds.CollectionEndEvent, kinds.CollectionStartEvent
    scalars, mappings = kinds.ScalarEvent, kinds.MappingStartEvent
    for count, event in enumerate(stream):
        line = event.start_mark.line + 1
        if count > 2 * MOST_NODES or len(open_nodes) > MOST_LEVELS + 1:
            raise SheetError([_too_large(wrong, line)])
        if isinstance(event, ends):
            open_nodes.pop()
        elif isinstance(event, kinds.DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise SheetError(
                    [wrong("not YAML: a sheet must be a single document, but another one begins here", line)]
                )
        elif isinstance(event, kinds.AliasEvent):
            node = anchors.get(event.anchor)
            if node is None or any(node is holder for holder in open_nodes):
                reason = "has no anchor above it" if node is None else "is inside its own anchor"
                raise SheetError([wrong(f"not YAML: the alias {event.anchor!r} {reason}", line)])
            open_nodes[-1].entries.append(node)
        elif isinstance(event, kinds.NodeEvent):
            tag = getattr(event, "tag", None)
            if tag is not None:
                findings.append(wrong(f"the tag {tag} is not allowed; every value is plain text", line))
            node = _Node(line, event.value if isinstance(event, scalars) else None, isinstance(event, mappings))
            open_nodes[-1].entries.append(node)
            if event.anchor is not None:
                anchors[event.anchor] = node
            if isinstance(event, starts):
                open_nodes.append(node)
    return next(iter(open_nodes[0].entries), None)


class _Conversion:
    """Recursive conversion of a tree to plain data, with a limit on the depth of expanded aliases."""

    def __init__(self, file: str, findings: list[Finding], wrong: Wrong) -> None:
        self._file, self._findings, self._wrong = file, findings, wrong
        self._lines: dict[Path, int] = {}
        self._count = 0

    def text(self, root: _Node | None) -> Text:
        self._lines[()] = 1 if root is None else root.line
        data = None if root is None else self._convert(root, ())
        return Text(data, self._lines, tuple(self._findings))

    def _convert(self, node: _Node, path: Path) -> Any:
        self._count += 1
        if self._count > MOST_NODES or len(path) > MOST_LEVELS:
            raise SheetError([_too_large(self._wrong, node.line)])
        self._lines.setdefault(path, node.line)
        if node.text is not None:
            return self._word(node.text, node.line)
        if node.is_mapping:
            return self._convert_mapping(node, path)
        return [self._convert(entry, (*path, k)) for k, entry in enumerate(node.entries)]

    def _convert_mapping(self, node: _Node, path: Path) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key_node, value_node in zip(node.entries[::2], node.entries[1::2], strict=True):
            if key_node.text is None:
                self._findings.append(self._wrong("a key must be a word", key_node.line))
                continue
            key = self._word(key_node.text, key_node.line)
            if key in result:
                first = self._lines[(*path, key)]
                message = f"the key {key!r} is given twice, first in line {first}"
                self._findings.append(Finding("error", "E_DUPLICATE_KEY", message, self._file, key_node.line))
            else:
                self._lines[(*path, key)] = key_node.line
                result[key] = self._convert(value_node, (*path, key))
        return result

    def _word(self, word: str, line: int) -> str:
        if word.isascii() or not any("\ud800" <= letter <= "\udfff" for letter in word):
            return word
        self._findings.append(self._wrong("half of a surrogate pair, such as \\ud800, is no character", line))
        return ""


def _too_large(wrong: Wrong, line: int) -> Finding:
    return wrong(f"the sheet is too large or too deep: at most {MOST_NODES:,} entries, {MOST_LEVELS} levels", line)
