"""YAML text to plain data that remembers its lines.

Every scalar stays text: units.py reads the numbers, so that ``1e-4``, ``on`` and ``12:30`` mean what they say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, final

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import CollectionEndEvent, CollectionStartEvent
from ruamel.yaml.nodes import MappingNode

from precision_pin.errors import Finding, SheetError

__all__ = ["Path", "Text", "read_text"]

Path = tuple[str | int, ...]
"""Keys and positions from the top of a sheet."""

MOST_LEVELS: Final = 12
MOST_NODES: Final = 50_000


@final
@dataclass(frozen=True)
class Text:
    """A sheet's contents.

    Attributes
    ----------
    data
        Dictionaries, lists and strings.
    lines
        Line of every key and item by its path.
    findings
        Duplicate keys and the like.
    """

    data: Any
    lines: dict[Path, int]
    findings: tuple[Finding, ...]

    def line(self, path: Path) -> int:
        """Return the line of a path, or of the nearest thing that holds it."""
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path, 1)


def read_text(text: str, file: str) -> Text:
    """Return the contents of YAML text.

    Raises
    ------
    SheetError
        Not YAML, or too large or deep.
    """
    findings: list[Finding] = []
    try:
        findings += _look_ahead(text, file)
        root = YAML(typ="safe", pure=True).compose(text)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else None
        raise SheetError(
            [Finding("error", "E_YAML", f"not YAML: {error.problem or error.context}", file, line)]
        ) from None
    except (YAMLError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise SheetError([Finding("error", "E_YAML", f"not YAML: {reason}", file, 1)]) from None
    lines: dict[Path, int] = {}
    count = 0

    def convert(node: Any, path: Path) -> Any:
        nonlocal count
        count += 1
        line = node.start_mark.line + 1
        if count > MOST_NODES or len(path) > MOST_LEVELS:
            raise _too_large(file, line)
        lines.setdefault(path, line)
        if isinstance(node.value, str):
            return node.value
        if not isinstance(node, MappingNode):
            return [convert(item, (*path, k)) for k, item in enumerate(node.value)]
        return convert_mapping(node, path)

    def convert_mapping(node: Any, path: Path) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key_node, value_node in node.value:
            line = key_node.start_mark.line + 1
            key = key_node.value
            if not isinstance(key, str):
                findings.append(Finding("error", "E_YAML", "a key must be a word", file, line))
            elif key in result:
                first = lines[(*path, key)]
                message = f"the key {key!r} stands twice, first in line {first}"
                findings.append(Finding("error", "E_DUPLICATE_KEY", message, file, line))
            else:
                lines[(*path, key)] = line
                result[key] = convert(value_node, (*path, key))
        return result

    data = convert(root, ()) if root is not None else None
    return Text(data, lines, tuple(findings))


def _look_ahead(text: str, file: str) -> list[Finding]:
    """Return findings about tags, from the stream of events.

    Composing nests as deep as the text and knows no limit; this pass does not nest.

    Raises
    ------
    SheetError
        Too large or deep.
    """
    findings: list[Finding] = []
    level = 0
    for count, event in enumerate(YAML(typ="safe", pure=True).parse(text)):
        line = event.start_mark.line + 1
        level += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
        if count > 2 * MOST_NODES or level > MOST_LEVELS:
            raise _too_large(file, line)
        if getattr(event, "tag", None) is not None:
            message = f"the tag {event.tag} is not allowed; every value is plain text"
            findings.append(Finding("error", "E_YAML", message, file, line))
    return findings


def _too_large(file: str, line: int) -> SheetError:
    message = f"the sheet is too large or too deep: at most {MOST_NODES} entries, {MOST_LEVELS} levels"
    return SheetError([Finding("error", "E_YAML", message, file, line)])
